"""What the cases of all checks are made of."""

import re
from typing import NamedTuple, TypeAlias

from litegrip_client.ctl.doctor.facts import Facts


class Found(NamedTuple):
    """What a check finds; `advice` is None where there must be none."""

    level: str
    text: str
    command: str | None
    advice: str | None


class Case(NamedTuple):
    """Facts, and what a check finds in them: `LEVEL text $ command # advice`, or nothing.

    Level and command stand there whole, text and advice in part.
    """

    facts: Facts
    finds: str | None = None

    def found(self) -> Found | None:
        """Return the parts of what is found."""
        if self.finds is None:
            return None
        parts = re.fullmatch(r"([A-Z]+) ?(.*?)(?: \$ (.*?))?(?: # (.*))?", self.finds)
        assert parts is not None, self.finds
        level, text, command, advice = parts.groups()
        return Found(level.lower(), text, command, advice)


Cases: TypeAlias = dict[str, list[Case]]
"""By check."""
