"""Hands that teach the jaws, and trajectories to be replayed, for the scenes about them."""

import math
from functools import partial
from typing import Any

from litegrip_client import (
    Trajectory,
    TrajectorySample,
)
from litegripd.model.motor import MitCommand
from tests.drop_in import Daemon, Site

CODE_NM = 20.0 / 4095
"""One step of a commanded torque on the bus."""

POINTS_AT = [number / 100 for number in range(201)]


def push(site: Site, daemon: Daemon, *steps: tuple[float, float]) -> None:
    """Have a hand push the jaws: each step is from when on, in s, and with which opening torque."""
    sign = daemon.gripper.parameters.close_sign
    for at_s, opening_nm in steps:
        site.after(at_s, partial(daemon.gripper.push, -opening_nm * sign))


def teach(site: Site, daemon: Daemon) -> None:
    """Have a hand open the jaws for a while, at some 100 mm/s, and let go of them."""
    push(site, daemon, (0.2, 0.25), (0.25, 0.18), (0.45, 0.0))


def swing(size: float = 0.2, middle: float = 0.5, torque_nm: float = 0.0) -> Trajectory:
    """Return a motion to and fro, of 2 s."""
    samples = [
        TrajectorySample(t, middle + size * math.sin(math.pi * t), 0.0, 0.0, torque_nm)
        for t in POINTS_AT
    ]
    return Trajectory(samples, 100.0, 1.7e9, 0.114, -1.491, 74.8)


def assert_slack(command: MitCommand) -> None:
    """No gain, and no torque but for the step with which zero is coded."""
    assert (command.kp_nm_rad, command.kd_nm_s_rad) == (0.0, 0.0)
    assert abs(command.torque_nm) < CODE_NM


def off_mm(moments: Any, trajectory: Trajectory, begun_s: float, travel_mm: float) -> float:
    """Return how far the jaws were from the path at most, from `begun_s` on."""
    worst = 0.0
    for sample in trajectory.samples:
        at_s = begun_s + sample.t - trajectory.samples[0].t
        moment = min(moments, key=lambda one: abs(one.at_s - at_s))
        worst = max(worst, abs(moment.opening_mm - sample.openness * travel_mm))
    return worst
