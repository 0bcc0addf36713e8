"""Trajectories of a program: record for a given time, replay, and move them in pieces.

A recording that did not fill is an error. Contents pass through here unread: the daemon checks
them.
"""

from __future__ import annotations

import base64
import hashlib
import os
import time
from collections.abc import Awaitable, Callable, Mapping

from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.values.checks import number
from litegrip_client.values.errors import (
    CommandError,
    LiteGripError,
    ParameterError,
    ProtocolError,
    TrajectoryEmptyError,
    TrajectoryNotActiveError,
    TrajectoryRecordingError,
)
from litegrip_client.values.terms import Called
from litegrip_client.values.trajectory_format import MAX_SAMPLES
from litegrip_client.values.warn import warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: trajectories are seldom worked with
    from typing import Any

    from litegrip_client.core.session import DaemonSession, Wire
    from litegrip_client.values.trajectory import Trajectory

MOST_MISSED_SHARE = 0.1
"""More than this share of the samples missing is no recording of the motion."""

_NOT_FULL = (
    "measurements were lost on the bus, or the daemon was late: see its health, then record again"
)

_LONGEST_PAUSE_S = 0.1
_SHORTEST_PAUSE_S = 0.005
_STAYS = ("recording_failed", "not_saved", "trajectories_full")
"""Ended by these, a recording is over; the daemon has it until the next one begins."""

_WHATEVER_THERE_IS = {"allow_empty": True, "allow_partial": True}

PIECE_BYTES = 8192

_KEPT_UPLOADS = 2
"""The one before the latest may still be on its way into a replay."""

_LOOK_S = 0.01
_LOADED_WITHIN_S = 1.0
"""So long a replay that begins is waited for: the daemon's helper process loads it."""

_Share = Callable[[float], None]


