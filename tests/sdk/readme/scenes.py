"""What these scenes have in common: calibration files, obstacles, and what records say."""

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from litegrip_client import LiteGrip, MotionConfig
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from tests.drop_in import Daemon, Moment, Site
from tests.geometry import MM_RAD, OPEN_RAD, SPAN_MM

LEAD_MM_RAD = 74.8
"""1 mm of a lead in a `MotionConfig` is a torque: that of the vendor's kp 100 at 74.8 mm/rad.
Motions have that stiffness; so it is as much in rad, whatever a calibration says."""
CODE_RAD = 25.0 / 65535
"""One step of a commanded position on the bus."""
CODE_RAD_S = 60.0 / 4095

BENCH_UNIT = {"closed_rad": -0.009666, "open_rad": -1.627123, "rad_to_mm": SPAN_MM / 1.617457}
"""A real gripper whose travel differs from the templates' (field measurements, from their zero)."""


def bench_unit(mount: str, **more: Any) -> SimulatorParameters:
    """Return a gripper that is not quite what the template of its mount says."""
    closed_rad, open_rad = BENCH_UNIT["closed_rad"], BENCH_UNIT["open_rad"]
    if mount == "reverse":
        closed_rad, open_rad = OPEN_RAD - closed_rad, OPEN_RAD - open_rad
    return SimulatorParameters(
        closed_rad=closed_rad, open_rad=open_rad, rad_to_mm=BENCH_UNIT["rad_to_mm"], **more
    )


def tuned(**values: float) -> MotionConfig:
    """Return a configuration in which these fields, and no others, are set."""
    config = MotionConfig()
    for name, value in values.items():
        setattr(config, name, value)
    return config


def content(mount: str, **more: Any) -> dict[str, Any]:
    """Return what a calibration file of the vendor's SDK holds."""
    closed_rad, open_rad = limits_of_mount(mount)
    return {
        "calibrated": True,
        "zero_position_rad": closed_rad,
        "max_position_rad": open_rad,
        "travel_range_rad": abs(closed_rad - open_rad),
        "rad_to_mm": MM_RAD,
        **more,
    }


def write_file(path: Path, mount: str, **more: Any) -> Path:
    """Write a calibration file."""
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps(content(mount, **more)), encoding="utf-8")
    return path


def own_file(home: Path, channel: str, mount: str, **more: Any) -> Path:
    """Write a channel's own file, where the SDK keeps it."""
    path = home / ".litegrip" / f"{channel}_calibration.json"
    return write_file(path, mount, channel=channel, **more)


def speed_mm_s(moments: Sequence[Moment], from_mm: float, to_mm: float) -> float:
    """Return how fast the jaws first went from one opening to another."""
    sign = 1.0 if to_mm > from_mm else -1.0
    ahead = [moment for moment in moments if (moment.opening_mm - from_mm) * sign >= 0.0]
    arrived = next(i for i, m in enumerate(ahead) if (m.opening_mm - to_mm) * sign >= 0.0)
    first, last = ahead[0], ahead[arrived]
    return (last.opening_mm - first.opening_mm) * sign / (last.at_s - first.at_s)


def lead_mm(moment: Moment) -> float:
    """Return by how much the command leads the position that the daemon measured, as a setting."""
    assert moment.command is not None
    return abs(moment.command.position_rad - moment.measured_rad) * LEAD_MM_RAD


def jaws_are_loose(site: Site, daemon: Daemon) -> bool:
    """Push the jaws by hand for a moment; tell whether they gave way."""
    before_mm = daemon.gripper.opening_mm
    daemon.gripper.push(-0.6 * daemon.gripper.parameters.close_sign)
    site.run(0.2)
    daemon.gripper.push(0.0)
    return daemon.gripper.opening_mm > before_mm + 3.0


def load_content(gripper: LiteGrip, content: dict[str, Any]) -> None:
    """Have the daemon use the content of a calibration file that is nowhere on the disk."""
    gripper._session.connection.call("calibration.load", {"content": content})
