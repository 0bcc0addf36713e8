"""Authority: the software stop, the lease, and other senders on the bus."""

from collections import deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias, TypedDict

from litegripd.model.errors import Refusal
from litegripd.model.motor import RegisterWrite
from litegripd.model.plain import Carried
from litegripd.model.sentence import method_name, sentence
from litegripd.model.state import STOP_LEVELS, Event, OnLost, Owner, Stop, StopLevel, User


class StopLatch:
    """Keeps the latched stop and counts the stops in `generation`.

    A request names the generation that its sender knew. One from before the latest stop never runs
    and clears nothing, even if it lay unread in the kernel when the stop came. `repeats` counts the
    stops since the latched one that did not raise the level. `on_stop` is called with the time of
    each stop: all that has come by then came before it. `stopped_by` are the users (None is the
    daemon itself) who have stopped since the present level was latched.
    """

    latched: Carried[Stop | None] = None
    generation: Carried[int] = 0
    repeats: Carried[int] = 0
    stopped_by: Carried[tuple[User | None, ...]] = ()
    _latest_s: Carried[float] = float("-inf")
    NOT_CARRIED = ("on_stop", "_cleared", "_latest_client", "_latest_of_others_s")
    # Connections end, and with them what was sent before a stop that is cleared.

    def __init__(self) -> None:
        self.on_stop: Callable[[float], None] = lambda _now_s: None
        self._cleared: Stop | None = None
        self._latest_client: int | None = None
        self._latest_of_others_s = float("-inf")

    def raise_to(self, level: StopLevel, by: Owner | None, why: str | None, now_s: float) -> Stop:
        """Latch a stop; one that is no stronger than the latched one changes only the counts."""
        self.generation += 1
        client = None if by is None else by.client
        if client != self._latest_client:
            self._latest_client, self._latest_of_others_s = client, self._latest_s
        self._latest_s = now_s
        latched, user = self.latched, None if by is None else by.user
        if latched is None or STOP_LEVELS.index(level) > STOP_LEVELS.index(latched.level):
            latched = Stop(level, by, now_s, why)
            self.latched, self.stopped_by = latched, (user,)
        else:
            self.repeats += 1
            if user not in self.stopped_by:
                self.stopped_by += (user,)
        self.on_stop(now_s)  # called after the latch, in case it fails
        return latched

    def may_be_cleared_by(self, user: User, *, alone: bool) -> bool:
        """Return True if a user has stopped, and may clear it; `alone`: only if nobody else has."""
        return self.stopped_by == (user,) if alone else user in self.stopped_by

    def clear(self) -> int:
        """Allow requests for motions again; return the number of repeats."""
        repeats, self.repeats = self.repeats, 0
        self._cleared = self.latched or self._cleared
        self.latched, self.stopped_by = None, ()
        return repeats

    def refusal(self) -> Refusal | None:
        """Return why nothing may move, or None."""
        stop = self.latched
        if stop is None:
            return None
        return Refusal(
            "stopped",
            sentence(
                "{stop} is latched{why}; clear it with {stop.clear} first",
                stop=of_stop(stop),
                why=_because(stop),
            ),
            {**_stop_data(stop), "hint": method_name("stop.clear")},
        )

    def clearing_refusal(self, lease_held: Refusal) -> Refusal:
        """Return who may clear the stop, for a client that may not.

        Another one has the lease, or it has lost the lease itself.
        """
        owner = lease_held.data.get("owner")
        known = [user for user in self.stopped_by if user is not None]
        whose = "" if self.latched is None else f", by {_stopper(self.latched)},"
        who = [f"{user}, who stopped it, " for user in known]
        why = sentence("; {why}", why=lease_held.message)
        hint = (
            {"hint": sentence("ask one of them to clear it")}
            if lease_held.reason == "lease_held"
            else {}
        )
        if isinstance(owner, dict):
            who = [f"{owner['program']} (pid {owner['pid']}), who has the lease, ", *who]
            why = sentence("")
        return Refusal(
            lease_held.reason,
            sentence(
                "the stop{whose} may be cleared by {who}or an admin{why}",
                whose=whose,
                who="".join(who),
                why=why,
            ),
            {**lease_held.data, **hint, "may_clear_uids": [user.uid for user in known]},
        )

    def refusal_of_sent(
        self,
        generation: int | None,
        sent_s: float | None,
        received_s: float,
        client: int,
        *,
        clears: bool = False,
    ) -> Refusal | None:
        """Return a refusal if a request is older than the latest stop, by any of its marks.

        `received_s` is when the daemon received it; `clears` says that it is to clear the stop.
        What a client sent after its own stop is newer than that stop, even if both were received
        at once.
        """
        is_own = client == self._latest_client
        stopped_s = self._latest_of_others_s if is_own else self._latest_s
        if generation is not None and generation < self.generation:
            how = "this client had not heard of it"
        elif sent_s is not None and sent_s < self._latest_s:
            how = f"it came {self._latest_s - sent_s:.3f} s after this was sent"
        elif received_s < stopped_s:
            how = f"it came {stopped_s - received_s:.3f} s after this had come"
        else:
            return None
        stop = self.latched or self._cleared
        which = "a stop" if stop is None else said_of(stop)
        again = "so this is not carried out: look at the state and, when it is safe, "
        if self.latched is None:
            how = f"it is cleared, but {how}"
            remedy = sentence("{again}send it again", again=again)
        elif clears:
            remedy = sentence("{again}send it again, which then clears that, too", again=again)
        else:
            remedy = sentence("{again}clear it ({stop.clear}), then send this again", again=again)
        return Refusal(
            "sent_before_stop",
            sentence("{which}; {how}, {remedy}", which=which, how=how, remedy=remedy),
            {**_stop_data(stop), "stop_generation": self.generation},
        )


