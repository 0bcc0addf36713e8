"""Who may: the stop, the lease, and clients that are lost.

What happens here happens between two ticks; it reaches the motor only by the engine's next step.
"""

from litegripd.control import announce
from litegripd.control.admission import ENDING, busy_with, stopped_under_way
from litegripd.control.grip import Grip
from litegripd.control.lease import Grant, Loss, LossCause, OnAnswer, Wish
from litegripd.control.running import Running
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, OnLost, Owner, StopLevel


class Arbiter(Running):
    """Says who may have what run, and ends what nobody may any more."""

    # Stop

    def stop(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> None:
        """Stop, in force with the next command that is sent, and latched.

        One that raises nothing takes effect all the same, but is only counted: a flood of stops
        is no flood of events.
        """
        before = self.stop_latch.latched
        stop = self.stop_latch.raise_to(level, by, why, now_s)
        refusal = self.stop_latch.refusal()
        self._owed = None  # what a client who is gone wished for the jaws would undo the stop
        if refusal is not None:
            running = self.jobs.running
            if running is not None and running.kind != "disable":
                self.end(stopped_under_way(running, refusal))
            self._drop_queued(refusal, lambda _job: True)
            if stop is not before:
                self.events.append(announce.stopped(stop.level, refusal))
        self._settle_into(stop.level)
        if isinstance(self.rest, Grip):
            self.rest.freeze()  # no more torque than there is now, but not a dropped object either

    def clear_stop(self, by: Owner) -> None:
        """Allow motions again; the jaws stay as they are."""
        if self.stop_latch.latched is not None:
            self.events.append(announce.stop_cleared(by, self.stop_latch.clear()))

    def shut_down(self) -> None:
        """Begin the daemon's end: what runs is cancelled, the motor disabled, all else refused."""
        self._is_ending = True
        self.must_disable = True
        self.end(ENDING)
        self._drop_queued(ENDING, lambda _job: True)

    # The lease

    def acquire(self, owner: Owner, wish: Wish) -> Grant | Refusal:
        """Grant the lease, where it is free and nobody else's motion runs."""
        before, running = self.lease.holder, self.jobs.running
        if before is None and running is not None and running.owner.client != owner.client:
            return busy_with(running)
        answer = self.lease.acquire(owner, wish, self.now_s)
        is_new = isinstance(answer, Grant) and (before is None or answer.number != before.number)
        return self._granted(answer) if is_new else answer

    def await_lease(
        self, owner: Owner, wish: Wish, wait_s: float, on_answer: OnAnswer
    ) -> Refusal | None:
        """Let `owner` wait for the lease, first come, first served."""

        def granted(answer: Grant | Refusal) -> None:
            on_answer(self._granted(answer))

        return self.lease.wait(owner, wish, self.now_s + wait_s, granted)

    def release(self, owner: Owner) -> Refusal | None:
        """Give the lease back; a motion that runs under it goes on."""
        holder, running = self.lease.holder, self.jobs.running
        refusal = self.lease.release(owner)
        if refusal is None and holder is not None:
            self.events.append(announce.lease_released(holder, owner))
            if running is not None and running.grant == holder.number:
                running.grant = None
        return refusal

    def take_over(self, owner: Owner, wish: Wish, why: str, left: OnLost = "hold") -> Grant:
        """Take the lease from whoever has it; the caller has made sure that `owner` may.

        What runs ends, whoever's it is and also what is detached, but for disabling and for the
        taker's own motion without a lease. What the jaws do then is the taker's to say (`left`),
        not the loser's, unless something goes on.
        """
        grant, loss = self.lease.take(owner, wish, why, left, self.now_s)
        running = self.jobs.running
        is_anothers = running is not None and running.owner.client != owner.client
        if running is not None and is_anothers and running.kind != "disable":
            self.end(announce.taken_refusal(owner, why, left))
        if loss is not None:
            self.lose(loss, loss.grant.owner.client)
        elif self.jobs.running is None:
            self._settle_into(left)
        self._granted(grant)
        return grant

    def resume(self, number: int, owner: Owner) -> Grant | Refusal:
        """Grant a lapsed lease again to who reconnected, if nobody has had one since."""
        return self._granted(self.lease.resume(number, owner, self.now_s))

    def _granted(self, answer: Grant | Refusal) -> Grant | Refusal:
        """Tell of a grant; what a lost client wished for the jaws counts no more from then on."""
        if isinstance(answer, Grant):
            if self._owed is not None:
                self._owed = None
                self.events.append(announce.left_to_holder())
            self.events.append(announce.lease_granted(answer))
        return answer

    # Lost clients and lost leases

    def client_lost(self, client: int, cause: LossCause = "connection") -> None:
        """End what a client owned: its motions, unless detached, and its lease."""
        self.lose(self.lease.lose(client, cause), client)

    def lose(self, loss: Loss | None, client: int) -> None:
        """End the motion of a lost client or lease; then the jaws do what was wished.

        That is done at once, or when the motion has ended that goes on without its client: a
        detached one, or another client's. Disabling always goes on.
        """
        running = self.jobs.running
        refusal = announce.loss_refusal(loss)
        self._drop_queued(refusal, lambda job: _falls(job, loss, client))
        ends = running is not None and running.kind != "disable" and _falls(running, loss, client)
        if ends:
            self.end(refusal)
        on_lost: OnLost = "hold" if loss is None else loss.on_lost
        cause = None if loss is None else loss.cause
        later = loss is not None and self.jobs.running is not None
        if loss is not None:
            self.events.append(announce.lease_lost(loss))
        if ends or loss is not None:
            self.events.append(announce.client_lost(on_lost, cause, later=later))
        if later:
            self._owed = on_lost
        elif ends or loss is not None:
            self._settle_into(on_lost)

    def _step_authority(self, now_s: float) -> None:
        """Take what time brings: a lease that runs out, and whose turn it is.

        A motion under a lease that is not the present one never goes on, whatever the way;
        disabling always does.
        """
        loss = self.lease.expire(now_s)
        if loss is not None:
            self.lose(loss, loss.grant.owner.client)
        running, holder = self.jobs.running, self.lease.holder
        present = None if holder is None else holder.number
        if (
            running is not None
            and not running.detached
            and running.kind != "disable"
            and running.grant not in (None, present)
        ):
            self.end(announce.loss_refusal(None))
        self._start_queued()
        self.lease.step(now_s, may_grant=self.jobs.running is None and not self._queue)


def _falls(job: Job, loss: Loss | None, client: int) -> bool:
    """Whether a job ends with its client, or with the lease that it runs under."""
    if job.detached:
        return False
    under = loss is not None and job.grant == loss.grant.number
    return under or job.owner.client == client
