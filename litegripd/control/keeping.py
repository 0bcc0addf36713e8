"""Who keeps the motor enabled, and what becomes of the jaws when that client is lost.

Knows no motion: the engine tells when one runs, and carries out what is returned.
"""

from dataclasses import dataclass

from litegripd.model.jobs import OnLost


@dataclass(slots=True)
class Keeping:
    """The client that enabled the motor, and what it wants to happen when it is lost."""

    client: int | None = None
    on_lost: OnLost = "hold"
    is_owed: bool = False
    """The keeper was lost while a motion ran that outlives it: its wish waits for the end."""
    _proposed: tuple[int, OnLost] | None = None
    _proposer_is_lost: bool = False

    def propose(self, client: int, on_lost: OnLost) -> None:
        """Let a client be the keeper, in place of any other, once its enabling has succeeded."""
        self._proposed, self._proposer_is_lost = (client, on_lost), False

    def decide(self, succeeded: bool) -> None:
        """Take note how the enabling ended; a keeper that is lost by now is owed its wish."""
        proposed, self._proposed = self._proposed, None
        if proposed is None or not succeeded:
            return
        self.client, self.on_lost = proposed
        self.is_owed = self._proposer_is_lost
        if self._proposer_is_lost:
            self.client = None

    def end(self) -> None:
        """Let nobody be the keeper: the motor is being disabled."""
        self.client, self.is_owed, self._proposed = None, False, None

    def change(self, client: int, on_lost: OnLost) -> bool:
        """Let the keeper change its mind; tell whether `client` is the keeper."""
        if self.client != client:
            return False
        self.on_lost = on_lost
        return True

    def lose(self, client: int, *, outlived: bool) -> OnLost | None:
        """Forget a client that is lost; return what it wanted, None if it was not the keeper.

        `outlived` tells that a motion goes on all the same; then the wish is owed at its end.
        """
        if self._proposed is not None and self._proposed[0] == client:
            self._proposer_is_lost = True
        if self.client != client:
            return None
        self.client, self.is_owed = None, outlived
        return self.on_lost

    def take_owed(self) -> OnLost | None:
        """Return, once, what is owed at the end of a motion."""
        owed, self.is_owed = self.is_owed, False
        return self.on_lost if owed else None
