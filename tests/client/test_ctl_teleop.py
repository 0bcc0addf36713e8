"""Teleoperation by litegripctl: its options, its live line, and its end."""

import json
from typing import Any

import pytest

from litegrip_client.ctl.commands.teleop import status_line, status_text
from litegrip_client.ctl.main import main
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.helpers import Ctl, interrupt_main_thread

STATUS: dict[str, Any] = {
    "active": True,
    "mode": "slave",
    "phase": "following",
    "topic": "litearm/v4/gripA/gripper_teleop",
    "link": "zenoh",
    "host": "10.0.0.20",
    "port": 17448,
    "link_state": "open",
    "link_error": None,
    "matching": None,
    "frames": 1234,
    "last_frame_age_ms": 3.2,
    "stale": False,
    "openness": 0.5,
    "position_mm": 60.1,
    "force_n": 2.0,
    "dq_cmd": 0.0,
    "loop_hz": 200.0,
    "rejected": 0,
    "out_of_order": 0,
    "other_leaders": 0,
    "dropped": 0,
    "send_failed": 0,
    "fault": "",
    "ready": True,
    "ready_rx": 0,
    "ready_pubs": 14,
    "ready_timed_out": False,
    "torque_nm": 0.2,
    "over_torque": False,
    "torque_trips": 0,
    "force_limited": False,
    "reflects": False,
    "reflected_n": None,
    "followers": None,
    "round_trip_ms": None,
    "late": 0,
    "link_protected": None,
    "job": 3,
}
ENDED = {**STATUS, "active": False}
GUARDS = ("sent_s", "stop_generation")


@pytest.fixture
def started(daemon: FakeDaemon) -> list[dict[str, Any]]:
    started: list[dict[str, Any]] = []

    def start(request: Request) -> dict[str, Any]:
        started.append({key: val for key, val in request.params.items() if key not in GUARDS})
        return STATUS

    daemon.handlers["teleop.start"] = start
    daemon.handlers["teleop.status"] = lambda _request: ENDED
    daemon.handlers["teleop.stop"] = lambda _request: ENDED
    return started


@pytest.mark.parametrize(
    ("arguments", "params"),
    [
        (("master",), {"mode": "master"}),
        (("master", "--rate", "50"), {"mode": "master", "rate_hz": 50.0}),
        (("slave", "--host", "b"), {"mode": "slave", "host": "b"}),
        (("slave", "--host", "b", "--reflect"), {"mode": "slave", "host": "b", "reflect": True}),
        (
            ("master", "--reflect-force", "4", "--reflect-gain", "0.3"),
            {"mode": "master", "reflect_n": 4.0, "reflect_gain": 0.3},
        ),
        (
            ("master", "--link", "udp", "--host", "a,b:5"),
            {"mode": "master", "link": "udp", "host": "a,b:5"},
        ),
        (
            ("slave", "--fake-leader", "--torque-limit", "1.0"),
            {"mode": "slave", "fake_leader": True, "torque_limit_nm": 1.0},
        ),
        (
            ("slave", "--link", "udp", "--port", "9", "--grip-id", "x", "--force-limit", "8"),
            {"mode": "slave", "link": "udp", "port": 9, "grip_id": "x", "force_limit_n": 8.0},
        ),
        (
            ("master", "--no-require-ready", "--ready-timeout", "0"),
            {"mode": "master", "require_ready": False, "ready_timeout_s": 0.0},
        ),
        (
            ("slave", "--host", "b", "--align-speed", "20", "--lead-cap", "0.5"),
            {"mode": "slave", "host": "b", "align_speed_mm_s": 20.0, "lead_cap_mm": 0.5},
        ),
        (
            ("slave", "--host", "b", "--watchdog", "0.1"),
            {"mode": "slave", "host": "b", "watchdog_s": 0.1},
        ),
    ],
)
def test_options_become_parameters(
    ctl: Ctl, started: list[dict[str, Any]], arguments: tuple[str, ...], params: dict[str, Any]
) -> None:
    assert ctl("teleop", *arguments, "--detach")[0] == 0
    assert started == [{**params, "detach": True}]


