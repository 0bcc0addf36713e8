"""USB adapters of the kernel's gs_usb driver: installed, plugged, shorted, mended. Run in the VM.

The adapters are emulated, their driver is not. What is printed as a command is typed as printed.
"""

import json
import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from tests.vm.emulated import Emulated
from tests.vm.guest import Rpc, check, ip, pause, play, reaches, reasons
from tests.vm.installing import ONE, installed
from tests.vm.two_grippers import grippers_after_reboot, two_grippers
from tests.vm.unit import (
    PROGRAMS,
    Unit,
    ctl,
    flags,
    is_set_up,
    link,
    must,
    run,
    typed,
)

STAYS_S = 5.0
"""For how long a state has to stay: longer than any that the daemon holds for a while."""


def adapter_refuses_restart() -> None:
    """What the kernel makes of `restart-ms` for an adapter whose driver knows none."""
    adapter = Emulated(ONE)
    adapter.start()
    command = "ip link set can0 type can bitrate 1000000 restart-ms 100"
    status, out = run(*command.split())
    check("the kernel refuses it", status != 0 and "support restart" in out, f"{status} {out}")
    data = link("can0").get("linkinfo", {}).get("info_data", {})
    check("and knows no restart time of it", not data.get("restart_ms"), data)
    adapter.unplug()
    adapter.plug()


def adapter_installed() -> None:
    """Installation by the words of the documentation, on a gs_usb adapter that is plugged in."""
    installed()
    up = reaches(lambda: is_set_up("can0", restart_ms=0))
    check("udev has brought can0 up", up, flags("can0"))
    unit = Unit()
    check("the unit is active", unit.is_active(), unit.tell())
    rpc = unit.rpc()
    check("the motor is found", reaches(partial(rpc.motor_is, "disabled")), reasons(rpc))
    reaches(lambda: bool(rpc.state()["calibrated"]))
    for command in ("enable", "open", "close", "disable"):
        status, out = ctl("alice", command)
        check(f"litegripctl {command}", status == 0, out)
    findings = complaints()
    check("doctor finds nothing to mend", not findings, findings)
    rpc.close()


def adapter_replugged() -> None:
    """The adapter is pulled out while the jaws are held, and plugged in again."""
    adapter, unit = installed(), Unit()
    rpc, before = unit.rpc(), unit.pid
    hold(rpc)
    adapter.unplug()
    check("unplugged: noticed", reaches(partial(rpc.bus_is, "adapter_gone")), reasons(rpc))
    told = reaches(lambda: "adapter_gone" in unit.show("StatusText"))
    check("unplugged: STATUS says so", told, unit.show("StatusText"))
    adapter.plug()
    up = reaches(lambda: is_set_up("can0", restart_ms=0))
    check("plugged in: udev brings it up", up, flags("can0"))
    works_again(rpc, "plugged in")
    check("the daemon never ended", unit.pid == before and unit.is_active(), unit.tell())
    adapter.unplug()
    unit.stop()
    adapter.plug()
    check("a stopped one is started by udev", reaches(unit.is_active), unit.tell())
    rpc.close()


def adapter_bus_off() -> None:
    """The wires are shorted while the jaws are held; mended, the printed remedies bring it back."""
    adapter, unit = installed(), Unit()
    rpc = unit.rpc()
    leave_bus(adapter, rpc)
    until_s = rpc.call("health")["uptime_s"] + STAYS_S
    states = set()
    while (health := rpc.call("health"))["uptime_s"] < until_s:
        states.add(health["bus"]["state"])
        pause.wait(0.2)
    check(f"and called so for {STAYS_S} s", states == {"bus_off"}, states)
    check("STATUS says so", "bus_off" in unit.show("StatusText"), unit.show("StatusText"))
    state = link("can0").get("linkinfo", {}).get("info_data", {}).get("state")
    check("the kernel says so", state == "BUS-OFF", state)
    adapter.tell("mend")
    check("wires alone mend nothing", not rpc.bus_is("up"), reasons(rpc))
    type_remedies(adapter, "bus off")
    works_again(rpc, "bus off, by doctor", phases=("enabled",))  # the last remedy is to enable it
    leave_bus(adapter, rpc)
    adapter.tell("mend")
    reaches(lambda: "bus_off" in unit.show("StatusText"))  # it is told a little later
    type_last_of(unit.show("StatusText"))
    works_again(rpc, "bus off, by STATUS")
    ip("link set can0 down")
    reaches(partial(rpc.bus_is, "link_down"))
    type_last_of(reasons(rpc))
    works_again(rpc, "link down, by health")
    rpc.close()


def adapter_error_frames() -> None:
    """An error on the bus is counted, and stops nothing."""
    adapter, unit = installed(), Unit()
    rpc = unit.rpc()
    reaches(partial(rpc.bus_is, "up"))
    rpc.insist("motor.enable")
    before = rpc.call("health")["bus"]["error_frames"]
    adapter.tell("error")
    counted = reaches(lambda: bool(rpc.call("health")["bus"]["error_frames"] > before))
    check("an error frame is counted", counted, rpc.call("health")["bus"])
    check("and the motor stays enabled", rpc.motor_is("enabled"), rpc.state()["motor"])
    rpc.call("motor.disable")
    rpc.close()


def wrong_bit_rate() -> None:
    """Set the adapter up with half the bit rate."""
    ip("link set can0 down")
    ip("link set can0 type can bitrate 500000")
    ip("link set can0 up")


def in_mode(mode: str) -> None:
    """Set the adapter up in a mode in which no motor answers."""
    ip("link set can0 down")
    ip(f"link set can0 type can bitrate 1000000 {mode} on")
    ip("link set can0 up")


RULE = Path("/etc/udev/rules.d/99-can.rules")


