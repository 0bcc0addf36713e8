"""True if what the daemon told of a crowd is as it must be: pure, from events, samples and deaths.

Every motion has one owner, runs alone, only by leave of the lease, and ends. What a client that
dies has, the lease or a motion, is lost with it, and the jaws do what was wished.
"""

from bisect import bisect_left
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from typing import Any, TypeAlias

from bench.crowd.client import EXPECTED

Event: TypeAlias = dict[str, Any]
"""The parameters of an `event` notification."""

UNPOWERED = frozenset({"disabling", "disabled", "offline", "fault"})
TICKS_TO_SHOW = 2
"""In so many samples what was wished shows: the end of a motion is told in its last tick."""


@dataclass(frozen=True, slots=True)
class Sample:
    """The state in tick `seq`; `commanded`: the motor was told a position or torque."""

    seq: int
    at_s: float
    mode: str
    job: int | None
    commanded: bool


@dataclass(frozen=True, slots=True)
class Death:
    """A process that was killed: CLOCK_MONOTONIC just before, and when the kernel was done."""

    pid: int
    at_s: float
    over_s: float


@dataclass(slots=True)
class Motion:
    """One motion, from its begin to its end."""

    number: int
    kind: str
    client: int
    pid: int
    detached: bool
    began_s: float
    ended_s: float | None = None
    state: str | None = None
    reason: str | None = None

    @property
    def is_lost_with_its_client(self) -> bool:
        return not self.detached and self.kind != "disable"


@dataclass(slots=True)
class Tenure:
    """One grant of the lease; `on_lost` is told only when it is lost, `after` is the motion that
    has to end before that comes into force."""

    client: int
    pid: int
    began_s: float
    ended_s: float | None = None
    cause: str | None = None
    on_lost: str = "hold"
    after: Motion | None = None


@dataclass(frozen=True, slots=True)
class Loss:
    """What a death did, by CLOCK_MONOTONIC: when the daemon told of it, and the first tick in
    force, None where a motion that goes on had to end first, or where that tick was not seen.
    `gap_s` is the longest time between two ticks on the way.
    """

    death: Death
    on_lost: str
    told_s: float
    in_force_s: float | None
    gap_s: float