class Trajectories:
    """The trajectories of one gripper object: what it records, and what it replays."""

    def __init__(self, session: DaemonSession) -> None:
        self._session = session
        self._uploads: list[tuple[Wire, bytes, Mapping[str, Any]]] = []
        self._begun_job: int | None = None
        self._ended_job: int | None = None

    def recording(self, duration_s: float, rate_hz: float, zero_gravity: bool) -> Recording:
        """Return a recording that has not begun; raises `CommandError` for an impossible time."""
        session = self._session
        return Recording(
            session.wire,
            session.pause,
            duration_s=duration_s,
            rate_hz=rate_hz,
            zero_gravity=zero_gravity,
        )

    async def begin(self, params: Mapping[str, Any]) -> dict[str, Any]:
        """Begin to record; return the status."""
        return await begin(self._session.wire, params)

    async def end(self, params: Mapping[str, Any]) -> Trajectory:
        """End the recording; return it."""
        return await self.fetch(await end(self._session.wire, params))

    async def fetch(self, kept: Mapping[str, Any]) -> Trajectory:
        """Return a recording, with its grips, by its description."""
        return await self._fetch(named(kept), has_grips=bool(kept.get("grips")))

    async def fetch_named(self, name: str) -> Trajectory:
        """Return what the daemon keeps under a name, with its grips."""
        return await self._fetch({"name": name}, has_grips=True)

    async def _fetch(self, source: Mapping[str, Any], *, has_grips: bool) -> Trajectory:
        from litegrip_client.values.trajectory import Trajectory  # noqa: PLC0415 - see the package

        session = self._session
        content = await fetch(session.wire, source)
        trajectory = await session.run_blocking(Trajectory.from_bytes, content)
        beside = await fetch_grips(session.wire, source) if has_grips else b""
        return await session.run_blocking(trajectory.with_grips, content, beside)

    async def kept(self) -> list[dict[str, Any]]:
        """Return what the daemon keeps, by name."""
        return (await listed(self._session.wire))[0]

    async def keep(self, name: str, trajectory: Trajectory) -> dict[str, Any]:
        """Have the daemon keep a trajectory under a name; return its description."""
        content, grips = await self._content(trajectory)
        return await send(self._session.wire, content, {"name": name}, grips=grips)

    async def _content(self, trajectory: Trajectory) -> tuple[bytes, bytes]:
        """Return a trajectory as it is sent; raises `CommandError` for what is none."""
        from litegrip_client.values.trajectory import Trajectory  # noqa: PLC0415 - see the package

        given: object = trajectory
        if not isinstance(given, Trajectory):
            text = f"{trajectory!r:.60} is no Trajectory"
            name = f"{given!r:.200}" if isinstance(given, str) else "name"
            hint = f"one of your own: Trajectory.load({name})"
            if not (isinstance(given, str) and os.sep in given):  # of the daemon's, none is a path
                hint = f"one that the daemon keeps: gripper.fetch_trajectory({name}); {hint}"
            raise ParameterError(text, reason="invalid_params", data={"hint": hint})
        run_blocking = self._session.run_blocking
        return await run_blocking(trajectory.to_bytes), await run_blocking(trajectory.grip_bytes)

    async def upload(self, trajectory: Trajectory) -> Mapping[str, Any]:
        """Send a trajectory, unless the daemon has it from this connection; return how it is named.

        Raises `CommandError` for what is no `Trajectory`.
        """
        wire = self._session.wire
        content, grips = await self._content(trajectory)
        self._uploads = [upload for upload in self._uploads if upload[0] is wire]
        for _, known, name in self._uploads:
            if known == content + grips:
                return name
        name = named(await send(wire, content, grips=grips))
        self._uploads.append((wire, content + grips, name))
        if len(self._uploads) > _KEPT_UPLOADS:
            await wire.call("trajectory.delete", self._uploads.pop(0)[2])
        return name

    async def status(self) -> dict[str, Any]:
        """Return the status of the running recording or replay, else of the latest one."""
        status = await self._session.wire.call("trajectory.status")
        if status["kind"] == "play" and status["job"] == self._ended_job:
            status["error"] = None  # this program ended it: that is no error
        return status

    async def begun(self, job: int) -> dict[str, Any]:
        """Wait until a replay that was begun is loaded; return the status.

        Raises why it has ended by then. One that takes long to be loaded is not waited for.
        """
        self._begun_job = job
        ends_s = time.monotonic() + _LOADED_WITHIN_S
        while status := await self.status():
            if status["job"] != job or not _is_playing(status):
                break
            if status.get("phase") != "load" or time.monotonic() >= ends_s:
                break
            await self._session.pause(_LOOK_S)
        if self._why_over(status) is not None:
            wire = self._session.wire
            if (error := (await wire.call("job.get", {"job": job})).get("error")) is not None:
                raise wire.connection.error_of(error, "trajectory.play")
        return status

    def _why_over(self, status: Mapping[str, Any]) -> str | None:
        """Return the error with which the replay that this object has begun last has ended."""
        if _is_playing(status) or status["kind"] != "play" or status["job"] != self._begun_job:
            return None
        return None if status["error"] is None else str(status["error"])

    async def not_playing(self, error: CommandError) -> CommandError:
        """Return the refusal of what needs a replay that runs, with the call that begins one.

        If that of this object has failed, the refusal says why.
        """
        if error.reason != "unknown_job":
            return error
        why = self._why_over(await self.status())
        begin = self._session.voice(Called("trajectory.play", "play_start"), None, None)
        message = f"{error.message}: begin one ({begin})" if begin else error.message
        if why is not None:
            message = f"{error.message}; the last one has ended: {why}"
        data = {**error.data, "hint": begin} if begin else error.data
        return TrajectoryNotActiveError(message, reason=error.reason, code=error.code, data=data)

    async def end_replay(self, timeout_s: float) -> dict[str, Any]:
        """End the replay that runs, if one does; return the status.

        Raises `CommandError` when it has not ended after `timeout_s` seconds.
        """
        ends_s = time.monotonic() + timeout_s
        status = await self.status()
        if not _is_playing(status):
            return status
        job = status["job"]
        await self._session.wire.call("job.cancel", {"job": job})
        self._ended_job = job
        while _is_playing(status := await self.status()) and status["job"] == job:
            if time.monotonic() >= ends_s:
                text = f"the replay, job {job}, has not ended within {timeout_s:g} s"
                raise CommandError(text, reason="busy", data={"job": job, "retryable": True})
            await self._session.pause(_LOOK_S)
        return status


