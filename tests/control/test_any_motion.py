"""Whatever is asked for and whatever is measured: every command stays inside the limits.

Twice: on the whole daemon with a simulated gripper, by the frames that it sends; and on the
controller alone, where a measurement may be what no gripper does.
"""

import struct
from contextlib import suppress
from dataclasses import replace
from typing import Any

import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, rule

from litegripd.model.calibration import CalibrationError, read_content
from litegripd.model.gripper import DM4310
from litegripd.model.motion_config import MotionConfig, MotionConfigError
from litegripd.model.motor import CanFrame, MotorPhase, Ranges, ZeroView
from litegripd.motor import codec
from litegripd.sim.plant import MOUNTS
from tests.control.any_requests import (
    NORMAL,
    REVERSE,
    Values,
    any_fields,
    calls,
    go_together,
    good_fields,
    motions,
    odd_contents,
    trajectories,
)
from tests.control.bench import LEAVE, Bench, Course, Request
from tests.control.limits import LimitWatch
from tests.properties import examples
from tests.world import CAN_ID, PERIOD_S, Client, World, is_command


@examples(100)
@given(any_fields)
def test_fields_in_their_ranges_make_a_configuration_if_they_go_together(fields: Values) -> None:
    if go_together(fields):
        config = MotionConfig().changed(fields, PERIOD_S)
        assert {name: getattr(config, name) for name in fields} == fields
    else:
        with pytest.raises(MotionConfigError):
            MotionConfig().changed(fields, PERIOD_S)


# The controller alone

configs: st.SearchStrategy[Values] = st.just({}) | good_fields
requests = st.tuples(st.integers(0, 1), calls | trajectories, st.booleans())
leaving: st.SearchStrategy[Request] = st.tuples(
    st.integers(0, 1), st.just((LEAVE, {})), st.just(True)
)
measurements = st.fixed_dictionaries(
    {},
    optional={
        "position_rad": st.floats(-1.75, 0.1) | st.floats(-1.75, 0.1) | st.floats(-30.0, 30.0),
        "velocity_rad_s": st.floats(-1.0, 1.0) | st.floats(-50.0, 50.0),
        "torque_nm": st.floats(-3.0, 3.0) | st.floats(-20.0, 20.0),
        "coil_temperature_c": st.sampled_from([25, 79, 85, 130, 255]),
    },
)
courses = st.builds(
    Course,
    is_ready=st.booleans(),
    requests=st.lists(requests, max_size=2).map(tuple) | st.tuples(requests) | st.tuples(leaving),
    late_s=st.sampled_from([0.0] * 12 + [-PERIOD_S, 0.03, 0.3, 1.2]),
    ticks=st.sampled_from([1, 2, 10, 60, 150]),
    phase=st.sampled_from([None] * 40 + list(MotorPhase)),
    follows=st.sampled_from([0.0, 0.02, 0.3, 1.0]),
    measured=st.just({}) | measurements,
    is_silent=st.sampled_from([False] * 6 + [True]),
    zero=st.sampled_from([None] * 20 + [ZeroView("done", 0.5, 0.0), ZeroView("failed")]),
)
spans = st.just(DM4310.ranges) | st.builds(Ranges, *[st.floats(0.125, 1000.0, width=32)] * 3)


QUIET = Course(False, (), 0.0, 1, None, 0.0, {}, False, None)


def asks(method: str, ticks: int = 1, **params: Any) -> Course:
    return replace(QUIET, requests=((0, (method, params), True),), ticks=ticks)


def measures(ticks: int = 1, **measured: Any) -> Course:
    return replace(QUIET, measured=measured, ticks=ticks)


@examples(80)
@given(
    configs,
    st.sampled_from([NORMAL, REVERSE, None]) | odd_contents,
    spans,
    st.lists(courses, min_size=5, max_size=30),
)
@example({}, NORMAL, DM4310.ranges, [asks("motion.hold"), measures(600, position_rad=-1.2)])
@example(
    {},
    NORMAL,
    DM4310.ranges,
    [asks("motion.set_force", force_n=40.0, ticks=100), asks("stop", ticks=100)],
)
@example(
    {},
    NORMAL,
    DM4310.ranges,
    [
        asks("calibration.zero"),
        measures(velocity_rad_s=2.0, torque_nm=-2.0),
        measures(velocity_rad_s=-2.0, torque_nm=2.0),
        measures(400, velocity_rad_s=2.0, torque_nm=0.0),
    ],
)
def test_no_request_and_no_measurement_lead_beyond_the_limits(
    fields: Values, content: Values | None, ranges: Ranges, happening: list[Course]
) -> None:
    bench = Bench(fields, content, ranges)
    for course in happening:
        bench.run(course)


