"""A whole gripper in one object: the motor's firmware, the mechanics, and a hand on the world.

Everything that happens on its bus passes through `receive`, the one place where frames enter and
leave. It knows no bus and no clock; all times come from the caller.
"""

from __future__ import annotations

import copy
import math
import sys
import threading
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from litegripd.model.gripper import DM4310, MOTOR_TYPES, why_not_driven
from litegripd.model.motor import MUJOCO, CanFrame
from litegripd.sim.drive import Drive, Mechanics, Scene
from litegripd.sim.motor import FAULTS, SimulatedMotor
from litegripd.sim.plant import (
    STIFFEST_NM_RAD,
    UNASKED_MAX_HZ,
    GrippedObject,
    Plant,
    SimulatorParameters,
    limits_of_mount,
)


class SimulatedGripper:
    """A simulated gripper: the same inputs at the same times give the same outputs.

    `seed` gives the reports a noise of at most one code; without one they are exact. `mechanics`
    are what the motor turns, in place of the simulator's own. Every method may be called from any
    thread.
    """

    def __init__(
        self,
        parameters: SimulatorParameters | None = None,
        *,
        seed: int | None = None,
        mechanics: Mechanics | None = None,
    ) -> None:
        self.parameters = SimulatorParameters() if parameters is None else parameters
        """The figures that this gripper was built from."""
        self._plant: Mechanics = Plant(self.parameters) if mechanics is None else mechanics
        self._drive = Drive(self.parameters, self._plant)
        self._motor = SimulatedMotor(self._drive, self.parameters, seed=seed)
        self._lock = threading.RLock()

    def fork(self) -> SimulatedGripper:
        """Return a gripper in the same state, which goes its own way from now on."""
        other = SimulatedGripper(self.parameters)
        with self._lock:
            parts = copy.deepcopy((self._plant, self._drive, self._motor))
        other._plant, other._drive, other._motor = parts
        return other

    @property
    def motor(self) -> SimulatedMotor:
        """The motor's firmware, to look at its status, registers and temperatures."""
        return self._motor

    @property
    def position_rad(self) -> float:
        """True mechanical position; the motor reports it shifted by its own zero."""
        return self.parameters.closed_rad + self.parameters.close_sign * self._plant.angle_rad

    @property
    def velocity_rad_s(self) -> float:
        """True velocity in motor radians per second."""
        return self.parameters.close_sign * self._plant.speed_rad_s

    @property
    def opening_mm(self) -> float:
        """True opening, 0 at the calibrated closed limit."""
        return -self._plant.angle_rad * self.parameters.rad_to_mm

    @property
    def motor_torque_nm(self) -> float:
        """Torque that the motor makes now, before the filter of its report."""
        return self._drive.motor_torque_nm

    @property
    def clamp_nm(self) -> float:
        """What the object between the jaws feels now, as torque at the motor's output."""
        return self._plant.clamp_nm

    @property
    def gripped_object(self) -> GrippedObject | None:
        """What is between the jaws, as it was put there."""
        return self._plant.gripped_object

    @property
    def hand_nm(self) -> float:
        """The torque of the hand that pushes the jaws, positive when it closes them."""
        return self._plant.hand_nm

    @property
    def made_share(self) -> float:
        """The share of the commanded torque that the motor makes."""
        return self._drive.made_share

    @property
    def is_held(self) -> bool:
        """True if something blocks the jaws where they are."""
        return self._plant.is_jammed

    def scene(self) -> Scene:
        """Return where the bodies of MuJoCo's scene are; raises `ValueError` without one."""
        with self._lock:
            return self._plant.scene()

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        """Hand one frame of the bus to the motor at `now_s`; return its immediate answers."""
        with self._lock:
            return self._motor.receive(now_s, frame)

    @property
    def next_unasked_s(self) -> float:
        """When the motor next reports by itself; infinite if it does not."""
        return self._motor.next_unasked_s

    def take_unasked(self, now_s: float) -> list[tuple[float, CanFrame]]:
        """Let time pass until `now_s`; return, once, what the motor reported by itself, and when.

        Raises `ValueError` for a time that is not finite.
        """
        with self._lock:
            return self._motor.take_unasked(now_s)

    def advance(self, now_s: float) -> None:
        """Let time pass until `now_s`. Raises `ValueError` for a time that is not finite."""
        with self._lock:
            self._motor.advance(now_s)

    def put_object(
        self,
        *,
        width_mm: float,
        stiffness_nm_rad: float = 250.0,
        damping_nm_s_rad: float = 0.4,
        friction_nm: float = 0.0,
        yield_mm_s: float = 0.0,
        yield_torque_nm: float = 0.0,
    ) -> None:
        """Put an object between the jaws, in place of any other.

        See `GrippedObject` for the figures. Raises `ValueError` for one that is out of range, and
        when the jaws are narrower than the object.
        """
        item = GrippedObject(
            width_mm=width_mm,
            stiffness_nm_rad=stiffness_nm_rad,
            damping_nm_s_rad=damping_nm_s_rad,
            friction_nm=friction_nm,
            yield_mm_s=yield_mm_s,
            yield_torque_nm=yield_torque_nm,
        )
        with self._lock:
            if width_mm > self.opening_mm:
                raise ValueError(
                    f"an object of {width_mm:g} mm does not fit between the jaws, "
                    f"which are {self.opening_mm:.1f} mm apart; open them first"
                )
            self._plant.put(item)

    def remove_object(self) -> None:
        """Take away what is between the jaws, at once."""
        with self._lock:
            self._plant.put(None)

    def give_way(self, way_mm: float) -> None:
        """Let the object between the jaws give way by so many millimetres, at once.

        Raises `ValueError` for a way that is not finite or not positive, and without an object.
        """
        if not math.isfinite(way_mm) or way_mm <= 0.0:
            raise ValueError(f"way_mm must be finite and more than 0, not {way_mm!r}")
        with self._lock:
            if self._plant.gripped_object is None:
                raise ValueError("there is no object between the jaws; put one there first")
            self._plant.give_way(way_mm)

    def push(self, torque_nm: float, damping_nm_s_rad: float = 0.0) -> None:
        """Push the jaws by hand with this torque (motor's direction) from now on; 0 lets go.

        With damping the hand has a speed of its own, torque by damping, as of one that leads.

        Raises `ValueError` for a torque that is not finite, or a damping that is not, or negative.
        """
        if not math.isfinite(torque_nm):
            raise ValueError(f"torque_nm must be finite, not {torque_nm!r}")
        if not math.isfinite(damping_nm_s_rad) or damping_nm_s_rad < 0.0:
            raise ValueError(
                f"damping_nm_s_rad must be finite and not negative, not {damping_nm_s_rad!r}"
            )
        with self._lock:
            closing_nm = torque_nm * self.parameters.close_sign
            self._plant.push(closing_nm, damping_nm_s_rad)

    def set_comm_loss(self, seconds: float | None) -> None:
        """Let the motor disarm so long after a command; 0 is never, None what TIMEOUT holds.

        Raises `ValueError` for a time that is negative or not finite.
        """
        if seconds is not None and (not math.isfinite(seconds) or seconds < 0):
            raise ValueError(f"the time must be finite and not negative, but is {seconds!r} s")
        with self._lock:
            self._motor.set_comm_loss(seconds)

    def set_idle_loss(self, seconds: float) -> None:
        """Let a disabled motor latch a communication loss so long after a command; 0 is never.

        Raises `ValueError` for a time that is negative or not finite.
        """
        if not math.isfinite(seconds) or seconds < 0:
            raise ValueError(f"the time must be finite and not negative, but is {seconds!r} s")
        with self._lock:
            self._motor.set_idle_loss(seconds)

    def set_unasked(self, rate_hz: float) -> None:
        """Let the motor report so often by itself while it is enabled; 0 is never.

        Raises `ValueError` for a rate outside 0 to 1000 Hz.
        """
        if not 0.0 <= rate_hz <= UNASKED_MAX_HZ:
            raise ValueError(f"the rate must be 0 to {UNASKED_MAX_HZ:g} Hz, not {rate_hz!r}")
        with self._lock:
            self._motor.set_unasked(rate_hz)

    def set_supply(self, volts: float) -> None:
        """Set the voltage of the power stage (24 V is normal, 0 V is unplugged).

        Raises `ValueError` for a voltage that is negative or not finite.
        """
        if not math.isfinite(volts) or volts < 0:
            raise ValueError(f"volts must be finite and not negative, but is {volts!r}")
        with self._lock:
            self._motor.set_supply(volts)

    def power_off(self) -> None:
        """Switch the motor off altogether: it hears and answers nothing, and the jaws are slack."""
        with self._lock:
            self._motor.power_off()

    def power_on(self, *, turns: int = 0) -> None:
        """Switch the motor on; its position comes back off by `turns` turns.

        It is disabled and without a fault, and its registers have their saved values.
        """
        with self._lock:
            self._motor.power_on(turns=turns)

    def power_cycle(self, *, turns: int = 0) -> None:
        """Switch the motor off and on again; its position comes back off by `turns` turns."""
        with self._lock:
            self._motor.power_on(turns=turns)

    def latch_fault(self, status: int) -> None:
        """Latch the fault of a status nibble, 0x8 to 0xE; clearing it ends it.

        Raises `ValueError` for another number, and while the motor is switched off.
        """
        if status not in FAULTS:
            raise ValueError(f"a fault's status must be 0x8 to 0xE, not {status!r}")
        with self._lock:
            if not self._motor.is_powered:
                raise ValueError("the motor is switched off and latches nothing; switch it on")
            self._motor.latch_fault(status)

    def weaken(self, made_share: float) -> None:
        """Let the motor make, and report, this share of the commanded torque; 1 ends it.

        Raises `ValueError` for a share outside 0 to 1.
        """
        if not 0.0 <= made_share <= 1.0:
            raise ValueError(f"made_share must be 0 to 1, not {made_share!r}")
        with self._lock:
            self._drive.made_share = made_share

    def jam(self) -> None:
        """Let the rotor be stuck where it is, whatever pushes it."""
        with self._lock:
            self._plant.jam(jammed=True)

    def free(self) -> None:
        """Let a stuck rotor turn again."""
        with self._lock:
            self._plant.jam(jammed=False)

    def jump(self, angle_rad: float) -> None:
        """Let the reported position jump by this angle, while the jaws stay where they are.

        Raises `ValueError` for an angle that is not finite.
        """
        if not math.isfinite(angle_rad):
            raise ValueError(f"angle_rad must be finite, not {angle_rad!r}")
        with self._lock:
            self._motor.jump(angle_rad)

    def heat_coil(self, coil_c: float) -> None:
        """Let the coil have this temperature now; it then cools as ever.

        Raises `ValueError` for one outside -50 to 300 °C.
        """
        if not -50.0 <= coil_c <= 300.0:
            raise ValueError(f"coil_c must be -50 to 300 °C, not {coil_c!r}")
        with self._lock:
            self._motor.set_coil(coil_c)


