"""Reading one register on demand, beside whatever else is said to the motor.

An answer counts only for the register that is being asked for: one that nobody awaits is neither
a value nor feedback. It sends nothing but read requests.
"""

import math

from litegripd.model.bus import CanFrame
from litegripd.model.errors import Refusal
from litegripd.model.motor import RegisterReply, RegisterRequest
from litegripd.motor.faults import SILENT
from litegripd.motor.identity import ANSWER_WITHIN_S
from litegripd.motor.phases import Phase
from litegripd.motor.registers import REGISTERS, Answer, Register, read_request

READABLE = frozenset({Phase.DISABLED, Phase.ENABLED, Phase.FAULT})
"""Elsewhere the motor does not answer, or its answers are awaited for another purpose."""

READ_TRIES = 5
READ_WITHIN_S = 1.0
"""How long a request waits in all, also for the end of an enabling or of a look at the motor."""


class RegisterReader:
    """Reads the register that is asked for; a request that is given again begins anew."""

    def __init__(self, can_id: int) -> None:
        self.reply: RegisterReply | None = None
        self._can_id = can_id
        self._request: RegisterRequest | None = None
        self._register: Register | None = None
        """What is being read; None once the request has its reply."""
        self._began_s = 0.0
        self._asked_s = float("-inf")
        self._tries = 0

    def step(self, now_s: float, request: RegisterRequest | None, phase: Phase) -> list[CanFrame]:
        """Pursue `request` and return the frame that is due, if any.

        In a phase that is not `READABLE` it waits. None withdraws the one that is pending.
        """
        if request != self._request:
            self._begin(now_s, request)
        register = self._register
        if register is None:
            return []
        may_ask_again = phase in READABLE and now_s - self._asked_s >= ANSWER_WITHIN_S
        is_over = may_ask_again and self._tries >= READ_TRIES
        if is_over or now_s - self._began_s >= READ_WITHIN_S:
            self._answer(None, SILENT)
            return []
        if not may_ask_again:
            return []
        self._tries += 1
        self._asked_s = now_s
        return [read_request(self._can_id, register)]

    def take(self, answer: Answer) -> bool:
        """Take an answer of the motor; tell whether it was the awaited one."""
        register = self._register
        is_awaited = register is not None and self._tries > 0 and answer.number == register.number
        if register is None or not is_awaited or answer.is_write:
            return False
        value = register.decode(answer.raw)
        if math.isfinite(value):
            self._answer(value, None)
        else:
            self._answer(None, _no_number(register, value))
        return True

    def _begin(self, now_s: float, request: RegisterRequest | None) -> None:
        self._request = request
        self._register = None if request is None else REGISTERS.get(request.number)
        self._began_s = now_s
        self._asked_s = float("-inf")
        self._tries = 0
        if request is not None and self._register is None:
            self._answer(None, _unknown(request.number))

    def _answer(self, value: float | None, failure: Refusal | None) -> None:
        self._register = None
        if self._request is not None:
            self.reply = RegisterReply(self._request.identity, value, failure)


def _unknown(number: int) -> Refusal:
    known = ", ".join(f"{register.number} {register.name}" for register in REGISTERS.values())
    return Refusal(
        "invalid_params",
        f"there is no register {number}; these can be read: {known}",
        {"requested": number, "limit": list(REGISTERS)},
    )


def _no_number(register: Register, value: float) -> Refusal:
    return Refusal(
        "motor_unsuitable",
        f"the motor's register {register.name} holds {value}, which is no number: set it with the"
        " maker's tool",
        {"register": register.name},
    )
