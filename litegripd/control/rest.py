"""What the jaws do while no action runs: held, or slack. Always something, in every period."""

from dataclasses import dataclass, replace
from typing import TypeAlias

from litegripd.control.gains import Gains
from litegripd.control.grip import Grip
from litegripd.model.geometry import Geometry
from litegripd.model.motor import Feedback, MitCommand


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold a position."""

    position_rad: float
    gains: Gains

    def command(self, _now_s: float, _feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return self.gains.at(self.position_rad)

    def eased(self, position_rad: float, geometry: Geometry) -> "Hold":
        """Return the hold for jaws that are at `position_rad` now.

        One that a hand has pressed beyond a calibrated stop comes back as far as the stop springs
        back: the motor must not press on for ever with what the hand has done. It never leads.
        """
        low_rad, high_rad = sorted((geometry.closed_rad, geometry.open_rad))
        low_rad, high_rad = min(low_rad, position_rad), max(high_rad, position_rad)
        if low_rad <= self.position_rad <= high_rad:
            return self
        return replace(self, position_rad=min(max(self.position_rad, low_rad), high_rad))


@dataclass(frozen=True, slots=True)
class Relax:
    """Let the jaws be moved by hand: no stiffness, no damping, no torque."""

    def command(self, _now_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return MitCommand(feedback.position_rad, 0.0, 0.0, 0.0, 0.0)


Rest: TypeAlias = Hold | Relax | Grip
