"""What is said to the service manager: datagrams to the socket that the environment names."""

import os
import socket
from pathlib import Path

import pytest

from litegripd.io.notify import Notifier, one_line, watchdog_s

DEADLINE_S = 20.0


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
        assert not notifier.barrier(0.0, lambda: None), "the manager has not looked yet"
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
        assert not notifier.barrier(DEADLINE_S, lambda: None)
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
        manager.recv(100)
        assert notifier.send("WATCHDOG=1"), "it is heard again once the manager reads"
        notifier.close()


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
