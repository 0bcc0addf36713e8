"""What each key of the configuration means, for the manual page.

The tables of `config` say which keys there are and what they may hold.
"""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

from litegripd.app.config import _CHOICES, _NAMED, _RANGES, _TYPES, load

_MEANINGS: Mapping[tuple[str, str], str] = {
    ("bus", "interface"): "The interface of python-can: slcan, gs_usb, virtual, litegrip_sim, and"
    " others.",
    ("bus", "channel"): "The channel of that interface, a device's path for slcan; the daemon's"
    " channel by default. Further keys of [bus] are handed to the interface.",
    ("bus", "bitrate"): "In bit/s. For socketcan the system sets it, by ip(8).",
    ("motor", "type"): "The motor's model.",
    ("motor", "can_id"): "The motor's id, its register ESC_ID.",
    ("motor", "master_id"): "Where the motor answers, its register MST_ID; found by itself when"
    " left out.",
    ("motor", "second_master"): "What another program that commands the motor on the same bus"
    " leads to: motions are refused, or it is only told of.",
    ("gripper", "mount"): "Which way the jaws close: normal, reverse, or the absolute path of a"
    " calibration file. When left out, the first calibration that is found.",
    ("gripper", "stroke_mm"): "The mechanical stroke, in mm.",
    ("control", "rate_hz"): "Ticks a second.",
    ("control", "priority"): "The priority under SCHED_FIFO, 0 for an ordinary one.",
    ("control", "cpus"): "The CPUs to run on; all when left out.",
    ("rpc", "socket"): "Where clients connect, an absolute path. Stops are taken beside it.",
    ("rpc", "group"): "The group whose members may connect.",
    ("access", "default"): "The role of who is in no list: observers read and stop, operators"
    " move, admins also take over from others and change the daemon's defaults.",
    ("access", "admins"): "Who is admin. Root and the daemon's own user are in any case.",
    ("access", "operators"): "Who is operator. Where several entries fit, the highest counts.",
    ("access", "observers"): "Who is observer.",
    ("teleop", "zenoh_config"): "A file of zenoh's own, for TLS and access lists. Without it the"
    " link is open to whoever reaches its port.",
}


@dataclass(frozen=True, slots=True)
class Key:
    """One key of the configuration; `allowed` and `default` as texts, None for no default."""

    table: str
    name: str
    allowed: str
    default: str | None
    meaning: str


def keys() -> Iterator[Key]:
    """Give all keys, in the order of their tables."""
    defaults = load("can0", None)
    for table, name in _TYPES:
        default = getattr(getattr(defaults, table), name, None)
        if (table, name) == ("bus", "channel") or default in ((), None):
            default = None
        meaning = _MEANINGS[table, name]
        yield Key(table, name, _allowed(table, name), _written(default), meaning)


def _allowed(table: str, name: str) -> str:
    choices = _CHOICES.get((table, name))
    if choices:
        return " or ".join(f'"{choice}"' for choice in choices)
    kind = _NAMED[_TYPES[table, name]]
    if (table, name) not in _RANGES:
        return kind
    low, high = _RANGES[table, name]
    return f"{kind}, {low:.12g} to {high:.12g}"


def _written(value: object) -> str | None:
    if value is None:
        return None
    return f'"{value}"' if isinstance(value, str) else f"{value:.12g}"
