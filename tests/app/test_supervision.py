"""What the service manager is told in which case, on a fake one: beat, status, begin and end."""

import contextlib
import os
import select
import socket
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

import pytest

from litegripd.app.systemd import FEEDBACK_WITHIN_S, Supervision
from litegripd.model.motor import BusCondition, MotorPhase
from tests.world import PERIOD_S, World


@dataclass
class Parts:
    """The parts that are looked at, and the manager's socket."""

    manager: socket.socket
    world: World = field(default_factory=World)
    verdict: tuple[str, list[str]] = ("ok", [])
    mode: str = "disabled"
    clients: int = 2
    is_open: bool = True
    lines_wait: bool = False
    requests: int = 0
    made: list[Supervision] = field(default_factory=list)

    def supervision(self, *, follows: bool = False) -> Supervision:
        facts = cast(Any, type("Facts", (), {"verdict": lambda _facts: self.verdict})())
        made = Supervision(
            self.world.machine, cast(Any, self), facts, lambda: self.mode, follows=follows
        )
        self.made.append(made)
        return made

    def told(self) -> list[str]:
        """Return what the manager has been told since the last call."""
        messages = []
        while select.select([self.manager], [], [], 0)[0]:
            messages.append(self.manager.recv(4096).decode())
        return messages

    def run(self, supervision: Supervision, seconds: float, *, failed: bool = False) -> list[str]:
        """Let time pass, tick by tick; return what the manager was told."""
        told = []
        for _ in range(round(seconds / PERIOD_S)):
            self.world.run(PERIOD_S)
            supervision.tick(self.world.now_s, failed=failed)
            told += self.told()  # at once: few datagrams wait at a socket
        return told


@pytest.fixture
def parts(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Parts]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        manager.setblocking(False)
        monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        monkeypatch.setenv("WATCHDOG_USEC", "2000000")
        monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
        parts = Parts(manager)
        parts.world.start()
        yield parts
        for supervision in parts.made:
            supervision.close()


def test_the_watchdog_is_fed_more_often_than_it_has_to_be(parts: Parts) -> None:
    told = parts.run(parts.supervision(), 10.0)
    assert 19 <= told.count("WATCHDOG=1") <= 20  # every 0.5 s of the 2 s


def test_the_status_is_told_on_change_and_at_most_once_a_second(parts: Parts) -> None:
    supervision = parts.supervision()
    told = [text for text in parts.run(supervision, 5.0) if text.startswith("STATUS")]
    assert told == ["STATUS=disabled, 2 clients, ok"]
    changes = []
    for number in range(20):
        parts.clients = number % 2
        changes += parts.run(supervision, 0.25)
    told = [text for text in changes if text.startswith("STATUS")]
    assert 1 <= len(told) <= 5


def test_the_status_has_the_reasons_and_is_one_line(parts: Parts) -> None:
    parts.verdict = ("down", ["the motor is silent", "no\nMAINPID=1"])
    parts.mode, parts.clients = "offline", 1
    told = parts.run(parts.supervision(), 1.5)
    wanted = "STATUS=offline, 1 client, down: the motor is silent; no MAINPID=1"
    assert [text for text in told if text.startswith("STATUS")] == [wanted]