def of_stop(stop: Stop) -> str:
    """Name a stop by its level and by who has stopped."""
    return f"a stop ({stop.level}) by {_stopper(stop)}"


def said_of(stop: Stop) -> str:
    """Return what is to be said of a stop later, when it may be cleared: who, and why."""
    return f"{of_stop(stop)}{_because(stop)}"


def _stopper(stop: Stop) -> str:
    return "the daemon" if stop.by is None else f"{stop.by.program} (pid {stop.by.pid})"


def _because(stop: Stop | None) -> str:
    return "" if stop is None or stop.why is None else f": {stop.why}"


def _stop_data(stop: Stop | None) -> dict[str, object]:
    """Return what a program may want to know of a stop: how, by whom (or None), and why."""
    if stop is None:
        return {}
    owner = None if stop.by is None else process_of(stop.by)
    return {"level": stop.level, "owner": owner, "why": stop.why}


QUIET_AFTER_S = 2.0
"""Without a frame for this time, the other program counts as gone."""

REPORT_EVERY_S = 10.0


class SecondMaster:
    """Counts the frames of others, and knows when the last one came."""

    is_active: Carried[bool] = False
    _seen_s: Carried[float] = 0.0
    _told_s: Carried[float] = 0.0
    NOT_CARRIED = ("is_tolerated", "count", "_write", "_known_write")  # the motor counts from 0

    def __init__(self) -> None:
        self.is_tolerated = False
        self.count = 0
        self._write: RegisterWrite | None = None
        """The latest write while another program is active."""
        self._known_write: RegisterWrite | None = None

    def step(self, now_s: float, count: int, write: RegisterWrite | None = None) -> Event | None:
        """Take the number of frames so far, and the latest of them that wrote registers.

        Return an event to report: a begin, another write, a reminder, or the end.
        """
        is_other = write is not None and write is not self._known_write
        is_new = is_other and write != self._write
        if is_other:
            self._write = self._known_write = write
        if count != self.count:
            self.count, self._seen_s = count, now_s
            if self.is_active and not is_new and now_s - self._told_s < REPORT_EVERY_S:
                return None
            self.is_active, self._told_s = True, now_s
            return Event("second_master", self._text(), {**self._data(), "active": True})
        if self.is_active and now_s - self._seen_s >= QUIET_AFTER_S:
            self.is_active, self._write = False, None
            text = f"the other sender is quiet again, after {count} frames"
            return Event("second_master", text, {"frames": count, "active": False})
        return None

    def refusal(self) -> Refusal | None:
        """Return why no motion may run, or None."""
        if self.is_tolerated or not self.is_active:
            return None
        return Refusal("second_master", self._text(), self._data())

    def _data(self) -> dict[str, object]:
        data: dict[str, object] = {"frames": self.count}
        if self._write is not None:
            data |= {"register": self._write.name, "value": self._write.value}
        return data

    def _text(self) -> str:
        does, write = "commands the motor", self._write
        if write is not None and write.name is None:
            does = "saves the motor's registers"
        elif write is not None:
            value = "" if write.value is None else f" to {write.value:g}"
            does = f"writes the motor's register {write.name}{value}"
        return (
            f"another program {does} on the same bus ({self.count} frames so far):"
            " find and end it (the maker's tool, a script with the vendor's SDK, cansend of"
            " can-utils, a second adapter), for one motor has one owner"
        )


