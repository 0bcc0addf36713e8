"""What fails under systemd: the daemon is killed or hangs, the interface goes and comes."""

import os
import signal
from functools import partial
from pathlib import Path

from tests.vm.attended import at_work
from tests.vm.guest import check, ip, reaches, reasons
from tests.vm.unit import PROGRAMS, STATE, Unit, ctl, is_set_up, link, must, run


def crash_dumps() -> int:
    """How many dumps of crashes there are."""
    return len(list((STATE / "dumps/can0").glob("*-crash.mcap")))


def killed() -> None:
    """kill -9 of the daemon: it comes back, the motor is off, the last minute is written."""
    ends_and_returns(signal.SIGKILL, "killed", "signal")


def hung() -> None:
    """SIGSTOP: the watchdog ends what does nothing any more."""
    ends_and_returns(signal.SIGSTOP, "hung", "watchdog")


def ends_and_returns(number: signal.Signals, what: str, result: str) -> None:
    """Send a signal to a daemon that holds; see it return."""
    unit = Unit()
    with at_work(unit) as rpc:
        check(f"{what}: the motor is enabled before", rpc.insist("motor.enable").get("ok") is True)
        before, restarts, dumps = unit.pid, unit.restarts, crash_dumps()
        os.kill(before, number)
        took_s = unit.comes_back(before)
        check(f"{what}: it is back", took_s is not None, f"{took_s} s")
        check(f"{what}: by one start", unit.restarts == restarts + 1, unit.tell())
        told = must("journalctl", "--no-pager", "-b", "--output=cat", f"--unit={unit.name}")
        check(f"{what}: systemd says why", f"with result '{result}'" in told)
        check(f"{what}: its last minute is written", reaches(lambda: crash_dumps() == dumps + 1))
    with at_work(unit) as rpc:
        state = rpc.state()
        check(f"{what}: the motor is not enabled", state["motor"] != "enabled", state["motor"])
        check(f"{what}: it can be used", rpc.insist("motor.enable").get("ok") is True)
        rpc.call("motor.disable")


def full_tmp() -> None:
    """With /tmp full a unit cannot be started (226): it is tried again until there is room."""
    unit = Unit()
    with at_work(unit):
        must("mount", "-t", "tmpfs", "-o", "nr_inodes=1", "full", "/tmp")
        try:
            before = unit.pid
            unit.stop()  # of one that is restarted, some versions of systemd keep the /tmp
            must("systemctl", "start", "--no-block", unit.name)
            fails = reaches(lambda: unit.show("ExecMainStatus") == "226")
            check("full /tmp: it cannot start", fails, unit.tell())
            tries = unit.restarts
            goes_on = reaches(lambda: unit.restarts >= tries + 2)
            check("full /tmp: it is tried again", goes_on, unit.tell())
        finally:
            must("umount", "/tmp")
        took_s = unit.comes_back(before)
        check("full /tmp: with room, it is back by itself", took_s is not None, f"{took_s} s")


def full_disk() -> None:
    """With the state directory's disk full, who acts is told so; with room it all works again."""
    unit = Unit()
    unit.stop()
    small = STATE.with_name("litegripd-small")
    must("cp", "-a", str(STATE), str(small))
    must("mount", "-t", "tmpfs", "-o", "size=20m", "small", str(STATE))
    try:
        must("bash", "-c", f"cp -a {small}/. {STATE}/ && chown litegrip:litegrip {STATE}")
        told_of_a_full_disk(unit)
    finally:
        unit.stop()
        must("umount", str(STATE))
        must("rm", "-r", str(small))
        unit.start()


def told_of_a_full_disk(unit: Unit) -> None:
    """Fill the disk of a running daemon, see each that writes told, free it, see each write."""
    from tests.trajectories import lgt  # noqa: PLC0415 - a bare system has no litegripd

    path = STATE / "can0_calibration.json"
    full = f"No space left on {STATE}"
    taught = Path("/home/alice/taught.lgt")
    taught.write_bytes(lgt([(number * 0.01, 0.5) for number in range(1000)]))
    taught.chmod(0o644)
    acts = (
        ("calibration", "load", "normal", "--keep"),
        ("dump", "--note", "full"),
        ("trajectories", "put", str(taught)),
        ("config", "set", "speed_mm_s=30", "--keep"),
    )
    with at_work(unit) as rpc:
        ctl("alice", "calibration", "load", "normal", "--keep")
        before, pid = path.read_bytes(), unit.pid
        filler = STATE / "filler"
        run("dd", "if=/dev/zero", f"of={filler}", "bs=64k")
        named = reaches(lambda: full in reasons(rpc))
        check("full disk: health names it", named, reasons(rpc))
        out = run(f"{PROGRAMS}/litegripctl", "-c", "can0", "doctor")[1]
        check("full disk: so does the doctor", "ERROR    disk" in out and full in out, out)
        for act in acts:
            status, out = ctl("root", *act)  # who may keep settings, too
            told = f"on {STATE}" in out and "bytes free" in out
            check(f"full disk: {act[0]} is refused with the cause", status != 0 and told, out)
        check("full disk: the calibration of before is there", path.read_bytes() == before)
        check("full disk: it still can be used", rpc.insist("motor.enable").get("ok") is True)
        filler.unlink()
        gone = reaches(lambda: full not in reasons(rpc))
        check("with room: health is content", gone, reasons(rpc))
        for act in acts:
            status, out = ctl("root", *act)  # who may keep settings, too
            check(f"with room: {act[0]} works", status == 0, out)
        check("with room: without a restart", unit.pid == pid, unit.tell())
        rpc.call("motor.disable")


