"""What the gripper's methods return: values, with the vendor SDK's names and truth.

A newer daemon may say more than these hold, which is ignored; what one of them needs and the
daemon does not say is a `ProtocolError`.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from litegrip_client.errors import ProtocolError


@dataclass(frozen=True, slots=True)
class GripperState:
    """The daemon's newest state. None stands where something is not known.

    Times are CLOCK_MONOTONIC seconds: `monotonic_s` of this state, `feedback_s` of the motor's
    last feedback. `age_s` is the feedback's age when the state was made; `stale` tells that the
    figures are old ones. `error_code` is the motor's status nibble and `status` its name.
    """

    seq: int
    monotonic_s: float
    feedback_s: float | None
    age_s: float | None
    stale: bool
    bus: str
    motor: str
    error_code: int | None
    status: str | None
    enabled: bool | None
    mode: str
    position_rad: float | None
    velocity_rad_s: float | None
    torque_nm: float | None
    force_n: float | None
    opening_mm: float | None
    openness: float | None
    driver_temperature_c: float | None
    coil_temperature_c: float | None
    command_rad: float | None
    limited: tuple[str, ...]
    calibrated: bool
    mount: str | None
    job: dict[str, Any] | None
    stop: dict[str, Any] | None
    stop_generation: int

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "GripperState":
        """Read the wire's form; raises `ProtocolError`."""
        values = _pick(data, _STATE_FIELDS, "state")
        values["limited"] = tuple(values["limited"] or ())
        return cls(**values)

    @property
    def age_now_s(self) -> float | None:
        """How old the motor's feedback is by now, in seconds; None if there never was any."""
        return None if self.feedback_s is None else time.monotonic() - self.feedback_s


_STATE_FIELDS = tuple(field.name for field in fields(GripperState))


@dataclass(frozen=True, slots=True)
class EnableResult:
    """How enabling went; true if the motor's status says that it is enabled.

    `tries` counts the enable commands sent. `reason` and `message` say why not, if not.
    """

    ok: bool
    state: GripperState
    tries: int
    reason: str | None = None
    message: str | None = None

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "EnableResult":
        """Read the wire's form; raises `ProtocolError`."""
        values = _pick(data, ("ok", "state", "tries"), "enable result")
        values["state"] = GripperState.from_wire(values["state"])
        return cls(**values, reason=data.get("reason"), message=data.get("message"))


@dataclass(frozen=True, slots=True)
class MoveResult:
    """How a motion ended; true if it ended as it should.

    For open and close that is pressed onto the mechanical stop: then `stalled` is true and
    `reached` is not, because the target lies behind the stop. `outcome` names the end;
    `target_rad` is what was aimed at, `limit_rad` the calibrated stop, `final_cmd_rad` the last
    position commanded, `steps` the number of commands.
    """

    ok: bool
    reached: bool
    stalled: bool
    state: GripperState
    target_rad: float
    limit_rad: float
    final_cmd_rad: float
    steps: int
    outcome: str

    def __bool__(self) -> bool:
        return self.ok

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "MoveResult":
        """Read the wire's form; raises `ProtocolError`."""
        same = ("ok", "reached", "stalled", "state", "target_rad", "limit_rad", "steps", "outcome")
        values = _pick(data, (*same, "final_command_rad"), "move result")
        values["state"] = GripperState.from_wire(values["state"])
        return cls(final_cmd_rad=values.pop("final_command_rad"), **values)


@dataclass(frozen=True, slots=True)
class MoveProgress:
    """How far a motion is: `phase`, command `i` of `total_steps`, and what the motor does."""

    phase: str
    i: int
    total_steps: int
    cmd_rad: float
    pos_rad: float
    torque_nm: float

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "MoveProgress":
        """Read the wire's form; raises `ProtocolError`."""
        return cls(*_pick(data, _PROGRESS_KEYS, "progress").values())


_PROGRESS_KEYS = ("phase", "step", "total_steps", "command_rad", "position_rad", "torque_nm")


def _pick(data: Mapping[str, Any], names: tuple[str, ...], what: str) -> dict[str, Any]:
    try:
        return {name: data[name] for name in names}
    except KeyError as error:
        raise ProtocolError(f"the daemon's {what} lacks {error}", reason="missing_field") from None
    except TypeError:
        raise ProtocolError(f"the daemon's {what} is no object: {data!r:.80}") from None