@dataclass(frozen=True, slots=True)
class Option:
    """What a user chooses of a simulated gripper; `kind` is the type of its value in TOML."""

    name: str
    kind: type
    meaning: str


OPTIONS = (
    Option(
        "mount", str, '"normal" or "reverse": which way closing runs. Say the same in `[gripper]`.'
    ),
    Option(
        "object_mm", float, "How wide an object between the jaws is, mm. Left out: there is none."
    ),
    Option("object_stiffness_nm_rad", float, "How stiff it is, N·m/rad; only with `object_mm`."),
    Option(
        "seed",
        int,
        "Reports have a noise of at most one code, by this number. Left out: they are exact.",
    ),
    Option(
        "watchdog_s",
        float,
        "After so long without a command the motor disarms, 0.1 s unless given, at most 0.4: a"
        " longer one the daemon sets back to 0.1 when it enables the motor.",
    ),
    Option(
        "comm_loss_s",
        float,
        "After so long it really disarms, whatever its register TIMEOUT says: 0.1, 0.4 and 0.9 were"
        " seen, 0 is never. Left out: as `watchdog_s`.",
    ),
    Option(
        "idle_loss_s",
        float,
        "After so long without a command it latches the same while it is disabled, as motors do"
        " after about 0.9. Left out: never.",
    ),
    Option(
        "unasked_hz",
        float,
        "How often it reports by itself while it is enabled: about 10 was seen. Left out: never.",
    ),
    Option(
        "motor_type",
        str,
        f"The type of its motor, {' or '.join(MOTOR_TYPES)}; {DM4310.name} unless given. Say the"
        " same in `[motor]`.",
    ),
    Option(
        "mechanics",
        str,
        '"mujoco", or "mujoco:" and the absolute path of a scene: MuJoCo moves the jaws'
        " ([mujoco.md](mujoco.md)), and there is no `object_mm`. Left out: the simulator's own.",
    ),
)
"""The only definition of these: the keys of `[bus]` that the daemon checks at its start, their
table in docs/configuration.md, and the arguments of the interface `litegrip_sim` follow from it.
`build_gripper` takes all of them by these names, and says whether a figure can be."""

