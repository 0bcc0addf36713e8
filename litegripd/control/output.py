"""The way of every command to the motor: through the last word, with an eye on the coil's heat."""

from litegripd.control.filter import Bounds, LastWord, torque_bound_nm
from litegripd.control.heat import HeatChange, HeatGuard
from litegripd.model.motor import Feedback, MitCommand, Ranges


class Output:
    """Keeps what was wanted and what is sent in its place, and why they differ."""

    def __init__(self) -> None:
        self.requested: MitCommand | None = None
        self.command: MitCommand | None = None
        self.limited: tuple[str, ...] = ()
        self.heat = HeatGuard()
        self._last_word = LastWord()

    def send(
        self, now_s: float, command: MitCommand, feedback: Feedback, bounds: Bounds, ranges: Ranges
    ) -> HeatChange | None:
        """Make `command` what may be sent; tell of a change in what the heat allows."""
        self.requested = command
        self.command, self.limited = self._last_word.apply(
            now_s, command, feedback, bounds, ranges, allowance_nm=self.heat.allowance_nm
        )
        return self.heat.update(now_s, feedback, torque_bound_nm(self.command, feedback))

    def unpowered(self, now_s: float, feedback: Feedback | None) -> HeatChange | None:
        """Take note that the motor is told nothing from now on."""
        self.requested, self.command, self.limited = None, None, ()
        self._last_word.unpowered(now_s)
        return None if feedback is None else self.heat.update(now_s, feedback, 0.0)
