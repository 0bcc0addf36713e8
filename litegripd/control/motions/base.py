"""What every action has: one method `step`, called once per tick, until there is an outcome."""

from dataclasses import dataclass
from typing import Protocol

from litegripd.control.holds import Idle
from litegripd.control.limiter import Bounds
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.motor import Feedback, MitCommand, MotorRequest, MotorView
from litegripd.model.results import Progress, Result
from litegripd.model.state import HelperTask


@dataclass(frozen=True, slots=True)
class Adopted:
    """A calibration that is in use from now on, and its file, if any."""

    calibration: Calibration
    file: str | None


@dataclass(frozen=True, slots=True)
class Step:
    """What an action wants in this tick, and its outcome in its last one."""

    command: MitCommand | None = None
    request: MotorRequest | None = None
    outcome: Result | Refusal | None = None
    task: HelperTask | None = None
    adopted: Adopted | None = None


class Action(Protocol):
    """A motion, or a change of the motor itself."""

    needs_power: bool
    """True if it runs only while the motor is enabled; losing power ends it."""

    bounds: Bounds | None
    """The bounds of its commands; None for those of the calibrated travel."""

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Advance to `now_s`. A position on a ramp follows from the time, not from the calls."""

    def idle_after(self) -> Idle | None:
        """Return what the jaws do if it ends now; None to hold where they are."""

    def progress(self) -> Progress | None:
        """Return how far it is; None if the action reports no progress."""

    def close(self) -> None:
        """Release what it has, other than the jaws; called once, when it has ended."""


def progress_of(
    phase: str, step: int, total_steps: int, command_rad: float, feedback: Feedback
) -> Progress:
    """Return the progress of a motion, with what was measured."""
    return Progress(
        phase,
        step,
        total_steps,
        command_rad,
        feedback.position_rad,
        feedback.torque_nm,
        feedback.coil_temperature_c,
    )


class PlainAction:
    """What most actions have in common: no own bounds, a hold at the end, no progress."""

    needs_power = True
    bounds: Bounds | None = None

    def idle_after(self) -> Idle | None:
        """Return None: the jaws hold where they are."""
        return None

    def progress(self) -> Progress | None:
        """Return None: there is no progress to report."""
        return None

    def close(self) -> None:
        """Release nothing."""
