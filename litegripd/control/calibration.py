"""The calibration in use, what is doubtful about it, and how a new one is saved."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from litegripd.control.admission import CALIBRATION_COMING, NOT_CALIBRATED, ZERO_MOVED
from litegripd.control.limiter import DEFAULT_GAINS, Gains, gains_of
from litegripd.control.motions.base import Adopted, Step
from litegripd.model.calibration import (
    NOMINAL,
    Calibration,
    CalibrationError,
    ScaleDoubt,
    foreign_warning,
    measured,
    out_of_range,
    plausible_travel_rad,
    scale_doubt,
    scale_warning,
    unfitting,
    work_stroke_warning,
)
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry, GripperId
from litegripd.model.motion_config import MotionConfig, damping_conflict
from litegripd.model.motor import MotorIdentity, MotorView, ZeroView
from litegripd.model.plain import Carried
from litegripd.model.sentence import sentence
from litegripd.model.state import HelperTask, TaskResult, ZeroOutcome, ZeroResult

REPAIR = sentence(
    "repair that file and have it read again ({calibration.load}), or measure again:"
    " {motor.enable}, then {calibration.zero with a mount}"
)
"""What to do about a file of which nothing can be used."""


@dataclass(frozen=True, slots=True)
class Terms:
    """What a motion, and the hold or grip that it leaves, counts on until the next motion.

    Another calibration or configuration must not move jaws that nobody has asked to move: a
    pressed stop would spring back by 1 mm when other limits are loaded under a latched stop.
    """

    geometry: Geometry | None
    """The calibrated travel, None without a calibration."""
    work_opening_mm: float | None
    """The opening to which `open` goes, None for the open stop."""
    gains: Gains
    """The gains of holds and of what follows set-points."""
    config: MotionConfig


class CalibrationInUse:
    """Knows the travel and the gains of the hold; `file` is None for a calibration in no file.

    Gains that a calibration leaves out are those that the same client has loaded before, else the
    daemon's own: one program's gains do not stay for the next one.
    """

    calibration: Carried[Calibration | None] = None
    file: Carried[str | None] = None
    gains: Carried[Gains] = DEFAULT_GAINS
    _own_gains: Carried[Gains] = DEFAULT_GAINS
    _by: Carried[int | None] = None
    problem: Carried[Refusal] = NOT_CALIBRATED
    _zero: Carried[ZeroView] = ZeroView()

    @property
    def valid(self) -> Calibration | None:
        """The calibration; None without one, and for one that is not calibrated (any more)."""
        calibration = self.calibration
        return calibration if calibration and calibration.calibrated else None

    @property
    def geometry(self) -> Geometry | None:
        """The calibrated travel, None while uncalibrated."""
        calibration = self.calibration
        return calibration.geometry if calibration and calibration.calibrated else None

    @property
    def work_opening_mm(self) -> float | None:
        """The opening to which `open` goes, None for the open stop and while uncalibrated."""
        calibration = self.calibration
        return calibration.work_opening_mm if calibration and calibration.calibrated else None

    @property
    def is_coming(self) -> bool:
        """True from the start until a calibration was read, or found missing."""
        return self.calibration is None and self.problem.reason == CALIBRATION_COMING.reason

    def expect(self) -> None:
        """Report that a calibration is being read, until `use`."""
        self.problem = CALIBRATION_COMING

    def use(
        self,
        calibration: Calibration | None,
        problem: Refusal | None,
        file: str | None,
        by: int | None = None,
    ) -> None:
        """Use a calibration and its file, or the reason why there is none.

        `by` is the client that has loaded it, None for the daemon itself.
        """
        self.gains = DEFAULT_GAINS if calibration is None else self._gains_of(calibration, by)
        self.calibration, self.file, self._by = calibration, file, by
        self.problem = problem or NOT_CALIBRATED
        if by is None and calibration is not None:
            self._own_gains = self.gains

    def terms(self, config: MotionConfig) -> Terms:
        """Return what a motion counts on that brings no calibration of its own."""
        return Terms(self.geometry, self.work_opening_mm, self.gains, config)

    def terms_of(
        self,
        given: Calibration,
        by: int,
        config: MotionConfig,
        gripper_id: GripperId,
        identity: MotorIdentity | None,
    ) -> Terms | Refusal:
        """Return what a motion counts on for which the client `by` has given a calibration.

        It is judged as one that is loaded, and nothing of it stays. What it cannot say is this
        gripper's: a measured force per torque.
        """
        refusal = self.why_unfitting(given, None, gripper_id, identity)
        if refusal is not None:
            return refusal
        if self.calibration is not None:
            given = given.with_force_of(self.calibration)
        return Terms(given.geometry, given.work_opening_mm, self._gains_of(given, by), config)

    # Doubts

    def scale_doubt(self, stroke_mm: float) -> ScaleDoubt | None:
        """Return why the scale in use is probably wrong, or None."""
        calibration = self.calibration
        if calibration is None or not calibration.calibrated:
            return None
        return scale_doubt(calibration, stroke_mm)

    def doubts(self, gripper_id: GripperId, identity: MotorIdentity | None) -> list[str]:
        """Return why it is probably wrong: its scale, and where it is from."""
        if self.valid is None:
            return []
        found = (
            scale_warning(self.valid, gripper_id.stroke_mm),
            self.foreign_doubt(gripper_id, identity),
        )
        return [doubt for doubt in found if doubt is not None]

    def work_stroke_doubts(self) -> list[str]:
        """Return that it has `open` go beyond the travel; else nothing."""
        beyond = None if self.valid is None else work_stroke_warning(self.valid)
        return [] if beyond is None else [beyond]

    def foreign_doubt(self, gripper_id: GripperId, identity: MotorIdentity | None) -> str | None:
        """Return why it is probably another gripper's, or None."""
        if self.valid is None:
            return None
        return foreign_warning(
            self.valid,
            channel=gripper_id.channel,
            can_id=gripper_id.can_id,
            master_id=None if identity is None else identity.master_id,
            motor_type=gripper_id.motor_type.name,
        )

    def why_unfitting(
        self,
        calibration: Calibration,
        file: str | None,
        gripper_id: GripperId,
        identity: MotorIdentity | None,
    ) -> Refusal | None:
        """Return a refusal if another calibration cannot be this gripper's, or None.

        `file` is where it comes from, None for what a client gives.
        """
        ranges = gripper_id.motor_type.ranges if identity is None else identity.ranges
        why = unfitting(calibration, gripper_id.stroke_mm, ranges.position_rad)
        return None if why is None else self._unfitting(why, file)

    def leave_range(self, position_rad: float) -> Refusal | None:
        """Give up a calibration beyond ±`position_rad`, what the motor can report; return why."""
        why = None if self.valid is None else out_of_range(self.valid, position_rad)
        if why is None:
            return None
        file = self.file
        self.use(None, None, None)
        self.problem = self._unfitting(why, file)
        return self.problem

    def _unfitting(self, why: str, file: str | None) -> Refusal:
        kept = "; the calibration in use stays in force" if self.geometry is not None else ""
        text = sentence(
            "the calibration {file} cannot be this gripper's: {why}{kept}",
            file=file or "that was given",
            why=why,
            kept=kept,
        )
        hint = {} if file is None else {"hint": REPAIR}
        return Refusal("calibration_unreadable", text, {"file": file, **hint})

    def _gains_of(self, calibration: Calibration, by: int | None) -> Gains:
        """Return the gains of a calibration that the client `by` brings."""
        gains = gains_of(calibration, self.gains if by == self._by else self._own_gains)
        if damping_conflict(gains.kp_nm_rad, gains.kd_nm_s_rad) is None:
            return gains
        return gains_of(calibration, DEFAULT_GAINS)  # one was given; take the default other

    def note_saved(self, calibration: Calibration, channel: str, file: str, saved_s: float) -> None:
        """Note that `calibration`, if still in use, is now in the file of `channel`."""
        if self.calibration is calibration:
            self.calibration = replace(calibration, channel=channel, saved_s=saved_s)
            self.file = file

    def note_zero(self, zero: ZeroView) -> Calibration | None:
        """Give a calibration up as soon as positions may count from another zero.

        Returns the new content for its file, so that a restart does not bring the old one back.
        """
        before, self._zero = self._zero, zero
        moved = zero.is_uncertain or zero.state == "done"
        calibration = self.calibration
        if zero == before or not moved or calibration is None or not calibration.calibrated:
            return None
        useless = replace(calibration, calibrated=False)
        self.use(useless, ZERO_MOVED, self.file)
        return useless


