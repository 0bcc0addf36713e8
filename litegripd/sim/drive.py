"""The torque that the motor makes: its law, its lags, and what it measures of itself.

What the torque moves is behind `Mechanics`, so that another plant than the simulator's own can
stand behind the same motor. Inside, everything is counted in the closing direction (0 at the
calibrated closed limit, negative towards open), which makes both mounts one and the same; callers
see motor radians. This module knows no frames, registers or faults: those belong to `motor`.
"""

from __future__ import annotations

import math
from pathlib import Path
from typing import NamedTuple, Protocol

from litegripd.sim.plant import (
    STEP_S,
    STEPS_PER_S,
    STILL_RAD_S,
    GrippedObject,
    SimulatorParameters,
)

# Below this difference the current loop counts as settled; 1e-9 N·m moves nothing.
_SETTLED_NM = 1e-9


class Scene(NamedTuple):
    """Where the bodies of a scene are at a time of it: positions as MuJoCo orders them."""

    file: Path
    time_s: float
    qpos: list[float]


class Mechanics(Protocol):
    """What the motor's output shaft turns: jaws and their friction, ends, and what is around them.

    Angle, speed and torque count in the closing direction, the angle from the calibrated closed
    limit, in rad, rad/s and N·m. A plant that has no such thing as an object, a hand, a hold, or a
    scene, raises `ValueError` for it, with the reason.
    """

    @property
    def angle_rad(self) -> float:
        """Angle of the shaft; negative towards open."""

    @property
    def speed_rad_s(self) -> float:
        """Speed of the shaft."""

    @property
    def can_rest(self) -> bool:
        """True if a shaft that stands will stand for as long as the torque stays as it is."""

    def step(self, torque_nm: float) -> tuple[float, float]:
        """Advance by `STEP_S` under this torque; return angle and speed.

        The speed of a shaft that stands is 0.
        """

    def brake(self, damping_nm_s_rad: float) -> None:
        """Let the shaft be braked in proportion to its speed until the next call."""

    @property
    def hand_nm(self) -> float:
        """The torque of the hand that pushes the jaws."""

    def push(self, torque_nm: float, damping_nm_s_rad: float = 0.0) -> None:
        """Let a hand push with this torque until the next call; 0 lets go.

        With damping it pushes less, the faster the jaws yield: it leads them at a speed.
        """

    @property
    def is_jammed(self) -> bool:
        """True if something blocks the shaft."""

    def jam(self, *, jammed: bool) -> None:
        """Let something block the shaft where it is, whatever the torque; or let go of it."""

    @property
    def gripped_object(self) -> GrippedObject | None:
        """What is between the jaws, as it was put there."""

    @property
    def clamp_nm(self) -> float:
        """What the jaws press with on what is between them, as torque of the shaft."""

    def put(self, item: GrippedObject | None) -> None:
        """Put an object between the jaws in place of the present one; None takes it away."""

    def give_way(self, way_mm: float) -> None:
        """Let the object give way at once, towards closed."""

    def scene(self) -> Scene:
        """Return where the bodies around the shaft are, to draw them."""


