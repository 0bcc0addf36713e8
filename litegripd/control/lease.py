"""Who may move the gripper: one lease, granted in the order of requests, lost in several ways.

It knows no motion: the controller ends what ran under a lost lease. Times are arguments; a callback
answers waiting requests.
"""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, TypedDict

from litegripd.model.errors import Refusal
from litegripd.model.jobs import OnLost, Owner
from litegripd.model.plain import Carried

LossCause: TypeAlias = Literal["connection", "process", "expired", "taken"]
"""Why a lease was lost: its connection ended, its process died, its time to live ran out without
a request, or somebody took it over."""

LOSS_TEXTS: Mapping[LossCause, str] = {
    "connection": "its connection ended",
    "process": "its process ended",
    "expired": "it sent nothing for longer than its ttl_s",
    "taken": "it was taken over",
}

MOST_WAITING = 64


@dataclass(frozen=True, slots=True)
class LeaseOptions:
    """The options of a lease.

    With `ttl_s` it is lost when its holder sends no request for that time; `on_lost` is what the
    jaws do then.
    """

    purpose: str | None = None
    ttl_s: float | None = None
    on_lost: OnLost = "hold"


@dataclass(frozen=True, slots=True)
class Grant:
    """A lease that a client holds; `number` counts the grants since the daemon's start."""

    number: int
    owner: Owner
    options: LeaseOptions
    since_s: float


class Taker(TypedDict):
    """The process that took a lease."""

    pid: int
    uid: int
    program: str


class _LossData(TypedDict):
    cause: LossCause
    why: str | None
    on_lost: OnLost


class LossData(_LossData, total=False):
    """Why a lease was lost, for programs; `by` exists only if it was taken."""

    by: Taker


@dataclass(frozen=True, slots=True)
class Loss:
    """A lost lease: the reason, and the taker if it was taken.

    `left` is what the jaws do then, if the taker chose it.
    """

    grant: Grant
    cause: LossCause
    by: Owner | None = None
    why: str | None = None
    left: OnLost | None = None

    @property
    def on_lost(self) -> OnLost:
        """What the jaws do: the taker's choice, otherwise the former holder's."""
        return self.left or self.grant.options.on_lost

    @property
    def text(self) -> str:
        """Why it was lost, and who took it."""
        if self.by is None:
            return LOSS_TEXTS[self.cause]
        by = self.by
        return f"{LOSS_TEXTS[self.cause]} by {by.program} (pid {by.pid}, uid {by.uid}): {self.why}"

    @property
    def data(self) -> LossData:
        """Return the same for programs."""
        data: LossData = {"cause": self.cause, "why": self.why, "on_lost": self.on_lost}
        if self.by is not None:
            data["by"] = _who(self.by)
        return data


OnAnswer: TypeAlias = Callable[[Grant | Refusal], None]


@dataclass(frozen=True, slots=True)
class _Waiting:
    owner: Owner
    options: LeaseOptions
    until_s: float
    on_answer: OnAnswer


