"""The state of the gripper, as one value.

A newer daemon may say more than it holds, which is ignored; what it needs and the daemon does
not say is a `ProtocolError`, but for `NEWER_FIELDS`, which are None for an older daemon.
"""

import time
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

from litegrip_client.checks import pick

USABLE_BUS = ("up", "motor_silent")
"""States of a bus on which frames can be exchanged."""


NEWER_FIELDS = ("clamp_n", "loss_detection", "loss_detection_from_n")
"""Fields that an older daemon does not send."""


@dataclass(frozen=True, slots=True)
class GripperState:
    """The daemon's newest state. None stands where something is not known.

    Times are CLOCK_MONOTONIC seconds: `monotonic_s` of this state, `feedback_s` of the motor's
    last feedback. `age_s` is the feedback's age when the state was made; `stale` is true if the
    figures are old ones. `error_code` is the motor's status nibble and `status` its name. `enabled`
    is None while nobody knows: take only False for a motor that is off.

    `command_rad` and `command_torque_nm` are the motor's command, `requested_rad` and
    `requested_torque_nm` the motion's request; `limited` says why they differ.
    `force_set_n` is the squeezing force that a hold by force aims at, None in any other and
    when the motor is off; `is_grasped` whether an object is being held.

    While one is, `clamp_n` is the least and the most force (N) that it may feel, for friction hides
    the difference; the least is 0 while the jaws search for an object that gave way.
    `loss_detection` is true if its loss would be noticed, `loss_detection_from_n` with which set
    force it would. All three are None without an object, and of a daemon that does not know them.
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
    clamp_n: tuple[float, float] | None
    loss_detection: bool | None
    loss_detection_from_n: float | None
    limited: tuple[str, ...]
    calibrated: bool
    mount: str | None
    job: dict[str, Any] | None
    stop: dict[str, Any] | None
    stop_generation: int

    @classmethod
    def from_wire(cls, data: Mapping[str, Any]) -> "GripperState":
        """Read the wire's form; raises `ProtocolError`."""
        values = pick(data, _NEEDED_FIELDS, "state")
        values |= {name: data.get(name) for name in NEWER_FIELDS}
        values["limited"] = tuple(values["limited"] or ())
        if values["clamp_n"] is not None:
            values["clamp_n"] = tuple(values["clamp_n"])
        return cls(**values)

    @property
    def age_now_s(self) -> float | None:
        """How old the motor's feedback is by now, in seconds; None if there never was any."""
        return None if self.feedback_s is None else time.monotonic() - self.feedback_s


STATE_FIELDS = tuple(field.name for field in fields(GripperState))
_NEEDED_FIELDS = tuple(name for name in STATE_FIELDS if name not in NEWER_FIELDS)
