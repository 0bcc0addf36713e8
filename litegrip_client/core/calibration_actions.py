"""Measure the gripper's travel: by probing both stops, or by hand.

The daemon then uses the new calibration for all its clients.
"""

from __future__ import annotations

from litegrip_client.checks import given_numbers, integer
from litegrip_client.core.loading import LoadingActions

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: the travel is seldom measured
    from typing import Any

    from litegrip_client.calibration import CalibrationData
    from litegrip_client.core.base import ProgressCallback
    from litegrip_client.core.manual import ManualCalibration


class CalibrationActions(LoadingActions):
    """The calibration. Every action raises `BusyError` while a motion runs."""

    async def zero(
        self,
        *,
        mount: str | None = None,
        progress: ProgressCallback | None = None,
    ) -> CalibrationData:
        """Measure the travel by probing both stops, use it and save it.

        Keep hands and objects out of the jaws.
        """
        from litegrip_client import calibration_files as files  # noqa: PLC0415 - see above

        target = files.environment_path()
        if target is not None:
            files.check_writable(target)
        data = await self._probe(self._configured({"save": True}), mount, progress)
        if target is not None:
            await self.save_calibration(target)
        return data

    async def calibrate(
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
        """Measure the travel as `zero` does, with these arguments, but do not save it."""
        config = given_numbers(
            calib_kp=kp,
            calib_kd=kd,
            calib_step_rad=step_rad,
            calib_tau_limit=tau_limit,
            calib_stall_delta=stall_delta,
        )
        for name, value in (("calib_stall_cycles", stall_cycles), ("calib_max_iter", max_iter)):
            if value is not None:
                config[name] = integer(name, value)
        params: dict[str, Any] = {"save": False}
        if config:
            params["config"] = config
        return await self._probe(params, mount, progress)

    def manual_calibration(self) -> ManualCalibration:
        """Calibrate by hand, for `async with`: the jaws are loose until its end."""
        from litegrip_client.core.manual import ManualCalibration  # noqa: PLC0415 - see above

        return ManualCalibration(self._link, self.save_calibration, self._end_frames)

    async def _probe(
        self, params: dict[str, Any], mount: str | None, progress: ProgressCallback | None
    ) -> CalibrationData:
        from litegrip_client.calibration import CalibrationData  # noqa: PLC0415 - see above
        from litegrip_client.probe import ProbePrinter  # noqa: PLC0415

        if mount is not None:
            params = {**params, "mount": mount}
        printer = ProbePrinter()
        result = await self._run("calibration.zero", params, progress or printer.progress)
        data = CalibrationData.from_result(result)
        if progress is None:
            printer.end(data, result.get("path"))
        return data
