"""A periodic timer as a file descriptor; `os.timerfd_create` exists only from Python 3.13 on.

`epoll.poll(timeout)` rounds its timeout up to whole milliseconds and more; a timerfd does not.
"""

import ctypes
import os
import time

_CLOCK_MONOTONIC = 1
_TFD_TIMER_ABSTIME = 1
_TFD_CLOEXEC = os.O_CLOEXEC
_NS_PER_S = 1_000_000_000


class _Timespec(ctypes.Structure):
    _fields_ = (("tv_sec", ctypes.c_long), ("tv_nsec", ctypes.c_long))


class _Itimerspec(ctypes.Structure):
    _fields_ = (("it_interval", _Timespec), ("it_value", _Timespec))


_libc = ctypes.CDLL(None, use_errno=True)


def _timespec(nanoseconds: int) -> _Timespec:
    return _Timespec(nanoseconds // _NS_PER_S, nanoseconds % _NS_PER_S)


def _check(result: int) -> int:
    if result < 0:
        number = ctypes.get_errno()
        raise OSError(number, os.strerror(number))
    return result


class PeriodicTimer:
    """Fires at `first_s + n * period_s` of CLOCK_MONOTONIC, however late it is read.

    By default it first fires one period from now.
    `wait()` blocks until the next firing and returns how many have passed since the last call;
    the descriptor may also be polled. Raises `OSError` where the kernel refuses.
    """

    def __init__(self, period_s: float, first_s: float | None = None) -> None:
        period_ns = round(period_s * _NS_PER_S)
        given_ns = None if first_s is None else round(first_s * _NS_PER_S)
        first_ns = given_ns or time.monotonic_ns() + period_ns
        self.period_s = period_ns / _NS_PER_S
        self._first_ns = first_ns
        self._period_ns = period_ns
        self._fired = 0
        self._at_once = 0
        self._fd = _check(_libc.timerfd_create(_CLOCK_MONOTONIC, _TFD_CLOEXEC))
        spec = _Itimerspec(_timespec(period_ns), _timespec(first_ns))
        _check(_libc.timerfd_settime(self._fd, _TFD_TIMER_ABSTIME, ctypes.byref(spec), None))

    def fileno(self) -> int:
        """Return the descriptor, readable when a firing is due."""
        return self._fd

    def wait(self) -> int:
        """Block until a firing is due; return the number of firings since the last call."""
        count = int.from_bytes(os.read(self._fd, 8), "little")
        self._fired += count
        self._at_once = count
        return count

    @property
    def first_due_s(self) -> float:
        """When the first of the firings that the last `wait` has returned was due."""
        return (self._first_ns + (self._fired - self._at_once) * self._period_ns) / _NS_PER_S

    @property
    def last_due_s(self) -> float:
        """When the latest firing that `wait` has returned was due."""
        return (self._first_ns + (self._fired - 1) * self._period_ns) / _NS_PER_S

    @property
    def next_due_s(self) -> float:
        """When the next firing is due."""
        return (self._first_ns + self._fired * self._period_ns) / _NS_PER_S

    def close(self) -> None:
        """Give the descriptor back."""
        os.close(self._fd)
