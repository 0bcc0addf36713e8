"""How long a request takes: at the daemon's own socket, through a portal, and by plain gRPC.

python -m bench.fleet.latency [ROUNDS, default 300] [ONE_WAY_MS,... default 0,1,20] [SEED]

A daemon with a simulated gripper, and for each delay a router, a gateway and a portal.
The delay is between portal and router, and between gRPC's client and its server, by the same relay
(`bench.fleet.link`; without one for 0 ms: loopback). TLS with certificates of both ends everywhere.
Each round asks each way once, in random order, on connections that stay. `state`: `state.get`.
`motion`: from the request of a motion that is not waited for, to the answer that it is accepted.
`stop`: by the socket for stops, to the daemon's answer. gRPC `memory` answers the same number of
bytes from memory, `daemon` passes each call on to the daemon, both in Python (`bench.fleet.grpc`);
without grpcio (`pip install grpcio`) their rows are missing. `refused` is not in the times.
`bare TCP` is an echo of 800 bytes.
"""

import contextlib
import importlib.util
import itertools
import json
import os
import random
import socket
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bench.fleet.scale import kill_all, said, started
from tests.process.daemon_process import SIMULATED, Client, DaemonProcess, daemon
from tests.process.fleet.fleet_process import HOST, Fleet, make_certificates

USER, TTL_S = "op1", 5.0
KINDS = ("state", "motion", "stop")
ECHO_BYTES = 800
BETWEEN_S = 0.01

Call = Callable[[bytes], bytes]
"""Sends a line, and returns the line that answers it."""


class Ways:
    """The ways to the daemon over one link, and how long each took."""

    def __init__(self) -> None:
        self.calls: dict[str, dict[str, Call]] = {}
        self.took_s: dict[tuple[str, str], list[float]] = {}
        self.refused: Counter[str] = Counter()
        self._identities = itertools.count(1)

    def measure(self, kind: str, rounds: int, seed: int, after: Callable[[bytes], None]) -> None:
        """Ask by each way in turn; `after` takes each answer, and is not timed."""
        order = random.Random(seed)
        ways = [way for way, calls in self.calls.items() if kind in calls]
        for number in range(rounds):
            for way in order.sample(ways, len(ways)):
                line = request(kind, next(self._identities), number)
                begun_s = time.monotonic()
                answer = self.calls[way][kind](line)
                took_s = time.monotonic() - begun_s
                if not answer:
                    raise RuntimeError(f"{way}: the connection is closed")
                if b'"error"' in answer:
                    self.refused[way] += 1
                    print(f"{way}: {answer.decode():.300}", file=sys.stderr)
                else:
                    self.took_s.setdefault((way, kind), []).append(took_s)
                    after(answer)
                time.sleep(BETWEEN_S)

    def rows(self, one_way_ms: float) -> Iterator[str]:
        for way, calls in self.calls.items():
            cells = ""
            for kind in KINDS:
                if kind in calls:
                    ordered = sorted(self.took_s[way, kind])
                    shares = (ordered[int(share * (len(ordered) - 1))] for share in (0.5, 0.99))
                    cells += "".join(f"{took_s * 1e3:>9.2f}" for took_s in shares)
                else:
                    cells += f"{'-':>9}{'-':>9}"
            yield f"{one_way_ms:>7g}  {way:<22}{cells}{self.refused[way]:>9}"


def request(kind: str, identity: int, number: int) -> bytes:
    """Return the line that asks; motions go to and fro, by 1 mm."""
    asked: dict[str, tuple[str, dict[str, Any]]] = {
        "state": ("state.get", {}),
        "motion": ("motion.move", {"opening_mm": 60.0 + number % 2, "wait": False}),
        "stop": ("stop", {"level": "hold", "why": "bench"}),
    }
    method, params = asked[kind]
    line = {"jsonrpc": "2.0", "id": identity, "method": method, "params": params}
    return json.dumps(line).encode() + b"\n"


def socket_calls(stack: contextlib.ExitStack, path: Path) -> dict[str, Call]:
    """Return the calls of a daemon's, or a portal's, sockets."""
    asked, stopped = (
        stack.enter_context(Client(one)) for one in (path, path.with_suffix(".stop.sock"))
    )
    calls = {"state": _by(asked), "motion": _by(asked)}
    return calls | {"stop": _by(stopped)}


def _by(client: Client) -> Call:
    lines = client.socket.makefile("rb")

    def call(line: bytes) -> bytes:
        client.socket.sendall(line)
        return lines.readline()

    return call


def grpc_calls(
    stack: contextlib.ExitStack, port: int, certificates: Path
) -> dict[str, dict[str, Call]]:
    """Return the calls of both kinds of gRPC's server."""
    from bench.fleet.grpc import channel  # noqa: PLC0415 - not everybody has grpcio

    connected = stack.enter_context(channel(port, certificates, USER))
    memory = {kind: connected.unary_unary(f"/memory/{kind}") for kind in KINDS}
    to_daemon = connected.unary_unary("/daemon/request")
    passed_on = {"state": to_daemon, "motion": to_daemon}
    passed_on["stop"] = connected.unary_unary("/daemon/stop")
    return {"gRPC, memory": memory, "gRPC, daemon": passed_on}


def echo_calls(stack: contextlib.ExitStack, port: int) -> dict[str, Call]:
    connected = stack.enter_context(socket.create_connection((HOST, port)))
    connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def call(_line: bytes) -> bytes:
        connected.sendall(b"x" * ECHO_BYTES)
        received = b""
        while len(received) < ECHO_BYTES:
            received += connected.recv(ECHO_BYTES)
        return received

    return {"state": call}