LossCause: TypeAlias = Literal["connection", "process", "expired", "taken"]
"""Why a lease was lost: its connection ended, its process died, its time to live ran out without
a request, or somebody took it over."""

LOSS_TEXTS: Mapping[LossCause, str] = {
    "connection": "its connection ended",
    "process": "its process ended",
    "expired": "it sent nothing for longer than its time to live",
    "taken": "it was taken over",
}

MOST_WAITING = 64


LONGEST_REMOTE_TTL_S = 5.0
"""Of a lease that a user of another machine resumes: as long as a gateway lets one be asked for."""


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
    """What `owner` has lost: the lease of the number `grant`, or, for None, a motion without one.

    `on_lost` is what the jaws do then: the taker's choice, otherwise the former holder's.
    """

    owner: Owner
    grant: int | None
    cause: LossCause
    on_lost: OnLost
    by: Owner | None = None
    why: str | None = None

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
            data["by"] = process_of(self.by)
        return data

    @property
    def notice(self) -> dict[str, object]:
        """Return the same with the loser, as the loser is told."""
        owner = self.owner
        return {"client": owner.client, "pid": owner.pid, "uid": owner.uid, **self.data}


OnAnswer: TypeAlias = Callable[[Grant | Refusal], None]


@dataclass(frozen=True, slots=True)
class _Waiting:
    owner: Owner
    options: LeaseOptions
    wait_s: float
    until_s: float
    on_answer: OnAnswer


