"""Units beside the daemons': the page in the browser, and a fleet's gateway, router and portal."""

import urllib.request
from pathlib import Path

from tests.vm.attended import at_work
from tests.vm.guest import check, reaches
from tests.vm.unit import CONFIGURATION, PROGRAMS, SLOW, Unit, ctl, must, run

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