class Drive:
    """The lagging torque of the motor, and its measurements, on mechanics."""

    def __init__(self, parameters: SimulatorParameters, mechanics: Mechanics) -> None:
        p = self._p = parameters
        self._mechanics = mechanics
        self._sign = p.close_sign
        self._current_decay = _decay(p.current_lag_s)
        self._filter_decay = _decay(p.torque_filter_s)
        self._torque = self._measured = 0.0
        self._filtered = self._speed_decay = 0.0  # the speed as the firmware knows it
        self._seen = mechanics.angle_rad  # the position as the firmware knows it
        if p.encoder_counts_per_rad:
            self._seen, _ = self._count(self._seen, self._seen, 0.0)
        self._most = math.inf
        self.made_share = 1.0
        """The motor makes, and reports, this share of the commanded torque."""
        self._heat_nm2 = 0.0
        self.brake()
        self.set_supply(p.rated_supply_v)
        self.set_speed_filter(p.speed_filter_hz)

    @property
    def measured_position_rad(self) -> float:
        """Position as the encoder counts it, in the frame of `position_rad`."""
        return self._p.closed_rad + self._sign * self._seen

    @property
    def measured_velocity_rad_s(self) -> float:
        """Velocity as the firmware measures it: by the encoder's steps, and filtered."""
        return self._sign * self._filtered

    @property
    def motor_torque_nm(self) -> float:
        """Torque that the motor makes now, in the motor's direction."""
        return self._sign * self._torque * self._p.torque_factor

    @property
    def measured_torque_nm(self) -> float:
        """The torque by the motor's own account, through the filter of its report."""
        return self._sign * self._measured

    def take_mean_square_torque(self, duration_s: float) -> float:
        """Return the mean of the squared torque over the last `duration_s`, and restart."""
        mean = self._heat_nm2 * STEP_S / duration_s
        self._heat_nm2 = 0.0
        return mean

    def drive(
        self,
        *,
        position_rad: float,
        velocity_rad_s: float,
        kp_nm_rad: float,
        kd_nm_s_rad: float,
        torque_nm: float,
        most_nm: float = math.inf,
    ) -> None:
        """Follow the torque law kp·(q - q_measured) + kd·(dq - dq_measured) + tau from now on.

        The torque is at most `most_nm` in both directions, whatever the law and the drive allow.
        """
        sign = self._sign
        self._position = sign * (position_rad - self._p.closed_rad)
        self._velocity = sign * velocity_rad_s
        self._kp = kp_nm_rad
        self._kd = kd_nm_s_rad
        self._feed_forward = sign * torque_nm
        self._most = most_nm
        self._mechanics.brake(0.0)

    def brake(self) -> None:
        """Make no torque and short the phases, which brakes in proportion to the speed."""
        self._position = self._velocity = self._kp = self._kd = self._feed_forward = 0.0
        self._torque = 0.0
        self._most = math.inf
        self._mechanics.brake(self._p.braking_nm_s_rad)

    def set_supply(self, volts: float) -> None:
        """Set what the supply allows: the no-load speed and the torque on the way there.

        A brushless drive makes at most V/√3 across a phase, so that the torque falls linearly
        from kt·V/(√3·R) at standstill to nothing at the no-load speed.
        """
        p = self._p
        stall_nm = p.torque_constant_nm_a * volts / (math.sqrt(3.0) * p.phase_resistance_ohm)
        self._limit = min(p.torque_limit_nm, stall_nm)
        self._speed_limit = p.no_load_speed_rad_s * volts / p.rated_supply_v
        self._speed_slope = stall_nm / self._speed_limit if volts > 0 else 0.0
        # Beyond this speed the supply bounds the torque, below it the current limit does.
        self._knee = self._speed_limit - self._limit / self._speed_slope if volts > 0 else 0.0

    def set_speed_filter(self, corner_hz: float) -> None:
        """Filter the measured speed in first order with this corner from now on; 0 is no filter."""
        self._speed_decay = _decay(1.0 / (math.tau * corner_hz)) if corner_hz else 0.0

    def run(self, steps: int) -> None:
        """Advance by this many steps of `STEP_S`.

        One loop over local variables: it runs inside a control thread of 200 Hz, where objects in
        every step would cost more than the physics. It ends early when the jaws are stuck and
        current and measured speed have settled: no further step changes anything then.
        """
        mechanics = self._mechanics
        s, v, step = mechanics.angle_rad, mechanics.speed_rad_s, mechanics.step
        torque, measured = self._torque, self._measured
        position, velocity, kp, kd = self._position, self._velocity, self._kp, self._kd
        feed_forward, limit, knee = self._feed_forward, self._limit, self._knee
        current_decay, filter_decay = self._current_decay, self._filter_decay
        filtered, speed_decay, seen = self._filtered, self._speed_decay, self._seen
        made_share, factor = self.made_share, self._p.torque_factor
        limit, has_steps = min(limit, self._most), self._p.encoder_counts_per_rad > 0.0
        heat = self._heat_nm2  # added to step by step: its rounding is the same for all slices
        done = 0
        for done in range(1, steps + 1):  # noqa: B007 - read after an early end
            wanted = kp * (position - seen) + kd * (velocity - filtered) + feed_forward
            wanted *= made_share
            if not (-limit <= wanted <= limit and -knee <= v <= knee):
                wanted = self._attainable(wanted, v)
            torque = wanted + (torque - wanted) * current_decay
            measured = torque + (measured - torque) * filter_decay
            heat += torque * torque
            stood = v == 0.0
            s, v = step(torque * factor)
            if v == 0.0:
                if stood and filtered == 0.0 and mechanics.can_rest:
                    if torque == wanted:
                        break
                    torque = _settled(torque, wanted, _SETTLED_NM)
                filtered = _settled(filtered, 0.0, STILL_RAD_S)
            if has_steps:
                seen, filtered = self._count(s, seen, filtered)
            else:
                filtered = v + (filtered - v) * speed_decay
                seen = s
        for _ in range(steps - done):
            measured = torque + (measured - torque) * filter_decay
            heat += torque * torque
        self._torque, self._measured = torque, measured
        self._heat_nm2 = heat
        self._filtered, self._seen = filtered, seen

    def _count(self, s: float, seen: float, filtered: float) -> tuple[float, float]:
        """Return position and filtered speed by the steps of the encoder, after those before."""
        counts = self._p.encoder_counts_per_rad
        angle = s * counts // 1.0 / counts
        speed = (angle - seen) * STEPS_PER_S
        return angle, speed + (filtered - speed) * self._speed_decay

    def _attainable(self, wanted: float, v: float) -> float:
        """Return the torque nearest to `wanted` that current limit and supply allow at a speed."""
        high, low = self._limit, -self._limit
        if v > self._knee:
            high = max(self._speed_slope * (self._speed_limit - v), 0.0)
        elif v < -self._knee:
            low = min(-self._speed_slope * (self._speed_limit + v), 0.0)
        return min(max(wanted, low, -self._most), high, self._most)


def _settled(value: float, end: float, within: float) -> float:
    """Return the end that a value approaches once it is this near, and the value until then."""
    return end if -within < value - end < within else value


def _decay(time_s: float) -> float:
    """Return what is left of a first-order lag's error after one step; without a lag, nothing."""
    return math.exp(-STEP_S / time_s) if time_s > 0.0 else 0.0
