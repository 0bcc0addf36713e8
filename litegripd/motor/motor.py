"""One motor: takes frames, keeps its phase, and gives the frames to send in each tick.

Pure: time is an argument, frames are values. What the engine wants comes in as a `MotorOrder`;
what is known goes out as a `MotorView`. Nothing in here decides to energise the motor.
"""

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import (
    DisableMotor,
    EnableMotor,
    MitCommand,
    MotorOrder,
    MotorPhase,
    MotorRequest,
    MotorView,
    SetZero,
    Status,
    ZeroView,
)
from litegripd.motor import codec
from litegripd.motor.arming import Arming
from litegripd.motor.faults import SILENT, STILL_ENABLED, fault_refusal
from litegripd.motor.identification import STILL_READ
from litegripd.motor.listening import Listener
from litegripd.motor.phases import ARMING_PHASES, FAULTY, PUBLIC, Event, Phase
from litegripd.motor.reading import READABLE
from litegripd.motor.registers import PMAX, VERIFIED
from litegripd.motor.silence import DISABLE_GIVES_UP_S, USUAL_PERIOD_S
from litegripd.motor.unfaulting import Unfaulting
from litegripd.motor.zeroing import NOT_DISABLED, UNDER_WAY, Zeroing


class Motor(Listener):
    """The motor `can_id`; its answers are found by register MST_ID, or must come on `master_id`."""

    def __init__(
        self, can_id: int, master_id: int | None = None, period_s: float = USUAL_PERIOD_S
    ) -> None:
        super().__init__(can_id, master_id, period_s)
        self._unfaulting: Unfaulting | None = None
        self._tries = 0
        self._failure: Refusal | None = None

    def view(self) -> MotorView:
        """Return what is known now."""
        return MotorView(
            phase=self._public_phase(),
            feedback=self._feedback if self._identification.usable_ranges else None,
            identity=self._identification.identity,
            enable_tries=self._tries,
            problem=self._problem(),
            failure=self._failure,
            fault=self._fault(),
            register=self._reading.reply,
            zero=self._zeroing.view,
            foreign_commands=self.counters.foreign_commands,
            foreign_write=self._foreign_write,
        )

    @property
    def phase(self) -> Phase:
        """The phase, finer than that of the view."""
        return self._phase

    @property
    def says_enabled(self) -> bool:
        """Whether its latest status was that it is enabled; that needs no ranges to be known."""
        return self._feedback is not None and self._feedback.status == Status.ENABLED

    @property
    def unanswered(self) -> int:
        """How many requests have gone out since the last answer."""
        return self._silence.unanswered

    @property
    def is_verifying(self) -> bool:
        """Whether registers are being read again."""
        return self._identification.verifier.is_open

    def step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        """Do what the engine wants and return the frames to send, in their order."""
        if order.request is not None:
            self._begin(order.request, now_s)
        frames = self._step(now_s, order)
        if frames:
            self._asked_s = now_s
        read = self._reading.step(now_s, order.register, self._phase)
        return frames + (read or self._verify(now_s))

    def _verify(self, now_s: float) -> list[CanFrame]:
        """Read again what decides how the motor is talked to; one frame beside a command."""
        known, is_enabled = self._identification, self._phase is Phase.ENABLED
        if known.identity is None or self._phase not in READABLE:
            return []
        most = 1 if is_enabled else len(VERIFIED)
        return known.verifier.step(now_s, known.identity, most, sets_watchdog=is_enabled)

    def _begin(self, request: MotorRequest, now_s: float) -> None:
        if isinstance(request, EnableMotor):
            self._begin_enable(request, now_s)
        elif isinstance(request, DisableMotor):
            self._failure = None
            self._go(Event.DISABLE, now_s)
        elif isinstance(request, SetZero):
            self._begin_zero(now_s)
        else:
            self._begin_clear(now_s)

    def _step(self, now_s: float, order: MotorOrder) -> list[CanFrame]:
        if self._phase is Phase.ENABLED and order.command is not None:
            return self._command(order.command, order.is_motion)
        if self._phase in ARMING_PHASES:
            return self._arm(now_s)
        if self._phase is Phase.UNFAULTING:
            return self._unfault(now_s)
        if self._phase is Phase.DISABLING:
            return self._disable(now_s)
        if self._phase is Phase.LOST:
            return self._traffic.probe(now_s)
        if self._zeroing.is_pending:
            return self._zeroing.step(now_s)
        if self._phase is Phase.LOOKING:
            return self._traffic.poll(now_s) + self._look_again(now_s)
        return self._unstore() + self._traffic.poll(now_s)

    def _public_phase(self) -> MotorPhase:
        is_silent = self._silence.is_total(self._phase)
        return MotorPhase.SILENT if is_silent else PUBLIC[self._phase]

    def _problem(self) -> Refusal | None:
        """Say why the motor could not be enabled now."""
        if self._public_phase() is MotorPhase.SILENT:
            return SILENT
        reading = STILL_READ if self._phase is Phase.LOOKING else None
        if self._identification.verifier.doubts_ranges:
            reading = STILL_READ
        return self._plausibility.refusal or reading or self._identification.problem()

    def _fault(self) -> Refusal | None:
        feedback = self._feedback if self._phase in FAULTY else None
        return None if feedback is None else fault_refusal(feedback, self._stood_still_s)

    def _begin_enable(self, request: EnableMotor, now_s: float) -> None:
        self._failure = UNDER_WAY if self._zeroing.is_pending else self._problem()
        self._tries = 0
        is_off = self._phase in (Phase.DISABLED, Phase.FAULT)
        if self._failure is not None or not is_off:
            return
        self._identification.verifier.begin()
        self._arming = Arming(self._identification, request, now_s)
        self._go(Event.ENABLE, now_s)

    def _begin_zero(self, now_s: float) -> None:
        if self._zeroing.is_pending:
            return
        is_disabled = self._phase is Phase.DISABLED
        refusal = self._problem() or self._fault() or (None if is_disabled else NOT_DISABLED)
        view = ZeroView("pending" if refusal is None else "failed", failure=refusal)
        self._zeroing = Zeroing(self._can_id, self._identification.ranges, now_s, view)

    def _begin_clear(self, now_s: float) -> None:
        """Accept the position as it is, and clear what the motor has latched, if anything.

        A motor that cannot be used is looked at anew: somebody may have set its registers.
        """
        self._failure = None
        self._plausibility.reset()
        if self._identification.problem() is not None:
            self._go(Event.LOOK, now_s)
        self._unfaulting = Unfaulting(self._can_id, now_s)
        self._go(Event.CLEAR, now_s)

    def _unfault(self, now_s: float) -> list[CanFrame]:
        if self._unfaulting is None or self._unfaulting.has_failed(now_s):
            self._failure = self._fault()
            self._go(Event.STAYED, now_s)
            return []
        return self._unfaulting.step(now_s)

    def _command(self, command: MitCommand, is_motion: bool) -> list[CanFrame]:
        """Give the command; while the position is in doubt, of a stiff one only its damping.

        A force alone goes on, or what it holds would fall for a disturbed frame.
        """
        has_no_scale = self._identification.verifier.is_in_doubt(PMAX)
        if (self._plausibility.in_a_row or has_no_scale) and command.kp_nm_rad:
            damping = min(command.kd_nm_s_rad, self._plausibility.brake_kd_nm_s_rad)
            command = MitCommand(command.position_rad, 0.0, 0.0, damping, 0.0)
            self._traffic.forget_command()
        return self._traffic.command(command, is_motion, self._identification.ranges_to_send)

    def _arm(self, now_s: float) -> list[CanFrame]:
        arming = self._arming
        if arming is None:
            return []
        if self._phase is Phase.PREPARING and arming.is_prepared:
            self._go(Event.PREPARED, now_s)
        if self._phase is not Phase.PREPARING:
            self._silence.unanswered += 1
        is_silent = self._silence.unanswered > self._silence.repeats
        if not is_silent and not self._silence.may_repeat:
            return []
        frames = arming.step(now_s, self._phase, self._feedback, is_silent=is_silent)
        self._tries = arming.tries
        if arming.failure is not None:
            self._failure = arming.failure
            self._go(Event.GAVE_UP, now_s)
            return self._disable(now_s)
        return frames

    def _disable(self, now_s: float) -> list[CanFrame]:
        if self._failure is None and now_s - self._entered_s >= DISABLE_GIVES_UP_S:
            self._failure = STILL_ENABLED
        return [*self._unstore(), CanFrame(self._can_id, codec.DISABLE)]

    def _unstore(self) -> list[CanFrame]:
        feedback = self._feedback
        if not self._traffic.is_stored or feedback is None:
            return []
        if self._identification.problem() is not None:
            return []
        return self._traffic.unstore(feedback.position_rad, self._identification.ranges)

    def _look_again(self, now_s: float) -> list[CanFrame]:
        """Read registers; a motor that is found enabled is disabled at once, whoever enabled it."""
        frames = self._identification.step(now_s)
        if self._identification.identity is None:
            self._note_identity()
        if self._feedback is not None and self._feedback.status == Status.ENABLED:
            frames.append(CanFrame(self._can_id, codec.DISABLE))
        return frames
