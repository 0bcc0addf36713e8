"""`LiteGrip` as the SDK has it: the gripper of one channel, through that channel's daemon.

The program's `config` is its own: what it assigns there is sent with its motions, and changes
nothing for other programs. The daemon decides what the motor is told.
"""

from __future__ import annotations

import logging
import math
import os
import sys
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import litegrip_client
from litegrip_client.core.motion import stay
from litegrip_client.threads.blocking import complete
from litegrip_client.values import errors as ours

from . import _files
from ._bridge import (
    Samples,
    finite,
    gains_in_range,
    in_their_terms,
    motion_config_of,
    opening_mm,
    state_of,
    translated,
    voice_of,
)
from ._sessions import Sessions
from ._shortened import shortened
from .actions import (
    EnableResult,
    GraspResult,
    GripperActions,
    MotionConfig,
    MoveProgress,
    MoveResult,
    WriteZeroResult,
    force_approach_terms,
    limit_target,
    press_target,
    work_limit_target,
)
from .can.protocol import DM_REG
from .constants import (
    DefaultParams,
    GripperGeometry,
    GripperParams,
    MotorType,
    UnitConversion,
    describe_error,
)
from .exceptions import (
    CANTimeoutError,
    CommandError,
    CommError,
    ConnectError,
    HardwareError,
    LiteGripError,
    NotInitializedError,
)
from .models import CalibrationData, GripperConfig, GripperInfo, GripperState, GripperStatus
from .teleop import (
    DEFAULT_ALIGN_SPEED_MM_S,
    DEFAULT_DQ_MAX,
    DEFAULT_GRIP_ID,
    DEFAULT_GRIP_PORT,
    DEFAULT_LEAD_CAP_MM,
    DEFAULT_READY_PERIOD_S,
    DEFAULT_READY_TIMEOUT_S,
    DEFAULT_READY_TOLERANCE_MM,
    DEFAULT_TORQUE_LIMIT_NM,
    TeleopTransport,
    clamp_to_calibrated,
)
from .trajectory import DEFAULT_RATE_HZ, Trajectory

if TYPE_CHECKING:
    from litegrip_client.threads.actions import SetpointStream
    from litegrip_client.values.results import GraspResult as OurGrasp
    from litegrip_client.values.results import GripperState as OurState
    from litegrip_client.values.results import MoveResult as OurMove

__all__ = [
    "CALIB_TEMPLATES",
    "DEFAULT_CALIB",
    "CANTimeoutError",
    "CalibrationData",
    "CommError",
    "CommandError",
    "ConnectError",
    "DefaultParams",
    "EnableResult",
    "GraspResult",
    "GripperActions",
    "GripperConfig",
    "GripperGeometry",
    "GripperInfo",
    "GripperParams",
    "GripperState",
    "GripperStatus",
    "HardwareError",
    "LiteGrip",
    "LiteGripError",
    "MotionConfig",
    "MoveProgress",
    "MoveResult",
    "NotInitializedError",
    "UnitConversion",
    "WriteZeroResult",
    "default_calib_path",
    "describe_error",
    "force_approach_terms",
    "limit_target",
    "list_templates",
    "press_target",
    "work_limit_target",
]

LOG = logging.getLogger("litegrip")

DEFAULT_CALIB = os.environ.get("LITEGRIP_CALIB") or os.path.expanduser(
    "~/.litegrip/litegrip_calibration.json"
)
"""The older, single file: it is read where the channel has none, and never written."""

CALIB_TEMPLATES = dict(_files.TEMPLATES)
_FACTORY_CALIB = _files.FACTORY

_FRAME_VALID_S = 0.2
_MOST_TAU_NM = 10.0
_MOST_FORCE_N = 100.0
_FASTEST_MM_S, _FASTEST_RAD_S = 150.0, 2.9
"""The daemon's bounds of a motion."""
_FRAME_PRESS_NM = 2.0
"""What a frame's position presses with at most: as a motion on its way."""
_LOOK_S, _PERIOD_S, _SHORT_S = 0.05, 0.005, 0.003
_SMALLEST_MM, _SMALLEST_RAD = 0.01, 1e-4
_WITHOUT_WAY_S = 0.1


def default_calib_path(channel: str = "can0") -> str:
    """Return the file in which a channel's calibration is kept: that of LITEGRIP_CALIB, if set."""
    return _files.default_path(channel)


def list_templates() -> list[str]:
    """Return the names of the mounts."""
    return list(CALIB_TEMPLATES)


