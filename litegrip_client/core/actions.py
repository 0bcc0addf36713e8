"""The actions of a gripper: what a program asks of it, written once, as coroutines.

They only send requests; the daemon decides and moves. `threads/actions.py`, for threads, is
generated from this file: its docstrings are written for both.
"""

from __future__ import annotations

from litegrip_client.core.motion import (
    Motion,
    SetpointStream,
    check_no_feedforward,
    frame_target,
    stay,
)
from litegrip_client.core.session import ACTION_TIMEOUT_S, DaemonSession, naming_the_danger
from litegrip_client.values.checks import (
    RANGES,
    check_callback,
    flag,
    given_numbers,
    in_range,
    integer,
    number,
    time_limit,
)
from litegrip_client.values.errors import CommandError, LiteGripError, ParameterError
from litegrip_client.values.motion_config import MotionConfig
from litegrip_client.values.results import (
    EnableResult,
    GraspResult,
    GripperState,
    MoveProgress,
    MoveResult,
    PlayResult,
    SetZeroResult,
)
from litegrip_client.values.terms import Called

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: what is seldom needed takes its time to import
    import os
    from collections.abc import Callable, Mapping
    from typing import Any, Literal, TypeAlias

    from litegrip_client.core.calibrations import ManualCalibration
    from litegrip_client.core.session import Wire
    from litegrip_client.core.trajectories import Trajectories
    from litegrip_client.values.calibration import CalibrationData, GripperConfig
    from litegrip_client.values.printed import TrajectoryTable
    from litegrip_client.values.trajectory import Trajectory

    ProgressCallback: TypeAlias = Callable[[MoveProgress], None]
    """Called where the call was made, at most 20 times a second."""

_LONGEST_WAIT_S = 86_400.0
"""A day, as the longest `hold_s` of a grasp."""