def _is_playing(status: Mapping[str, Any]) -> bool:
    return status["active"] is True and status["kind"] == "play"


async def begin(wire: Wire, params: Mapping[str, Any]) -> dict[str, Any]:
    """Begin to record; return the status. An interrupt meanwhile ends the recording."""
    call = wire.connection.prepare_guarded("trajectory.record_start", params)
    call.keep = True
    try:
        return await wire.run(call)
    except BaseException:
        undo = ("trajectory.record_stop", _WHATEVER_THERE_IS)
        wire.connection.abandon(call, lambda _status: undo)
        raise


async def end(wire: Wire, params: Mapping[str, Any]) -> dict[str, Any]:
    """End the recording and have the daemon keep it; return its description."""
    try:
        return await wire.call("trajectory.record_stop", params, ACTION_TIMEOUT_S)
    except TrajectoryRecordingError as error:
        if "samples" not in error.data:
            kind: type[LiteGripError] = TrajectoryNotActiveError
        elif error.data["samples"] == 0 and error.data.get("error") is None:
            kind = TrajectoryEmptyError
        else:
            raise
        raise kind(error.message, reason=error.reason, code=error.code, data=error.data) from None


class Recording:
    """One recording of `duration_s`, to be run once; the daemon keeps it under `name`.

    Without a duration an interrupt ends it, which is kept; so is one that the daemon ends as full.
    `pause` waits for some seconds. `on_status` is called with `trajectory.status` on the way.
    """

    def __init__(
        self,
        wire: Wire,
        pause: Callable[[float], Awaitable[None]],
        *,
        duration_s: float | None,
        rate_hz: float = 100.0,
        zero_gravity: bool = True,
        name: str | None = None,
        on_status: Callable[[dict[str, Any]], None] = lambda _status: None,
    ) -> None:
        """Raise `CommandError` for an impossible time."""
        self._wire = wire
        self._pause = pause
        self._rate_hz = number("rate_hz", rate_hz)
        self._has_end = duration_s is not None
        if duration_s is None:
            self._samples = MAX_SAMPLES
        else:
            self._samples = round(number("duration_s", duration_s) * self._rate_hz)
        if self._samples < 1:
            text = f"{duration_s!r} s at {rate_hz!r} Hz make no sample: record for longer"
            raise ParameterError(text, reason="invalid_params", data={"parameter": "duration_s"})
        self._start = {
            "rate_hz": self._rate_hz,
            "zero_gravity": zero_gravity,
            "max_samples": self._samples,
        }
        self._name = {} if name is None else {"name": name}
        self._on_status = on_status

    async def run(self) -> dict[str, Any]:
        """Record; return the result of `trajectory.record_stop`.

        Raises `CommandError`, with the number of samples, when it did not fill. Whatever
        else ends the waiting ends the recording first, so that the jaws hold, and is then raised.
        """
        wire = self._wire
        try:
            status = await begin(wire, self._start)
        except ParameterError as error:
            raise self._in_seconds(error) from None
        try:
            try:
                while status["active"] and status["kind"] == "record":
                    self._on_status(status)
                    due = status["samples"] + status["missed"]
                    left_s = (self._samples - due) / self._rate_hz
                    await self._pause(min(max(left_s, _SHORTEST_PAUSE_S), _LONGEST_PAUSE_S))
                    status = await wire.call("trajectory.status")
            except KeyboardInterrupt:
                if self._has_end:
                    raise
            if self._has_end:
                self._check(status)
            return await end(wire, self._name)
        except GeneratorExit:  # the event loop is gone, and nothing can be awaited
            raise
        except BaseException as error:
            if getattr(error, "reason", None) not in _STAYS and not wire.connection.closed:
                await wire.finish(self._cancel)
            raise

    def _in_seconds(self, error: ParameterError) -> ParameterError:
        """Return the refusal of too many samples in what was asked for: a time."""
        if error.data.get("parameter") != "max_samples":
            return error
        longest_s = MAX_SAMPLES / self._rate_hz
        text = (
            f"{self._samples / self._rate_hz:g} s at {self._rate_hz:g} Hz make {self._samples}"
            f" samples: record for at most {longest_s:g} s, {MAX_SAMPLES} samples"
        )
        data = {**error.data, "parameter": "duration_s"}
        return ParameterError(text, reason=error.reason, code=error.code, data=data)

    def _check(self, status: dict[str, Any]) -> None:
        """Refuse a recording with holes before it is kept; the daemon refuses a broken one."""
        got = status["samples"]
        if status["error"] is None and got < (1.0 - MOST_MISSED_SHARE) * self._samples:
            raise TrajectoryRecordingError(
                f"the recording did not fill: {got} of {self._samples} samples",
                reason="recording_failed",
                data={"samples": got, "expected": self._samples, "hint": _NOT_FULL},
            )

    async def _cancel(self) -> None:
        try:
            await end(self._wire, _WHATEVER_THERE_IS)
        except LiteGripError as error:
            warn(f"the interrupted recording could not be ended: {error}")


