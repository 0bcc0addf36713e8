"""One read of the state by what a user would pick instead, beside the daemon: alternating, one run.

python -m bench.timing.rivals [ROUNDS, default 30]

Each rival is a process of its own that does nothing else, at a Unix socket, and serves one
dictionary as its documentation shows it; the daemon answers beside its 200 ticks a second. All
hand out the same: a dictionary. What is not installed is left out and named; `make bench` installs
them.
"""

import asyncio
import contextlib
import http.client
import importlib.util
import json
import multiprocessing.connection
import platform
import select
import socket
import statistics
import sys
import tempfile
from collections.abc import Callable
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path
from typing import Any

from bench.__main__ import call, run_module, wait_for
from bench.timing.reads import raw, timed, ways

Read = Callable[[], object]


@dataclass(frozen=True, slots=True)
class Rival:
    """How one of them serves a dictionary at a path, and what reads it there."""

    name: str
    serve: Callable[[Path, dict[str, Any]], None]
    reader: Callable[[Path], Read]
    packages: tuple[str, ...] = ()

    @property
    def version(self) -> str:
        """What is installed of it."""
        found = " ".join(metadata.version(package) for package in self.packages)
        return found or f"Python {platform.python_version()}"

    @property
    def is_there(self) -> bool:
        """True if its packages can be imported."""
        return all(importlib.util.find_spec(_MODULES[one]) is not None for one in self.packages)


_MODULES = {
    "grpcio": "grpc",
    "fastapi": "fastapi",
    "uvicorn": "uvicorn",
    "Pyro5": "Pyro5",
    "rpyc": "rpyc",
}


def _answer(line: bytes, state: dict[str, Any]) -> bytes:
    request = json.loads(line)
    return json.dumps({"jsonrpc": "2.0", "id": request["id"], "result": state}).encode() + b"\n"


def serve_epoll(path: Path, state: dict[str, Any]) -> None:
    """Answer lines of JSON from a loop that is written by hand."""
    listener = socket.socket(socket.AF_UNIX)
    listener.bind(str(path))
    listener.listen()
    epoll, peers = select.epoll(), dict[int, socket.socket]()
    epoll.register(listener.fileno(), select.EPOLLIN)
    while True:
        for number, _mask in epoll.poll():
            if number == listener.fileno():
                peer, _ = listener.accept()
                peers[peer.fileno()] = peer
                epoll.register(peer.fileno(), select.EPOLLIN)
            elif line := peers[number].recv(65536):
                peers[number].sendall(_answer(line, state))
            else:
                epoll.unregister(number)
                peers.pop(number).close()


