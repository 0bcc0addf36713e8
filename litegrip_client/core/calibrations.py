"""Calibrations of a program: load and save them, and measure the travel by hand.

There is one calibration, the daemon's, for all its clients. Files are the client's, where a path
is given or LITEGRIP_CALIB names one; their contents travel.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Awaitable, Callable, Mapping
from typing import Any

from litegrip_client.core.session import ACTION_TIMEOUT_S, AsyncBlock, DaemonSession
from litegrip_client.values import calibration_files as files
from litegrip_client.values.calibration import CALIBRATION_KEYS, CalibrationData
from litegrip_client.values.errors import BusyError, CommandError, LiteGripError, ParameterError
from litegrip_client.values.results import MoveProgress
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.warn import leave, warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from litegrip_client.values.terms import Voice

Command = Callable[[str, dict[str, Any], float], Awaitable[dict[str, Any]]]

_REPORTS_PER_LINE = 10
"""Reports come at 20 Hz: two lines a second."""


async def load(
    session: DaemonSession,
    command: Command,
    path: str | os.PathLike[str] | None,
    template: str | None,
) -> bool:
    """Have the daemon use a calibration; false if none was found.

    Without `path` and `template` the usual places are searched. Raises `CommandError`.
    """
    if template is not None:
        if path is not None:
            text = "either a path or a template can be loaded, not both"
            raise ParameterError(text, reason="invalid_params")
        return await _load(session, command, {"template": files.check_template(template)})
    asked = path if path is not None else files.environment_path()
    if asked is None:
        return await _load_found(session, command)
    name = files.template_at(asked)
    if name is not None:
        return await _load(session, command, {"template": name})
    return await _load_file(session, command, asked, await session.run_blocking(files.read, asked))


async def use(session: DaemonSession, command: Command, data: CalibrationData) -> bool:
    """Have the daemon use a calibration's values."""
    content = {name: getattr(data, name) for name in CALIBRATION_KEYS}
    known = {name: value for name, value in content.items() if value is not None}
    return await _load(session, command, {"content": {**known, "calibrated": True}})


async def _load_file(
    session: DaemonSession,
    command: Command,
    path: str | os.PathLike[str],
    content: dict[str, Any],
) -> bool:
    try:
        return await _load(session, command, {"content": content})
    except CommandError as error:
        error.message = f"{os.fspath(path)}: {error.message}"
        raise


async def _load(session: DaemonSession, command: Command, params: dict[str, Any]) -> bool:
    answer = await command("calibration.load", params, ACTION_TIMEOUT_S)
    warn_of_doubts(answer, session.voice)
    return answer["loaded"] is True


def warn_of_doubts(view: Mapping[str, Any], voice: Voice | None) -> None:
    """Log each reason why a calibration is probably wrong, in the words of a voice."""
    from litegrip_client.values.voices import in_python  # noqa: PLC0415 - seldom needed

    for doubt in warnings_in(view, voice or in_python):
        warn(doubt)


def warnings_in(view: Mapping[str, Any], voice: Voice) -> list[str]:
    """Return why a calibration is probably wrong; an older daemon knows the scale alone."""
    from litegrip_client.values.terms import told, told_all  # noqa: PLC0415 - seldom needed

    if "warnings" in view:
        return told_all(view, "warnings", voice)
    return [told(view, "scale_warning", voice)] if view.get("scale_warning") else []


async def _load_found(session: DaemonSession, command: Command) -> bool:
    try:
        answer = await command("calibration.load", {}, ACTION_TIMEOUT_S)
    except BusyError:
        if (await session.wire.call("calibration.get"))["calibrated"] is True:
            return True
        raise
    if answer["loaded"] is True and answer["factory"] is not True:
        warn_of_doubts(answer, session.voice)
        return True
    for reason in answer["skipped"]:
        warn(f"the daemon passed over: {reason}")
    found = await session.run_blocking(next, files.own_files(session.channel), None)
    if found is None:
        return answer["loaded"] is True
    return await _load_file(session, command, *found)


