"""Record a motion and replay it: by hand or beside others, in the background or until the end.

They ask, and wait; what records and what moves is the daemon.
"""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from typing import Any

    from litegrip_client.base import ProgressCallback
    from litegrip_client.results import PlayResult
    from litegrip_client.trajectory import Trajectory


class TrajectoryActions(ActionBase):
    """What concerns trajectories: a motion, captured once and repeated later.

    Recording and replay exclude each other and every other motion (`TrajectoryBusyError`,
    `BusyError`), need an enabled motor (`HardwareError`) and a calibration (`CommandError`), and
    end with the connection. Everything raises what `GripperActions` says besides.
    """

    def record(
        self, duration_s: float, rate_hz: float = 100.0, zero_gravity: bool = True
    ) -> Trajectory:
        """Record for `duration_s` seconds, `rate_hz` samples a second (1 to the control rate).

        With `zero_gravity` **the jaws are slack** for that time, to be pushed by hand, and hold at
        the end; without, it only watches what others make them do: another thread of this program,
        say. A recording that did not fill raises `CommandError`, reason recording_failed, which
        tells how many samples there are: one that was broken off, or of which more than a tenth is
        missing. Single measurements may be missing in it, lost on the bus, but never more than
        0.1 s at a stretch: `longest_gap_s` of the trajectory tells.

        An interrupt ends the recording before it is raised.
        """
        return wait(self._core.record(duration_s, rate_hz, zero_gravity))

    def record_start(
        self, rate_hz: float = 100.0, zero_gravity: bool = True, max_samples: int | None = None
    ) -> dict[str, Any]:
        """Begin to record in the background, as `record` does; return `trajectory_status()`.

        It ends by `record_stop`, or when `max_samples` (1 to 360 000, which is the default) were
        due; the jaws then hold.
        """
        return wait(self._core.record_start(rate_hz, zero_gravity, max_samples))

    def record_stop(self, allow_empty: bool = False) -> Trajectory:
        """End the recording and return it.

        Raises `CommandError`, reason recording_failed, for one that was broken off (by a stop, a
        fault of the motor, a silent bus, ...), and for one without samples unless `allow_empty`.
        """
        return wait(self._core.record_stop(allow_empty))

    def play(
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
        """Replay a trajectory to its end; the jaws then hold there until the next command.

        It commands positions, by the openness and the calibration in use now; the torque that was
        recorded is never repeated. `speed` is a multiple of the one that was taught, 0.1 to 4;
        `kp` (5 to 500 N·m/rad) and `kd` (0.1 to 5 N·m·s/rad, and at least kp · 0.002 s) are the
        calibration's by default; `torque_nm` is what the jaws press with on what is in the way, at
        most (0.3 to 3, 2 by default). With `align` they first go to where it begins, at
        `motion_config.speed_mm_s`; without, they must be there, within `motion_config.max_lead_mm`.
        `repeat` is how often.

        With `force` "replay" the jaws do each of `trajectory.grips` again, as `grasp` does, with
        the taught force and for as long as it lasted, at `motion_config.grasp_speed_mm_s`; what is
        not gripped, or lost, ends the replay with `ok` False and outcome no_object or object_lost.
        A trajectory without grips is then refused (`CommandError`).

        `loop` is for `play_start`. An interrupt, or an error of `progress`, cancels the replay
        before it is raised. A path that something blocks gives `ok` False.
        """
        return wait(
            self._core.play(
                trajectory,
                speed,
                kp,
                kd,
                align,
                loop=loop,
                repeat=repeat,
                torque_nm=torque_nm,
                force=force,
                progress=progress,
            )
        )

    def play_start(  # noqa: PLR0917 - the vendor's, by position
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
        """Begin to replay in the background, as `play` does; return `trajectory_status()`.

        With `loop` it continues until `play_stop`; a trajectory of one sample is a pose, which is
        held then. `error` of `trajectory_status` reports later errors.
        """
        return wait(
            self._core.play_start(
                trajectory, speed, kp, kd, loop, align, torque_nm=torque_nm, force=force
            )
        )

    def play_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End the replay; the jaws hold where they are. Return `trajectory_status()`.

        It does nothing where none runs. Raises `CommandError` when it has not ended after
        `timeout` seconds.
        """
        return wait(self._core.play_stop(timeout))

    def trajectory_status(self) -> dict[str, Any]:
        """Return the status of the running recording or replay, else of the latest one.

        `active`, `kind` ("record", "play" or None), `samples` and `error` are always there; of a
        recording also `rate_hz`, `zero_gravity`, `loop_hz`, `missed` and `duration_s`, of a replay
        `frames`, `speed`, `openness`, `completed`, `loops`, `phase` and `grips`.
        """
        return wait(self._core.trajectory_status())
