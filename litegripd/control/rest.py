"""What the jaws do while no action runs: held, or slack. Always something, in every period."""

from dataclasses import dataclass
from typing import TypeAlias

from litegripd.control.gains import Gains
from litegripd.control.grip import Grip
from litegripd.model.motor import Feedback, MitCommand


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold a position."""

    position_rad: float
    gains: Gains

    def command(self, _now_s: float, _feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return self.gains.at(self.position_rad)


@dataclass(frozen=True, slots=True)
class Relax:
    """Let the jaws be moved by hand: no stiffness, no damping, no torque."""

    def command(self, _now_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return MitCommand(feedback.position_rad, 0.0, 0.0, 0.0, 0.0)


Rest: TypeAlias = Hold | Relax | Grip
