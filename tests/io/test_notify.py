"""What is said to the service manager: datagrams to the socket that the environment names."""

import itertools
import os
import select
import socket
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from litegripd.app.systemd import Notifier, one_line, watchdog_s

DEADLINE_S = 20.0


class Full:
    """A manager that does not read, with no more room for anything, and who has to tell it."""

    def __init__(self, manager: socket.socket) -> None:
        self.manager = manager
        self.notifier = Notifier()
        while self.notifier.send("STATUS=full"):
            pass

    def room_at(self, number: int) -> Callable[[], bool]:
        """Return what makes room for one message when it is called so often."""
        calls = itertools.count(1)

        def goes_on() -> bool:
            count = next(calls)
            if count == number:
                self.manager.recv(100)
            return count < 1000

        return goes_on

    def read(self) -> list[bytes]:
        """Return all that the manager was told."""
        messages = []
        while select.select([self.manager], [], [], 0)[0]:
            messages.append(self.manager.recv(100))
        return messages


@pytest.fixture
def full(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Full]:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        full = Full(manager)
        yield full
        full.notifier.close()


@pytest.mark.parametrize("is_abstract", [False, True])
def test_the_manager_is_told_and_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, is_abstract: bool
) -> None:
    path = f"{'@' if is_abstract else ''}{tmp_path / 'notify'}"
    address = "\0" + path[1:] if is_abstract else path
    monkeypatch.setenv("NOTIFY_SOCKET", path)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(address)
        notifier = Notifier()
        assert notifier.send("READY=1")
        assert manager.recv(100) == b"READY=1"
        assert not notifier.barrier(0.0, lambda: True), "the manager has not looked yet"
        message, descriptors, _flags, _address = socket.recv_fds(manager, 100, 1)
        assert message == b"BARRIER=1"
        os.close(descriptors[0])
        assert notifier.send("WATCHDOG=1")
        assert manager.recv(100) == b"WATCHDOG=1"
        notifier.close()


def test_without_a_manager_nothing_is_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv("NOTIFY_SOCKET", raising=False)
    for path in (None, str(tmp_path / "nobody"), "vsock:2:1234"):
        if path is not None:
            monkeypatch.setenv("NOTIFY_SOCKET", path)
        notifier = Notifier()
        assert not notifier.send("READY=1")
        assert not notifier.is_full
        assert not notifier.insist("READY=1", lambda: pytest.fail("there is nobody to wait for"))
        assert not notifier.barrier(DEADLINE_S, lambda: True)
        notifier.close()


def test_a_manager_that_does_not_read_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager:
        manager.bind(str(tmp_path / "notify"))
        notifier = Notifier()
        sent = 0
        while notifier.send("WATCHDOG=1"):
            sent += 1
            assert sent < 100_000
        assert notifier.is_full
        manager.recv(100)
        again = notifier.send("WATCHDOG=1"), notifier.is_full
        assert again == (True, False), "it is heard again once the manager reads"
        notifier.close()


def test_what_must_be_told_is_told_as_soon_as_the_manager_reads(full: Full) -> None:
    goes_on = full.room_at(3)
    assert full.notifier.insist("MAINPID=7", goes_on)
    assert full.read()[-1] == b"MAINPID=7"


def test_a_barrier_waits_for_room_and_its_time_counts_from_then(full: Full) -> None:
    goes_on = full.room_at(3)
    assert not full.notifier.barrier(0.0, goes_on), "it is sent, and not yet looked at"
    assert full.read()[-1] == b"BARRIER=1"


def test_nothing_is_insisted_on_when_it_matters_no_longer(full: Full) -> None:
    assert not full.notifier.insist("MAINPID=7", lambda: False)
    assert not full.notifier.barrier(DEADLINE_S, lambda: False)
    assert set(full.read()) == {b"STATUS=full"}


def test_the_watchdog_is_for_the_process_that_is_named_and_its_successors(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("WATCHDOG_USEC", "5000000")
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    assert watchdog_s() == 5.0
    monkeypatch.setenv("WATCHDOG_PID", str(os.getpid()))
    assert watchdog_s() == 5.0
    monkeypatch.setenv("WATCHDOG_PID", "1")
    assert watchdog_s() is None
    assert watchdog_s(follows=True) == 5.0


@pytest.mark.parametrize("given", ["", "0", "-1", "soon", "5.5"])
def test_without_a_watchdog_there_is_none_to_feed(
    monkeypatch: pytest.MonkeyPatch, given: str
) -> None:
    monkeypatch.delenv("WATCHDOG_PID", raising=False)
    monkeypatch.setenv("WATCHDOG_USEC", given)
    assert watchdog_s() is None


def test_a_text_gives_no_orders_of_its_own() -> None:
    assert one_line("no answer\nMAINPID=1\x00 ü") == "no answer MAINPID=1  ü"
