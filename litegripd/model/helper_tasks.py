"""Slow work that the pure rooms want done: somebody with a disk does it and tells the result."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class TaskResult:
    """What became of a task: `value` where it worked, else `error`, a sentence.

    `reason` is that of the error table, where it is not for the one who asked to find it.
    """

    value: object = None
    error: str | None = None
    reason: str | None = None


@dataclass(frozen=True, slots=True)
class HelperTask:
    """One operation of the helper process; `on_result` is called once, between two ticks.

    `uid` is the user whose request it is alone; None for the daemon's own, and for what a motion
    needs, which never wait behind requests.
    """

    operation: str
    parameters: Mapping[str, object]
    on_result: Callable[[TaskResult], None]
    uid: int | None = None
