"""Measure the gripper's travel: by probing both stops, or by hand.

What was measured is used by the daemon, for all its clients, from then on.
"""

from __future__ import annotations

from litegrip_client.blocking import wait
from litegrip_client.loading import LoadingActions

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from litegrip_client.base import ProgressCallback
    from litegrip_client.calibration import CalibrationData
    from litegrip_client.manual import ManualCalibration


class CalibrationActions(LoadingActions):
    """What concerns the calibration. None of it goes while a motion runs (`BusyError`)."""

    def zero(
        self,
        *,
        mount: str | None = None,
        progress: ProgressCallback | None = None,
    ) -> CalibrationData:
        """Measure the travel by probing both stops, use it and save it.

        Keep hands and objects out of the jaws. Which stop is the closed one is taken from the
        calibration in use, or from `mount`. It probes with `motion_config.calib_*`; the daemon
        saves, and so does this program where LITEGRIP_CALIB names a file. Prints how far it is,
        unless `progress` is given. Raises `HardwareError` when no plausible travel was found,
        `CommandError` when it was not saved, and what `GripperActions` says.
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

        It probes with its arguments (N·m/rad, N·m·s/rad, rad, N·m; the daemon's defaults for
        those left out) and not with `motion_config`.
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

        Move them to each stop and say so: see `ManualCalibration`.
        """
        from litegrip_client.manual import ManualCalibration  # noqa: PLC0415 - see the package

        return ManualCalibration(self._core.manual_calibration())
