"""Calibration by hand: the jaws are loose, and their user says when they are at a stop."""

from collections.abc import Callable
from types import TracebackType
from typing import Any

from litegrip_client.calibration import CalibrationData
from litegrip_client.calibration_files import check_writable, environment_path
from litegrip_client.errors import CommandError, LiteGripError
from litegrip_client.link import ACTION_TIMEOUT_S, Link
from litegrip_client.warn import leave


class ManualCalibration:
    """One calibration by hand, as `with gripper.manual_calibration() as manual:`.

    The motor must be enabled. Push the jaws to each stop, in any order, and call `mark_closed` and
    `mark_open` there; then `finish`. The marks alone say which way closing is. A block that ends
    without `finish` changes nothing. At its end the jaws hold.
    """

    def __init__(self, link: Link, save: Callable[[str], str]) -> None:
        self._link = link
        self._save = save
        self._running = False

    def mark_closed(self) -> float:
        """Take the present position as the closed limit; return it, in rad."""
        return float(self._step("closed")["closed_rad"])

    def mark_open(self) -> float:
        """Take the present position as the open limit; return it, in rad."""
        return float(self._step("open")["open_rad"])

    def finish(self, save: bool = True) -> CalibrationData:
        """Use the calibration that the two marks make, and save it unless `save` is false.

        It is saved as `LiteGrip.zero` does. Raises `CommandError` while a mark is missing or the
        two cannot be right (then mark again), and when it could not be saved.
        """
        target = environment_path() if save else None
        if target is not None:
            check_writable(target)
        result = self._step("finish", save=save)
        self._running = False
        data = CalibrationData.from_result(result)
        if target is not None:
            self._save(target)
        return data

    def __enter__(self) -> "ManualCalibration":
        if self._running:
            raise CommandError("this calibration has begun already", reason="busy")
        self._running = True
        try:
            self._step("begin")
        except LiteGripError:
            self._running = False
            raise
        except BaseException as error:  # it may have begun, though the answer was not awaited
            leave(self._cancel, error)
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        leave(self._cancel, error)

    def _cancel(self) -> None:
        if self._running:
            self._running = False
            self._link.connection.call("calibration.manual", {"step": "cancel"})

    def _step(self, step: str, **more: Any) -> dict[str, Any]:
        if not self._running:
            raise CommandError(
                "no calibration by hand is going on",
                reason="not_begun",
                data={"hint": "use it as: with gripper.manual_calibration() as manual:"},
            )
        connection = self._link.connection
        params = {"step": step, **more}
        return connection.run(
            connection.prepare_guarded("calibration.manual", params), ACTION_TIMEOUT_S
        )