class Lease:
    """The one lease of a gripper.

    A connection that has lost it moves nothing until it asks for the lease again: a program that
    slept through its loss must not act as if it had it.
    """

    _last: Carried[int] = 0
    _lapsed: Carried[Grant | None] = None
    NOT_CARRIED = ("holder", "_waiting", "_expires_s", "_losses")

    def __init__(self) -> None:
        self.holder: Grant | None = None
        self._waiting: deque[_Waiting] = deque()
        self._expires_s: float | None = None
        self._losses: dict[int, Loss] = {}

    @property
    def waiting(self) -> int:
        """The number of waiting requests."""
        return len(self._waiting)

    def refusal(self, owner: Owner) -> Refusal | None:
        """Return why `owner` may not move the gripper, or None.

        A request that names a grant must name the present one. A request that names none is
        admitted if its own connection holds the lease, or if the lease is free and was not lost by
        this connection.
        """
        holder = self.holder
        if owner.grant is not None and (holder is None or holder.number != owner.grant):
            text = "the lease of this token is lost for good: acquire a new one"
            return Refusal("lease_lost", text, _held_by(holder))
        if owner.grant is not None:
            return None
        loss = self._losses.get(owner.client)
        if loss is not None:
            return _lost_refusal(loss, holder)
        if holder is None or holder.owner.client == owner.client:
            return None
        return held_refusal(holder)

    def acquire(self, owner: Owner, options: LeaseOptions, now_s: float) -> Grant | Refusal:
        """Grant the lease if it is free; its holder may change its options."""
        holder = self.holder
        if holder is not None and holder.owner.client == owner.client:
            self.holder = replace(holder, options=options)
            self._renew(now_s)
            return self.holder
        if holder is not None:
            return held_refusal(holder)
        if self._waiting:
            text = f"{len(self._waiting)} are waiting for the lease already: wait, too (wait_s)"
            return Refusal("lease_held", text, {"waiting": len(self._waiting)})
        return self._grant(owner, options, now_s)

    def wait(
        self, owner: Owner, options: LeaseOptions, until_s: float, on_answer: OnAnswer
    ) -> Refusal | None:
        """Wait for the lease; `on_answer` is called once, from `step` or another's request."""
        if len(self._waiting) >= MOST_WAITING:
            text = f"{MOST_WAITING} are waiting for the lease already: try again later"
            return Refusal("too_many_requests", text, {"limit": MOST_WAITING})
        self._waiting.append(_Waiting(owner, options, until_s, on_answer))
        return None

    def release(self, owner: Owner) -> Refusal | None:
        """Release the lease if `owner` has it; this is no loss."""
        holder = self.holder
        if holder is None:
            return Refusal("lease_lost", "there is no lease to release")
        refusal = self.refusal(owner)
        if refusal is None:
            self._free()
        return refusal

    def take(
        self, owner: Owner, options: LeaseOptions, why: str, left: OnLost, now_s: float
    ) -> tuple[Grant, Loss | None]:
        """Take the lease over; the caller has checked that `owner` may."""
        holder = self.holder
        loss = None if holder is None else Loss(holder, "taken", owner, why, left)
        if loss is not None:
            self._losses[loss.grant.owner.client] = loss
        return self._grant(owner, options, now_s), loss

    def resume(self, number: int, owner: Owner, now_s: float) -> Grant | Refusal:
        """Grant a lapsed lease again for its number, if nobody has acquired one since."""
        lapsed = self._lapsed
        if self.holder is not None or lapsed is None or lapsed.number != number or self._waiting:
            text = (
                "the lease of this token cannot be resumed: it was given back, or somebody has had"
                " the lease since; acquire it again (lease.acquire)"
            )
            return Refusal("lease_lost", text)
        return self._grant(owner, lapsed.options, now_s)

    def renew(self, client: int, now_s: float) -> None:
        """Take note of a request: its sender does not hang."""
        if self.holder is not None and self.holder.owner.client == client:
            self._renew(now_s)

    def lose(self, client: int, cause: LossCause) -> Loss | None:
        """Forget a lost client; return what it lost."""
        self._waiting = deque(entry for entry in self._waiting if entry.owner.client != client)
        holder = self.holder
        loss = None
        if holder is not None and holder.owner.client == client:
            loss = Loss(holder, cause)
            self._lapse(loss)
        if cause == "connection":
            self._losses.pop(client, None)  # it sends no more requests
        return loss

    def expire(self, now_s: float) -> Loss | None:
        """Return the loss of a lease whose holder sent nothing for too long, or None."""
        holder = self.holder
        if holder is None or self._expires_s is None or now_s < self._expires_s:
            return None
        loss = Loss(holder, "expired")
        self._lapse(loss)
        return loss

    def step(self, now_s: float, *, may_grant: bool) -> None:
        """Answer waiting requests: those whose time is over, and the next if `may_grant`."""
        for entry in [entry for entry in self._waiting if now_s >= entry.until_s]:
            self._waiting.remove(entry)
            entry.on_answer(_waited_in_vain(self.holder))
        if may_grant and self.holder is None and self._waiting:
            entry = self._waiting.popleft()
            entry.on_answer(self._grant(entry.owner, entry.options, now_s))

    def _grant(self, owner: Owner, options: LeaseOptions, now_s: float) -> Grant:
        self._last += 1
        self.holder = Grant(self._last, replace(owner, grant=None), options, now_s)
        self._lapsed = None
        self._losses.pop(owner.client, None)
        self._renew(now_s)
        return self.holder

    def _renew(self, now_s: float) -> None:
        ttl_s = None if self.holder is None else self.holder.options.ttl_s
        self._expires_s = None if ttl_s is None else now_s + ttl_s

    def _lapse(self, loss: Loss) -> None:
        self._free()
        self._lapsed = loss.grant
        self._losses[loss.grant.owner.client] = loss

    def _free(self) -> None:
        self.holder, self._expires_s, self._lapsed = None, None, None


def held_refusal(holder: Grant) -> Refusal:
    """Return who has the lease, and what for."""
    owner, purpose = holder.owner, holder.options.purpose
    what = "" if purpose is None else f" for {purpose}"
    return Refusal(
        "lease_held",
        f"{owner.program} (pid {owner.pid}) has the gripper{what}: wait for it (lease.acquire"
        " with wait_s), or take it over (lease.take)",
        {"owner": _owner_data(holder)},
    )


def _lost_refusal(loss: Loss, holder: Grant | None) -> Refusal:
    """Return who has taken the lease of a connection, or how else it was lost."""
    return Refusal(
        "lease_lost",
        f"the lease of this connection is lost: {loss.text}; nothing moves for it until it asks"
        " for the gripper again (lease.acquire)",
        {**loss.data, **_held_by(holder), "hint": "lease.acquire"},
    )


def _held_by(holder: Grant | None) -> dict[str, object]:
    return {} if holder is None else {"owner": _owner_data(holder)}


def _owner_data(holder: Grant) -> dict[str, object]:
    purpose, since_s = holder.options.purpose, holder.since_s
    return {**_who(holder.owner), "purpose": purpose, "since_s": since_s}


def _who(owner: Owner) -> Taker:
    return {"pid": owner.pid, "uid": owner.uid, "program": owner.program}


def _waited_in_vain(holder: Grant | None) -> Refusal:
    if holder is not None:
        return held_refusal(holder)
    return Refusal("lease_held", "the gripper was not free in time: wait longer, or try again")
