"""The state of the gripper, as one value.

A newer daemon may say more than it holds, which is ignored; what it needs and the daemon does
not say is a `ProtocolError`.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from litegrip_client.checks import pick

USABLE_BUS = ("up", "motor_silent")
"""States of a bus on which frames can be exchanged."""


@dataclass(frozen=True, slots=True)
class GripperState:
    """The daemon's newest state. None stands where something is not known.

    Times are CLOCK_MONOTONIC seconds: `monotonic_s` of this state, `feedback_s` of the motor's
    last feedback. `age_s` is the feedback's age when the state was made; `stale` tells that the
    figures are old ones. `error_code` is the motor's status nibble and `status` its name. `enabled`
    is None while nobody knows: take only False for a motor that is off.

    `command_rad` and `command_torque_nm` are what the motor was told, `requested_rad` and
    `requested_torque_nm` what the motion wanted it to be told; `limited` says why they differ.
    `force_set_n` is the squeezing force that a hold by force aims at, None in any other and
    when the motor is off; `is_grasped` whether an object is being held.
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
    requested_rad: float | None
    command_torque_nm: float | None
    requested_torque_nm: float | None
    force_set_n: float | None
    is_grasped: bool
    limited: tuple[str, ...]
    calibrated: bool
    mount: str | None
    job: dict[str, Any] | None
    stop: dict[str, Any] | None
    stop_generation: int

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "GripperState":
        """Read the wire's form; raises `ProtocolError`."""
        values = pick(data, STATE_FIELDS, "state")
        values["limited"] = tuple(values["limited"] or ())
        return cls(**values)

    @property
    def age_now_s(self) -> float | None:
        """How old the motor's feedback is by now, in seconds; None if there never was any."""
        return None if self.feedback_s is None else time.monotonic() - self.feedback_s


STATE_FIELDS = tuple(field.name for field in fields(GripperState))
