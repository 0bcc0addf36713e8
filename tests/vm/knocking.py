"""A fleet's router that somebody without a certificate knocks at, as a unit. Run as root in the VM.

The router is this machine's; the lab, with gateway, portal and users, and the stranger are network
namespaces with addresses of their own. What protects the router is typed as the page has it.
"""

import contextlib
import itertools
import json
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from tests.vm import knocker
from tests.vm.attended import at_work
from tests.vm.guest import Program, check, ip, pause, play, reaches, running
from tests.vm.unit import CONFIGURATION, PROGRAMS, SLOW, Unit, ctl, install_units, must, run, typed

PAGE = Path("/mnt/host/tests/fleet-security.md")
SECTION = "\n## Who keeps everybody out of the router\n"
CERTIFICATES = "/mnt/host/source/etc/zenoh-certificates"
TLS = Path("/etc/litegripd/tls")
MACHINES = Path("/etc/litegripd/machines")
UNITS = Path("/etc/systemd/system")
ROUTER, GATEWAY, PORTAL = (
    f"litegripd-fleet@{part}.service" for part in ("router", "gateway", "portal")
)
CLOSED = UNITS / f"{ROUTER}.d/override.conf"
NFTABLES = Path("/etc/nftables.conf")
HOSTS = Path("/etc/netns/lab/hosts")
PORT = 7447

ADDRESSES = {
    "lab": ("192.168.1.1/24", "192.168.1.2/24", "fd00:1::1/64", "fd00:1::2/64"),
    "stranger": ("192.168.2.1/24", "192.168.2.2/24", "fd00:2::1/64", "fd00:2::2/64"),
}
"""Of each cable: the router's end and the other's, by IPv4 and by IPv6. Those of the lab are the
page's."""
FAMILIES = {"IPv4": 0, "IPv6": 2}

KEPT, AT_ONCE = "20 a second, kept open", "1200 that are closed at once"
KNOCKS = {KEPT: ("20", "1000"), AT_ONCE: ("100000", "0", "1200")}
FEW = ("100000", "0", "5")
FAILING_AFTER_S = 12.0
"""zenoh waits 10 s for the first word of those that are kept open."""
TRIES, EACH_S = 4, 4.0
BURST, RATE_HZ, ANEW_S = 20, 4, 60
"""What the page lets each address open, and when an address is forgotten."""

NETWORK = """
[network]
connect = ["tls/router.lab:{port}"]
ca = "{tls}/{name}/ca.pem"
certificate = "{tls}/{name}/own.pem"
key = "{tls}/{name}/own.key"
"""
AS_ROUTER = """
[router]
listen = ["tls/[::]:7447"]
[router.users]
op1 = "operator"
[router.gateways]
robot1 = ["lab.arm"]
"""
AS_GATEWAY = """
[gateway]
site = "lab"
grippers = { arm = "can0" }
"""
AS_PORTAL = """
[portal]
user = "op1"
grippers = ["lab.arm"]
"""
AS_USER = f'{AS_PORTAL}directory = "/nowhere"\n'
"""Somebody who is new: no portal's session helps him."""
IN_THE_LAB = f"""[Service]
ExecStart=
ExecStart={PROGRAMS}/litegripd-fleet --config {MACHINES}/%i.toml %i
NetworkNamespacePath=/run/netns/lab
BindReadOnlyPaths={HOSTS}:/etc/hosts
"""
STOP = (f"{PROGRAMS}/litegripctl", "fleet", "stop", "lab", "--config", f"{MACHINES}/portal.toml")
ACCESS = '[access]\ngateways = ["litegrip-gateway"]\noperators = ["litegrip-gateway"]\n'


def page_blocks() -> tuple[str, str, str]:
    """Return what the page shows: the drop-in, the table of nftables, and what loads that."""
    section = PAGE.read_text().partition(SECTION)[2].partition("\n## ")[0]
    drop_in, table, commands = (block.partition("\n")[2] for block in section.split("```")[1::2])
    return drop_in, table, commands


# The machines -------------------------------------------------------------------------------------