async def save_calibration(session: DaemonSession, path: str | os.PathLike[str] | None) -> str:
    """Save the calibration in use; return the path. Raises `CommandError`."""
    target = path if path is not None else files.environment_path()
    if target is None:
        saved = await session.wire.call("calibration.save", None, ACTION_TIMEOUT_S)
        return str(saved["path"])
    present = await session.wire.call("calibration.get")
    if present["calibrated"] is not True:
        raise CommandError("there is no calibration to be saved", reason="not_calibrated")
    return await session.run_blocking(files.write, target, present["content"])


@shortened
class ManualCalibration(AsyncBlock):
    """One calibration by hand, as `async with gripper.manual_calibration() as manual:`.

    The motor must be enabled. Push the jaws to each stop, in any order, and call `mark_closed` and
    `mark_open` there; then `finish`. The marks alone say which way closing is. A block that ends
    without `finish` changes nothing. At its end the jaws hold.
    """

    def __init__(
        self,
        session: DaemonSession,
        before: Callable[[], Awaitable[None]],
        stroke: Callable[[float | None], dict[str, float]],
    ) -> None:
        """`before` is awaited before it begins; `stroke` makes a parameter of a stroke."""
        self._session = session
        self._before = before
        self._stroke = stroke
        self._running = False

    async def mark_closed(self) -> float:
        """Take the present position as the closed limit; return it, in rad."""
        return float((await self._step("closed"))["closed_rad"])

    async def mark_open(self) -> float:
        """Take the present position as the open limit; return it, in rad."""
        return float((await self._step("open"))["open_rad"])

    async def finish(self, save: bool = True, *, stroke_mm: float | None = None) -> CalibrationData:
        """Use the calibration that the two marks make, and save it unless `save` is false.

        It is saved as `LiteGrip.zero` does, and `stroke_mm` is as there. Raises `CommandError`
        while a mark is missing or the two cannot be right (then mark again), and when it could not
        be saved.
        """
        target = files.environment_path() if save else None
        if target is not None:
            files.check_writable(target)
        result = await self._step("finish", save=save, **self._stroke(stroke_mm))
        self._running = False
        data = CalibrationData.from_result(result)
        if target is not None:
            await save_calibration(self._session, target)
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

    async def __aexit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        await leave(self._cancel, error)

    async def _cancel(self) -> None:
        if self._running:
            self._running = False
            await self._session.wire.call("calibration.manual", {"step": "cancel"})

    async def _step(self, step: str, **more: Any) -> dict[str, Any]:
        if not self._running:
            raise CommandError(
                "no calibration by hand is under way",
                reason="not_begun",
                data={"hint": "use it as: with gripper.manual_calibration() as manual:"},
            )
        return await self._session.command(
            "calibration.manual", {"step": step, **more}, ACTION_TIMEOUT_S
        )


class ProbePrinter:
    """Prints what a probe does, as the vendor's SDK does; nothing else in the client prints.

    It prints each new phase, and its progress now and then.
    """

    def __init__(self) -> None:
        self._stage = ""
        self._reports = 0

    def progress(self, report: MoveProgress) -> None:
        """Print a line for some of the reports."""
        if report.stage != self._stage:
            self._stage, self._reports = report.stage, 0
        if self._reports % _REPORTS_PER_LINE == 0:
            total = f"/{report.total_steps}" if report.total_steps else ""  # mostly nobody knows
            _print(
                f"[{report.stage}] {report.i}{total} cmd={report.cmd_rad:+.4f} rad "
                f"pos={report.pos_rad:+.4f} rad tau={report.torque_nm:+.3f} N·m"
            )
        self._reports += 1

    def end(self, data: CalibrationData, path: str | None) -> None:
        """Print what was measured, with which stroke, and where the daemon saved it."""
        saved = "not saved" if path is None else f"saved by the daemon to {path}"
        _print(
            f"closed {data.zero_position_rad:+.4f} rad, open {data.max_position_rad:+.4f} rad, "
            f"travel {data.travel_range_rad:.4f} rad, {data.rad_to_mm:.2f} mm/rad; {saved}"
        )
        _print(
            f"taken: the jaws open {data.stroke_mm:.5g} mm (config.max_stroke_mm). If a caliper"
            " says otherwise: gripper.rescale_calibration(MM), then gripper.save_calibration()"
        )


def _print(line: str) -> None:
    sys.stdout.write(f"{line}\n")
    sys.stdout.flush()
