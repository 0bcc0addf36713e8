"""Plain gRPC with TLS both ways, to compare the fleet with; needs `pip install grpcio`.

python -m bench.fleet.grpc PORT CERTIFICATES DAEMON_SOCKET

A Python server whose `/memory/...` answer from memory, and whose `/daemon/request` and
`/daemon/stop` pass each call on to a daemon's sockets. It has no signs of life, no ages, no roles,
and it sends nothing twice.
"""

import json
import sys
import threading
from collections.abc import Callable
from concurrent import futures
from pathlib import Path

import grpc

from bench.hostile.raw_connection import Connection
from tests.process.fleet.fleet_process import HOST

KINDS = ("state", "motion", "stop")
WORKERS = 4


class Forwarding:
    """Passes calls on to a daemon; each thread of the server has connections of its own."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._own = threading.local()

    def request(self, line: bytes, _context: object) -> bytes:
        return self._asked("request", self._path, line)

    def stop(self, line: bytes, _context: object) -> bytes:
        return self._asked("stop", self._path.with_suffix(".stop.sock"), line)

    def _asked(self, name: str, path: Path, line: bytes) -> bytes:
        connection: Connection | None = getattr(self._own, name, None)
        if connection is None:
            connection = Connection(path)
            setattr(self._own, name, connection)
        connection.send(line)
        identity = json.loads(line)["id"]
        while (answer := connection.line()) and json.loads(answer).get("id") != identity:
            pass
        return answer


def serve(port: int, certificates: Path, path: Path) -> None:
    """Serve until the process is ended; the first line of standard input has what memory has."""
    memory = json.loads(sys.stdin.readline())
    forwarding = Forwarding(path)
    handlers: dict[str, dict[str, Callable[[bytes, object], bytes]]] = {
        "memory": {kind: _constant(memory[kind].encode()) for kind in KINDS},
        "daemon": {"request": forwarding.request, "stop": forwarding.stop},
    }
    server = grpc.server(futures.ThreadPoolExecutor(WORKERS))
    for service, methods in handlers.items():
        rpcs = {name: grpc.unary_unary_rpc_method_handler(take) for name, take in methods.items()}
        server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler(service, rpcs),))
    own = certificates / HOST
    credentials = grpc.ssl_server_credentials(
        [((own / "own.key").read_bytes(), (own / "own.pem").read_bytes())],
        (own / "ca.pem").read_bytes(),
        require_client_auth=True,
    )
    server.add_secure_port(f"{HOST}:{port}", credentials)
    server.start()
    print("listening", flush=True)
    server.wait_for_termination()


def _constant(answer: bytes) -> Callable[[bytes, object], bytes]:
    return lambda _line, _context: answer


def channel(port: int, certificates: Path, user: str) -> "grpc.Channel":
    """Return a channel to such a server, as a user."""
    own = certificates / user
    credentials = grpc.ssl_channel_credentials(
        (own / "ca.pem").read_bytes(),
        (own / "own.key").read_bytes(),
        (own / "own.pem").read_bytes(),
    )
    return grpc.secure_channel(f"{HOST}:{port}", credentials)


if __name__ == "__main__":
    serve(int(sys.argv[1]), Path(sys.argv[2]), Path(sys.argv[3]))
