"""What the pictures of `litegripctl plot` show: labels, lines, events, as they were recorded."""

import json
import math
import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from mcap.reader import make_reader

from litegrip_client import Trajectory
from litegrip_client.ctl.plot.drawing import (
    Dump,
    Happening,
    draw,
    draw_trajectory,
    labels,
    png,
    read,
)
from litegripd.recorder.files import read as read_memory
from litegripd.recorder.files import to_mcap
from tests.client.helpers import Ctl
from tests.client.taught import TAUGHT
from tests.geometry import TRAVEL_MM
from tests.trajectories import HEADER_BYTES, lgt
from tests.world import World

OPENING, TORQUE, COIL, LATENESS = (
    "opening [mm]",
    "torque [N·m]",
    "temperature [°C]",
    "lateness [µs]",
)
STALE_S = 0.15
ALARM = "#c0392b"


def recorded(folder: Path, world: World) -> Path:
    path = folder / "x.mcap"
    path.write_bytes(to_mcap(read_memory(bytes(world.disk.memory)), "motor_fault", "", 10**18))
    return path


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A grip, a motion that a fault ends, and then a motor that is switched off."""
    world = World()
    client = world.enabled()
    world.gripper.heat_coil(50.0)
    world.gripper.put_object(width_mm=50.0)
    client.result("motion.grasp", force_n=8, until="verdict")
    world.run(0.5)
    client.send("motion.open")
    world.run(0.3)
    world.gripper.set_supply(40.0)
    world.run(0.5)
    world.gripper.power_off()
    world.run(0.5)
    return recorded(tmp_path_factory.mktemp("dump"), world)


@pytest.fixture
def dump(path: Path) -> Dump:
    return read(str(path))


def content_of(path: Path, topic: str) -> list[dict[str, Any]]:
    """Return the messages of a recorded file as they are in it."""
    with path.open("rb") as file:
        found = make_reader(file).iter_messages()
        return [json.loads(m.data) for _s, channel, m in found if channel.topic.endswith(topic)]


def rows(figure: Figure) -> dict[str, Axes]:
    return {axes.get_ylabel(): axes for axes in figure.axes}


def points(line: Line2D) -> tuple[list[float], list[float]]:
    times, shown = map(np.asarray, line.get_data())
    return times.tolist(), shown.tolist()


def lines(axes: Axes) -> dict[str, Any]:
    """Return the lines that have a name, as times and values."""
    named = {str(line.get_label()): points(line) for line in axes.lines}
    return {name: line for name, line in named.items() if not name.startswith("_")}


def verticals(axes: Axes) -> list[float]:
    """Return the times of the lines from the bottom to the top."""
    drawn = map(points, axes.lines)
    return [times[0] for times, shown in drawn if shown == [0, 1] and times[0] == times[1]]


def values(ticks: list[dict[str, Any]], name: str, *, is_measured: bool = True) -> Any:
    """Return what a line is to show: nothing where nothing was known, or only what was once."""
    shown = [
        math.nan if is_measured and tick.get("age_s", 0.0) > STALE_S else tick.get(name, math.nan)
        for tick in ticks
    ]
    assert not all(map(math.isnan, shown)), f"{name} tells nothing"
    return pytest.approx(shown, nan_ok=True)


def test_each_row_of_a_dump_has_a_label_with_its_unit(dump: Dump) -> None:
    figure = draw(dump, None)
    names = [axes.get_ylabel() for axes in figure.axes]
    assert names == ["", "mode", OPENING, TORQUE, COIL, LATENESS]
    assert figure.axes[-1].get_xlabel() == "time before the end of the recording [s]"
    assert figure.get_suptitle().startswith("channel virtual, until 2001-09-0")
    assert figure.get_suptitle().endswith("motor fault")


def test_the_colours_of_the_modes_that_occur_are_named(dump: Dump) -> None:
    figure = draw(dump, None)
    (legend,) = figure.legends
    shown = [text.get_text() for text in legend.get_texts()]
    assert set(shown) == {str(tick["mode"]) for tick in dump.ticks}
    assert {"fault", "holding", "moving"} <= set(shown)
    (late,) = draw(dump, 0.2).legends
    assert len(late.get_texts()) < len(shown)


def test_a_gripper_at_rest_is_a_line_and_no_landscape(tmp_path: Path) -> None:
    world = World()
    world.enabled()
    world.run(1.0)
    figure = draw(read(str(recorded(tmp_path, world))), None)
    drawn = rows(figure)
    for label, least in ((OPENING, 10.0), (TORQUE, 0.5), (COIL, 6.0)):
        low, high = drawn[label].get_ylim()
        assert high - low >= least * 0.999, label
    png(figure)  # the texts are known behind this
    for label in (OPENING, TORQUE, COIL):
        assert drawn[label].yaxis.get_offset_text().get_text() == ""


def test_the_lines_of_a_dump_are_what_was_recorded(path: Path, dump: Dump) -> None:
    ticks = content_of(path, "/tick")
    end_s = ticks[-1]["monotonic_s"]
    times = pytest.approx([tick["monotonic_s"] - end_s for tick in ticks])
    assert any(tick.get("age_s", 0.0) > STALE_S for tick in ticks)
    drawn = rows(draw(dump, None))
    assert lines(drawn[OPENING]) == {
        "command": (times, values(ticks, "command_mm", is_measured=False)),
        "measured": (times, values(ticks, "opening_mm")),
    }
    assert lines(drawn[TORQUE]) == {
        "feed-forward": (times, values(ticks, "command_torque_nm", is_measured=False)),
        "measured": (times, values(ticks, "torque_nm")),
    }
    assert lines(drawn[COIL]) == {
        "coil": (times, values(ticks, "coil_temperature_c")),
        "driver": (times, values(ticks, "driver_temperature_c")),
    }


def test_a_line_is_broken_where_there_were_no_ticks(dump: Dump) -> None:
    ticks = [*dump.ticks[:100], *dump.ticks[200:]]
    drawn = lines(rows(draw(replace(dump, ticks=ticks), None))[TORQUE])["measured"]
    end_s = ticks[-1]["monotonic_s"]
    times = [tick["monotonic_s"] - end_s for tick in ticks]
    shown = values(ticks, "torque_nm").expected
    assert drawn == (
        pytest.approx([*times[:100], times[99], *times[100:]]),
        pytest.approx([*shown[:100], math.nan, *shown[100:]], nan_ok=True),
    )


def test_a_dump_without_calibration_is_drawn_in_radians(tmp_path: Path) -> None:
    world = World(calibrated=False)
    world.gripper.push(0.5)
    world.run(0.5)
    path = recorded(tmp_path, world)
    drawn = rows(draw(read(str(path)), None))
    assert OPENING not in drawn
    _times, shown = lines(drawn["position [rad]"])["measured"]
    assert shown == values(content_of(path, "/tick"), "position_rad")


def test_lateness_is_drawn_and_what_it_has_cost_is_marked(dump: Dump) -> None:
    late_us = [5.0 + number % 90 for number in range(len(dump.ticks))]
    ticks = [
        {**tick, "late_us": late, "lost_ticks": 3 * (n >= 200), "failed": n in (10, 20)}
        for n, (tick, late) in enumerate(zip(dump.ticks, late_us, strict=True))
    ]
    axes = rows(draw(replace(dump, ticks=ticks), None))[LATENESS]
    times = [tick["monotonic_s"] - ticks[-1]["monotonic_s"] for tick in ticks]
    assert axes.get_yscale() == "log"
    assert lines(axes) == {
        "each tick": (times, late_us),
        "ticks lost before": ([times[200]], [late_us[200]]),
        "tick failed": ([times[10], times[20]], [late_us[10], late_us[20]]),
    }


def test_each_event_is_a_line_through_all_rows(path: Path, dump: Dump) -> None:
    end_s = content_of(path, "/tick")[-1]["monotonic_s"]
    events = [event["monotonic_s"] - end_s for event in content_of(path, "/event")]
    assert len(events) > 10
    drawn = rows(draw(dump, None))
    for name in (OPENING, TORQUE, COIL, LATENESS):
        assert sorted(verticals(drawn[name])) == pytest.approx(sorted(events)), name
    last = rows(draw(dump, 1.2))[TORQUE]
    assert last.get_xlim() == pytest.approx((-1.2, 0.0))
    shown = [at_s for at_s in events if at_s >= -1.2]
    assert 0 < len(shown) < len(events)
    assert sorted(verticals(last)) == pytest.approx(sorted(shown))


def test_events_are_named_above_the_rows_where_they_were(path: Path, dump: Dump) -> None:
    events, ticks = content_of(path, "/event"), content_of(path, "/tick")
    (fault_s,) = [
        e["monotonic_s"] for e in events if e["message"].startswith("motor: enabled -> fault")
    ]
    head, modes, *_ = draw(dump, None).axes
    named = {text.get_text(): text for text in head.texts}
    assert list(named) == [
        "CAN bus  +1",
        "enable (job 1)  +6",
        "job 2 done",
        "open (job 3)",
        "motor fault  +1",
        "motor silent  +1",
    ]
    at_s = named["motor fault  +1"].get_position()[0]
    assert at_s == pytest.approx(fault_s - ticks[-1]["monotonic_s"])
    alarms = [text for text, drawn in named.items() if drawn.get_color() == ALARM]
    assert alarms == ["motor fault  +1", "motor silent  +1"]
    modes_named = [text.get_text() for text in modes.texts]
    assert modes_named == ["moving", "holding", "moving", "fault", "offline"]


def test_an_object_that_moved_is_named_with_its_way_and_is_no_alarm() -> None:
    text = "the object gave way by 1.5 mm and is held again, at 48.5 mm"
    data = {"moved_mm": 1.49, "width_mm": 48.5}
    (label,) = labels([Happening(1.0, "object_moved", text, data)], 10.0, -10.0)
    assert (label.text, label.is_alarm) == ("object moved 1.5 mm", False)
    (other,) = labels([Happening(1.0, "object_moved", text, {})], 10.0, -10.0)
    assert other.text.startswith("the object gave way")


def test_labels_are_few_and_the_worst_gives_its_name() -> None:
    routine = [Happening(0.001 * n, "lease", "lease 1 taken", {}) for n in range(50)]
    fault = Happening(0.02, "motor", "motor: enabled -> fault", {"phase": "fault"})
    (label,) = labels([*routine, fault], 10.0, -10.0)
    assert (label.text, label.is_alarm) == ("motor fault  +1", True)
    many = [Happening(0.01 * n, "stop", f"stop {n}", {}) for n in range(1000)]
    assert len(labels(many, 10.0, -10.0)) < 50


@pytest.mark.parametrize("last_s", [None, 0.5, 500.0])
def test_the_file_is_this_picture_of_a_dump(
    litegripctl: Ctl, path: Path, dump: Dump, tmp_path: Path, last_s: float | None
) -> None:
    picture = tmp_path / "y.png"
    last = () if last_s is None else ("--last", str(last_s))
    shown = litegripctl("plot", str(path), "-o", str(picture), *last)
    assert shown == (0, f"drawn in {picture}\n", "")
    assert picture.read_bytes() == png(draw(dump, last_s))


# Trajectories

GAP_AFTER = 60
SAMPLES = [
    (0.01 * n + (0.2 if n > GAP_AFTER else 0.0), n / 120, -1.5 + n / 80, 0.5 - n / 100, n / 50 - 1)
    for n in range(121)
]
"""Time, openness, position, velocity and torque; in the middle some are missing."""
CONTENT = lgt([sample[:2] for sample in SAMPLES])[:HEADER_BYTES] + b"".join(
    struct.pack("<ddddd", *sample) for sample in SAMPLES
)
ROWS = (OPENING, "velocity [rad/s]", TORQUE)


def with_gap(column: list[float]) -> Any:
    """Return what a line is to show of a column: nothing in the gap."""
    before = column[: GAP_AFTER + 1]
    return pytest.approx([*before, math.nan, *column[GAP_AFTER + 1 :]], nan_ok=True)


def test_the_lines_of_a_trajectory_are_what_was_recorded() -> None:
    trajectory = Trajectory.from_bytes(CONTENT)
    figure = draw_trajectory(trajectory, "pick")
    assert [axes.get_ylabel() for axes in figure.axes] == list(ROWS)
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert figure.get_suptitle().startswith("pick   ·   121 samples at 100 Hz   ·   mount normal")
    times_s, openness, _position, velocity, torque = map(list, zip(*SAMPLES, strict=True))
    travel_mm = TRAVEL_MM
    drawn: dict[str, Any] = {}
    for axes in figure.axes:
        (line,) = axes.lines
        at_s, shown = points(line)
        assert at_s.pop(GAP_AFTER + 1) == times_s[GAP_AFTER]
        assert at_s == times_s
        drawn[axes.get_ylabel()] = shown
    assert drawn == {
        OPENING: with_gap([travel_mm * share for share in openness]),
        "velocity [rad/s]": with_gap(velocity),
        TORQUE: with_gap(torque),
    }


def test_grips_are_shaded_in_all_rows_and_their_force_is_named() -> None:
    figure = draw_trajectory(TAUGHT, "pick")
    for axes in figure.axes:
        spans = [
            patch.get_extents().transformed(axes.transData.inverted()) for patch in axes.patches
        ]
        assert [(span.x0, span.x1) for span in spans] == [
            pytest.approx((grip.start_s, grip.end_s)) for grip in TAUGHT.grips
        ]
    assert [text.get_text() for text in figure.axes[0].texts] == ["8 N", "12.5 N"]


def test_the_file_is_this_picture_of_a_trajectory(litegripctl: Ctl, tmp_path: Path) -> None:
    path = tmp_path / "pick.lgt"
    path.write_bytes(CONTENT)
    assert litegripctl("plot", str(path))[0] == 0
    picture = png(draw_trajectory(Trajectory.from_bytes(CONTENT), "pick"))
    assert path.with_suffix(".png").read_bytes() == picture
