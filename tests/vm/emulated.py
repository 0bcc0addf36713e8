"""Emulated adapters as services of the virtual machine: started, told what to do, asked."""

import socket
from pathlib import Path

from tests.vm.gs_usb_device import control_path
from tests.vm.guest import reaches
from tests.vm.unit import PROGRAMS, must

_SERVICE = """
[Unit]
Description=An emulated gs_usb adapter with a gripper
RequiresMountsFor=/mnt/host
{order}
[Service]
Environment=PYTHONPATH=/mnt/host
ExecStart={programs}/python -m tests.vm.gs_usb_device {serial} --port {port}
ExecStartPost=/bin/sh -c 'until [ -S {control} ]; do sleep 0.1; done'
[Install]
WantedBy=multi-user.target
"""


class Emulated:
    """One adapter with its gripper; `after` is one that is plugged in before it at boot."""

    def __init__(self, serial: str, port: int = 0, after: str | None = None) -> None:
        self.serial = serial
        self.unit = f"emulated-{serial}.service"
        self._control = control_path(serial)
        order = "" if after is None else f"After=emulated-{after}.service"
        text = _SERVICE.format(
            order=order, programs=PROGRAMS, serial=serial, port=port, control=self._control
        )
        Path("/etc/systemd/system", self.unit).write_text(text)
        must("systemctl", "daemon-reload")

    def start(self) -> None:
        """Let there be such an adapter, plugged in as it is at its start."""
        must("systemctl", "start", self.unit)
        if not reaches(self.is_there):
            raise TimeoutError(f"the kernel makes no interface of {self.serial}")

    def tell(self, command: str) -> None:
        """Give it one of its commands."""
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connection:
            connection.connect(str(self._control))
            connection.sendall(f"{command}\n".encode())
            answer = connection.makefile().readline().strip()
        if answer != "ok":
            raise RuntimeError(f"{self.serial}: {command}: {answer}")

    def plug(self) -> None:
        """Plug it in, and wait for its interface."""
        self.tell("plug")
        if not reaches(self.is_there):
            raise TimeoutError(f"{self.serial} does not come back")

    def unplug(self) -> None:
        """Pull it out, and wait until its interface has gone."""
        self.tell("unplug")
        if not reaches(lambda: not self.is_there()):
            raise TimeoutError(f"{self.serial} is still there")

    def is_there(self) -> bool:
        """True if it has a network interface."""
        return self.interface() is not None

    def is_named(self, name: str) -> bool:
        """True if its network interface has this name."""
        return self.interface() == name

    def interface(self) -> str | None:
        """Return the name of its network interface, None while there is none."""
        for interface in Path("/sys/class/net").iterdir():
            serial = (interface / "device").resolve().parent / "serial"
            try:
                if serial.read_text().strip() == self.serial:
                    return interface.name
            except OSError:
                continue  # none of USB, or it has gone meanwhile
        return None