def set_up() -> None:
    """Have daemon, router, gateway and portal installed, each with its certificate; once."""
    if MACHINES.exists():
        return
    must("useradd", "--create-home", "alice")
    CONFIGURATION.parent.mkdir(exist_ok=True)
    CONFIGURATION.write_text(SLOW)
    install_units("alice", "can0", "can1")
    must("systemctl", "disable", "--now", "litegripd@can1")  # the simulated motor's
    print(must(f"{PROGRAMS}/litegripctl", "install-units", "--fleet"), flush=True)
    must("systemd-sysusers")
    CONFIGURATION.write_text(f"{SLOW}{ACCESS}")
    Unit().restart()
    lay_cables()
    must("sh", CERTIFICATES, str(TLS), "router.lab", "gateway:robot1", "user:op1")
    (TLS / "ca.key").unlink()
    must("chgrp", "-R", "litegrip-fleet", str(TLS))
    must("chmod", "-R", "u=rwX,g=rX,o=", str(TLS))
    MACHINES.mkdir()
    for file, name, part in (
        (MACHINES.parent / "fleet.toml", "router.lab", AS_ROUTER),
        (MACHINES / "gateway.toml", "robot1", AS_GATEWAY),
        (MACHINES / "portal.toml", "op1", AS_PORTAL),
        (MACHINES / "user.toml", "op1", AS_USER),
    ):
        file.write_text(f"{NETWORK.format(port=PORT, tls=TLS, name=name)}{part}")
    for unit in (GATEWAY, PORTAL):
        put(UNITS / f"{unit}.d/lab.conf", IN_THE_LAB)
    must("systemctl", "daemon-reload")


def lay_cables() -> None:
    """Join both namespaces to this machine, each by a cable of its own."""
    for name, (here, there, here6, there6) in ADDRESSES.items():
        ip(f"netns add {name}")
        ip(f"link add {name} type veth peer name eth0 netns {name}")
        ip(f"address add {here} dev {name}")
        ip(f"address add {here6} dev {name} nodad")
        ip(f"link set {name} up")
        ip(f"-netns {name} address add {there} dev eth0")
        ip(f"-netns {name} address add {there6} dev eth0 nodad")
        ip(f"-netns {name} link set lo up")
        ip(f"-netns {name} link set eth0 up")
    put(HOSTS, "")


def put(file: Path, text: str) -> None:
    """Write a file in a directory that may have to be made."""
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(text)


def address(name: str, family: str) -> str:
    """Return the router's address on a cable."""
    return ADDRESSES[name][FAMILIES[family]].partition("/")[0]


# What is tried ------------------------------------------------------------------------------------


@dataclass(frozen=True, slots=True)
class Tried:
    """How users fared, and the stranger, for so long."""

    entered: int
    told: str
    has_stopped: bool
    knocks: int
    connected: int
    took_s: float

    def __str__(self) -> str:
        knocks = f"the stranger: {self.connected} of {self.knocks} connections"
        return f"{self.entered} of {TRIES}: {self.told}; {knocks} in {self.took_s:.0f} s"


@contextlib.contextmanager
def fleet(family: str) -> Iterator[None]:
    """Have all of it run by IPv4 or IPv6, with a router that nobody has knocked at yet."""
    HOSTS.write_text(f"127.0.0.1 localhost\n{address('lab', family)} router.lab\n")
    units = (ROUTER, GATEWAY, PORTAL)
    must("systemctl", "restart", *units)
    seen = reaches(alice_sees)
    check(f"{family}: alice sees the gripper", seen, "" if seen else journal(*units))
    entered, told = users_come(1)
    check(f"{family}: nobody knocks: a new user is let in", entered == 1, told)
    yield
    must("systemctl", "stop", *units)


def alice_sees() -> bool:
    """True if she sees the gripper by the portal's session."""
    return ctl("alice", "state", channel="lab.arm")[0] == 0


def journal(*units: str) -> str:
    """Return what units have said last."""
    named = [f"--unit={unit}" for unit in units]
    return run("journalctl", "--no-pager", "--output=cat", "--lines=12", *named)[1]


def users_come(tries: int = TRIES) -> tuple[int, str]:
    """Have users come anew, each 4 s, and list the grippers; tell how many were let in."""
    entered, told = 0, []
    for number in range(tries):
        began_s = time.monotonic()
        status, out = in_the_lab("list", "lab")
        took_s = time.monotonic() - began_s
        is_in = status == 0 and "lab.arm" in out
        entered += is_in
        told.append(f"{took_s:.1f} s" if is_in else f"out, exit code {status}")
        if number + 1 < tries:
            pause.wait(max(0.0, EACH_S - took_s))
    return entered, ", ".join(told)


def in_the_lab(*arguments: str) -> tuple[int, str]:
    """Run litegripd-fleet as a user who is new: the network itself is asked."""
    program = (f"{PROGRAMS}/litegripd-fleet", "--config", f"{MACHINES}/user.toml")
    return run("ip", "netns", "exec", "lab", *program, *arguments)


def knocked_at(kind: str, family: str) -> Tried:
    """Have the stranger knock while users come."""
    began_s = time.monotonic()
    with stranger(family, KNOCKS[kind]) as program:
        if kind == KEPT:
            pause.wait(FAILING_AFTER_S)
        else:
            wait_for(program)
        entered, told = users_come()
        status, out = in_the_lab("stop", "lab")
        has_stopped = status == 0 and "lab.arm: stopped" in out
        check(f"{family}, {kind}: who is in stays in", alice_sees())
        took_s = time.monotonic() - began_s
        counted = ended(program)
    return Tried(entered, told, has_stopped, counted["tried"], counted["connected"], took_s)


