"""What the values on the command line may look like.

Only their form is checked here; which ranges are allowed is the daemon's to say.
"""

from __future__ import annotations

import math
import re
from argparse import ArgumentTypeError

_UNITS = {"mm": "opening_mm", "rad": "position_rad", "%": "openness"}
_NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_TARGET = re.compile(rf"({_NUMBER}) ?(mm|rad|%)")
_INTERFACE = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_.-]{0,14}")  # IFNAMSIZ less the final zero
_SETTING = re.compile(rf"([a-z][a-z0-9_]*)=({_NUMBER}(?:e[+-]?[0-9]+)?)", re.IGNORECASE)


def protect_target(argument: str) -> str:
    """Mark a target below zero, which looks like an option, as something else."""
    return f" {argument}" if argument.startswith("-") and _TARGET.fullmatch(argument) else argument


def target(text: str) -> tuple[str, float]:
    """Read a target with its unit; gives the parameter of motion.move, and its value."""
    found = _TARGET.fullmatch(text.strip())
    if found is None:
        raise ArgumentTypeError(
            f"{text.strip()!r} is no target: say 45mm (opening), -0.3rad (position of the motor) "
            "or 50% (of the travel, 0% is closed)"
        )
    value = float(found[1])
    return _UNITS[found[2]], value / 100.0 if found[2] == "%" else value


def setting(text: str) -> tuple[str, float]:
    """Read FIELD=NUMBER."""
    found = _SETTING.fullmatch(text)
    if found is None:
        raise ArgumentTypeError(f"{text!r} is no setting: say FIELD=NUMBER, force_n=15 for one")
    # Some fields are whole numbers, and the daemon takes a whole number for the others, too.
    return found[1], int(found[2]) if re.fullmatch(r"[+-]?[0-9]+", found[2]) else float(found[2])


def positive(text: str) -> float:
    """Read a number above 0."""
    value = _number(text)
    if not value > 0.0:
        raise ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def not_negative(text: str) -> float:
    """Read a number of 0 or more."""
    value = _number(text)
    if not value >= 0.0:
        raise ArgumentTypeError(f"{text!r} is not a number of 0 or more")
    return value


def _number(text: str) -> float:
    """Return the number, NaN for what is none or not finite."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def count(text: str) -> int:
    """Read a whole number of 1 or more."""
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)


def interface(text: str) -> str:
    """Read the name of a network interface."""
    if not _INTERFACE.fullmatch(text):
        raise ArgumentTypeError(f"{text!r} is no name of a CAN interface, such as can0")
    return text
