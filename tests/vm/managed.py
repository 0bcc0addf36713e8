"""What a unit asks of systemd, and what it does when that cannot be had."""

import contextlib
import socket
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tests.vm.attended import RESTARTS_AT_MOST, at_work, patient_motor
from tests.vm.guest import Rpc, check, reaches
from tests.vm.unit import CONFIGURATION, PROGRAMS, SLOW, STATE, Unit, must, run

DROP_INS = Path("/run/systemd/system")
NOTIFY_SOCKET = "/run/systemd/notify"
MANAGER = Path("/sys/fs/cgroup/init.scope/cgroup.freeze")
STARTS_OF_LOOP = 3


@contextlib.contextmanager
def drop_in(unit: Unit, content: str) -> Iterator[None]:
    """Change a unit for a while; it is restarted by whoever wants that."""
    file = DROP_INS / f"{unit.name}.d/scene.conf"
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(f"[Service]\n{content}\n")
    must("systemctl", "daemon-reload")
    try:
        yield
    finally:
        file.unlink()
        must("systemctl", "daemon-reload")


def group_of(name: str) -> str:
    """Return the group of one of the channels' files."""
    return Path("/run/litegripd", name).group()


def groups_of_channels() -> None:
    """One channel's group leaves the other channel alone, whichever is started last."""
    first, second = Unit("can0"), Unit("vcan0")
    must("groupadd", "--system", "robots")
    of_second = CONFIGURATION.parent / "vcan0.toml"
    of_second.write_text(SLOW + '[rpc]\ngroup = "robots"\n')
    with at_work(first), patient_motor("vcan0"), drop_in(second, "Group=robots"):
        for unit in (second, first):
            unit.restart()
            names = ("can0.sock", "can0.stop.sock", "vcan0.sock", "vcan0.stop.sock")
            groups = [group_of(name) for name in names]
            wanted = ["litegrip", "litegrip", "robots", "robots"]
            check(f"{unit.channel} anew: each socket has its group", groups == wanted, groups)
            check("the state is everybody's", STATE.group() == "litegrip")
        found = reaches(lambda: second.rpc().motor_is("disabled"))
        check("the other daemon works", found, second.tell())
        second.stop()
    of_second.write_text(SLOW)


def packages_that_are_missing() -> None:
    """An interpreter without its packages, as after a release upgrade, ends the unit."""
    unit = Unit()
    unit.stop()
    (packages,) = Path(PROGRAMS).parent.glob("lib/python3.*/site-packages")
    away = packages.with_name("away")
    packages.rename(away)
    try:
        run("systemctl", "start", unit.name)
        ended = reaches(lambda: unit.show("ActiveState") == "failed")
        check("missing packages end the unit", ended and unit.restarts == 0, unit.tell())
        check("as what it is", unit.show("ExecMainStatus") == "5", unit.show("ExecMainStatus"))
        said = must("journalctl", "--unit", unit.name, "--output=cat", "--no-pager", "--lines=20")
        check("the journal says what to do", "docs/installation.md" in said, said)
    finally:
        away.rename(packages)
        run("systemctl", "reset-failed", unit.name)
    unit.start()
    check("mended, it starts", unit.is_active(), unit.tell())


def program_that_cannot_run() -> None:
    """A program that is not there ends the unit; one that always fails is tried more rarely."""
    unit = Unit()
    unit.stop()
    program = Path(PROGRAMS, "litegripd")
    away = program.with_name("litegripd.away")
    program.rename(away)
    try:
        run("systemctl", "start", unit.name)
        ended = reaches(lambda: unit.show("ActiveState") == "failed")
        check("203/EXEC ends the unit", ended and unit.restarts == 0, unit.tell())
        check("as what it is", unit.show("ExecMainStatus") == "203", unit.show("ExecMainStatus"))
        program.write_text("#!/bin/sh\nexit 1\n")
        program.chmod(0o755)
        run("systemctl", "start", unit.name)
        tried = reaches(lambda: unit.restarts >= STARTS_OF_LOOP)
        check("exit status 1 is tried again", tried, unit.tell())
        if unit.show("RestartSteps"):
            later = unit.show("RestartUSecNext")
            check("later and later", later != unit.show("RestartUSec"), later)
        program.chmod(0o700)
        status, out = run(f"{PROGRAMS}/litegripctl", "install-units")
        check("install-units refuses what others cannot run", status != 0 and "0700" in out, out)
    finally:
        program.unlink(missing_ok=True)
        away.rename(program)
        run("systemctl", "stop", unit.name)
        run("systemctl", "reset-failed", unit.name)
    unit.start()
    check("mended, it starts", unit.is_active(), unit.tell())


def manager_that_does_not_read() -> None:
    """A restart that holds while systemd stands still and its queue is full: it is told later."""
    unit = Unit()
    with drop_in(unit, "WatchdogSec=120"):
        unit.stop()  # it is started anew beside a motor that has its settings
        with at_work(unit) as rpc:
            check("the motor is enabled", rpc.insist("motor.enable").get("ok") is True)
            before = unit.pid
            MANAGER.write_text("1")
            try:
                fill_queue()
                after = restarted(before)
                check("a successor has taken over", after != before, after)
                is_left = Path(f"/proc/{before}").exists()
                check("the old daemon waits for systemd", is_left)
            finally:
                MANAGER.write_text("0")
            followed = reaches(lambda: unit.pid == after)
            check("systemd follows the successor", followed and unit.is_active(), unit.tell())
            gone = reaches(lambda: not Path(f"/proc/{before}").exists())
            check("the old daemon has ended", gone)
            with contextlib.closing(unit.rpc()) as successor:
                check("the motor is enabled still", successor.motor_is("enabled"))
                successor.call("motor.disable")
                reaches(partial(successor.motor_is, "disabled"))
    unit.restart()


def fill_queue() -> None:
    """Tell systemd so much that there is no room for anything more."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as sender:
        sender.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while sender.sendto(b"STATUS=a scene", NOTIFY_SOCKET):
                pass


def restarted(before: int) -> int:
    """Restart without letting go, by the daemon alone; return its pid."""
    for _ in range(RESTARTS_AT_MOST):
        with contextlib.closing(Rpc("can0")) as rpc:
            rpc.insist("motor.enable")
            answer = rpc.call("daemon.restart", hold_through_restart=True)
        if "pid" in answer:
            return int(answer["pid"])
        print(f"      {answer}", flush=True)
    return before


MANAGED = (
    groups_of_channels,
    packages_that_are_missing,
    program_that_cannot_run,
    manager_that_does_not_read,
)