@pytest.mark.parametrize(
    "arguments",
    [(), ("lead",), ("slave", "--fake-leader", "--host", "b"), ("master", "--torque-limit", "1")],
)
def test_wrong_usage_is_told(
    ctl: Ctl, started: list[dict[str, Any]], arguments: tuple[str, ...]
) -> None:
    assert ctl("teleop", *arguments)[0] == 2
    assert started == []


def test_detached_it_returns_at_once(ctl: Ctl, started: list[dict[str, Any]]) -> None:
    code, out, _ = ctl("teleop", "slave", "--host", "b", "--detach")
    assert (code, out) == (0, "slave: it runs; end it with: litegripctl teleop stop\n")


@pytest.mark.parametrize(
    ("link_state", "code", "told"),
    [
        ("open", 0, "slave: it runs; end it with: litegripctl teleop stop\n"),
        ("failed", 1, "slave: ended, the link has failed: port 17448 is in use\n"),
    ],
)
def test_detached_it_returns_when_the_link_is_open_or_has_failed(
    daemon: FakeDaemon, ctl: Ctl, link_state: str, code: int, told: str
) -> None:
    opening = {**STATUS, "link_state": "opening"}
    later = {**STATUS, "link_state": link_state, "link_error": "port 17448 is in use"}
    looks = iter((opening, later))
    stops: list[int] = []

    def stop(_request: Request) -> dict[str, Any]:
        stops.append(1)
        return ENDED

    daemon.handlers["teleop.start"] = lambda _request: opening
    daemon.handlers["teleop.status"] = lambda _request: next(looks)
    daemon.handlers["teleop.stop"] = stop
    ended, out, said = ctl("teleop", "slave", "--host", "b", "--detach")
    assert (ended, out) == (code, told)
    assert ("the link has failed, and nothing runs: port 17448 is in use" in said) is bool(code)
    assert len(stops) == code


def test_detached_it_tells_why_its_leader_is_not_reached(daemon: FakeDaemon, ctl: Ctl) -> None:
    started = {**STATUS, "link_state": "open", "link_reach": "resolving", "link_unreached": None}
    why = "the name b does not resolve: unknown (for 0 s)"
    looks = iter((started, {**started, "link_unreached": why}))
    daemon.handlers["teleop.start"] = lambda _request: started
    daemon.handlers["teleop.status"] = lambda _request: next(looks)
    assert ctl("teleop", "slave", "--host", "b", "--detach")[:2] == (
        0,
        (
            f"slave: it runs, but its leader is not reached: {why}; end it with: litegripctl teleop"
            " stop\n"
        ),
    )


@pytest.mark.parametrize(
    ("reach", "said"),
    [
        ("resolving", "zenoh resolving"),
        ("connecting", "zenoh connecting"),
        ("connected", "zenoh connected, no frame yet"),
        ("frames", "zenoh connected, frames come"),
        ("bound", "zenoh bound, no frame comes"),
        ("sending", "zenoh sending"),
        (None, "zenoh open"),
    ],
)
def test_the_status_says_how_far_the_link_has_come(reach: str | None, said: str) -> None:
    why = "b:1 has refused the connection (for 4 s)" if reach == "connecting" else None
    text = status_text({**STATUS, "link_state": "open", "link_reach": reach, "link_unreached": why})
    (line,) = [line for line in text.splitlines() if line.startswith("link ")]
    assert line.startswith(f"link              {said}, ")
    assert (f"not reached: {why}" in text) is (why is not None)