def test_without_a_watchdog_only_the_status_is_told(
    parts: Parts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("WATCHDOG_USEC")
    assert parts.run(parts.supervision(), 5.0) == ["STATUS=disabled, 2 clients, ok"]


def test_a_tick_that_always_fails_feeds_nothing(parts: Parts) -> None:
    supervision = parts.supervision()
    assert "WATCHDOG=1" not in parts.run(supervision, 3.0, failed=True)
    assert "WATCHDOG=1" in parts.run(supervision, 3.0)


def test_a_tick_that_fails_now_and_then_is_no_reason_to_start_anew(parts: Parts) -> None:
    supervision = parts.supervision()
    parts.run(supervision, 0.1, failed=True)
    assert "WATCHDOG=1" in parts.run(supervision, 1.0)


def test_a_motor_that_is_known_to_be_silent_is_no_reason(parts: Parts) -> None:
    supervision = parts.supervision()
    parts.world.gripper.power_off()
    told = parts.run(supervision, 5.0)
    assert parts.world.machine.motor.view().phase is MotorPhase.SILENT
    assert told.count("WATCHDOG=1") >= 9


def test_feedback_that_is_old_unnoticed_is_one(
    parts: Parts, caplog: pytest.LogCaptureFixture
) -> None:
    supervision = parts.supervision()
    parts.run(supervision, 1.0)
    now_s = parts.world.now_s + FEEDBACK_WITHIN_S + 0.1  # the motor's part of the tick is not done
    for number in range(400):
        supervision.tick(now_s + number * PERIOD_S, failed=False)
    assert parts.world.machine.motor.view().phase is MotorPhase.DISABLED
    assert "WATCHDOG=1" not in parts.told()
    complaints = [r for r in caplog.records if "the watchdog is not fed" in r.message]
    assert len(complaints) == 1, "it is said once"
    parts.world.machine.controller.note_bus(BusCondition("down", "unplugged"))
    supervision.tick(now_s + 10.0, failed=False)
    assert "WATCHDOG=1" in parts.told(), "a bus that is known to be lost is no reason"


def test_a_daemon_that_hears_no_client_any_more_is_started_anew(parts: Parts) -> None:
    parts.is_open = False
    assert "WATCHDOG=1" not in parts.run(parts.supervision(), 3.0)


def test_requests_that_wait_and_are_not_served_are_noticed(parts: Parts) -> None:
    supervision = parts.supervision()
    parts.lines_wait = True
    parts.run(supervision, 1.2)
    assert "WATCHDOG=1" not in parts.run(supervision, 3.0)
    parts.requests = 1
    assert "WATCHDOG=1" in parts.run(supervision, 0.6), "one was served since"


def test_a_flood_that_is_served_is_no_reason(parts: Parts) -> None:
    supervision = parts.supervision()
    parts.lines_wait = True
    told = []
    for _ in range(10):
        parts.requests += 100
        told += parts.run(supervision, 0.5)
    assert told.count("WATCHDOG=1") >= 9


def test_a_successor_is_heard_in_the_name_of_the_first(
    parts: Parts, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("WATCHDOG_PID", "1")
    assert "WATCHDOG=1" not in parts.run(parts.supervision(), 2.0)
    successor = parts.supervision(follows=True)
    assert not parts.run(successor, 0.4), "not before the manager knows it"
    assert "WATCHDOG=1" in parts.run(successor, 1.0)


def fill(parts: Parts, supervision: Supervision) -> None:
    """Have the status told, and others say so much that there is no room for another word."""
    parts.run(supervision, 1.5)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.setblocking(False)
        with contextlib.suppress(BlockingIOError):
            while other.sendto(b"STATUS=of others", parts.manager.getsockname()):
                pass


def test_readiness_is_told_again_until_there_is_room_for_it(parts: Parts) -> None:
    supervision = parts.supervision()
    fill(parts, supervision)
    supervision.ready()
    assert "READY=1" not in parts.told()
    assert parts.run(supervision, 1.0).count("READY=1") == 1


def test_a_successor_is_named_as_soon_as_there_is_room_for_it(parts: Parts) -> None:
    supervision = parts.supervision()
    fill(parts, supervision)
    told: list[str] = []
    waited = 0

    def goes_on() -> bool:
        nonlocal waited
        waited += 1
        if waited > 2:
            told.extend(parts.told())
        return "BARRIER=1" not in told

    supervision.ready()
    supervision.followed_by(7, goes_on)
    assert "READY=1" not in told, "alone"
    assert told[-2:] == ["MAINPID=7\nREADY=1", "BARRIER=1"]


def test_a_successor_that_has_ended_is_not_named_any_more(parts: Parts) -> None:
    supervision = parts.supervision()
    fill(parts, supervision)
    supervision.followed_by(7, lambda: False)
    assert "MAINPID=7" not in parts.told()


def test_begin_and_end_are_told(parts: Parts) -> None:
    supervision = parts.supervision()
    supervision.ready()
    supervision.ends()
    assert parts.told() == ["READY=1", "STOPPING=1"]
