"""What true looks at the jaws say: whether something was dropped, and whether anything shook."""

from collections.abc import Sequence

from tests.plants.world import LOOK_S, Look

SHAKE_MM_S = 20.0
"""The rotor's speed; below it trembles a rotor in its backlash that echoes its own speed noise."""
SHAKE_HALF_WAVES = 6
SHAKE_LASTS_S = 0.3

CLAMP_SHARE = 0.2
ADRIFT_S = 0.1
RETURNING_MM_S = 2.0


def is_shaking(looks: Sequence[Look], least_mm_s: float = SHAKE_MM_S) -> bool:
    """Tell whether the rotor swings to and fro.

    Each time it turns round ends a half-wave; one that is faster than `least_mm_s` at its begin
    counts. Six of them, from the first to the last at least 0.3 s, are no settling any more.
    """
    peaks: list[tuple[float, float]] = []
    for look in looks:
        speed = look.rotor_mm_s
        if abs(speed) >= least_mm_s and (not peaks or peaks[-1][1] * speed < 0.0):
            peaks.append((look.at_s, speed))
    turns = peaks[1:]
    return len(turns) >= SHAKE_HALF_WAVES and turns[-1][0] - turns[0][0] >= SHAKE_LASTS_S


def adrift_s(looks: Sequence[Look], asked_n: float) -> float:
    """Return how long the object felt next to nothing while the jaws were not on their way back."""
    return LOOK_S * sum(_is_adrift(look, asked_n) for look in looks)


def _is_adrift(look: Look, asked_n: float) -> bool:
    return look.clamp_n < CLAMP_SHARE * asked_n and look.jaw_mm_s < RETURNING_MM_S


def is_slack(looks: Sequence[Look], asked_n: float) -> bool:
    """Tell whether the motor did not even try meanwhile: it made less than half the torque."""
    torques_nm = [look.torque_nm for look in looks if _is_adrift(look, asked_n)]
    return sum(torques_nm) < 0.05 * asked_n * len(torques_nm)


def is_dropped(looks: Sequence[Look], asked_n: float, *, can_follow: bool) -> bool:
    """Tell whether the daemon let go of an object that was there all the time.

    Jaws that squeeze on but cannot follow it, as their friction is larger, have dropped nothing.
    """
    if adrift_s(looks, asked_n) <= ADRIFT_S:
        return False
    return can_follow or is_slack(looks, asked_n)
