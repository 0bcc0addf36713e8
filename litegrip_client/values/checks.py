"""Checks of values before they are sent, and of what the daemon has sent.

The daemon checks ranges. These checks reject only what no range can hold, and, where a call only
prepares requests, what is outside of the daemon's range for every gripper.
"""

from __future__ import annotations

import math
import operator
import os
from collections.abc import Mapping

from litegrip_client.values.errors import CommandError, ParameterError, ProtocolError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


RANGES = {
    "speed_mm_s": (0.1, 150.0, "mm/s"),
    "grasp_speed_mm_s": (0.1, 150.0, "mm/s"),
    "force_n": (0.5, 40.0, "N"),
    "torque_nm": (0.1, 3.0, "N·m"),
    "valid_s": (0.02, 2.0, "s"),
}
"""What the daemon allows at most, whichever the gripper: least, most and the unit."""


def range_of(name: str) -> str:
    """Return the range of a value as it is told, without the unit."""
    least, most, _unit = RANGES[name]
    return f"{least:g} to {most:g}"


class UnsetFloat(float):
    """A default that nobody set: a number like any other, but not one to be sent."""

    __slots__ = ()


def number(name: str, value: Any) -> float:
    """Return `value` as a float; raises `CommandError` for what is no finite number."""
    try:
        if isinstance(value, bool | str | bytes):
            raise TypeError
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        item = "; pass its element, x.item()" if _is_array_of_one(value) else ""
        raise wrong(name, f"is {value!r:.60}, it must be a number{item}") from None
    if not math.isfinite(result):
        raise wrong(name, f"is {result}, it must be a finite number")
    return result


def _is_array_of_one(value: Any) -> bool:
    """Return True for an array of one element, as numpy's, which newer ones make no float of."""
    return getattr(value, "size", None) == 1 and callable(getattr(value, "item", None))


def time_limit(name: str, value: Any) -> float:
    """Return how long to wait, in s; raises `CommandError` for what is no number, or below 0."""
    result = number(name, value)
    if result < 0.0:
        raise wrong(name, f"is {result:g}, it must be 0 or more")
    return result


def integer(name: str, value: Any) -> int:
    """Return `value` as an int; raises `CommandError` for what is no whole number."""
    try:
        if isinstance(value, bool):
            raise TypeError
        return operator.index(value)
    except TypeError:
        raise wrong(name, f"is {value!r:.60}, it must be a whole number") from None


def flag(name: str, value: Any) -> bool:
    """Return `value` as a bool; raises `CommandError` for what is neither: "no" would be true."""
    if value not in (False, True):
        raise wrong(name, f"is {value!r:.60}, it must be True or False")
    return bool(value)


def path(name: str, value: Any) -> str:
    """Return a path as text; raises `CommandError` for what is none."""
    try:
        result = os.fspath(value)
    except TypeError:
        result = None
    if not isinstance(result, str):
        raise wrong(name, f"is {value!r:.60}, it must be a path")
    return result


def check_callback(name: str, value: Any, arguments: int, what: str) -> None:
    """Raise `CommandError` for what cannot be called with so many arguments, or is async.

    `what` names the arguments. What Python does not know the parameters of is not refused.
    """
    import inspect  # noqa: PLC0415 - callbacks are seldom given

    if not callable(value):
        raise wrong(name, f"is {value!r:.60}, it must be a function of {what}")
    if any(map(inspect.iscoroutinefunction, (value, type(value).__call__))):
        problem = f"is an async function, it must be a plain one of {what}"
        raise wrong(name, f"{problem}: it is called, and not awaited")
    try:
        signature = inspect.signature(value)
    except (AttributeError, NameError, TypeError, ValueError):
        return  # of a function in C, or with annotations that are only for a type checker
    try:
        signature.bind(*[None] * arguments)
    except TypeError as error:
        raise wrong(name, f"must be a function of {what}: {error}") from None


def in_range(name: str, value: Any, least: float, most: float, unit: str) -> float:
    """Return `value` as a float; raises `CommandError` for what is outside of the range."""
    result = number(name, value)
    if not least <= result <= most:
        error = wrong(name, f"is {result:g}, it must be {least:g} to {most:g} {unit}")
        error.data["limit"] = [least, most]
        raise error
    return result


def given_numbers(**values: Any) -> dict[str, Any]:
    """Return those of the arguments that are not None, as floats; raises `CommandError`."""
    return {name: number(name, value) for name, value in values.items() if value is not None}


def pick(data: Mapping[str, Any], names: tuple[str, ...], what: str) -> dict[str, Any]:
    """Return these members of what the daemon sent; raises `ProtocolError` if one is missing."""
    try:
        return {name: data[name] for name in names}
    except KeyError as error:
        raise ProtocolError(f"the daemon's {what} lacks {error}", reason="missing_field") from None
    except TypeError:
        raise ProtocolError(f"the daemon's {what} is no object: {data!r:.80}") from None


def wrong(name: str, problem: str) -> CommandError:
    """Return the error for an argument that cannot be."""
    return ParameterError(f"{name} {problem}", reason="invalid_params", data={"parameter": name})
