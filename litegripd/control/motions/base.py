"""What every action is: one method `step`, called once per tick, until it has an outcome."""

from dataclasses import dataclass
from typing import Protocol

from litegripd.control.holds import Idle
from litegripd.control.limiter import Bounds
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.jobs import HelperTask
from litegripd.model.motor import Feedback, MitCommand, MotorRequest, MotorView
from litegripd.model.results import Progress, Result


@dataclass(frozen=True, slots=True)
class Adopted:
    """A calibration that is in use from now on, and the file that has it, if any."""

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
    """A motion, or a change of the motor's power."""

    needs_power: bool
    """True if it runs only while the motor is enabled; then losing power ends it."""

    bounds: Bounds | None
    """Where its commands may lie; None: in the calibrated travel."""

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Advance to `now_s`. A position on a ramp follows from the time, not from the calls."""

    def idle_after(self) -> Idle | None:
        """Tell what the jaws do if it ends now; None: hold where they are."""

    def progress(self) -> Progress | None:
        """Return where it is, None for an action that has nothing to tell."""

    def close(self) -> None:
        """Give back what it has, other than the jaws; called once, when it has ended."""


def progress_of(
    phase: str, step: int, total_steps: int, command_rad: float, feedback: Feedback
) -> Progress:
    """Return where a motion is, with what was measured."""
    return Progress(
        phase, step, total_steps, command_rad, feedback.position_rad, feedback.torque_nm
    )


class PlainAction:
    """What most actions have in common: no bounds of their own, a hold afterwards, no progress."""

    needs_power = True
    bounds: Bounds | None = None

    def idle_after(self) -> Idle | None:
        """Let the jaws hold where they are."""
        return None

    def progress(self) -> Progress | None:
        """There is nothing to tell."""
        return None

    def close(self) -> None:
        """There is nothing to give back."""