def named(kept: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return how a trajectory is named to the daemon, by its description.

    A daemon of 0.1.0 gives those that end with their connection a number.
    """
    known = ("name", "upload", "recording")
    return next({key: kept[key]} for key in known if kept.get(key) is not None)


async def listed(wire: Wire) -> tuple[list[dict[str, Any]], dict[str, Any] | None]:
    """Return what the daemon keeps, by name, and what this user has of it and may have.

    The latter is None from an older daemon.
    """
    rows: list[dict[str, Any]] = []
    usage, more = None, True
    while more:
        params = {"after": rows[-1]["name"]} if rows else {}
        answer = await wire.call("trajectory.list", params, ACTION_TIMEOUT_S)
        rows += answer["trajectories"]
        more = answer["more"] and bool(answer["trajectories"])
        usage = answer.get("usage")
    return rows, usage


async def fetch(
    wire: Wire, source: Mapping[str, Any], on_share: _Share = lambda _share: None
) -> bytes:
    """Return a whole trajectory; `source` has the parameters of `trajectory.get` that name it.

    `on_share` is called with the share that has come, 0 to 1. Raises `CommandError` if the
    trajectory was replaced meanwhile.
    """
    whole = bytearray()
    announced: tuple[int, str] | None = None  # the size in bytes, and the SHA-256
    while announced is None or len(whole) < announced[0]:
        params = {**source, "offset": len(whole)}
        piece = await wire.call("trajectory.get", params, ACTION_TIMEOUT_S)
        before, announced = announced, (int(piece["total"]), str(piece["sha256"]))
        if before not in (None, announced):
            text = "the trajectory was replaced while it was being fetched: fetch it again"
            raise CommandError(text, reason="trajectory_unreadable", data={"retryable": True})
        data = base64.b64decode(piece["data"])
        if not data and len(whole) < announced[0]:
            raise ProtocolError(f"the daemon sent nothing of a trajectory from {len(whole)} on")
        whole += data
        on_share(len(whole) / max(announced[0], 1))
    content = bytes(whole)
    if hashlib.sha256(content).hexdigest() != announced[1]:
        raise ProtocolError("the trajectory has not the SHA-256 that the daemon announced")
    return content


async def fetch_grips(wire: Wire, source: Mapping[str, Any]) -> bytes:
    """Return the file of grips for `source`, empty if there is none."""
    return await fetch(wire, {**source, "format": "grip"})


async def send(
    wire: Wire,
    content: bytes,
    more: Mapping[str, Any] | None = None,
    on_share: _Share = lambda _share: None,
    grips: bytes = b"",
) -> dict[str, Any]:
    """Send a whole content, and the file of its grips; return the answer to the last piece.

    `more` are further parameters of `trajectory.put`: under which name to keep it, say.
    """
    content += grips
    common = {"total": len(content), "sha256": hashlib.sha256(content).hexdigest(), **(more or {})}
    if grips:
        common["grip_bytes"] = len(grips)
    answer: dict[str, Any] = {}
    for offset in range(0, max(len(content), 1), PIECE_BYTES):
        data = base64.b64encode(content[offset : offset + PIECE_BYTES]).decode()
        params = {"offset": offset, "data": data, **common}
        answer = await wire.call("trajectory.put", params, ACTION_TIMEOUT_S)
        on_share(min(1.0, (offset + PIECE_BYTES) / max(len(content), 1)))
    return answer
