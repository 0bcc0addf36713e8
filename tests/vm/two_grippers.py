"""Two grippers on two USB adapters: names by serial number, a group for each, and a reboot."""

import contextlib
from functools import partial
from pathlib import Path

from tests.vm.emulated import Emulated
from tests.vm.guest import check, reaches, reasons
from tests.vm.installing import installed
from tests.vm.unit import CONFIGURATION, SLOW, Unit, ctl, flags, install_units, is_set_up, must

PERSONS = {"left": "lena", "right": "rick"}
"""Who may use which gripper."""

_RULE = 'ACTION=="add", SUBSYSTEM=="net", ATTR{type}=="280", ATTRS{serial}=="LEFT", NAME="left"'
_LINK = "[Match]\nProperty=ID_SERIAL_SHORT=RIGHT\n\n[Link]\nName=right\n"
"""The two ways of the documentation."""


def adapters() -> tuple[Emulated, Emulated]:
    """Return left and right; at boot, the right one is there first."""
    return Emulated("LEFT", port=1, after="RIGHT"), Emulated("RIGHT", port=2)


def two_grippers() -> None:
    """Two adapters with names by their serial numbers, for two groups of people."""
    one = installed()
    must("systemctl", "disable", "--now", "litegripd@can0")
    one.tell("end")
    for name, person in PERSONS.items():
        give(name, person)
    Path("/etc/udev/rules.d/70-can-names.rules").write_text(f"{_RULE}\n")
    Path("/etc/systemd/network/70-right.link").write_text(_LINK)
    must("systemctl", "daemon-reload")
    must("udevadm", "control", "--reload")
    left, right = adapters()
    left.start()
    right.start()
    install_units("root", *PERSONS)
    check_both(left, right)
    left.unplug()
    left.plug()
    check("replugged, it is left again", reaches(partial(left.is_named, "left")))
    check_gripper("left")
    for adapter in (left, right):
        must("systemctl", "enable", adapter.unit)


def grippers_after_reboot() -> None:
    """Both are there after a reboot, though the adapters came in the other order."""
    left, right = adapters()
    for adapter in (right, left):
        check(f"{adapter.serial} is there", reaches(adapter.is_there))
    check_both(left, right)


def give(name: str, person: str) -> None:
    """Let this person's group have the gripper of this name: its unit's group and its sockets'."""
    group = f"{person}s"
    must("groupadd", "--system", group)
    must("useradd", "--create-home", "--groups", group, person)
    configuration = SLOW + f'[rpc]\ngroup = "{group}"\n'
    (CONFIGURATION.parent / f"{name}.toml").write_text(configuration)
    drop_in = Path(f"/etc/systemd/system/litegripd@{name}.service.d/group.conf")
    drop_in.parent.mkdir(parents=True)
    drop_in.write_text(f"[Service]\nGroup={group}\n")


def check_both(left: Emulated, right: Emulated) -> None:
    """See each under its name, at work, and used by its own persons alone, restarts or not."""
    for adapter, name in ((left, "left"), (right, "right")):
        named = reaches(partial(adapter.is_named, name))
        check(f"the adapter {adapter.serial} is {name}", named, adapter.interface())
        check_gripper(name)
    check_persons()
    for name in PERSONS:
        Unit(name).restart()
        check_persons(f" after a restart of {name}")


def check_gripper(name: str) -> None:
    """See one interface up, and its motor found."""
    up = reaches(partial(is_set_up, name, restart_ms=0))
    check(f"udev brings {name} up", up, flags(name))
    unit = Unit(name)
    check(f"the daemon of {name} runs", reaches(unit.is_active), unit.tell())
    with contextlib.closing(unit.rpc()) as rpc:
        found = reaches(lambda: rpc.bus_is("up") and rpc.state()["motor"] in ("disabled", "fault"))
        check(f"the motor of {name} is found", found, reasons(rpc))


def check_persons(when: str = "") -> None:
    """See that each may use one gripper, its software stop included, and not the other."""
    for name, person in PERSONS.items():
        status, out = ctl(person, "enable", channel=name)
        check(f"{person} enables {name}{when}", status == 0, out)
        status, out = ctl(person, "stop", channel=name)
        check(f"{person} stops {name}{when}", status == 0, out)
        with contextlib.closing(Unit(name).rpc()) as rpc:
            rpc.call("stop.clear")
        (other,) = set(PERSONS.values()) - {person}
        status, out = ctl(other, "state", channel=name)
        check(f"{other} is refused {name}{when}", status == 3 and "ermission" in out, out)
