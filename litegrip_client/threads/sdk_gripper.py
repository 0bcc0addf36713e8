"""The members of the SDK's `LiteGrip` that say in other words what ours can do."""

from __future__ import annotations

import time

from litegrip_client.threads.actions import BlockingGripper
from litegrip_client.threads.blocking import BlockingSession, complete
from litegrip_client.values.checks import number, time_limit
from litegrip_client.values.errors import (
    CANTimeoutError,
    CommandError,
    ConnectError,
    LiteGripError,
    ParameterError,
)
from litegrip_client.values.fields import NM_TO_N, SPAN_INSET_MM

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.values.calibration import CalibrationData
    from litegrip_client.values.results import GripperState, MoveResult

_STEP_S = 0.005


class SdkGripper(BlockingGripper):
    """A gripper, with the SDK's further members. They raise what `GripperActions` says.

    What is measured is a number, never None: without a measurement that counts (the bus is down,
    the motor is silent) `CANTimeoutError` is raised. `get_state` has the old figures then.
    """

    _polled_s: float | None = None

    if TYPE_CHECKING:
        # The class that is made of this one has them.
        states: Any  # an iterator over states
        _session: BlockingSession

    # What it is

    @property
    def can_id(self) -> int:
        """The motor's id on the bus, the daemon's."""
        return self.config.can_id

    @property
    def mst_id(self) -> int | None:
        """The id of the motor's answers; None until the motor has answered."""
        return self.config.mst_id

    @property
    def is_enabled(self) -> bool:
        """True if the motor is known to be enabled."""
        return self.get_state().is_enabled

    # What it measures

    def poll(self, timeout_s: float = 0.0) -> bool:
        """Return True if there are figures that no call of this method has seen before.

        Waits for them for at most `timeout_s` seconds. Nothing has to be read here: the daemon asks
        the motor in every period (5 ms).
        """
        ends_s = time.monotonic() + time_limit("timeout_s", timeout_s)
        while True:
            state = self.get_state()
            if not state.stale and state.feedback_s != self._polled_s:
                self._polled_s = state.feedback_s
                return True
            if time.monotonic() >= ends_s:
                return False
            time.sleep(_STEP_S)

    def wait_for_ready(self, timeout: float = 5.0) -> bool:
        """Wait until the motor answers without a fault; false if it does not within `timeout` s.

        It need not be enabled yet.
        """
        ends_s = time.monotonic() + time_limit("timeout", timeout)
        while True:
            state = self.get_state()
            if not state.stale and not state.is_error:
                return True
            if time.monotonic() >= ends_s:
                return False
            time.sleep(_STEP_S)

    def get_position(self) -> float:
        """Return the opening in mm, 0 closed. Raises `CommandError` without a calibration."""
        state = self._fresh()
        if state.opening_mm is None:
            raise ParameterError(
                "no calibration is loaded, so there is no opening in mm",
                reason="not_calibrated",
                data={"hint": "load_calibration(), or get_position_rad()"},
            )
        return state.opening_mm

    def get_position_rad(self) -> float:
        """Return the motor's position in rad."""
        return float(self._fresh().position_rad or 0.0)

    def get_torque(self) -> float:
        """Return the motor's torque in N·m."""
        return float(self._fresh().torque_nm or 0.0)

    def get_force(self) -> float:
        """Return the force in N, squeezing positive; `config.nm_to_n` for 1 N·m (approximate)."""
        state = self._fresh()
        return float(state.torque_nm or 0.0) * NM_TO_N if state.force_n is None else state.force_n

    def get_temperature(self) -> tuple[float, float]:
        """Return the temperatures of driver (MOSFET) and coil, in °C."""
        state = self._fresh()
        return float(state.temperature_mos or 0.0), float(state.temperature_coil or 0.0)

    def get_error(self) -> int:
        """Return the motor's status nibble: 0 disabled, 1 enabled, 8 to 14 a fault.

        `describe_error` has it in words.
        """
        return int(self._fresh().error_code or 0)

    def is_moving(self) -> bool:
        """Return True if the jaws move by 0.05 rad/s (2.6 mm/s at 52.69 mm/rad) or more."""
        return self._fresh().is_moving

    def is_grasped(self) -> bool:
        """Return True if an object is being held by force."""
        return bool(self._fresh().is_grasped)

    def _fresh(self) -> GripperState:
        state = self.get_state()
        if state.stale or state.position_rad is None:
            raise CANTimeoutError(
                f"the motor has not answered lately (bus: {state.bus}): there is no new figure",
                reason="motor_silent",
                data={"hint": self._session.here("see health(), or litegripctl doctor")},
            )
        return state

    # Motions

    def move_at_speed_rad(
        self,
        target_rad: float,
        speed_rad_s: float = 0.5,
        kp: float | None = None,
        kd: float | None = None,
    ) -> MoveResult:
        """Move to a position of the motor, in rad, at a speed: as `move_at_speed` does."""
        config = self.config
        if config.pos_closed_rad is None or config.close_sign is None or config.rad_to_mm is None:
            return self.goto_rad(target_rad, kp, kd)  # which is rejected with the reason
        opening_rad = (config.pos_closed_rad - number("target_rad", target_rad)) * config.close_sign
        speed_mm_s = number("speed_rad_s", speed_rad_s) * config.rad_to_mm
        return self.move_at_speed(opening_rad * config.rad_to_mm, speed_mm_s, kp, kd)

    def enter_zero_gravity(self, duration: float = 0.0) -> bool:
        """Let the jaws go: enabled, without torque; true.

        With a `duration` it returns after so many seconds, and the jaws then hold; what ends a
        motion ends the wait at once, by the same error, and after `cancel` they hold. With 0 it
        returns at once, and they are loose until `exit_zero_gravity` or any motion.
        """
        lasts_s = number("duration", duration)
        if lasts_s < 0.0:
            raise ParameterError(
                f"duration is {lasts_s:g}, it must be 0 s or longer",
                reason="invalid_params",
                data={"parameter": "duration"},
            )
        began = self.zero_gravity()
        if lasts_s > 0.0:
            from litegrip_client.core.motion import stay  # noqa: PLC0415 - see above

            try:
                complete(stay(self._session, began.stop_generation, lasts_s))
            except LiteGripError:  # what the jaws do now is decided
                raise
            except BaseException:
                self.hold()
                raise
            self.hold()
        return True

    def exit_zero_gravity(self) -> bool:
        """Hold the jaws where they are; true."""
        self.hold()
        return True

    # Calibration

    def calibrate_guided(  # noqa: PLR0917 - the vendor's, by position
        self,
        kp: float | None = None,
        kd: float | None = None,
        step_rad: float | None = None,
        stall_delta: float | None = None,
        stall_cycles: int | None = None,
        max_iter: int | None = None,
        tau_limit: float | None = None,
    ) -> CalibrationData:
        """Measure the travel by probing both stops, as `calibrate` does."""
        return self.calibrate(kp, kd, step_rad, stall_delta, stall_cycles, max_iter, tau_limit)

    def calibrate_manual(
        self, duration: float = 30.0, settle_time: float = 2.0, sample_interval: float = 0.01
    ) -> CalibrationData:
        """Measure the travel while the jaws are moved by hand, and use it; nothing is saved.

        The jaws are loose for `duration` seconds: push them to both stops. The two extremes become
        the limits, the mount in use says which is the closed one, and `config.max_stroke_mm` how
        far the jaws open. Then the jaws hold, and
        `settle_time` seconds later this returns. The motor must be enabled. `sample_interval` is
        checked and not used: every period counts.

        Raises `CommandError` when no mount is known, or the jaws were hardly moved.
        """
        return calibrate_by_hand(
            self,
            number("duration", duration),
            number("settle_time", settle_time),
            number("sample_interval", sample_interval),
        )