BITRATE = 1_000_000
"""The motor knows no other."""


def options_of(given: Mapping[str, object], *, from_text: bool = False) -> dict[str, Any]:
    """Return what was given as `build_gripper` takes it; None counts as not given.

    Numbers may be text where `from_text`, as python-can's own files have them. Raises `ValueError`
    for an unknown option and a wrong type.
    """
    kinds = {option.name: option.kind for option in OPTIONS}
    if unknown := sorted(given.keys() - kinds):
        raise ValueError(
            f"unknown option {', '.join(unknown)}; litegrip_sim takes {', '.join(kinds)}"
        )
    options = {
        name: _valued(name, kinds[name], value, from_text)
        for name, value in given.items()
        if value is not None
    }
    if "object_stiffness_nm_rad" in options and "object_mm" not in options:
        raise ValueError("object_stiffness_nm_rad needs object_mm: there is no object")
    return options


def check_bitrate(bitrate: object) -> None:
    """Raise `ValueError` for a bit rate that is not the motor's; None is not given."""
    if bitrate is not None and _valued("bitrate", float, bitrate, True) != BITRATE:
        raise ValueError(f"bitrate must be {BITRATE}, as the motor's is, not {bitrate!r}")


def _valued(name: str, kind: type, value: object, from_text: bool) -> str | float | int:
    if kind is str:
        if isinstance(value, str) and value:
            return value
        raise ValueError(f"{name} must be a string, not {value!r}")
    complaint = f"{name} must be a number, not {value!r}"
    if isinstance(value, bool) or not isinstance(
        value, (int, float, str) if from_text else (int, float)
    ):
        raise ValueError(complaint)
    try:
        number = float(value)
    except (ValueError, OverflowError):
        raise ValueError(complaint) from None
    if kind is not int:
        return number
    if not number.is_integer():
        raise ValueError(f"{name} must be a whole number, not {value!r}")
    return int(number)


