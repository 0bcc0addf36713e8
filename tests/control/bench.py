"""A controller and its RPC service without a motor: all reports of one are made up.

In every period it gets what clients may ask and what a motor may report, and is watched.
"""

import json
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, TypeAlias

from litegripd.app.build import build_service
from litegripd.control.controller import Controller
from litegripd.model.calibration import CalibrationError, read_content
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import (
    DisableMotor,
    EnableMotor,
    Feedback,
    MotorIdentity,
    MotorInput,
    MotorPhase,
    MotorView,
    Ranges,
    SetZero,
    ZeroView,
)
from litegripd.model.state import HelperTask, TaskResult
from litegripd.motor import codec
from litegripd.rpc.sessions import Peer, Session
from tests.control.limits import LimitWatch
from tests.world import PERIOD_S, Disk, FixedFacts

Request: TypeAlias = tuple[int, tuple[str, dict[str, Any]], bool]
"""Which client, the method and its parameters, and whether it has an id where it need not."""

LEAVE = "leave"


@dataclass(frozen=True, slots=True)
class Course:
    """What happens in a few ticks.

    `is_ready` clears a stop and enables the motor first. The jaws go `follows` of the way to what
    is commanded in each tick, 0 to 1, unless they jump to `measured`; a `silent` motor reports
    nothing new.
    """

    is_ready: bool
    requests: tuple[Request, ...]
    late_s: float
    ticks: int
    phase: MotorPhase | None
    follows: float
    measured: dict[str, Any]
    is_silent: bool
    zero: ZeroView | None


class Bench:
    """One controller with two clients."""

    def __init__(self, fields: dict[str, Any], content: dict[str, Any] | None, spans: Ranges):
        self.controller = Controller(MotionConfig().changed(fields, PERIOD_S), PERIOD_S)
        self._service = build_service(self.controller, FixedFacts(), PERIOD_S)
        self._watch = LimitWatch(self.controller)
        self._disk = Disk()
        self._finished: list[tuple[HelperTask, TaskResult]] = []
        self._now_s = 1000.0
        self._phase = MotorPhase.ENABLED
        self._zero = ZeroView()
        self._spans = spans
        self._feedback = Feedback(1, 0.0, 0.0, 0.0, 30, 30, self._now_s)
        self._measure(position_rad=-0.5)
        self._sessions = [self._connect(), self._connect()]
        if content is not None:
            with suppress(CalibrationError):
                self.controller.use_calibration(read_content(content))
        self._tick()

    def run(self, course: Course) -> None:
        """Let a few ticks pass."""
        if course.is_ready:
            self._ask(0, "stop.clear", {})
            self._phase = MotorPhase.ENABLED
            self._tick()
        for number, (method, params), has_id in course.requests:
            self._ask(number, method, params, has_id=has_id)
        self._now_s += course.late_s
        self._phase = course.phase or self._phase
        self._zero = course.zero or self._zero
        if not course.is_silent:
            self._measure(**course.measured)
        for _ in range(course.ticks):
            self._now_s += PERIOD_S
            if not course.is_silent:
                self._follow(course.follows)
            self._tick()

    def _connect(self) -> Session:
        return self._service.opened(Peer(7, 1000, 1000, "program"), self._now_s)

    def _measure(self, **changes: Any) -> None:
        """Measure as a frame in these ranges can report it."""
        spans, wanted = self._spans, replace(self._feedback, at_s=self._now_s, **changes)
        self._feedback = replace(
            wanted,
            position_rad=_within(wanted.position_rad, spans.position_rad),
            velocity_rad_s=_within(wanted.velocity_rad_s, spans.velocity_rad_s),
            torque_nm=_within(wanted.torque_nm, spans.torque_nm),
        )

    def _follow(self, share: float) -> None:
        command, here_rad = self.controller.output.command, self._feedback.position_rad
        if command is None or share == 0.0:
            self._measure()
            return
        there_rad = here_rad + share * (command.position_rad - here_rad)
        self._measure(position_rad=there_rad, velocity_rad_s=(there_rad - here_rad) / PERIOD_S)

    def _ask(
        self, number: int, method: str, params: dict[str, Any], *, has_id: bool = True
    ) -> None:
        session = self._sessions[number]
        if method == LEAVE:
            self._service.closed(session, self._now_s)
            self._sessions[number] = self._connect()
            return
        request: dict[str, Any] = {"jsonrpc": "2.0", "method": method, "params": params}
        if has_id or method != "stream.set":
            request["id"] = 1
        self._service.handle(session, json.dumps(request).encode(), self._now_s)
        self._read(session)

    def _read(self, session: Session) -> None:
        """Nothing that a client gets reports a defect."""
        for line in session.outgoing:
            error = json.loads(line).get("error", {})
            assert error.get("data", {}).get("reason") != "internal_error", error
        session.outgoing.clear()

    def _tick(self) -> None:
        controller = self.controller
        identity = MotorIdentity(0x08, 0x18, self._spans, 0.1, 1)
        view = MotorView(self._phase, self._feedback, identity, zero=self._zero)
        running, latched = controller.jobs.running, controller.stop_latch.latched
        self._watch.begin()
        motor_input = controller.step(self._now_s, view)
        if isinstance(motor_input.request, EnableMotor):
            assert running is not None
            assert (running.kind, latched) == ("enable", None)
        if isinstance(motor_input.request, SetZero):
            assert running is not None
            assert running.kind == "set_zero"
        if motor_input.command is not None:
            codec.encode_command(motor_input.command, self._spans)
        self._watch.check(
            self._now_s,
            motor_input.command,
            self._feedback,
            self._spans,
            is_motion=motor_input.is_motion,
        )
        self._obey(motor_input)
        self._service.after_tick(self._now_s)
        for session in self._sessions:
            self._read(session)
        self._run_errands()

    def _obey(self, motor_input: MotorInput) -> None:
        """Follow the motor's input, without the delays of a real motor."""
        if isinstance(motor_input.request, DisableMotor):
            self._phase = MotorPhase.DISABLING
        elif self._phase is MotorPhase.DISABLING:
            self._phase = MotorPhase.DISABLED
        elif isinstance(motor_input.request, EnableMotor) and self._phase is MotorPhase.DISABLED:
            self._phase = MotorPhase.ENABLED
        if isinstance(motor_input.request, SetZero):
            self._zero = ZeroView("pending", is_uncertain=True)
        elif self._zero.state == "pending":
            self._zero = ZeroView("done", 0.5, 0.001)

    def _run_errands(self) -> None:
        tasks, self.controller.tasks = self.controller.tasks, []
        finished, self._finished = self._finished, []
        for task, result in finished:
            task.on_result(result)
        self._finished = [(task, self._disk.do(task)) for task in tasks]


def _within(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)
