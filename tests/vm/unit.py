"""What the scenes on systemd are made of: units, users, and what systemd tells of a unit."""

import json
import subprocess
import time
from pathlib import Path
from typing import Any

from tests.vm.guest import Rpc, check, reaches

PROGRAMS = "/opt/litegripd/bin"
CONFIGURATION = Path("/etc/litegripd/can0.toml")
STATE = Path("/var/lib/litegripd")
SLOW = '[gripper]\nmount = "normal"\n[control]\nrate_hz = 100\npriority = 0\n'
"""Half the usual rate, without priority: an emulated machine has no more to give."""


def run(*command: str, limit_s: float = 120.0) -> tuple[int, str]:
    """Run a command; return its exit status and all that it printed."""
    done = subprocess.run(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        timeout=limit_s,
        check=False,
    )
    return done.returncode, done.stdout.strip()


def must(*command: str) -> str:
    """Run a command that has to succeed; return what it printed."""
    status, out = run(*command)
    if status != 0:
        raise RuntimeError(f"{' '.join(command)}: exit status {status}: {out}")
    return out


def typed(line: str) -> tuple[int, str]:
    """Run a line as it would be typed into a shell; return its exit status and what it printed."""
    return run("bash", "-c", line)


def ctl(user: str, *arguments: str, channel: str = "can0") -> tuple[int, str]:
    """Run litegripctl as a user."""
    program = f"{PROGRAMS}/litegripctl"
    return run("runuser", "-u", user, "--", program, "-c", channel, *arguments)


class Unit:
    """One channel's unit."""

    def __init__(self, channel: str = "can0") -> None:
        self.channel = channel
        self.name = f"litegripd@{channel}.service"

    def show(self, name: str) -> str:
        """Return one of its properties."""
        return must("systemctl", "show", "--property", name, "--value", self.name)

    @property
    def pid(self) -> int:
        """The main process, 0 while there is none."""
        return int(self.show("MainPID"))

    @property
    def restarts(self) -> int:
        """How often systemd has started it anew since it was started."""
        return int(self.show("NRestarts"))

    def is_active(self) -> bool:
        """True if it runs and is ready."""
        return self.show("ActiveState") == "active"

    def tell(self) -> str:
        """Say how it is."""
        names = "ActiveState,SubState,Result,MainPID,NRestarts,StatusText"
        return " ".join(must("systemctl", "show", "--property", names, self.name).split("\n"))

    def start(self) -> None:
        """Start it, and wait until it is ready."""
        must("systemctl", "start", self.name)

    def restart(self) -> None:
        """Restart it, and wait until it is ready."""
        must("systemctl", "restart", self.name)

    def stop(self) -> None:
        """Stop it, and wait until it has ended."""
        must("systemctl", "stop", self.name)

    def comes_back(self, before: int) -> float | None:
        """Wait for another main process than `before` to be ready; tell how long it took."""
        began_s = time.monotonic()

        def is_back() -> bool:
            return self.pid not in (0, before) and self.is_active()

        return time.monotonic() - began_s if reaches(is_back) else None

    def processes(self) -> list[int]:
        """Return the pids of all of its processes."""
        group = self.show("ControlGroup")
        return [int(pid) for pid in Path(f"/sys/fs/cgroup{group}/cgroup.procs").read_text().split()]

    def rpc(self) -> Rpc:
        """Connect to the daemon, as root."""
        return Rpc(self.channel)


def status_of(pid: int, name: str) -> str:
    """Return one line of a process's /proc/PID/status."""
    lines = Path(f"/proc/{pid}/status").read_text().splitlines()
    return next(line.partition(":")[2].strip() for line in lines if line.startswith(f"{name}:"))


def link(name: str) -> dict[str, Any]:
    """Return what `ip` tells of an interface, with its CAN settings; nothing without one."""
    status, out = run("ip", "-json", "-details", "link", "show", name)
    return json.loads(out)[0] if status == 0 else {}


def flags(name: str) -> str:
    """Say in which state an interface is."""
    return " ".join(link(name).get("flags", ["not there"]))


def is_set_up(name: str, restart_ms: int = 100) -> bool:
    """True if a CAN interface is as the rule sets it; 0 for one that knows no restart."""
    found = link(name)
    data = found.get("linkinfo", {}).get("info_data", {})
    return (
        "UP" in found.get("flags", ())
        and data.get("bittiming", {}).get("bitrate") == 1_000_000
        and data.get("restart_ms", 0) == restart_ms
        and found.get("txqlen") == 10
    )


def install_units(user: str, *channels: str) -> None:
    """Run it for these channels, and then what it prints, word for word."""
    options = [option for channel in channels for option in ("--can", channel)]
    out = must(f"{PROGRAMS}/litegripctl", "install-units", *options)
    type_printed(out, user)


def type_printed(out: str, user: str) -> None:
    """Type what install-units has printed, word for word."""
    print(out, flush=True)
    following = out.partition("next, as root:\n")[2].splitlines()
    for line in following:
        if line.startswith("note: "):
            continue
        status, said = typed(line.strip().replace("USER", user))
        check(f"typed as printed: {line.strip()}", status == 0, said)
