"""The client for threads: made by docs/generate.py from its core, not by hand."""

from __future__ import annotations

from litegrip_client.threads.blocking import complete
from litegrip_client.values.fields import Hinting
from litegrip_client.values.tracebacks import shortened

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing typing and dataclasses is slow
    import os
    from collections.abc import Mapping
    from typing import Any, Literal

    from litegrip_client.core import actions as core_actions
    from litegrip_client.core import calibrations as core_calibrations
    from litegrip_client.core import gripper as core_gripper
    from litegrip_client.core import motion as core_motion
    from litegrip_client.core import session as core_session
    from litegrip_client.core.actions import ProgressCallback
    from litegrip_client.values.calibration import CalibrationData, GripperConfig
    from litegrip_client.values.motion_config import MotionConfig
    from litegrip_client.values.printed import HealthReport, JobTable, TrajectoryTable
    from litegrip_client.values.results import (
        EnableResult,
        GraspResult,
        GripperState,
        MoveResult,
        PlayResult,
        SetZeroResult,
    )
    from litegrip_client.values.trajectory import Trajectory


@shortened
class Lease:
    """The lease of one gripper, for `with`: taken at the start, returned at the end.

    Without a block, `acquire` and `release` do the same. It is kept while another block, or
    `enable`, of the same gripper object needs it. `token` names it, for another connection of the
    same program (`lease` of the raw methods).
    """

    def __init__(self, core: core_session.Lease) -> None:
        self._core = core

    def __repr__(self) -> str:
        return repr(self._core)

    @property
    def token(self) -> str | None:
        """The name of the lease, until it is released."""
        return self._core.token

    def acquire(self) -> None:
        """Take the lease, until `release`; one that was lost is taken again.

        Raises `LeaseError`, which names the owner, when it is not free within `wait_s` seconds.
        """
        complete(self._core.acquire())

    def release(self) -> None:
        """Give the lease back, unless this gripper object needs it for more; again does nothing.

        The jaws stay as they are.
        """
        complete(self._core.release())

    def __enter__(self) -> Lease:
        complete(self._core.__aenter__())
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        complete(self._core.__aexit__(_kind, error, _))

    def renew(self) -> None:
        """Restart `ttl_s`, as every call does. Raises `LeaseError` when the lease is lost."""
        complete(self._core.renew())


@shortened
class ManualCalibration:
    """One calibration by hand, as `with gripper.manual_calibration() as manual:`.

    The motor must be enabled. Push the jaws to each stop, in any order, and call `mark_closed` and
    `mark_open` there; then `finish`. The marks alone say which way closing is. A block that ends
    without `finish` changes nothing. At its end the jaws hold.
    """

    def __init__(self, core: core_calibrations.ManualCalibration) -> None:
        self._core = core

    def mark_closed(self) -> float:
        """Take the present position as the closed limit; return it, in rad."""
        return complete(self._core.mark_closed())

    def mark_open(self) -> float:
        """Take the present position as the open limit; return it, in rad."""
        return complete(self._core.mark_open())

    def finish(self, save: bool = True, *, stroke_mm: float | None = None) -> CalibrationData:
        """Use the calibration that the two marks make, and save it unless `save` is false.

        It is saved as `LiteGrip.zero` does, and `stroke_mm` is as there. Raises `CommandError`
        while a mark is missing or the two cannot be right (then mark again), and when it could not
        be saved.
        """
        return complete(self._core.finish(save, stroke_mm=stroke_mm))

    def __enter__(self) -> ManualCalibration:
        complete(self._core.__aenter__())
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        complete(self._core.__aexit__(_kind, error, _))


@shortened
class SetpointStream(Hinting):
    """A stream of targets for the jaws: `with gripper.stream() as stream:`.

    The latest target wins, of whichever stream of the program. When none comes for `valid_s`, and
    at the end of the block, the jaws hold where they are. Each object is for one thread or task.
    Without a block it works until `close`; after that, or the block, `set_target` raises
    `ConnectError`.

    The first target, and one after a pause, waits for the daemon's answer; the others are sent
    without. What the daemon refuses of those is raised by one of the next calls, at the latest by
    `close` or the end of the block, but for one that came too late: the jaws hold until the next
    one. After `cancel` of the gripper the next call raises `CancelledError`, and the one after that
    begins anew.
    """

    def __init__(self, core: core_motion.SetpointStream) -> None:
        self._core = core

    def __repr__(self) -> str:
        return repr(self._core)

    def set_target(
        self,
        opening_mm: float | None = None,
        *,
        position_rad: float | None = None,
        openness: float | None = None,
        push_nm: float | None = None,
        torque_nm: float | None = None,
        kp: float | None = None,
        kd: float | None = None,
    ) -> None:
        """Send the jaws to exactly one of `opening_mm`, `position_rad` and `openness` (0 to 1).

        Or have the motor make the torque `push_nm` in N·m, positive towards larger radians, within
        what `set_force` allows and at a bounded speed; with 0 the jaws are slack. Nothing else goes
        with it.

        `torque_nm` is for this target what it is for the whole stream. `kp` (5 to 500 N·m/rad) and
        `kd` (0.1 to 5 N·m·s/rad) are the most stiffness and damping, the calibration's by default.
        Raises `CommandError` (a target outside the travel, another motion runs, ...) and all that
        motions raise: for the first target at once, for others by a later call, `close` included.
        The call that raises sends nothing: send its target again.
        """
        complete(
            self._core.set_target(
                opening_mm,
                position_rad=position_rad,
                openness=openness,
                push_nm=push_nm,
                torque_nm=torque_nm,
                kp=kp,
                kd=kd,
            )
        )

    def close(self) -> None:
        """End the stream at once, so that the jaws hold; again does nothing.

        Raises why a target was refused, if no call has raised it.
        """
        complete(self._core.close())

    def __enter__(self) -> SetpointStream:
        complete(self._core.__aenter__())
        return self

    def __exit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        complete(self._core.__aexit__(_kind, error, _))


