"""Two grippers on two USB adapters: names by serial number, a group for each, and a reboot."""

import contextlib
from functools import partial
from pathlib import Path

from tests.vm.emulated import Emulated
from tests.vm.guest import check, reaches, reasons
from tests.vm.installing import installed
from tests.vm.unit import CONFIGURATION, Unit, ctl, flags, is_set_up, must, type_printed, typed

PERSONS = {"left": "lena", "right": "rick"}
"""Who may use which gripper."""

PAGE = Path("/mnt/host/tests/installation.md")
SERIALS = {"004A00375553500E20393256": "LEFT", "002B00474D4D500120363531": "RIGHT"}
"""Those of the page, and those of the emulated adapters."""
RULE = Path("/usr/local/lib/udev/rules.d/85-litegrip.rules")
RULES = Path("/etc/udev/rules.d/70-can-names.rules")
_LINK = "[Match]\nProperty=ID_SERIAL_SHORT=RIGHT\n\n[Link]\nName=right\n"
"""The other way of the page."""


def page_blocks() -> list[str]:
    """Return the commands of the page's section on several adapters, block by block."""
    section = PAGE.read_text().partition("\n## Several adapters\n")[2].partition("\n## ")[0]
    blocks = section.split("```\n")[1::2]
    for theirs, ours in SERIALS.items():
        blocks = [block.replace(theirs, ours) for block in blocks]
    return blocks


def type_block(block: str) -> str:
    """Type a block as it stands; return what it printed."""
    status, out = typed(f"set -e\n{block}")
    check(f"typed as on the page: {block.splitlines()[0]}", status == 0, out)
    return out


def adapters() -> tuple[Emulated, Emulated]:
    """Return left and right; at boot, the right one is there first."""
    return Emulated("LEFT", port=1, after="RIGHT"), Emulated("RIGHT", port=2)


def two_grippers() -> None:
    """Two adapters with names of their own, by the page word by word, for two groups of people."""
    forget, look, name_them, install, use = page_blocks()
    one = installed()
    type_block(forget)
    one.tell("end")
    left, right = adapters()
    left.start()
    seen = type_block(look).splitlines()
    socket, serial = (line.strip() for line in seen[2:4])
    check("the lines are those of the page", _are_as_told(seen), seen)
    right.start()
    type_block(name_them)
    for name, person in PERSONS.items():
        give(name, person)
    must("systemctl", "daemon-reload")
    for adapter in (left, right):
        adapter.unplug()
        adapter.plug()
    type_printed(type_block(install), "root")
    type_block(use)
    check("no daemon waits for can0", not Unit().is_active(), Unit().tell())
    check("and no rule brings it up", "can0" not in RULE.read_text().splitlines()[-1])
    check_both(left, right)
    left.unplug()
    left.plug()
    check("replugged, it is left again", reaches(partial(left.is_named, "left")))
    check_gripper("left")
    by_socket_and_link(left, right, serial, socket)
    for adapter in (left, right):
        must("systemctl", "enable", adapter.unit)


def _are_as_told(seen: list[str]) -> bool:
    """Return True if the page's command prints the four lines that it tells of."""
    names = [line.strip().partition("==")[0] for line in seen]
    is_interface = [":" in line for line in seen[1:3]]
    return names == ["ATTR{dev_id}", "KERNELS", "KERNELS", "ATTRS{serial}"] and is_interface == [
        True,
        False,
    ]


def by_socket_and_link(left: Emulated, right: Emulated, serial: str, socket: str) -> None:
    """The other ways of the page: the left one by its socket, the right one by a .link file."""
    line = RULES.read_text().splitlines()[0]
    check("the rule has the serial number", serial in line, f"{serial} {line}")
    RULES.write_text(f"{line.replace(serial, socket)}\n")
    Path("/etc/systemd/network/70-right.link").write_text(_LINK)
    must("udevadm", "control", "--reload")
    for adapter, name in ((left, "left"), (right, "right")):
        adapter.unplug()
        adapter.plug()
        named = reaches(partial(adapter.is_named, name))
        check(f"{name}, named by the other way", named, adapter.interface())
        check_gripper(name)
    RULES.write_text(f"{line}\n")  # at the next boot they come at other sockets
    must("udevadm", "control", "--reload")


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
    with (CONFIGURATION.parent / f"{name}.toml").open("a") as configuration:
        configuration.write(f'[control]\nrate_hz = 100\npriority = 0\n[rpc]\ngroup = "{group}"\n')
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
