"""Record a motion and replay it: by hand or beside others, in the background or until the end.

The trajectory travels in pieces; what records and what moves is the daemon.
"""

from __future__ import annotations

import time

from litegrip_client.checks import given_numbers, integer, number
from litegrip_client.core.base import ActionBase, ProgressCallback
from litegrip_client.core.recording import Recording, begin, end
from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: trajectories are seldom worked with
    from typing import Any

    from litegrip_client.core.link import Link
    from litegrip_client.core.wire import Wire
    from litegrip_client.motion_config import MotionConfig
    from litegrip_client.results import PlayResult
    from litegrip_client.trajectory import Trajectory

_KEPT_UPLOADS = 2
"""The one before the latest may still be on its way into a replay."""

_LOOK_S = 0.01


class TrajectoryActions(ActionBase):
    """What concerns trajectories. Recording, replay and other motions exclude each other."""

    def __init__(self, link: Link, motion_config: MotionConfig | None = None) -> None:
        super().__init__(link, motion_config)
        self._uploads: list[tuple[Wire, bytes, int]] = []
        self._ended_job: int | None = None

    async def record(
        self, duration_s: float, rate_hz: float = 100.0, zero_gravity: bool = True
    ) -> Trajectory:
        """Record for `duration_s` seconds; the jaws are slack meanwhile, if `zero_gravity`."""
        wire = self._link.wire
        recording = Recording(
            wire,
            self._link.pause,
            duration_s=duration_s,
            rate_hz=rate_hz,
            zero_gravity=zero_gravity,
        )
        if zero_gravity:
            await self._end_frames()
        return await self._fetched(wire, await recording.run())

    async def record_start(
        self, rate_hz: float = 100.0, zero_gravity: bool = True, max_samples: int | None = None
    ) -> dict[str, Any]:
        """Begin to record in the background; return the status."""
        params = {"rate_hz": number("rate_hz", rate_hz), "zero_gravity": bool(zero_gravity)}
        if max_samples is not None:
            params["max_samples"] = integer("max_samples", max_samples)
        if zero_gravity:
            await self._end_frames()
        return await begin(self._link.wire, params)

    async def record_stop(self, allow_empty: bool = False) -> Trajectory:
        """End the recording; return what was captured."""
        wire = self._link.wire
        return await self._fetched(wire, await end(wire, {"allow_empty": bool(allow_empty)}))

    async def play(
        self,
        trajectory: Trajectory,
        speed: float = 1.0,
        kp: float | None = None,
        kd: float | None = None,
        align: bool = True,
        *,
        loop: bool = False,
        repeat: int = 1,
        torque_nm: float | None = None,
        force: str = "path",
        progress: ProgressCallback | None = None,
    ) -> PlayResult:
        """Replay to the end; the jaws then hold there."""
        from litegrip_client.results import PlayResult  # noqa: PLC0415 - see above

        if loop:
            raise CommandError(
                "play returns at the end, which a loop does not have",
                reason="invalid_params",
                data={"parameter": "loop", "hint": "use play_start(trajectory, loop=True)"},
            )
        params = _play_params(speed, kp, kd, align, torque_nm, force)
        params["repeat"] = integer("repeat", repeat)
        params["upload"] = await self._uploaded(trajectory)
        result = await self._run("trajectory.play", self._configured(params), progress)
        return PlayResult.from_wire(result)

    async def play_start(  # noqa: PLR0917 - the vendor's, by position
        self,
        trajectory: Trajectory,
        speed: float = 1.0,
        kp: float | None = None,
        kd: float | None = None,
        loop: bool = False,
        align: bool = True,
        *,
        torque_nm: float | None = None,
        force: str = "path",
    ) -> dict[str, Any]:
        """Begin to replay in the background; return the status."""
        params = _play_params(speed, kp, kd, align, torque_nm, force)
        # It shall end with the connection, which a motion for which nobody waits does not.
        params |= {"loop": bool(loop), "wait": False, "detach": False}
        params["upload"] = await self._uploaded(trajectory)
        await self._command("trajectory.play", self._configured(params))
        return await self.trajectory_status()

    async def play_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End the replay that runs, if one does, within `timeout` seconds; the jaws then hold."""
        ends_s = time.monotonic() + number("timeout", timeout)
        status = await self.trajectory_status()
        if not _is_playing(status):
            return status
        job = status["job"]
        await self._link.wire.call("job.cancel", {"job": job})
        self._ended_job = job
        while _is_playing(status := await self.trajectory_status()) and status["job"] == job:
            if time.monotonic() >= ends_s:
                text = f"the replay, job {job}, has not ended within {timeout:g} s"
                raise CommandError(text, reason="busy", data={"job": job, "retryable": True})
            await self._link.pause(_LOOK_S)
        return status

    async def trajectory_status(self) -> dict[str, Any]:
        """Return the status of the running recording or replay, else of the latest one."""
        status = await self._link.wire.call("trajectory.status")
        if status["kind"] == "play" and status["job"] == self._ended_job:
            status["error"] = None  # as it was told to
        return status

    async def _fetched(self, wire: Wire, kept: dict[str, Any]) -> Trajectory:
        from litegrip_client.core.trajectory_transfer import (  # noqa: PLC0415 - see above
            fetch,
            fetch_grips,
        )
        from litegrip_client.trajectory import Trajectory  # noqa: PLC0415

        source = {"recording": kept["recording"]}
        content = await fetch(wire, source)
        trajectory = await self._link.aside(Trajectory.from_bytes, content)
        if not kept.get("grips"):
            return trajectory
        beside = await fetch_grips(wire, source)
        return await self._link.aside(trajectory.with_grips, content, beside)

    async def _uploaded(self, trajectory: Trajectory) -> int:
        """Send a trajectory, unless the daemon has it from this connection; return its number."""
        from litegrip_client.core.trajectory_transfer import send  # noqa: PLC0415 - see above
        from litegrip_client.trajectory import Trajectory  # noqa: PLC0415

        given: object = trajectory
        if not isinstance(given, Trajectory):
            text = f"{trajectory!r:.60} is no Trajectory"
            hint = {"hint": 'a saved one: Trajectory.load("pick")'}
            raise CommandError(text, reason="invalid_params", data=hint)
        wire = self._link.wire
        content = await self._link.aside(trajectory.to_bytes)
        grips = await self._link.aside(trajectory.grip_bytes)
        self._uploads = [upload for upload in self._uploads if upload[0] is wire]
        for _, known, upload in self._uploads:
            if known == content + grips:
                return upload
        sent = await send(wire, content, grips=grips)
        self._uploads.append((wire, content + grips, sent["upload"]))
        if len(self._uploads) > _KEPT_UPLOADS:
            await wire.call("trajectory.delete", {"upload": self._uploads.pop(0)[2]})
        return int(sent["upload"])


def _play_params(  # noqa: PLR0917 - those of `play`, in its order
    speed: float,
    kp: float | None,
    kd: float | None,
    align: bool,
    torque_nm: float | None,
    force: str,
) -> dict[str, Any]:
    params: dict[str, Any] = {"speed": number("speed", speed), "align": bool(align)}
    if force != "path":
        params["force"] = force
    return params | given_numbers(kp=kp, kd=kd, torque_nm=torque_nm)


def _is_playing(status: dict[str, Any]) -> bool:
    return status["active"] is True and status["kind"] == "play"
