"""Every command of litegripctl: what it asks, what it shows, how it ends."""

import json
import time
from typing import Any

import pytest

from litegrip_client.ctl import state_view
from litegrip_client.ctl.state_view import state_line
from litegrip_client.values.results import STATE_FIELDS
from litegripd.model.sentence import sentence, terms_of, with_terms
from tests.client.fake_daemon import HELLO, MOVE, STATE, FakeDaemon, Request
from tests.client.helpers import Ctl

JOBS = {
    "jobs": [
        {
            "job": 4,
            "kind": "open",
            "state": "running",
            "phase": "travel",
            "owner": {"program": "pick.py\x1b[2J", "pid": 77},
        },
        {"job": 3, "kind": "close", "state": "done", "phase": None, "owner": None},
    ]
}
JOBS_SHOWN = """\
JOB  KIND   BEGAN  TOOK  OUTCOME          OWNER
4    open   --     -- s  running, travel  pick.py?[2J (pid 77)
3    close  --     -- s  done             unknown (pid None)
"""
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
HEALTH = {"verdict": "ok", "control": {"late_us": {"p99": 120}}, "bus": {"errors": []}}
DOCUMENT = {"openrpc": "1.2.6", "methods": [{"name": "stop", "summary": "Stop."}]}
STOP = {"level": "relax", "generation": 4, "state": STATE}

SHOWN: list[tuple[list[str], str, Any, str]] = [
    (["enable"], "motor.enable", {"ok": True, "tries": 1, "state": STATE}, "enabled\n"),
    (["disable"], "motor.disable", {"ok": True, "state": STATE}, "disabled\n"),
    (
        ["clear-fault"],
        "motor.clear_fault",
        {"ok": True, "cleared": "over_voltage", "state": STATE},
        "cleared: over_voltage; it is disabled\n",
    ),
    (
        ["clear-fault"],
        "motor.clear_fault",
        {"ok": True, "cleared": None, "state": STATE},
        "the motor had no fault; it is disabled\n",
    ),
    (["open"], "motion.open", MOVE, "open: pressed, at 35.25 mm\n"),
    (["close"], "motion.close", MOVE, "close: pressed, at 35.25 mm\n"),
    (["open", "--no-wait"], "motion.open", {"job": 6}, "open: job 6 started\n"),
    (["hold"], "motion.hold", {"state": STATE}, "holding at 35.25 mm\n"),
    (["stop"], "stop", STOP, "stopped: relax, until: litegripctl clear\n"),
    (["clear"], "stop.clear", {"generation": 5, "state": STATE}, "cleared: motions are allowed\n"),
    (
        ["jobs"],
        "job.list",
        JOBS,
        JOBS_SHOWN,
    ),
    (["jobs"], "job.list", {"jobs": []}, "no jobs\n"),
    (
        ["restart", "--hold"],
        "daemon.restart",
        {"pid": 78, "gap_s": 0.005},
        "restarted: pid 78 has taken over, the jaws are held (no command for 5.0 ms)\n",
    ),
    (
        ["cancel", "4"],
        "job.cancel",
        {"job": 4, "state": "cancelled"},
        "job 4 cancelled, the jaws hold\n",
    ),
    (
        ["health"],
        "health",
        HEALTH,
        "verdict: ok\n\ncontrol.late_us.p99  120\nbus.errors           --\n",
    ),
    (["info"], "info.get", {"version": "1", "x": [1]}, "version  1\nx[0]     1\n"),
    (["discover"], "rpc.discover", DOCUMENT, "stop  Stop.\n"),
    (["watch", "--count", "1"], "state.subscribe", {"subscription": 1, "state": STATE}, ""),
    (["state"], "state.get", STATE, ""),
]


