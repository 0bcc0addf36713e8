"""Tracebacks of errors that leave the API, and of Ctrl-C in it: the user's lines and one of ours.

What lies below a method is the same for each of its errors, and tells a user nothing. Lines of the
user's below it, of a callback, stay. Other errors are defects of ours, and shown whole. A call with
arguments that a method does not have is the user's line alone; one that was to stop the gripper
stops it first. With `python -X dev` tracebacks are whole.

Pytest shows the whole source of each function in a traceback. It leaves out what lies in a module
with `__tracebackhide__`: there the user's line is the last one.

Here an error gets its gripper, too: all pass, also those that no daemon has sent.
"""

from __future__ import annotations

import functools
import os
import sys
from types import CodeType, FunctionType, TracebackType

from litegrip_client.values.errors import LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from collections.abc import Callable, Sequence
    from typing import Any, TypeVar

    from litegrip_client.values.errors import Origin

    _Kind = TypeVar("_Kind", bound=type)

_STANDARD = os.__file__.rpartition("/")[0] + "/"
_PACKAGE = __name__.partition(".")[0] + "."
HIDDEN = (
    __file__.rsplit("/", 2)[0] + "/",  # the package: this room is a folder of it
    f"{_STANDARD}asyncio/",
    f"{_STANDARD}concurrent/",
    f"{_STANDARD}contextlib.py",
)
_SPECIAL = (
    *("__init__", "__enter__", "__exit__", "__iter__", "__next__", "__setattr__", "__delattr__"),
    *("__aenter__", "__aexit__", "__aiter__", "__anext__"),
)
_KNOWING = ("_session", "_connection", "_source", "_exchange")
"""The attributes of our objects that know their gripper."""
_STOP = "software_stop"
STOPPED_ALL_THE_SAME = "the gripper was told to stop all the same, until clear_stop()"
_IS_COROUTINE = 128
"""`inspect.CO_COROUTINE`."""


def _is_hidden_by_pytest(raised: Any) -> bool:
    """Return True for pytest's record of an error that a member has been asked to raise."""
    errors = (LiteGripError, KeyboardInterrupt)
    return isinstance(getattr(raised, "value", None), errors) and not sys.flags.dev_mode


__tracebackhide__ = _is_hidden_by_pytest


def shortened(kind: _Kind) -> _Kind:
    """Shorten the tracebacks of what the public members of a class raise; for a decorator."""
    return shortened_of(kind, (LiteGripError,), HIDDEN)


def shortened_of(
    kind: _Kind, raised: tuple[type[Exception], ...], hidden: tuple[str, ...]
) -> _Kind:
    """Do so for a class of a package that raises errors of its own, and lies in `hidden`, too."""
    rules = _Rules(kind, (*raised, KeyboardInterrupt), hidden)
    members = {name: one for base in reversed(kind.__mro__) for name, one in vars(base).items()}
    for name, member in members.items():
        if name.startswith("_") and name not in _SPECIAL:
            continue
        if isinstance(member, property) and member.fget is not None:
            made = member.getter(_shortened(member.fget, rules))
            if member.fset is not None:
                made = made.setter(_shortened(member.fset, rules))
            setattr(kind, name, made)
        elif isinstance(member, classmethod):
            of_class = _Rules(None, rules.errors, hidden)
            setattr(kind, name, classmethod(_shortened(member.__func__, of_class)))
        elif isinstance(member, FunctionType) and _is_plain(member):
            setattr(kind, name, _shortened(member, rules))
    return kind


class _Rules:
    """For the methods of one class, None for those that are called on the class itself."""

    __slots__ = ("errors", "hidden", "kind")

    def __init__(
        self,
        kind: type | None,
        errors: tuple[type[BaseException], ...],
        hidden: tuple[str, ...],
    ) -> None:
        self.kind, self.errors, self.hidden = kind, errors, hidden


def _is_own(function: Any) -> bool:
    return bool(function.__code__.co_filename == __file__)


def _is_plain(function: Any) -> bool:
    """Return True if nothing but this module stands before a function."""
    return _is_own(function) or not hasattr(function, "__wrapped__")


def is_of_handler(error: BaseException) -> bool:
    """Return True if a signal handler of this program has raised it.

    That runs in the middle of anything, and may raise what a socket or a decoder would.
    """
    import signal  # noqa: PLC0415 - an error

    handlers = [signal.getsignal(number) for number in signal.valid_signals()]
    codes = {_code_of(one) for one in handlers if callable(one)} - {None}
    at = error.__traceback__
    while at is not None and at.tb_frame.f_code not in codes:
        at = at.tb_next
    return at is not None


def _code_of(function: Any) -> CodeType | None:
    function = getattr(function, "func", function)  # of a `functools.partial`
    code = getattr(function, "__code__", None) or getattr(type(function).__call__, "__code__", None)
    return code if isinstance(code, CodeType) else None


