"""Draws a flight-recorder dump, or a trajectory, with matplotlib.

A dump is an MCAP file. What its fields mean is written in the file itself; here are only the names
that are drawn.
"""

from __future__ import annotations

import io
import json
import math
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from time import localtime, strftime
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader

from litegrip_client.values.errors import CommandError
from litegrip_client.values.fields import STALE_AFTER_S
from litegrip_client.values.printed import date
from litegrip_client.values.trajectory import Trajectory
from litegrip_client.values.trajectory_format import TaughtGrip

_WARNING = 3
"""The level of a warning in the format of a dump's events, `foxglove.Log`."""


@dataclass(frozen=True)
class Happening:
    """One event of the dump, at its time of CLOCK_MONOTONIC."""

    at_s: float
    kind: str
    message: str
    data: Mapping[str, Any]
    is_warning: bool = False


@dataclass(frozen=True)
class Dump:
    """The ticks in order, each with the fields that were known in it, and what happened."""

    about: Mapping[str, str]
    ended_ns: int
    ticks: list[dict[str, Any]]
    events: list[Happening]

    def column(self, name: str) -> list[float]:
        """Return one field of all ticks; NaN, which is not drawn, where it was unknown."""
        return [float(tick.get(name, math.nan)) for tick in self.ticks]

    def measured(self, name: str) -> list[float]:
        """Return one field of the feedback; NaN where that is too old to say anything."""
        return [
            float(tick.get(name, math.nan)) if tick.get("age_s", 0.0) <= STALE_AFTER_S else math.nan
            for tick in self.ticks
        ]


def read(path: str) -> Dump:
    """Read a dump; raises `CommandError` for a file that is none."""
    try:
        with Path(path).open("rb") as file:
            found = _read(make_reader(file))
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    except (McapError, ValueError, KeyError, EOFError) as error:
        raise _unreadable(path, f"it is no whole MCAP file of the recorder: {error}") from error
    if not found.ticks:
        raise _unreadable(path, "there are no ticks in it")
    return found


def _read(reader: McapReader) -> Dump:
    about: dict[str, str] = {}
    for metadata in reader.iter_metadata():
        about |= metadata.metadata
    ticks: list[dict[str, Any]] = []
    events: list[Happening] = []
    ended_ns = 0
    for _schema, channel, message in reader.iter_messages():
        content = json.loads(message.data)
        if channel.topic.endswith("/tick"):
            ticks.append(content)
            ended_ns = message.log_time
        elif channel.topic.endswith("/event"):
            events.append(
                Happening(
                    content["monotonic_s"],
                    content["name"],
                    content["message"],
                    content["data"],
                    content["level"] >= _WARNING,
                )
            )
    return Dump(about, ended_ns, ticks, events)


def _unreadable(path: str, why: str) -> CommandError:
    return CommandError(
        f"cannot draw {path}: {why}",
        reason="dump_unreadable",
        data={"hint": "give a file that 'litegripctl dump' names"},
    )


def finish(axes: Axes, label: str, least: float = 0.0) -> None:
    """Give them a label, a grid and room; a legend beside them where lines have names.

    The axis spans `least` at least, so that noise does not look like motion, and its numbers are
    whole ones: none is to be added to all of them.
    """
    axes.set_ylabel(label, fontsize=9)
    if axes.get_yscale() == "linear":
        axes.ticklabel_format(axis="y", style="plain", useOffset=False)
        low, high = axes.get_ylim()
        missing = max(0.0, least - (high - low))
        axes.set_ylim(low - missing / 2, high + missing / 2)
    axes.grid(axis="y", color="#eceff1", lw=0.8)
    axes.set_axisbelow(True)
    for side in ("top", "right"):
        axes.spines[side].set_visible(False)
    axes.tick_params(labelsize=8)
    if axes.get_legend_handles_labels()[0]:
        axes.legend(
            loc="upper left",
            bbox_to_anchor=(1.0, 1.02),
            fontsize=8,
            frameon=False,
            handlelength=1.2,
        )


def png(figure: Figure) -> bytes:
    """Return what is written to a file."""
    file = io.BytesIO()
    figure.savefig(file, format="png")
    return file.getvalue()


_APART_SHARE = 0.022
"""Two labels are at least this share of the shown time apart."""