@pytest.mark.parametrize(("arguments", "method", "result", "text"), SHOWN)
def test_what_is_shown(
    daemon: FakeDaemon, ctl: Ctl, arguments: list[str], method: str, result: Any, text: str
) -> None:
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 1}
    daemon.handlers[method] = lambda request: result
    code, out, err = ctl(*arguments)
    assert (code, err) == (0, "")
    assert out == text or (not text and "35.25 mm" in out)
    code, out, err = ctl(*arguments, "--json")
    assert (code, err) == (0, "")
    assert json.loads(out) == (result["state"] if method == "state.subscribe" else result)
    assert out.count("\n") == 1


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


@pytest.mark.parametrize(
    ("arguments", "method", "params"),
    [
        (["enable"], "motor.enable", {"detach": True}),
        (["enable", "--retries", "4"], "motor.enable", {"detach": True, "retries": 4}),
        (["disable"], "motor.disable", {"detach": True}),
        (["open"], "motion.open", {"detach": True, "progress": True}),
        (
            ["close", "--speed", "12.5"],
            "motion.close",
            {"detach": True, "progress": True, "speed_mm_s": 12.5},
        ),
        (["open", "--no-wait"], "motion.open", {"detach": True, "wait": False}),
        (["stop", "--level", "relax"], "stop", {"level": "relax"}),
        (["stop", "--why", "smoke"], "stop", {"level": "hold", "why": "smoke"}),
        (["clear"], "stop.clear", {}),
        (["cancel", "12"], "job.cancel", {"job": 12}),
        (["restart", "--hold"], "daemon.restart", {"hold_through_restart": True}),
        (["watch", "--hz", "50", "--count", "1"], "state.subscribe", {"hz": 50.0}),
    ],
)
def test_what_is_asked(
    daemon: FakeDaemon, ctl: Ctl, arguments: list[str], method: str, params: dict[str, Any]
) -> None:
    daemon.handlers[method] = lambda request: request.fail("internal_error", -32603)
    code, _, _ = ctl(*arguments)
    assert code == 70
    (request,) = daemon.wait_for(method)
    is_guarded = method.startswith("mot") or method == "stop.clear"
    guards = {"sent_s", "stop_generation"} if is_guarded else set()
    guards -= {"sent_s", "stop_generation"} if method == "motor.disable" else set()
    assert request.params.keys() == params.keys() | guards
    assert request.params.items() >= params.items()
    assert daemon.requests[0].params == {"client": "litegripctl"}


@pytest.mark.parametrize(
    ("arguments", "method", "result", "text"),
    [
        (
            ["enable"],
            "motor.enable",
            {"ok": False, "tries": 3, "state": STATE, "message": "no feedback"},
            "NOT enabled: no feedback (tries: 3)\n",
        ),
        (
            ["disable"],
            "motor.disable",
            {"ok": False, "state": STATE},
            "NOT disabled: the motor does not confirm it\n",
        ),
        (
            ["open"],
            "motion.open",
            {**MOVE, "ok": False, "outcome": "blocked"},
            "open: NOT ok: blocked, at 35.25 mm\n",
        ),
        (
            ["cancel", "3"],
            "job.cancel",
            {"job": 3, "state": "done"},
            "job 3 had ended already: done\n",
        ),
    ],
)
def test_what_ended_but_not_well_ends_with_1(
    daemon: FakeDaemon, ctl: Ctl, arguments: list[str], method: str, result: Any, text: str
) -> None:
    daemon.handlers[method] = lambda request: result
    assert ctl(*arguments) == (1, text, "")
    code, out, _ = ctl(*arguments, "--json")
    assert (code, json.loads(out)) == (1, result)


@pytest.mark.parametrize(("verdict", "code"), [("ok", 0), ("degraded", 1), ("down", 2)])
def test_health_ends_by_the_verdict(daemon: FakeDaemon, ctl: Ctl, verdict: str, code: int) -> None:
    health = {"verdict": verdict, "reasons": ["a\x1b[2J", "b"], "uptime_s": 1.5}
    daemon.handlers["health"] = lambda request: health
    shown = f"verdict: {verdict}\n- a?[2J\n- b\n\nuptime_s  1.5\n"
    assert ctl("health") == (code, shown, "")
    assert ctl("health", "--json")[0] == code
    daemon.handlers["health"] = lambda request: {"verdict": verdict, "reasons": []}
    assert ctl("health") == (code, f"verdict: {verdict}\n", "")