def _shortened(method: Any, rules: _Rules) -> Callable[..., Any]:
    """Return a method that does so; of an inherited one that does, one for this class."""
    if _is_own(method):
        method = method.__wrapped__
    method.__globals__.setdefault("__tracebackhide__", _is_hidden_by_pytest)

    def call(*arguments: Any, **named: Any) -> Any:
        try:
            return method(*arguments, **named)
        except BaseException as error:
            if _is_of_the_class(rules, arguments):
                raise _no_object(rules) from None
            if _mended(error, method, rules, arguments, named):
                method(arguments[0], *_level(arguments, named))
                error.args = (f"{error}; {STOPPED_ALL_THE_SAME}",)
            raise

    async def call_and_wait(*arguments: Any, **named: Any) -> Any:
        try:
            return await method(*arguments, **named)
        except BaseException as error:
            if _is_of_the_class(rules, arguments):
                raise _no_object(rules) from None
            if _mended(error, method, rules, arguments, named):
                await method(arguments[0], *_level(arguments, named))
                error.args = (f"{error}; {STOPPED_ALL_THE_SAME}",)
            raise

    is_coroutine = method.__code__.co_flags & _IS_COROUTINE
    return functools.update_wrapper(call_and_wait if is_coroutine else call, method)


def _is_of_the_class(rules: _Rules, arguments: Sequence[Any]) -> bool:
    """Return True if a method was called without its object."""
    if rules.kind is None or sys.flags.dev_mode:
        return False
    return not (arguments and isinstance(arguments[0], rules.kind))


def _no_object(rules: _Rules) -> TypeError:
    name = "" if rules.kind is None else rules.kind.__name__
    how = ", as `gripper = LiteGrip('can0')`" if name == "LiteGrip" else ""
    return TypeError(f"{name} is the class: make an object first{how}")


def _mended(
    error: BaseException,
    method: Callable[..., Any],
    rules: _Rules,
    arguments: Sequence[Any],
    named: dict[str, Any],
) -> bool:
    """Name an error's gripper, and shorten its traceback.

    Return True if it means a stop that did not stop.
    """
    if isinstance(error, LiteGripError) and error.origin is None and arguments:
        error.origin = _origin_of(arguments[0])
    if sys.flags.dev_mode:
        return False
    cancelled = getattr(sys.modules.get("asyncio"), "CancelledError", LiteGripError)
    if isinstance(error, (*rules.errors, cancelled)):
        _shorten(error, rules.hidden)
    elif isinstance(error, Exception):
        if _is_of_a_callback(error, rules.hidden):
            _shorten(error, rules.hidden)
        else:
            return _leave_out(error, method, arguments, named) and method.__name__ == _STOP
    return False


def _origin_of(one: object) -> Origin | None:
    """Return the gripper of an object: its session knows it, or the connection that it reads."""
    held = getattr(one, "__dict__", {})
    origins = (getattr(held.get(name), "origin", None) for name in _KNOWING)
    return next((origin for origin in origins if origin is not None), None)


def _leave_out(
    error: Exception, method: Callable[..., Any], arguments: Sequence[Any], named: dict[str, Any]
) -> bool:
    """Leave out the entry of the function that calls this, of any other error.

    Where nothing lies below, the call itself has failed: then say what arguments the method has,
    and return True.
    """
    below = _called(error)
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


def _called(error: BaseException) -> TracebackType | None:
    """Return the entry of the method itself."""
    return None if error.__traceback__ is None else error.__traceback__.tb_next


def _below(trace: TracebackType, hidden: tuple[str, ...]) -> TracebackType | None:
    """Return the first entry below one that is not hidden, None if there is none."""
    below = trace.tb_next
    while below is not None and _is_hidden(below, hidden):
        below = below.tb_next
    return below


def _is_hidden(trace: TracebackType, hidden: tuple[str, ...]) -> bool:
    """Return True for an entry of ours; what `dataclass` has made is in no file."""
    frame = trace.tb_frame
    return frame.f_code.co_filename.startswith(hidden) or (
        str(frame.f_globals.get("__name__")).startswith(_PACKAGE)
    )


def _is_of_a_callback(error: BaseException, hidden: tuple[str, ...]) -> bool:
    """Return True if what a method has called in the user's program has raised an error.

    All other errors that are not raised on purpose are of ours: they are shown whole.
    """
    called = _called(error)
    below = None if called is None else _below(called, hidden)
    if below is None:
        return False
    file = below.tb_frame.f_code.co_filename
    return "-packages/" in file or not file.startswith((_STANDARD, "<frozen "))


def _shorten(error: BaseException, hidden: tuple[str, ...]) -> None:
    """Leave out the entry of the function that calls this, and what the method's own leads to.

    Python 3.10 keeps the former: its `raise` does not look at the error again.
    """
    called = _called(error)
    if called is not None:
        called.tb_next = _below(called, hidden)
        error.__traceback__ = called
