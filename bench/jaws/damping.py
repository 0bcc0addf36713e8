"""How much damping a motor bears that filters its speed, and whether a hold shakes on it.

A gain is commanded straight to the simulated motor, whose free jaws are kicked; the daemon's hold
is disturbed while it holds something.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from bench.jaws.held import LOOK_S, HeldRig, Setting
from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame, MitCommand
from litegripd.motor import codec
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters

PERIOD_S = 0.005
KICK_NM, KICK_S = 6.0, 0.02
SETTLE_S = 0.5
LOOKED_S = 0.3
HOLD_FORCE_N = 40.0


@dataclass(frozen=True, slots=True)
class Motor:
    """What differs between motors: the filter of their speed, and the inertia they move."""

    filter_s: float
    inertia_share: float

    @property
    def name(self) -> str:
        """The motor in words."""
        return f"{self.filter_s * 1e3:.0f} ms, {'half' if self.inertia_share < 1.0 else 'whole'}"

    @property
    def parameters(self) -> SimulatorParameters:
        """The simulator's figures of this motor."""
        usual = SimulatorParameters()
        rotor = self.inertia_share * usual.inertia_kg_m2 - usual.finger_inertia_kg_m2
        corner_hz = 1.0 / (math.tau * self.filter_s) if self.filter_s else 0.0
        return replace(usual, rotor_inertia_kg_m2=rotor, speed_filter_hz=corner_hz)

    def most_damping(self) -> float:
        """Return the largest stable damping (N·m·s/rad) of free jaws, without friction."""
        if self.filter_s == 0.0:
            return math.inf
        parameters = self.parameters
        lags = 1.0 / self.filter_s + 1.0 / parameters.current_lag_s
        return parameters.inertia_kg_m2 * lags


MOTORS = tuple(Motor(filter_s, share) for share in (1.0, 0.5) for filter_s in (0.0, 0.001, 0.002))


def swing_of_gain(motor: Motor, kd_nm_s_rad: float) -> float:
    """Return the torque (N·m) of free jaws that are damped, half a second after a kick."""
    gripper = SimulatedGripper(motor.parameters)
    can_id, sign = gripper.parameters.can_id, gripper.parameters.close_sign
    gripper.receive(0.0, CanFrame(can_id, codec.ENABLE))
    command = MitCommand(0.0, 0.0, 0.0, kd_nm_s_rad, 0.0)
    frame = CanFrame(can_id, codec.encode_command(command, DM4310.ranges))
    looks, swing_nm = round(PERIOD_S / LOOK_S), 0.0
    for tick in range(round((KICK_S + SETTLE_S + LOOKED_S) / PERIOD_S)):
        now_s = tick * PERIOD_S
        gripper.receive(now_s, frame)
        gripper.push(sign * KICK_NM if now_s < KICK_S else 0.0)
        for look in range(1, looks + 1):
            gripper.advance(now_s + look * LOOK_S)
            if now_s >= KICK_S + SETTLE_S:
                swing_nm = max(swing_nm, abs(gripper.motor_torque_nm))
    return swing_nm


def swing_of_hold(motor: Motor, happen: Callable[[HeldRig], None]) -> float:
    """Return by how much (N·m) the torque of a hold swings, half a second after a disturbance."""
    rig = HeldRig(Setting("normal", 200), HOLD_FORCE_N, parameters=motor.parameters)
    happen(rig)
    rig.run(SETTLE_S)
    seen_nm: list[float] = []
    for _ in range(round(LOOKED_S / rig.period_s)):
        seen_nm += rig.torques_of_tick()
    return (max(seen_nm) - min(seen_nm)) / 2.0