def stranger(family: str, knocks: Sequence[str]) -> contextlib.AbstractContextManager[Program]:
    """Have the stranger knock."""
    command = ("python3", knocker.__file__, address("stranger", family), str(PORT), *knocks)
    return running("ip", "netns", "exec", "stranger", *command)


def wait_for(program: Program) -> None:
    """Wait until the stranger has come to his end."""
    if not reaches(lambda: program.status is not None):
        raise TimeoutError("the stranger knocks on")


def gets_in(family: str) -> bool:
    """Have the stranger knock five times; return True if a connection came about."""
    with stranger(family, FEW) as program:
        wait_for(program)
    return ended(program)["connected"] > 0


def ended(program: Program) -> dict[str, int]:
    """End the stranger; return how often he has knocked, and how many connections came about."""
    if program.status is None:
        program.end()
    counted: dict[str, int] = json.loads(program.log.read_text().splitlines()[-1])
    return counted


def try_all(look: Callable[[str, Tried], None]) -> None:
    """Try each way to knock, by IPv4 and by IPv6; `look` is told what, and how it went."""
    set_up()
    with at_work(Unit()):
        for family, kind in itertools.product(FAMILIES, KNOCKS):
            with fleet(family):
                look(f"{family}, {kind}", knocked_at(kind, family))


def all_enter(what: str, tried: Tried) -> None:
    """See that every user was let in, and could stop."""
    check(f"{what}: every new user is let in", tried.entered == TRIES, tried)
    check(f"{what}: his stop arrives", tried.has_stopped)
    clear(what)


def clear(what: str) -> None:
    """Clear the stop."""
    status, out = ctl("alice", "clear", channel="lab.arm")
    check(f"{what}: that is cleared", status == 0, out)


# The scenes ---------------------------------------------------------------------------------------


def unprotected_router() -> None:
    """Without protection, a stranger keeps everybody new out; who is in stays in."""

    def look(what: str, tried: Tried) -> None:
        check(f"{what}: nobody new is let in", tried.entered == 0, tried)
        check(f"{what}: nor does his stop arrive", not tried.has_stopped)
        status, out = run("runuser", "-u", "alice", "--", *STOP)
        check(f"{what}: alice's stop goes by the portal", status == 0, out.splitlines()[-1:])
        clear(what)

    try_all(look)


def router_for_the_lab_alone() -> None:
    """With the page's drop-in, the stranger gets no connection, and users are let in."""
    set_up()
    must("systemctl", "restart", ROUTER)
    got = {family: reaches(partial(gets_in, family)) for family in FAMILIES}
    check("without it, the stranger gets connections", all(got.values()), got)
    put(CLOSED, page_blocks()[0])
    must("systemctl", "daemon-reload")  # as `systemctl edit` does
    got = {family: gets_in(family) for family in FAMILIES}
    check("it is in force without a restart of the router", not any(got.values()), got)

    def look(what: str, tried: Tried) -> None:
        all_enter(what, tried)
        check(f"{what}: no connection for him", tried.connected == 0, tried.connected)

    try_all(look)
    CLOSED.unlink()
    must("systemctl", "daemon-reload")


def router_with_a_limit() -> None:
    """With the page's limit, the stranger gets few connections, and users are let in."""
    set_up()
    _, table, commands = page_blocks()
    before = NFTABLES.read_text()
    NFTABLES.write_text(f"{before}\n{table}")
    status, out = typed(f"set -e\n{commands}")
    check("typed as on the page", status == 0, out)
    check("the limit is there", "knocking6" in must("nft", "list", "ruleset"))
    status, out = run("systemctl", "is-enabled", "nftables")
    check("and will be at the next start", status == 0, out)

    def look(what: str, tried: Tried) -> None:
        all_enter(what, tried)
        most = 1.2 * (BURST * (1 + tried.took_s // ANEW_S) + RATE_HZ * tried.took_s)
        few = 0 < tried.connected <= most
        check(f"{what}: few connections for him", few, f"{tried.connected}, at most {most:.0f}")

    try_all(look)
    NFTABLES.write_text(before)
    must("systemctl", "disable", "--now", "nftables")


SCENES = (unprotected_router, router_for_the_lab_alone, router_with_a_limit)


def main() -> int:
    """Run the scenes, or those that are named; return 0 when every check passed."""
    _boot, *names = sys.argv[1:]
    return play([scene for scene in SCENES if not names or scene.__name__ in names])


if __name__ == "__main__":
    sys.exit(main())
