"""A calibration by hand, for a fixed time: the extremes that the jaws reach become the limits."""

from __future__ import annotations

import time

from litegrip_client.calibration import CalibrationData
from litegrip_client.errors import CommandError, ParameterError

TYPE_CHECKING = False
if TYPE_CHECKING:
    from litegrip_client.gripper import LiteGrip

LEAST_TRAVEL_RAD = 0.3
"""Less is no travel that a hand has pushed from stop to stop (1.6 rad as sold)."""
STROKE_MM = 120.0
_HZ = 200.0


def calibrate_by_hand(
    gripper: LiteGrip, duration_s: float, settle_s: float, sample_interval_s: float
) -> CalibrationData:
    """Let the jaws go for a while, and use the extremes; raises `CommandError`."""
    for name, value, least in (
        ("duration", duration_s, 0.0),
        ("sample_interval", sample_interval_s, 0.0),
    ):
        if value <= least:
            text = f"{name} is {value:g}, it must be above {least:g}"
            raise ParameterError(text, reason="invalid_params", data={"parameter": name})
    mount = gripper.mount
    if mount is None:
        raise CommandError(
            "no mount is known, so nothing says which extreme is the closed one",
            reason="not_calibrated",
            data={"hint": "load_template('normal') or load_template('reverse') first"},
        )
    low_rad, high_rad = _extremes(gripper, duration_s)
    time.sleep(max(settle_s, 0.0))
    if high_rad - low_rad < LEAST_TRAVEL_RAD:
        raise CommandError(
            f"the jaws were moved by {high_rad - low_rad:.3f} rad only: push them to both stops",
            reason="out_of_limits",
            data={"limit": LEAST_TRAVEL_RAD, "requested": high_rad - low_rad},
        )
    closed_rad, open_rad = (high_rad, low_rad) if mount == "normal" else (low_rad, high_rad)
    travel_rad = high_rad - low_rad
    present = gripper.config
    data = CalibrationData(
        channel=present.channel,
        can_id=present.can_id,
        mst_id=present.mst_id,
        motor_type=present.motor_type,
        calibrated=True,
        zero_position_rad=closed_rad,
        max_position_rad=open_rad,
        travel_range_rad=travel_rad,
        rad_to_mm=(present.travel_mm or STROKE_MM) / travel_rad,
        kp=present.kp,
        kd=present.kd,
        calibration_time=time.time(),
    )
    gripper.use_calibration(data)
    return data


def _extremes(gripper: LiteGrip, duration_s: float) -> tuple[float, float]:
    """Return the least and the largest position (rad) while the jaws are loose."""
    gripper.zero_gravity()
    try:
        ends_s = time.monotonic() + duration_s
        low_rad = high_rad = gripper.get_position_rad()
        with gripper.states(_HZ, ["position_rad", "stale"], batch=10) as states:
            for state in states:
                if state["position_rad"] is not None and not state["stale"]:
                    low_rad = min(low_rad, state["position_rad"])
                    high_rad = max(high_rad, state["position_rad"])
                if time.monotonic() >= ends_s:
                    return low_rad, high_rad
        raise CommandError("the states ended before the calibration", reason="connection_lost")
    finally:
        gripper.hold()
