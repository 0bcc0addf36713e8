"""Calibration by hand: the jaws are loose, and their user says when they are at a stop."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from types import TracebackType
from typing import Any

from litegrip_client.calibration import CalibrationData
from litegrip_client.calibration_files import check_writable, environment_path
from litegrip_client.core.link import ACTION_TIMEOUT_S, Link
from litegrip_client.errors import CommandError, LiteGripError
from litegrip_client.warn import leave


class ManualCalibration:
    """One calibration by hand, as `async with gripper.manual_calibration() as manual:`.

    The motor must be enabled. Push the jaws to each stop, in any order, and call `mark_closed` and
    `mark_open` there; then `finish`. The marks alone say which way closing is. A block that ends
    without `finish` changes nothing. At its end the jaws hold.
    """

    def __init__(
        self,
        link: Link,
        save: Callable[[str], Awaitable[str]],
        before: Callable[[], Awaitable[None]],
    ) -> None:
        """`before` is awaited before it begins."""
        self._link = link
        self._save = save
        self._before = before
        self._running = False

    async def mark_closed(self) -> float:
        """Take the present position as the closed limit; return it, in rad."""
        return float((await self._step("closed"))["closed_rad"])

    async def mark_open(self) -> float:
        """Take the present position as the open limit; return it, in rad."""
        return float((await self._step("open"))["open_rad"])

    async def finish(self, save: bool = True) -> CalibrationData:
        """Use the calibration that the two marks make, and save it unless `save` is false."""
        target = environment_path() if save else None
        if target is not None:
            check_writable(target)
        result = await self._step("finish", save=save)
        self._running = False
        data = CalibrationData.from_result(result)
        if target is not None:
            await self._save(target)
        return data

    async def __aenter__(self) -> ManualCalibration:
        if self._running:
            raise CommandError("this calibration has begun already", reason="busy")
        await self._before()
        self._running = True
        try:
            await self._step("begin")
        except LiteGripError:
            self._running = False
            raise
        except GeneratorExit:  # the event loop is gone, and nothing can be awaited
            raise
        except BaseException as error:  # it may have begun, though the answer was not awaited
            await leave(self._cancel, error)
            raise
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        await leave(self._cancel, error)

    async def _cancel(self) -> None:
        if self._running:
            self._running = False
            await self._link.wire.call("calibration.manual", {"step": "cancel"})

    async def _step(self, step: str, **more: Any) -> dict[str, Any]:
        if not self._running:
            raise CommandError(
                "no calibration by hand is going on",
                reason="not_begun",
                data={"hint": "use it as: with gripper.manual_calibration() as manual:"},
            )
        wire = self._link.wire
        call = wire.prepare_guarded("calibration.manual", {"step": step, **more})
        return await wire.run(call, ACTION_TIMEOUT_S)
