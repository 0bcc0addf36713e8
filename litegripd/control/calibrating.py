"""What clients may ask about the calibration: to measure it, to load one, to keep it.

Never while a motion runs: under the running motion the travel would change its meaning.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import TypeAlias

from litegripd.control.actions.by_hand import CalibrateByHand, SetZero, Side
from litegripd.control.actions.zero import Calibrate
from litegripd.control.admission import NO_FEEDBACK, busy_refusal, busy_with, motor_refusal
from litegripd.control.calibration import Saving, content_of, save_errand
from litegripd.control.engine import Engine
from litegripd.model.calibration import Calibration
from litegripd.model.errands import ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Mount
from litegripd.model.jobs import Job, Owner
from litegripd.model.motion_config import MotionConfig

OnSaved: TypeAlias = Callable[[ErrandResult], None]


class Calibrating:
    """Begins calibrations on one engine, and takes care of what is in use."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine

    def zero(
        self,
        owner: Owner,
        config: MotionConfig,
        *,
        mount: Mount | None,
        keep: bool,
        detached: bool,
    ) -> Job | Refusal:
        """Begin to probe both stops; `mount` declares the direction, else the calibration does."""
        engine = self._engine
        refusal = self._unready()
        if refusal is not None:
            return refusal
        before = engine.calibrated.calibration
        geometry = engine.geometry
        if mount is None and geometry is None:
            return engine.calibrated.problem
        if mount is not None:
            close_sign = 1 if mount == "normal" else -1
        else:
            close_sign = 1 if geometry is None else geometry.close_sign
        saving = Saving(before, engine.unit, engine.gains, keep=keep)
        return engine.begin("zero", Calibrate(close_sign, config, saving), owner, detached)

    def by_hand(self, owner: Owner, config: MotionConfig) -> Job | Refusal:
        """Begin a calibration by hand: the jaws go slack."""
        refusal = self._unready()
        if refusal is not None:
            return refusal
        return self._engine.begin("calibrate_by_hand", CalibrateByHand(config), owner, False)

    def mark(self, side: Side, owner: Owner) -> dict[Side, float] | Refusal:
        """Take the present position as a stop; return all marks so far, in rad."""
        action = self._by_hand_of(owner)
        if isinstance(action, Refusal):
            return action
        return action.mark(side) or dict(action.marks)

    def finish(self, owner: Owner, *, keep: bool) -> Job | Refusal:
        """Make the marks the calibration; the job ends when it is in use."""
        engine = self._engine
        action, running = self._by_hand_of(owner), engine.jobs.running
        if isinstance(action, Refusal):
            return action
        saving = Saving(engine.calibrated.calibration, engine.unit, engine.gains, keep=keep)
        return action.finish(saving) or running or _NOT_BY_HAND

    def give_up(self, owner: Owner) -> Refusal | None:
        """End a calibration by hand without a result; the jaws hold where they are."""
        action = self._by_hand_of(owner)
        if isinstance(action, Refusal):
            return action
        self._engine.end(Refusal("cancelled", "the calibration by hand was given up"))
        return None

    def set_zero(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to make the present position the motor's zero."""
        engine = self._engine
        refusal = engine.why_busy() or (None if engine.motor.feedback else NO_FEEDBACK)
        if refusal is not None:
            return refusal
        return engine.begin("set_zero", SetZero(), owner, detached)

    def refusal_to_load(self) -> Refusal | None:
        """Say why no other calibration may be taken now, if so."""
        return busy_refusal(self._engine.jobs.running)

    def load(self, calibration: Calibration, file: str | None) -> Refusal | None:
        """Take another calibration."""
        refusal = self.refusal_to_load()
        if refusal is None:
            self._engine.use_calibration(calibration, file=file)
        return refusal

    def save(self, on_saved: OnSaved, uid: int | None = None) -> Refusal | None:
        """Have the calibration in use written to the daemon's own file."""
        engine = self._engine
        calibration = engine.calibrated.calibration
        if calibration is None or not calibration.calibrated:
            return engine.calibrated.problem
        content = content_of(calibration, engine.unit, engine.gains, engine.motor)

        def saved(result: ErrandResult) -> None:
            if result.error is None and isinstance(result.value, dict):
                stored = result.value
                engine.calibrated.note_saved(
                    calibration, engine.unit.channel, stored["path"], stored["saved_s"]
                )
            on_saved(result)

        engine.errands.append(replace(save_errand(engine.unit, content, saved), uid=uid))
        return None

    def _unready(self) -> Refusal | None:
        engine = self._engine
        return engine.why_busy() or motor_refusal(engine.motor)

    def _by_hand_of(self, owner: Owner) -> CalibrateByHand | Refusal:
        running, action = self._engine.jobs.running, self._engine.action
        if not isinstance(action, CalibrateByHand) or running is None:
            return _NOT_BY_HAND
        if running.owner.client != owner.client:
            return busy_with(running)
        return action


_NOT_BY_HAND = Refusal(
    "not_calibrated",
    "no calibration by hand is under way: begin one (calibration.manual)",
    {"hint": "calibration.manual"},
)
