"""A daemon that may open few files: stops are heard, or it does not start and says why."""

import contextlib
import os
import socket
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess

WITH_LIMIT = (
    "import resource, sys\n"
    "resource.setrlimit(resource.RLIMIT_NOFILE, ({limit}, {limit}))\n"
    "from litegripd.app.main import main\n"
    "sys.exit(main())\n"
)


def start(folder: Path, limit: int) -> DaemonProcess:
    program = ("-c", WITH_LIMIT.format(limit=limit))
    where = ("--simulate", "--socket", str(folder / "rpc.sock"))
    return DaemonProcess(folder, f"few-{os.getpid()}", *where, program=program)


@pytest.mark.parametrize("limit", [64, 128, 159])
def test_with_too_few_it_does_not_start_and_says_what_it_needs(tmp_path: Path, limit: int) -> None:
    running = start(tmp_path, limit)
    try:
        assert running.exit_code() != 0
        assert f"may open {limit} files, and needs 160 at least" in running.log
        assert "LimitNOFILE" in running.log
        assert "Traceback" not in running.log
    finally:
        running.kill()


def test_with_few_it_lets_few_clients_in_and_everybody_stop(tmp_path: Path) -> None:
    running = start(tmp_path, 160)
    try:
        with contextlib.ExitStack() as stack:
            clients: list[Client] = [stack.enter_context(running.connect()) for _ in range(16)]
            for client in clients:
                client.result("state.get")
            for _ in range(8):  # they are turned away, whatever they wait for
                answer = stack.enter_context(running.connect()).read()
                assert answer["error"]["data"]["reason"] == "too_many_connections"
                assert answer["error"]["data"]["limit"] == 16
            for number in range(1, 81):
                stopper = stack.enter_context(socket.socket(socket.AF_UNIX))
                stopper.settimeout(DEADLINE_S)
                stopper.connect(str(running.socket_path.with_name("rpc.stop.sock")))
                stopper.sendall(b"hold\n")
                assert b'"generation":%d' % number in stopper.recv(4096)
            assert clients[0].result("state.get")["stop"]["repeats"] == 79
        running.end()
    finally:
        running.kill()