@dataclass(slots=True)
class Audit:
    """Takes the events in their order, then judges."""

    motions: dict[int, Motion] = field(default_factory=dict)
    tenures: list[Tenure] = field(default_factory=list)
    refused: dict[str, int] = field(default_factory=dict)
    complaints: list[str] = field(default_factory=list)
    unseen: int = 0
    running: Motion | None = None
    holder: Tenure | None = None
    _seq: int | None = None
    _lost: Tenure | None = None
    _settled_s: list[float] = field(default_factory=list)

    def take(self, event: Event) -> None:
        """Take the next event."""
        seq, data = event["seq"], event["data"]
        if self._seq is not None and seq != self._seq + 1:
            self.complaints.append(f"event {seq} follows on {self._seq}")
        self._seq = seq
        function = {
            "job_started": self._started,
            "job_ended": self._ended,
            "lease": self._lease,
            "lease_lost": self._lease_lost,
            "client_lost": self._client_lost,
            "refused": self._refused,
        }.get(event["kind"])
        if function is not None:
            function(data, event["monotonic_s"])

    def _started(self, data: dict[str, Any], at_s: float) -> None:
        number = data["job"]
        motion = Motion(**{"number": number, **_without(data, "job"), "began_s": at_s})
        if number in self.motions:
            self.complaints.append(f"job {number} began twice: {self.motions[number]}, {motion}")
        if self.running is not None:
            self.complaints.append(f"{motion} began while {self.running} ran")
        if self.holder is not None and self.holder.client != motion.client:
            self.complaints.append(f"{motion} began under the lease of another: {self.holder}")
        self.motions[number] = self.running = motion

    def _ended(self, data: dict[str, Any], at_s: float) -> None:
        number, reason = data["job"], data["reason"]
        self._judge_reason(reason, f"job {number}")
        motion = self.motions.get(number)
        at_once = motion is None or motion.began_s == at_s
        if at_once and data["state"] == "done":
            self._settled_s.append(at_s)  # as by motion.hold: the jaws do something else now
        if motion is None:  # it waited in the queue in vain
            return
        if motion is not self.running:
            self.complaints.append(f"{motion} ended while {self.running} ran")
        motion.ended_s, motion.state, motion.reason = at_s, data["state"], reason
        if motion.state not in ("done", "failed", "cancelled"):
            self.complaints.append(f"{motion} ended without an outcome")
        self.running = None

    def _lease(self, data: dict[str, Any], at_s: float) -> None:
        if data["held"] and self.holder is not None:
            self.complaints.append(f"client {data['client']} got the lease of {self.holder}")
        if data["held"]:
            self.holder = Tenure(data["client"], data["pid"], at_s)
            self.tenures.append(self.holder)
        else:
            self._end_tenure(data, at_s, "given back")

    def _lease_lost(self, data: dict[str, Any], at_s: float) -> None:
        self._lost = self.holder
        self._end_tenure(data, at_s, data["cause"])

    def _end_tenure(self, data: dict[str, Any], at_s: float, cause: str) -> None:
        if self.holder is None or self.holder.client != data["client"]:
            self.complaints.append(f"client {data['client']} lost the lease of {self.holder}")
        else:
            self.holder.ended_s, self.holder.cause = at_s, cause
        self.holder = None

    def _client_lost(self, data: dict[str, Any], _at_s: float) -> None:
        if self._lost is not None:
            self._lost.on_lost, self._lost.after = data["on_lost"], self.running
        self._lost = None

    def _refused(self, data: dict[str, Any], _at_s: float) -> None:
        reason = data["reason"]
        self.refused[reason] = self.refused.get(reason, 0) + 1
        self._judge_reason(reason, "a request")

    def _judge_reason(self, reason: str | None, what: str) -> None:
        if reason is not None and reason not in EXPECTED:
            self.complaints.append(f"{what} was refused or ended by {reason}")

    def judge(self, samples: Sequence[Sample], deaths: Iterable[Death]) -> list[Loss]:
        """Return what the deaths did; what never happened becomes a complaint."""
        for motion in self.motions.values():
            if motion.ended_s is None:
                self.complaints.append(f"{motion} did not end")
        losses = [self._loss(death, samples) for death in deaths]
        return [loss for loss in losses if loss is not None]

    def _loss(self, death: Death, samples: Sequence[Sample]) -> Loss | None:
        """Return what one death did, None where there was nothing to lose by then."""
        at_s = death.at_s
        tenure = next((t for t in self.tenures if t.pid == death.pid and _was(t, at_s)), None)
        motion = next(
            (m for m in self.motions.values() if m.pid == death.pid and _was(m, at_s)), None
        )
        if motion is not None and not motion.is_lost_with_its_client:
            motion = None
        if tenure is not None and tenure.ended_s is None:
            self.complaints.append(f"{tenure} outlived its holder, which was killed at {at_s}")
        elif tenure is not None and tenure.cause in ("connection", "process"):
            return self._in_force(death, tenure.ended_s, tenure.on_lost, tenure.after, samples)
        elif motion is not None and motion.reason in ("client_lost", "lease_lost"):
            return self._in_force(death, motion.ended_s, "hold", None, samples)
        return None  # it had nothing, or gave it back in its last moment

    def _in_force(
        self,
        death: Death,
        told_s: float | None,
        on_lost: str,
        after: Motion | None,
        samples: Sequence[Sample],
    ) -> Loss | None:
        begins_s = told_s if after is None else after.ended_s
        if told_s is None or begins_s is None:
            return None  # the motion did not end: there is a complaint about it already
        first = bisect_left(samples, begins_s, key=attrgetter("at_s"))
        shown = samples[first : first + TICKS_TO_SHOW]
        seen = [sample.seq for sample in samples[max(first - 1, 0) : first + TICKS_TO_SHOW]]
        if any(one + 1 != following for one, following in pairwise(seen)):
            self.unseen += 1
            return Loss(death, on_lost, told_s, None, 0.0)
        found = [s for s in shown if self._shows(s, on_lost, death.pid, begins_s)]
        if not found:
            self.complaints.append(f"{on_lost} did not come into force after {death}: {shown}")
            return None
        if after is not None:
            return Loss(death, on_lost, told_s, None, 0.0)
        died = bisect_left(samples, death.at_s, key=attrgetter("at_s"))
        ticks = [
            one.at_s
            for one in samples[max(died - 1, 0) : first + TICKS_TO_SHOW]
            if one.at_s <= found[0].at_s
        ]
        gap_s = max((later - sooner for sooner, later in pairwise(ticks)), default=0.0)
        return Loss(death, on_lost, told_s, found[0].at_s, gap_s)

    def _shows(self, sample: Sample, on_lost: str, dead_pid: int, since_s: float) -> bool:
        """True if the jaws do what was wished, or what somebody has asked for since."""
        motion = None if sample.job is None else self.motions.get(sample.job)
        if motion is not None:
            return motion.pid != dead_pid or not motion.is_lost_with_its_client
        if any(since_s <= settled_s <= sample.at_s for settled_s in self._settled_s):
            return True
        if on_lost == "hold" or not sample.commanded or sample.mode in UNPOWERED:
            return True
        return on_lost == "relax" and sample.mode == "relaxed"


def _was(span: Tenure | Motion, at_s: float) -> bool:
    return span.began_s <= at_s and (span.ended_s is None or at_s < span.ended_s)


def _without(data: dict[str, Any], name: str) -> dict[str, Any]:
    return {key: value for key, value in data.items() if key != name}
