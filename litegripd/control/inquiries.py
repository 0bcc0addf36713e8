"""Registers that clients want to read: asked for one after the other, beside the motion."""

from collections import deque
from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.motor import RegisterReply, RegisterRequest

MOST_WAITING = 16

OnReply: TypeAlias = Callable[[RegisterReply], None]


@dataclass(frozen=True, slots=True)
class _Inquiry:
    request: RegisterRequest
    on_reply: OnReply


class Inquiries:
    """The row of registers to be read."""

    def __init__(self) -> None:
        self._row: deque[_Inquiry] = deque()
        self._last = 0

    def add(self, number: int, on_reply: OnReply) -> Refusal | None:
        """Put a register at the end of the row; `on_reply` is called once, in a tick."""
        if len(self._row) >= MOST_WAITING:
            text = f"{MOST_WAITING} registers are waiting to be read already: try again"
            return Refusal("too_many_requests", text, {"limit": MOST_WAITING})
        self._last += 1
        self._row.append(_Inquiry(RegisterRequest(self._last, number), on_reply))
        return None

    def step(self, reply: RegisterReply | None) -> RegisterRequest | None:
        """Hand over the motor's latest reply; return what is to be asked for now."""
        row = self._row
        if row and reply is not None and reply.identity == row[0].request.identity:
            row.popleft().on_reply(reply)
        return row[0].request if row else None
