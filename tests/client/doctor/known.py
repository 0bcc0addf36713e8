"""Facts of a gripper with which all is well, and ways to make one thing differ."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

from litegrip_client.ctl.doctor.facts import Daemon, Facts, Socket, System, User
from litegrip_client.socketcan.link import Link, from_ip

LINKS = Path(__file__).parent / "links"
NOW_S = 1_800_000_000.0
FILE = "/var/lib/litegripd/can0_calibration.json"

HELLO: dict[str, Any] = {
    "version": "1.2.3",
    "channel": "can0",
    "pid": 77,
    "motor": {"can_id": 8, "master_id": 24},
    "gripper": {
        "calibrated": True,
        "mount": "normal",
        "travel_mm": 87.0,
        "rad_to_mm": 54.4,
        "stroke_mm": 85.0,
        "work_stroke_mm": 80.0,
        "closed_rad": 0.1,
        "open_rad": -1.5,
    },
    "limits": {"rate_hz": 200},
}
REGISTERS = {
    "MST_ID": 24,
    "ESC_ID": 8,
    "TIMEOUT": 2000,
    "CTRL_MODE": 1,
    "PMAX": 12.5,
    "VMAX": 30.0,
    "TMAX": 10.0,
    "can_br": 4,
}
INFO: dict[str, Any] = {
    **HELLO,
    "registers": REGISTERS,
    "calibration_file": FILE,
    "calibration": {
        "file": FILE,
        "nominal": False,
        "channel": "can0",
        "saved_s": NOW_S - 3.2 * 86_400,
        "foreign": None,
    },
    "configuration": {
        "bus": {"interface": "socketcan", "channel": "can0", "bitrate": 1_000_000},
        "control": {"priority": 50, "rate_hz": 200},
        "file": "/etc/litegripd/can0.toml",
        "gripper": {"stroke_mm": 85.0},
        "rpc": {"group": "litegrip"},
    },
}
HEALTH: dict[str, Any] = {
    "verdict": "ok",
    "reasons": [],
    "uptime_s": 12.3,
    "control": {"fifo_priority": 50, "memory_locked": True},
    "bus": {"state": "up", "error": None, "load": 0.123, "send_failures": 0},
    "motor": {"foreign_commands": 0, "foreign_active": False},
    "teleop": {"link": None, "reach": None, "unreached": None},
}
STATE: dict[str, Any] = {
    "motor": "disabled",
    "status": "disabled",
    "enabled": False,
    "age_s": 0.004,
    "stale": False,
    "position_rad": -0.5,
    "scale_doubt": None,
}
SOCKETS = (
    Socket("/run/litegripd/can0.sock", True, 0),
    Socket("/run/litegripd/can0.stop.sock", True, 0),
)


def changed(data: Mapping[str, Any], path: str, value: object) -> dict[str, Any]:
    """Return `data` with another value under a dotted name."""
    name, _, rest = path.partition(".")
    return {**data, name: changed(data[name], rest, value) if rest else value}


def link(name: str) -> Link:
    """Return the link of a file in links/."""
    return from_ip((LINKS / f"{name}.json").read_text(encoding="utf-8"))


def daemon(**changes: object) -> Daemon:
    """Return a daemon that is well but for `changes`: hello_motor__can_id=9, health_verdict=..."""
    parts: dict[str, dict[str, Any]] = {
        "hello": HELLO,
        "info": INFO,
        "health": HEALTH,
        "state": STATE,
    }
    for name, value in changes.items():
        part, _, path = name.partition("_")
        parts[part] = changed(parts[part], path.replace("__", "."), value)
    return Daemon("/run/litegripd/can0.sock", **parts)


def facts(link_name: str | None = "healthy", **changes: Any) -> Facts:
    """Return facts with which all is well but for the link and `changes`, which are fields."""
    found = None if link_name is None else link(link_name)
    whole = Facts(
        channel="can0",
        version="1.2.3",
        user=User("alice", 1000, "litegrip"),
        system=System(found, None, ("can0", "can1"), "peak_usb", "PCAN-USB"),
        sockets=SOCKETS,
        daemon=daemon(),
        ctl="litegripctl -c can0",
        now_s=NOW_S,
    )
    return replace(whole, **changes)


def with_daemon(**changes: object) -> Facts:
    """Return facts with which all is well but for `changes` of the daemon."""
    return facts(daemon=daemon(**changes))


def system(**changes: Any) -> System:
    """Return a system with a healthy link but for `changes`."""
    return replace(facts().system, **changes)
