"""An emulated candleLight adapter with a simulated gripper on its bus; run as root in the VM.

The kernel's own gs_usb driver makes an interface of it, for the adapter is plugged into the ports
of `vhci_hcd`. Lines on its control socket, each a connection of its own, are answered with "ok" or
with what is wrong: plug, unplug, short, mend, error, end.
"""

from __future__ import annotations

import argparse
import contextlib
import selectors
import socket
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import build_gripper
from litegripd.sim.interface import MotorWire
from tests.vm.gs_usb import Adapter, Identity
from tests.vm.usbip import FULL_SPEED, Endpoints, Handlers

VHCI = Path("/sys/devices/platform/vhci_hcd.0")
ADVANCE_S = 0.02
WATCHDOG_S = 0.4
"""The motor's: as long as is taken, for an emulated machine stalls."""


def control_path(serial: str) -> Path:
    """Return the path of an adapter's control socket."""
    return Path(f"/run/emulated-{serial}.sock")


class Device:
    """The adapter, its cable to the host, and the motor behind it. One thread."""

    def __init__(self, serial: str, port: int, selector: selectors.BaseSelector) -> None:
        self._port = port
        self._selector = selector
        self._wire = MotorWire(build_gripper(watchdog_s=WATCHDOG_S))
        self._adapter = Adapter(Identity(serial), self._carry)
        self._endpoints = self._fresh_endpoints()
        self._cable: socket.socket | None = None
        self.is_ended = False
        self.commands: dict[str, Callable[[], None]] = {
            "plug": self.plug,
            "unplug": self.unplug,
            "short": lambda: self._short(shorted=True),
            "mend": lambda: self._short(shorted=False),
            "error": self._adapter.report_error,
            "end": self._end,
        }

    def plug(self) -> None:
        """Plug the adapter in."""
        if self._cable is not None:
            raise ValueError("it is plugged in already")
        self._endpoints = self._fresh_endpoints()
        self._cable, of_kernel = socket.socketpair()
        with of_kernel:
            line = f"{self._port} {of_kernel.fileno()} {self._port + 1} {FULL_SPEED}"
            (VHCI / "attach").write_text(line)
        self._selector.register(self._cable, selectors.EVENT_READ, self._serve_host)

    def unplug(self) -> None:
        """Pull the adapter out; the motor keeps its power."""
        if self._cable is None:
            raise ValueError("it is unplugged already")
        (VHCI / "detach").write_text(str(self._port))  # first: the kernel notices the end as well
        self._let_go(self._cable)

    def advance(self) -> None:
        """Let the motor live on, and tell the host what there is to tell."""
        now_s = time.monotonic()
        self._wire.gripper.advance(now_s)
        for _, frame in self._wire.late(now_s):
            self._adapter.from_bus(frame)
        if self._cable is not None:
            self._cable.sendall(self._endpoints.flush())

    def _fresh_endpoints(self) -> Endpoints:
        adapter = self._adapter
        return Endpoints(Handlers(adapter.control, adapter.from_host, adapter.next_packet))

    def _carry(self, frame: CanFrame) -> None:
        now_s = time.monotonic()
        for _, answer in self._wire.carry(now_s, now_s, frame):
            self._adapter.from_bus(answer)

    def _short(self, *, shorted: bool) -> None:
        self._adapter.shorted = shorted

    def _end(self) -> None:
        if self._cable is not None:
            self.unplug()
        self.is_ended = True

    def _serve_host(self) -> None:
        cable = self._cable
        if cable is None:
            return
        data = cable.recv(65536)
        if not data:
            self._let_go(cable)
            return
        cable.sendall(self._endpoints.feed(data))

    def _let_go(self, cable: socket.socket) -> None:
        self._selector.unregister(cable)
        cable.close()
        self._cable = None
        self._adapter.unplug()


def main() -> int:
    """Serve one adapter until it is told to end."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("serial")
    parser.add_argument("--port", type=int, default=0, help="of vhci_hcd, 0 to 7")
    parser.add_argument("--unplugged", action="store_true", help="wait for 'plug'")
    arguments = parser.parse_args()
    subprocess.run(["modprobe", "vhci-hcd"], check=True)
    path = control_path(arguments.serial)
    path.unlink(missing_ok=True)
    with (
        selectors.DefaultSelector() as selector,
        socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener,
    ):
        device = Device(arguments.serial, arguments.port, selector)
        if not arguments.unplugged:
            device.plug()
        listener.bind(str(path))
        listener.listen()
        selector.register(listener, selectors.EVENT_READ, lambda: _serve_command(listener, device))
        while not device.is_ended:
            for key, _ in selector.select(ADVANCE_S):
                key.data()
            device.advance()
    path.unlink()
    return 0


def _serve_command(listener: socket.socket, device: Device) -> None:
    """Carry out the one line of a connection."""
    connection, _ = listener.accept()
    with connection, contextlib.suppress(ConnectionError):
        name = connection.makefile().readline().strip()
        command = device.commands.get(name)
        try:
            if command is None:
                raise ValueError(f"no command {name!r}; there are: {', '.join(device.commands)}")
            command()
            answer = "ok"
        except (OSError, ValueError) as error:
            answer = str(error)
        connection.sendall(f"{answer}\n".encode())


if __name__ == "__main__":
    sys.exit(main())
