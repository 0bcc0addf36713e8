"""A small crowd at one daemon, as `python -m bench.crowd` lets a great one loose; and its audit."""

from typing import Any

import pytest

from bench.crowd.audit import Audit, Death, Sample
from bench.crowd.run import survive
from tests.process.daemon_process import DaemonProcess

CLIENTS = 12
SECONDS = 4.0
CROWDS = 8
OWNER = {"client": 3, "pid": 33}
OTHER = {"client": 4, "pid": 44}


@pytest.mark.alone
@pytest.mark.local_only("it knows its clients by the pids that the daemon sees")
def test_a_crowd_that_hangs_and_dies_leaves_the_daemon_as_it_was(simulated: DaemonProcess) -> None:
    """Chance decides what a crowd does: so crowds come until each kind of thing has happened."""
    simulated.connect().close()
    path, pid = simulated.socket_path, simulated.process.pid
    missing = {"motions", "tenures", "losses", "deaths", "stops"}
    for seed in range(1, CROWDS + 1):
        outcome = survive(path, pid, CLIENTS, SECONDS, seed)
        assert outcome.complaints == []
        assert outcome.descriptors[0] == outcome.descriptors[1]
        happened = {
            "motions": outcome.audit.motions,
            "tenures": outcome.audit.tenures,
            "losses": outcome.losses,
            "deaths": outcome.deaths > CLIENTS,
            "stops": outcome.stops,
        }
        missing -= {kind for kind, what in happened.items() if what}
        if not missing:
            break
    assert missing == set()
    assert "Traceback" not in simulated.log


class Told:
    """An audit of events that a test makes up, a second apart."""

    def __init__(self) -> None:
        self.audit = Audit()
        self.now_s = 0.0

    def tell(self, kind: str, /, **data: Any) -> "Told":
        self.now_s += 1.0
        event = {"seq": int(self.now_s), "monotonic_s": self.now_s, "kind": kind, "data": data}
        self.audit.take(event)
        return self

    def begin(self, job: int, owner: dict[str, int]) -> "Told":
        return self.tell("job_started", job=job, kind="open", detached=False, **owner)

    def end(self, job: int, reason: str | None = None) -> "Told":
        state = "done" if reason is None else "cancelled"
        return self.tell("job_ended", job=job, state=state, reason=reason)

    def grant(self, owner: dict[str, int]) -> "Told":
        return self.tell("lease", lease=1, held=True, **owner)

    def lose(self, owner: dict[str, int], on_lost: str) -> "Told":
        self.tell("lease_lost", cause="connection", why=None, **owner)
        return self.tell("client_lost", on_lost=on_lost)

    def complaint(self) -> str:
        """Return the one thing that is wrong when all is judged."""
        assert self.audit.judge((), ()) == []
        (complaint,) = self.audit.complaints
        return complaint


def test_motions_after_one_another_are_as_they_must_be() -> None:
    told = Told().begin(1, OWNER).end(1).grant(OTHER).begin(2, OTHER).end(2).end(3, "stopped")
    assert told.audit.judge((), ()) == []
    assert told.audit.complaints == []


@pytest.mark.parametrize(
    ("told", "complaint"),
    [
        (Told().begin(1, OWNER), "did not end"),
        (Told().begin(1, OWNER).begin(2, OTHER).end(2).begin(1, OWNER).end(1), "began while"),
        (Told().begin(1, OWNER).end(1).begin(1, OTHER).end(1), "began twice"),
        (Told().begin(1, OWNER).end(1).end(1), "ended while None ran"),
        (Told().begin(1, OWNER).end(1, "internal_error"), "internal_error"),
        (Told().tell("refused", reason="internal_error"), "internal_error"),
        (Told().grant(OTHER).begin(1, OWNER).end(1), "under the lease of another"),
        (Told().grant(OTHER).grant(OWNER), "got the lease of"),
        (Told().grant(OTHER).lose(OWNER, "hold"), "lost the lease of"),
    ],
)
def test_an_audit_finds_what_must_not_be(told: Told, complaint: str) -> None:
    told.audit.judge((), ())
    assert any(complaint in found for found in told.audit.complaints), told.audit.complaints