def test_a_state_in_full(daemon: FakeDaemon, ctl: Ctl) -> None:
    known: dict[str, Any] = {"command_torque_nm": 0.25, "force_set_n": None, "limited": []}
    daemon.handlers["state.get"] = lambda request: {**STATE, **known}
    assert ctl("state")[1].splitlines() == [
        "mode         holding (motor enabled, bus up)",
        "opening      35.25 mm, 50% open",
        "position     +0.2500 rad",
        "command      +0.2600 rad, +0.250 N·m",
        "velocity     +0.0000 rad/s",
        "torque       +0.500 N·m, force about +5.0 N",
        "temperature  driver 31 °C, coil 33 °C",
        "status       enabled",
        "calibrated   yes, mount reverse",
        "age          0.002 s",
    ]


def test_a_stale_state_says_so_first_and_unknown_figures_are_no_numbers(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    unknown = dict.fromkeys(name for name, value in STATE.items() if isinstance(value, float))
    daemon.handlers["state.get"] = lambda request: {
        **STATE,
        **unknown,
        "stale": True,
        "age_s": 0.42,
        "limited": ["speed", "torque"],
        "requested_rad": 0.5,
        "requested_torque_nm": 2.0,
        "force_set_n": 20.0,
        "is_grasped": True,
        "job": {"job": 4, "kind": "open", "phase": "travel", "owner": {"program": "p", "pid": 1}},
        "stop": {"level": "hold", "by": {"program": "q", "pid": 2}, "why": "smoke"},
    }
    lines = ctl("state")[1].splitlines()
    assert lines[0] == "STALE, 0.4 s old: these are the last known figures"
    assert "opening      -- mm, -- open" in lines
    assert lines[-6:] == [
        "age          STALE, 0.4 s old",
        "squeezing    with 20.0 N, an object is held",
        "limited      speed, torque",
        "requested    +0.5000 rad, +2.000 N·m",
        "job          4 open, travel, by p (pid 1)",
        "stop         hold, by q (pid 2): smoke (clear it with: litegripctl clear)",
    ]


def test_of_a_motor_that_has_never_answered_no_figure_is_shown(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    silent = dict.fromkeys(name for name, value in STATE.items() if isinstance(value, float))
    unheard = {**STATE, **silent, "mode": "offline", "motor": "silent", "status": None}
    unheard |= {"stale": True, "feedback_s": None, "age_s": None}
    daemon.handlers["state.get"] = lambda request: unheard
    lines = ctl("state")[1].splitlines()
    assert lines == [
        "the motor has not answered yet: nothing is known of it",
        "mode         offline (motor silent, bus up)",
        "calibrated   yes, mount reverse",
        "age          no answer yet",
    ]
    watched(daemon)
    daemon.handlers["state.subscribe"] = lambda request: {"subscription": 1, "state": unheard}
    assert ctl("watch", "--count", "1")[1].endswith("no answer yet\n")


@pytest.mark.parametrize(
    ("clamp_n", "told", "shown"),
    [
        ([18.5, 21.5], {"loss_detection": True}, "18.5 to 21.5 N on the object"),
        ([0.0, 22.5], {"loss_detection": False}, "0.0 to 22.5 N on the object"),
        ([None, "x"], {"loss_detection": None}, "-- to -- N on the object"),
    ],
)
def test_what_is_held_is_shown_with_what_it_may_feel(
    daemon: FakeDaemon, ctl: Ctl, clamp_n: list[Any], told: dict[str, Any], shown: str
) -> None:
    held = {"force_set_n": 20.0, "is_grasped": True, "clamp_n": clamp_n}
    state = {**STATE, **held, **told, "loss_detection_from_n": 24.0}
    daemon.handlers["state.get"] = lambda request: state
    line = f"squeezing    with 20.0 N ({shown}), an object is held"
    if told["loss_detection"] is False:
        line += "; its loss would be noticed from 24.0 N on"
    assert line in ctl("state")[1].splitlines()


def test_what_presses_is_shown_in_whatever_mode(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["state.get"] = lambda request: {**STATE, "pressing_n": 9.43}
    assert "pressing     with about 9.4 N" in ctl("state")[1].splitlines()
    assert "pressing 9.4 N" in state_line({**STATE, "pressing_n": 9.43})
    assert "pressing" not in state_line(STATE)


def test_a_state_of_an_older_daemon_is_shown_without_what_it_does_not_tell(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    new = ("requested_rad", "command_torque_nm", "requested_torque_nm", "force_set_n", "is_grasped")
    old = {name: value for name, value in STATE.items() if name not in new}
    daemon.handlers["state.get"] = lambda request: old
    lines = ctl("state")[1].splitlines()
    assert lines[3] == "command      +0.2600 rad"
    assert not [line for line in lines if line.startswith(("squeezing", "requested"))]


def watched(daemon: FakeDaemon, *states: dict[str, Any]) -> None:
    def subscribe(request: Request) -> None:
        request.reply({"subscription": 1, "state": STATE})
        for seq, state in enumerate(states):
            sample = {"subscription": 1, "seq": seq, "dropped": 0, "monotonic_s": 1.0}
            request.notify("state.sample", {**sample, "state": state})

    daemon.handlers["state.subscribe"] = subscribe
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 1}


def test_a_field_that_has_no_line_of_its_own_is_shown_by_its_name(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    """So does one of a newer daemon's."""
    newer = {"gap_mm": 1.25, "sag_rad_s": 2, "is_wet": True, "tool": "pad\x1b", "other": None}
    daemon.handlers["state.get"] = lambda _: STATE | newer
    before = ctl("state")[1]
    daemon.handlers["state.get"] = lambda _: STATE
    lines = ctl("state")[1]
    assert before == lines + (
        "gap          1.25 mm\nsag          2 rad/s\nis wet       yes\ntool         pad?\n"
    )
    assert set(STATE_FIELDS) >= state_view._TOLD


def test_watch_on_a_pipe_is_a_line_for_each_state(daemon: FakeDaemon, ctl: Ctl) -> None:
    moving = {**STATE, "job": {"job": 4, "kind": "open"}, "stop": {"level": "hold"}}
    watched(daemon, moving, {**STATE, "stale": True, "age_s": 0.4})
    code, out, _ = ctl("watch", "--count", "3")
    assert code == 0
    assert out.splitlines() == [
        "holding      35.25 mm   +0.2500 rad   +0.500 N·m   33 °C",
        "holding      35.25 mm   +0.2500 rad   +0.500 N·m   33 °C  job 4 open  STOP hold",
        "holding      35.25 mm   +0.2500 rad   +0.500 N·m   33 °C  STALE, 0.4 s old",
    ]
    assert daemon.methods()[-1] == "state.unsubscribe"


def test_watch_as_json_is_an_object_for_each_state(daemon: FakeDaemon, ctl: Ctl) -> None:
    watched(daemon, {**STATE, "seq": 8})
    _, out, _ = ctl("watch", "--count", "2", "--json")
    assert [json.loads(line)["seq"] for line in out.splitlines()] == [7, 8]


def test_the_reasons_of_health_name_commands(daemon: FakeDaemon, ctl: Ctl) -> None:
    reasons = [sentence("look at it, then {motor.clear_fault}")]
    answer = with_terms({"verdict": "down", "reasons": reasons})
    daemon.handlers["health"] = lambda request: answer
    code, shown, _ = ctl("health")
    assert (code, shown) == (2, "verdict: down\n- look at it, then litegripctl clear-fault\n")
    assert json.loads(ctl("health", "--json")[1])["reasons"] == reasons


@pytest.mark.parametrize(
    ("state", "text"),
    [
        ({"motor": "fault", "mode": "fault", "enabled": False}, "nothing is held: the motor is fa"),
        (
            {"motor": "disabled", "mode": "disabled", "enabled": False},
            "held: the motor is disabled\n",
        ),
        ({"motor": "silent", "mode": "offline", "enabled": None}, "held: the motor is silent\n"),
        ({"mode": "relaxed"}, "taken over, the motor stays enabled, and slack (no command for 5"),
    ],
)
def test_a_restart_says_held_only_of_what_is_held(
    daemon: FakeDaemon, ctl: Ctl, state: dict[str, Any], text: str
) -> None:
    daemon.handlers["daemon.restart"] = lambda request: {"pid": 78, "gap_s": 0.005}
    daemon.handlers["state.get"] = lambda request: {**STATE, **state}
    code, shown, told = ctl("restart", "--hold")
    assert (code, told) == (0, "")
    assert text in shown
    assert "jaws are held" not in shown


def test_a_successor_that_does_not_answer_may_hold_or_not(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["daemon.restart"] = lambda request: {"pid": 78, "gap_s": 0.005}
    daemon.handlers["state.get"] = lambda request: request.hang_up()
    code, shown, told = ctl("restart", "--hold")
    assert (code, told) == (0, "")
    assert "pid 78 has taken over, but it is not known if the jaws are held: " in shown


def test_a_restart_that_lets_go_is_left_to_the_service_manager(
    daemon: FakeDaemon, ctl: Ctl
) -> None:
    daemon.handlers["hello"] = lambda request: {**HELLO, "channel": "can3"}
    code, shown, told = ctl("restart")
    assert (code, shown) == (2, "")
    assert "systemctl restart litegripd@can3" in told
    assert "daemon.restart" not in [request.method for request in daemon.requests]


def test_a_restart_of_another_machines_daemon_is_done_there(daemon: FakeDaemon, ctl: Ctl) -> None:
    remote = {"site": "lab", "channel": "can3"}
    daemon.handlers["hello"] = lambda request: {**HELLO, "channel": "lab.left", "remote": remote}
    code, _shown, told = ctl("restart")
    assert code == 2
    assert "on the gripper's machine: systemctl restart litegripd@can3" in told


@pytest.mark.parametrize(
    ("state", "now"),
    [
        ({"mode": "holding"}, "the jaws hold"),
        ({"mode": "relaxed"}, "the jaws are slack"),
        ({"mode": "moving"}, "another motion runs"),
        ({"mode": "offline"}, "the motor does not answer"),
        ({"mode": "disabled"}, "the motor is not enabled"),
        ({"mode": "fault"}, "the motor is not enabled"),
    ],
)
def test_cancel_says_what_the_jaws_do_and_no_more(
    daemon: FakeDaemon, ctl: Ctl, state: dict[str, str], now: str
) -> None:
    daemon.handlers["job.cancel"] = lambda request: {"job": 4, "state": "cancelled"}
    daemon.handlers["state.get"] = lambda request: {**STATE, **state}
    assert ctl("cancel", "4")[1] == f"job 4 cancelled, {now}\n"


def test_a_stop_that_reaches_nothing_says_so(daemon: FakeDaemon, ctl: Ctl) -> None:
    silent = {**STATE, "motor": "silent", "mode": "offline", "enabled": None}
    daemon.handlers["stop"] = lambda request: {"level": "disable", "state": silent}
    assert (
        "the motor does not answer, so nothing reaches it" in ctl("stop", "--level", "disable")[1]
    )
    daemon.handlers["stop.clear"] = lambda request: {"generation": 5, "state": silent}
    text = "cleared: motions are allowed, once the motor is enabled (it is silent)\n"
    assert ctl("clear")[1] == text