_LONGEST = 30
_ROUTINE = ("owner", "refused", "lease", "recorder", "job_ended", "calibration")
"""Not named while something else happens close by; the last ones rather than the first."""


@dataclass(frozen=True)
class Label:
    """A text at `x_s`, for what happened at `at_s`; both in seconds before the end."""

    at_s: float
    x_s: float
    text: str
    is_alarm: bool


def labels(events: list[Happening], end_s: float, begin_s: float) -> list[Label]:
    """Return the labels of events in their order of time."""
    apart_s = -begin_s * _APART_SHARE
    groups: list[list[Happening]] = []
    for event in sorted(events, key=lambda event: event.at_s):
        if groups and event.at_s - groups[-1][0].at_s < apart_s:
            groups[-1].append(event)
        else:
            groups.append([event])
    found = []
    for group in groups:
        first = max(group, key=_weight)
        others = {(one.kind, one.message) for one in group} - {(first.kind, first.message)}
        text = _short(first) + (f"  +{len(others)}" if others else "")
        at_s, x_s = first.at_s - end_s, group[0].at_s - end_s
        found.append(Label(at_s, x_s, text, any(map(_is_alarm, group))))
    return found


def _weight(event: Happening) -> int:
    if event.kind in _ROUTINE and not (event.kind == "job_ended" and _is_alarm(event)):
        return _ROUTINE.index(event.kind)
    if _is_alarm(event):
        return len(_ROUTINE) + {"job_ended": 2, "motor": 4}.get(event.kind, 3)
    return len(_ROUTINE) + (event.kind == "job_started")


def _is_alarm(event: Happening) -> bool:
    failed = event.kind == "job_ended" and event.data.get("state") in ("failed", "cancelled")
    fault = event.kind == "motor" and event.data.get("phase") in ("fault", "silent")
    return event.is_warning or failed or fault


def _short(event: Happening) -> str:
    """Return an event in few words: a motion's kind, the motor's new phase."""
    message, data = event.message, event.data
    if event.kind == "job_started" and "kind" in data:
        return f"{data['kind']} (job {data.get('job')})"
    if event.kind == "job_ended" and "state" in data:
        return f"job {data.get('job')} {data['state']}"
    if event.kind == "object_moved" and isinstance(data.get("moved_mm"), int | float):
        return f"object moved {data['moved_mm']:.1f} mm"
    if event.kind == "motor" and "phase" in data:
        return f"motor {data['phase']}"
    if event.kind in ("calibration", "stop", "heat", "weak", "recorder", "lease"):
        return event.kind
    words = re.split(r"[:;(]", message)[0].strip()
    return words if len(words) <= _LONGEST else f"{words[: _LONGEST - 1]}…"


_MEASURED, _COMMAND, _THIRD = "#1f4e79", "#d9822b", "#7f8c8d"
_ALARM, _QUIET = "#c0392b", "#9aa5b1"
_MODES = {
    "offline": "#bdbdbd",
    "disabled": "#e3e6ea",
    "enabling": "#fff2b3",
    "holding": "#b9dfc0",
    "moving": "#8fc1e3",
    "relaxed": "#dccdec",
    "disabling": "#fff2b3",
    "fault": "#e57368",
}
_GAP_S = 0.05
_LEAST_MM, _LEAST_RAD, _LEAST_NM, _LEAST_RAD_S = 10.0, 0.1, 0.5, 1.0
_SIZE_INCHES = (13.0, 9.2)
_LABELLED_SHARE = 0.06
"""A mode that lasts for less than this share of the time is coloured, but not named."""


