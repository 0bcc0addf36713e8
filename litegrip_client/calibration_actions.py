"""Measure the gripper's travel: by probing both stops, or by hand.

The daemon then uses the new calibration for all its clients.
"""

from __future__ import annotations

from litegrip_client.blocking import wait
from litegrip_client.loading import LoadingActions

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from litegrip_client.base import ProgressCallback
    from litegrip_client.calibration import CalibrationData
    from litegrip_client.manual import ManualCalibration


class CalibrationActions(LoadingActions):
    """The calibration. Every action raises `BusyError` while a motion runs."""

    def zero(
        self,
        *,
        mount: str | None = None,
        progress: ProgressCallback | None = None,
    ) -> CalibrationData:
        """Measure the travel by probing both stops, use it and save it.

        Keep hands and objects out of the jaws. The calibration in use, or `mount`,
        determines which stop is the closed one. The probe uses `motion_config.calib_*`. The
        daemon saves the result; this program saves it too if LITEGRIP_CALIB names a file. Prints
        its progress, unless `progress` is given. Raises `HardwareError` when no plausible travel
        was found, `CommandError` when it was not saved, and the errors of `GripperActions`.
        """
        return wait(self._core.zero(mount=mount, progress=progress))

    def calibrate(
        self,
        kp: float | None = None,
        kd: float | None = None,
        step_rad: float | None = None,
        tau_limit: float | None = None,
        *,
        stall_delta: float | None = None,
        stall_cycles: int | None = None,
        max_iter: int | None = None,
        mount: str | None = None,
        progress: ProgressCallback | None = None,
    ) -> CalibrationData:
        """Measure the travel as `zero` does and use it, but do not save it.

        The probe uses the arguments (N·m/rad, N·m·s/rad, rad, N·m), not `motion_config`. The
        daemon's defaults replace arguments that are left out.
        """
        return wait(
            self._core.calibrate(
                kp,
                kd,
                step_rad,
                tau_limit,
                stall_delta=stall_delta,
                stall_cycles=stall_cycles,
                max_iter=max_iter,
                mount=mount,
                progress=progress,
            )
        )

    def manual_calibration(self) -> ManualCalibration:
        """Calibrate by hand, for `with`: the jaws are loose until its end.

        Move them to each stop and mark it: see `ManualCalibration`.
        """
        from litegrip_client.manual import ManualCalibration  # noqa: PLC0415 - see the package

        return ManualCalibration(self._core.manual_calibration())
