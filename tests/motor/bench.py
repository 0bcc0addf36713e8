"""One Motor and a simulated gripper on a virtual bus in virtual time, without an controller."""

import struct
from collections.abc import Callable

from litegripd.model.motor import (
    CanFrame,
    EnableMotor,
    Feedback,
    MitCommand,
    MotorInput,
    MotorPhase,
    MotorRequest,
    MotorView,
    RegisterReply,
    RegisterRequest,
    SetZero,
    ZeroView,
)
from litegripd.motor import codec
from litegripd.motor.motor import Motor
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters

CAN_ID = 0x08
MASTER_ID = 0x18
REGISTER_ID = 0x7FF
PERIOD_S = 0.005
FRAME_TIME_S = 130e-6

Loses = Callable[[CanFrame], bool]


def nothing(_frame: CanFrame) -> bool:
    return False


def everything(_frame: CanFrame) -> bool:
    return True


class LosesFirst:
    """Loses the first frames that fit."""

    def __init__(self, count: int, fits: Loses) -> None:
        self.left, self._fits = count, fits

    def __call__(self, frame: CanFrame) -> bool:
        if self.left == 0 or not self._fits(frame):
            return False
        self.left -= 1
        return True


def is_zero(frame: CanFrame) -> bool:
    return frame == CanFrame(CAN_ID, codec.SET_ZERO)


def is_read(frame: CanFrame) -> bool:
    return frame.can_id == REGISTER_ID and frame.data[2] == 0x33


def is_answer(frame: CanFrame) -> bool:
    return frame.can_id == MASTER_ID and frame.data[:3] == bytes([CAN_ID, 0, 0x33])


class Bench:
    """While the motor is enabled, `tick` commands it to damp only."""

    def __init__(
        self, parameters: SimulatorParameters | None = None, seed: int | None = None
    ) -> None:
        self.now_s = 1000.0
        self.gripper = SimulatedGripper(parameters, seed=seed)
        self.motor = Motor(CAN_ID)
        self.register: RegisterRequest | None = None
        self.sent: list[tuple[float, CanFrame]] = []
        self.lose_to_motor: Loses = nothing
        self.lose_from_motor: Loses = nothing
        self._in_flight: list[CanFrame] = []

    @property
    def view(self) -> MotorView:
        """What the motor was known to be in the latest tick."""
        return self.motor.view()

    @property
    def feedback(self) -> Feedback:
        """The latest feedback, which a scene expects to be there."""
        feedback = self.view.feedback
        assert feedback is not None
        return feedback

    def tick(self, request: MotorRequest | None = None) -> list[CanFrame]:
        """Let one period pass; return what was sent in it."""
        self.receive()
        return self.step(request)

    def receive(self) -> MotorView:
        """Let the motor take what has come; return what is known then."""
        self.now_s += PERIOD_S
        self.gripper.advance(self.now_s)
        received, self._in_flight = self._in_flight, []
        self.motor.receive(self.now_s, received)
        return self.view

    def step(self, request: MotorRequest | None = None) -> list[CanFrame]:
        """Let the motor send what is wanted in this period."""
        wanted = MotorInput(self._damping(), request, register=self.register)
        frames = self.motor.step(self.now_s, wanted)
        for frame in frames:
            self.sent.append((self.now_s, frame))
            if not self.lose_to_motor(frame):
                answers = self.gripper.receive(self.now_s + FRAME_TIME_S, frame)
                self._in_flight += [f for f in answers if not self.lose_from_motor(f)]
        return frames

    def inject(self, *frames: CanFrame) -> None:
        """Let frames arrive, in the next tick and before the motor's, that it did not send."""
        self._in_flight[:0] = frames

    def lose_in_flight(self) -> None:
        """Lose the answers that have not come yet."""
        self._in_flight.clear()

    def run(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / PERIOD_S)):
            self.tick()

    def run_until(self, condition: Callable[[], bool], within_s: float = 2.0) -> None:
        """Let time pass until a condition holds; fail when it does not within a while."""
        ends_s = self.now_s + within_s
        while not condition():
            assert self.now_s < ends_s, f"did not happen within {within_s} s"
            self.tick()

    def started(self) -> "Bench":
        """Find the motor."""
        self.run_until(lambda: self.view.phase is MotorPhase.DISABLED)
        self.run(0.1)
        return self

    def enabled(self) -> "Bench":
        """Find the motor and enable it."""
        self.started().tick(EnableMotor(3, 0.2))
        self.run_until(lambda: self.view.phase is MotorPhase.ENABLED)
        return self

    def faulty(self) -> "Bench":
        """Find the motor and let it have a fault."""
        self.started().gripper.set_supply(40.0)
        self.run_until(lambda: self.view.phase is MotorPhase.FAULT)
        return self

    def read(self, request: RegisterRequest, within_s: float = 2.0) -> RegisterReply:
        """Ask for a register until there is a reply; return it."""
        self.register = request
        self.run_until(lambda: self._reply_to(request) is not None, within_s)
        self.register = None
        reply = self._reply_to(request)
        assert reply is not None
        return reply

    def times_of(self, fits: Loses, since_s: float = 0.0) -> list[float]:
        """Return when frames that fit were sent."""
        return [at_s for at_s, frame in self.sent if at_s >= since_s and fits(frame)]

    def _reply_to(self, request: RegisterRequest) -> RegisterReply | None:
        reply = self.view.register
        return reply if reply is not None and reply.identity == request.identity else None

    def _damping(self) -> MitCommand | None:
        view = self.view
        if view.phase is not MotorPhase.ENABLED or view.feedback is None:
            return None
        return MitCommand(view.feedback.position_rad, 0.0, 0.0, 1.0, 0.0)


def feedback_frame(position_rad: float, status: int = 0, motor: int = CAN_ID) -> CanFrame:
    code = round((position_rad + 12.5) * 65535 / 25.0)
    head = struct.pack(">BH", status << 4 | motor, code)
    return CanFrame(MASTER_ID, head + bytes.fromhex("7FF8002020"))


def ended(bench: Bench, within_s: float = 1.0) -> ZeroView:
    """Let time pass until the setting has ended; return how."""
    bench.run_until(lambda: bench.view.zero.state in ("done", "failed"), within_s)
    return bench.view.zero


def set_zero(bench: Bench) -> ZeroView:
    bench.tick(SetZero())
    return ended(bench)


def reason(zero: ZeroView) -> str:
    assert zero.state == "failed"
    assert zero.failure is not None
    return zero.failure.reason


def bench_in(phase: MotorPhase) -> Bench:
    if phase is MotorPhase.ENABLED:
        return Bench().enabled()
    return Bench().faulty() if phase is MotorPhase.FAULT else Bench().started()
