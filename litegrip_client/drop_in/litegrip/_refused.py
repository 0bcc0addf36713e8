"""What needs the bus in the program's own process: the names exist, using them raises."""

from __future__ import annotations

from collections.abc import Mapping
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, ClassVar, NoReturn

from .exceptions import CommandError


def refuse(name: str, instead: str) -> NoReturn:
    """Raise `CommandError`: the bus is the daemon's."""
    raise CommandError(
        f"{name} cannot be used: the bus is the daemon's, so that many programs can use one"
        f" gripper; instead: {instead}"
    )


class Refused:
    """A class whose objects can be made, and whose members raise `CommandError`.

    `_INSTEAD` has the members, and what to use instead of each.
    """

    _INSTEAD: ClassVar[Mapping[str, str]] = MappingProxyType({})

    if TYPE_CHECKING:

        def __getattr__(self, name: str) -> Any: ...

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        for name, instead in cls._INSTEAD.items():
            setattr(cls, name, _member(f"{cls.__name__}.{name}", instead))


def _member(name: str, instead: str) -> Any:
    def refused(*_arguments: Any, **_keywords: Any) -> NoReturn:
        refuse(name, instead)

    refused.__name__ = name.rpartition(".")[2]
    refused.__qualname__ = name
    refused.__doc__ = f"Raise `CommandError`; instead: {instead}."
    return refused
