"""How far a command may lead the jaws: in two tiers, less near the stop that lies ahead."""

from litegripd.model.geometry import Geometry
from litegripd.model.motion_config import MotionConfig


def is_in_press_zone(short_rad: float, geometry: Geometry, config: MotionConfig) -> bool:
    """Whether jaws that are `short_rad` short of the stop are to press on it gently."""
    return short_rad <= geometry.to_rad(config.press_zone_mm)


def lead_cap_rad(short_rad: float, geometry: Geometry, config: MotionConfig) -> float:
    """Return the largest lead (rad) for jaws that are `short_rad` short of the stop ahead."""
    pressing = is_in_press_zone(short_rad, geometry, config)
    return geometry.to_rad(config.stop_lead_mm if pressing else config.max_lead_mm)


def led(wanted_rad: float, position_rad: float, lead_rad: float) -> float:
    """Return the position nearest to the wanted one that leads the jaws by `lead_rad` at most."""
    return min(max(wanted_rad, position_rad - lead_rad), position_rad + lead_rad)
