"""What every action is: one method `step`, called once per tick, until it has an outcome."""

from dataclasses import dataclass
from typing import Protocol

from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.motor import DisableMotor, EnableMotor, MitCommand, MotorView
from litegripd.model.results import Progress, Result


@dataclass(frozen=True, slots=True)
class Step:
    """What an action wants in this tick, and its outcome in its last one."""

    command: MitCommand | None = None
    request: EnableMotor | DisableMotor | None = None
    outcome: Result | Refusal | None = None


@dataclass(frozen=True, slots=True)
class Gains:
    """Stiffness and damping of position commands."""

    kp_nm_rad: float
    kd_nm_s_rad: float

    def at(self, position_rad: float, velocity_rad_s: float = 0.0) -> MitCommand:
        """Return the command that goes to a position, without torque of its own."""
        return MitCommand(position_rad, velocity_rad_s, self.kp_nm_rad, self.kd_nm_s_rad, 0.0)


DEFAULT_GAINS = Gains(kp_nm_rad=100.0, kd_nm_s_rad=2.0)


def gains_of(calibration: Calibration) -> Gains:
    """Return a calibration's gains; the default stands for one that it does not give."""
    kp, kd = calibration.kp_nm_rad, calibration.kd_nm_s_rad
    return Gains(
        DEFAULT_GAINS.kp_nm_rad if kp is None else kp,
        DEFAULT_GAINS.kd_nm_s_rad if kd is None else kd,
    )


class Action(Protocol):
    """A motion, or a change of the motor's power."""

    needs_power: bool
    """Whether it runs only while the motor is enabled; then losing power ends it."""

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Advance to `now_s`. A position on a ramp follows from the time, not from the calls."""

    def progress(self) -> Progress | None:
        """Tell where it is, None for an action that has nothing to tell."""
