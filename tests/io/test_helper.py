"""The helper process: requests, results in pieces, its death and its return."""

import logging
import os
import select
import signal
import socket
import time
from collections.abc import Callable, Iterator, Sequence
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace

import pytest

from litegrip_client.values.repeats import RepeatsHandler
from litegripd.io.helper.child import MAX_PACKET_BYTES, Child, Start, start_here
from litegripd.io.helper.helper import Helper, HelperResult

DEADLINE_S = 30.0


class Rig:
    """A helper served by a poll of its own, in place of the reactor."""

    def __init__(
        self,
        module: str = "tests.io.helper_for_tests",
        memory_fd: int | None = None,
        start: Start = start_here,
    ) -> None:
        self.poll = select.poll()
        self.watched: list[int] = []
        self.results: list[HelperResult] = []
        self.helper = Helper(self._watch, self._unwatch, module, memory_fd, start)
        self.helper.poll(time.monotonic())

    def _watch(self, child: Child) -> None:
        self.watched.append(child.socket.fileno())
        self.poll.register(child.socket.fileno(), select.POLLIN)

    def _unwatch(self, child: Child) -> None:
        self.watched.remove(child.socket.fileno())
        self.poll.unregister(child.socket.fileno())

    def until(self, condition: Callable[[], bool]) -> None:
        """Serve the helper until a condition holds."""
        ends_s = time.monotonic() + DEADLINE_S
        while not condition():
            assert time.monotonic() < ends_s, "did not happen in time"
            for _fd, mask in self.poll.poll(10):
                self.helper.on_event(mask)
            self.helper.poll(time.monotonic())

    def ask(self, operation: str, **parameters: object) -> HelperResult:
        """Ask for an operation and wait for what becomes of it."""
        before = len(self.results)
        self.helper.request(operation, parameters, self.results.append)
        self.until(lambda: len(self.results) > before)
        return self.results[-1]


@pytest.fixture
def rig() -> Iterator[Rig]:
    made = Rig()
    yield made
    made.helper.close()
    assert made.watched == []


def test_a_result_comes_back(rig: Rig) -> None:
    assert rig.ask("double", x="ü") == HelperResult({"twice": ["ü", "ü"]})


def test_a_long_result_comes_in_pieces(rig: Rig) -> None:
    result = rig.ask("pieces", count=100)
    assert result.error is None
    assert result.pieces == tuple(bytes([n]) * 100 for n in range(100))


@pytest.mark.parametrize(
    ("operation", "reason"),
    [
        ("broken", "ValueError: the disk is on fire"),
        ("no_json", "TypeError"),
        ("pipe", "BrokenPipeError"),
        ("no such thing", "KeyError"),
    ],
)
def test_an_error_comes_back_as_a_sentence_and_the_helper_goes_on(
    rig: Rig, operation: str, reason: str
) -> None:
    pid = rig.helper.pid
    result = rig.ask(operation)
    assert result.error is not None
    assert result.error.startswith(reason)
    assert (result.value, result.pieces) == (None, ())
    assert rig.ask("double", x=1).error is None
    assert rig.helper.pid == pid


def test_many_requests_are_answered_in_their_order(rig: Rig) -> None:
    got: list[object] = []
    for number in range(20):
        rig.helper.request("double", {"x": number}, lambda result: got.append(result.value))
    rig.until(lambda: len(got) == 20)
    assert got == [{"twice": [n, n]} for n in range(20)]