LEAST_TRAVEL_RAD = 0.3
"""Less is no travel that a hand has pushed from stop to stop (1.3 to 1.8 rad as sold)."""
_HZ = 200.0


def calibrate_by_hand(
    gripper: SdkGripper, duration_s: float, settle_s: float, sample_interval_s: float
) -> CalibrationData:
    """Let the jaws go for a while, and use the extremes; raises `CommandError`."""
    for name, value, least in (
        ("duration", duration_s, 0.0),
        ("sample_interval", sample_interval_s, 0.0),
    ):
        if value <= least:
            text = f"{name} is {value:g}, it must be above {least:g}"
            raise ParameterError(text, reason="invalid_params", data={"parameter": name})
    mount = gripper.mount
    if mount is None:
        raise CommandError(
            "no mount is known, so nothing says which extreme is the closed one",
            reason="not_calibrated",
            data={"hint": "load_template('normal') or load_template('reverse') first"},
        )
    low_rad, high_rad = _extremes(gripper, duration_s)
    time.sleep(max(settle_s, 0.0))
    if high_rad - low_rad < LEAST_TRAVEL_RAD:
        raise CommandError(
            f"the jaws were moved by {high_rad - low_rad:.3f} rad only: push them to both stops",
            reason="out_of_limits",
            data={"limit": LEAST_TRAVEL_RAD, "requested": high_rad - low_rad},
        )
    closed_rad, open_rad = (high_rad, low_rad) if mount == "normal" else (low_rad, high_rad)
    travel_rad = high_rad - low_rad
    present = gripper.config
    from litegrip_client.values.calibration import CalibrationData  # noqa: PLC0415 - see above

    data = CalibrationData(
        channel=present.channel,
        can_id=present.can_id,
        mst_id=present.mst_id,
        motor_type=present.motor_type,
        calibrated=True,
        zero_position_rad=closed_rad,
        max_position_rad=open_rad,
        travel_range_rad=travel_rad,
        rad_to_mm=(present.max_stroke_mm + SPAN_INSET_MM) / travel_rad,
        work_stroke_mm=present.work_stroke_mm,
        nm_to_n=present.nm_to_n,
        kp=present.kp,
        kd=present.kd,
        calibration_time=time.time(),
    )
    gripper.use_calibration(data)
    return data


def _extremes(gripper: SdkGripper, duration_s: float) -> tuple[float, float]:
    """Return the least and the largest position (rad) while the jaws are loose; then they hold."""
    from litegrip_client.values.warn import leave  # noqa: PLC0415 - seldom needed

    async def hold() -> None:
        if gripper.is_connected:
            gripper.hold()

    try:
        gripper.zero_gravity()
        found = _seen(gripper, time.monotonic() + duration_s)
    except BaseException as error:
        if isinstance(error, ConnectError) and error.hint is not None:  # as of an iteration
            error.data["hint"] = error.hint.replace(".states()", ".calibrate_manual()")
        complete(leave(hold, error))  # where that fails, too, the first error is the one to see
        raise
    gripper.hold()
    return found


def _seen(gripper: SdkGripper, ends_s: float) -> tuple[float, float]:
    """Return the least and the largest position (rad) until then."""
    low_rad = high_rad = gripper.get_position_rad()
    with gripper.states(_HZ, ["position_rad", "stale"], batch=10) as states:
        for state in states:
            if state["position_rad"] is not None and not state["stale"]:
                low_rad = min(low_rad, state["position_rad"])
                high_rad = max(high_rad, state["position_rad"])
            if time.monotonic() >= ends_s:
                return low_rad, high_rad
    raise CommandError("the states ended before the calibration", reason="connection_lost")
