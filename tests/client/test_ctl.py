"""What litegripctl shows with the time of day, and of an older daemon."""

import json
import time

import pytest

from litegrip_client.ctl import state_view
from litegrip_client.values.results import STATE_FIELDS
from litegripd.model.sentence import sentence, terms_of
from tests.client.fake_daemon import HELLO, STATE, FakeDaemon, Request
from tests.client.helpers import Ctl

ENDED = {
    "job": 5,
    "kind": "move",
    "state": "done",
    "owner": {"client": 1, "pid": 77, "uid": 0, "program": "pick.py"},
    "detached": True,
    "started_s": 1000.0,
    "ended_s": 1002.25,
    "phase": None,
    "error": None,
    "result": {"job": 5, "ok": False, "outcome": "blocked", "target_rad": 0.123456, "state": STATE},
}
REFUSED = sentence("the motor is not enabled: call {motor.enable} first")
FAILED = {
    **ENDED,
    "job": 6,
    "state": "failed",
    "detached": False,
    "error": {
        "code": -32030,
        "message": REFUSED,
        "data": {
            "reason": "not_enabled",
            "retryable": False,
            "terms": terms_of({"message": REFUSED}),
        },
    },
    "result": None,
}
AT_NOON_S = 43_200.0
"""Unix time, which is noon in UTC, when the daemon's clock shows 1000 s."""


@pytest.fixture
def noon(daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    monkeypatch.setattr("litegrip_client.ctl.render.time", lambda: AT_NOON_S)
    daemon.handlers["hello"] = lambda request: {**HELLO, "monotonic_s": 1000.0}


@pytest.mark.usefixtures("noon")
def test_jobs_are_shown_with_the_time_of_day_and_how_they_ended(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    daemon.handlers["job.list"] = lambda request: {"jobs": [ENDED, FAILED]}
    _, out, _ = ctl("jobs")
    assert out.splitlines()[1:] == [
        "5    move  12:00:00  2.2 s  NOT ok: blocked      pick.py (pid 77)",
        "6    move  12:00:00  2.2 s  failed: not enabled  pick.py (pid 77)",
    ]


@pytest.mark.usefixtures("noon")
def test_a_job_is_shown_whole(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["job.get"] = lambda request: ENDED if request.params["job"] == 5 else FAILED
    code, out, _ = ctl("job", "5")
    assert code == 0
    assert out.splitlines() == [
        "job         5, move",
        "outcome     NOT ok: blocked",
        "began       12:00:00",
        "ended       12:00:02",
        "took        2.2 s",
        "owner       pick.py (pid 77), detached",
        "target_rad  0.1235",
    ]
    _, out, _ = ctl("job", "6")
    assert "outcome  failed: not enabled\n" in out
    assert "why      the motor is not enabled: call litegripctl enable first\n" in out
    _, out, _ = ctl("job", "6", "--json")
    assert json.loads(out) == FAILED


@pytest.mark.usefixtures("noon")
def test_events_are_shown_and_followed(daemon: FakeDaemon, ctl: Ctl) -> None:
    event = {"seq": 7, "monotonic_s": 1060.0, "kind": "motor", "message": "x\x1b[2J", "data": {}}
    subscribed = {"subscription": 1, "state": STATE, "events": [event]}
    daemon.handlers["events.subscribe"] = lambda request: subscribed
    daemon.handlers["events.unsubscribe"] = lambda request: {"subscription": 1}
    assert ctl("events", "--kind", "motor") == (0, "12:01:00  x?[2J\n", "")
    assert daemon.wait_for("events.subscribe")[0].params == {"kinds": ["motor"]}
    _, out, _ = ctl("events", "--json")
    assert json.loads(out) == event

    def follow(request: Request) -> None:
        request.reply(subscribed)
        request.notify("event", {**event, "seq": 8, "subscription": 1})
        request.hang_up()

    daemon.handlers["events.subscribe"] = follow
    code, out, err = ctl("events", "-f")
    assert (code, out) == (3, "12:01:00  x?[2J\n" * 2)
    assert "connection" in err


def test_a_state_of_an_older_daemon_is_shown_without_what_it_does_not_tell(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    new = ("requested_rad", "command_torque_nm", "requested_torque_nm", "force_set_n", "is_grasped")
    old = {name: value for name, value in STATE.items() if name not in new}
    daemon.handlers["state.get"] = lambda request: old
    lines = ctl("state")[1].splitlines()
    assert lines[3] == "command      +0.2600 rad"
    assert not [line for line in lines if line.startswith(("squeezing", "requested"))]


def test_only_fields_of_a_state_have_a_line_of_their_own() -> None:
    assert set(STATE_FIELDS) >= state_view._TOLD
