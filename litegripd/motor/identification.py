"""What the motor is: found by a look at its registers, and found anew after a silence.

Keeps the finished identity and what follows from it: where its answers come, in which ranges its
frames are coded, why it cannot be used. It sends nothing but read requests.
"""

from litegripd.model.errors import Refusal
from litegripd.model.frame import CanFrame
from litegripd.model.motor import MotorIdentity, Ranges
from litegripd.motor.look import Look, has_usable_ranges, uncontrollable, unsuitable
from litegripd.motor.registers import Answer
from litegripd.motor.verifying import Verifier

STILL_READ = Refusal("motor_silent", "the motor's registers are still being read: try again")


class Identification:
    """The identity of the motor `can_id`, as far as it is known."""

    def __init__(self, can_id: int, configured_master_id: int | None) -> None:
        self.identity: MotorIdentity | None = None
        self.verifier = Verifier(can_id)
        self.can_id = can_id
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

    @property
    def ranges_to_send(self) -> Ranges:
        """What commands are coded with: no torque is larger than wanted by any possible range."""
        usable = self.usable_ranges
        return Ranges() if usable is None else self.verifier.widest(usable)

    def begin(self) -> None:
        """Forget everything and look anew."""
        self._look = Look(self.can_id)
        self.identity = None
        self.verifier.reset()

    def expect_another(self) -> None:
        """Look anew for the id of the answers: another motor may come in a silent one's place."""
        if self._look.master_id is not None:
            self._look = Look(self.can_id)

    def step(self, now_s: float) -> list[CanFrame]:
        """Return the read request that is due, if any."""
        return self._look.step(now_s)

    def take(self, answer: Answer, can_id: int) -> bool:
        """Take an answer that came on `can_id`; tell whether it was the awaited one."""
        return self._look.take(answer, can_id)

    def note_request(self, request: Answer) -> None:
        """Take another program's request to write registers; all is verified after it."""
        if self.identity is None:
            self.verifier.begin()  # what the look has read already may hold no longer
        else:
            self.verifier.note_request(request, self.identity)

    def note_written(self, answer: Answer, can_id: int) -> None:
        """Take the motor's answer to another program's write, which came on `can_id`."""
        if self.identity is None:
            self.verifier.begin()
        else:
            self.identity = self.verifier.note_written(answer, can_id, self.identity)

    def verify(self, answer: Answer, can_id: int) -> bool:
        """Take an answer to a read; tell whether the verifier awaited it."""
        found = self.identity and self.verifier.take(answer, can_id, self.identity)
        self.identity = found or self.identity
        return found is not None

    def finish(self) -> bool:
        """Note the identity when all has been asked for; tell whether it is known."""
        self.identity = self._look.identity()
        return self.identity is not None

    def problem(self) -> Refusal | None:
        """Say why the motor cannot be used, if so; it has told too little while unknown."""
        if self.identity is None:
            return STILL_READ
        return unsuitable(self.identity, self._configured_master_id)

    @property
    def is_uncontrollable(self) -> bool:
        """Whether it is known that the motor cannot be commanded."""
        return self.identity is not None and uncontrollable(self.identity) is not None
