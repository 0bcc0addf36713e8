"""A CAN frame, and the states of the CAN bus by name, with what to do about each.

The names of the states are part of the protocol: `state.get`, `health` and the events carry them.
"""

import shlex
from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.model.errors import Refusal


@dataclass(frozen=True, slots=True)
class CanFrame:
    """One classic CAN data frame with an 11-bit identifier.

    `can_id` is 0 to 0x7FF and `data` at most 8 bytes. Error, remote and extended frames never
    become a `CanFrame`. The bus drops and counts them, because the masked id of an error frame can
    equal the feedback id (0x08 | 0x10 = 0x18).
    """

    can_id: int
    data: bytes


BusState: TypeAlias = Literal[
    "up", "link_down", "adapter_gone", "bus_off", "bus_stalled", "motor_silent", "down"
]
"""`down` stands for what has no name of its own: not opened yet, or an adapter's own error."""

_REMEDIES: dict[BusState, str] = {
    "link_down": "bring the link up: {up}",
    "adapter_gone": "plug the adapter in, or correct its name ('ip -brief link show type can' lists"
    " CAN interfaces): it is opened as soon as it is there",
    "bus_off": "check wiring, termination and bit rate; a controller with restart-ms set then comes"
    " back by itself, any other one by: sudo ip link set {name} down && sudo ip link set {name} up",
    "bus_stalled": "nobody on the bus acknowledges a frame: check the cable and the motor's power",
    "motor_silent": "check the motor's 24 V supply, the CAN wiring and its id",
    "down": "fix what the error names: the daemon keeps reopening the bus",
}


def remedy(state: BusState, bus_channel: str) -> str | None:
    """Return what to do about a state of the bus that [bus] channel names; None for "up".

    Every adapter takes these commands; some drivers refuse `restart-ms`, and the restart by hand.
    """
    name = shlex.quote(bus_channel)
    settings = "" if bus_channel.startswith(("vcan", "vxcan")) else " type can bitrate 1000000"
    text = _REMEDIES.get(state)
    up = f"sudo ip link set {name} up{settings}"
    return None if text is None else text.format(name=name, up=up)


@dataclass(frozen=True, slots=True)
class BusCondition:
    """The state of the bus; `error` is a sentence that says why it is not up."""

    state: BusState
    error: str | None = None

    @property
    def is_usable(self) -> bool:
        """True if frames can be exchanged, as far as is known; the motor may still be silent."""
        return self.state in ("up", "motor_silent")

    def refusal(self, bus_channel: str) -> Refusal | None:
        """Return why the motor cannot be reached because of the bus, or None."""
        if self.is_usable:
            return None
        hint = remedy(self.state, bus_channel)
        text = f"the CAN bus cannot be used ({self.state}): {self.error}; {hint}"
        return Refusal("bus_down", text, {"bus": self.state, "hint": hint})


UP = BusCondition("up")
NOT_OPENED = BusCondition("down", "not opened yet")
