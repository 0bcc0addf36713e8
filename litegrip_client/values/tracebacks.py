"""Tracebacks of errors that leave the API, and of Ctrl-C in it: the user's lines and one of ours.

What lies below a method is the same for each of its errors, and tells a user nothing. Lines of the
user's below it, of a callback, stay. A call with arguments that a method does not have is the
user's line alone; one that was to stop the gripper stops it first. With `python -X dev` tracebacks
are whole.
"""

from __future__ import annotations

import functools
import os
import sys
from types import FunctionType

from litegrip_client.values.errors import LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from collections.abc import Callable, Sequence
    from typing import Any, TypeVar

    _Kind = TypeVar("_Kind", bound=type)

_STANDARD = os.__file__.rpartition("/")[0]
HIDDEN = (
    __file__.rsplit("/", 2)[0] + "/",  # the package: this room is a folder of it
    f"{_STANDARD}/asyncio/",
    f"{_STANDARD}/concurrent/",
    f"{_STANDARD}/contextlib.py",
)
_SPECIAL = ("__init__", "__enter__", "__exit__", "__next__", "__aenter__", "__aexit__", "__anext__")
_STOP = "software_stop"
STOPPED_ALL_THE_SAME = "the gripper was told to stop all the same, until clear_stop()"
_IS_COROUTINE = 128
"""`inspect.CO_COROUTINE`."""


def shortened(kind: _Kind) -> _Kind:
    """Shorten the tracebacks of what the public members of a class raise; for a decorator."""
    return shortened_of(kind, (LiteGripError,), HIDDEN)


def shortened_of(
    kind: _Kind, raised: tuple[type[Exception], ...], hidden: tuple[str, ...]
) -> _Kind:
    """Do so for a class of a package that raises errors of its own, and lies in `hidden`, too."""
    errors = (*raised, KeyboardInterrupt)
    if sys.flags.dev_mode:
        return kind
    members = {name: one for base in reversed(kind.__mro__) for name, one in vars(base).items()}
    for name, member in members.items():
        if name.startswith("_") and name not in _SPECIAL:
            continue
        if isinstance(member, property) and member.fget is not None:
            setattr(kind, name, member.getter(_shortened(member.fget, errors, hidden)))
        elif isinstance(member, FunctionType) and not hasattr(member, "__wrapped__"):
            setattr(kind, name, _shortened(member, errors, hidden))
    return kind


def _shortened(
    method: Callable[..., Any], errors: tuple[type[BaseException], ...], hidden: tuple[str, ...]
) -> Callable[..., Any]:
    def call(*arguments: Any, **named: Any) -> Any:
        try:
            return method(*arguments, **named)
        except errors as error:
            _shorten(error, hidden)
            raise
        except Exception as error:
            if _leave_out(error, method, arguments, named) and method.__name__ == _STOP:
                method(arguments[0], *_level(arguments, named))
                error.args = (f"{error}; {STOPPED_ALL_THE_SAME}",)
            raise

    async def call_and_wait(*arguments: Any, **named: Any) -> Any:
        try:
            return await method(*arguments, **named)
        except errors as error:
            _shorten(error, hidden)
            raise
        except Exception as error:
            if _leave_out(error, method, arguments, named) and method.__name__ == _STOP:
                await method(arguments[0], *_level(arguments, named))
                error.args = (f"{error}; {STOPPED_ALL_THE_SAME}",)
            raise

    is_coroutine = method.__code__.co_flags & _IS_COROUTINE
    return functools.update_wrapper(call_and_wait if is_coroutine else call, method)


def _leave_out(
    error: Exception, method: Callable[..., Any], arguments: Sequence[Any], named: dict[str, Any]
) -> bool:
    """Leave out the entry of the function that calls this, of any other error.

    Where nothing lies below, the call itself has failed: then say what arguments the method has,
    and return True.
    """
    below = None if error.__traceback__ is None else error.__traceback__.tb_next
    is_misuse = below is None and isinstance(error, TypeError)
    if is_misuse:
        from litegrip_client.values.voices import misuse  # noqa: PLC0415 - an error

        error.args = (misuse(method, arguments, named) or str(error),)
    error.__traceback__ = below
    return is_misuse


def _level(arguments: Sequence[Any], named: dict[str, Any]) -> Sequence[Any]:
    """Return the level that a wrong call of a stop gives, as its arguments; empty if it has none.

    The stop itself knows what to do with one that is none.
    """
    return arguments[1:2] or [named[name] for name in ("level",) if name in named]


def _shorten(error: BaseException, hidden: tuple[str, ...]) -> None:
    """Leave out the entry of the function that calls this, and what the method's own leads to.

    Python 3.10 keeps the former: its `raise` does not look at the error again.
    """
    trace = error.__traceback__
    called = None if trace is None else trace.tb_next
    if called is not None:
        below = called.tb_next
        while below is not None and below.tb_frame.f_code.co_filename.startswith(hidden):
            below = below.tb_next
        called.tb_next = below
        error.__traceback__ = called
