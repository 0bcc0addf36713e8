"""What litegripctl shows of a teleoperation."""

import re
from typing import Any

import pytest

from litegrip_client.ctl.commands.teleop import status_line, status_text
from tests.client.helpers import Ctl
from tests.client.rig import Heard
from tests.world import World

STATUS: dict[str, Any] = {
    **World().client().result("teleop.status"),
    "active": True,
    "mode": "slave",
    "phase": "following",
    "topic": "litearm/v4/gripA/gripper_teleop",
    "link": "zenoh",
    "host": "10.0.0.20",
    "port": 17448,
    "link_state": "open",
    "frames": 1234,
    "last_frame_age_ms": 3.2,
    "openness": 0.5,
    "position_mm": 60.1,
    "force_n": 2.0,
    "loop_hz": 200.0,
    "ready": True,
    "torque_nm": 0.2,
    "job": 3,
}
"""That of a follower which has heard its leader; else as of a daemon that follows nobody."""


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


def test_the_cause_stands_where_a_narrow_terminal_still_shows_it() -> None:
    why = "10.0.0.20:17448 does not answer: it is off (for 4 s)"
    line = status_line({**STATUS, "frames": 0, "phase": "waiting", "link_unreached": why})
    assert line.startswith(f"slave waiting    not reached: {why}  nothing heard from ")


REFUSED = "10.0.0.20:17448 has refused the connection: nobody listens at that port"


def test_the_live_line_is_no_wider_than_the_terminal(
    heard: Heard, on_a_terminal: Ctl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "60")
    waiting = {**STATUS, "frames": 0, "phase": "waiting", "link_unreached": f"{REFUSED} (for 4 s)"}
    answers(heard, waiting, {**STATUS, "active": False})
    _, shown, _ = on_a_terminal("teleop", "slave", "--host", "10.0.0.20")
    (line,) = re.findall(r"\r(.+?)\x1b\[K", shown)
    assert line == f"slave waiting    not reached: {REFUSED}"[:58] + "…"


def test_in_a_pipe_each_change_of_the_link_is_a_line(heard: Heard, litegripctl: Ctl) -> None:
    waiting = {**STATUS, "frames": 0, "phase": "waiting", "link_reach": "connecting"}
    refused = [{**waiting, "link_unreached": f"{REFUSED} (for {n} s)"} for n in (1, 2, 3)]
    heard_of = {**STATUS, "link_reach": "frames"}
    later = {**heard_of, "frames": 1300, "last_frame_age_ms": 4.0}
    shown = []
    for as_json in ([], ["--json"]):
        answers(heard, waiting, *refused, heard_of, later, {**STATUS, "active": False})
        shown.append(litegripctl(*as_json, "teleop", "slave", "--host", "10.0.0.20")[1])
    first, second, third, last = shown[0].splitlines()
    assert first.startswith("slave waiting    nothing heard")
    assert second.startswith(f"slave waiting    not reached: {REFUSED} (for 1 s)")
    assert third == status_line(heard_of)
    assert last.startswith("slave ended")
    assert shown[1].count("\n") == 1


def answers(heard: Heard, *statuses: dict[str, Any]) -> None:
    """The daemon begins a teleoperation, and tells of it in turn."""
    left = iter(statuses)
    heard.instead["teleop.start"] = statuses[0]
    heard.instead["teleop.status"] = lambda _request: next(left)


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
