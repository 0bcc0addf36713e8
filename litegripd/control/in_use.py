"""The calibration that is in use, where it came from, and why there is none."""

from dataclasses import replace

from litegripd.control.admission import CALIBRATION_COMING, NOT_CALIBRATED, ZERO_MOVED
from litegripd.control.gains import DEFAULT_GAINS, gains_of
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.geometry import Geometry
from litegripd.model.motion_limits import damping_conflict
from litegripd.model.motor import ZeroView


class CalibrationInUse:
    """Knows the travel and the gains of the hold; `file` is None for what has none."""

    def __init__(self) -> None:
        self.calibration: Calibration | None = None
        self.file: str | None = None
        self.gains = DEFAULT_GAINS
        self.problem = NOT_CALIBRATED
        self._zero = ZeroView()

    @property
    def geometry(self) -> Geometry | None:
        """The calibrated travel, None while uncalibrated."""
        calibration = self.calibration
        return calibration.geometry if calibration and calibration.calibrated else None

    @property
    def is_coming(self) -> bool:
        """True from the start until it is known whether there is a calibration."""
        return self.calibration is None and self.problem.reason == CALIBRATION_COMING.reason

    def expect(self) -> None:
        """Say that one is being read, until `use`."""
        self.problem = CALIBRATION_COMING

    def use(
        self, calibration: Calibration | None, problem: Refusal | None, file: str | None
    ) -> None:
        """Take a calibration and its file, or the reason why there is none."""
        self.calibration, self.file = calibration, file
        self.problem = problem or NOT_CALIBRATED
        before, self.gains = self.gains, DEFAULT_GAINS
        if calibration is None:
            return
        gains = gains_of(calibration, before)
        if damping_conflict(gains.kp_nm_rad, gains.kd_nm_s_rad) is not None:
            gains = gains_of(calibration, DEFAULT_GAINS)  # one was given, and fits the usual other
        self.gains = gains

    def note_saved(self, calibration: Calibration, channel: str, file: str, saved_s: float) -> None:
        """Note that `calibration`, if it is still in use, is in the file of `channel` now."""
        if self.calibration is calibration:
            self.calibration = replace(calibration, channel=channel, saved_s=saved_s)
            self.file = file

    def note_zero(self, zero: ZeroView) -> Calibration | None:
        """Give a calibration up as soon as positions may count from another zero.

        Returns what its file shall hold from now on, so that a restart does not bring it back.
        """
        before, self._zero = self._zero, zero
        moved = zero.is_uncertain or zero.state == "done"
        calibration = self.calibration
        if zero == before or not moved or calibration is None or not calibration.calibrated:
            return None
        useless = replace(calibration, calibrated=False)
        self.use(useless, ZERO_MOVED, self.file)
        return useless