def serve_asyncio(path: Path, state: dict[str, Any]) -> None:
    """Answer lines of JSON by asyncio's streams."""

    async def take(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        while line := await reader.readline():
            writer.write(_answer(line, state))

    async def serve() -> None:
        server = await asyncio.start_unix_server(take, path)
        await server.serve_forever()

    asyncio.run(serve())


def read_lines(path: Path) -> Read:
    """Exchange lines, and read the JSON."""
    exchange = raw(path)
    return lambda: json.loads(exchange())["result"]


def serve_multiprocessing(path: Path, state: dict[str, Any]) -> None:
    """Answer by `multiprocessing.connection`, which pickles."""
    with multiprocessing.connection.Listener(str(path), "AF_UNIX") as listener:
        while True:
            with contextlib.suppress(EOFError), listener.accept() as peer:
                while True:
                    peer.recv()
                    peer.send(state)


def read_multiprocessing(path: Path) -> Read:
    """Ask by `multiprocessing.connection`."""
    peer = multiprocessing.connection.Client(str(path), "AF_UNIX")

    def read() -> object:
        peer.send("state")
        return peer.recv()

    return read


def serve_grpc(path: Path, state: dict[str, Any]) -> None:
    """Answer by gRPC, with JSON in its messages."""
    from concurrent import futures  # noqa: PLC0415 - of this rival alone

    import grpc  # noqa: PLC0415

    def get(_request: bytes, _context: object) -> bytes:
        return json.dumps(state).encode()

    server = grpc.server(futures.ThreadPoolExecutor(4))
    methods = {"Get": grpc.unary_unary_rpc_method_handler(get)}
    server.add_generic_rpc_handlers((grpc.method_handlers_generic_handler("State", methods),))
    server.add_insecure_port(f"unix:{path}")
    server.start()
    server.wait_for_termination()


def read_grpc(path: Path) -> Read:
    """Ask by gRPC."""
    import grpc  # noqa: PLC0415

    get = grpc.insecure_channel(f"unix:{path}").unary_unary("/State/Get")
    return lambda: json.loads(get(b""))


def serve_fastapi(path: Path, state: dict[str, Any]) -> None:
    """Answer by FastAPI under uvicorn."""
    import fastapi  # noqa: PLC0415
    import uvicorn  # noqa: PLC0415

    app = fastapi.FastAPI()

    async def get() -> dict[str, Any]:
        return state

    app.add_api_route("/state", get)
    uvicorn.run(app, uds=str(path), log_level="error")


def read_http(path: Path) -> Read:
    """Ask by HTTP, over one connection."""
    connection = http.client.HTTPConnection("localhost")
    connection.sock = socket.socket(socket.AF_UNIX)
    connection.sock.connect(str(path))

    def read() -> object:
        connection.request("GET", "/state")
        return json.loads(connection.getresponse().read())

    return read


def serve_pyro(path: Path, state: dict[str, Any]) -> None:
    """Answer by Pyro5."""
    import Pyro5.api  # noqa: PLC0415

    class Holder:
        def get(self) -> dict[str, Any]:
            return state

    with Pyro5.api.Daemon(unixsocket=str(path)) as daemon:
        daemon.register(Pyro5.api.expose(Holder)(), "state")
        daemon.requestLoop()


def read_pyro(path: Path) -> Read:
    """Ask by Pyro5."""
    import Pyro5.api  # noqa: PLC0415

    proxy = Pyro5.api.Proxy(f"PYRO:state@./u:{path}")
    return lambda: proxy.get()  # noqa: PLW0108 - asks once by itself, if it is looked up


def serve_rpyc(path: Path, state: dict[str, Any]) -> None:
    """Answer by RPyC, with JSON: a dictionary of its own would be fetched entry by entry."""
    import rpyc  # noqa: PLC0415
    from rpyc.utils.server import ThreadedServer  # noqa: PLC0415

    class Holder(rpyc.Service):  # type: ignore[misc]  # it has no types
        def exposed_get(self) -> str:
            return json.dumps(state)

    ThreadedServer(Holder, socket_path=str(path)).start()


def read_rpyc(path: Path) -> Read:
    """Ask by RPyC."""
    from rpyc.utils.factory import unix_connect  # noqa: PLC0415

    root = unix_connect(str(path)).root
    return lambda: json.loads(root.get())


RIVALS = (
    Rival("an epoll loop and JSON", serve_epoll, read_lines),
    Rival("asyncio's streams and JSON", serve_asyncio, read_lines),
    Rival("multiprocessing.connection", serve_multiprocessing, read_multiprocessing),
    Rival("gRPC", serve_grpc, read_grpc, ("grpcio",)),
    Rival("RPyC", serve_rpyc, read_rpyc, ("rpyc",)),
    Rival("Pyro5", serve_pyro, read_pyro, ("Pyro5",)),
    Rival("FastAPI, uvicorn", serve_fastapi, read_http, ("fastapi", "uvicorn")),
)


def measure(rounds: int) -> dict[str, list[float]]:
    """Return the median of each round, in seconds, by what has read, all in turn."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        reads = ways(folder, stack)
        state = call(folder / "bench.sock", "state.get")["result"]
        (folder / "state.json").write_text(json.dumps(state), encoding="utf-8")
        for number, rival in enumerate(RIVALS):
            if not rival.is_there:
                continue
            path = folder / f"{number}.sock"
            serving = run_module("bench.timing.rivals", "--serve", number, path)
            stack.callback(serving.kill)
            wait_for(path)
            read = rival.reader(path)
            if read() != state:
                raise RuntimeError(f"{rival.name} does not hand out the state")
            reads[rival.name] = lambda read=read: timed(read)  # type: ignore[misc]
        seen: dict[str, list[float]] = {what: [] for what in reads}
        for _ in range(rounds):
            for what, run in reads.items():
                seen[what].append(statistics.median(run()))
    return seen


def main() -> None:
    if sys.argv[1:2] == ["--serve"]:
        path = Path(sys.argv[3])
        state = json.loads((path.parent / "state.json").read_text(encoding="utf-8"))
        RIVALS[int(sys.argv[2])].serve(path, state)
    rounds = int(sys.argv[1]) if len(sys.argv) > 1 else 30
    seen = measure(rounds)
    daemon = seen["raw lines and json.loads"]
    print(f"{rounds} rounds, all in turn: µs, and times the daemon's raw lines with json.loads")
    for what, medians in seen.items():
        ratio = statistics.median(one / own for one, own in zip(medians, daemon, strict=True))
        print(f"{statistics.median(medians) * 1e6:8.1f}  {ratio:6.2f} x  {what}")
    for rival in RIVALS:
        print(f"{rival.name}: {rival.version if rival.is_there else 'not installed'}")


if __name__ == "__main__":
    main()
