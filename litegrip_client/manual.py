"""Calibration by hand: the jaws are loose, and the user marks each stop."""

from __future__ import annotations

from types import TracebackType

from litegrip_client.blocking import wait
from litegrip_client.calibration import CalibrationData
from litegrip_client.core import manual as core


class ManualCalibration:
    """One calibration by hand, as `with gripper.manual_calibration() as manual:`.

    The motor must be enabled. Push the jaws to each stop, in any order, and call `mark_closed` and
    `mark_open` there; then `finish`. The marks alone say which way closing is. A block that ends
    without `finish` changes nothing. At its end the jaws hold.
    """

    def __init__(self, manual: core.ManualCalibration) -> None:
        self._manual = manual

    def mark_closed(self) -> float:
        """Take the present position as the closed limit; return it, in rad."""
        return wait(self._manual.mark_closed())

    def mark_open(self) -> float:
        """Take the present position as the open limit; return it, in rad."""
        return wait(self._manual.mark_open())

    def finish(self, save: bool = True) -> CalibrationData:
        """Use the calibration that the two marks make, and save it unless `save` is false.

        It is saved as `LiteGrip.zero` does. Raises `CommandError` while a mark is missing or the
        two cannot be right (then mark again), and when it could not be saved.
        """
        return wait(self._manual.finish(save))

    def __enter__(self) -> ManualCalibration:
        wait(self._manual.__aenter__())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        wait(self._manual.__aexit__(kind, error, trace))