_FRAME_VALID_S = 0.2


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

    def __init__(
        self,
        session: DaemonSession,
        motion_config: MotionConfig | None = None,
        config: GripperConfig | None = None,
    ) -> None:
        """Raise `CommandError` for what is no `MotionConfig`. `config` is the program's own."""
        self._session = session
        self._own_config = config
        self._frames: SetpointStream | None = None
        self._kept_trajectories: Trajectories | None = None
        self._mount_due: str | None = None
        self.motion_calibration = None
        self.motion_config = MotionConfig() if motion_config is None else motion_config

    @property
    def motion_config(self) -> MotionConfig:
        """The tunables of this object's motions: what was set in them is sent with each call."""
        return self._motion_config

    @motion_config.setter
    def motion_config(self, value: MotionConfig) -> None:
        if not isinstance(value, MotionConfig):
            raise ParameterError(
                f"motion_config is {value!r:.60}, it must be a MotionConfig",
                reason="invalid_params",
                data={"parameter": "motion_config"},
            )
        self._motion_config = value

    @property
    def motion_calibration(self) -> Mapping[str, float] | None:
        """What this object's motions count on in place of the daemon's calibration, or None.

        It has the keys of a calibration file: `zero_position_rad` (closed), `max_position_rad`
        (open) and `rad_to_mm`, and perhaps `work_stroke_mm`, `kp` and `kd`. It is sent with each
        motion, and changes nothing for other clients; the state's millimetres are the daemon's. The
        daemon refuses what `load_calibration` would refuse.
        """
        return self._motion_calibration

    @motion_calibration.setter
    def motion_calibration(self, value: Mapping[str, float] | None) -> None:
        self._motion_calibration = value

    # The motor

    async def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor; true if its status says so.

        `retries`: enable commands at most, 1 to 20; None means `motion_config.enable_retries`.
        It takes the lease: until the gripper is disconnected no other client moves it. An older
        object of the same program hands it over between motions, if `enable` gave it the lease.
        If this process ends without disabling the motor, the daemon disables it, or continues to
        hold, according to the present `disable_on_disconnect`. Raises `LeaseError`, which names
        the owner, when another client has the lease, `StoppedError` while a stop is latched and
        `HardwareError` when the motor or the bus does not work.
        """
        session = self._session
        wire = session.wire
        params = {} if retries is None else {"retries": integer("retries", retries)}
        params = self._tuned(params, only="enable_")
        call = wire.connection.prepare_guarded("motor.enable", params)
        await session.acquire_to_enable("disable" if session.disable_on_disconnect else "hold")
        if self._mount_due is not None:
            await self._load_mount(wire)
        before = session.enabled_here, session.keeps_lease
        # Also if the answer never comes: the motor may be enabled.
        session.enabled_here = session.keeps_lease = True
        try:
            result = EnableResult.from_wire(await wire.run(call, ACTION_TIMEOUT_S), session.voice)
        except LiteGripError:
            if call.answered:
                await self._undo_enable(*before)
            raise
        if not result.ok:
            await self._undo_enable(*before)
        return result

    async def _load_mount(self, wire: Wire) -> None:
        """Have the daemon use the nominal calibration of the constructor's `mount`."""
        call = wire.connection.prepare_guarded("calibration.load", {"template": self._mount_due})
        await wire.run(call, ACTION_TIMEOUT_S)
        self._mount_due = None

    async def _undo_enable(self, was_enabled_here: bool, kept_lease: bool) -> None:
        self._session.enabled_here, self._session.keeps_lease = was_enabled_here, kept_lease
        await self._session.let_go()

    async def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed.

        Raises `CommError` if the motor cannot be reached: it may be enabled, so cut its power.
        """
        with naming_the_danger(self._session.here):
            done = (await self._ask("motor.disable"))["ok"] is True
        if done:
            self._session.enabled_here = False
        return done

    async def clear_fault(self, *, enable: bool = True) -> bool:
        """Clear the motor's latched fault and enable the motor; true if it is enabled.

        The motor holds the measured position then; `enable` describes what else that means. With
        `enable` false it stays disabled, and true means that no fault is left. An enabled motor
        has no fault: nothing happens. This also accepts a position that has jumped: check first
        where the jaws are. Raises `HardwareError` with a fault that cannot be cleared.
        """
        enables = flag("enable", enable)
        state = GripperState.from_wire(await self._session.wire.call("state.get"))
        if state.enabled is True and not state.stale:
            return True
        await self._ask("motor.clear_fault")
        self._session.enabled_here = False
        return bool(await self.enable()) if enables else True

    async def read_param(self, register: str | int) -> float:
        """Read a register of the motor, by name ("PMAX") or number (21); nothing is written.

        Raises `CommandError` for one that is not known.
        """
        name = register if isinstance(register, str) else str(integer("register", register))
        value: float = (await self._ask("motor.read_register", {"register": name}))["value"]
        return value

    async def set_zero(self) -> SetZeroResult:
        """Store the present position as the motor's zero, permanently; disables the motor first.

        The calibration is then invalid: motions are refused until the gripper is calibrated
        again, by `zero` or `manual_calibration`.
        """
        answer = await self._command("motor.set_zero", {}, ACTION_TIMEOUT_S)
        result = SetZeroResult.from_wire(answer)
        if result.ok:
            self._session.enabled_here = False
        return result

    # Motions

    async def open(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Open the jaws to the mechanical stop, at `speed_mm_s` or `motion_config`'s.

        A success is `ok` and `stalled`: pressed onto the stop. If the calibration has a
        `work_stroke_mm`, they move to that opening instead, and a success is `reached` and not
        `stalled`. Raises as `GripperActions` does.
        """
        return await self._move("motion.open", given_numbers(speed_mm_s=speed_mm_s), progress)

    async def close(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Close the jaws to the mechanical stop; everything as for `open` onto the stop."""
        return await self._move("motion.close", given_numbers(speed_mm_s=speed_mm_s), progress)

    async def grasp(
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
        params: dict[str, Any] = given_numbers(
            force_n=force_n,
            hold_s=hold_s,
            speed_mm_s=speed_mm_s,
            width_mm=width_mm,
            tolerance_mm=tolerance_mm,
        )
        if until != "held":
            params["until"] = until
            if hold_s == 0.0:  # the default, which the verdict does not go with
                del params["hold_s"]
        if hold_by is not None:
            params["hold_by"] = hold_by
        result = await self._run("motion.grasp", self._configured(params), progress)
        return GraspResult.from_wire(result)

    async def goto(
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
        target = {"opening_mm": number("position_mm", position_mm)}
        target |= _pace(kp, kd, duration)
        return await self._move("motion.move", target, progress)

    async def goto_rad(  # noqa: PLR0917 - the vendor's, by position
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
        check_no_feedforward("goto_rad", dq_target=dq_target, tau_feedforward=tau_feedforward)
        target = {"position_rad": number("position_rad", position_rad)}
        target |= _pace(kp, kd, duration)
        return await self._move(Called("motion.move", "goto_rad"), target, progress)

    async def move_to(
        self,
        target_rad: float,
        kp: float | None = None,
        kd: float | None = None,
        tau_feedforward: float = 0.0,
        duration: float = 1.0,
    ) -> MoveResult:
        """Move to a position of the motor, in rad, in `duration` seconds: as `goto_rad` does."""
        check_no_feedforward("move_to", tau_feedforward=tau_feedforward)
        target = {"position_rad": number("target_rad", target_rad)}
        target |= _pace(kp, kd, duration)
        called = Called("motion.move", "move_to", position_rad="target_rad")
        return await self._move(called, target, None)

    async def goto_openness(
        self,
        openness: float,
        *,
        kp: float | None = None,
        kd: float | None = None,
        duration: float | None = 0.5,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a share of the travel, 0 (closed) to 1 (open); all else as for `goto`."""
        target = {"openness": number("openness", openness)}
        target |= _pace(kp, kd, duration)
        return await self._move(Called("motion.move", "goto_openness"), target, progress)

    async def move_at_speed(
        self,
        target_mm: float,
        speed_mm_s: float = 30.0,
        kp: float | None = None,
        kd: float | None = None,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to an opening in mm at a speed; everything else as for `goto`."""
        target = {"opening_mm": number("target_mm", target_mm)}
        target |= given_numbers(speed_mm_s=speed_mm_s, kp=kp, kd=kd)
        called = Called("motion.move", "move_at_speed", opening_mm="target_mm")
        return await self._move(called, target, progress)

    async def set_force(self, force_n: float, duration: float = 0.3) -> bool:
        """Squeeze with `force_n`, 0.5 to 40 N, ramped; return after `duration` seconds.

        `duration` is 0 to 86 400 (a day). The force stays until the next motion. True if the jaws
        still hold then. What ends a motion ends the wait at once, by the same error; the jaws hold
        after `cancel`.

        It changes the force of a grasp, also while another thread or task of this program waits
        for that grasp. Jaws that hold nothing close until something resists, faster than `grasp`.
        """
        wait_s = number("duration", duration)
        if not 0.0 <= wait_s <= _LONGEST_WAIT_S:
            text = f"duration is {wait_s:g}, it must be 0 to {_LONGEST_WAIT_S:g} s"
            raise ParameterError(text, reason="invalid_params", data={"parameter": "duration"})
        params = self._configured({"force_n": number("force_n", force_n)})
        state = state_of(await self._command("motion.set_force", params))
        if wait_s > 0.0:
            await stay(self._session, state.stop_generation, wait_s)
            state = GripperState.from_wire(await self._session.wire.call("state.get"))
        return state.force_set_n is not None

    async def zero_gravity(self, on: bool = True) -> GripperState:
        """Let the jaws be moved freely by hand, the motor enabled but without any torque.

        They are loose until `zero_gravity(False)`, `hold` or any motion. Until then the state's
        `mode` is "relaxed" and `is_zero_gravity` true, as after `stop` and a stop "relax".
        """
        method = "motion.zero_gravity" if flag("on", on) else "motion.hold"
        return state_of(await self._command(method, {}))

    async def hold(self) -> GripperState:
        """Hold from now on: a held object with its present force, else the measured position."""
        return state_of(await self._command("motion.hold", {}))

    # Set-points: targets that a program sends again and again, each valid for a short time only

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
        given = {"speed_mm_s": speed_mm_s, "torque_nm": torque_nm}
        limits = self._limits() | {
            name: in_range(name, value, *RANGES[name])
            for name, value in given.items()
            if value is not None
        }
        tuned = "speed_mm_s" if speed_mm_s is None and "speed_mm_s" in limits else None
        return SetpointStream(self._session, valid_s, limits, self._end_frames, tuned=tuned)

    async def send_mit_frame(
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
        target = frame_target(q, kp, kd, dq, tau)
        if self._frames is None:
            self._frames = SetpointStream(
                self._session, _FRAME_VALID_S, self._limits(), is_told_at_end=False
            )
        await self._frames.set_target(**target)
        return True

    def _limits(self) -> dict[str, Any]:
        """Return the tunable speed if it was set, the only tunable of streams, and the limits."""
        config = self._motion_config.to_wire()
        return self._calibrated({name: config[name] for name in ("speed_mm_s",) if name in config})

    async def _end_frames(self) -> None:
        """End the stream of `send_mit_frame`, so that another request can begin."""
        if self._frames is not None:
            frames, self._frames = self._frames, None
            await frames.close()

    # Trajectories: motions, captured once and repeated later. Recording and replay exclude each
    # other and every other motion (`TrajectoryBusyError`, `BusyError`), need an enabled motor
    # (`HardwareError`) and a calibration (`CommandError`), and end with the connection.

    async def record(
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
        is_slack = flag("zero_gravity", zero_gravity)
        recording = self._trajectories.recording(duration_s, rate_hz, is_slack)
        if is_slack:
            await self._end_frames()
        return await self._trajectories.fetch(await recording.run())

    async def record_start(
        self, rate_hz: float = 100.0, zero_gravity: bool = True, max_samples: int | None = None
    ) -> dict[str, Any]:
        """Begin to record in the background, as `record` does; return `trajectory_status()`.

        It ends by `record_stop`, or when `max_samples` (1 to 360 000, which is the default) were
        due; the jaws then hold.
        """
        is_slack = flag("zero_gravity", zero_gravity)
        params = {"rate_hz": number("rate_hz", rate_hz), "zero_gravity": is_slack}
        if max_samples is not None:
            params["max_samples"] = integer("max_samples", max_samples)
        if is_slack:
            await self._end_frames()
        return await self._trajectories.begin(self._calibrated(params))

    async def record_stop(
        self, allow_empty: bool = False, *, allow_partial: bool = False
    ) -> Trajectory:
        """End the recording and return it.

        Raises `CommandError`, reason recording_failed, for one that was broken off (by a stop, a
        fault of the motor, a silent bus, ...) unless `allow_partial`, and for one without samples
        unless `allow_empty`. What is refused stays until the next recording begins: with
        `allow_partial` a second call returns the samples before the break.
        """
        params = {"allow_empty": flag("allow_empty", allow_empty)}
        if flag("allow_partial", allow_partial):
            params["allow_partial"] = True
        return await self._trajectories.end(params)

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
        if flag("loop", loop):
            raise ParameterError(
                "play returns at the end, which a loop does not have",
                reason="invalid_params",
                data={"parameter": "loop", "hint": "use play_start(trajectory, loop=True)"},
            )
        params = _play_params(speed, kp, kd, align, torque_nm, force)
        params["repeat"] = integer("repeat", repeat)
        params.update(await self._trajectories.upload(trajectory))
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
        """Begin to replay in the background, as `play` does; return `trajectory_status()`.

        With `loop` it continues until `play_stop`; a trajectory of one sample is a pose, which is
        held then. It raises what is wrong with the trajectory as `play` does, for it waits until
        the daemon has loaded it, but for a second at most. `error` of `trajectory_status` reports
        later errors, and so do the calls that need a replay.
        """
        params = _play_params(speed, kp, kd, align, torque_nm, force)
        # It must end with the connection. A motion for which nobody waits does not.
        params |= {"loop": flag("loop", loop), "wait": False, "detach": False}
        params.update(await self._trajectories.upload(trajectory))
        begun = await self._command("trajectory.play", self._configured(params))
        return await self._trajectories.begun(int(begun["job"]))

    async def play_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End the replay; the jaws hold where they are. Return `trajectory_status()`.

        It does nothing where none runs. Raises `CommandError` when it has not ended after
        `timeout` seconds.
        """
        return await self._trajectories.end_replay(time_limit("timeout", timeout))

    async def play_pause(self) -> dict[str, Any]:
        """Let the replay wait where it is; the jaws hold there. Return `trajectory_status()`.

        Raises `TrajectoryNotActiveError` when none runs. As `play_resume` and `play_speed` it acts
        on whatever replay runs, from another thread or program, too, unless another program has
        the lease.
        """
        return await self._control({"action": "pause"})

    async def play_resume(self) -> dict[str, Any]:
        """Let the replay continue; return `trajectory_status()`. Raises as `play_pause`."""
        return await self._control({"action": "resume"})

    async def play_speed(self, speed: float) -> dict[str, Any]:
        """Replay at `speed` from now on, 0.1 to 4 times the taught one; as `play_pause`.

        It is refused (`CommandError`) where the path would be faster than the jaws may be.
        """
        return await self._control({"action": "speed", "speed": number("speed", speed)})

    async def _control(self, params: dict[str, Any]) -> dict[str, Any]:
        try:
            await self._command("trajectory.control", params)
        except CommandError as error:
            raise await self._trajectories.not_playing(error) from None
        return await self.trajectory_status()

    async def trajectory_status(self) -> dict[str, Any]:
        """Return the status of the running recording or replay, else of the latest one.

        `active`, `kind` ("record", "play" or None), `samples` and `error` are always there; of a
        recording also `rate_hz`, `zero_gravity`, `loop_hz`, `missed` and `duration_s`, of a replay
        `frames`, `speed`, `openness`, `completed`, `loops`, `phase` and `grips`. `unkept` is None,
        or `samples`, `duration_s` and `error` of a recording that ended and is not kept yet.
        """
        return await self._trajectories.status()

    async def kept_trajectories(self) -> TrajectoryTable:
        """Return what the daemon keeps, by name: `litegripctl trajectories` shows the same.

        It is a list of dictionaries, which prints as a table.

        Of each `name`, `samples`, `duration_s` (s), `sample_hz`, `created_s` (Unix time), `grips`,
        `bytes`, `uid`, and `error`, which says why it cannot be used, or is None.
        """
        from litegrip_client.values.printed import TrajectoryTable  # noqa: PLC0415 - see above

        return TrajectoryTable(await self._trajectories.kept())

    async def fetch_trajectory(self, name: str) -> Trajectory:
        """Return what the daemon keeps under `name`, to be replayed or saved to a file.

        Raises `TrajectoryNotFoundError` when there is none.
        """
        return await self._trajectories.fetch_named(name)

    async def keep_trajectory(self, name: str, trajectory: Trajectory) -> dict[str, Any]:
        """Have the daemon keep a trajectory under `name`, in place of any before.

        All programs can replay it then, and it outlives this one. Return its description, with its
        `path` on the daemon's machine. Raises `CommandError` for a name that cannot be, and when
        this user's room is used up.
        """
        return await self._trajectories.keep(name, trajectory)

    async def delete_trajectory(self, name: str) -> None:
        """Have the daemon remove what it keeps under `name`.

        Raises `TrajectoryNotFoundError` when there is none.
        """
        await self._session.wire.call("trajectory.delete", {"name": name}, ACTION_TIMEOUT_S)

    @property
    def _trajectories(self) -> Trajectories:
        if self._kept_trajectories is None:
            from litegrip_client.core.trajectories import Trajectories  # noqa: PLC0415 - see above

            self._kept_trajectories = Trajectories(self._session)
        return self._kept_trajectories

    # Teleoperation: one gripper goes where another one's jaws are moved by hand

    async def teleop_start(
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
        if transport is not None:
            raise CommandError(
                "a transport of the caller's own cannot be used: the link is the daemon's, so that"
                " it continues while a script is late",
                reason="unsupported",
                data={"parameter": "transport", "hint": 'leave it out, or take link="udp"'},
            )
        params: dict[str, Any] = {"mode": mode}
        listens = (mode, link) == ("slave", "udp")
        texts = {"grip_id": grip_id, "link": link}
        texts |= {"bind": host, "host": only_from} if listens else {"host": host}
        if only_from is not None and not listens:
            text = 'only_from is for a slave with link="udp"; with zenoh it connects to its host'
            raise ParameterError(text, reason="invalid_params", data={"parameter": "only_from"})
        params |= {name: value for name, value in texts.items() if value is not None}
        if port is not None:
            params["port"] = integer("port", port)
        params |= given_numbers(
            rate_hz=rate_hz,
            watchdog_s=watchdog_s,
            torque_limit_nm=torque_limit_nm,
            force_limit_n=force_limit_n,
            kp=kp,
            kd=kd,
            dq_max=dq_max,
            reflect_n=reflect_n,
            reflect_gain=reflect_gain,
            align_speed_mm_s=align_speed_mm_s,
            lead_cap_mm=lead_cap_mm,
            ready_timeout_s=ready_timeout_s,
            ready_tolerance_mm=ready_tolerance_mm,
            ready_period_s=ready_period_s,
        )
        if flag("reflect", reflect):
            params["reflect"] = True
        if flag("fake_leader", fake_leader):
            params["fake_leader"] = True
        if not flag("align", align):
            params["align"] = False
        if not flag("require_ready", require_ready):
            params["require_ready"] = False
        config = self._motion_config.to_wire()
        if config:
            params["config"] = config
        return _of_sdk(await self._command("teleop.start", self._calibrated(params)))

    async def teleop_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End it, if it runs: the jaws hold where they are. Returns the status at the end.

        Raises `ConnectError` when the daemon does not answer within `timeout` seconds. Jaws that
        the torque guard has released stay loose: holding would press what it freed.
        """
        timeout_s = time_limit("timeout", timeout)
        return _of_sdk(await self._session.wire.call("teleop.stop", None, timeout_s))

    async def teleop_status(self) -> dict[str, Any]:
        """Return the status of teleoperation, or of the last one.

        A dictionary with `active`, `mode`, `topic`, `frames`, `last_frame_age_ms`, `stale`,
        `openness`, `position_mm`, `force_n`, `dq_cmd`, `loop_hz`, `rejected`, `send_failed`,
        `fault`, `torque_nm`, `over_torque`, `torque_trips`, `matching`, `ready`, `ready_rx`,
        `ready_pubs`, `ready_timed_out` and more: whether its limits make a slave press less
        (`force_limited`), and, of reflection, `reflected_n`, `followers` and `round_trip_ms`. No
        figure is NaN; those of a frame are 0 while `frames` is 0. `fault` is "" without one.
        """
        return _of_sdk(await self._session.wire.call("teleop.status"))

    # The calibration: which way closing is, and how far it is. There is one, the daemon's, for all
    # its clients. Files are the client's, where a path is given or LITEGRIP_CALIB names one.
    # Every action raises `BusyError` while a motion runs.

    async def config(self) -> GripperConfig:
        """Return limits, gains and ids as the daemon has them now; not to be changed from here.

        Only `max_stroke_mm`, how far the jaws open, may be assigned: this object's `zero`,
        `calibrate` and `manual_calibration` then use it.
        """
        from litegrip_client.values.calibration import GripperConfig  # noqa: PLC0415 - see above

        info = await self._session.wire.call("info.get")
        if self._own_config is None:
            self._own_config = GripperConfig()
        return GripperConfig.from_wire(info, self._own_config)

    async def load_calibration(
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
        from litegrip_client.core import calibrations  # noqa: PLC0415 - see above

        await self._session.open_first()
        return await calibrations.load(self._session, self._command, path, template)

    async def use_calibration(self, data: CalibrationData) -> bool:
        """Have the daemon use these limits and gains, for all its clients; true.

        Nothing is saved. Raises `CommandError` when they cannot be used.
        """
        from litegrip_client.core import calibrations  # noqa: PLC0415 - see above

        return await calibrations.use(self._session, self._command, data)

    async def load_template(self, name: str) -> bool:
        """Have the daemon use the nominal geometry of a mount, "normal" or "reverse".

        The daemon logs the closing direction; `mount` returns it, too. Raises `CommandError` for
        another name, and when the daemon cannot use it.
        """
        from litegrip_client.core import calibrations  # noqa: PLC0415 - see above

        return await calibrations.load(self._session, self._command, None, name)

    async def save_calibration(self, path: str | os.PathLike[str] | None = None) -> str:
        """Save the calibration in use; return the path.

        With `path`, or LITEGRIP_CALIB, to that file of this program's; else the daemon saves it
        where it finds it at its next start. Raises `CommandError` when there is none, or when
        the file cannot be written.
        """
        from litegrip_client.core import calibrations  # noqa: PLC0415 - see above

        return await calibrations.save_calibration(self._session, path)

    async def rescale_calibration(self, stroke_mm: float | None = None) -> CalibrationData:
        """Correct the millimetres of the calibration in use: the jaws open `stroke_mm`.

        That is what a caliper measures; `config.max_stroke_mm` by default. `rad_to_mm` follows, the
        limits stay, and nothing moves. `save_calibration` saves it.
        """
        from litegrip_client.core import calibrations  # noqa: PLC0415
        from litegrip_client.values.calibration import CalibrationData  # noqa: PLC0415 - see above

        view = await self._command("calibration.rescale", self._stroke(stroke_mm))
        calibrations.warn_of_doubts(view, self._session.voice)
        return CalibrationData.from_content(view["content"])

    async def zero(
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
        from litegrip_client.values import calibration_files as files  # noqa: PLC0415 - see above

        target = files.environment_path()
        if target is not None:
            files.check_writable(target)
        params = self._tuned({"save": True, **self._stroke(stroke_mm)})
        try:
            data = await self._probe("calibration.zero", params, mount, progress)
        except LiteGripError as error:
            if self._session.voice(None, "config", "calibration.zero") == "motion_config":
                own = "raise gripper.motion_config.calib_"
                error.message = error.message.replace("raise calib_", own)
                error.args = (error.message,)
            raise
        if target is not None:
            await self.save_calibration(target)
        return data

    async def calibrate(  # noqa: PLR0917 - the vendor's, by position
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
        given = given_numbers(
            kp=kp, kd=kd, step_rad=step_rad, tau_limit=tau_limit, stall_delta=stall_delta
        )
        for name, value in (("stall_cycles", stall_cycles), ("max_iter", max_iter)):
            if value is not None:
                given[name] = integer(name, value)
        params: dict[str, Any] = {"save": False, **self._stroke(stroke_mm)}
        if given:
            params["config"] = {f"calib_{name}": value for name, value in given.items()}
        called = Called("calibration.zero", "calibrate")
        try:
            return await self._probe(called, params, mount, progress)
        except LiteGripError as error:
            _name_arguments(error)
            raise

    def manual_calibration(self) -> ManualCalibration:
        """Calibrate by hand, for `async with`: the jaws are loose until its end.

        Move them to each stop and mark it: see `ManualCalibration`.
        """
        from litegrip_client.core.calibrations import ManualCalibration  # noqa: PLC0415 - see above

        return ManualCalibration(self._session, self._end_frames, self._stroke)

    def _stroke(self, stroke_mm: float | None) -> dict[str, float]:
        """Return the parameter for how far the jaws open; empty leaves it to the daemon."""
        if stroke_mm is None and self._own_config is not None:
            stroke_mm = self._own_config.assigned_stroke_mm
        return given_numbers(stroke_mm=stroke_mm)

    async def _probe(
        self,
        method: str,
        params: dict[str, Any],
        mount: str | None,
        progress: ProgressCallback | None,
    ) -> CalibrationData:
        from litegrip_client.core.calibrations import ProbePrinter  # noqa: PLC0415
        from litegrip_client.values.calibration import CalibrationData  # noqa: PLC0415 - see above

        if mount is not None:
            params = {**params, "mount": mount}
        printer = ProbePrinter()
        result = await self._run(method, params, progress or printer.progress)
        data = CalibrationData.from_result(result)
        if progress is None:
            printer.end(data, result.get("path"))
        return data

    # How a request is made

    def _configured(self, params: dict[str, Any]) -> dict[str, Any]:
        """Add the tunables that were set to the parameters of a motion, and its limits."""
        return self._calibrated(self._tuned(params))

    def _tuned(self, params: dict[str, Any], only: str = "") -> dict[str, Any]:
        """Add the tunables that were set to the parameters of a call; `only` those that begin so.

        Others could only have it refused.
        """
        set_here = self._motion_config.to_wire()
        config = {name: value for name, value in set_here.items() if name.startswith(only)}
        return {**params, "config": config} if config else params

    def _calibrated(self, params: dict[str, Any]) -> dict[str, Any]:
        """Add the limits of this object's motions to the parameters of one, if it has its own."""
        own = self._motion_calibration
        return params if own is None else {**params, "calibration": dict(own)}

    async def _move(
        self, method: str, params: dict[str, Any], progress: ProgressCallback | None
    ) -> MoveResult:
        return MoveResult.from_wire(await self._run(method, self._configured(params), progress))

    async def _run(
        self, method: str, params: dict[str, Any], progress: ProgressCallback | None
    ) -> dict[str, Any]:
        """Wait for a motion's result; an interrupt or an error cancels the motion."""
        if progress is not None:
            check_callback("progress", progress, 1, "a MoveProgress")
        positions: list[float] = []

        def report(data: dict[str, Any]) -> None:
            if progress is not None:
                progress(MoveProgress.from_wire(data, positions))

        await self._end_frames()
        return await Motion(self._session.wire, method, params, report).run()

    async def _command(
        self, method: str, params: dict[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call that is answered soon and must never act after a stop."""
        await self._end_frames()
        return await self._session.command(method, params, timeout_s)

    async def _ask(self, method: str, params: dict[str, Any] | None = None) -> dict[str, Any]:
        return await self._session.wire.call(method, params, ACTION_TIMEOUT_S)


_UNITS_OF_A_PROBE = {
    "kp": " N·m/rad",
    "kd": " N·m·s/rad",
    "step_rad": " rad",
    "tau_limit": " N·m",
    "stall_delta": " rad",
    "stall_cycles": "",
    "max_iter": "",
}
"""By an argument of `calibrate`, which is the tunable `calib_*` of the daemon."""


def _name_arguments(error: LiteGripError) -> None:
    """Have an error of `calibrate` name its arguments, not the tunables that they are sent as."""
    for name in _UNITS_OF_A_PROBE:
        error.message = error.message.replace(f"calib_{name}", name)
    name = str(error.data.get("field", "")).removeprefix("calib_")
    if error.data.get("parameter") == "config" and name in _UNITS_OF_A_PROBE:
        unit = _UNITS_OF_A_PROBE[name]
        _, found, problem = error.message.partition(f"{name} is ")
        error.message = f"{found}{problem.removesuffix(unit)}{unit}"
        del error.data["field"]
        error.data.pop("hint", None)  # it is of what was set before
        error.data["parameter"] = name
    error.args = (error.message,)


def state_of(result: dict[str, Any]) -> GripperState:
    """Return the state that comes with a result."""
    return GripperState.from_wire(result.get("state", {}))


_BEFORE_A_FRAME: dict[str, Any] = {
    "openness": 0.0,
    "position_mm": 0.0,
    "force_n": 0.0,
    "torque_nm": 0.0,
    "fault": "",
}
"""What an older daemon has no value for, with the SDK's: scripts print them as numbers and text."""


def _of_sdk(status: dict[str, Any]) -> dict[str, Any]:
    """Return a status of teleoperation with the values that the SDK has before there are any."""
    missing = {
        name: first for name, first in _BEFORE_A_FRAME.items() if status.get(name, first) is None
    }
    return {**status, **missing}


def _pace(kp: float | None, kd: float | None, duration: float | None) -> dict[str, float]:
    """Return what goes with a target: gains, and the least time that it takes."""
    least = {} if duration is None else {"at_least_s": number("duration", duration)}
    return {**given_numbers(kp=kp, kd=kd), **least}


def _play_params(  # noqa: PLR0917 - those of `play`, in its order
    speed: float,
    kp: float | None,
    kd: float | None,
    align: bool,
    torque_nm: float | None,
    force: str,
) -> dict[str, Any]:
    params: dict[str, Any] = {"speed": number("speed", speed), "align": flag("align", align)}
    if force != "path":
        params["force"] = force
    return params | given_numbers(kp=kp, kd=kd, torque_nm=torque_nm)