def interface_goes_and_comes() -> None:
    """The interface is set down and up, its card is removed and found: the daemon goes on."""
    unit = Unit()
    must("systemctl", "enable", unit.name)
    with at_work(unit) as rpc:
        before, restarts = unit.pid, unit.restarts
        ip("link set can0 down")
        check("link down: noticed", reaches(partial(rpc.bus_is, "link_down")), reasons(rpc))
        told = reaches(lambda: "down" in unit.show("StatusText"))
        check("link down: STATUS says so", told, unit.show("StatusText"))
        ip("link set can0 up")
        found = reaches(lambda: rpc.motor_is("disabled") and rpc.bus_is("up"))
        check("link up: the motor is found", found, reasons(rpc))
        unplug()
        gone = reaches(partial(rpc.bus_is, "adapter_gone"))
        check("unplugged: noticed", gone, reasons(rpc))
        plug()
        found = reaches(lambda: rpc.motor_is("disabled") and rpc.bus_is("up"))
        check("plugged in: udev brings it up, the motor is found", found, reasons(rpc))
        same = (unit.pid, unit.restarts) == (before, restarts)
        check("the daemon never ended", same and unit.is_active(), unit.tell())


def started_by_udev() -> None:
    """An enabled unit that was stopped is started when the interface appears."""
    unit = Unit()
    must("systemctl", "enable", unit.name)
    with at_work(unit) as rpc:
        rpc.insist("motor.enable")
        unit.stop()
        check("systemctl stop: as it should", unit.show("Result") == "success", unit.tell())
        unplug()
        check("it stays stopped without the interface", not unit.is_active(), unit.tell())
        plug()
        check("and is started with it", reaches(unit.is_active), unit.tell())
        found = reaches(lambda: unit.rpc().motor_is("disabled"))
        check("and finds the motor", found, unit.tell())
    must("systemctl", "disable", unit.name)
    unit.stop()
    unplug()
    plug()
    reaches(lambda: "UP" in link("can0").get("flags", ()))
    must("udevadm", "settle")
    check("one that is not enabled is not", unit.show("ActiveState") == "inactive", unit.tell())
    must("systemctl", "enable", unit.name)


def beside_networkd() -> None:
    """Where systemd-networkd runs, and an earlier version had it do it: the rule does now."""
    networks = Path("/usr/local/lib/systemd/network")
    networks.mkdir(parents=True, exist_ok=True)
    old = networks / "80-litegrip.network"
    old.write_text("[Match]\nName=can0\n\n[CAN]\nBitRate=1000000\nRestartSec=100ms\n")
    must("systemctl", "enable", "--now", "systemd-networkd")
    print(must(f"{PROGRAMS}/litegripctl", "install-units", "--can", "can0", "--can", "can1"))
    must("networkctl", "reload")
    must("udevadm", "control", "--reload")
    check("what had networkd do it is removed", not old.exists())
    unplug()
    plug()
    check("the rule brings can0 up", reaches(partial(is_set_up, "can0")), link("can0"))
    must("udevadm", "settle")
    told = must("networkctl", "--no-pager", "status", "can0")
    check("networkd leaves can0 alone", "unmanaged" in told and is_set_up("can0"), told)


def unplug() -> None:
    """Take the card of can0 out of its bus."""
    (Path("/sys/class/net/can0/device").resolve() / "remove").write_text("1")
    if not reaches(lambda: not link("can0")):
        raise TimeoutError("can0 is still there")


def plug() -> None:
    """Have the bus look for cards."""
    Path("/sys/bus/pci/rescan").write_text("1")
    if not reaches(lambda: bool(link("can0"))):
        raise TimeoutError("can0 does not come back")


FAILING_UNITS = (
    killed,
    hung,
    full_tmp,
    full_disk,
    interface_goes_and_comes,
    started_by_udev,
    beside_networkd,
)