def build_gripper(
    *,
    mount: str = "normal",
    seed: int | None = None,
    object_mm: float | None = None,
    object_stiffness_nm_rad: float = 250.0,
    can_id: int = 0x08,
    master_id: int = 0x18,
    watchdog_s: float = 0.1,
    comm_loss_s: float | None = None,
    idle_loss_s: float = 0.0,
    unasked_hz: float = 0.0,
    motor_type: str = DM4310.name,
    mechanics: str | None = None,
) -> SimulatedGripper:
    """Build a gripper of the nominal geometry from the few figures that a user chooses.

    With an object of `object_mm` the jaws start at least 10 mm wider than it, as far as the travel
    allows. `mechanics` names others than the simulator's own, as `named_mechanics` has them; they
    start as their scene does. Raises `ValueError` for a figure that is out of range.
    """
    closed_rad, open_rad = limits_of_mount(mount)
    if motor_type not in MOTOR_TYPES:
        raise ValueError(f"motor_type is {motor_type!r}, {why_not_driven(motor_type)}")
    nominal = SimulatorParameters(closed_rad=closed_rad, open_rad=open_rad)
    opening_mm = nominal.initial_opening_mm
    if object_mm is not None:
        travel_mm = abs(closed_rad - open_rad) * nominal.rad_to_mm
        if not 0 <= object_mm < travel_mm:
            raise ValueError(
                f"object_mm must be 0 to less than {travel_mm:.0f} mm wide, not {object_mm:g}"
            )
        if not 0 < object_stiffness_nm_rad <= STIFFEST_NM_RAD:
            raise ValueError(
                f"object_stiffness_nm_rad must be more than 0 and at most {STIFFEST_NM_RAD:g}, not"
                f" {object_stiffness_nm_rad:g}"
            )
        opening_mm = min(max(opening_mm, object_mm + 10.0), travel_mm)
    parameters = replace(
        nominal.of_motor(MOTOR_TYPES[motor_type]),
        can_id=can_id,
        master_id=master_id,
        initial_opening_mm=opening_mm,
        watchdog_s=watchdog_s,
        comm_loss_s=comm_loss_s,
        idle_loss_s=idle_loss_s,
        unasked_hz=unasked_hz,
    )
    plant = None if mechanics is None else named_mechanics(mechanics, parameters)
    gripper = SimulatedGripper(parameters, seed=seed, mechanics=plant)
    if object_mm is not None:
        gripper.put_object(width_mm=object_mm, stiffness_nm_rad=object_stiffness_nm_rad)
    return gripper


def named_mechanics(name: str, parameters: SimulatorParameters) -> Mechanics:
    """Return MuJoCo's mechanics: "mujoco", or "mujoco:SCENE.xml" for a scene of one's own.

    Raises `ValueError` for another name, for a scene that cannot be used, and where the package is
    missing.
    """
    kind, separator, scene = name.partition(":")
    if kind != MUJOCO or (separator and not scene):
        raise ValueError(f"mechanics must be {MUJOCO} or {MUJOCO}:SCENE.xml, not {name!r}")
    try:
        from litegripd.sim.mujoco_plant import SCENE, MujocoPlant  # noqa: PLC0415 - takes time
    except ImportError as error:
        raise ValueError(
            f"MuJoCo's mechanics need its package ({error}): install litegripd with its extra"
            f" mujoco, or: {sys.executable} -m pip install mujoco"
        ) from error
    return MujocoPlant(parameters, Path(scene) if scene else SCENE)
