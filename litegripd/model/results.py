"""What a motion ended with, and what it reports on its way; names as in the vendor's SDK."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

MoveOutcome: TypeAlias = Literal["pressed_home", "blocked", "no_stop", "timed_out"]
"""`pressed_home`: stalled on the mechanical stop. `blocked`: stalled short of it. `no_stop`: the
jaws passed the calibrated stop and met none. `timed_out`: neither stalled nor arrived."""


@dataclass(frozen=True, slots=True)
class MoveResult:
    """How `open` or `close` ended.

    A success is `ok`, `stalled` and not `reached`: the target lies past the stop on purpose.
    """

    ok: bool
    outcome: MoveOutcome
    reached: bool
    stalled: bool
    target_rad: float
    limit_rad: float
    final_command_rad: float
    steps: int


@dataclass(frozen=True, slots=True)
class EnableResult:
    """Whether the motor confirmed that it is enabled, after how many attempts, and if not, why."""

    ok: bool
    tries: int
    message: str | None = None


@dataclass(frozen=True, slots=True)
class DisableResult:
    """Whether the motor confirmed that it is disabled."""

    ok: bool


@dataclass(frozen=True, slots=True)
class HoldResult:
    """Where the jaws are held from now on."""

    position_rad: float


Result: TypeAlias = MoveResult | EnableResult | DisableResult | HoldResult


@dataclass(frozen=True, slots=True)
class Progress:
    """Where a motion is: its phase, its step of the total, command and feedback."""

    phase: str
    step: int
    total_steps: int
    command_rad: float
    position_rad: float
    torque_nm: float