def test_an_event_that_is_left_out_is_missed() -> None:
    told = Told().grant(OTHER)
    told.now_s += 1.0
    told.tell("lease", lease=1, held=False, **OTHER)
    assert told.complaint() == "event 3 follows on 1"


def test_a_lease_that_outlives_its_holder_is_found() -> None:
    audit = Told().grant(OWNER).audit
    assert audit.judge((), [Death(OWNER["pid"], 1.5, 1.6)]) == []
    assert "outlived its holder" in audit.complaints[0]


def test_who_had_nothing_loses_nothing() -> None:
    audit = Told().grant(OWNER).lose(OWNER, "hold").audit
    assert audit.judge((), [Death(OTHER["pid"], 1.5, 1.6), Death(OWNER["pid"], 2.5, 2.6)]) == []
    assert audit.complaints == []


@pytest.mark.parametrize(
    ("on_lost", "mode", "commanded", "is_in_force"),
    [
        ("hold", "holding", True, True),
        ("relax", "relaxed", True, True),
        ("relax", "disabled", False, True),
        ("relax", "enabling", False, True),
        ("relax", "holding", True, False),
        ("disable", "disabling", False, True),
        ("disable", "holding", False, True),
        ("disable", "holding", True, False),
        ("disable", "relaxed", True, False),
    ],
)
def test_what_a_lost_lease_leaves_must_be_what_was_wished(
    on_lost: str, mode: str, commanded: bool, is_in_force: bool
) -> None:
    told = Told().grant(OWNER).begin(1, OWNER).end(1, "client_lost").lose(OWNER, on_lost)
    samples = [Sample(tick, 3.9 + tick / 10, mode, None, commanded) for tick in range(5)]
    losses = told.audit.judge(samples, [Death(OWNER["pid"], 2.5, 2.6)])
    if is_in_force:
        (loss,) = losses
        assert told.audit.complaints == []
        assert loss.on_lost == on_lost
        assert (loss.told_s, loss.in_force_s) == (4.0, 4.0)
    else:
        assert losses == []
        assert "did not come into force" in told.audit.complaints[0]


def test_a_motion_that_goes_on_after_its_owner_is_found() -> None:
    told = Told().begin(1, OWNER).end(1, "client_lost").begin(2, OWNER).end(2)
    samples = [Sample(tick, 2.0 + tick / 10, "moving", 2, True) for tick in range(3)]
    assert told.audit.judge(samples, [Death(OWNER["pid"], 1.5, 1.6)]) == []
    assert "did not come into force" in told.audit.complaints[0]


def test_what_a_lost_lease_leaves_waits_for_a_motion_of_another() -> None:
    told = Told().begin(1, OTHER).grant(OWNER).lose(OWNER, "relax").end(1)
    told.audit.complaints.clear()
    samples = [Sample(1, 3.5, "moving", 1, True), Sample(2, 5.1, "relaxed", None, True)]
    (loss,) = told.audit.judge(samples, [Death(OWNER["pid"], 2.5, 2.6)])
    assert loss.in_force_s is None
    assert told.audit.complaints == []


def test_what_somebody_asks_for_after_the_loss_may_show_in_its_place() -> None:
    told = Told().grant(OWNER).lose(OWNER, "relax").end(1)
    samples = [
        Sample(tick, at_s, "holding", None, True) for tick, at_s in enumerate((1.9, 4.1, 4.2))
    ]
    (loss,) = told.audit.judge(samples, [Death(OWNER["pid"], 1.5, 1.6)])
    assert loss.in_force_s is not None
    assert told.audit.complaints == []


def test_a_tick_that_was_not_seen_is_not_judged() -> None:
    told = Told().grant(OWNER).lose(OWNER, "relax")
    samples = [Sample(1, 1.9, "holding", None, True), Sample(3, 2.1, "holding", None, True)]
    (loss,) = told.audit.judge(samples, [Death(OWNER["pid"], 1.5, 1.6)])
    assert loss.in_force_s is None
    assert told.audit.unseen == 1
    assert told.audit.complaints == []
