"""Slow work that the pure rooms want done: somebody with a disk does it and tells the result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class ErrandResult:
    """What became of an errand: `value` where it worked, else `error`, a sentence."""

    value: object = None
    error: str | None = None


@dataclass(frozen=True, slots=True)
class Errand:
    """One operation of the helper process; `on_result` is called once, between two ticks."""

    operation: str
    parameters: Mapping[str, object]
    on_result: Callable[[ErrandResult], None]
