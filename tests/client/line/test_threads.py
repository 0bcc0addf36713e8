import json
import math
import os
import signal
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

import litegrip_client
from litegrip_client import LiteGrip
from litegrip_client.core.motion import Motion
from litegrip_client.line.connection import Connection
from litegrip_client.threads.blocking import BlockingWire, complete
from litegrip_client.values.errors import ConnectError, LiteGripError
from tests.client.fake_daemon import DEADLINE_S, STATE, FakeDaemon, Request
from tests.client.helpers import event, in_thread, interrupt_main_thread, sample, until_read


@pytest.fixture
def shared(daemon: FakeDaemon) -> Iterator[Connection]:
    """Return a connection that threads share."""
    with Connection(daemon.path, DEADLINE_S) as connection:
        yield connection


def test_progress_comes_in_the_calling_thread_and_may_make_calls(
    daemon: FakeDaemon, shared: Connection
) -> None:
    def move(request: Request) -> None:
        request.progress(1)
        request.progress(2)
        request.reply({"ok": True})

    seen: list[tuple[int, int, dict[str, Any]]] = []

    def note(data: dict[str, Any]) -> None:
        seen.append((threading.get_ident(), data["step"], shared.call("state.get")))

    daemon.handlers["motion.open"] = move
    assert shared.call("motion.open", {}, None, note) == {"ok": True}
    assert seen == [(threading.get_ident(), 1, STATE), (threading.get_ident(), 2, STATE)]


def test_progress_read_by_another_thread_reaches_the_caller(
    daemon: FakeDaemon, shared: Connection
) -> None:
    seen: list[int] = []
    noted = threading.Event()

    def note(data: dict[str, Any]) -> None:
        seen.append(data["step"])
        noted.set()

    other = in_thread(lambda: shared.call("other"))
    (first,) = daemon.wait_for("other")
    mover = in_thread(lambda: shared.call("motion.open", None, None, note))
    (motion,) = daemon.wait_for("motion.open")
    motion.progress(5)
    assert noted.wait(DEADLINE_S)
    motion.reply({"ok": True})
    assert mover() == {"ok": True}
    assert seen == [5]
    first.reply({})
    other()


def test_an_interrupted_call_leaves_the_connection_usable(
    daemon: FakeDaemon, shared: Connection
) -> None:
    daemon.handlers["wait"] = lambda request: interrupt_main_thread()
    with pytest.raises(KeyboardInterrupt):
        shared.call("wait", timeout_s=math.inf)
    daemon.requests[0].reply({"late": True})
    assert shared.call("state.get") == STATE


def test_interrupts_at_any_moment_lose_nothing(daemon: FakeDaemon, shared: Connection) -> None:
    def echo(request: Request) -> None:
        request.reply(request.params)
        interrupt_main_thread()

    daemon.handlers["echo"] = echo
    daemon.handlers["plain"] = lambda request: request.params
    interrupted = 0
    for turn in range(300):
        try:
            assert shared.call("echo", {"turn": turn}) == {"turn": turn}
            while True:  # the interrupt is on its way
                os.sched_yield()
        except KeyboardInterrupt:
            interrupted += 1
        assert shared.call("plain", {"turn": turn}) == {"turn": turn}
    assert interrupted == 300


class Interrupts:
    """Two interrupts: a signal, and another at the client's `nth` call after it.

    That is where one can come: at the beginning of a function, and after one in C. `is_over` if
    there were fewer calls.
    """

    def __init__(self, nth: int) -> None:
        self._left = nth

    @property
    def is_over(self) -> bool:
        return self._left > 0

    def __call__(self, _number: int, _frame: FrameType | None) -> None:
        sys.setprofile(self._at_call)
        raise KeyboardInterrupt

    def _at_call(self, frame: FrameType, event: str, _argument: object) -> None:
        code = frame.f_code
        is_ours = code.co_filename.startswith(str(Path(litegrip_client.__file__).parent))
        # A generator that is thrown away is called, too; nothing can be raised there.
        if not is_ours or code.co_name == "<genexpr>" or event not in ("call", "c_return"):
            return
        self._left -= 1
        if self._left == 0:
            sys.setprofile(None)
            raise KeyboardInterrupt


@pytest.mark.parametrize("is_reported", [True, False])
def test_two_interrupts_at_once_cancel_a_motion_all_the_same(
    daemon: FakeDaemon, shared: Connection, is_reported: bool
) -> None:
    """As one Ctrl-C does that reaches a program by two ways. `is_reported`: it knows its job."""

    def move(request: Request) -> None:
        if is_reported:
            request.progress()
        interrupt_main_thread()

    job = {"job": 4, "state": "running", "owner": {"pid": os.getpid()}}
    daemon.handlers["motion.open"] = move
    daemon.handlers["job.list"] = lambda _request: {"jobs": [job]}
    daemon.handlers["job.cancel"] = lambda _request: job
    before = signal.getsignal(signal.SIGINT)
    try:
        for nth in range(1, 2000):
            seen = len(daemon.requests)
            signal.signal(signal.SIGINT, interrupts := Interrupts(nth))
            with pytest.raises(KeyboardInterrupt):
                complete(Motion(BlockingWire(shared), "motion.open", {}).run())
            sys.setprofile(None)
            for _ in range(2):  # the second comes after what the first's answer has sent
                assert shared.call("state.get") == STATE, nth
            assert "job.cancel" in [one.method for one in daemon.requests[seen:]], nth
            if interrupts.is_over:
                break
    finally:
        sys.setprofile(None)
        signal.signal(signal.SIGINT, before)
    assert nth > 20


