"""The motor of a channel, without jaws."""

from .can_bus import LiteGripCAN

__all__ = ["LiteGripCAN"]
