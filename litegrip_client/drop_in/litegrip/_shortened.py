"""Tracebacks of this package as those of the client: the user's lines and one of ours."""

from __future__ import annotations

import os
from typing import TypeVar

from litegrip_client.values.tracebacks import HIDDEN, shortened_of

from .exceptions import LiteGripError

_Kind = TypeVar("_Kind", bound=type)
_FOLDER = os.path.dirname(__file__) + os.sep
_RAISED = (LiteGripError, ValueError, RuntimeError)
"""The SDK raises the latter two, too."""


def shortened(kind: _Kind) -> _Kind:
    """Shorten the tracebacks of what the public members of a class raise; for a decorator."""
    return shortened_of(kind, _RAISED, (*HIDDEN, _FOLDER))
