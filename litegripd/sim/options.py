"""What a user chooses of a simulated gripper: `OPTIONS` is the only definition.

The keys of `[bus]` that the daemon checks at its start, their table in docs/configuration.md, and
the arguments of the interface `litegrip_sim` follow from it. `build_gripper` takes all of them by
these names, and says whether a figure can be.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from litegripd.model.gripper import DM4310, MOTOR_TYPES


@dataclass(frozen=True, slots=True)
class Option:
    """One of them; `kind` is the type of its value in TOML."""

    name: str
    kind: type
    meaning: str


OPTIONS = (
    Option(
        "mount", str, '"normal" or "reverse": which way closing runs. Say the same in `[gripper]`.'
    ),
    Option(
        "object_mm", float, "How wide an object between the jaws is, mm. Left out: there is none."
    ),
    Option("object_stiffness_nm_rad", float, "How stiff it is, N·m/rad; only with `object_mm`."),
    Option(
        "seed",
        int,
        "Reports have a noise of at most one code, by this number. Left out: they are exact.",
    ),
    Option(
        "watchdog_s",
        float,
        "After so long without a command the motor disarms, 0.1 s unless given, at most 0.4: a"
        " longer one the daemon sets back to 0.1 when it enables the motor.",
    ),
    Option(
        "comm_loss_s",
        float,
        "After so long it really disarms, whatever its register TIMEOUT says: 0.1, 0.4 and 0.9 were"
        " seen, 0 is never. Left out: as `watchdog_s`.",
    ),
    Option(
        "idle_loss_s",
        float,
        "After so long without a command it latches the same while it is disabled, as motors do"
        " after about 0.9. Left out: never.",
    ),
    Option(
        "unasked_hz",
        float,
        "How often it reports by itself while it is enabled: about 10 was seen. Left out: never.",
    ),
    Option(
        "motor_type",
        str,
        f"The type of its motor, {' or '.join(MOTOR_TYPES)}; {DM4310.name} unless given. Say the"
        " same in `[motor]`.",
    ),
    Option(
        "mechanics",
        str,
        '"mujoco", or "mujoco:" and the absolute path of a scene: MuJoCo moves the jaws'
        " ([mujoco.md](mujoco.md)), and there is no `object_mm`. Left out: the simulator's own.",
    ),
)

BITRATE = 1_000_000
"""The motor knows no other."""


def options_of(given: Mapping[str, object], *, from_text: bool = False) -> dict[str, Any]:
    """Return what was given as `build_gripper` takes it; None counts as not given.

    Numbers may be text where `from_text`, as python-can's own files have them. Raises `ValueError`
    for an unknown option and a wrong type.
    """
    kinds = {option.name: option.kind for option in OPTIONS}
    if unknown := sorted(given.keys() - kinds):
        raise ValueError(
            f"unknown option {', '.join(unknown)}; litegrip_sim takes {', '.join(kinds)}"
        )
    options = {
        name: _valued(name, kinds[name], value, from_text)
        for name, value in given.items()
        if value is not None
    }
    if "object_stiffness_nm_rad" in options and "object_mm" not in options:
        raise ValueError("object_stiffness_nm_rad needs object_mm: there is no object")
    return options


def check_bitrate(bitrate: object) -> None:
    """Raise `ValueError` for a bit rate that is not the motor's; None is not given."""
    if bitrate is not None and _valued("bitrate", float, bitrate, True) != BITRATE:
        raise ValueError(f"bitrate must be {BITRATE}, as the motor's is, not {bitrate!r}")


def _valued(name: str, kind: type, value: object, from_text: bool) -> str | float | int:
    if kind is str:
        if isinstance(value, str) and value:
            return value
        raise ValueError(f"{name} must be a string, not {value!r}")
    complaint = f"{name} must be a number, not {value!r}"
    if isinstance(value, bool) or not isinstance(
        value, (int, float, str) if from_text else (int, float)
    ):
        raise ValueError(complaint)
    try:
        number = float(value)
    except (ValueError, OverflowError):
        raise ValueError(complaint) from None
    if kind is not int:
        return number
    if not number.is_integer():
        raise ValueError(f"{name} must be a whole number, not {value!r}")
    return int(number)