def test_a_helper_that_dies_fails_its_requests_and_is_started_again(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    pid = rig.helper.pid
    rig.helper.request("die", {}, rig.results.append)
    rig.helper.request("double", {"x": 1}, rig.results.append)
    rig.until(lambda: len(rig.results) == 2)
    assert [result.error for result in rig.results] == [
        "the helper process died while it worked on this"
    ] * 2
    assert not rig.helper.is_running
    assert rig.helper.pid is None
    assert rig.helper.deaths == 1
    assert str(pid) in caplog.text
    rig.until(lambda: rig.helper.is_running)
    assert rig.helper.pid != pid
    assert rig.ask("double", x=2).value == {"twice": [2, 2]}


def test_one_that_fails_at_each_start_is_started_ever_more_rarely(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now_s, starts = 100.0, list[float]()
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    child = Child(ours)

    def start(_module: str, _arguments: Sequence[str], _memory_fd: int | None) -> Child:
        starts.append(now_s)
        if now_s < 160.0:
            raise OSError("no such interpreter")
        return child

    clock = SimpleNamespace(monotonic=lambda: now_s)
    monkeypatch.setattr("litegripd.io.helper.helper.time", clock)
    helper = Helper(lambda _child: None, lambda _child: None, start=start)
    while now_s < 170.0:
        helper.poll(now_s)
        now_s += 0.125
    waits_s = [later - before for before, later in pairwise(starts)]
    assert waits_s[:6] == [0.5, 1.0, 2.0, 4.0, 5.0, 5.0]
    assert len(starts) < 20
    now_s += 60.0  # for which it lives
    theirs.close()
    child.failure = "killed"
    helper.on_event(select.POLLHUP)
    before = len(starts)
    helper.poll(now_s + 0.5)
    assert len(starts) == before + 1


def test_without_a_helper_requests_are_refused_at_once(rig: Rig) -> None:
    assert rig.helper.pid is not None
    os.kill(rig.helper.pid, signal.SIGKILL)
    rig.until(lambda: not rig.helper.is_running)
    rig.helper.request("double", {"x": 1}, rig.results.append)
    assert rig.results[-1].error is not None
    assert rig.helper.refused == 1


def test_the_line_that_tells_of_its_death_is_written_by_the_next_one(
    capfd: pytest.CaptureFixture[str],
) -> None:
    rig = Rig()
    handler = RepeatsHandler(lambda _record, text: rig.helper.post("log", {"text": f"{text}\n"}))
    logging.getLogger("litegripd").addHandler(handler)
    try:
        assert rig.helper.pid is not None
        os.kill(rig.helper.pid, signal.SIGKILL)
        rig.until(lambda: rig.helper.deaths == 1 and rig.helper.is_running)
        assert rig.ask("double", x=1).error is None  # by now it has begun
    finally:
        logging.getLogger("litegripd").removeHandler(handler)
        rig.helper.close()
    assert "died; it will be started again\n" in capfd.readouterr().err
    assert handler.dropped == 0


def test_posts_that_wait_for_a_helper_are_bounded(rig: Rig) -> None:
    assert rig.helper.pid is not None
    os.kill(rig.helper.pid, signal.SIGKILL)
    rig.until(lambda: not rig.helper.is_running)
    assert not rig.helper.post("double", {"x": "y" * MAX_PACKET_BYTES})
    posted = 0
    while rig.helper.post("double", {"x": posted}):
        posted += 1
        assert posted < 1000
    assert posted == 64
    rig.until(lambda: rig.helper.is_running)
    assert rig.ask("double", x=1).error is None
    assert rig.helper.post("double", {"x": 1})


def test_a_stopped_helper_refuses_rather_than_makes_wait(rig: Rig) -> None:
    assert rig.helper.pid is not None
    rig.ask("double", x=1)
    os.kill(rig.helper.pid, signal.SIGSTOP)
    posted = 0
    while rig.helper.post("double", {"x": "y" * 1000}):
        posted += 1
        assert posted < 10_000
    os.kill(rig.helper.pid, signal.SIGCONT)
    assert posted > 10
    rig.until(lambda: rig.ask("double", x=3).error is None)


def test_a_request_that_fits_no_packet_is_refused(rig: Rig) -> None:
    assert not rig.helper.post("double", {"x": "y" * MAX_PACKET_BYTES})
    rig.helper.request("double", {"x": "y" * MAX_PACKET_BYTES}, rig.results.append)
    assert rig.results[-1].error is not None
    assert rig.ask("double", x=4).error is None


def test_a_defect_of_who_asked_does_not_leave_the_helper_unserved(
    rig: Rig, caplog: pytest.LogCaptureFixture
) -> None:
    def broken(_result: HelperResult) -> None:
        raise ZeroDivisionError("a defect")

    rig.helper.request("double", {"x": 1}, broken)
    assert rig.ask("double", x=2).error is None
    assert "ZeroDivisionError" in caplog.text


def test_what_was_posted_before_the_end_is_still_done(capfd: pytest.CaptureFixture[str]) -> None:
    rig = Rig()
    assert rig.ask("double", x=1).error is None, "it has begun: the end does not wait for that"
    for number in range(50):
        assert rig.helper.post("log", {"text": f"line {number} \udcff\n"})
    rig.helper.close()
    written = capfd.readouterr().err.splitlines()
    assert written == [f"line {number} \\udcff" for number in range(50)]


def test_a_log_that_nobody_reads_does_not_kill_the_helper(rig: Rig) -> None:
    """Standard error of the helper is a closed pipe, as in `litegripd 2>&1 | head`."""
    reader, writer = os.pipe()
    kept = os.dup(2)
    os.dup2(writer, 2)
    os.close(writer)
    os.close(reader)
    try:
        other = Rig()
    finally:
        os.dup2(kept, 2)
        os.close(kept)
    try:
        assert other.helper.post("log", {"text": "lost\n"})
        assert other.ask("double", x=1).error is None
        assert other.helper.deaths == 0
    finally:
        other.helper.close()


def test_a_helper_that_cannot_be_started_is_tried_again(caplog: pytest.LogCaptureFixture) -> None:
    attempts = 0

    def at_first_impossible(module: str, arguments: Sequence[str], memory_fd: int | None) -> Child:
        nonlocal attempts
        attempts += 1
        if attempts == 1:
            raise OSError(11, "no processes left")
        return start_here(module, arguments, memory_fd)

    rig = Rig(start=at_first_impossible)
    assert not rig.helper.is_running
    assert "no processes left" in caplog.text
    rig.until(lambda: rig.helper.is_running)
    rig.helper.close()


def test_a_helper_ends_with_its_daemon() -> None:
    child = start_here("litegripd.app.helper_main")
    assert child.pid is not None
    pidfd = os.pidfd_open(child.pid)
    try:
        child.socket.close()
        assert select.select([pidfd], [], [], DEADLINE_S)[0]
        assert child.has_ended
    finally:
        os.close(pidfd)
        child.close()


def test_a_helper_runs_nothing_that_lies_in_the_current_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "json.py").write_text("raise SystemExit('a module of somebody else')")
    monkeypatch.chdir(tmp_path)
    rig = Rig("litegripd.app.helper_main")
    try:
        assert rig.ask("calibration.templates").error is None
    finally:
        rig.helper.close()