class Lease:
    """The one lease of a gripper.

    A connection that has lost it moves nothing until it asks for the lease again: a program that
    slept through its loss must not act as if it had it. So does one whose motion without a lease a
    taker has ended: a stream would begin anew with its next set-point.
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
            hint = method_name("lease.acquire")
            return Refusal("lease_lost", text, {**_held_by(holder), "hint": hint})
        if owner.grant is not None:
            return None
        loss = self._losses.get(owner.client)
        if loss is not None:
            return Refusal(
                "lease_lost",
                sentence(
                    "{what}: {how}; nothing moves for it until it asks for the gripper again"
                    " ({lease.acquire})",
                    what="the gripper is lost to this connection"
                    if loss.grant is None
                    else "the lease of this connection is lost",
                    how=loss.text,
                ),
                {**loss.data, **_held_by(holder), "hint": method_name("lease.acquire")},
            )
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
            hint = sentence("wait, too ({.wait_s})")
            text = sentence(
                "{count} are waiting for the lease already: {hint}",
                count=len(self._waiting),
                hint=hint,
            )
            return Refusal("lease_held", text, {"waiting": len(self._waiting), "hint": hint})
        return self._grant(owner, options, now_s)

    def wait(
        self,
        owner: Owner,
        options: LeaseOptions,
        now_s: float,
        wait_s: float,
        on_answer: OnAnswer,
    ) -> Refusal | None:
        """Wait for the lease; `on_answer` is called once, from `step` or another's request."""
        if len(self._waiting) >= MOST_WAITING:
            text = f"{MOST_WAITING} are waiting for the lease already: try again later"
            return Refusal("too_many_requests", text, {"limit": MOST_WAITING})
        self._waiting.append(_Waiting(owner, options, wait_s, now_s + wait_s, on_answer))
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
        loss = None
        if holder is not None:
            loss = Loss(holder.owner, holder.number, "taken", left, owner, why)
            self.note_loss(loss)
        return self._grant(owner, options, now_s), loss

    def note_loss(self, loss: Loss) -> None:
        """Let the loser, whose connection has not ended, move nothing until it asks again."""
        self._losses[loss.owner.client] = loss

    def resume(self, number: int, owner: Owner, now_s: float) -> Grant | Refusal:
        """Grant a lapsed lease again for its number, if nobody has acquired one since."""
        lapsed = self._lapsed
        if lapsed is None or not self.may_resume(number):
            text = sentence(
                "the lease of this token cannot be resumed: it was given back, or somebody has had"
                " the lease since; acquire it again ({lease.acquire})"
            )
            return Refusal("lease_lost", text, {"hint": method_name("lease.acquire")})
        options = lapsed.options
        if owner.remote is not None:  # behind a network, nobody sees that the holder has gone
            ttl_s = min(options.ttl_s or LONGEST_REMOTE_TTL_S, LONGEST_REMOTE_TTL_S)
            options = replace(options, ttl_s=ttl_s)
        return self._grant(owner, options, now_s)

    def may_resume(self, number: int) -> bool:
        """Return True if this lease lapsed, and nobody has one or waits for one since."""
        lapsed = self._lapsed
        is_free = self.holder is None and not self._waiting
        return is_free and lapsed is not None and lapsed.number == number

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
            loss = self._lapse(holder, cause)
        if cause == "connection":
            self._losses.pop(client, None)  # it sends no more requests
        return loss

    def expire(self, now_s: float) -> Loss | None:
        """Return the loss of a lease whose holder sent nothing for too long, or None."""
        holder = self.holder
        if holder is None or self._expires_s is None or now_s < self._expires_s:
            return None
        return self._lapse(holder, "expired")

    def step(self, now_s: float, *, may_grant: bool) -> None:
        """Answer waiting requests: the holder's own, late ones, and the next if `may_grant`."""
        holder = self.holder
        if holder is not None:  # it has asked twice, or has taken what it waits for
            client = holder.owner.client
            for entry in [entry for entry in self._waiting if entry.owner.client == client]:
                self._waiting.remove(entry)
                entry.on_answer(holder)
        for entry in [entry for entry in self._waiting if now_s >= entry.until_s]:
            self._waiting.remove(entry)
            entry.on_answer(_waited_refusal(self.holder, entry.wait_s))
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

    def _lapse(self, holder: Grant, cause: LossCause) -> Loss:
        self._free()
        self._lapsed = holder
        loss = Loss(holder.owner, holder.number, cause, holder.options.on_lost)
        self.note_loss(loss)
        return loss

    def _free(self) -> None:
        self.holder, self._expires_s, self._lapsed = None, None, None


_TO_GET_IT = sentence("wait for it ({lease.acquire with wait_s}), or take it over ({lease.take})")
_AFTER_WAITING = sentence(
    "wait longer ({lease.acquire with wait_s}), or take it over ({lease.take})"
)


def held_refusal(holder: Grant, waited_s: float | None = None) -> Refusal:
    """Return who has the lease, and what for; and that it was waited for."""
    owner, purpose = holder.owner, holder.options.purpose
    what = "" if purpose in (None, owner.program) else f" for {purpose}"
    how = _TO_GET_IT if waited_s is None else _AFTER_WAITING
    waited = "" if waited_s is None else f" after {waited_s:g} s of waiting"
    return Refusal(
        "lease_held",
        sentence(
            "{program} (pid {pid}) {still}has the gripper{what}{waited}: {how}",
            program=owner.program,
            pid=owner.pid,
            still="" if waited_s is None else "still ",
            what=what,
            waited=waited,
            how=how,
        ),
        {"owner": _owner_data(holder), "hint": how},
    )


_LATER = sentence("wait longer, or try again")


def _waited_refusal(holder: Grant | None, waited_s: float) -> Refusal:
    """Return why the lease could not be had in the time of who waited for it."""
    if holder is not None:
        return held_refusal(holder, waited_s)
    text = sentence("the gripper was not free within {s:g} s: {how}", s=waited_s, how=_LATER)
    return Refusal("lease_held", text, {"hint": _LATER})


def _held_by(holder: Grant | None) -> dict[str, object]:
    return {} if holder is None else {"owner": _owner_data(holder)}


def _owner_data(holder: Grant) -> dict[str, object]:
    purpose, since_s = holder.options.purpose, holder.since_s
    return {**process_of(holder.owner), "purpose": purpose, "since_s": since_s}


def process_of(owner: Owner) -> Taker:
    """Return the process of a client, for programs."""
    return {"pid": owner.pid, "uid": owner.uid, "program": owner.program}