def test_a_master_that_is_refused_names_a_follower(daemon: FakeDaemon, ctl: Ctl) -> None:
    why = "b:1 refuses what is sent: nobody listens at that port (for 2 s)"
    leads = {**STATUS, "mode": "master", "link": "udp", "link_state": "open"}
    daemon.handlers["teleop.start"] = lambda _request: {
        **leads,
        "link_reach": "sending",
        "link_unreached": why,
    }
    _code, out, _said = ctl("teleop", "master", "--link", "udp", "--host", "b", "--detach")
    assert f"master: it runs, but a follower is not reached: {why}" in out


def test_detached_it_tells_of_an_end_while_the_link_opened(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["teleop.start"] = lambda _request: {**STATUS, "link_state": "opening"}
    daemon.handlers["teleop.status"] = lambda _request: {**ENDED, "fault": "driver_hot"}
    code, out, _ = ctl("teleop", "slave", "--host", "b", "--detach")
    assert code == 1
    assert "ended by          driver_hot" in out


def test_it_is_watched_until_it_ends_by_itself(
    daemon: FakeDaemon, ctl: Ctl, started: list[dict[str, Any]]
) -> None:
    looked: list[int] = []

    def status(_request: Request) -> dict[str, Any]:
        looked.append(1)
        return STATUS if len(looked) < 3 else {**ENDED, "fault": "driver_hot"}

    daemon.handlers["teleop.status"] = status
    code, out, _ = ctl("teleop", "slave", "--host", "b")
    assert code == 1
    assert out == "slave ended by driver_hot after 1234 frames\n"
    assert started == [{"mode": "slave", "host": "b"}]


def test_ctrl_c_ends_it_and_is_a_good_end(
    daemon: FakeDaemon, ctl: Ctl, started: list[dict[str, Any]]
) -> None:
    stops: list[int] = []

    def stop(_request: Request) -> dict[str, Any]:
        stops.append(1)
        return ENDED

    def status(_request: Request) -> dict[str, Any]:
        interrupt_main_thread()
        return STATUS

    daemon.handlers["teleop.status"] = status
    daemon.handlers["teleop.stop"] = stop
    code, out, _ = ctl("teleop", "slave", "--host", "b")
    assert code == 0
    assert out == "slave ended after 1234 frames; the jaws hold\n"
    assert stops == [1]


def test_a_refusal_has_its_own_hint(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["teleop.start"] = lambda request: request.fail("teleop_busy", -32050, "runs")
    code, _, err = ctl("teleop", "master")
    assert code == 6
    assert "litegripctl teleop stop" in err


def test_status_and_stop(ctl: Ctl, started: list[dict[str, Any]]) -> None:
    code, out, _ = ctl("teleop", "status")
    assert code == 0
    assert "60.10 mm, 50.0 % open" in out
    assert "1234, the last 3 ms ago" in out
    assert ctl("teleop", "stop") == (0, "slave ended after 1234 frames\n", "")
    code, out, _ = ctl("--json", "teleop", "status")
    assert json.loads(out) == ENDED


def test_what_went_wrong_on_the_way_is_told_at_the_end(
    daemon: FakeDaemon, ctl: Ctl, started: list[dict[str, Any]]
) -> None:
    daemon.handlers["teleop.stop"] = lambda _request: {**ENDED, "stale": True, "torque_trips": 2}
    assert ctl("teleop", "stop")[1] == "slave ended after 1234 frames, torque_trips 2\n"


def test_whose_a_figure_is_stands_before_it() -> None:
    rows = [line.split("  ")[0] for line in status_text(STATUS).splitlines()]
    assert [row for row in rows if "'s" in row or "own" in row] == [
        "leader's opening",
        "leader's force",
        "own torque",
    ]
    leads = status_text({**STATUS, "mode": "master", "phase": "leading"})
    rows = [line.split("  ")[0] for line in leads.splitlines()]
    assert {"opening", "force", "torque"} <= set(rows)


@pytest.mark.parametrize(
    ("followers", "matching", "told"),
    [
        (2, True, "2 heard"),
        (None, True, "at least one"),
        (None, False, "none"),
        (None, None, "not known: they are not heard"),
    ],
)
def test_a_leader_tells_of_its_followers_what_it_knows(
    followers: int | None, matching: bool | None, told: str
) -> None:
    leads = {**STATUS, "mode": "master", "followers": followers, "matching": matching}
    assert f"followers         {told}" in status_text(leads).splitlines()
    assert "followers" not in status_text(STATUS)
    assert "followers" not in status_text({**leads, "active": False})


def test_no_teleoperation_so_far(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["teleop.status"] = lambda _request: {"active": False, "mode": None}
    assert ctl("teleop", "status")[1] == "no teleoperation so far\n"
    daemon.handlers["teleop.stop"] = daemon.handlers["teleop.status"]
    assert ctl("teleop", "stop")[1] == "no teleoperation so far\n"


def test_the_live_line_says_what_matters() -> None:
    line = status_line(STATUS)
    words = line.split()
    assert words[:7] == ["slave", "following", "leader's", "50.0", "%", "60.10", "mm"]
    assert words[7:] == ["own", "+0.20", "N·m", "200", "Hz", "frames", "1234"]
    master = {**STATUS, "mode": "master", "phase": "leading", "matching": True}
    assert status_line(master).split()[:4] == ["master", "leading", "50.0", "%"]
    bad = {**STATUS, "stale": True, "over_torque": True, "torque_trips": 2, "rejected": 5}
    shown = status_line(bad)
    for note in ("STALE 3 ms", "RELEASED", "torque_trips 2", "rejected 5"):
        assert note in shown
    alone = {**STATUS, "mode": "master", "phase": "leading", "matching": False}
    assert "nobody follows" in status_line(alone)
    broken = {**STATUS, "link_state": "failed", "link_error": "port\x1b taken"}
    assert "link failed: port? taken" in status_line(broken)


def test_reflection_and_limits_are_shown_where_there_are_any() -> None:
    slave = {**STATUS, "reflected_n": 7.25, "force_limited": True}
    assert "reflects +7.2 N " in status_line(slave)
    assert "force limited" in status_line(slave)
    master = {**slave, "mode": "master", "followers": 0, "round_trip_ms": 12.4, "late": 3}
    shown = status_line(master)
    for note in ("reflects +7.2 N (12 ms round)", "nobody sends a force", "late 3"):
        assert note in shown
    assert "felt              reflects +7.2 N" in status_text(slave)
    for protected, told in ((True, False), (None, False), (False, True)):
        text = status_text({**STATUS, "link_protected": protected})
        assert ("open to" in text) is told


@pytest.mark.parametrize(
    ("host", "port", "where", "leader"),
    [
        ("10.0.0.20", 17448, "zenoh open, 10.0.0.20:17448\n", "10.0.0.20:17448"),
        ("fe80::1", 5, "zenoh open, [fe80::1]:5\n", "[fe80::1]:5"),
        (None, 5, "zenoh open, port 5\n", "a leader at port 5"),
        (None, None, "zenoh open\n", "a leader"),
    ],
)
def test_a_leader_that_was_not_heard_yet_is_no_good_link(
    host: str | None, port: int | None, where: str, leader: str
) -> None:
    waiting = {**STATUS, "host": host, "port": port, "frames": 0, "phase": "waiting"}
    told = f"nothing heard from {leader} yet"
    text = status_text(waiting)
    assert f"link              {where}" in text
    assert told in text
    assert told in status_line(waiting)
    for other in ({**waiting, "frames": 1}, {**waiting, "mode": "master"}):
        assert "nothing heard" not in status_text(other)


def test_what_is_not_known_is_shown_as_such() -> None:
    first = {**STATUS, "openness": None, "position_mm": None, "torque_nm": None, "force_n": None}
    assert "--" in status_line(first)
    assert "-- mm, -- open" in status_text({**first, "last_frame_age_ms": None})


def test_help_shows_examples(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit):
        main(["teleop", "--help"])
    assert "--fake-leader --torque-limit 1.0" in capsys.readouterr().out
