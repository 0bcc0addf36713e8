"""What true looks at the jaws say: whether something was dropped, and whether anything shook."""

from collections.abc import Sequence
from itertools import pairwise

from tests.plants.world import LOOK_S, Look

SHAKE_MM_S = 5.0
SHAKE_HALF_WAVES = 6
SHAKE_LASTS_S = 0.3

CLAMP_SHARE = 0.2
ADRIFT_S = 0.1
RETURNING_MM_S = 2.0


def is_shaking(looks: Sequence[Look]) -> bool:
    """Tell whether the rotor swings to and fro.

    Each time it turns round ends a half-wave; one whose fastest speed is at least `SHAKE_MM_S`
    counts. Six of them, from the first to the last at least 0.3 s, are no settling any more.
    """
    peaks: list[tuple[float, float]] = []  # of the half-waves so far: when and how fast
    for look in looks:
        speed = look.rotor_mm_s
        if abs(speed) < SHAKE_MM_S:
            continue
        if not peaks or peaks[-1][1] * speed < 0.0:
            peaks.append((look.at_s, speed))
    turns = [later for earlier, later in pairwise(peaks) if earlier[1] * later[1] < 0.0]
    return len(turns) >= SHAKE_HALF_WAVES and turns[-1][0] - turns[0][0] >= SHAKE_LASTS_S


def adrift_s(looks: Sequence[Look], asked_n: float) -> float:
    """Return how long the object felt next to nothing while the jaws were not on their way back."""
    return LOOK_S * sum(
        look.clamp_n < CLAMP_SHARE * asked_n and look.jaw_mm_s < RETURNING_MM_S for look in looks
    )


def slack_s(looks: Sequence[Look], asked_n: float) -> float:
    """Return for how much of that the motor did not even try: it made less than half the torque."""
    return adrift_s([look for look in looks if look.torque_nm < 0.05 * asked_n], asked_n)


def is_dropped(looks: Sequence[Look], asked_n: float, *, can_follow: bool) -> bool:
    """Tell whether the daemon let go of an object that was there all the time.

    Jaws that squeeze on but cannot follow it, as their friction is larger, have dropped nothing.
    """
    lost_s = adrift_s(looks, asked_n) if can_follow else slack_s(looks, asked_n)
    return lost_s > ADRIFT_S
