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
from litegripd.control.controller import Controller
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Mount
from litegripd.model.helper_tasks import TaskResult
from litegripd.model.jobs import Job, Owner
from litegripd.model.motion_config import MotionConfig

OnSaved: TypeAlias = Callable[[TaskResult], None]


class Calibrating:
    """Begins calibrations on one controller, and takes care of what is in use."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller

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
        controller = self._controller
        refusal = self._unready()
        if refusal is not None:
            return refusal
        before = controller.calibrated.calibration
        geometry = controller.geometry
        if mount is None and geometry is None:
            return controller.calibrated.problem
        if mount is not None:
            close_sign = 1 if mount == "normal" else -1
        else:
            close_sign = 1 if geometry is None else geometry.close_sign
        saving = Saving(before, controller.gripper_id, controller.gains, keep=keep)
        return controller.begin("zero", Calibrate(close_sign, config, saving), owner, detached)

    def by_hand(self, owner: Owner, config: MotionConfig) -> Job | Refusal:
        """Begin a calibration by hand: the jaws go slack."""
        refusal = self._unready()
        if refusal is not None:
            return refusal
        return self._controller.begin("calibrate_by_hand", CalibrateByHand(config), owner, False)

    def mark(self, side: Side, owner: Owner) -> dict[Side, float] | Refusal:
        """Take the present position as a stop; return all marks so far, in rad."""
        action = self._by_hand_of(owner)
        if isinstance(action, Refusal):
            return action
        return action.mark(side) or dict(action.marks)

    def finish(self, owner: Owner, *, keep: bool) -> Job | Refusal:
        """Make the marks the calibration; the job ends when it is in use."""
        controller = self._controller
        action, running = self._by_hand_of(owner), controller.jobs.running
        if isinstance(action, Refusal):
            return action
        saving = Saving(
            controller.calibrated.calibration, controller.gripper_id, controller.gains, keep=keep
        )
        return action.finish(saving) or running or _NOT_BY_HAND

    def give_up(self, owner: Owner) -> Refusal | None:
        """End a calibration by hand without a result; the jaws hold where they are."""
        action = self._by_hand_of(owner)
        if isinstance(action, Refusal):
            return action
        self._controller.end(Refusal("cancelled", "the calibration by hand was given up"))
        return None

    def set_zero(self, owner: Owner, detached: bool) -> Job | Refusal:
        """Begin to make the present position the motor's zero."""
        controller = self._controller
        refusal = controller.why_busy() or (None if controller.motor.feedback else NO_FEEDBACK)
        if refusal is not None:
            return refusal
        return controller.begin("set_zero", SetZero(), owner, detached)

    def refusal_to_load(self) -> Refusal | None:
        """Return why no other calibration may be taken now, or None."""
        return busy_refusal(self._controller.jobs.running)

    def load(self, calibration: Calibration, file: str | None) -> Refusal | None:
        """Take another calibration."""
        refusal = self.refusal_to_load()
        if refusal is None:
            self._controller.use_calibration(calibration, file=file)
        return refusal

    def save(self, on_saved: OnSaved, uid: int | None = None) -> Refusal | None:
        """Have the calibration in use written to the daemon's own file."""
        controller = self._controller
        calibration = controller.calibrated.calibration
        if calibration is None or not calibration.calibrated:
            return controller.calibrated.problem
        content = content_of(calibration, controller.gripper_id, controller.gains, controller.motor)

        def saved(result: TaskResult) -> None:
            if result.error is None and isinstance(result.value, dict):
                stored = result.value
                controller.calibrated.note_saved(
                    calibration, controller.gripper_id.channel, stored["path"], stored["saved_s"]
                )
            on_saved(result)

        controller.tasks.append(
            replace(save_errand(controller.gripper_id, content, saved), uid=uid)
        )
        return None

    def _unready(self) -> Refusal | None:
        controller = self._controller
        return controller.why_busy() or motor_refusal(controller.motor)

    def _by_hand_of(self, owner: Owner) -> CalibrateByHand | Refusal:
        running, action = self._controller.jobs.running, self._controller.action
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
