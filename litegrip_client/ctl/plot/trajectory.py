"""Draws a trajectory: opening, velocity and torque over time, its grips shaded; gaps are gaps."""

from __future__ import annotations

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from litegrip_client.ctl.plot.axes import finish
from litegrip_client.ctl.render_trajectories import date
from litegrip_client.taught_grips import TaughtGrip
from litegrip_client.trajectory import Trajectory

_LINE, _GRIP, _FORCE = "#1f4e79", "#fdebd0", "#a04000"
_LONG_GAP = 2.5
"""Samples further apart than so many periods are not joined."""


def draw_trajectory(trajectory: Trajectory, name: str) -> Figure:
    """Draw all of a trajectory; `name` is its title."""
    figure = Figure(figsize=(13.0, 7.2), dpi=110, facecolor="white")
    opening, velocity, torque = figure.subplots(
        3, 1, sharex=True, height_ratios=(3.0, 1.6, 1.6), squeeze=True
    )
    samples, travel_mm = trajectory.samples, trajectory.travel_mm
    _row(opening, trajectory, [one.openness * travel_mm for one in samples], "opening [mm]")
    _row(velocity, trajectory, [one.velocity_rad_s for one in samples], "velocity [rad/s]")
    _row(torque, trajectory, [one.torque_nm for one in samples], "torque [N·m]")
    for grip in trajectory.grips:
        _grip((opening, velocity, torque), grip)
    opening.set_ylim(-0.04 * travel_mm, 1.04 * travel_mm)
    torque.set_xlabel("time [s]")
    figure.suptitle(_title(trajectory, name), x=0.075, ha="left", fontsize=11, y=0.975)
    figure.subplots_adjust(left=0.075, right=0.97, top=0.93, bottom=0.08, hspace=0.12)
    figure.align_ylabels([opening, velocity, torque])
    return figure


def _title(trajectory: Trajectory, name: str) -> str:
    words = [name, f"{len(trajectory)} samples at {trajectory.sample_hz:g} Hz"]
    if trajectory.mount is not None:
        words.append(f"mount {trajectory.mount}")
    words.append(date(trajectory.created))
    return "   ·   ".join(words)


def _row(axes: Axes, trajectory: Trajectory, values: list[float], label: str) -> None:
    longest_s = _LONG_GAP / trajectory.sample_hz
    times: list[float] = []
    drawn: list[float] = []
    for sample, value in zip(trajectory.samples, values, strict=True):
        if times and sample.t - times[-1] > longest_s:
            times.append(times[-1])
            drawn.append(math.nan)
        times.append(sample.t)
        drawn.append(value)
    axes.plot(times, drawn, color=_LINE, lw=1.2, marker="." if len(times) == 1 else None)
    finish(axes, label)


def _grip(rows: tuple[Axes, ...], grip: TaughtGrip) -> None:
    """Shade the time of a grip in all rows, and write its force at the top of the first."""
    for axes in rows:
        axes.axvspan(grip.start_s, grip.end_s, color=_GRIP, lw=0.8, zorder=0.4)
    rows[0].annotate(
        f"{grip.force_n:g} N",
        ((grip.start_s + grip.end_s) / 2, 1.0),
        xycoords=("data", "axes fraction"),
        xytext=(0, -3),
        textcoords="offset points",
        ha="center",
        va="top",
        fontsize=8,
        color=_FORCE,
        annotation_clip=True,
    )