@shortened
class LiteGrip:
    """The gripper on `channel`; `with LiteGrip("can0") as gripper:` connects and disconnects.

    An argument that is left at its default yields to `config`, which is kept by reference: assign
    its fields at any time. `mount` ("normal" or "reverse") loads that template at once. Before
    `connect()` only what needs the motor raises, `NotInitializedError`. `daemon` is the object of
    `litegrip_client` behind this one, for all that the SDK does not know; None before `connect()`.
    """

    def __init__(
        self,
        channel: str = DefaultParams.CAN_CHANNEL,
        can_id: int = GripperParams.CAN_ID,
        mst_id: int | None = None,
        canfd_mode: bool | None = None,
        motor_type: MotorType = MotorType.DM4310,
        config: GripperConfig | None = None,
        motion_config: MotionConfig | None = None,
        disable_on_disconnect: bool = True,
        mount: str | None = None,
    ) -> None:
        self.config = GripperConfig() if config is None else config
        if channel != DefaultParams.CAN_CHANNEL:
            self.config.can_channel = channel
        if can_id != GripperParams.CAN_ID:
            self.config.can_id = can_id
        if mst_id is not None:
            self.config.mst_id = mst_id
        if canfd_mode is not None:
            self.config.canfd_mode = canfd_mode
        if self.config.canfd_mode:
            LOG.warning("canfd_mode is ignored: the motor speaks classic CAN at 1 Mbit/s")
        self.motion_config = MotionConfig() if motion_config is None else motion_config
        self.disable_on_disconnect = disable_on_disconnect
        self.actions = GripperActions(self)
        self.daemon: litegrip_client.LiteGrip | None = None
        self._motor_type = MotorType(motor_type)
        self._found_mst_id: int | None = None
        self._enabled = False
        self._frames: SetpointStream | None = None
        self._frames_calibration: dict[str, float] | None = None
        self._limits = (-math.inf, math.inf)
        self._polled_s: float | None = None
        self._sessions = Sessions(self)
        if mount is not None:
            self.load_template(mount)

    # What it is

    @property
    def channel(self) -> str:
        """The CAN channel, whose daemon drives the gripper."""
        return self.config.can_channel

    @property
    def can_id(self) -> int:
        """The id of the motor's commands."""
        return self.config.can_id

    @property
    def mst_id(self) -> int | None:
        """The id of the motor's answers; None while that is not known."""
        return self.config.mst_id or self._found_mst_id

    @property
    def is_connected(self) -> bool:
        """True if a daemon answers."""
        return self.daemon is not None and self.daemon.is_connected

    @property
    def is_enabled(self) -> bool:
        """True from this object's enabling to its disabling."""
        return self._enabled and self.is_connected

    @property
    def mount(self) -> str | None:
        """Which way the motor is mounted, "normal" or "reverse"; None while not calibrated."""
        return self.config.mount

    @property
    def session(self) -> str | None:
        """What runs in the background: "teleop", "record", "play" or None."""
        return self._sessions.kind

    def __repr__(self) -> str:
        mst_id = "auto" if self.mst_id is None else f"0x{self.mst_id:02X}"
        return (
            f"LiteGrip(channel={self.channel!r}, can_id=0x{self.can_id:02X}, mst_id={mst_id},"
            f" connected={self.is_connected}, enabled={self.is_enabled})"
        )

    def get_info(self) -> GripperInfo:
        """Return the type of the motor and its ids."""
        return GripperInfo(
            motor_type=self._motor_type.name, can_id=self.can_id, mst_id=self.mst_id or 0
        )

    # Connection

    def connect(self) -> bool:
        """Connect to the channel's daemon; true. It enables nothing and loads no calibration.

        Raises `ConnectError`.
        """
        if self.is_connected:
            return True
        self.disconnect()  # from a daemon that is gone
        config = self.config
        named_id = None if config.can_id == GripperParams.CAN_ID else config.can_id
        try:
            daemon = litegrip_client.LiteGrip(
                config.can_channel,
                named_id,
                disable_on_disconnect=bool(self.disable_on_disconnect),
                voice=voice_of(LiteGrip, config.can_channel),
            )
            daemon.connect()
            found, version = daemon.config, daemon.info().get("version")
        except ours.LiteGripError as error:
            raise ConnectError(str(error)) from None
        self.daemon, self._enabled, self._frames, self._polled_s = daemon, False, None, None
        self._found_mst_id = found.mst_id
        if found.motor_type != self._motor_type.name:
            LOG.warning(
                "the motor of %s is a %s, not a %s",
                config.can_channel,
                found.motor_type,
                self._motor_type.name,
            )
        LOG.info("connected to the daemon of %s, version %s", self.channel, version)
        return True

    def disconnect(self) -> None:
        """End sessions; disable the motor if this object has enabled it, and the connection."""
        daemon = self.daemon
        if daemon is None:
            return
        self._sessions.end()
        self.daemon, self._enabled, self._frames = None, False, None
        daemon.disable_on_disconnect = bool(self.disable_on_disconnect)
        try:
            daemon.disconnect()
        except ours.LiteGripError as error:
            LOG.warning("on disconnecting: %s", error)
        LOG.info("disconnected from %s", self.channel)

    def __enter__(self) -> LiteGrip:
        self.connect()
        return self

    def __exit__(self, *_error: object) -> None:
        self.disconnect()

    # The motor

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor, which then holds its angle; false if it does not confirm.

        `retries` are the tries, `motion_config.enable_retries` by default. Raises
        `NotInitializedError` before `connect()`, `CommandError` where another program has the
        gripper or a stop is latched.
        """
        daemon = self._connected()
        tries = self.motion_config.enable_retries if retries is None else retries
        daemon.disable_on_disconnect = bool(self.disable_on_disconnect)
        daemon.motion_config = motion_config_of(self.motion_config)
        self._drop_frames()
        try:
            result = daemon.enable(tries)
        except ours.HardwareError as error:
            LOG.warning("the motor could not be enabled: %s", error)
            self._enabled = False
            return EnableResult(False, self.get_state(), tries)
        except ours.LiteGripError as error:
            raise translated(error) from None
        self._enabled = result.ok
        if not result.ok:
            LOG.warning("the motor could not be enabled: %s", result.message)
        return EnableResult(result.ok, state_of(result.state, self.config), result.tries)

    def disable(self) -> bool:
        """Disable the motor: no torque. True if that was sent."""
        daemon = self._connected()
        self._frames = None  # which ends with it
        with in_their_terms():
            daemon.disable()
        self._enabled = False
        return True

    def clear_fault(self) -> bool:
        """Clear the motor's fault and enable it; true. Raises `HardwareError` with its code."""
        daemon = self._connected()
        self._drop_frames()
        with in_their_terms():
            if not daemon.clear_fault():
                self._enabled = False
                state = self.get_state()
                text = "the motor's fault could not be cleared"
                raise HardwareError(text, state.error_code or None)
        self._enabled = True
        return True

    def stop(self) -> None:
        """Take the torque off the jaws, and end what this program has them do; nothing is latched.

        It does nothing before `connect()`, and on a motor that this object has not enabled.
        """
        if not self.is_enabled:
            return
        daemon = self._connected()
        with in_their_terms():
            if self._frames is None and _is_slack(daemon.get_state()):
                return  # a program may stop 50 times a second
            self._frames = None
            daemon.stop()

    def read_param(self, rid: int, timeout_s: float = 0.5) -> float:
        """Read a register of the motor (`DM_REG`). Raises `CANTimeoutError` and `ValueError`."""
        daemon = self._connected()
        register = DM_REG(rid)
        try:
            return float(daemon.read_param(int(register)))
        except ours.CommError as error:
            raise CANTimeoutError(str(error)) from None
        except ours.LiteGripError as error:
            raise translated(error) from None

    def write_zero(self) -> WriteZeroResult:
        """Make the present angle the motor's zero, for good; the calibration stays as it is.

        Its limits mean other angles then: calibrate again. Raises `HardwareError`.
        """
        self._ready()
        before_rad = self.get_position_rad()
        if not self._set_zero():
            raise HardwareError("the motor did not take its new zero")
        self.enable()
        LOG.warning("the motor's zero has moved by %.4f rad: calibrate again", before_rad)
        return WriteZeroResult(before_rad, self.get_position_rad())

    def _set_zero(self) -> bool:
        """Set the motor's zero, which disables it; true if it took that."""
        daemon = self._connected()
        self._drop_frames()
        with in_their_terms():
            done = bool(daemon.set_zero())
        self._enabled = False
        return done

    # Reading

    def poll(self, timeout_s: float = 0.0) -> bool:
        """Return True if the motor has reported since the last `poll`; wait for it so long.

        False before `connect()`.
        """
        if not self.is_connected:
            return False
        state = self._report_after(self._polled_s, timeout_s, _PERIOD_S)
        if state is None:
            return False
        self._polled_s = state.feedback_s
        return True

    def refresh_status(self, timeout_s: float = 0.5) -> bool:
        """Return True once the motor has reported after this call."""
        with in_their_terms():
            before_s = self._connected().get_state().feedback_s
        return self._report_after(before_s, timeout_s, _SHORT_S) is not None

    def _report_after(
        self, before_s: float | None, timeout_s: float, period_s: float
    ) -> OurState | None:
        """Return what the motor reports anew, looking each period; None if not in time."""
        daemon = self._connected()
        ends_s = time.monotonic() + timeout_s
        while True:
            with in_their_terms():
                state = daemon.get_state()
            if not state.stale and state.feedback_s != before_s:
                return state
            if time.monotonic() >= ends_s:
                return None
            time.sleep(period_s)

    def get_state(self, wait: bool = True) -> GripperState:
        """Return what the motor has reported last; `wait` makes no difference."""
        daemon = self._connected()
        with in_their_terms():
            return state_of(daemon.get_state(), self.config)

    def get_position(self) -> float:
        """Return the opening, mm."""
        return self.get_state().position_mm

    def get_position_rad(self) -> float:
        """Return the motor's angle, rad."""
        return self.get_state().position_rad

    def get_torque(self) -> float:
        """Return the motor's torque, N·m, signed."""
        return self.get_state().torque_nm

    def get_force(self) -> float:
        """Return the force, N, closing positive; nominal."""
        return self.get_state().force_n

    def get_error(self) -> int:
        """Return the motor's status (`ErrorCode`)."""
        return self.get_state().error_code

    def get_temperature(self) -> tuple[int, int]:
        """Return the temperatures of driver and coil, °C."""
        state = self.get_state()
        return state.temperature_mos, state.temperature_coil

    def is_moving(self) -> bool:
        """Return True above 0.01 rad/s."""
        return self.get_state().is_moving

    def is_grasped(self) -> bool:
        """Return True above the torque `config.grasp_torque_threshold`."""
        return abs(self.get_state().torque_nm) > self.config.grasp_torque_threshold

    def wait_for_ready(self, timeout: float = 5.0) -> bool:
        """Wait until the motor is enabled and still; false if it is not in time."""
        ends_s = time.monotonic() + timeout
        while self.is_connected:
            state = self.get_state()
            if state.is_enabled and not state.is_moving:
                return True
            if time.monotonic() >= ends_s:
                break
            time.sleep(_LOOK_S)
        return False

    # Frames

    def send_mit_frame(
        self, q: float, kp: float, kd: float, dq: float = 0.0, tau: float = 0.0
    ) -> bool:
        """Have the jaws follow `q` (rad), or, with `kp` 0, have the motor make `tau` (N·m).

        It counts for 0.2 s; without another one the jaws then hold. `q` stays inside the limits,
        gains inside the daemon's ranges. `dq` is not used: the daemon feeds the velocity of the
        path forward. With `kp` and `tau` 0 the jaws are slack.

        False where nothing could be sent: not connected, not enabled. Raises `CommandError` for
        what is not finite, for a `tau` beyond 10 N·m or beside a `kp`, and for what the daemon
        refuses.
        """
        if not self.is_enabled:
            return False
        given = {"q": q, "kp": kp, "kd": kd, "dq": dq, "tau": tau}
        values = {name: finite(name, value) for name, value in given.items()}
        if abs(values["tau"]) > _MOST_TAU_NM:
            raise CommandError(f"tau is {tau:g} N·m, it must be at most {_MOST_TAU_NM:g}")
        with in_their_terms():
            own, frames = self._own_calibration(), self._frames  # another thread may stop
            if frames is None or own != self._frames_calibration:
                frames = self._frames = self._stream(own)
            if values["kp"] > 0.0:
                if values["tau"] != 0.0:
                    raise CommandError("tau beside a kp: the daemon computes the torque itself")
                stiff, damped = gains_in_range(values["kp"], values["kd"])
                low, high = self._limits
                target_rad = min(max(values["q"], low), high)
                frames.set_target(position_rad=target_rad, kp=stiff, kd=damped)
            else:
                frames.set_target(push_nm=values["tau"])
        return True

    def _stream(self, own: dict[str, float] | None) -> SetpointStream:
        """Begin a stream of frames with the limits of now: the daemon's while there are no own."""
        daemon, config = self._ready(), self.config
        daemon.motion_calibration = self._frames_calibration = own
        scale = config.rad_to_mm
        limits: tuple[float | None, float | None] = (config.pos_closed_rad, config.pos_open_rad)
        if not config.calibrated:
            theirs = daemon.config
            limits = theirs.pos_closed_rad, theirs.pos_open_rad
            scale = theirs.rad_to_mm or scale
        known = [limit for limit in limits if limit is not None]
        self._limits = min(known, default=-math.inf), max(known, default=math.inf)
        fastest = min(_FASTEST_MM_S, _FASTEST_RAD_S * scale)
        return daemon.stream(_FRAME_VALID_S, speed_mm_s=fastest, torque_nm=_FRAME_PRESS_NM)

    def _drop_frames(self) -> None:
        """End the stream of frames, so that another request can begin."""
        frames, self._frames = self._frames, None
        if frames is not None:
            with in_their_terms():
                frames.close()

    # Motions

    def open(
        self,
        speed_mm_s: float | None = None,
        *,
        progress: Callable[[MoveProgress], None] | None = None,
    ) -> MoveResult:
        """Open to the stop, or to `config.work_stroke_mm`; blocks until it is there.

        `speed_mm_s` is `motion_config.speed_mm_s` by default. `progress` is called on the way, in
        this thread; what it raises ends the motion and passes through.
        """
        daemon = self._begin("open", speed_mm_s)
        samples = Samples(progress, self.motion_config)
        with in_their_terms():
            return self._moved(daemon.open(speed_mm_s, progress=samples.take), samples)

    def close(
        self,
        speed_mm_s: float | None = None,
        *,
        progress: Callable[[MoveProgress], None] | None = None,
    ) -> MoveResult:
        """Close to the stop; all else as for `open`."""
        daemon = self._begin("close", speed_mm_s)
        samples = Samples(progress, self.motion_config)
        with in_their_terms():
            return self._moved(daemon.close(speed_mm_s, progress=samples.take), samples)

    def _moved(self, result: OurMove, samples: Samples) -> MoveResult:
        samples.end(result.steps, result.final_cmd_rad, result.state)
        return MoveResult(
            result.ok,
            result.reached,
            result.stalled,
            state_of(result.state, self.config),
            result.target_rad,
            result.limit_rad,
            result.final_cmd_rad,
            result.steps,
            result.protected,
        )

    def grasp(
        self,
        force_n: float | None = None,
        hold_s: float = 0.0,
        *,
        progress: Callable[[MoveProgress], None] | None = None,
    ) -> GraspResult:
        """Close until something is met, and squeeze with `force_n` for `hold_s` seconds.

        Without anything between them the jaws squeeze each other. With `hold_s` 0 or less it
        returns only after a fault, or by an interrupt. The force stays after it returns. While it
        holds, `progress` is called once each `motion_config.hold_interval`.
        """
        self._ready()
        force = self.motion_config.force_n if force_n is None else finite("force_n", force_n)
        lasts_s = finite("hold_s", hold_s)
        finite("hold_interval", self.motion_config.hold_interval)
        daemon = self._begin("grasp", None)
        limit_target(self.config, "close", self.motion_config.margin)
        samples = Samples(progress, self.motion_config)
        with in_their_terms():
            met = daemon.grasp(force, until="verdict", progress=samples.take)
            if met.outcome == "no_object":
                daemon.set_force(force, 0.0)
            elif not met.ok:
                return self._grasped(met, force, 0, ok=False)
            ok, cycles = self._hold(daemon, lasts_s, progress)
        return self._grasped(met, force, cycles, ok=ok)

    def _hold(
        self,
        daemon: litegrip_client.LiteGrip,
        lasts_s: float,
        progress: Callable[[MoveProgress], None] | None,
    ) -> tuple[bool, int]:
        """Wait while the jaws hold; return whether they still do, and how many slices began."""
        began_s, slices = time.monotonic(), 0
        while True:
            slices += 1
            due_s = began_s + slices * max(self.motion_config.hold_interval, _PERIOD_S)
            time.sleep(max(due_s - time.monotonic(), 0.0))
            found = daemon.get_state()
            if found.error_code != 1 or found.force_set_n is None:
                return False, slices
            if progress is not None:
                at_rad, coil_c = found.position_rad or 0.0, int(found.coil_temperature_c or 0)
                torque_nm = found.torque_nm or 0.0
                progress(
                    MoveProgress("hold", slices, 0, at_rad, at_rad, 0.0, None, torque_nm, coil_c)
                )
            if 0.0 < lasts_s <= due_s - began_s + _PERIOD_S / 2.0:
                return True, slices

    def _grasped(self, met: OurGrasp, force_n: float, cycles: int, *, ok: bool) -> GraspResult:
        state = self.get_state()
        return GraspResult(ok, met.reached, met.stalled, state, met.target_rad, force_n, cycles)

    def goto(
        self,
        position_mm: float,
        kp: float | None = None,
        kd: float | None = None,
        duration: float = 0.5,
    ) -> bool:
        """Move to an opening, mm, in `duration` seconds; it stays inside the travel."""
        self._ready()
        return self._go(self._angle(finite("position_mm", position_mm)), kp, kd, duration)

    def goto_rad(
        self,
        position_rad: float,
        kp: float | None = None,
        kd: float | None = None,
        dq_target: float = 0.0,
        tau_feedforward: float = 0.0,
        duration: float = 0.5,
    ) -> bool:
        """Move to an angle, rad, in `duration` seconds; it stays inside the limits.

        `dq_target` and `tau_feedforward` are not used: the daemon computes both.
        """
        self._ready()
        finite("dq_target", dq_target)
        if abs(finite("tau_feedforward", tau_feedforward)) > _MOST_TAU_NM:
            raise CommandError(
                f"tau_feedforward is {tau_feedforward:g} N·m, it must be at most {_MOST_TAU_NM:g}"
            )
        return self._go(finite("position_rad", position_rad), kp, kd, duration)

    def move_to(
        self,
        target_rad: float,
        kp: float | None = None,
        kd: float | None = None,
        tau_feedforward: float = 0.0,
        duration: float = 1.0,
    ) -> bool:
        """Move to an angle, rad, as `goto_rad` does."""
        return self.goto_rad(target_rad, kp, kd, 0.0, tau_feedforward, duration)

    def home(self) -> bool:
        """Move to the closed limit, in a second."""
        return self.goto_rad(self.config.pos_closed_rad, duration=1.0)

    def _go(self, target_rad: float, kp: float | None, kd: float | None, duration: float) -> bool:
        lasts_s = max(finite("duration", duration), 0.0)
        daemon = self._begin("goto", None)
        stiff, damped = self._move_gains(kp, kd)
        with in_their_terms():
            daemon.goto_rad(
                clamp_to_calibrated(self.config, target_rad), stiff, damped, duration=lasts_s
            )
        return True

    def move_at_speed(
        self,
        target_mm: float,
        speed_mm_s: float = 30.0,
        kp: float | None = None,
        kd: float | None = None,
    ) -> bool:
        """Move to an opening, mm, at a speed; true. Without a way or a speed nothing is sent."""
        self._ready()
        target_rad = self._angle(finite("target_mm", target_mm))
        return self._at_speed(target_rad, finite("speed_mm_s", speed_mm_s), _SMALLEST_MM, kp, kd)

    def move_at_speed_rad(
        self,
        target_rad: float,
        speed_rad_s: float = 0.5,
        kp: float | None = None,
        kd: float | None = None,
    ) -> bool:
        """Move to an angle, rad, at a speed, rad/s; as `move_at_speed`."""
        self._ready()
        speed_mm_s = finite("speed_rad_s", speed_rad_s) * self.config.rad_to_mm
        least_mm = _SMALLEST_RAD * self.config.rad_to_mm
        return self._at_speed(finite("target_rad", target_rad), speed_mm_s, least_mm, kp, kd)

    def _at_speed(
        self,
        target_rad: float,
        speed_mm_s: float,
        least_mm: float,
        kp: float | None,
        kd: float | None,
    ) -> bool:
        daemon = self._begin("move_at_speed", None)
        target_rad = clamp_to_calibrated(self.config, target_rad)
        way_mm = abs(target_rad - self.get_position_rad()) * self.config.rad_to_mm
        if way_mm < least_mm or speed_mm_s <= 0.0:
            return True
        stiff, damped = self._move_gains(kp, kd)
        with in_their_terms():
            daemon.move_at_speed(opening_mm(target_rad, self.config), speed_mm_s, stiff, damped)
        time.sleep(_WITHOUT_WAY_S)
        return True

    def set_force(self, force_n: float, duration: float = 0.3) -> bool:
        """Squeeze with a force, N: climb at `motion_config.force_ramp_n_s`, hold `duration`, true.

        The force stays afterwards. With 0 the jaws are slack. Raises `CommandError` beyond the
        daemon's limit, and for a force that opens.
        """
        self._ready()
        force, lasts_s = finite("force_n", force_n), max(finite("duration", duration), 0.0)
        if abs(force) > _MOST_FORCE_N:
            raise CommandError(f"force_n is {force:g}, it must be at most {_MOST_FORCE_N:g}")
        if force < 0.0:
            raise CommandError(
                f"force_n is {force:g}: nothing is held by opening; open(), or send_mit_frame with"
                " kp 0 and a tau"
            )
        daemon = self._begin("set_force", None)
        with in_their_terms():
            if force == 0.0:
                _loosen(daemon, lasts_s)
                return True
            present_n = max(self.get_force(), 0.0)
            climb_s = abs(force - present_n) / max(self.motion_config.force_ramp_n_s, 1e-3)
            daemon.set_force(force, climb_s + lasts_s)
        return True

    def enter_zero_gravity(self, duration: float = 0.0) -> None:
        """Let the jaws be moved by hand; with a `duration` it returns after so many seconds.

        They stay slack until another command. What ends a motion ends the wait at once, by the
        same error: a stop, the loss of the lease, a fault, the daemon's end.
        """
        daemon = self._ready()
        self._drop_frames()
        with in_their_terms():
            _loosen(daemon, finite("duration", duration))

    def exit_zero_gravity(self) -> None:
        """Hold the jaws where they are; nothing before `connect()`, or where not enabled."""
        if not self.is_enabled:
            return
        daemon = self._connected()
        self._drop_frames()
        with in_their_terms():
            daemon.hold()

    # Calibration

    def zero(self) -> CalibrationData:
        """Measure the travel by probing both stops, use it, and save it: the daemon too."""
        daemon = self._ready()
        self._drop_frames()
        daemon.motion_config = motion_config_of(self.motion_config)
        data = self._calibrated(lambda mount, mm: daemon.zero(mount=mount, stroke_mm=mm))
        self.save_calibration()
        return data

    def calibrate(
        self,
        kp: float = 20.0,
        kd: float = 2.0,
        step_rad: float = 0.05,
        stall_delta: float = 0.0015,
        stall_cycles: int = 5,
        max_iter: int = 200,
        tau_limit: float | None = 2.0,
    ) -> CalibrationData:
        """Measure the travel by probing both stops, and use it; it is not saved.

        Raises `RuntimeError` where no travel is found, `HardwareError` where it is not confirmed.
        """
        daemon = self._ready()
        self._drop_frames()
        if tau_limit is None:
            raise CommandError("tau_limit cannot be None: the probe would press without a bound")
        given = (kp, kd, step_rad, stall_delta, stall_cycles, max_iter, tau_limit)
        return self._calibrated(
            lambda mount, mm: daemon.calibrate(*given, mount=mount, stroke_mm=mm)
        )

    def calibrate_guided(
        self,
        kp: float = 20.0,
        kd: float = 2.0,
        step_rad: float = 0.05,
        stall_delta: float = 0.0015,
        stall_cycles: int = 5,
        max_iter: int = 200,
        tau_limit: float | None = 2.0,
    ) -> CalibrationData:
        """Measure the travel as `calibrate` does, once Enter has confirmed it on a terminal."""
        self._ready()
        if sys.stdin is not None and sys.stdin.isatty():
            input("The jaws will move to both stops: clear them, and press Enter ")
        return self.calibrate(kp, kd, step_rad, stall_delta, stall_cycles, max_iter, tau_limit)

    def calibrate_manual(
        self, duration: float = 30.0, settle_time: float = 2.0, sample_interval: float = 0.01
    ) -> CalibrationData:
        """Measure the travel while a hand moves the jaws to both stops; it is not saved.

        `config.close_sign` says which extreme is the closed one. An interrupt ends it early and
        counts. Then the jaws hold. Raises `RuntimeError` where they were not moved.
        """
        daemon = self._ready()
        self._drop_frames()
        low = high = self.get_position_rad()
        print(f"The jaws are loose for {duration:g} s: push them to both stops (Ctrl+C ends it).")
        with in_their_terms():
            daemon.zero_gravity()
        try:
            ends_s = time.monotonic() + duration
            while time.monotonic() < ends_s:
                time.sleep(max(sample_interval, _PERIOD_S))
                at_rad = self.get_position_rad()
                low, high = min(low, at_rad), max(high, at_rad)
        except KeyboardInterrupt:
            print("ended early")
        finally:
            with in_their_terms():
                daemon.hold()
        time.sleep(max(settle_time, 0.0))
        closed, opened = (high, low) if self.config.close_sign > 0.0 else (low, high)
        if high - low <= 0.0:
            raise RuntimeError("the jaws were not moved: there is no travel")
        data = self._take(closed, opened, (self.config.max_stroke_mm + 1.0) / (high - low))
        print(f"closed {closed:+.4f} rad, open {opened:+.4f} rad, {data.travel_mm:.1f} mm")
        return data

    def _calibrated(self, probe: Callable[[str, float], Any]) -> CalibrationData:
        mount = "normal" if self.config.close_sign > 0.0 else "reverse"
        try:
            found = probe(mount, self.config.max_stroke_mm)
        except ours.HardwareError as error:
            if error.reason in ("implausible_travel", "not_found"):
                raise RuntimeError(str(error)) from None
            raise translated(error) from None
        except ours.LiteGripError as error:
            raise translated(error) from None
        return self._take(found.zero_position_rad, found.max_position_rad, found.rad_to_mm)

    def _take(self, closed_rad: float, open_rad: float, rad_to_mm: float) -> CalibrationData:
        """Use what was measured."""
        config = self.config
        config.pos_closed_rad, config.pos_open_rad = closed_rad, open_rad
        config.rad_to_mm, config.calibrated = rad_to_mm, True
        return CalibrationData(
            zero_position=round(closed_rad, 6),
            max_position=round(open_rad, 6),
            travel_range=round(abs(open_rad - closed_rad), 6),
            rad_to_mm=round(rad_to_mm, 2),
            motor_type=self._motor_type.name,
            can_id=self.can_id,
            mst_id=self.mst_id or 0,
            calibration_time=time.strftime("%Y-%m-%d %H:%M:%S"),
        )

    def save_calibration(self, path: str | None = None) -> str:
        """Write `config` to a file, by default `default_calib_path(channel)`; return its path."""
        target = default_calib_path(self.channel) if path is None else path
        _files.write(target, _files.content_of(self.config, self._motor_type.name, self.mst_id))
        LOG.info("calibration saved to %s", target)
        return target

    def load_calibration(self, path: str | None = None, template: str | None = None) -> bool:
        """Read a calibration into `config`; true if one was found.

        A `template` is "normal" or "reverse". A `path` that is missing, or no JSON, is replaced by
        the factory's file, with a warning. Without either: the channel's own file, the older
        single one, the daemon's calibration if one answers, and the factory's file if that is for
        this channel. Raises `CommandError` and, for a file that lacks a limit or the
        scale, `KeyError`.
        """
        if path is not None and template is not None:
            raise CommandError("path and template together: give one of them")
        if template is not None:
            if template not in CALIB_TEMPLATES:
                names = ", ".join(CALIB_TEMPLATES)
                raise CommandError(f"{template!r} is no template, it must be one of: {names}")
            found: str | None = CALIB_TEMPLATES[template]
            _files.apply(_files.read_strictly(CALIB_TEMPLATES[template]), self.config)
        elif path is not None:
            found = self._load_named(path)
        else:
            found = self._load_found()
        if not found:
            LOG.warning("no calibration was found for %s", self.channel)
            return False
        LOG.info("calibration %s: mount %s", found, self.mount)
        return True

    def _load_named(self, path: str) -> str:
        try:
            content = _files.read(path)
        except (OSError, ValueError, RecursionError) as error:
            LOG.warning("calibration %s cannot be read, the factory's counts: %s", path, error)
            content, path = _files.read_strictly(_FACTORY_CALIB), _FACTORY_CALIB
        named = content.get("channel")
        if named not in (None, self.channel) and path != _FACTORY_CALIB:
            LOG.warning("calibration %s is for channel %s, not %s", path, named, self.channel)
        _files.apply(content, self.config)
        return path

    def _load_found(self) -> str | None:
        for path, content in _files.candidates(self.channel, DEFAULT_CALIB):
            _files.apply(content, self.config)
            return path
        if self._load_daemons():
            return "of the daemon"
        content = _files.read_strictly(_FACTORY_CALIB)
        if content.get("channel") not in (None, self.channel):
            return None
        _files.apply(content, self.config)
        return _FACTORY_CALIB

    def _load_daemons(self) -> bool:
        """Take the limits and gains that the daemon has; false where none answers, or has any."""
        try:
            if self.daemon is not None and self.is_connected:
                theirs = self.daemon.config
            else:
                with litegrip_client.LiteGrip(self.channel) as daemon:
                    theirs = daemon.config
        except ours.LiteGripError as error:
            LOG.info("the daemon of %s does not tell its calibration: %s", self.channel, error)
            return False
        if theirs.pos_closed_rad is None or theirs.pos_open_rad is None or theirs.rad_to_mm is None:
            return False
        config = self.config
        config.pos_closed_rad, config.pos_open_rad = theirs.pos_closed_rad, theirs.pos_open_rad
        config.rad_to_mm, config.work_stroke_mm = theirs.rad_to_mm, theirs.work_stroke_mm
        config.kp, config.kd, config.calibrated = theirs.kp, theirs.kd, True
        return True

    def load_template(self, name: str) -> bool:
        """Read the nominal calibration of a mount, "normal" or "reverse"."""
        return self.load_calibration(template=name)

    # Sessions

    def record_start(
        self,
        rate_hz: float = DEFAULT_RATE_HZ,
        zero_gravity: bool = True,
        max_samples: int | None = None,
    ) -> dict[str, Any]:
        """Begin to record in the background; return the status."""
        return self._sessions.record_start(rate_hz, zero_gravity, max_samples)

    def record_stop(self, allow_empty: bool = False) -> Trajectory:
        """End the recording and return it; the jaws hold if they were slack."""
        return self._sessions.record_stop(allow_empty)

    def record(
        self, duration_s: float, rate_hz: float = DEFAULT_RATE_HZ, zero_gravity: bool = True
    ) -> Trajectory:
        """Record for a while; blocks."""
        return self._sessions.record(duration_s, rate_hz, zero_gravity)

    def play_start(
        self,
        trajectory: Trajectory,
        speed: float = 1.0,
        kp: float | None = None,
        kd: float | None = None,
        loop: bool = False,
        align: bool = True,
    ) -> dict[str, Any]:
        """Begin to replay in the background; return the status."""
        return self._sessions.play_start(trajectory, speed, kp, kd, loop, align)

    def play(
        self,
        trajectory: Trajectory,
        speed: float = 1.0,
        kp: float | None = None,
        kd: float | None = None,
        loop: bool = False,
        align: bool = True,
    ) -> dict[str, Any]:
        """Replay to the end; blocks, and returns the final status."""
        return self._sessions.play(trajectory, speed, kp, kd, loop, align)

    def play_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End the replay; the jaws hold. Return the final status."""
        return self._sessions.play_stop(timeout)

    def trajectory_status(self) -> dict[str, Any]:
        """Return the status of this object's recording or replay."""
        return self._sessions.trajectory_status()

    def teleop_start(
        self,
        mode: str,
        *,
        transport: TeleopTransport | None = None,
        link: str = "zenoh",
        host: str | None = None,
        port: int = DEFAULT_GRIP_PORT,
        grip_id: str = DEFAULT_GRIP_ID,
        kp: float | None = None,
        kd: float | None = None,
        align: bool = True,
        align_speed_mm_s: float = DEFAULT_ALIGN_SPEED_MM_S,
        watchdog_s: float = 0.2,
        dq_max: float = DEFAULT_DQ_MAX,
        torque_limit_nm: float = DEFAULT_TORQUE_LIMIT_NM,
        lead_cap_mm: float = DEFAULT_LEAD_CAP_MM,
        require_ready: bool = True,
        ready_timeout_s: float = DEFAULT_READY_TIMEOUT_S,
        ready_tolerance_mm: float = DEFAULT_READY_TOLERANCE_MM,
        ready_period_s: float = DEFAULT_READY_PERIOD_S,
        rate_hz: float = 50.0,
    ) -> dict[str, Any]:
        """Lead ("master") or follow ("slave") in the background; return the status.

        With a `transport` of the program's own this process carries its payloads to the daemon,
        which runs the loop; else the daemon has the link.
        """
        return self._sessions.teleop_start(
            mode,
            transport,
            link=link,
            host=host,
            port=port,
            grip_id=grip_id,
            align=align,
            gains=(kp, kd),
            require_ready=require_ready,
            figures={
                "rate_hz": rate_hz,
                "watchdog_s": watchdog_s,
                "align_speed_mm_s": align_speed_mm_s,
                "ready_period_s": ready_period_s,
                "torque_limit_nm": torque_limit_nm,
                "lead_cap_mm": lead_cap_mm,
                "ready_timeout_s": ready_timeout_s,
                "ready_tolerance_mm": ready_tolerance_mm,
                "dq_max": dq_max,
            },
        )

    def teleop_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End teleoperation; the jaws hold. Return the final status."""
        return self._sessions.teleop_stop(timeout)

    def teleop_status(self) -> dict[str, Any]:
        """Return the status of this object's teleoperation."""
        return self._sessions.teleop_status()

    # How a motion is asked for

    def _connected(self) -> litegrip_client.LiteGrip:
        if self.daemon is None:
            raise NotInitializedError("not connected: call connect() first")
        return self.daemon

    def _ready(self) -> litegrip_client.LiteGrip:
        """Return the daemon's object; raises `NotInitializedError` unless enabled."""
        daemon = self._connected()
        if not self._enabled:
            raise NotInitializedError("not enabled: call enable() first")
        return daemon

    def _begin(self, name: str, speed_mm_s: float | None) -> litegrip_client.LiteGrip:
        """Return the daemon's object for a motion: with this program's terms in force."""
        self._ready()
        if speed_mm_s is not None:
            finite("speed_mm_s", speed_mm_s)
        limit_target(self.config, "close", 0.0)  # raises where there is no travel
        daemon = self._in_force()
        LOG.info("%s on %s", name, self.channel)
        return daemon

    def _in_force(self) -> litegrip_client.LiteGrip:
        """Return the daemon's object with this program's tunables and limits; frames end."""
        daemon = self._ready()
        self._drop_frames()
        daemon.motion_config = motion_config_of(self.motion_config)
        daemon.motion_calibration = self._own_calibration()
        return daemon

    def _own_calibration(self) -> dict[str, float] | None:
        """Return what is sent with a motion: the program's limits, None while it has none."""
        config = self.config
        if not config.calibrated:
            return None
        kp, kd = gains_in_range(config.kp, config.kd)
        own = {
            "zero_position_rad": config.pos_closed_rad,
            "max_position_rad": config.pos_open_rad,
            "rad_to_mm": config.rad_to_mm,
            "kp": kp,
            "kd": kd,
        }
        return (
            own
            if config.work_stroke_mm <= 0.0
            else {**own, "work_stroke_mm": config.work_stroke_mm}
        )

    def _angle(self, opening_mm: float) -> float:
        """Return the angle of an opening."""
        config = self.config
        if config.rad_to_mm == 0.0:
            raise CommandError("rad_to_mm is 0: load a calibration, or zero()")
        return config.pos_closed_rad - config.close_sign * opening_mm / config.rad_to_mm

    def _move_gains(self, kp: float | None, kd: float | None) -> tuple[float, float]:
        config = self.config
        return gains_in_range(config.kp if kp is None else kp, config.kd if kd is None else kd)


def _loosen(daemon: litegrip_client.LiteGrip, lasts_s: float) -> None:
    """Make the jaws slack, and return after `lasts_s`; what ends a motion ends this, too."""
    began = daemon.zero_gravity()
    complete(stay(daemon._session, began.stop_generation, lasts_s))  # noqa: SLF001


def _is_slack(state: Any) -> bool:
    """Return True if the jaws are slack, and nothing runs that would end that."""
    return state.mode == "relaxed" and state.job is None