SAVE_WITHIN_S = 10.0


class Saving:
    """Makes the calibration of two measured stops the gripper's own; saves it if `keep` is true.

    `step` returns the task once, and the outcome when it is done.
    """

    def __init__(
        self,
        before: Calibration | None,
        gripper_id: GripperId,
        gains: Gains,
        *,
        stroke_mm: float | None,
        keep: bool,
    ) -> None:
        """`stroke_mm` is how far the jaws open, None for what is configured."""
        self._before = before
        self._gripper_id = gripper_id
        self._stroke_mm = gripper_id.stroke_mm if stroke_mm is None else stroke_mm
        self._gains = gains
        self._keep = keep
        self._calibration: Calibration | None = None
        self._saved: TaskResult | None = None
        self._began_s: float | None = None
        self._content: dict[str, Any] = {}

    @property
    def rad_to_mm(self) -> float:
        """The scale known before, or the nominal one: for speeds and run-ups only, never saved."""
        known = NOMINAL[0] if self._before is None else self._before.geometry
        return known.rad_to_mm

    def begin(self, closed_rad: float, open_rad: float, *, plausible: bool) -> ZeroResult | None:
        """Take the stops; return a failure if they cannot be right.

        With `plausible` the travel must be close to the one known before.
        """
        try:
            found = measured(
                self._before,
                closed_rad=closed_rad,
                open_rad=open_rad,
                stroke_mm=self._stroke_mm,
            )
        except CalibrationError as error:
            return failed("implausible_travel", str(error))
        before, travel_rad = self._before, found.geometry.travel_rad
        if plausible and before is not None:
            low_rad, high_rad = plausible_travel_rad(before)
            if not low_rad <= travel_rad <= high_rad:
                return failed(
                    "implausible_travel",
                    f"the stops are {travel_rad:.3f} rad apart, by the calibration before it was"
                    f" {before.geometry.travel_rad:.3f}: clear the jaws' way and try again, or"
                    " calibrate by hand",
                )
        self._calibration = found
        return None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Have the file written, wait for it, and adopt the calibration."""
        calibration = self._calibration
        if calibration is None:
            return Step(outcome=failed("not_found", "no stops were measured"))
        if self._began_s is None:
            self._began_s = now_s
            self._content = content_of(calibration, self._gripper_id, self._gains, motor)
            if self._keep:
                return Step(task=save_task(self._gripper_id, self._content, self._note))
        if not self._keep:
            return _adopt(calibration, self._content, None)
        if self._saved is None:
            if now_s - self._began_s < SAVE_WITHIN_S:
                return Step()
            return Step(outcome=failed("not_saved", f"not written within {SAVE_WITHIN_S:g} s"))
        if self._saved.error is not None or not isinstance(self._saved.value, dict):
            return Step(outcome=failed("not_saved", f"not saved: {self._saved.error}"))
        value = self._saved.value
        stored = replace(calibration, saved_s=float(value["saved_s"]))
        return _adopt(stored, self._content, str(value["path"]))

    def _note(self, result: TaskResult) -> None:
        self._saved = result


def content_of(
    calibration: Calibration, gripper_id: GripperId, gains: Gains, motor: MotorView
) -> dict[str, Any]:
    """Return the content of this gripper's file for a calibration."""
    return calibration.file_content(
        channel=gripper_id.channel,
        can_id=gripper_id.can_id,
        master_id=None if motor.identity is None else motor.identity.master_id,
        motor_type=gripper_id.motor_type.name,
        kp_nm_rad=gains.kp_nm_rad,
        kd_nm_s_rad=gains.kd_nm_s_rad,
    )


def save_task(
    gripper_id: GripperId, content: Mapping[str, Any], on_result: Callable[[TaskResult], None]
) -> HelperTask:
    """Return the helper task that writes the daemon's own calibration file."""
    return HelperTask(
        "calibration.save", {"channel": gripper_id.channel, "content": content}, on_result
    )


def failed(outcome: ZeroOutcome, message: str) -> ZeroResult:
    """Return a result with the reason why there is no new calibration."""
    return ZeroResult(False, outcome, None, None, None, None, None, None, message)


def _adopt(calibration: Calibration, content: dict[str, Any], path: str | None) -> Step:
    geometry = calibration.geometry
    in_use = replace(calibration, channel=str(content["channel"]), content=content)
    result = ZeroResult(
        ok=True,
        outcome="measured",
        closed_rad=geometry.closed_rad,
        open_rad=geometry.open_rad,
        travel_rad=geometry.travel_rad,
        rad_to_mm=geometry.rad_to_mm,
        content=content,
        path=path,
        message=None,
    )
    return Step(outcome=result, adopted=Adopted(in_use, path))
