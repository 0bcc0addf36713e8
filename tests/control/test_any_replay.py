"""The replay by itself, with made-up jaws: by the clock, and whatever the path is."""

import hashlib
import json
import math
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from litegrip_client.values.trajectory_format import TaughtGrip, pack_grips
from litegripd.control.holds import LARGEST, Slack
from litegripd.control.limiter import DEFAULT_GAINS, torque_bound_nm
from litegripd.control.motions.grasp import FIRM_NM, TOUCH_SHARE
from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310, FASTEST_MM_S, Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand, MotorPhase, MotorView
from litegripd.model.state import ReplayResult, Result, TaskResult
from litegripd.trajectories.replay import Replay, ReplayRequest
from litegripd.trajectories.store import TrajectoryStore
from tests.trajectories import Point, lgt, pieces, sampled, swing
from tests.world import PERIOD_S

GEOMETRY = Geometry(0.114, -1.491, 74.8)


class Jaws:
    """Jaws that follow the command in the next tick, as far as `follows`, and a helper at hand."""

    def __init__(
        self,
        points: list[Point],
        follows: float = 1.0,
        grips: tuple[TaughtGrip, ...] = (),
        obstacle_rad: float = math.inf,
        **request: object,
    ) -> None:
        self.store = TrajectoryStore(lambda: Path("/nowhere"))
        operations = self.store.operations()
        content = lgt(points)
        beside = pack_grips(grips, hashlib.sha256(content).hexdigest()) if grips else b""
        common = {"key": "tmp/it", "name": None, "header": None, "grip_bytes": len(beside)}
        for piece in pieces(content + beside, **common):
            operations["trajectory.put"](piece)
        wanted = ReplayRequest("tmp/it", **request)  # type: ignore[arg-type]
        self.replay = Replay(
            wanted,
            geometry=GEOMETRY,
            config=MotionConfig(),
            gains=DEFAULT_GAINS,
            period_s=PERIOD_S,
            motor_type=DM4310,
            idle=Slack,
        )
        self.follows = follows
        self.obstacle_rad = obstacle_rad
        self.torque_nm = 0.0
        self.now_s = 100.0
        self.position_rad = -0.7
        self.velocity_rad_s = 0.0
        self.outcome: Result | Refusal | None = None

    @property
    def phase(self) -> str:
        return self.replay.phase

    def tick(self, after_s: float = PERIOD_S) -> MitCommand | None:
        """Let time pass, and the replay make its step."""
        self.now_s += after_s
        feedback = Feedback(
            1,
            self.position_rad,
            self.velocity_rad_s,
            self.torque_nm,
            30,
            30,
            self.now_s - PERIOD_S,
        )
        step = self.replay.step(self.now_s, MotorView(MotorPhase.ENABLED, feedback))
        self.outcome = step.outcome
        if step.task is not None:
            answer = self.store.operations()[step.task.operation](step.task.parameters)
            step.task.on_result(TaskResult(json.loads(json.dumps(answer))))
        if step.command is not None:
            command, here_rad = step.command, self.position_rad
            self.torque_nm = command.kp_nm_rad * (command.position_rad - here_rad)
            self.torque_nm += command.kd_nm_s_rad * command.velocity_rad_s + command.torque_nm
            moved_rad = self.follows * (command.position_rad - here_rad)
            moved_rad = min(moved_rad, self.obstacle_rad - here_rad)
            self.position_rad += moved_rad
            self.velocity_rad_s = moved_rad / PERIOD_S
        return step.command


def test_over_ten_minutes_it_is_on_time_to_a_tick() -> None:
    """Whatever the ticks do: early ones, late ones, lost ones."""
    points = sampled(swing(0.5, 0.4, 7.3), 600.0)
    jaws = Jaws(points)
    while jaws.phase != "play":
        jaws.tick()
    began_s, ticks, motion = jaws.now_s, 0, swing(0.5, 0.4, 7.3)
    while jaws.phase == "play":
        jaws.tick((0.2 * PERIOD_S, PERIOD_S, 1.8 * PERIOD_S, 4.0 * PERIOD_S)[ticks % 4])
        ticks += 1
        elapsed_s = jaws.now_s - began_s
        if elapsed_s < 600.0:
            assert abs((jaws.replay.openness or 0.0) - motion(elapsed_s)) < 1e-4
    assert elapsed_s == pytest.approx(600.0, abs=4 * PERIOD_S)
    assert elapsed_s >= 600.0 - 1e-6
    while jaws.outcome is None:
        jaws.tick()
    assert isinstance(jaws.outcome, ReplayResult)
    assert jaws.outcome.ok


@st.composite
def paths(draw: st.DrawFn) -> list[Point]:
    """Paths of all kinds, sudden turns and standing times included."""
    steps = draw(
        st.lists(
            st.tuples(st.sampled_from([0.0, 1e-6, 0.004, 0.01, 0.1, 0.5]), st.floats(0.0, 1.0)),
            min_size=1,
            max_size=12,
        )
    )
    t_s = draw(st.floats(-1e4, 1e4))
    points = []
    for step_s, openness in steps:
        t_s += step_s
        points.append((t_s, openness))
    return points


