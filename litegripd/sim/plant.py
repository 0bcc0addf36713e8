"""The mechanics of the gripper and the torque that its motor makes.

Time advances in fixed steps of 0.25 ms, so that the result never depends on how a caller slices
time. Inside, everything is counted in the closing direction (`s`, 0 at the calibrated closed limit,
negative towards open), which makes both mounts one and the same; callers see motor radians.
This module knows no frames, registers or faults: those belong to `motor`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from litegripd.sim.parameters import SimulatorParameters

STEP_S = 0.25e-3
STEPS_PER_S = 4000

# Below this difference the current loop counts as settled; 1e-9 N·m moves nothing.
_SETTLED_NM = 1e-9
# Below this speed the jaws stand; what they would still creep is far below 1e-6 rad.
_STILL_RAD_S = 1e-6


@dataclass(frozen=True, slots=True)
class GrippedObject:
    """Something between the jaws that resists closing.

    `width_mm` is the opening at which the jaws touch it. Its stiffness, damping and friction act at
    the motor's output, while the jaws press on it. It gives way at `yield_mm_s` for as long as the
    jaws press with more than `yield_torque_nm`.

    Raises `ValueError` for a figure that is not finite or out of its range.
    """

    width_mm: float
    stiffness_nm_rad: float = 250.0
    damping_nm_s_rad: float = 0.4
    friction_nm: float = 0.0
    yield_mm_s: float = 0.0
    yield_torque_nm: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__slots__:
            value = getattr(self, name)
            if not math.isfinite(value) or value < 0:
                raise ValueError(f"{name} must be finite and not negative, but is {value!r}")
        if not 0 < self.stiffness_nm_rad <= 5000:
            raise ValueError(
                f"stiffness_nm_rad must be more than 0 and at most 5000, "
                f"but is {self.stiffness_nm_rad!r}"
            )


class Plant:
    """Jaws, friction, ends, object and hand, and the lagging torque of the motor.

    Semi-implicit Euler with implicit damping and a friction that can only stop motion, never
    reverse it: the integration is stable for every gain that a command frame can carry. A damping
    gain that shakes does so because the current and the measured speed lag, as in a real motor.
    """

    def __init__(self, parameters: SimulatorParameters) -> None:
        p = self._p = parameters
        self._sign = p.close_sign
        self._gain = STEP_S / p.inertia_kg_m2
        self._current_decay = _decay(p.current_lag_s)
        self._filter_decay = _decay(p.torque_filter_s)
        # Where the ends begin: pressed with the press torque, the jaws stand at the limits.
        useful_nm = p.press_torque_nm - p.coulomb_nm
        travel_rad = abs(p.closed_rad - p.open_rad)
        self._closed_k = p.closed_stiffness_nm_rad
        self._closed_at = -useful_nm / self._closed_k
        self._open_at = -travel_rad + useful_nm / p.open_stiffness_nm_rad
        self._zone_at = self._closed_at - p.close_stick_zone_rad
        self._s = -p.initial_opening_mm / p.rad_to_mm
        self._v = self._torque = self._measured = self._hand = 0.0
        self._filtered = self._speed_decay = 0.0  # the speed as the firmware knows it
        self._seen = self._s  # the position as the firmware knows it
        if p.encoder_counts_per_rad:
            self._seen, _ = self._count(self._s, self._s, 0.0)
        self._most = math.inf
        self._energy_nm2_s = 0.0
        self._object_at = math.inf
        self.jam(jammed=False)
        self.put(None)
        self.brake()
        self.set_supply(p.rated_supply_v)
        self.set_speed_filter(p.speed_filter_hz)

    @property
    def position_rad(self) -> float:
        """Mechanical position in motor radians, in the frame of the calibrated limits."""
        return self._p.closed_rad + self._sign * self._s

    @property
    def velocity_rad_s(self) -> float:
        """Velocity in motor radians per second."""
        return self._sign * self._v

    @property
    def measured_position_rad(self) -> float:
        """Position as the encoder counts it, in the frame of `position_rad`."""
        return self._p.closed_rad + self._sign * self._seen

    @property
    def measured_velocity_rad_s(self) -> float:
        """Velocity as the firmware measures it: by the encoder's steps, and filtered."""
        return self._sign * self._filtered

    @property
    def opening_mm(self) -> float:
        """Opening, 0 at the calibrated closed limit, positive towards open."""
        return -self._s * self._p.rad_to_mm

    @property
    def motor_torque_nm(self) -> float:
        """Torque that the motor makes now, in the motor's direction."""
        return self._sign * self._torque

    @property
    def measured_torque_nm(self) -> float:
        """The same torque through the filter of the motor's own report."""
        return self._sign * self._measured

    @property
    def clamp_nm(self) -> float:
        """What the object feels, as torque at the output; 0 where the jaws do not press on one."""
        item = self._object
        if item is None or self._s <= self._object_at:
            return 0.0
        press_nm = item.stiffness_nm_rad * (self._s - self._object_at)
        return max(press_nm + item.damping_nm_s_rad * self._v, 0.0)

    @property
    def gripped_object(self) -> GrippedObject | None:
        """What is between the jaws, as it was put there."""
        return self._object

    def take_mean_square_torque(self, duration_s: float) -> float:
        """Return the mean of the squared torque over the last `duration_s`, and restart."""
        mean = self._energy_nm2_s / duration_s
        self._energy_nm2_s = 0.0
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
        self._free_damping = 1.0 + self._gain * self._p.viscous_nm_s_rad

    def brake(self) -> None:
        """Make no torque and short the phases, which brakes in proportion to the speed."""
        self._position = self._velocity = self._kp = self._kd = self._feed_forward = 0.0
        self._torque = 0.0
        self._most = math.inf
        damping_nm_s_rad = self._p.viscous_nm_s_rad + self._p.braking_nm_s_rad
        self._free_damping = 1.0 + self._gain * damping_nm_s_rad

    def push(self, torque_nm: float) -> None:
        """Let a hand push with this torque (motor's direction) until the next call; 0 lets go."""
        self._hand = self._sign * torque_nm

    def jam(self, *, jammed: bool) -> None:
        """Let something block the rotor where it is, whatever the torque; or let go of it."""
        self._jammed = jammed
        self._yielding = False
        friction = (math.inf, math.inf) if jammed else (self._p.coulomb_nm, self._p.breakaway_nm)
        self._drags = (self._gain * friction[0], self._gain * friction[1])
        self._bound_free_travel()

    def put(self, item: GrippedObject | None) -> None:
        """Put an object between the jaws in place of the present one; None takes it away."""
        self._object = item
        self._object_at = math.inf if item is None else -item.width_mm / self._p.rad_to_mm
        self._bound_free_travel()

    def give_way(self, way_mm: float) -> None:
        """Let the object give way at once, towards closed."""
        self._object_at += way_mm / self._p.rad_to_mm
        self._bound_free_travel()

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

        One loop over local variables: it runs inside a control thread of 200 Hz, where calls and
        objects in every step would cost more than the physics. It ends early when the jaws are
        stuck and current and measured speed have settled: no further step changes anything then.
        """
        s, v, torque, measured = self._s, self._v, self._torque, self._measured
        position, velocity, kp, kd = self._position, self._velocity, self._kp, self._kd
        feed_forward, hand, free_damping = self._feed_forward, self._hand, self._free_damping
        limit, knee, free_from, free_until = self._limit, self._knee, self._free_from, self._free_to
        gain, current_decay, filter_decay = self._gain, self._current_decay, self._filter_decay
        moving_drag, still_drag = self._drags
        filtered, speed_decay, seen = self._filtered, self._speed_decay, self._seen
        limit, has_steps = min(limit, self._most), self._p.encoder_counts_per_rad > 0.0
        heat = 0.0
        done = 0
        for done in range(1, steps + 1):  # noqa: B007 - read after an early end
            wanted = kp * (position - seen) + kd * (velocity - filtered) + feed_forward
            if not (-limit <= wanted <= limit and -knee <= v <= knee):
                wanted = self._attainable(wanted, v)
            torque = wanted + (torque - wanted) * current_decay
            measured = torque + (measured - torque) * filter_decay
            heat += torque * torque
            if free_from < s < free_until:
                swing = v + gain * (torque + hand)
                drag = moving_drag if v else still_drag
                damping = free_damping
            else:
                force, damping, drag = self._resist(s, v, torque + hand)
                swing = v + gain * force
                free_until = self._free_to
            if swing > drag + _STILL_RAD_S:
                v = (swing - drag) / damping
                s += v * STEP_S
            elif swing < -drag - _STILL_RAD_S:
                v = (swing + drag) / damping
                s += v * STEP_S
            else:
                if v == filtered == 0.0 and not self._yielding:
                    if torque == wanted:
                        break
                    torque = _settled(torque, wanted, _SETTLED_NM)
                filtered = _settled(filtered, 0.0, _STILL_RAD_S)
                v = 0.0
            if has_steps:
                seen, filtered = self._count(s, seen, filtered)
            else:
                filtered = v + (filtered - v) * speed_decay
                seen = s
        for _ in range(steps - done):
            measured = torque + (measured - torque) * filter_decay
            heat += torque * torque
        self._s, self._v, self._torque, self._measured = s, v, torque, measured
        self._energy_nm2_s += heat * STEP_S
        self._filtered, self._seen = filtered, seen

    def _count(self, s: float, seen: float, filtered: float) -> tuple[float, float]:
        """Return position and filtered speed by the steps of the encoder, after those before."""
        counts = self._p.encoder_counts_per_rad
        angle = s * counts // 1.0 / counts
        speed = (angle - seen) * STEPS_PER_S
        return angle, speed + (filtered - speed) * self._speed_decay

    def _bound_free_travel(self) -> None:
        """Note between where nothing but friction resists; a blocked rotor meets nothing else."""
        self._free_from = -math.inf if self._jammed else self._open_at
        self._free_to = math.inf if self._jammed else min(self._zone_at, self._object_at)

    def _attainable(self, wanted: float, v: float) -> float:
        """Return the torque nearest to `wanted` that current limit and supply allow at a speed."""
        high, low = self._limit, -self._limit
        if v > self._knee:
            high = max(self._speed_slope * (self._speed_limit - v), 0.0)
        elif v < -self._knee:
            low = min(-self._speed_slope * (self._speed_limit + v), 0.0)
        return min(max(wanted, low, -self._most), high, self._most)

    def _resist(self, s: float, v: float, force: float) -> tuple[float, float, float]:
        """Return force, damping factor and drag where the ends, the object or the zone resist.

        A spring and damper never pull: where the damper would, the jaws have come off.
        """
        p, gain = self._p, self._gain
        damping = self._free_damping
        friction = p.coulomb_nm if v else p.breakaway_nm
        self._yielding = False
        if s > self._closed_at:
            press = self._closed_k * (s - self._closed_at)
            if press + p.closed_damping_nm_s_rad * v > 0.0:
                force -= press
                damping += gain * p.closed_damping_nm_s_rad
        elif s < self._open_at:
            press = p.open_stiffness_nm_rad * (s - self._open_at)
            if press + p.open_damping_nm_s_rad * v < 0.0:
                force -= press
                damping += gain * p.open_damping_nm_s_rad
        elif s > self._zone_at and (v > 0.0 or (v == 0.0 and force > 0.0)):
            ratio = v / p.close_stick_speed_rad_s
            friction += (p.close_stick_nm - friction) / (1.0 + ratio * ratio)
        if self._object is not None and s > self._object_at:
            press = self._object.stiffness_nm_rad * (s - self._object_at)
            if press + self._object.damping_nm_s_rad * v > 0.0:
                force -= press
                damping += gain * self._object.damping_nm_s_rad
                friction += self._object.friction_nm
                self._let_object_yield(self._object, press)
        return force, damping, gain * friction

    def _let_object_yield(self, item: GrippedObject, press_nm: float) -> None:
        if item.yield_mm_s > 0.0 and press_nm > item.yield_torque_nm:
            self._yielding = True
            self._object_at += item.yield_mm_s / self._p.rad_to_mm * STEP_S
            self._bound_free_travel()


def _settled(value: float, end: float, within: float) -> float:
    """Return the end that a value approaches once it is this near, and the value until then."""
    return end if -within < value - end < within else value


def _decay(time_s: float) -> float:
    """Return what is left of a first-order lag's error after one step; without a lag, nothing."""
    return math.exp(-STEP_S / time_s) if time_s > 0.0 else 0.0
