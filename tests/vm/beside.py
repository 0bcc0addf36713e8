"""Units beside the daemons': the page in the browser, and a fleet's gateway, router and portal."""

import contextlib
import urllib.request
from collections.abc import Sequence
from functools import partial
from pathlib import Path

from tests.vm.attended import RESTARTS_AT_MOST, at_work
from tests.vm.guest import check, reaches
from tests.vm.unit import CONFIGURATION, PROGRAMS, SLOW, Unit, ctl, must, run, typed

WEB, PARTS = "litegripd-web.service", ("router", "gateway", "portal")
FLEET = Path("/etc/litegripd/fleet.toml")
EXPOSURE_AT_MOST = 2.5
ENDPOINT = "tcp/127.0.0.1:7447"
FLEET_CONFIG = f"""
[network]
connect = ["{ENDPOINT}"]
insecure = true
[router]
listen = ["{ENDPOINT}"]
[gateway]
site = "lab"
grippers = {{ arm = "can0" }}
[portal]
user = "op1"
grippers = ["lab.arm"]
"""
WITH_GATEWAY = f'{SLOW}[access]\ngateways = ["litegrip-gateway"]\n'


def page_as_a_unit() -> None:
    """The page, as a user of its own that serves this machine alone."""
    with at_work(Unit()):
        must("systemctl", "start", WEB)
        token = Path("/run/litegripd-web/token")
        check("it keeps its secret", reaches(token.exists), _status(WEB))
        check(
            "for the group alone", token.stat().st_mode & 0o777 == 0o640, oct(token.stat().st_mode)
        )
        check("it serves the page", reaches(_page_is_served), _status(WEB))
        _runs_as(WEB, "litegrip-web")
        _exposure(WEB)
        must("systemctl", "stop", WEB)


def _page_is_served() -> bool:
    try:
        with urllib.request.urlopen("http://127.0.0.1:8040/", timeout=5) as answer:
            return b"litegrip" in answer.read().lower()
    except OSError:
        return False


def fleet_as_units() -> None:
    """A gripper by gateway, router and portal, each a user of its own."""
    print(must(f"{PROGRAMS}/litegripctl", "install-units", "--fleet"), flush=True)
    must("systemd-sysusers")
    must("systemctl", "daemon-reload")
    FLEET.write_text(FLEET_CONFIG)
    CONFIGURATION.write_text(WITH_GATEWAY)
    unit = Unit()
    units = [f"litegripd-fleet@{part}.service" for part in PARTS]
    with at_work(unit):
        unit.restart()
        must("systemctl", "start", *units)
        found = reaches(lambda: ctl("alice", "state", channel="lab.arm")[0] == 0)
        check("alice sees the gripper through the portal", found, "; ".join(map(_status, units)))
        status, out = ctl("bob", "state", channel="lab.arm")
        check("bob, outside of the group, does not", status == 3 and "ermission" in out, out)
        status, out = ctl("alice", "stop", channel="lab.arm")
        check("alice stops it", status == 0, out)
        status, out = ctl("alice", "clear", channel="lab.arm")
        check("and clears that", status == 0, out)
        for part, name in zip(PARTS, units, strict=True):
            _runs_as(name, f"litegrip-{part}")
            _exposure(name)
        must("systemctl", "stop", *units)
    CONFIGURATION.write_text(SLOW)
    unit.restart()


def printed_after_an_upgrade() -> None:
    """What install-units prints is typed with all of it running: held, and without power."""
    must(f"{PROGRAMS}/litegripctl", "install-units", "--fleet")
    must("systemd-sysusers")
    must("systemctl", "daemon-reload")
    FLEET.write_text(FLEET_CONFIG)
    CONFIGURATION.write_text(WITH_GATEWAY)
    unit = Unit()
    units = (unit.name, WEB, *(f"litegripd-fleet@{part}.service" for part in PARTS))
    with at_work(unit):
        unit.restart()
        must("systemctl", "restart", *units[1:])
        with contextlib.closing(unit.rpc()) as rpc:
            reaches(lambda: rpc.motor_is("disabled"))
            rpc.insist("motor.enable")
        restarts = unit.restarts
        type_upgrade("all running", units)
        check("all running: the daemon was reloaded", unit.restarts == restarts, unit.tell())
        with contextlib.closing(unit.rpc()) as rpc:
            check("all running: the motor is enabled still", rpc.motor_is("enabled"))
            rpc.call("motor.disable")
    with contextlib.closing(unit.rpc()) as rpc:
        check("all off: the motor is silent", reaches(lambda: rpc.motor_is("silent")))
    type_upgrade("all off", units)
    must("systemctl", "stop", *units[1:])
    CONFIGURATION.write_text(SLOW)
    unit.restart()


def type_upgrade(when: str, units: Sequence[str]) -> None:
    """Type what install-units prints; see that each unit runs in another process than before."""
    before = {name: _pid(name) for name in units}
    out = must(f"{PROGRAMS}/litegripctl", "install-units")
    print(out, flush=True)
    for line in out.partition("next, as root:\n")[2].splitlines():
        if not line.startswith("note: "):
            # A reload that this slow machine was too slow for is typed again, as the page says.
            tries = RESTARTS_AT_MOST if "reload litegripd" in line and "||" not in line else 1
            done = any(typed(line.strip())[0] == 0 for _ in range(tries))
            check(f"{when}: typed as printed: {line.strip()}", done)
    for name in units:
        another = reaches(partial(_is_another, name, before[name]))
        check(f"{when}: {name} is of the new version", another, _status(name))


def _is_another(name: str, before: int) -> bool:
    return _pid(name) not in (0, before) and run("systemctl", "is-active", name)[1] == "active"


def _pid(name: str) -> int:
    return int(must("systemctl", "show", "--property=MainPID", "--value", name))


def _status(name: str) -> str:
    return must("systemctl", "show", "--property", "ActiveState,Result,MainPID,NRestarts", name)


def _runs_as(name: str, user: str) -> None:
    pid = must("systemctl", "show", "--property", "MainPID", "--value", name)
    _code, owner = run("ps", "-o", "user:32=", "-p", pid)
    check(f"{name} runs as {user}", owner == user, owner)


def _exposure(name: str) -> None:
    out = must("systemd-analyze", "security", "--no-pager", name)
    exposure = float(out.rpartition("exposure level for")[2].split()[1])
    check(f"exposure at most {EXPOSURE_AT_MOST}", exposure <= EXPOSURE_AT_MOST, exposure)