def test_an_interrupt_of_the_leader_does_not_leave_the_others_waiting(
    daemon: FakeDaemon, shared: Connection
) -> None:
    followers: list[Callable[[], Any]] = []

    def lead(request: Request) -> None:
        followers.append(in_thread(lambda: shared.call("follow")))

    def follow(request: Request) -> None:
        interrupt_main_thread()

    daemon.handlers["lead"] = lead
    daemon.handlers["follow"] = follow
    with pytest.raises(KeyboardInterrupt):
        shared.call("lead", timeout_s=math.inf)
    (request,) = daemon.wait_for("follow")
    request.reply({"followed": True})
    assert followers[0]() == {"followed": True}


def test_a_signal_handler_during_a_call_gets_a_clear_refusal(
    daemon: FakeDaemon, shared: Connection
) -> None:
    caught: list[LiteGripError] = []

    def handler(number: int, frame: object) -> None:
        try:
            shared.call("state.get")
        except LiteGripError as error:
            caught.append(error)
        daemon.requests[0].reply({"went": "on"})

    before = signal.signal(signal.SIGUSR1, handler)
    try:
        daemon.handlers["wait"] = lambda request: signal.pthread_kill(
            threading.main_thread().ident or 0, signal.SIGUSR1
        )
        assert shared.call("wait") == {"went": "on"}
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert [error.reason for error in caught] in (["reentrant"], [])
    assert shared.call("state.get") == STATE


def test_a_daemon_that_has_gone_is_noticed_without_a_call(
    daemon: FakeDaemon, shared: Connection
) -> None:
    shared.call("state.get")
    was_closed = shared.closed
    daemon.requests[0].hang_up()
    assert (was_closed, shared.closed) == (False, True)


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_is_refused_and_its_close_does_not_hurt(
    daemon: FakeDaemon, shared: Connection
) -> None:
    shared.call("state.get")
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        said = "nothing"
        try:
            shared.call("state.get")
        except ConnectError as error:
            said = f"{error.reason}: {error}"
        finally:
            shared.close()
            os.write(writing, said.encode())
            os._exit(0)
    os.close(writing)
    os.waitpid(child, 0)
    said = os.read(reading, 10_000).decode()
    os.close(reading)
    assert said.startswith("forked: this connection belongs to process")
    assert "connect again in the child" in said
    assert shared.call("state.get") == STATE


def test_a_read_that_nothing_disturbs_takes_few_calls(daemon: FakeDaemon) -> None:
    """What is called is cold after each wait for the daemon, and so it is what a read takes."""
    called: list[str] = []

    def note(frame: FrameType, event: str, _argument: object) -> None:
        if event == "call":
            called.append(frame.f_code.co_name)

    with LiteGrip(socket_path=daemon.path) as gripper:
        sys.setprofile(note)
        try:
            gripper.get_state()
        finally:
            sys.setprofile(None)
    assert len(called) <= 20, called


# Subscriptions


def subscribed(daemon: FakeDaemon) -> None:
    daemon.handlers["state.subscribe"] = lambda request: {"subscription": 5, "state": STATE}
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 5}


def test_closing_by_another_thread_wakes_who_waits(daemon: FakeDaemon, shared: Connection) -> None:
    subscribed(daemon)
    samples = shared.subscribe_state()
    assert next(samples).state == STATE
    waiting = in_thread(lambda: list(samples))
    samples.close()
    assert waiting() == []


@pytest.mark.parametrize("is_first", [True, False])
def test_a_sample_that_comes_with_an_answer_is_not_lost(
    daemon: FakeDaemon, shared: Connection, is_first: bool
) -> None:
    subscribed(daemon)
    params = {"subscription": 5, "seq": 1, "dropped": 0, "state": {"seq": 1}}
    told = json.dumps({"jsonrpc": "2.0", "method": "state.sample", "params": params})

    def answer(request: Request) -> None:
        message = json.dumps({"jsonrpc": "2.0", "id": request.identity, "result": STATE})
        lines = (told, message) if is_first else (message, told)
        request.send_bytes("".join(f"{line}\n" for line in lines).encode())

    with shared.subscribe_state() as samples:
        assert next(samples).state == STATE
        daemon.handlers["state.get"] = answer
        assert shared.call("state.get") == STATE
        assert next(samples).seq == 1


def test_a_subscription_and_a_call_by_two_threads(daemon: FakeDaemon, shared: Connection) -> None:
    subscribed(daemon)
    with shared.subscribe_state() as samples:

        def read() -> list[int | None]:
            seen = [next(samples).seq]
            began.set()
            return seen + [next(samples).seq for _ in range(50)]

        began = threading.Event()
        reader = in_thread(read)
        assert began.wait(DEADLINE_S)
        for seq in range(1, 51):
            assert shared.call("state.get") == STATE
            sample(daemon.requests[0], seq)
        assert reader() == [None, *range(1, 51)]


def test_events_are_waited_for_however_long(daemon: FakeDaemon, shared: Connection) -> None:
    begun = {"subscription": 5, "state": STATE, "events": []}
    daemon.handlers["events.subscribe"] = lambda request: begun
    daemon.handlers["events.unsubscribe"] = lambda request: {"subscription": 5}
    with shared.subscribe_events() as events:
        shared.timeout_s = 0.0
        waiting = in_thread(lambda: next(events))
        until_read(shared)
        event(daemon.requests[0], 45)
        assert waiting().seq == 45
        shared.timeout_s = DEADLINE_S