def another_rule() -> None:
    """Have a rule of somebody else's set another rate at the next plug."""
    command = "/sbin/ip link set %k up type can bitrate 500000"
    RULE.write_text(f'ACTION=="add", SUBSYSTEM=="net", KERNEL=="can0", RUN+="{command}"\n')


STATES: tuple[tuple[str, Callable[[], object]], ...] = (
    ("link down", partial(ip, "link set can0 down")),
    ("another bit rate", wrong_bit_rate),
    ("only listening", partial(in_mode, "listen-only")),
    ("looping back", partial(in_mode, "loopback")),
    ("a rule that sets another bit rate", another_rule),
    ("a long queue", partial(ip, "link set can0 txqueuelen 1000")),
    ("the daemon stopped", partial(must, "systemctl", "stop", "litegripd@can0")),
)


def doctors_remedies() -> None:
    """What doctor prints is typed in the state in which it prints it."""
    adapter = installed()
    for what, spoil in STATES:
        spoil()
        found = reaches(lambda: bool(remedies()))
        check(f"{what}: doctor names a command", found, complaints())
        type_remedies(adapter, what)


def wrong_rate_is_named() -> None:
    """A wrong bit rate is told as what it is, and the daemon's own words correct it."""
    installed()
    unit = Unit()
    rpc = unit.rpc()
    reaches(partial(rpc.bus_is, "up"))
    wrong_bit_rate()
    slow = "can0 runs at 0.5 Mbit/s, and the motor speaks at 1 Mbit/s"
    check("health names the bit rate", reaches(lambda: slow in reasons(rpc)), reasons(rpc))
    check("and has it as a figure", rpc.call("health")["bus"]["bitrate"] == 500_000)
    journal = run("journalctl", "-u", "litegripd@can0", "-o", "cat")[1]
    check("so does the journal", slow in journal, journal[-2000:])
    type_last_of(reasons(rpc))
    works_again(rpc, "another bit rate, by health")
    told = reaches(lambda: rpc.call("health")["bus"]["bitrate"] == 1_000_000)
    check("the right bit rate is read again", told, reasons(rpc))
    rpc.close()


def leave_bus(adapter: Emulated, rpc: Rpc) -> None:
    """Short the wires while the jaws are held."""
    hold(rpc)
    adapter.tell("short")
    check("shorted: the bus is off", reaches(partial(rpc.bus_is, "bus_off")), reasons(rpc))


def type_last_of(text: str) -> None:
    """Type the command at the end of a sentence that says what to do."""
    command = text[text.find("sudo ") :].partition(";")[0] if "sudo " in text else ""
    status, out = typed(command)
    check(f"typed as printed: {command}", bool(command) and status == 0, out or text)


def hold(rpc: Rpc) -> None:
    """Have the motor hold the jaws open."""
    reaches(lambda: rpc.state()["motor"] in ("disabled", "enabled"))
    reaches(lambda: bool(rpc.state()["calibrated"]))
    check("the jaws hold", rpc.insist("motion.open").get("ok") is True, rpc.state()["mode"])


OFF = ("disabled", "fault")


def works_again(rpc: Rpc, what: str, phases: tuple[str, ...] = OFF) -> None:
    """See bus and motor back, the motor in one of these phases, and it can be used."""
    found = reaches(lambda: rpc.bus_is("up") and rpc.state()["motor"] in phases)
    check(f"{what}: bus and motor are back", found, f"{reasons(rpc)} {flags('can0')}")
    check(f"{what}: the motor can be enabled", rpc.insist("motor.enable").get("ok") is True)
    check(f"{what}: it moves", rpc.insist("motion.close").get("ok") is True, reasons(rpc))
    rpc.call("motor.disable")


def complaints() -> list[dict[str, Any]]:
    """Return what doctor finds not to be all right, but for what no adapter can be blamed for."""
    out = run(f"{PROGRAMS}/litegripctl", "doctor", "--json")[1]
    rows: list[dict[str, Any]] = json.loads(out)["findings"]
    return [row for row in rows if row["level"] != "ok" and row["check"] not in OTHERS]


OTHERS = ("calibration", "real-time", "health")
"""The calibration that was not measured on this gripper, and a slow machine."""
REMEDIES_AT_MOST = 4


def remedies() -> list[str]:
    """Return the commands that doctor names now."""
    return [row["command"] for row in complaints() if row["command"] is not None]


def names_other_than(commands: list[str]) -> bool:
    """True if doctor names other commands now."""
    return remedies() != commands


def type_remedies(adapter: Emulated, what: str) -> None:
    """Type the first command of doctor's as it stands, and ask anew, until it has none."""
    for _ in range(REMEDIES_AT_MOST):
        if not (commands := remedies()):
            break
        status, out = typed(commands[0])
        check(f"{what}: typed as printed: {commands[0]}", status == 0, out)
        reaches(partial(names_other_than, commands), limit_s=20.0)
    mended = not remedies()
    check(f"{what}: doctor names no command any more", mended, complaints())
    if not mended:  # the next scene has something of its own to tell
        adapter.unplug()
        adapter.plug()


FIRST = (
    adapter_refuses_restart,
    adapter_installed,
    adapter_replugged,
    adapter_bus_off,
    adapter_error_frames,
    wrong_rate_is_named,
    doctors_remedies,
    two_grippers,
)
SECOND = (grippers_after_reboot,)


def main() -> int:
    """Run the scenes of one boot, or those that are named; return 0 when every check passed."""
    boot, *names = sys.argv[1:]
    if boot == "1" and "grippers_after_reboot" in names:
        names.append("two_grippers")
    scenes = FIRST if boot == "1" else SECOND
    return play([scene for scene in scenes if not names or scene.__name__ in names])


if __name__ == "__main__":
    sys.exit(main())