# The whole daemon, by its frames

which = st.integers(0, 1)
some_ticks = st.sampled_from([0, 1, 2, 20, 60])
many_ticks = st.sampled_from([0, 20, 200])
FOREIGN = ((6.0, 20.0, 7.0), (100.0, 100.0, 50.0))
"""What the registers PMAX, VMAX and TMAX of another motor may hold."""


class AnyMotion(RuleBasedStateMachine):
    """Two clients, a gripper with things and hands at it, and a bus that loses and forges."""

    @initialize(
        mount=st.sampled_from(MOUNTS),
        fields=configs,
        content=st.sampled_from(["the mount's", "the mount's", None]) | odd_contents,
        ranges=st.sampled_from([None, None, *FOREIGN]),
    )
    def begin(
        self, mount: str, fields: Values, content: Any, ranges: tuple[float, ...] | None
    ) -> None:
        config = MotionConfig().changed(fields, PERIOD_S)
        self.world = World(mount, calibrated=content == "the mount's", config=config)
        if isinstance(content, dict):
            with suppress(CalibrationError):
                self.world.controller.use_calibration(read_content(content))
        for number, value in zip((21, 22, 23), ranges or (), strict=False):
            assert self.world.gripper.motor.registers.write(number, struct.pack("<f", value))
        self.clients = [self.world.client(), self.world.client()]
        self.watch = LimitWatch(self.world.controller)
        self.lossy_ticks = 0
        self.world.start()
        assert self.clients[0].result("motor.enable")["ok"]
        self.world.sent.clear()

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    def tick(self) -> None:
        world, controller = self.world, self.world.controller
        self.lossy_ticks = max(self.lossy_ticks - 1, 0)
        if not self.lossy_ticks:
            world.lose_to_motor = world.lose_from_motor = lambda _frame: False
        running, latched = controller.jobs.running, controller.stop_latch.latched
        action = controller.action
        self.watch.begin()
        world.tick()
        own = [s.frame for s in world.sent if s.frame.can_id == CAN_ID]
        world.sent.clear()
        if codec.ENABLE in [frame.data for frame in own]:
            assert running is not None
            assert (running.kind, latched) == ("enable", None)
        assert len(own) == 1 or world.phase is not MotorPhase.ENABLED
        self.check(own, is_motion=action is not None and controller.action is action)
        for client in self.clients:
            self.read(client)

    def check(self, own: list[CanFrame], *, is_motion: bool) -> None:
        world, motor = self.world, self.world.controller.motor
        commands = [codec.decode_command(f.data, world.ranges) for f in own if is_command(f)]
        if world.machine.motor._plausibility.in_a_row and commands:
            assert commands[-1].kp_nm_rad == 0.0  # it only brakes, no harder than its command did
            assert abs(commands[-1].torque_nm) <= 1.01 * world.ranges.torque_nm / 4095
            self.watch.note()
            return
        if motor.phase is MotorPhase.ENABLED and commands:
            self.watch.check(
                world.now_s,
                commands[-1],
                motor.feedback,
                world.ranges,
                is_motion=is_motion,
                in_codes=True,
                is_unanswered=world.machine.motor._silence.unanswered > 1,
            )
            return
        least_nm = 1.01 * world.ranges.torque_nm / 4095
        for command in commands:
            assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0
            assert abs(command.torque_nm) <= least_nm
        self.watch.check(world.now_s, None, None, world.ranges, is_motion=False)

    def read(self, client: Client) -> None:
        """Nothing that a client gets reports a defect."""
        client.read()
        for answer in client.answers.values():
            assert answer.get("error", {}).get("data", {}).get("reason") != "internal_error"
        client.answers.clear()
        client.notifications.clear()

    @rule(number=which, call=calls, count=some_ticks)
    def ask(self, number: int, call: tuple[str, Values], count: int) -> None:
        method, params = call
        running = self.world.controller.jobs.running
        if method == "job.cancel" and running is not None:
            params = {"job": running.number}
        self.clients[number].send(method, **params)
        self.ticks(count)

    @rule(number=which, call=motions, count=some_ticks)
    def move(self, number: int, call: tuple[str, Values], count: int) -> None:
        self.clients[number].send("stop.clear")
        self.clients[number].send("motor.enable")
        self.ticks(12)
        self.clients[number].send(call[0], **call[1])
        self.ticks(count)

    @rule(number=which)
    def leave(self, number: int) -> None:
        self.clients[number].leave()
        self.clients[number] = self.world.client()

    @rule(count=st.sampled_from([1, 5, 20, 100, 200]))
    def let_pass(self, count: int) -> None:
        self.ticks(count)

    @rule(count=st.sampled_from([1, 2, 3, 5, 12, 60]), to_motor=st.booleans())
    def lose_frames(self, count: int, to_motor: bool) -> None:
        self.lossy_ticks = count + 1
        if to_motor:
            self.world.lose_to_motor = lambda _frame: True
        else:
            self.world.lose_from_motor = lambda _frame: True
        self.ticks(count)

    @rule(
        status=st.sampled_from([1, 1, 1, 1, 0, 8, 13]),
        rest=st.binary(min_size=7, max_size=7),
        count=st.integers(1, 5),
    )
    def forge_feedback(self, status: int, rest: bytes, count: int) -> None:
        for _ in range(count):
            self.world.inject(CanFrame(0x18, bytes([status << 4 | CAN_ID]) + rest))
            self.tick()

    @rule(torque_nm=st.sampled_from([0.0, 0.0, 0.5, -0.5, 3.0, -3.0, 9.0, -9.0]), count=many_ticks)
    def push(self, torque_nm: float, count: int) -> None:
        self.world.gripper.push(torque_nm)
        self.ticks(count)

    @rule(
        share=st.floats(0.3, 1.0),
        stiffness=st.sampled_from([20.0, 250.0, 5000.0]),
        yield_mm_s=st.sampled_from([0.0, 3.0, 30.0]),
    )
    def put_object(self, share: float, stiffness: float, yield_mm_s: float) -> None:
        gripper = self.world.gripper
        if gripper.opening_mm > 1.0:
            gripper.put_object(
                width_mm=share * gripper.opening_mm,
                stiffness_nm_rad=stiffness,
                yield_mm_s=yield_mm_s,
            )

    @rule()
    def remove_object(self) -> None:
        self.world.gripper.remove_object()

    @rule(volts=st.sampled_from([24.0, 24.0, 24.0, 40.0, 5.0]))
    def set_supply(self, volts: float) -> None:
        self.world.gripper.set_supply(volts)

    @rule(turns=st.sampled_from([0, 0, 1, -1]))
    def power_cycle(self, turns: int) -> None:
        self.world.gripper.power_cycle(turns=turns)

    @rule(error=st.sampled_from([None, None, "no space left on the device"]))
    def spoil_the_disk(self, error: str | None) -> None:
        self.world.disk.error = error


TestAnyMotion = AnyMotion.TestCase
TestAnyMotion.settings = examples(50, stateful_step_count=30)


def test_a_forged_frame_of_great_speed_leads_to_no_great_torque() -> None:
    """It may be believed once; then the true ones cannot be true, and the jaws are braked."""
    course = AnyMotion()
    content = {
        "rad_to_mm": 1e6,
        "max_position_rad": -0.28412607015649183,
        "mst_id": 0,
        "zero_position_rad": -1e-05,
    }
    course.begin("normal", {"press_overshoot": 0.2, "force_n": 30.0}, content, None)
    course.lose_frames(2, to_motor=True)
    course.push(0.5, 200)
    course.push(-9.0, 0)
    course.put_object(1 / 3, 5000.0, 30.0)
    course.forge_feedback(1, b"\x08\xd9\xe3\xea\xdb\x0f\x02", 4)
    course.ticks(100)
