"""Bad input and floods over the real socket: answered, logged without waiting, and survived."""

import itertools
import os
import signal
import time
from pathlib import Path

from tests.io.test_standard_error import fill
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, spawned

BAD = {
    b"open!\n": "parse_error",
    b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"speed_mm_s":"fast"}}\n': (
        "invalid_params"
    ),
    b'{"jsonrpc":"2.0","id":1,"method":"motion.fly"}\n': "unknown_method",
    b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"speed_mm_s":NaN}}\n': (
        "parse_error"
    ),
    b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"speed_mm_s":1e999}}\n': (
        "invalid_params"
    ),
    b'[{"jsonrpc":"2.0","id":1,"method":"state.get"}]\n': "invalid_request",
    b"[" * 16000 + b"\n": "invalid_request",
    b"\xff\xfe\n": "parse_error",
    b'{"jsonrpc":"2.0","method":"motion.open"}\n': "invalid_request",
    b'{"jsonrpc":"2.0","id":1,"id":1,"method":"motion.open"}\n': "parse_error",
    b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"config":%b%b}}\n'
    % (b"[" * 500, b"]" * 500): "invalid_params",
    b'{"a":' * 500 + b"1" + b"}" * 500 + b"\n": "invalid_request",
}


def test_bad_input_is_answered_and_survived(simulated: DaemonProcess) -> None:
    with simulated.connect() as client, simulated.connect() as half:
        client.enabled()
        before = client.result("health")["rpc"]["refused_requests"]
        half.socket.sendall(b'{"jsonrpc":"2.0","id":1,"meth')
        for line, reason in BAD.items():
            error = client.raw(line)["error"]
            assert error["data"]["reason"] == reason
            assert error["code"] < 0
            assert error["message"]
        assert client.result("state.get")["mode"] == "holding"
        with simulated.connect() as long:
            answer = long.raw(b"x" * 17_000 + b"\n")
            assert answer["error"]["data"]["reason"] == "line_too_long"
            assert long.read() == {}
        health = client.result("health")
        assert health["control"]["tick_errors"] == 0
        # Of what comes by a portal, some is refused on the way.
        refused = 1 if simulated.remote_as else len(BAD)
        assert health["rpc"]["refused_requests"] >= before + refused
        half.socket.sendall(b'od":"state.get"}\n')
        assert half.read()["id"] == 1


def test_a_flood_of_bad_input_keeps_nobody_out(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        before = client.result("health")["rpc"]["refused_requests"]
    flood = spawned(
        "import socket, sys\n"
        "s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1]); print('on', flush=True)\n"
        "while True:\n"
        "    s.sendall(b'flood\\n' * 100); n = 0\n"
        "    while n < 100: n += s.recv(65536).count(b'\\n')\n",
        str(simulated.socket_path),
        says="on",
    )
    with flood, simulated.connect() as client:
        many = before + 1000
        client.until_health(lambda health: bool(health["rpc"]["refused_requests"] > many))
        client.enabled()
        assert client.result("motion.open", speed_mm_s=100)["ok"]
        assert client.result("health")["control"]["tick_errors"] == 0


def test_a_log_that_nobody_reads_holds_nothing_up(tmp_path: Path) -> None:
    """Standard error is a full pipe from the beginning: lines are dropped, counted, and told of."""
    reader, writer = os.pipe()
    fill(writer)
    socket_path = str(tmp_path / "rpc.sock")
    arguments = (f"sim-{os.getpid()}", "--simulate", "--socket", socket_path)
    running = DaemonProcess(tmp_path, *arguments, log=writer)
    os.close(writer)
    try:
        with running.connect() as client:
            for _ in range(3):
                assert client.result("calibration.templates")["templates"]
            health = client.until_health(lambda found: bool(found["log"]["is_stuck"]))
            assert health["verdict"] == "degraded"
            assert any("standard error" in reason for reason in health["reasons"])
            client.enabled()
            ends_s = time.monotonic() + DEADLINE_S
            for letters in itertools.product("abcdefghijklmnopqrst", repeat=4):
                if client.result("health")["log"]["dropped"]:
                    break
                client.refusal("".join(letters))  # each another one: the same ones are counted
                assert time.monotonic() < ends_s
            assert client.despite_silence("motion.open", speed_mm_s=100)["ok"]
            assert client.result("health")["control"]["tick_errors"] == 0
        running.process.send_signal(signal.SIGTERM)
        assert running.process.wait(DEADLINE_S) == 0
    finally:
        running.kill()
        os.close(reader)