def draw(dump: Dump, last_s: float | None) -> Figure:
    """Draw a dump, or the last `last_s` seconds of it."""
    end_s = dump.ticks[-1]["monotonic_s"]
    times = [time_s - end_s for time_s in dump.column("monotonic_s")]
    begin_s = times[0] if last_s is None else max(times[0], -last_s)
    figure = Figure(figsize=_SIZE_INCHES, dpi=110, facecolor="white")
    rows = figure.subplots(
        6, 1, sharex=True, height_ratios=(1.5, 0.28, 3.2, 2.2, 1.4, 1.4), squeeze=True
    )
    head, modes, position, torque, temperature, lateness = rows
    position.set_xlim(begin_s, max(0.0, begin_s + 0.01))
    _draw_modes(modes, dump, times, begin_s)
    _draw_position(position, dump, times)
    _draw_torque(torque, dump, times)
    _draw_temperature(temperature, dump, times)
    _draw_lateness(lateness, dump, times)
    shown = [e for e in dump.events if begin_s <= e.at_s - end_s <= 0.0]
    _draw_events(head, (position, torque, temperature, lateness), shown, end_s, begin_s)
    lateness.set_xlabel("time before the end of the recording [s]")
    _name_modes(figure, dump, end_s + begin_s)
    ended = strftime("%Y-%m-%d %H:%M:%S", localtime(dump.ended_ns // 1_000_000_000))
    cause, note = dump.about.get("cause", "").replace("_", " "), dump.about.get("note", "")
    words = [f"channel {dump.about.get('channel', '?')}, until {ended}", cause]
    words += [note] if note.replace("_", " ") != cause else []
    title = "   ·   ".join(word[:90] for word in words if word)
    figure.suptitle(title, x=0.075, ha="left", fontsize=11, y=0.985)
    figure.subplots_adjust(left=0.075, right=0.9, top=0.955, bottom=0.085, hspace=0.14)
    figure.align_ylabels(list(rows))
    return figure


def _name_modes(figure: Figure, dump: Dump, from_s: float) -> None:
    """Name the colours of the modes that are shown, below the rows."""
    shown = {str(tick["mode"]) for tick in dump.ticks if tick["monotonic_s"] >= from_s}
    figure.legend(
        handles=[
            Patch(facecolor=color, label=mode) for mode, color in _MODES.items() if mode in shown
        ],
        loc="lower left",
        bbox_to_anchor=(0.065, 0.0),
        ncols=len(_MODES),
        fontsize=8,
        frameon=False,
        title="mode",
        title_fontsize=8,
        alignment="left",
    )


def _draw_modes(axes: Axes, dump: Dump, times: list[float], begin_s: float) -> None:
    """Show the mode as a coloured strip, with its name where that has room."""
    begin = 0
    for mode, group in groupby(str(tick["mode"]) for tick in dump.ticks):
        after = begin + len(list(group))
        left, right = times[begin], times[min(after, len(times) - 1)]
        begin = after
        if right <= begin_s:
            continue
        left = max(left, begin_s)
        axes.axvspan(left, right, color=_MODES.get(mode, "#ffffff"), lw=0)
        if right - left >= -begin_s * _LABELLED_SHARE:
            axes.text((left + right) / 2, 0.5, mode, ha="center", va="center_baseline", fontsize=8)
    axes.set_ylim(0, 1)
    axes.set_yticks([])
    axes.tick_params(bottom=False)
    axes.set_ylabel("mode", rotation=0, ha="right", va="center", fontsize=9)


def _draw_position(axes: Axes, dump: Dump, times: list[float]) -> None:
    """Show the opening in mm, else, where it was never known, the position in rad."""
    is_calibrated = any("opening_mm" in tick for tick in dump.ticks)
    names = ("opening_mm", "command_mm") if is_calibrated else ("position_rad", "command_rad")
    _line(axes, times, dump.column(names[1]), "command", _COMMAND)
    _line(axes, times, dump.measured(names[0]), "measured", _MEASURED)
    finish(
        axes,
        "opening [mm]" if is_calibrated else "position [rad]",
        _LEAST_MM if is_calibrated else _LEAST_RAD,
    )


def _draw_torque(axes: Axes, dump: Dump, times: list[float]) -> None:
    axes.axhline(0.0, color="#d0d4d8", lw=0.8)
    _line(axes, times, dump.column("command_torque_nm"), "feed-forward", _COMMAND)
    _line(axes, times, dump.measured("torque_nm"), "measured", _MEASURED)
    finish(axes, "torque [N·m]", _LEAST_NM)


def _draw_temperature(axes: Axes, dump: Dump, times: list[float]) -> None:
    coil = dump.measured("coil_temperature_c")
    driver = dump.measured("driver_temperature_c")
    _line(axes, times, coil, "coil", _ALARM)
    _line(axes, times, driver, "driver", _THIRD)
    known = [value for value in coil + driver if not math.isnan(value)]
    if known:
        axes.set_ylim(min(known) - 3.0, max(known) + 3.0)
    finish(axes, "temperature [°C]")


def _draw_lateness(axes: Axes, dump: Dump, times: list[float]) -> None:
    """Show how late each tick began; lost and failed ones are marked."""
    late_us = [max(value, 1.0) for value in dump.column("late_us")]
    axes.plot(*_broken(times, late_us, _GAP_S), color=_MEASURED, lw=0.7, label="each tick")
    axes.set_yscale("log")
    axes.set_ylim(min(5.0, *late_us), max(2000.0, *late_us) * 1.5)
    lost = dump.column("lost_ticks")
    _mark(axes, times, late_us, lambda n: n > 0 and lost[n] > lost[n - 1], "ticks lost before")
    _mark(axes, times, late_us, lambda n: bool(dump.ticks[n]["failed"]), "tick failed")
    finish(axes, "lateness [µs]")


def _mark(
    axes: Axes, times: list[float], values: list[float], is_it: Callable[[int], bool], name: str
) -> None:
    marked = [n for n in range(len(times)) if is_it(n)]
    if marked:
        axes.plot(
            [times[n] for n in marked],
            [values[n] for n in marked],
            linestyle="none",
            marker="x" if "failed" in name else "o",
            markersize=4,
            color=_ALARM,
            label=name,
        )


def _line(axes: Axes, times: list[float], values: list[float], label: str, color: str) -> None:
    if not all(map(math.isnan, values)):
        axes.plot(*_broken(times, values, _GAP_S), label=label, color=color, lw=1.2)


def _broken(
    times: list[float], values: list[float], gap_s: float
) -> tuple[list[float], list[float]]:
    """Break a line where there was nothing for so long: nothing is known of the time between."""
    broken_times, broken_values = [times[0]], [values[0]]
    for before, time, value in zip(times[:-1], times[1:], values[1:], strict=True):
        if time - before > gap_s:
            broken_times.append(before)
            broken_values.append(math.nan)
        broken_times.append(time)
        broken_values.append(value)
    return broken_times, broken_values


def _draw_events(
    head: Axes, rows: tuple[Axes, ...], events: list[Happening], end_s: float, begin_s: float
) -> None:
    """Draw each event as a line through all rows, and name it in the free room above them."""
    head.set_axis_off()
    head.set_ylim(0.0, 1.0)
    for event in events:
        for axes in rows:
            axes.axvline(event.at_s - end_s, color=_QUIET, lw=0.6, ls=(0, (2, 2)), zorder=0.5)
    style: dict[str, Any] = {"fontsize": 7, "rotation": 30, "rotation_mode": "anchor"}
    for label in labels(events, end_s, begin_s):
        color = _ALARM if label.is_alarm else "#37474f"
        head.plot([label.at_s, label.x_s], [-0.05, 0.06], color=_QUIET, lw=0.6, clip_on=False)
        head.text(label.x_s, 0.08, label.text, color=color, ha="left", va="bottom", **style)


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
    times = [one.t for one in samples]
    for axes, values, label, least in (
        (opening, [one.openness * travel_mm for one in samples], "opening [mm]", 0.0),
        (velocity, [one.velocity_rad_s for one in samples], "velocity [rad/s]", _LEAST_RAD_S),
        (torque, [one.torque_nm for one in samples], "torque [N·m]", _LEAST_NM),
    ):
        broken = _broken(times, values, _LONG_GAP / trajectory.sample_hz)
        axes.plot(*broken, color=_LINE, lw=1.2, marker="." if len(times) == 1 else None)
        finish(axes, label, least)
    for grip in trajectory.grips:
        _grip((opening, velocity, torque), grip)
    opening.set_ylim(-0.04 * travel_mm, 1.04 * travel_mm)
    torque.set_xlabel("time [s]")
    words = [name, f"{len(trajectory)} samples at {trajectory.sample_hz:g} Hz"]
    words += [] if trajectory.mount is None else [f"mount {trajectory.mount}"]
    title = "   ·   ".join([*words, date(trajectory.created)])
    figure.suptitle(title, x=0.075, ha="left", fontsize=11, y=0.975)
    figure.subplots_adjust(left=0.075, right=0.97, top=0.93, bottom=0.08, hspace=0.12)
    figure.align_ylabels([opening, velocity, torque])
    return figure


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
