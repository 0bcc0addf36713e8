"""What a caller wants of a replay, and whether and how fast a loaded trajectory can be gone so."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.control.loading import Loading
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import RANGES, MotionConfig
from litegripd.model.path import Path

Force: TypeAlias = Literal["path", "replay"]

FASTEST_MM_S = RANGES["speed_mm_s"][1]
"""No path is replayed faster than any other motion may be."""

CATCH_UP = 1.2
"""Jaws that were held up go so much faster than the path's fastest part, to reach it again."""

LONGEST_S = 86_400.0


@dataclass(frozen=True, slots=True)
class ReplayRequest:
    """What a caller wants of a replay: `repeat` passes, 0 for ever.

    `source` is the trajectory as the helper process knows it; `torque_nm` the most to press with
    on the path; with `force` "replay" the taught grips are done again.
    """

    source: Mapping[str, object]
    speed: float = 1.0
    torque_nm: float = 2.0
    repeat: int = 1
    align: bool = True
    force: Force = "path"


def unfit(
    request: ReplayRequest, path: Path, geometry: Geometry, config: MotionConfig, here_rad: float
) -> Refusal | None:
    """Say that a path takes too long, or begins too far from jaws that shall not align, if so."""
    if not path.duration_s <= LONGEST_S:
        text = f"the trajectory takes {path.duration_s:g} s, at most {LONGEST_S:g} s are played"
        return Refusal("out_of_limits", text)
    distance_rad = abs(geometry.position_rad(path.openness_at(0.0)) - here_rad)
    distance_mm, most_mm = distance_rad * geometry.rad_to_mm, config.max_lead_mm
    if request.align or distance_mm <= most_mm:
        return None
    text = (
        f"the trajectory begins {distance_mm:.1f} mm from where the jaws are, without align"
        f" at most {most_mm:g} mm (max_lead_mm): leave align on, or move there first"
    )
    data = {"field": "align", "requested": distance_mm, "limit": most_mm}
    return Refusal("out_of_limits", text, data)


def speed_refusal(speed: float, max_rate_s: float, geometry: Geometry) -> Refusal | None:
    """Say that the fastest part of a path, `max_rate_s` of the travel, is too fast, if so."""
    rate_mm_s = max_rate_s * geometry.travel_mm
    if rate_mm_s * speed <= FASTEST_MM_S:
        return None
    most = FASTEST_MM_S / rate_mm_s
    text = (
        f"speed is {speed:g}, with which the fastest part of the trajectory has"
        f" {rate_mm_s * speed:.4g} mm/s; at most {most:.3g} goes, {FASTEST_MM_S:g} mm/s"
    )
    return Refusal("out_of_limits", text, {"field": "speed", "requested": speed, "limit": most})


def fastest_rad_s(
    speed: float, max_rate_s: float, geometry: Geometry, config: MotionConfig
) -> float:
    """Return how fast commands may move along a path whose fastest part is `max_rate_s`."""
    taught_rad_s = max_rate_s * geometry.travel_rad * speed
    usual_rad_s = geometry.to_rad(config.speed_mm_s)
    return min(CATCH_UP * max(taught_rad_s, usual_rad_s), geometry.to_rad(FASTEST_MM_S))


def grips_refusal(force: Force, loading: Loading) -> Refusal | None:
    """Say why there are no grips to repeat, where they are wanted."""
    if force == "path" or loading.grips:
        return None
    hint = "only its path can be replayed"
    if loading.grip_problem is not None:
        text = f"the grips of this trajectory cannot be used: {loading.grip_problem}; {hint}"
        return Refusal("trajectory_unreadable", text)
    text = f"no grip is kept with this trajectory; {hint}"
    return Refusal("out_of_limits", text, {"field": "force"})
