"""What the daemon tells about itself; made by the room that knows all the others."""

from typing import Protocol


class Facts(Protocol):
    """Dictionaries that JSON can hold."""

    def hello(self) -> dict[str, object]:
        """Describe the daemon, the motor and the limits."""

    def health(self, now_s: float) -> dict[str, object]:
        """Tell the verdict and the figures."""

    def info(self) -> dict[str, object]:
        """Tell what does not change."""
