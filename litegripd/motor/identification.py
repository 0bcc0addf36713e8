"""What the motor is: found by a look at its registers, and found anew after a silence.

Keeps the finished identity and what follows from it: where its answers come, in which ranges its
frames are coded, why it cannot be used. It sends nothing but read requests.
"""

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import MotorIdentity, Ranges
from litegripd.motor.look import Look, has_usable_ranges, unsuitable
from litegripd.motor.registers import Answer

STILL_READ = Refusal("motor_silent", "the motor's registers are still being read: try again")


class Identification:
    """The identity of the motor `can_id`, as far as it is known."""

    def __init__(self, can_id: int, configured_master_id: int | None) -> None:
        self.identity: MotorIdentity | None = None
        self._can_id = can_id
        self._configured_master_id = configured_master_id
        self._look = Look(can_id)

    @property
    def master_id(self) -> int | None:
        """The id on which the motor answers, once it is known."""
        return self._look.master_id if self.identity is None else self.identity.master_id

    @property
    def usable_ranges(self) -> Ranges | None:
        """The motor's own ranges, None while they are unknown and where they make no sense."""
        identity = self.identity
        return identity.ranges if identity is not None and has_usable_ranges(identity) else None

    @property
    def ranges(self) -> Ranges:
        """What frames are decoded with; the status does not depend on it."""
        return self.usable_ranges or Ranges()

    def begin(self) -> None:
        """Forget everything and look anew."""
        self._look = Look(self._can_id)
        self.identity = None

    def expect_another(self) -> None:
        """Look anew for the id of the answers: another motor may come in a silent one's place."""
        if self._look.master_id is not None:
            self._look = Look(self._can_id)

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the read request that is due, if any."""
        return self._look.step(now_s)

    def take(self, answer: Answer, can_id: int) -> bool:
        """Take an answer that came on `can_id`; tell whether it was the awaited one."""
        return self._look.take(answer, can_id)

    def finish(self) -> bool:
        """Note the identity when all has been asked for; tell whether it is known."""
        self.identity = self._look.identity()
        return self.identity is not None

    def problem(self) -> Refusal | None:
        """Say why the motor cannot be used, if so; it has told too little while unknown."""
        if self.identity is None:
            return STILL_READ
        return unsuitable(self.identity, self._configured_master_id)
