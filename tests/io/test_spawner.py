"""The spawner: starts that nobody waits for, their failures, its death and its replacement."""

import os
import resource
import select
import signal
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from litegripd.io.helper.child import Child
from litegripd.io.helper.helper import Helper
from litegripd.io.helper.spawner import MODULE as SPAWNER
from litegripd.io.helper.spawner import Spawner

DEADLINE_S = 30.0
MODULE = "tests.io.helper_for_tests"


@pytest.fixture
def spawner() -> Iterator[Spawner]:
    made = Spawner()
    yield made
    made.close()


@pytest.fixture
def helper(spawner: Spawner) -> Iterator[Helper]:
    made = Helper(lambda _child: None, lambda _child: None, MODULE, start=spawner.start)
    made.poll(time.monotonic())
    yield made
    made.close()


def until(condition: Callable[[], bool], meanwhile: Callable[[], None] = lambda: None) -> None:
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s, "did not happen in time"
        meanwhile()
        select.select((), (), (), 0.002)


def end(process: int | None, number: signal.Signals = signal.SIGKILL) -> None:
    assert process is not None
    os.kill(process, number)


def double(child: Child) -> bytes:
    assert select.select([child.socket], [], [], DEADLINE_S)[0]
    return child.receive() or b""


def test_a_process_that_cannot_be_watched_counts_as_not_started(spawner: Spawner) -> None:
    """All descriptors are in use when its pidfd comes: the kernel leaves that out."""
    child = spawner.start(MODULE)
    before = resource.getrlimit(resource.RLIMIT_NOFILE)
    assert spawner._child is not None
    assert select.select([spawner._child.socket], [], [], DEADLINE_S)[0]
    resource.setrlimit(resource.RLIMIT_NOFILE, (3, before[1]))
    try:
        assert child.pid is None
    finally:
        resource.setrlimit(resource.RLIMIT_NOFILE, before)
    assert child.has_ended
    assert child.failure is not None
    assert "no descriptor" in child.failure
    child.close()


def test_a_process_that_has_ended_has_left_its_end_of_the_pair(spawner: Spawner) -> None:
    """No other process has it: what asks after each tick may ask the socket alone."""
    others = [spawner.start(MODULE) for _ in range(2)]
    child = spawner.start(MODULE)
    another = spawner.start(MODULE)
    assert child.send(b'[1, "double", {"x": 1}]')
    double(child)
    assert child.receive() is None
    assert (child.is_cut, child.has_ended) == (False, False)
    pidfd = child.pidfd
    assert child.pid is not None
    assert pidfd is not None
    end(child.pid)
    assert select.select([pidfd], [], [], DEADLINE_S)[0]
    assert child.receive() is None
    assert child.is_cut is True
    assert child.has_ended is True
    for one in (*others, child, another):
        one.close()


def test_a_start_does_not_wait_for_the_process(spawner: Spawner) -> None:
    """The spawner stands still, as it would in a slow start of a program."""
    end(spawner.pid, signal.SIGSTOP)
    child = spawner.start(MODULE)
    assert child.send(b'[1, "double", {"x": 1}]')
    assert (child.pid, child.has_ended) == (None, False)
    end(spawner.pid, signal.SIGCONT)
    assert double(child)[4:] == b'r{"twice": [1, 1]}'
    assert child.pid != os.getpid()
    assert not child.has_ended
    child.close(DEADLINE_S)


def test_only_the_spawner_is_started_by_this_process(
    spawner: Spawner, monkeypatch: pytest.MonkeyPatch
) -> None:
    def forbidden(*_arguments: object, **_named: object) -> int:
        raise AssertionError("this process has started another one")

    monkeypatch.setattr(os, "posix_spawn", forbidden)
    child = spawner.start(MODULE)
    until(lambda: child.pid is not None)
    child.close(DEADLINE_S)


def test_the_end_of_a_process_is_seen_and_it_leaves_no_zombie(spawner: Spawner) -> None:
    child = spawner.start(MODULE)
    until(lambda: child.pid is not None)
    pid = child.pid
    end(pid)
    until(lambda: child.has_ended)
    child.close()
    until(lambda: not Path(f"/proc/{pid}").exists())


