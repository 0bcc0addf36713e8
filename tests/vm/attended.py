"""The features of a daemon whose unit shuts it off: what it keeps, links, adapters, restarts."""

import contextlib
import os
import signal
import subprocess
from collections.abc import Iterator
from functools import partial
from pathlib import Path

from tests.vm.guest import REGISTERS, Rpc, check, reaches, running, simulator
from tests.vm.unit import (
    CONFIGURATION,
    PROGRAMS,
    SLOW,
    STATE,
    Unit,
    ctl,
    must,
    run,
    status_of,
)

RESTARTS_AT_MOST = 12
"""An emulated machine may need longer for the handover than the motor can wait; then the daemon
goes on as it was, and it is tried again."""

WATCHDOG_OF_400_MS = "08005509401F0000"  # write register 9 of motor 8: 8000 times 50 µs
HOLDER = """
import os, signal
from litegrip_client import LiteGrip
gripper = LiteGrip("can0")
gripper.connect()
with gripper.lease("scene"):
    if os.fork() == 0:
        signal.pause()  # has the connection, too
    print("leased", flush=True)
    signal.pause()
"""


@contextlib.contextmanager
def patient_motor(channel: str) -> Iterator[None]:
    """Simulate a motor whose watchdog waits 0.4 s, as long as is taken: this machine stalls."""
    with simulator(channel):
        subprocess.run(["cansend", channel, f"{REGISTERS}#{WATCHDOG_OF_400_MS}"], check=True)
        yield


@contextlib.contextmanager
def at_work(unit: Unit) -> Iterator[Rpc]:
    """Have the daemon run with a motor that answers; give a connection."""
    with patient_motor("can1"):
        if not unit.is_active():
            unit.start()
        with contextlib.closing(unit.rpc()) as rpc:
            reaches(lambda: rpc.state()["motor"] in ("disabled", "enabled"))
            reaches(lambda: bool(rpc.state()["calibrated"]))
            # The write of the register has motions refused, and enabling, until it is quiet again.
            reaches(lambda: not rpc.call("health")["motor"]["foreign_active"])
            yield rpc


def kept_things() -> None:
    """Dumps, calibration, trajectories, the home: what a daemon shut off by its unit can write."""
    from tests.trajectories import lgt  # noqa: PLC0415 - a bare system has no litegripd

    with at_work(Unit()):
        status, out = ctl("alice", "calibration", "load", "normal", "--keep")
        kept = STATE / "can0_calibration.json"
        check("a calibration is kept", status == 0 and kept.owner() == "litegrip", out)
        copy = Path("/home/alice/jerk.mcap")
        status, out = ctl("alice", "dump", "--note", "scene", "-o", str(copy))
        check("alice gets a copy of a dump", status == 0 and copy.stat().st_size > 1000, out)
        readable, out = run("runuser", "-u", "bob", "--", "ls", str(STATE / "dumps"))
        check("which is not for bob", readable != 0, out)
        taught = Path("/home/alice/pick.lgt")
        taught.write_bytes(lgt([(number * 0.01, 0.5) for number in range(100)]))
        status, out = ctl("alice", "trajectories", "put", str(taught))
        stored = list(STATE.rglob("pick.lgt"))
        check("a trajectory is kept", status == 0 and len(stored) == 1, f"{out} {stored}")
        environment = Path(f"/proc/{Unit().pid}/environ").read_text()
        home = f"HOME={STATE}"
        check("its ~/.litegrip is in its state directory", home in environment.split("\0"))


def clients_of_others() -> None:
    """Clients of other users: their names, and the end of a process whose socket lives on."""
    with at_work(Unit()) as rpc:
        command = ("runuser", "-u", "alice", "--", f"{PROGRAMS}/python", "-c", HOLDER)
        with running(*command) as program:
            leased = reaches(lambda: rpc.call("lease.get").get("owner") is not None)
            check("alice has the lease", leased, program.log.read_text())
            holder = rpc.call("lease.get")["owner"] or {}
            row = next(c for c in rpc.call("clients.list")["clients"] if c["pid"] == holder["pid"])
            uid = int(must("id", "-u", "alice"))
            check("the kernel's word on who it is", row["uid"] == uid, row)
            named = "python" in row["program"] or "litegrip" in row["program"]
            check("and its program has a name", named, row["program"])
            os.kill(row["pid"], signal.SIGKILL)
            lost = reaches(lambda: rpc.call("lease.get").get("owner") is None)
            check("its end is noticed though a fork has the socket", lost)
            run("pkill", "-KILL", "-u", "alice", "-f", "signal.pause")


def links() -> None:
    """Teleoperation over zenoh and UDP: a process with network and without rights."""
    with at_work(Unit()) as rpc:
        rpc.insist("motor.enable")
        for kind, more in (("zenoh", ()), ("udp", ("--host", "127.0.0.1"))):
            status, out = ctl("alice", "teleop", "master", "--link", kind, "--detach", *more)
            check(f"teleop leads over {kind}", status == 0, out)

            def is_open() -> bool:
                return '"open"' in ctl("alice", "--json", "teleop", "status")[1]

            opened = reaches(is_open)
            check(f"the {kind} link is open", opened, ctl("alice", "teleop", "status")[1])
            policies = {must("chrt", "--pid", str(pid)) for pid in Unit().processes()}
            ordinary = all("SCHED_FIFO" not in policy for policy in policies)
            check("and no process has a priority", ordinary, len(policies))
            ctl("alice", "teleop", "stop")
        rpc.call("motor.disable")


