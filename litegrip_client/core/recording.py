"""Record for a given time: begin, watch until it is over, have it kept.

A recording that did not fill is an error. This module must not know what a trajectory holds.
"""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Mapping

from litegrip_client.checks import number
from litegrip_client.core.link import ACTION_TIMEOUT_S
from litegrip_client.errors import CommandError, LiteGripError
from litegrip_client.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.wire import Wire

MOST_MISSED_SHARE = 0.1
"""More than this share of the samples missing is no recording of the motion."""

_LONGEST_PAUSE_S = 0.1
_SHORTEST_PAUSE_S = 0.005
_STAYS = ("recording_failed", "not_saved", "trajectories_full")
"""Ended by these, a recording is over; the daemon has it until the next one begins."""

_WHATEVER_THERE_IS = {"allow_empty": True, "allow_partial": True}


async def begin(wire: Wire, params: Mapping[str, Any]) -> dict[str, Any]:
    """Begin to record; return the status. Who is interrupted meanwhile has begun nothing."""
    call = wire.prepare_guarded("trajectory.record_start", params)
    call.keep = True
    try:
        return await wire.run(call)
    except BaseException:
        wire.abandon(call, lambda _status: ("trajectory.record_stop", _WHATEVER_THERE_IS))
        raise


async def end(wire: Wire, params: Mapping[str, Any]) -> dict[str, Any]:
    """End the recording and have the daemon keep it; return its description."""
    return await wire.call("trajectory.record_stop", params, ACTION_TIMEOUT_S)


class Recording:
    """One recording of `duration_s`, to be run once; `name` is what the daemon keeps it under.

    `pause` waits for some seconds. `on_status` is called with `trajectory.status` on the way.
    """

    def __init__(
        self,
        wire: Wire,
        pause: Callable[[float], Awaitable[None]],
        *,
        duration_s: float,
        rate_hz: float = 100.0,
        zero_gravity: bool = True,
        name: str | None = None,
        on_status: Callable[[dict[str, Any]], None] = lambda _status: None,
    ) -> None:
        """Raise `CommandError` for what can be no time."""
        self._wire = wire
        self._pause = pause
        self._rate_hz = number("rate_hz", rate_hz)
        self._samples = round(number("duration_s", duration_s) * self._rate_hz)
        if self._samples < 1:
            text = f"{duration_s!r} s at {rate_hz!r} Hz make no sample: record for longer"
            raise CommandError(text, reason="invalid_params", data={"parameter": "duration_s"})
        self._start = {
            "rate_hz": self._rate_hz,
            "zero_gravity": bool(zero_gravity),
            "max_samples": self._samples,
        }
        self._name = {} if name is None else {"name": name}
        self._on_status = on_status

    async def run(self) -> dict[str, Any]:
        """Record; return the result of `trajectory.record_stop`.

        Raises `CommandError` that tells how many samples there are when it did not fill. Whatever
        else ends the waiting ends the recording first, so that the jaws hold, and is then raised.
        """
        wire = self._wire
        status = await begin(wire, self._start)
        try:
            while status["active"] and status["kind"] == "record":
                self._on_status(status)
                due = status["samples"] + status["missed"]
                left_s = (self._samples - due) / self._rate_hz
                await self._pause(min(max(left_s, _SHORTEST_PAUSE_S), _LONGEST_PAUSE_S))
                status = await wire.call("trajectory.status")
            self._check(status)
            return await end(wire, self._name)
        except GeneratorExit:  # the event loop is gone, and nothing can be awaited
            raise
        except BaseException as error:
            if getattr(error, "reason", None) not in _STAYS and not wire.closed:
                await wire.finish(self._cancel())
            raise

    def _check(self, status: dict[str, Any]) -> None:
        """Refuse a recording with holes before it is kept; the daemon refuses a broken one."""
        got = status["samples"]
        if status["error"] is None and got < (1.0 - MOST_MISSED_SHARE) * self._samples:
            raise CommandError(
                f"the recording did not fill: {got} of {self._samples} samples",
                reason="recording_failed",
                data={"samples": got, "expected": self._samples},
            )

    async def _cancel(self) -> None:
        try:
            await end(self._wire, _WHATEVER_THERE_IS)
        except LiteGripError as error:
            warn(f"the interrupted recording could not be ended: {error}")
