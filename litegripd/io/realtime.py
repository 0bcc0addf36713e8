"""Asks the kernel for real-time rights and reports which were granted; none is ever required."""

import ctypes
import gc
import os
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass

_MCL_CURRENT = 1
_MCL_FUTURE = 2
_MCL_ONFAULT = 4  # Linux 4.4: lock what is touched, so that unused mappings cost no memory


@dataclass(frozen=True, slots=True)
class RealtimeRights:
    """What the kernel granted; a text gives the reason if it did not."""

    fifo_priority: int
    memory_locked: bool
    cpus: tuple[int, ...]
    refused: tuple[str, ...]


def acquire(priority: int, cpus: Sequence[int]) -> RealtimeRights:
    """Ask for SCHED_FIFO at `priority` (0: stay ordinary), locked memory and the CPUs `cpus`.

    Children return to the ordinary policy (`SCHED_RESET_ON_FORK`): the priority is for the control
    thread alone. Raises nothing: a refusal is part of the result.
    """
    refused: list[str] = []

    def attempt(what: str, action: Callable[[], object]) -> bool:
        try:
            action()
        except (
            OSError,
            OverflowError,
            ValueError,
        ) as error:  # the last two: no such CPU or priority
            refused.append(f"{what}: {getattr(error, 'strerror', None) or error}")
            return False
        return True

    granted = 0
    if priority > 0 and attempt(
        f"SCHED_FIFO {priority}",
        lambda: os.sched_setscheduler(
            0, os.SCHED_FIFO | os.SCHED_RESET_ON_FORK, os.sched_param(priority)
        ),
    ):
        granted = priority
    locked = attempt("locked memory", _lock_memory)
    if cpus:
        attempt(f"CPUs {list(cpus)}", lambda: os.sched_setaffinity(0, cpus))
    return RealtimeRights(granted, locked, tuple(sorted(os.sched_getaffinity(0))), tuple(refused))


def give_up_priority() -> None:
    """Return to ordinary scheduling: the remaining work must not keep others waiting.

    `SCHED_RESET_ON_FORK` stays: nobody may clear it without privileges.
    """
    os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def _lock_memory() -> None:
    libc = ctypes.CDLL(None, use_errno=True)
    if libc.mlockall(_MCL_CURRENT | _MCL_FUTURE | _MCL_ONFAULT) != 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))


class GarbageCollector:
    """Keeps Python's collector out of the ticks: frozen after start, run only in slack.

    Reference counting frees nearly everything. Only cycles are left, and the daemon makes few.
    `collect` is called when a period has nothing else to do.
    """

    _YOUNG_EVERY_S = 1.0
    _FULL_EVERY_S = 60.0

    def __init__(self) -> None:
        self.longest_s = 0.0
        self._next_young_s = 0.0
        self._next_full_s = 0.0

    def freeze(self) -> None:
        """Collect once, exempt all living objects, and switch the automatic runs off."""
        gc.collect()
        gc.freeze()
        gc.disable()
        now_s = time.monotonic()
        self._next_young_s = now_s + self._YOUNG_EVERY_S
        self._next_full_s = now_s + self._FULL_EVERY_S

    def thaw(self) -> None:
        """Return the collector to the interpreter."""
        gc.unfreeze()
        gc.enable()

    def collect(self, now_s: float) -> None:
        """Run the collection that is due, or none."""
        if now_s < self._next_young_s:
            return
        full = now_s >= self._next_full_s
        gc.collect(2 if full else 1)
        ended_s = time.monotonic()
        self.longest_s = max(self.longest_s, ended_s - now_s)
        self._next_young_s = ended_s + self._YOUNG_EVERY_S
        if full:
            self._next_full_s = ended_s + self._FULL_EVERY_S