def restart_that_holds() -> None:
    """litegripctl restart --hold and systemctl reload: the unit stays, its process is another."""
    unit = Unit()
    with at_work(unit) as rpc:
        rpc.insist("motor.enable")
        before, restarts = unit.pid, unit.restarts
        held, tries = hold_through(("runuser", "-u", "root", "--", *restart_command()))
        check("restart --hold", held, f"{tries} tries")
        followed = reaches(lambda: unit.pid not in (0, before))
        check("systemd follows the successor", followed and unit.is_active(), unit.tell())
        with contextlib.closing(unit.rpc()) as successor:
            check("the motor is enabled still", successor.motor_is("enabled"))
            check("and it is the main process", successor.call("hello")["pid"] == unit.pid)
            began_s = successor.call("health")["uptime_s"]
            later_s = began_s + 8.0  # longer than WatchdogSec
            reaches(lambda: bool(successor.call("health")["uptime_s"] > later_s))
        check("the successor feeds the watchdog", unit.restarts == restarts, unit.tell())
        check("and tells its status", "client" in unit.show("StatusText"), unit.show("StatusText"))
    reload_access(unit)


def restart_command() -> tuple[str, ...]:
    """The command that restarts the daemon of can0."""
    return (f"{PROGRAMS}/litegripctl", "-c", "can0", "restart", "--hold")


def hold_through(command: tuple[str, ...]) -> tuple[bool, int]:
    """Restart by a command until that succeeds; tell whether it has, and the tries."""
    for number in range(1, RESTARTS_AT_MOST + 1):
        with contextlib.closing(Rpc("can0")) as rpc:
            if not rpc.motor_is("enabled"):
                rpc.insist("motor.enable")
        status, out = run(*command)
        if status == 0:
            return True, number
        print(f"      try {number}: {out}", flush=True)
    return False, RESTARTS_AT_MOST


def reload_access(unit: Unit) -> None:
    """A changed [access] is in force after `systemctl reload`; a changed [bus] refuses it."""
    with at_work(unit):
        CONFIGURATION.write_text(SLOW + '[access]\ndefault = "observer"\n')
        before = unit.pid
        reloaded, tries = hold_through(("systemctl", "reload", unit.name))
        check("systemctl reload", reloaded and unit.is_active(), f"{tries} tries; {unit.tell()}")
        check("follows a successor as well", unit.pid not in (0, before))
        status, out = ctl("alice", "enable")
        check("alice only observes now", status == 9, out)
        CONFIGURATION.write_text(SLOW.replace("[gripper]", "[bus]\nbitrate = 500000\n[gripper]"))
        before = unit.pid
        status, out = run("systemctl", "reload", unit.name)
        check("another [bus] makes the reload fail", status != 0, out)
        check("and leaves the daemon as it is", unit.is_active() and unit.pid == before)
        CONFIGURATION.write_text(SLOW)
        unit.restart()


def serial_adapter() -> None:
    """SLCAN by the drop-in: the pump process, on a pseudo-terminal in place of a serial port."""
    must(f"{PROGRAMS}/litegripctl", "install-units", "--serial")
    must("systemctl", "daemon-reload")
    command = (f"{PROGRAMS}/litegrip-sim", "--pty")
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stdin=subprocess.DEVNULL, text=True)
    try:
        assert process.stdout is not None
        terminal = process.stdout.readline().strip()
        Path(terminal).chmod(0o666)
        bus = f'[bus]\ninterface = "slcan"\nchannel = "{terminal}"\nsleep_after_open = 0\n'
        (CONFIGURATION.parent / "arm.toml").write_text(bus + SLOW)
        unit = Unit("arm")
        unit.start()
        with contextlib.closing(unit.rpc()) as rpc:
            found = reaches(partial(rpc.motor_is, "disabled"))
            check("the motor is found over SLCAN", found, unit.tell())
            reaches(lambda: bool(rpc.state()["calibrated"]))
            check("it can be enabled", rpc.insist("motor.enable").get("ok") is True)
            rpc.call("motor.disable")
        groups = status_of(unit.pid, "Groups").split()
        dialout = must("getent", "group", "dialout").split(":")[2]
        check("it has the group of serial ports", dialout in groups, groups)
        unit.stop()
        check("it ended as it should", unit.show("Result") == "success", unit.tell())
    finally:
        process.terminate()
        process.wait()


def two_channels() -> None:
    """Two daemons at once, and both ended by their target."""
    first, second = Unit("can0"), Unit("vcan0")
    with at_work(first) as one, patient_motor("vcan0"):
        second.start()
        with contextlib.closing(second.rpc()) as other:
            reaches(partial(other.motor_is, "disabled"))
            reaches(lambda: bool(other.state()["calibrated"]))
            for name, rpc in (("can0", one), ("vcan0", other)):
                enabled = rpc.insist("motor.enable")
                check(f"{name}'s motor is enabled", enabled.get("ok") is True, enabled)
                rpc.call("motor.disable")
        must("systemctl", "enable", "litegripd.target", "litegripd@can0", "litegripd@vcan0")
        must("systemctl", "start", "litegripd.target")
        must("systemctl", "stop", "litegripd.target")
        ended = reaches(lambda: not first.is_active() and not second.is_active())
        check("the target ends both", ended, f"{first.tell()} {second.tell()}")
        must("systemctl", "disable", "litegripd@vcan0")


ATTENDED = (
    kept_things,
    clients_of_others,
    links,
    restart_that_holds,
    serial_adapter,
    two_channels,
)
