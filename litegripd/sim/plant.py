"""The mechanics of the gripper, and the parameters of its mechanics and its drive.

One frozen `SimulatorParameters` describes one gripper: its mechanics, its drive, its heat and its
geometry, each figure with where it comes from.

Time advances in fixed steps of 0.25 ms, so that the result never depends on how a caller slices
time. `Plant` is the mechanics that the simulator has by itself; `drive` says what any mechanics
have, and makes the torque. Nothing here knows frames, registers or faults: those belong to `motor`.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from typing import NoReturn

from litegripd.model.gripper import DM4310, MotorType

MOUNTS = ("normal", "reverse")

SPEED_FILTER_MAX_HZ = 500.0
"""The largest value that register V_BW takes."""

UNASKED_MAX_HZ = 1000.0
"""About 10 Hz was seen; a bus at 1 Mbit/s bears this beside 200 commands a second."""

ENCODER_COUNTS_PER_RAD = (1 << 14) * DM4310.gear_ratio / math.tau
"""About 26,000 steps per rad of the output: 14 bits a turn of the rotor and the gear of 10.

The 14 bits are from the maker's data sheet; that the rotor's encoder measures is an estimate.
"""


@dataclass(frozen=True, slots=True)
class SimulatorParameters:
    """All figures of one gripper; every torque and angle is at the motor's output shaft.

    `closed_rad` and `open_rad` are what a calibration would find: where the jaws are while they
    are pressed against that end with `press_torque_nm`. Their order is the mount: closing
    increases radians when `closed_rad` is the larger one.

    Raises `ValueError` for a figure that is not finite or out of its range.
    """

    # What the motor's registers say of its type. The figures below are a DM4310's as well; those
    # of another type are made by `of_motor`.
    motor_type: MotorType = DM4310

    # Identifiers (motor's manual: the factory setting of these grippers).
    can_id: int = 0x08
    master_id: int = 0x18

    # Time without a command in register TIMEOUT (motors are known with 0.1 s, 0.4 s and 0), and the
    # time after which the motor really disarms. None: what the register says. Else whatever it
    # says, 0 for never: 0.1, 0.4 and 0.9 s have been measured, on motors that read 0.4 s and 0.
    watchdog_s: float = 0.1
    comm_loss_s: float | None = None

    # Time without a command after which a disabled motor latches the same fault; 0 is never. 0.9 s
    # was measured (vendor's bench), and called normal there. As in an enabled one, requests for the
    # status do not count as commands: that is the harsher assumption.
    idle_loss_s: float = 0.0

    # How often the motor reports by itself while it is enabled; 0 is never. About 10 Hz was seen.
    unasked_hz: float = 0.0

    # Geometry (vendor's newest calibration file, normal mount).
    closed_rad: float = 0.0
    open_rad: float = -1.651026
    rad_to_mm: float = 52.69
    initial_opening_mm: float = 60.0

    # Inertia (maker's table; gripper's model files: 2 x 35.45 g at about 26 mm/rad each).
    rotor_inertia_kg_m2: float = DM4310.rotor_inertia_kg_m2
    finger_inertia_kg_m2: float = 4.9e-5

    # Friction (motor's manual for the breakaway, estimates for the rest).
    breakaway_nm: float = DM4310.breakaway_nm
    coulomb_nm: float = DM4310.coulomb_nm
    viscous_nm_s_rad: float = DM4310.viscous_nm_s_rad

    # Close-side stick-slip (field measurements: a dead band of about 0.010 rad at the stock
    # stiffness of 100 N·m/rad). A little under 1 N·m, because the calibration's probe
    # (20 N·m/rad x 0.05 rad) is known to get through. It holds standing and slow jaws and leaves
    # travel at 50 mm/s (0.95 rad/s) nearly unhindered; speed and zone are estimates.
    close_stick_nm: float = 0.95
    close_stick_speed_rad_s: float = 0.08
    close_stick_zone_rad: float = 0.10

    # Ends (gripper's manual: the closed end springs back about 0.0275 rad after a press of 1 N·m;
    # field measurements: the open end has about 250 N·m/rad; damping is an estimate).
    press_torque_nm: float = 0.94
    closed_springback_rad: float = 0.0275
    closed_springback_press_nm: float = 1.0
    closed_damping_nm_s_rad: float = 0.13
    open_stiffness_nm_rad: float = 250.0
    open_damping_nm_s_rad: float = 0.4

    # Drive (maker's table; the braking of the shorted phases from field measurements).
    torque_constant_nm_a: float = DM4310.torque_constant_nm_a
    current_limit_a: float = DM4310.current_limit_a
    phase_resistance_ohm: float = DM4310.phase_resistance_ohm
    no_load_speed_rad_s: float = DM4310.no_load_speed_rad_s
    rated_supply_v: float = 24.0
    braking_nm_s_rad: float = DM4310.braking_nm_s_rad
    current_lag_s: float = 1.0e-3
    torque_filter_s: float = 4.5e-3
    torque_factor: float = 1.0  # the true torque as a share of what the motor believes and reports

    # What the firmware measures. The speed filter is register 32, V_BW: 0 to 500. The maker names
    # no unit. It is taken as the corner of a first-order filter in Hz: field trials found a lag of
    # 1 to 2 ms, which is 160 to 80 Hz, while 500 rad/s would be 2 ms at least. 0 is taken as no
    # filter. The counts are at the output; 0 is an encoder without steps, `ENCODER_COUNTS_PER_RAD`
    # a likely one. The speed is the change of the counted position in a step of the simulation.
    speed_filter_hz: float = 100.0
    encoder_counts_per_rad: float = 0.0

    # Heat (estimates: 4.3 K/W in all, of which the housing, 750 s, holds the smaller part).
    ambient_c: float = 25.0
    winding_k_w: float = DM4310.winding_k_w
    winding_time_s: float = DM4310.winding_s
    housing_k_w: float = DM4310.housing_k_w
    housing_time_s: float = DM4310.housing_s
    driver_k_w: float = 0.4
    driver_time_s: float = 30.0
    driver_trip_c: float = 120.0  # firmware; the coil's limit is register 2

    def __post_init__(self) -> None:
        for field in fields(self):
            value = getattr(self, field.name)
            if value is None or isinstance(value, MotorType):
                continue
            if not math.isfinite(value):
                raise ValueError(f"{field.name} must be a finite number, not {value!r}")
            if field.name not in _MAY_BE_ANY_SIGN and value < 0:
                raise ValueError(f"{field.name} must not be negative, but is {value!r}")
            if field.name in _MUST_BE_POSITIVE and value == 0:
                raise ValueError(f"{field.name} must be more than 0")
            most = _MOST.get(field.name, math.inf)
            if value > most:
                raise ValueError(f"{field.name} must be at most {most:g}, but is {value!r}")
        self._check_together()

    def _check_together(self) -> None:
        if self.closed_rad == self.open_rad:
            raise ValueError("closed_rad and open_rad are equal; the jaws would have no travel")
        if not 0 < self.can_id <= 0x7FE or not 0 <= self.master_id <= 0x7FE:
            raise ValueError(
                f"can_id must be 1 to 0x7FE and master_id 0 to 0x7FE, "
                f"but they are {self.can_id:#x} and {self.master_id:#x}"
            )
        if self.coulomb_nm > self.breakaway_nm or self.breakaway_nm > self.close_stick_nm:
            raise ValueError("friction must grow: coulomb_nm <= breakaway_nm <= close_stick_nm")
        if self.closed_springback_press_nm <= 2 * self.coulomb_nm:
            raise ValueError("closed_springback_press_nm must be more than twice coulomb_nm")
        if self.press_torque_nm <= self.coulomb_nm:
            raise ValueError("press_torque_nm must be more than coulomb_nm")

    def of_motor(self, motor_type: MotorType) -> SimulatorParameters:
        """Return the same gripper with a motor of this type; its ends stay as stiff as they are."""
        useful_nm = self.closed_springback_press_nm - 2 * motor_type.coulomb_nm
        return replace(
            self,
            motor_type=motor_type,
            rotor_inertia_kg_m2=motor_type.rotor_inertia_kg_m2,
            breakaway_nm=motor_type.breakaway_nm,
            coulomb_nm=motor_type.coulomb_nm,
            viscous_nm_s_rad=motor_type.viscous_nm_s_rad,
            closed_springback_rad=useful_nm / self.closed_stiffness_nm_rad,
            torque_constant_nm_a=motor_type.torque_constant_nm_a,
            current_limit_a=motor_type.current_limit_a,
            phase_resistance_ohm=motor_type.phase_resistance_ohm,
            no_load_speed_rad_s=motor_type.no_load_speed_rad_s,
            braking_nm_s_rad=motor_type.braking_nm_s_rad,
            winding_k_w=motor_type.winding_k_w,
            winding_time_s=motor_type.winding_s,
            housing_k_w=motor_type.housing_k_w,
            housing_time_s=motor_type.housing_s,
        )

    @property
    def close_sign(self) -> int:
        """+1 when closing increases radians (mount "normal"), -1 otherwise."""
        return 1 if self.closed_rad > self.open_rad else -1

    @property
    def inertia_kg_m2(self) -> float:
        """Rotor and fingers together, at the output."""
        return self.rotor_inertia_kg_m2 + self.finger_inertia_kg_m2

    @property
    def closed_stiffness_nm_rad(self) -> float:
        """Stiffness of the closed end that gives the measured spring-back.

        Friction costs twice: it keeps the press from going home by `coulomb_nm`, and it stops the
        way back while the end still pushes with `coulomb_nm`.
        """
        useful_nm = self.closed_springback_press_nm - 2 * self.coulomb_nm
        return useful_nm / self.closed_springback_rad

    @property
    def torque_limit_nm(self) -> float:
        """The most that the current limit allows, about 9.7 N·m."""
        return self.torque_constant_nm_a * self.current_limit_a


_MAY_BE_ANY_SIGN = frozenset({"closed_rad", "open_rad", "initial_opening_mm", "ambient_c"})
_MOST = {"speed_filter_hz": SPEED_FILTER_MAX_HZ, "unasked_hz": UNASKED_MAX_HZ}
_MUST_BE_POSITIVE = frozenset(
    {
        "rad_to_mm",
        "rotor_inertia_kg_m2",
        "close_stick_speed_rad_s",
        "closed_springback_rad",
        "open_stiffness_nm_rad",
        "torque_constant_nm_a",
        "torque_factor",
        "current_limit_a",
        "phase_resistance_ohm",
        "no_load_speed_rad_s",
        "rated_supply_v",
        "torque_filter_s",
        "winding_time_s",
        "housing_time_s",
        "driver_time_s",
    }
)


def limits_of_mount(mount: str) -> tuple[float, float]:
    """Return the (closed, open) limits in rad of the calibration template of a mount.

    Raises `ValueError` for a mount other than "normal" and "reverse".
    """
    if mount not in MOUNTS:
        raise ValueError(f"mount must be one of {', '.join(MOUNTS)}, not {mount!r}")
    return (0.0, -1.651026) if mount == "normal" else (-1.651026, 0.0)


STEP_S = 0.25e-3
STEPS_PER_S = 4000
STIFFEST_NM_RAD = 5000.0
"""The stiffest object that these steps bear."""

STILL_RAD_S = 1e-6
"""Below this speed the jaws stand; what they would still creep is far below 1e-6 rad."""


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
        if not 0 < self.stiffness_nm_rad <= STIFFEST_NM_RAD:
            raise ValueError(
                f"stiffness_nm_rad must be more than 0 and at most {STIFFEST_NM_RAD:g}, "
                f"but is {self.stiffness_nm_rad!r}"
            )


class Plant:
    """Jaws, friction, ends, object and hand: what the motor's torque moves; see `drive.Mechanics`.

    Semi-implicit Euler with implicit damping and a friction that can only stop motion, never
    reverse it: the integration is stable for every gain that a command frame can carry. A damping
    gain that shakes does so because the current and the measured speed lag, as in a real motor.
    """

    def __init__(self, parameters: SimulatorParameters) -> None:
        p = self._p = parameters
        self._gain = STEP_S / p.inertia_kg_m2
        # Where the ends begin: pressed with the press torque, the jaws stand at the limits.
        useful_nm = p.press_torque_nm - p.coulomb_nm
        travel_rad = abs(p.closed_rad - p.open_rad)
        self._closed_k = p.closed_stiffness_nm_rad
        self._closed_at = -useful_nm / self._closed_k
        self._open_at = -travel_rad + useful_nm / p.open_stiffness_nm_rad
        self._zone_at = self._closed_at - p.close_stick_zone_rad
        self.angle_rad = -p.initial_opening_mm / p.rad_to_mm
        self.speed_rad_s = 0.0
        self._hand = self._hand_damping = 0.0
        self._object_at = math.inf
        self.jam(jammed=False)
        self.put(None)
        self.brake(0.0)

    @property
    def clamp_nm(self) -> float:
        """What the object feels, as torque at the output; 0 where the jaws do not press on one."""
        item = self.gripped_object
        if item is None or self.angle_rad <= self._object_at:
            return 0.0
        press_nm = item.stiffness_nm_rad * (self.angle_rad - self._object_at)
        return max(press_nm + item.damping_nm_s_rad * self.speed_rad_s, 0.0)

    @property
    def hand_nm(self) -> float:
        """The torque of the hand that pushes the jaws."""
        return self._hand - self._hand_damping * self.speed_rad_s

    def brake(self, damping_nm_s_rad: float) -> None:
        """Let the shaft be braked in proportion to its speed until the next call."""
        self._own_damping = damping_nm_s_rad + self._p.viscous_nm_s_rad
        self._free_damping = 1.0 + self._gain * (self._own_damping + self._hand_damping)

    def push(self, torque_nm: float, damping_nm_s_rad: float = 0.0) -> None:
        """Let a hand push with this torque until the next call; 0 lets go.

        With damping it pushes less, the faster the jaws yield: it leads them at a speed.
        """
        self._hand, self._hand_damping = torque_nm, damping_nm_s_rad
        self._free_damping = 1.0 + self._gain * (self._own_damping + damping_nm_s_rad)

    def jam(self, *, jammed: bool) -> None:
        """Let something block the shaft where it is, whatever the torque; or let go of it."""
        self.is_jammed = jammed
        self.can_rest = True
        friction = (math.inf, math.inf) if jammed else (self._p.coulomb_nm, self._p.breakaway_nm)
        self._drags = (self._gain * friction[0], self._gain * friction[1])
        self._bound_free_travel()

    def put(self, item: GrippedObject | None) -> None:
        """Put an object between the jaws in place of the present one; None takes it away."""
        self.gripped_object = item
        self._object_at = math.inf if item is None else -item.width_mm / self._p.rad_to_mm
        self._bound_free_travel()

    def give_way(self, way_mm: float) -> None:
        """Let the object give way at once, towards closed."""
        self._object_at += way_mm / self._p.rad_to_mm
        self._bound_free_travel()

    def scene(self) -> NoReturn:
        """Raise `ValueError`: here are numbers, and no bodies."""
        raise ValueError(
            "the simulator's own mechanics have no bodies to draw; litegripd --simulate mujoco has"
        )

    def step(self, torque_nm: float) -> tuple[float, float]:
        """Advance by `STEP_S` under this torque; return angle and speed."""
        s, v, force = self.angle_rad, self.speed_rad_s, torque_nm + self._hand
        if self._free_from < s < self._free_to:
            drag = self._drags[0] if v else self._drags[1]
            damping = self._free_damping
        else:
            force, damping, drag = self._resist(s, v, force)
        swing = v + self._gain * force
        if swing > drag + STILL_RAD_S:
            v = (swing - drag) / damping
            s += v * STEP_S
        elif swing < -drag - STILL_RAD_S:
            v = (swing + drag) / damping
            s += v * STEP_S
        else:
            v = 0.0
        self.angle_rad, self.speed_rad_s = s, v
        return s, v

    def _bound_free_travel(self) -> None:
        """Note between where nothing but friction resists; a blocked rotor meets nothing else."""
        self._free_from = -math.inf if self.is_jammed else self._open_at
        self._free_to = math.inf if self.is_jammed else min(self._zone_at, self._object_at)

    def _resist(self, s: float, v: float, force: float) -> tuple[float, float, float]:
        """Return force, damping factor and drag where the ends, the object or the zone resist.

        A spring and damper never pull: where the damper would, the jaws have come off.
        """
        p, gain = self._p, self._gain
        damping = self._free_damping
        friction = p.coulomb_nm if v else p.breakaway_nm
        self.can_rest = True
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
        item = self.gripped_object
        if item is not None and s > self._object_at:
            press = item.stiffness_nm_rad * (s - self._object_at)
            if press + item.damping_nm_s_rad * v > 0.0:
                force -= press
                damping += gain * item.damping_nm_s_rad
                friction += item.friction_nm
                if item.yield_mm_s > 0.0 and press > item.yield_torque_nm:
                    self.can_rest = False
                    self._object_at += item.yield_mm_s / p.rad_to_mm * STEP_S
                    self._bound_free_travel()
        return force, damping, gain * friction
