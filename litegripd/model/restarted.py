"""What came of a restart of the daemon that held on."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Restarted:
    """The successor that has taken over, and the time between the commands of the two."""

    pid: int
    gap_s: float
