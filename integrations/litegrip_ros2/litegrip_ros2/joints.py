"""The joints that ROS sees, and the gripper's opening: positions, speeds and forces of both.

A joint's position is in m, its velocity in m/s, its effort in N: the force that squeezes, positive
in both layouts. The gripper's opening is in mm, 0 at the closed stop.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

CLOSED_M = 0.042726
"""Where each of the two joints of the vendor's URDF is when the jaws touch; 0 is open."""
EDGE_MM = 2.0
"""So far beyond the travel a target means its end: a URDF and a calibration differ by that."""
APART_M = 0.001
"""Two joints that are sent to places further apart than this contradict each other."""


class UnusableError(ValueError):
    """A message that says nothing which this gripper could do."""


class Layout(Enum):
    """Which joints there are."""

    OPENING = "opening"
    """One, whose position is the opening: 0 is closed."""
    SLIDES = "slides"
    """The two of the vendor's URDF, one for each jaw: 0 is open, `closed_m` closed."""


DEFAULT_NAMES = {
    Layout.OPENING: ("gripper_opening_joint",),
    Layout.SLIDES: ("gripper_slide_joint_right", "gripper_slide_joint_left"),
}


@dataclass(frozen=True)
class Target:
    """Where jaws are sent: the opening in mm, their speed in mm/s and the force in N, if given."""

    opening_mm: float
    speed_mm_s: float | None = None
    force_n: float | None = None


@dataclass(frozen=True)
class Joints:
    """The joints of one gripper. `closed_m` counts for slides alone."""

    layout: Layout
    names: tuple[str, ...]
    closed_m: float = CLOSED_M

    def __post_init__(self) -> None:
        """Raise `ValueError` for what cannot be the joints of a gripper."""
        needed = len(DEFAULT_NAMES[self.layout])
        if len(self.names) != needed or len(set(self.names)) != needed or not all(self.names):
            raise ValueError(
                f"joint_names is {list(self.names)}, layout {self.layout.value!r} needs"
                f" {needed} different name{'s' if needed > 1 else ''}"
            )
        if not 0.0 < self.closed_m < 1.0:
            raise ValueError(f"closed_m is {self.closed_m:g}, it must be above 0 and below 1 m")

    def position_m(self, opening_mm: float) -> float:
        """Return where each joint is at an opening."""
        if self.layout is Layout.OPENING:
            return opening_mm / 1000.0
        return self.closed_m - opening_mm / 2000.0

    def opening_mm(self, position_m: float) -> float:
        """Return the opening for a position of a joint."""
        if self.layout is Layout.OPENING:
            return position_m * 1000.0
        return (self.closed_m - position_m) * 2000.0

    def velocity_m_s(self, opening_mm_s: float) -> float:
        """Return how fast each joint moves when the opening changes so fast."""
        return opening_mm_s / (1000.0 if self.layout is Layout.OPENING else -2000.0)

    def speed_mm_s(self, velocity_m_s: float) -> float:
        """Return the speed of the opening, never negative, for a velocity of a joint."""
        return abs(velocity_m_s) * (1000.0 if self.layout is Layout.OPENING else 2000.0)

    def target(
        self,
        names: Sequence[str],
        positions: Sequence[float],
        velocities: Sequence[float],
        efforts: Sequence[float],
    ) -> Target:
        """Read a `JointState` as a command; other joints in it are not this gripper's.

        Without names the values are those of the joints, in their order. A velocity or effort that
        is missing, not finite or 0 was not given. Raises `UnusableError`.
        """
        if not names:
            names = self.names[: len(positions)]
        if len(set(names)) != len(names):
            raise UnusableError(f"a joint is named twice: {', '.join(names)}")
        if len(positions) != len(names):
            raise UnusableError(f"{len(positions)} positions for {len(names)} joints")
        own = [index for index, name in enumerate(names) if name in self.names]
        if not own:
            raise UnusableError(
                f"no joint of this gripper in {', '.join(names) or 'it'}:"
                f" it has {', '.join(self.names)}"
            )
        asked = [positions[index] for index in own]
        if not all(map(math.isfinite, asked)):
            raise UnusableError("a position is not finite")
        if max(asked) - min(asked) > APART_M:
            raise UnusableError(
                f"the jaws are coupled, {' and '.join(f'{value:g}' for value in asked)} m"
                " cannot be both"
            )
        velocity = _largest("velocity", velocities, names, own)
        return Target(
            self.opening_mm(sum(asked) / len(asked)),
            None if velocity is None else self.speed_mm_s(velocity),
            _largest("effort", efforts, names, own),
        )


def _largest(
    what: str, values: Sequence[float], names: Sequence[str], own: Sequence[int]
) -> float | None:
    """Return the largest magnitude that was given for the own joints, None without any."""
    if not values:
        return None
    if len(values) != len(names):
        raise UnusableError(f"{len(values)} values of {what} for {len(names)} joints")
    given = [abs(values[index]) for index in own if math.isfinite(values[index])]
    return max(given, default=0.0) or None


def within_travel(opening_mm: float, travel_mm: float) -> float:
    """Return the target, or the end of the travel if it is at most `EDGE_MM` beyond that.

    A target further out is returned as it is: the daemon refuses it, and says the travel.
    """
    nearest = min(max(opening_mm, 0.0), travel_mm)
    return nearest if abs(nearest - opening_mm) <= EDGE_MM else opening_mm


@dataclass(frozen=True)
class Scale:
    """What turns the motor's figures into those of the jaws, as the calibration in use has it."""

    travel_mm: float
    mm_per_rad: float
    """By how much the jaws open for a radian; negative where they open by falling radians."""
    nm_per_n: float

    @classmethod
    def from_info(cls, info: Mapping[str, object]) -> Scale | None:
        """Read the answer of the client's `info()`; None while the gripper is not calibrated."""
        gripper = info.get("gripper")
        if not isinstance(gripper, Mapping) or not gripper.get("calibrated"):
            return None
        opens = gripper["open_rad"] - gripper["closed_rad"]
        return cls(
            float(gripper["travel_mm"]),
            math.copysign(gripper["rad_to_mm"], opens),
            1.0 / float(gripper["nm_to_n"]),
        )

    def opening_mm_s(self, velocity_rad_s: float) -> float:
        """Return how fast the opening changes."""
        return velocity_rad_s * self.mm_per_rad

    def torque_nm(self, force_n: float) -> float:
        """Return the motor's torque for a force of the jaws."""
        return force_n * self.nm_per_n
