"""What a viewer is shown of a live state, in the words of the daemon's dumps.

Pure: no clock, no connection, nothing of Foxglove's SDK.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from litegrip_client import GripperState
from litegrip_client.values.foxglove import finite, joints_of


@dataclass(frozen=True, slots=True)
class Scale:
    """The calibration in use: the opening is 0 at `closed_rad`, and grows with `mm_per_rad`."""

    closed_rad: float
    mm_per_rad: float
    """Negative where the motor's radians fall while the jaws open."""

    @classmethod
    def from_info(cls, info: Mapping[str, Any]) -> Scale | None:
        """Read `LiteGrip.info()`; None for a gripper that is not calibrated."""
        gripper = info["gripper"]
        if not gripper["calibrated"]:
            return None
        closed_rad, open_rad = float(gripper["closed_rad"]), float(gripper["open_rad"])
        mm_per_rad = math.copysign(float(gripper["rad_to_mm"]), open_rad - closed_rad)
        return cls(closed_rad, mm_per_rad)

    def opening_mm(self, position_rad: float) -> float:
        """Return the opening at a position of the motor."""
        return (position_rad - self.closed_rad) * self.mm_per_rad


def tick_of(state: GripperState, scale: Scale | None, *, is_fresh: bool) -> dict[str, Any]:
    """Return a state as a tick of a dump has it: what is not known is left out.

    So are measured figures that are not fresh: a viewer would draw old ones as those of now.
    """
    fields: dict[str, Any] = {
        "seq": state.seq,
        "monotonic_s": state.monotonic_s,
        "bus": state.bus,
        "motor": state.motor,
        "mode": state.mode,
        "stopped": state.stop is not None,
    }
    if state.job is not None:
        fields |= {"job": state.job["job"], "job_kind": state.job["kind"]}
    commanded = {
        name: getattr(state, name)
        for name in ("command_rad", "command_torque_nm", "requested_rad", "requested_torque_nm")
    }
    if scale is not None and state.command_rad is not None and state.mode != "relaxed":
        commanded["command_mm"] = scale.opening_mm(state.command_rad)
    fields |= finite(commanded)
    if is_fresh:
        fields |= _measured(state)
    return fields


def _measured(state: GripperState) -> dict[str, Any]:
    known = {
        "status": state.status,
        "error_code": state.error_code,
        "driver_temperature_c": state.driver_temperature_c,
        "coil_temperature_c": state.coil_temperature_c,
    }
    measured = {
        name: getattr(state, name)
        for name in ("age_s", "position_rad", "velocity_rad_s", "torque_nm", "opening_mm")
    }
    return {name: value for name, value in known.items() if value is not None} | finite(measured)


def joints_message(state: GripperState, scale: Scale | None, at_ns: int) -> dict[str, Any]:
    """Return where the joints were at a Unix time, that of the motor's feedback."""
    opens_mm_s = None
    if scale is not None and state.velocity_rad_s is not None:
        opens_mm_s = state.velocity_rad_s * scale.mm_per_rad
    return joints_of(
        at_ns,
        position_rad=state.position_rad,
        velocity_rad_s=state.velocity_rad_s,
        torque_nm=state.torque_nm,
        opening_mm=state.opening_mm,
        opens_mm_s=opens_mm_s,
    )
