"""The state of the CAN bus by name, and what to do about each.

The names are part of the protocol: `state.get`, `health` and the events carry them.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal, TypeAlias

from litegripd.model.errors import Refusal

BusState: TypeAlias = Literal[
    "up", "link_down", "adapter_gone", "bus_off", "bus_stalled", "motor_silent", "down"
]
"""`down` is what has no name of its own: not opened yet, or an adapter's own error."""

BUS_REMEDIES: Mapping[BusState, str] = MappingProxyType(
    {
        "link_down": "bring the link up: ip link set CHANNEL up type can bitrate 1000000"
        " restart-ms 100 (without restart-ms for an adapter that refuses it)",
        "adapter_gone": "plug the adapter in, or correct its name ('ip link' lists interfaces): it"
        " is opened as soon as it is there",
        "bus_off": "check wiring, termination and bit rate; with restart-ms set, the controller"
        " comes back by itself, else: ip link set CHANNEL type can restart, or, where the adapter"
        " refuses that, down and up",
        "bus_stalled": "nobody on the bus acknowledges a frame: check the cable and the motor's"
        " power",
        "motor_silent": "check the motor's 24 V supply, the CAN wiring and its id",
        "down": "mend what the error names: the bus is opened again and again by itself",
    }
)


@dataclass(frozen=True, slots=True)
class BusCondition:
    """In which state the bus is; `error` is a sentence that says why it is not up."""

    state: BusState
    error: str | None = None

    @property
    def is_usable(self) -> bool:
        """Whether frames can be exchanged as far as is known; a silent motor is no matter of it."""
        return self.state in ("up", "motor_silent")

    def refusal(self) -> Refusal | None:
        """Say why the motor cannot be reached, where it is the bus that stands in the way."""
        if self.is_usable:
            return None
        remedy = BUS_REMEDIES[self.state]
        text = f"the CAN bus cannot be used ({self.state}): {self.error}; {remedy}"
        return Refusal("bus_down", text, {"bus": self.state, "hint": remedy})


UP = BusCondition("up")
NOT_OPENED = BusCondition("down", "not opened yet")