class GripperActions:
    """All actions of the gripper at the other end of a session.

    Every action raises `ConnectError` without a connection. An action that moves the jaws raises
    `CommandError` (not calibrated, or a value out of its range), `BusyError` (another motion
    runs), `StoppedError` (a stop is latched, or came in between), `CancelledError` and
    `HardwareError` (the motor or the bus does not work).

    `progress` gets a `MoveProgress` up to 20 times a second. An interrupt (`KeyboardInterrupt`, a
    cancelled task), or an error of the callback, cancels the motion before it is raised; the jaws
    then hold.

    They report by results, progress callbacks and exceptions, and print nothing. Only the probe of
    the calibration prints, as in the vendor's SDK.
    """

    def __init__(self, core: core_actions.GripperActions) -> None:
        self._core = core

    @property
    def motion_config(self) -> MotionConfig:
        """The tunables of this object's motions: what was set in them is sent with each call."""
        return self._core.motion_config

    @motion_config.setter
    def motion_config(self, value: MotionConfig) -> None:
        self._core.motion_config = value

    @property
    def motion_calibration(self) -> Mapping[str, float] | None:
        """What this object's motions count on in place of the daemon's calibration, or None.

        It has the keys of a calibration file: `zero_position_rad` (closed), `max_position_rad`
        (open) and `rad_to_mm`, and perhaps `work_stroke_mm`, `kp` and `kd`. It is sent with each
        motion, and changes nothing for other clients; the state's millimetres are the daemon's. The
        daemon refuses what `load_calibration` would refuse.
        """
        return self._core.motion_calibration

    @motion_calibration.setter
    def motion_calibration(self, value: Mapping[str, float] | None) -> None:
        self._core.motion_calibration = value

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor; true if its status says so.

        `retries`: enable commands at most, 1 to 20; None means `motion_config.enable_retries`.
        It takes the lease: until the gripper is disconnected no other client moves it. An older
        object of the same program hands it over between motions, if `enable` gave it the lease.
        If this process ends without disabling the motor, the daemon disables it, or continues to
        hold, according to the present `disable_on_disconnect`. Raises `LeaseError`, which names
        the owner, when another client has the lease, `StoppedError` while a stop is latched and
        `HardwareError` when the motor or the bus does not work.
        """
        return complete(self._core.enable(retries))

    def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed.

        Raises `CommError` if the motor cannot be reached: it may be enabled, so cut its power.
        """
        return complete(self._core.disable())

    def clear_fault(self, *, enable: bool = True) -> bool:
        """Clear the motor's latched fault and enable the motor; true if it is enabled.

        The motor holds the measured position then; `enable` describes what else that means. With
        `enable` false it stays disabled, and true means that no fault is left. An enabled motor
        has no fault: nothing happens. This also accepts a position that has jumped: check first
        where the jaws are. Raises `HardwareError` with a fault that cannot be cleared.
        """
        return complete(self._core.clear_fault(enable=enable))

    def read_param(self, register: str | int) -> float:
        """Read a register of the motor, by name ("PMAX") or number (21); nothing is written.

        Raises `CommandError` for one that is not known.
        """
        return complete(self._core.read_param(register))

    def set_zero(self) -> SetZeroResult:
        """Store the present position as the motor's zero, permanently; disables the motor first.

        The calibration is then invalid: motions are refused until the gripper is calibrated
        again, by `zero` or `manual_calibration`.
        """
        return complete(self._core.set_zero())

    def open(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Open the jaws to the mechanical stop, at `speed_mm_s` or `motion_config`'s.

        A success is `ok` and `stalled`: pressed onto the stop. If the calibration has a
        `work_stroke_mm`, they move to that opening instead, and a success is `reached` and not
        `stalled`. Raises as `GripperActions` does.
        """
        return complete(self._core.open(speed_mm_s, progress=progress))

    def close(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Close the jaws to the mechanical stop; everything as for `open` onto the stop."""
        return complete(self._core.close(speed_mm_s, progress=progress))

    def grasp(
        self,
        force_n: float | None = None,
        hold_s: float = 0.0,
        *,
        speed_mm_s: float | None = None,
        width_mm: float | None = None,
        tolerance_mm: float | None = None,
        until: Literal["held", "verdict"] = "held",
        hold_by: Literal["torque", "gains"] | None = None,
        progress: ProgressCallback | None = None,
    ) -> GraspResult:
        """Close until an object stops the jaws, then hold it with `force_n`.

        `force_n`: 0.5 to 40 N, `motion_config.force_n` by default; approximate. For continuous
        work the vendor recommends 20 N: `health` says how long the coil bears more. `hold_s`:
        seconds until this returns; with 0 it does not return by itself while the object is held,
        and an interrupt ends the waiting. The jaws then continue to hold with the same force, until
        the next command or until the motor is disabled (`disconnect` disables it).
        With `until` "verdict" it returns as soon as it has detected an object or none, and
        `hold_s` must be left out.

        `speed_mm_s` is the closing speed, `motion_config.grasp_speed_mm_s` by default. With
        `width_mm`, `tolerance_mm` is required, too: an object whose width differs by more is
        still held, but `ok` is False.
        `hold_by` "gains" holds with `hold_kp` and `hold_kd` around a position, which loses force
        when the object yields.

        Without an object it returns at once, with `ok` False. Raises as `GripperActions` does.
        """
        return complete(
            self._core.grasp(
                force_n,
                hold_s,
                speed_mm_s=speed_mm_s,
                width_mm=width_mm,
                tolerance_mm=tolerance_mm,
                until=until,
                hold_by=hold_by,
                progress=progress,
            )
        )

    def goto(
        self,
        position_mm: float,
        kp: float | None = None,
        kd: float | None = None,
        duration: float | None = 0.5,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to an opening between the fingers, in mm: 0 at the closed stop.

        `duration`: seconds that the way takes, or longer where the fastest speed that fits
        `motion_config` needs more; None moves at `motion_config.speed_mm_s`. `kp` (5 to 500
        N·m/rad) and `kd` (0.1 to 5 N·m·s/rad, and at least kp · 0.002 s) are the calibration's by
        default; a stiffer move presses no harder on what is in its way. A success is `reached` and
        not `stalled`. Raises as `GripperActions` does. A target outside the calibrated travel is
        a `CommandError`; its `data["limit"]` is the travel.
        """
        return complete(self._core.goto(position_mm, kp, kd, duration, progress=progress))

    def goto_rad(
        self,
        position_rad: float,
        kp: float | None = None,
        kd: float | None = None,
        dq_target: float = 0.0,
        tau_feedforward: float = 0.0,
        duration: float | None = 0.5,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a position of the motor, in rad; everything else as for `goto`.

        `dq_target` and `tau_feedforward` must be 0: the daemon computes the velocity of its ramp
        itself, and a torque is given as a force (`set_force`, `grasp`). Others raise
        `CommandError`, reason "unsupported".
        """
        return complete(
            self._core.goto_rad(
                position_rad, kp, kd, dq_target, tau_feedforward, duration, progress=progress
            )
        )

    def move_to(
        self,
        target_rad: float,
        kp: float | None = None,
        kd: float | None = None,
        tau_feedforward: float = 0.0,
        duration: float = 1.0,
    ) -> MoveResult:
        """Move to a position of the motor, in rad, in `duration` seconds: as `goto_rad` does."""
        return complete(self._core.move_to(target_rad, kp, kd, tau_feedforward, duration))

    def goto_openness(
        self,
        openness: float,
        *,
        kp: float | None = None,
        kd: float | None = None,
        duration: float | None = 0.5,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a share of the travel, 0 (closed) to 1 (open); all else as for `goto`."""
        return complete(
            self._core.goto_openness(openness, kp=kp, kd=kd, duration=duration, progress=progress)
        )

    def move_at_speed(
        self,
        target_mm: float,
        speed_mm_s: float = 30.0,
        kp: float | None = None,
        kd: float | None = None,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to an opening in mm at a speed; everything else as for `goto`."""
        return complete(self._core.move_at_speed(target_mm, speed_mm_s, kp, kd, progress=progress))

    def set_force(self, force_n: float, duration: float = 0.3) -> bool:
        """Squeeze with `force_n`, 0.5 to 40 N, ramped; return after `duration` seconds.

        `duration` is 0 to 86 400 (a day). The force stays until the next motion. True if the jaws
        still hold then. What ends a motion ends the wait at once, by the same error; the jaws hold
        after `cancel`.

        It changes the force of a grasp, also while another thread or task of this program waits
        for that grasp. Jaws that hold nothing close until something resists, faster than `grasp`.
        """
        return complete(self._core.set_force(force_n, duration))

    def zero_gravity(self, on: bool = True) -> GripperState:
        """Let the jaws be moved freely by hand, the motor enabled but without any torque.

        They are loose until `zero_gravity(False)`, `hold` or any motion. Until then the state's
        `mode` is "relaxed" and `is_zero_gravity` true, as after `stop` and a stop "relax".
        """
        return complete(self._core.zero_gravity(on))

    def hold(self) -> GripperState:
        """Hold from now on: a held object with its present force, else the measured position."""
        return complete(self._core.hold())

    def stream(
        self,
        valid_s: float = 0.2,
        *,
        speed_mm_s: float | None = None,
        torque_nm: float | None = None,
    ) -> SetpointStream:
        """Begin a stream of targets; the jaws do not move before the first `set_target`.

        `valid_s`: 0.02 to 2 s, after which the jaws hold unless a new target came. `speed_mm_s`
        is how fast they follow at most: `motion_config.speed_mm_s` if that was set, else as fast
        as any motion may be, 150 mm/s. While it holds them back, `limited` of the state has
        "speed". They reach a target when the next one is due. `torque_nm`, 0.1 to 3 N·m, is what
        they press with at most on what stands in their way (1 by default).
        """
        return SetpointStream(
            self._core.stream(valid_s, speed_mm_s=speed_mm_s, torque_nm=torque_nm)
        )

    def send_mit_frame(
        self, q: float, kp: float, kd: float, dq: float = 0.0, tau: float = 0.0
    ) -> bool:
        """Send a set-point for the position `q`, in rad, valid for 0.2 s; not a frame on the bus.

        The jaws follow as those of a `stream`, with `kp` (5 to 500 N·m/rad) and `kd` (0.1 to 5
        N·m·s/rad, at least kp · 0.002 s) or softer, and press with 1 N·m at most. The velocity of
        their path is fed forward: `dq` is not used, but checked.

        With `kp` 0 it is a set-point of the torque `tau` (N·m, positive towards larger radians,
        within what `set_force` allows), at a bounded speed; with `tau` 0 the jaws are slack.

        True when it is sent; a refusal is raised, perhaps by the next call. Raises
        `CommandError` with reason "unsupported" for a `tau` beside a `kp`, and for a speed (`dq`
        and `kd` without `kp`): use `set_force`, or `move_at_speed`.
        """
        return complete(self._core.send_mit_frame(q, kp, kd, dq, tau))

    def record(
        self, duration_s: float, rate_hz: float = 100.0, zero_gravity: bool = True
    ) -> Trajectory:
        """Record for `duration_s` seconds, `rate_hz` samples a second (1 to the control rate).

        With `zero_gravity` **the jaws are slack** for that time, to be pushed by hand, and hold at
        the end; without, it only watches what others make them do: another thread of this program,
        for example. A recording that did not fill raises `CommandError`, reason recording_failed,
        with the number of samples: one that was interrupted, or of which more than a tenth is
        missing. Single measurements may be missing in it, lost on the bus, but never more than
        0.1 s at a stretch: see `longest_gap_s` of the trajectory.

        An interrupt ends the recording before it is raised.
        """
        return complete(self._core.record(duration_s, rate_hz, zero_gravity))

    def record_start(
        self, rate_hz: float = 100.0, zero_gravity: bool = True, max_samples: int | None = None
    ) -> dict[str, Any]:
        """Begin to record in the background, as `record` does; return `trajectory_status()`.

        It ends by `record_stop`, or when `max_samples` (1 to 360 000, which is the default) were
        due; the jaws then hold.
        """
        return complete(self._core.record_start(rate_hz, zero_gravity, max_samples))

    def record_stop(self, allow_empty: bool = False, *, allow_partial: bool = False) -> Trajectory:
        """End the recording and return it.

        Raises `CommandError`, reason recording_failed, for one that was broken off (by a stop, a
        fault of the motor, a silent bus, ...) unless `allow_partial`, and for one without samples
        unless `allow_empty`. What is refused stays until the next recording begins: with
        `allow_partial` a second call returns the samples before the break.
        """
        return complete(self._core.record_stop(allow_empty, allow_partial=allow_partial))

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
        `motion_config.speed_mm_s`; without, they must be there, within 4 mm.
        `repeat` is how often.

        With `force` "replay" the jaws do each of `trajectory.grips` again, as `grasp` does, with
        the taught force and for as long as it lasted, at `motion_config.grasp_speed_mm_s`; what is
        not gripped, or lost, ends the replay with `ok` False and outcome no_object, object_lost or
        motor_weak.
        A trajectory without grips is then refused (`CommandError`).

        `loop` is for `play_start`. An interrupt, or an error of `progress`, cancels the replay
        before it is raised. A path that something blocks gives `ok` False.
        """
        return complete(
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

    def play_start(
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
        held then. It raises what is wrong with the trajectory as `play` does, for it waits until
        the daemon has loaded it, but for a second at most. `error` of `trajectory_status` reports
        later errors, and so do the calls that need a replay.
        """
        return complete(
            self._core.play_start(
                trajectory, speed, kp, kd, loop, align, torque_nm=torque_nm, force=force
            )
        )

    def play_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End the replay; the jaws hold where they are. Return `trajectory_status()`.

        It does nothing where none runs. Raises `CommandError` when it has not ended after
        `timeout` seconds.
        """
        return complete(self._core.play_stop(timeout))

    def play_pause(self) -> dict[str, Any]:
        """Let the replay wait where it is; the jaws hold there. Return `trajectory_status()`.

        Raises `TrajectoryNotActiveError` when none runs. As `play_resume` and `play_speed` it acts
        on whatever replay runs, from another thread or program, too, unless another program has
        the lease.
        """
        return complete(self._core.play_pause())

    def play_resume(self) -> dict[str, Any]:
        """Let the replay continue; return `trajectory_status()`. Raises as `play_pause`."""
        return complete(self._core.play_resume())

    def play_speed(self, speed: float) -> dict[str, Any]:
        """Replay at `speed` from now on, 0.1 to 4 times the taught one; as `play_pause`.

        It is refused (`CommandError`) where the path would be faster than the jaws may be.
        """
        return complete(self._core.play_speed(speed))

    def trajectory_status(self) -> dict[str, Any]:
        """Return the status of the running recording or replay, else of the latest one.

        `active`, `kind` ("record", "play" or None), `samples` and `error` are always there; of a
        recording also `rate_hz`, `zero_gravity`, `loop_hz`, `missed` and `duration_s`, of a replay
        `frames`, `speed`, `openness`, `completed`, `loops`, `phase` and `grips`. `unkept` is None,
        or `samples`, `duration_s` and `error` of a recording that ended and is not kept yet.
        """
        return complete(self._core.trajectory_status())

    def kept_trajectories(self) -> TrajectoryTable:
        """Return what the daemon keeps, by name: `litegripctl trajectories` shows the same.

        It is a list of dictionaries, which prints as a table.

        Of each `name`, `samples`, `duration_s` (s), `sample_hz`, `created_s` (Unix time), `grips`,
        `bytes`, `uid`, and `error`, which says why it cannot be used, or is None.
        """
        return complete(self._core.kept_trajectories())

    def fetch_trajectory(self, name: str) -> Trajectory:
        """Return what the daemon keeps under `name`, to be replayed or saved to a file.

        Raises `TrajectoryNotFoundError` when there is none.
        """
        return complete(self._core.fetch_trajectory(name))

    def keep_trajectory(self, name: str, trajectory: Trajectory) -> dict[str, Any]:
        """Have the daemon keep a trajectory under `name`, in place of any before.

        All programs can replay it then, and it outlives this one. Return its description, with its
        `path` on the daemon's machine. Raises `CommandError` for a name that cannot be, and when
        this user's room is used up.
        """
        return complete(self._core.keep_trajectory(name, trajectory))

    def delete_trajectory(self, name: str) -> None:
        """Have the daemon remove what it keeps under `name`.

        Raises `TrajectoryNotFoundError` when there is none.
        """
        complete(self._core.delete_trajectory(name))

    def teleop_start(
        self,
        mode: str,
        host: str | None = None,
        *,
        only_from: str | None = None,
        align: bool = True,
        align_speed_mm_s: float | None = None,
        lead_cap_mm: float | None = None,
        require_ready: bool = True,
        ready_timeout_s: float | None = None,
        ready_tolerance_mm: float | None = None,
        ready_period_s: float | None = None,
        port: int | None = None,
        grip_id: str | None = None,
        link: str | None = None,
        rate_hz: float | None = None,
        watchdog_s: float | None = None,
        torque_limit_nm: float | None = None,
        force_limit_n: float | None = None,
        kp: float | None = None,
        kd: float | None = None,
        dq_max: float | None = None,
        reflect: bool = False,
        reflect_n: float | None = None,
        reflect_gain: float | None = None,
        fake_leader: bool = False,
        transport: object = None,
    ) -> dict[str, Any]:
        """Lead ("master") or follow ("slave") until `teleop_stop`; return the first status.

        A master's jaws hold until its slave is ready, go slack then, and are moved by hand. A slave
        needs the master's `host`; its jaws go where the master's are, as a share of its own travel:
        calibration and mount may differ.
        Both ends share `port` (17448) and `grip_id` ("gripA"). `link` is "zenoh" (the default)
        or "udp", which only a trusted network is for, and with which the master needs the slave's
        `host`, and a slave's is its own address to listen at (all of them by default; `only_from`
        is the only leader that it listens to). `rate_hz` is how often a master publishes, the
        control rate by default.

        After `watchdog_s` (0.2) without a frame a slave holds its last target. At or over
        `torque_limit_nm` (0: off) for 60 ms it lets go, until the master has reopened by 0.05.
        With `force_limit_n` it pushes by no more; more than 20 N, or 2 N·m, counts as that. `kp`
        and `kd` are the calibration's by default; `dq_max` (10 rad/s) bounds the velocity that is
        fed forward. `fake_leader` follows a synthetic sweep instead of a master.

        With `reflect` a slave sends its force, and a master with `reflect_n` (0, off, to 10 N)
        pushes back with the share `reflect_gain` (0.5) of it: the hand feels what is gripped. Over
        udp a master's `host` may name several slaves, separated by commas.

        A slave first goes to where its master is, at `align_speed_mm_s` (`motion_config.speed_mm_s`
        by default). With `align` false it goes there as fast as the bounds of its lead and its
        force let it; it does not jump either. `lead_cap_mm` (`max_lead_mm`) bounds what its lead
        pushes with: 1.34 N·m a mm, 2 N·m at most; 0 is as far as that.

        It is ready when it follows and its jaws are within `ready_tolerance_mm` (2) of where the
        master's are; it says so every `ready_period_s` (0.1). The first time lets a master's jaws
        go; after `ready_timeout_s` (10; 0: never) they go slack all the same, and
        `ready_timed_out` of the status is true. With `require_ready` false, and over udp, where
        nobody can say so, they are slack at once.

        `transport` is refused: the link is the daemon's.

        It ends with this object's connection. Raises `TeleopNotReady` (not calibrated, not
        enabled), `TeleopBusyError` (it runs already), `TrajectoryBusyError` (a trajectory is
        recorded or replayed) and what `GripperActions` says.
        """
        return complete(
            self._core.teleop_start(
                mode,
                host,
                only_from=only_from,
                align=align,
                align_speed_mm_s=align_speed_mm_s,
                lead_cap_mm=lead_cap_mm,
                require_ready=require_ready,
                ready_timeout_s=ready_timeout_s,
                ready_tolerance_mm=ready_tolerance_mm,
                ready_period_s=ready_period_s,
                port=port,
                grip_id=grip_id,
                link=link,
                rate_hz=rate_hz,
                watchdog_s=watchdog_s,
                torque_limit_nm=torque_limit_nm,
                force_limit_n=force_limit_n,
                kp=kp,
                kd=kd,
                dq_max=dq_max,
                reflect=reflect,
                reflect_n=reflect_n,
                reflect_gain=reflect_gain,
                fake_leader=fake_leader,
                transport=transport,
            )
        )

    def teleop_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End it, if it runs: the jaws hold where they are. Returns the status at the end.

        Raises `ConnectError` when the daemon does not answer within `timeout` seconds. Jaws that
        the torque guard has released stay loose: holding would press what it freed.
        """
        return complete(self._core.teleop_stop(timeout))

    def teleop_status(self) -> dict[str, Any]:
        """Return the status of teleoperation, or of the last one.

        A dictionary with `active`, `mode`, `topic`, `frames`, `last_frame_age_ms`, `stale`,
        `openness`, `position_mm`, `force_n`, `dq_cmd`, `loop_hz`, `rejected`, `send_failed`,
        `fault`, `torque_nm`, `over_torque`, `torque_trips`, `matching`, `ready`, `ready_rx`,
        `ready_pubs`, `ready_timed_out` and more: whether its limits make a slave press less
        (`force_limited`), and, of reflection, `reflected_n`, `followers` and `round_trip_ms`. No
        figure is NaN; those of a frame are 0 while `frames` is 0. `fault` is "" without one.
        """
        return complete(self._core.teleop_status())

    @property
    def config(self) -> GripperConfig:
        """Return limits, gains and ids as the daemon has them now; not to be changed from here.

        Only `max_stroke_mm`, how far the jaws open, may be assigned: this object's `zero`,
        `calibrate` and `manual_calibration` then use it.
        """
        return complete(self._core.config())

    def load_calibration(
        self, path: str | os.PathLike[str] | None = None, template: str | None = None
    ) -> bool:
        """Have the daemon use a calibration, for all its clients; false if none was found.

        `path` is a file of this program's; one of `CALIB_TEMPLATES` is that template. `template`
        is "normal" or "reverse". Without either: the file that LITEGRIP_CALIB of this program's
        environment names; else what the daemon finds for the channel (its own file, or the user's
        whom it runs as); else ~/.litegrip/<channel>_calibration.json and
        ~/.litegrip/litegrip_calibration.json of this program's user; else, for can0, the
        factory's. While any client's motion runs, only the calibration already in use is accepted.
        Gains that a file leaves out are this program's last ones, else the daemon's own.

        Raises `CommandError` when a named calibration cannot be used; never takes another file.
        The daemon logs the closing direction, and a `can_id` that is another motor's; `mount`
        returns the direction, too. Before the first `connect` it connects.
        """
        return complete(self._core.load_calibration(path, template))

    def use_calibration(self, data: CalibrationData) -> bool:
        """Have the daemon use these limits and gains, for all its clients; true.

        Nothing is saved. Raises `CommandError` when they cannot be used.
        """
        return complete(self._core.use_calibration(data))

    def load_template(self, name: str) -> bool:
        """Have the daemon use the nominal geometry of a mount, "normal" or "reverse".

        The daemon logs the closing direction; `mount` returns it, too. Raises `CommandError` for
        another name, and when the daemon cannot use it.
        """
        return complete(self._core.load_template(name))

    def save_calibration(self, path: str | os.PathLike[str] | None = None) -> str:
        """Save the calibration in use; return the path.

        With `path`, or LITEGRIP_CALIB, to that file of this program's; else the daemon saves it
        where it finds it at its next start. Raises `CommandError` when there is none, or when
        the file cannot be written.
        """
        return complete(self._core.save_calibration(path))

    def rescale_calibration(self, stroke_mm: float | None = None) -> CalibrationData:
        """Correct the millimetres of the calibration in use: the jaws open `stroke_mm`.

        That is what a caliper measures; `config.max_stroke_mm` by default. `rad_to_mm` follows, the
        limits stay, and nothing moves. `save_calibration` saves it.
        """
        return complete(self._core.rescale_calibration(stroke_mm))

    def zero(
        self,
        *,
        mount: str | None = None,
        stroke_mm: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> CalibrationData:
        """Measure the travel by probing both stops, use it and save it.

        Keep hands and objects out of the jaws. The calibration in use, or `mount`,
        determines which stop is the closed one. `stroke_mm` is how far the jaws open, as a caliper
        measures it; `config.max_stroke_mm` by default. `rad_to_mm` follows from it, so if it is
        wrong, all millimetres are: `rescale_calibration` corrects them. The probe uses
        `motion_config.calib_*`. The daemon saves the result; this program saves it too if
        LITEGRIP_CALIB names a file. Prints its progress, unless `progress` is given.

        Raises `HardwareError` when no plausible travel was found, `CommandError` when it was not
        saved, and the errors of `GripperActions`.
        """
        return complete(self._core.zero(mount=mount, stroke_mm=stroke_mm, progress=progress))

    def calibrate(
        self,
        kp: float | None = None,
        kd: float | None = None,
        step_rad: float | None = None,
        stall_delta: float | None = None,
        stall_cycles: int | None = None,
        max_iter: int | None = None,
        tau_limit: float | None = None,
        *,
        mount: str | None = None,
        stroke_mm: float | None = None,
        progress: ProgressCallback | None = None,
    ) -> CalibrationData:
        """Measure the travel as `zero` does and use it, but do not save it.

        The probe uses the arguments (N·m/rad, N·m·s/rad, rad, N·m), not `motion_config`. The
        daemon's defaults replace arguments that are left out.
        """
        return complete(
            self._core.calibrate(
                kp,
                kd,
                step_rad,
                stall_delta,
                stall_cycles,
                max_iter,
                tau_limit,
                mount=mount,
                stroke_mm=stroke_mm,
                progress=progress,
            )
        )

    def manual_calibration(self) -> ManualCalibration:
        """Calibrate by hand, for `with`: the jaws are loose until its end.

        Move them to each stop and mark it: see `ManualCalibration`.
        """
        return ManualCalibration(self._core.manual_calibration())


class BlockingGripper(GripperActions):
    """The actions, the connection, the lease, the stop, and what can be asked."""

    _core: core_gripper.Gripper

    def connect(self) -> bool:
        """Connect to the daemon, unless connected, and load the constructor's `mount`; true.

        Raises `ConnectError` when no daemon answers (its hint says how to start one). Raises
        `CommandError` when the daemon has another channel or CAN id, or cannot load the mount.
        While another client moves the gripper, or where this user may only watch, the mount is
        not loaded, and a warning is logged; `enable` loads it then.
        """
        return complete(self._core.connect())

    def disconnect(self) -> None:
        """Disconnect; first disable the motor if this object enabled it.

        The motor stays enabled if `disable_on_disconnect` is false. Raises the error of
        disabling, but closes the connection in any case.
        """
        complete(self._core.disconnect())

    def __exit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        complete(self._core.__aexit__(_kind, error, _))

    @property
    def is_connected(self) -> bool:
        """True if calls can be made."""
        return self._core.is_connected

    @property
    def channel(self) -> str:
        """The daemon's channel; where a socket alone is named, its path before `connect`."""
        return self._core.channel

    @property
    def socket_path(self) -> str | None:
        """The daemon's socket: of the connection, else what the constructor was given, or None."""
        return self._core.socket_path

    @property
    def disable_on_disconnect(self) -> bool:
        """True if the end of the connection disables the motor that this object enabled.

        `disconnect` uses the present value; after a crash the value at `enable` counts.
        """
        return self._core.disable_on_disconnect

    @disable_on_disconnect.setter
    def disable_on_disconnect(self, value: bool) -> None:
        self._core.disable_on_disconnect = value

    def lease(
        self,
        purpose: str | None = None,
        *,
        ttl_s: float | None = None,
        wait_s: float = 0.0,
        on_lost: str | None = None,
    ) -> Lease:
        """Take the lease, for exclusive control: `with gripper.lease("sorting", wait_s=10):`.

        Without a block nothing is taken before `acquire` of what is returned, until its `release`.
        `enable` takes the lease automatically, until `disconnect`.
        `wait_s` is how long to wait for another owner. With `ttl_s` the lease is lost when no
        call is made for that time; a longer motion is ended. `on_lost` is what the jaws do when
        the lease is lost: "hold", "relax" or "disable" (default: what `enable` has said, before
        or after, which is "disable" with `disable_on_disconnect`; without it "hold"). In a
        take-over, the new owner decides.
        Raises `LeaseError`, which names the owner. After a loss, `disable` and every motion raise
        `LeaseError` (`lease_lost`) until `lease` or `enable` takes the lease again. The end of who
        had enabled before then disables the motor again, whoever has enabled it meanwhile.
        """
        return Lease(self._core.lease(purpose, ttl_s=ttl_s, wait_s=wait_s, on_lost=on_lost))

    def take_lease(self, why: str = "no reason given", *, jaws: str = "hold") -> None:
        """Take the lease from its present owner; the owner is notified of the reason `why`.

        The motion that runs ends, also one without a lease, and nothing that others have queued
        begins. Who has lost by that gets `LeaseError` (`lease_lost`) until it takes the lease. The
        jaws then keep what they hold, or follow `jaws`: "relax" (no torque) or "disable". A motor
        that is enabled is this object's to disable at its end, as after its own `enable`.

        Raises `NotPermittedError` unless the owner is the same user, or this user is an admin in
        the daemon's configuration.
        """
        complete(self._core.take_lease(why, jaws=jaws))

    def cancel(self) -> bool:
        """Cancel this object's own motion: the jaws hold; true if one was cancelled.

        Who waits for the motion, or sends a stream of targets, gets `CancelledError`. What this
        object has begun in the background (a replay, a recording, teleoperation) ends as well.
        Any thread or task may call it, and a signal handler while its thread waits for the motion:
        there it returns at once, true, and the motion ends a moment later. Nothing is latched, and
        what other objects and programs move goes on.
        """
        return complete(self._core.cancel())

    def stop(self) -> None:
        """Take the torque off the jaws at once; they are slack until the next motion.

        It ends this object's own motion and latches nothing: the next motion may begin. A motor
        that is disabled has no torque already.

        If the gripper is not this object's to move (another client has the lease, or moves it, or
        this user may not), it is stopped all the same, by `software_stop("relax")`, which is
        latched. A warning is logged then. The same happens in a signal handler whose thread waits
        for a motion.
        """
        complete(self._core.stop())

    def software_stop(
        self, level: Literal["hold", "relax", "disable"] = "hold", why: str | None = None
    ) -> GripperState:
        """Stop the gripper, whichever client moves it, until `clear_stop`.

        `level` is "hold", "relax" or "disable". Any thread may call it, and also a signal
        handler while its thread waits for a motion. The stop uses the daemon's stop socket, which
        other requests cannot delay; there a reason is cut to 80 characters. Without that socket it
        is sent as a usual request; without a connection it connects by itself. This is a software
        stop: it does not replace the switch that cuts the power.

        Raises `CANTimeoutError` if the stop is latched, but the motor does not answer, enabled or
        not: then nothing reaches it, so cut its power. Raises `ConnectError` if none confirms the
        stop, after about 2 s on this machine, 5 s where this object must connect first: the stop
        may still act, so cut the power, too. Wrong arguments raise their error after the gripper
        was stopped ("hold").
        """
        return complete(self._core.software_stop(level, why))

    def clear_stop(self) -> GripperState:
        """Clear a stop: the motor may then be enabled and moved again. Moves nothing.

        Raises `StoppedError` (`sent_before_stop`) for a stop that this object did not know of:
        look at the state, and clear again.
        """
        return complete(self._core.clear_stop())

    def get_state(self, wait: bool = True) -> GripperState:
        """Return the daemon's newest state; it never waits for the bus. Look at `stale`.

        `wait` makes no difference: the daemon asks the motor in every period, also while nobody
        calls, so the state is as new as one that was waited for.
        """
        return complete(self._core.get_state(wait))

    def health(self) -> HealthReport:
        """Return the daemon's health: its verdict, the bus, the ticks, the clients.

        `reasons` say why the verdict is not "ok"; `notes` what is normal and worth knowing. It is
        a dictionary, which prints line by line.
        """
        return complete(self._core.health())

    def info(self) -> dict[str, Any]:
        """Return what does not change: versions, the motor's registers, ranges, calibration."""
        return complete(self._core.info())

    def dump(self, note: str | None = None) -> str:
        """Write the last minute, tick by tick, to a file; return its path on the daemon's machine.

        `litegripctl plot` draws it, and so does the page in the browser; it is an MCAP file. `note`
        says in it what it is of. Raises `CommandError` when it cannot be written.
        """
        return complete(self._core.dump(note))

    def jobs(self) -> JobTable:
        """Return the running jobs and the ended ones that are still kept, of all clients.

        It is a list of dictionaries, which prints as a table.
        """
        return complete(self._core.jobs())

    @property
    def mount(self) -> str | None:
        """Return which way the motor is mounted, "normal" or "reverse"; None until calibrated.

        Before the first `connect` it connects.
        """
        return complete(self._core.mount())
