"""Numbered items over a network that loses, repeats and reorders: each arrives once, in order."""

from collections import deque
from typing import Generic, TypeVar

_Item = TypeVar("_Item")


class Outbox(Generic[_Item]):
    """What was sent and is not known to have arrived, the oldest first.

    `last` is the number of the newest item, 0 before the first; `size_bytes` what is kept.
    """

    def __init__(self) -> None:
        self.last = 0
        self.size_bytes = 0
        self._items: deque[tuple[int, _Item, int]] = deque()

    def add(self, item: _Item, size_bytes: int) -> int:
        """Keep an item until it is confirmed; return its number."""
        self.last += 1
        self.size_bytes += size_bytes
        self._items.append((self.last, item, size_bytes))
        return self.last

    def confirm(self, number: int) -> None:
        """Forget all items up to this number: they have arrived."""
        while self._items and self._items[0][0] <= number:
            self.size_bytes -= self._items.popleft()[2]

    def unconfirmed(self) -> list[tuple[int, _Item]]:
        """Return the numbers and items that may have to be sent again."""
        return [(number, item) for number, item, _size in self._items]


class Inbox:
    """What has arrived; `taken` is the number of the last item that did in order."""

    def __init__(self) -> None:
        self.taken = 0

    def take(self, number: int) -> bool:
        """Return True if the item of this number is the next one, which is hereby taken."""
        if number != self.taken + 1:
            return False
        self.taken = number
        return True