def test_a_process_holds_no_end_of_another_pair(spawner: Spawner) -> None:
    """It would keep that from seeing its daemon's end."""
    first, second = spawner.start(MODULE), spawner.start(MODULE)
    until(lambda: first.pid is not None and second.pid is not None)
    sockets = [
        {
            str(path.readlink())
            for path in Path(f"/proc/{child.pid}/fd").iterdir()
            if path.name == "3"
        }
        for child in (first, second)
    ]
    assert sockets[0] != sockets[1]
    first.socket.close()
    until(lambda: first.has_ended)
    assert not second.has_ended
    second.close(DEADLINE_S)


def test_a_start_that_fails_says_why(spawner: Spawner, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("litegripd.io.helper.child._PYTHON", "/no/such/python")
    with pytest.raises(OSError, match="No such file"):
        Spawner()
    child = spawner.start(MODULE, ["\0"])  # no argument can have one
    until(lambda: child.has_ended)
    assert child.failure is not None
    assert "null" in child.failure
    child.close()
    other = spawner.start(MODULE)
    until(lambda: other.pid is not None)
    other.close(DEADLINE_S)


def test_without_a_spawner_a_start_is_refused(spawner: Spawner) -> None:
    end(spawner.pid)
    until(lambda: spawner_is_gone(spawner))
    with pytest.raises(OSError, match="is gone"):
        spawner.start(MODULE)


def spawner_is_gone(spawner: Spawner) -> bool:
    spawner._settle(0.0)
    return not spawner.is_running


def test_a_spawner_that_dies_takes_what_it_has_not_started_with_it(spawner: Spawner) -> None:
    end(spawner.pid, signal.SIGSTOP)
    child = spawner.start(MODULE)
    end(spawner.pid)
    until(lambda: child.has_ended)
    assert child.failure == "the process that starts the others died"
    child.close()
    assert spawner.deaths == 1


def test_the_helper_replaces_a_spawner_that_died(spawner: Spawner, helper: Helper) -> None:
    until(lambda: helper.pid is not None)
    first = spawner.pid
    end(first)
    now_s = time.monotonic()
    until(lambda: spawner_is_gone(spawner))
    spawner.poll(now_s + 1.0, helper, may_wait=False)
    until(lambda: spawner.is_running, lambda: helper.on_event(select.EPOLLIN))
    assert spawner.pid not in (None, first, os.getpid())
    child = spawner.start(MODULE)
    assert child.send(b'[1, "double", {"x": 2}]')
    assert double(child)[4:] == b'r{"twice": [2, 2]}'
    child.close(DEADLINE_S)


def test_without_helper_and_spawner_this_process_waits_only_where_it_may(
    spawner: Spawner, helper: Helper
) -> None:
    until(lambda: helper.pid is not None)
    end(helper.pid)
    end(spawner.pid)
    until(lambda: not helper.is_running, lambda: helper.on_event(select.EPOLLIN))
    until(lambda: spawner_is_gone(spawner))
    now_s = time.monotonic()
    for tick in range(5):
        spawner.poll(now_s + tick, helper, may_wait=False)
    assert spawner.pid is None
    spawner.poll(now_s + 10.0, helper, may_wait=True)
    until(lambda: spawner.is_running)
    helper.poll(now_s + 10.0)
    until(lambda: helper.pid is not None)


def test_a_process_that_starts_after_the_end_ends_by_itself(spawner: Spawner) -> None:
    """The daemon is about to end, and does not wait."""
    end(spawner.pid, signal.SIGSTOP)
    child = spawner.start(MODULE)
    child.close()
    end(spawner.pid, signal.SIGCONT)
    children = Path(f"/proc/{spawner.pid}/task/{spawner.pid}/children")
    other = spawner.start(MODULE)
    until(lambda: other.pid is not None)
    until(lambda: children.read_text(encoding="ascii").split() == [str(other.pid)])
    other.close(DEADLINE_S)


def test_lists_of_processes_show_short_commands(spawner: Spawner) -> None:
    """`systemctl status` shows each: interpreter, one file, the module, and its arguments."""
    child = spawner.start(MODULE, ("an argument",))
    until(lambda: child.pid is not None)
    try:
        for pid, own in ((spawner.pid, [SPAWNER]), (child.pid, [MODULE, "an argument"])):
            path = Path(f"/proc/{pid}/cmdline")
            until(lambda path=path: b"run.py" in path.read_bytes())  # type: ignore[misc]
            _python, run, *rest = path.read_text(encoding="utf-8").removesuffix("\0").split("\0")
            assert rest == own
            assert "\n" not in run
            assert run.endswith("/litegripd/io/helper/run.py")
    finally:
        child.close()
