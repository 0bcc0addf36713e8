"""What LeRobot's plug-in uses of draccus, for `make check`, where LeRobot is not installed."""

from collections.abc import Callable, Mapping
from typing import Any, ClassVar, TypeVar

_Class = TypeVar("_Class", bound=type)


class ChoiceRegistry:
    """Classes that a configuration chooses among, by name."""

    choices: ClassVar[dict[str, type]]

    @classmethod
    def register_subclass(cls, name: str) -> Callable[[_Class], _Class]:
        """Register a class under a name."""

        def register(chosen: _Class) -> _Class:
            cls.choices[name] = chosen
            return chosen

        return register


def decode(cls: type[ChoiceRegistry], raw: Mapping[str, Any]) -> Any:
    """Make the configuration whose `type` is in a dictionary, of the rest of it."""
    settings = dict(raw)
    return cls.choices[settings.pop("type")](**settings)