def echo_port(stack: contextlib.ExitStack) -> int:
    """Start an echo on a thread; return its port."""
    listener = stack.enter_context(socket.create_server((HOST, 0)))

    def serve() -> None:
        with contextlib.suppress(OSError):
            while True:
                connected, _address = listener.accept()
                connected.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                while received := connected.recv(65_536):
                    connected.sendall(received)

    threading.Thread(target=serve, daemon=True).start()
    return int(listener.getsockname()[1])


class Lab:
    """A daemon, and what stays for all delays."""

    def __init__(self, stack: contextlib.ExitStack, folder: Path, gripper: DaemonProcess) -> None:
        self.gripper = gripper
        self.local = stack.enter_context(gripper.connect()).enabled()
        self.certificates = make_certificates(
            folder / "tls", HOST, f"user:{USER}", "gateway:robot1"
        )
        self._folder = folder
        self._has_grpc = importlib.util.find_spec("grpc") is not None
        if not self._has_grpc:
            print("no grpcio: `pip install grpcio` for the rows of gRPC")

    def ways(self, stack: contextlib.ExitStack, one_way_ms: float) -> Ways:
        """Start what is needed for one delay."""
        ways = Ways()
        if not one_way_ms:
            ways.calls["the daemon's socket"] = socket_calls(stack, self.gripper.socket_path)
        echo = self._over(stack, echo_port(stack), one_way_ms)
        ways.calls["bare TCP, no TLS"] = echo_calls(stack, echo)
        ways.calls["portal"] = socket_calls(stack, self._portal(stack, one_way_ms))
        if self._has_grpc:
            port = self._over(stack, self._grpc(stack), one_way_ms)
            ways.calls |= grpc_calls(stack, port, self.certificates)
        return ways

    def _portal(self, stack: contextlib.ExitStack, one_way_ms: float) -> Path:
        short = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="latency-")))
        logs = self._folder / f"{one_way_ms:g}"
        logs.mkdir()
        fleet = Fleet(logs, short, self.certificates)
        stack.callback(kill_all, fleet)
        fleet.start_router({USER: "operator"}, {"robot1": ["left"]})
        fleet.start_gateway({"left": self.gripper.socket_path})
        router, _colon, port = fleet.endpoint.rpartition(":")
        fleet.endpoint = f"{router}:{self._over(stack, int(port), one_way_ms)}"
        fleet.start_portal(USER, "operator", ["left"], TTL_S)
        fleet.gateway.until_says("can be reached")
        return fleet.socket_path()

    def _grpc(self, stack: contextlib.ExitStack) -> int:
        port = free_port()
        server = started("bench.fleet.grpc", port, self.certificates, self.gripper.socket_path)
        stack.callback(server.kill)
        assert server.stdin is not None
        server.stdin.write(json.dumps(self._memory()) + "\n")
        server.stdin.flush()
        said(server)
        return port

    def _memory(self) -> dict[str, str]:
        """Return answers as long as the daemon's."""
        state = self.local.call("state.get")
        short: dict[str, Any] = {"jsonrpc": "2.0", "id": 1234}
        answers = {
            "state": state,
            "motion": short | {"result": {"job": 1234}},
            "stop": short | {"result": {"level": "hold", "generation": 1234}},
        }
        return {kind: json.dumps(one, separators=(",", ":")) for kind, one in answers.items()}

    def _over(self, stack: contextlib.ExitStack, port: int, one_way_ms: float) -> int:
        """Return the port of a relay to a port; without a delay, that port."""
        if not one_way_ms:
            return port
        own = free_port()
        relay = started("bench.fleet.link", own, port, one_way_ms)
        stack.callback(relay.kill)
        said(relay)
        return own

    def until_ended(self, answer: bytes) -> None:
        """Wait for the end of the motion that was begun; the daemon has none of `gRPC, memory`."""
        self.local.call("job.wait", job=json.loads(answer)["result"]["job"])

    def clear(self, _answer: bytes) -> None:
        """Clear the stop."""
        self.local.result("stop.clear")


def free_port() -> int:
    with socket.socket() as found:
        found.bind((HOST, 0))
        return int(found.getsockname()[1])


def main() -> None:
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    delays = [float(ms) for ms in (sys.argv[2] if len(sys.argv) > 2 else "0,1,20").split(",")]
    seed = int(sys.argv[3]) if len(sys.argv) > 3 else 1
    print(f"{rounds} rounds, seed {seed}; ms, p50 and p99 of each")
    print(
        f"{'one way':>7}  {'':<22}{'state':>18}{'motion':>18}{'stop':>18}{'refused':>9}", flush=True
    )
    with tempfile.TemporaryDirectory(prefix="latency-") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        config = folder / "simulated.toml"
        config.write_text(SIMULATED, encoding="utf-8")
        gripper = stack.enter_context(
            daemon(folder / "left", f"latency-{os.getpid()}", "--config", str(config))
        )
        lab = Lab(stack, folder, gripper)
        for one_way_ms in delays:
            with contextlib.ExitStack() as link:
                ways = lab.ways(link, one_way_ms)
                ways.measure("state", rounds, seed, lambda _answer: None)
                ways.measure("motion", rounds, seed, lab.until_ended)
                ways.measure("stop", rounds, seed, lab.clear)
                print("\n".join(ways.rows(one_way_ms)), flush=True)


if __name__ == "__main__":
    main()
