"""What the jaws do while no action runs: held, or slack. Always something, in every period."""

from dataclasses import dataclass, replace
from typing import TypeAlias

from litegripd.control.gains import Gains
from litegripd.control.grip import Grip
from litegripd.model.geometry import Geometry
from litegripd.model.motor import Feedback, MitCommand

STANDING_RAD_S = 0.05
"""Jaws that press on something are slower than this, 4 mm/s."""
PRESSING_SHARE = 0.5
FAINT_NM = 0.1
"""What friction leaves of the way to a target does not count."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Hold a position."""

    position_rad: float
    gains: Gains

    def command(self, _now_s: float, _feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return self.gains.at(self.position_rad)

    def presses(self, feedback: Feedback) -> bool:
        """Whether jaws that stand are where this hold leaves them, for its torque is there already.

        A command that leads jaws which it has not reached yet would move them further.
        """
        asked_nm = self.gains.kp_nm_rad * (self.position_rad - feedback.position_rad)
        sign = 1.0 if asked_nm > 0.0 else -1.0
        stands = abs(feedback.velocity_rad_s) <= STANDING_RAD_S
        return stands and sign * feedback.torque_nm >= PRESSING_SHARE * abs(asked_nm) - FAINT_NM

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
