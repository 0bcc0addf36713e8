"""A lab: robots and operators, each on a machine of its own, and a router on another one."""

import contextlib
import os
import subprocess
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from tests.process.daemon_process import Client, DaemonProcess, configured, ran
from tests.process.fleet.fleet_process import SITE, Fleet, started
from tests.process.fleet.machines import Machines, machines

ROUTER = "router"
ROBOTS = {"robot1": "left", "robot2": "right"}
"""The gripper of each."""

OPERATORS = ("op1", "op2")
CERTIFICATES = (ROUTER, *(f"gateway:{name}" for name in ROBOTS), *(f"user:{n}" for n in OPERATORS))
"""As `make_certificates` takes them."""


@dataclass(frozen=True, slots=True)
class Lab:
    """All of it. The parts of the fleet are called as the machines on which they run."""

    machines: Machines
    fleet: Fleet
    grippers: Mapping[str, DaemonProcess]

    def socket_path(self, operator: str = "op1", gripper: str = "left") -> Path:
        """Return where an operator's machine has a gripper's socket."""
        return self.fleet.socket_path(gripper, operator)

    def stop_path(self, operator: str = "op1", gripper: str = "left") -> Path:
        """Return where an operator's machine has a gripper's socket for stops."""
        return self.socket_path(operator, gripper).with_suffix(".stop.sock")

    def client(self, operator: str = "op1", gripper: str = "left") -> Client:
        """Connect as a program on an operator's machine."""
        return Client(self.socket_path(operator, gripper))

    def run(self, operator: str, *command: str) -> "subprocess.CompletedProcess[str]":
        """Run a command on an operator's machine."""
        directory = str(self.fleet.runtime_directory(operator))
        return ran(
            *self.machines.on(operator), *command, env={**os.environ, "XDG_RUNTIME_DIR": directory}
        )


@contextlib.contextmanager
def lab(
    folder: Path,
    certificates: Path,
    *,
    robots: Sequence[str] = tuple(ROBOTS),
    operators: Sequence[str] = OPERATORS,
    ttl_s: float = 1.0,
) -> Iterator[Lab]:
    """Run daemons, gateways, router and portals, and have the motors ready."""
    users = dict.fromkeys(operators, "operator")
    own = {name: [ROBOTS[name]] for name in robots}
    with contextlib.ExitStack() as stack:
        made = stack.enter_context(machines(ROUTER, *robots, *operators))
        grippers: dict[str, DaemonProcess] = {}
        for robot in robots:
            # A socket's path has 107 bytes at most.
            short = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="robot-")))
            own_daemon = configured(short, f"{robot}-{os.getpid()}", on=made.on(robot))
            grippers[ROBOTS[robot]] = stack.enter_context(own_daemon)
        for running in grippers.values():
            with running.connect() as client:
                client.until(lambda state: bool(state["motor"] == "disabled"))
        on = {name: made.on(name) for name in made.names}
        fleet = stack.enter_context(started(folder / "fleet", certificates, ROUTER, on))
        fleet.start_router(users, own)
        for robot, (gripper,) in own.items():
            fleet.start_gateway({gripper: grippers[gripper].socket_path}, robot, robot)
        for operator in operators:
            fleet.start_portal(operator, "operator", list(grippers), ttl_s, operator)
        for robot, (gripper,) in own.items():
            fleet.parts[robot].until_says(f"{SITE}.{gripper}: ")
        yield Lab(made, fleet, grippers)