@settings(max_examples=100, deadline=None)
@given(
    points=paths(),
    speed=st.floats(0.25, 4.0),
    torque_nm=st.floats(0.3, 3.0),
    follows=st.sampled_from([0.0, 0.3, 0.9, 1.0]),
    repeat=st.integers(0, 3),
    align=st.booleans(),
)
def test_whatever_the_path_no_command_leaves_its_bounds(
    points: list[Point], speed: float, torque_nm: float, follows: float, repeat: int, align: bool
) -> None:
    """Inside the travel, within the torque, never faster than jaws may go; and it ends."""
    jaws = Jaws(points, follows, speed=speed, torque_nm=torque_nm, repeat=repeat, align=align)
    lead_before_mm = 0.0
    duration_s = (points[-1][0] - points[0][0]) / speed
    last_tick = round((duration_s + 8.0) * max(repeat, 1) / PERIOD_S)
    for _ in range(last_tick):
        at_rad = jaws.position_rad
        command = jaws.tick()
        if command is not None:
            assert GEOMETRY.open_rad - 1e-9 <= command.position_rad <= GEOMETRY.closed_rad + 1e-9
            standing = Feedback(1, at_rad, 0.0, 0.0, 30, 30, 0.0)
            assert torque_bound_nm(command, standing) <= torque_nm * (1.0 + 1e-9)
            assert command.torque_nm == 0.0
            # It may go back towards the jaws at once, but not away from them.
            lead_mm = abs(command.position_rad - at_rad) * GEOMETRY.rad_to_mm
            assert lead_mm <= lead_before_mm + FASTEST_MM_S * PERIOD_S + 1e-6
            lead_before_mm = abs(command.position_rad - jaws.position_rad) * GEOMETRY.rad_to_mm
        if jaws.outcome is not None:
            break
    assert (jaws.outcome is None) <= (repeat == 0)


@st.composite
def taught(draw: st.DrawFn) -> tuple[list[Point], tuple[TaughtGrip, ...]]:
    """Slow paths with grips: short ones, one after the other at once, at the begin and the end."""
    times = sorted(
        draw(st.lists(st.sampled_from([0.0, 0.3, 0.31, 1.0, 2.0, 3.0]), min_size=3, max_size=9))
    )
    grips = tuple(
        TaughtGrip(*triple, 0.5, 60.0, draw(st.sampled_from([0.5, 8.0, 30.0])), "anybody")
        for triple in zip(times[::3], times[1::3], times[2::3], strict=False)
    )
    middle, size = draw(st.floats(0.3, 0.7)), draw(st.sampled_from([0.0, 0.05, 0.3]))
    return sampled(swing(middle, size, draw(st.sampled_from([3.0, 4.0]))), 3.0), grips


@settings(max_examples=60, deadline=None)
@given(
    path=taught(),
    obstacle=st.sampled_from([None, 0.1, 0.4, 0.6]),
    gone_s=st.sampled_from([None, 2.0, 5.0]),
    torque_nm=st.floats(0.3, 3.0),
    repeat=st.integers(1, 2),
)
def test_whatever_the_grips_no_command_is_stronger_than_its_phase_allows(
    path: tuple[list[Point], tuple[TaughtGrip, ...]],
    obstacle: float | None,
    gone_s: float | None,
    torque_nm: float,
    repeat: int,
) -> None:
    """On the path by its torque, to a contact by the budget, in the hold by the force; it ends."""
    points, grips = path
    obstacle_rad = math.inf if obstacle is None else GEOMETRY.position_rad(obstacle)
    jaws = Jaws(
        points, 1.0, grips, obstacle_rad, force="replay", torque_nm=torque_nm, repeat=repeat
    )
    jaws.position_rad = GEOMETRY.position_rad(0.9)
    began_s = jaws.now_s
    held_nm = max(grip.force_n for grip in grips) / 10.0
    load_nm = LARGEST * DM4310.coulomb_nm  # what these jaws may have shown on their way
    touch_nm = load_nm + min(max(TOUCH_SHARE * held_nm, FIRM_NM[0]), FIRM_NM[1])
    for _ in range(round(repeat * (20.0 + 8.0 * len(grips)) / PERIOD_S)):
        if gone_s is not None and jaws.now_s - began_s > gone_s:
            jaws.obstacle_rad = math.inf
        at_rad, was_held = jaws.position_rad, jaws.replay.grips.held is not None
        command = jaws.tick()
        is_held = jaws.replay.grips.held is not None
        if command is not None:
            assert GEOMETRY.open_rad - 1e-9 <= command.position_rad <= GEOMETRY.closed_rad + 1e-9
            most_nm = max(torque_nm, touch_nm, held_nm if was_held or is_held else 0.0)
            speed_rad_s = command.velocity_rad_s if was_held or is_held else 0.0
            standing = Feedback(1, at_rad, speed_rad_s, 0.0, 30, 30, 0.0)
            assert torque_bound_nm(command, standing) <= most_nm * (1.0 + 1e-9)
        if jaws.outcome is not None:
            break
    assert isinstance(jaws.outcome, ReplayResult)
