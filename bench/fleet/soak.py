"""Memory of gateway, portal and router over many reconnects, of clients and of the network.

python -m bench.fleet.soak [MINUTES, default 60] [SEED, default 1] [CLIENTS A SECOND, default 5]

Two fleets with certificates, each with a router, a gateway and a portal, before grippers of
`bench.fleet.standin`. Clients connect through the portals, ask, sometimes subscribe, and close or
are killed. Every 20 s something breaks: in the first fleet the TCP connection of the portal or of
the gateway (by `bench.fleet.link`), or a second gateway, which is killed and started again; in the
second fleet the router, which is killed and started again. The parts of the table live from the
begin to the end. `kB per 1000` is the slope of the resident memory, by least squares, after the
first sixth of the time; `halves` are the means of the second and of the last third.
"""

import contextlib
import json
import os
import random
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from bench.fleet.recorded import record
from bench.fleet.scale import kill_all
from bench.fleet.standin import name_of
from bench.fleet.usage import Usage, slope, usage_of
from tests.process.fleet.fleet_process import HOST, SITE, Fleet, Part, make_certificates

BREAK_EVERY_S = 20.0
SAMPLE_EVERY_S = 10.0
PRINT_EVERY_S = 300.0
CLIENT_WITHIN_S = 15.0
USER, TTL_S = "op1", 1.0

ENDS = {
    "closes": 35,
    "killed": 35,
    "subscribed, closes": 10,
    "subscribed, killed": 10,
    "killed at once": 10,
    "stays": 2,
}
"""How a client ends, by how often."""

STAYS_S = 30.0
"""So long such a client reads samples, if nothing breaks meanwhile."""

DONE, UNREACHABLE, HUNG = 0, 3, 4


def client(path: Path, end: str) -> int:
    """Be a client, and end as is said; return how it went, unless this process is killed."""
    try:
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connected:
            connected.settimeout(CLIENT_WITHIN_S)
            connected.connect(str(path))
            connected.sendall(_request("hello", client="soak"))
            if end == "killed at once":
                os.kill(os.getpid(), signal.SIGKILL)
            lines = connected.makefile("rb")
            asked = [lines.readline()]
            connected.sendall(_request("state.get"))
            asked.append(lines.readline())
            if end.startswith("subscribed") or end == "stays":
                connected.sendall(_request("state.subscribe", hz=20))
                asked += [lines.readline() for _ in range(4)]
            leaves_s = time.monotonic() + (STAYS_S if end == "stays" else 0.0)
            while asked[-1] and time.monotonic() < leaves_s:
                asked.append(lines.readline())
            if not all(asked) or any(b'"unreachable"' in line for line in asked):
                return UNREACHABLE
            if end.endswith("killed"):
                os.kill(os.getpid(), signal.SIGKILL)
            return DONE
    except (ConnectionError, FileNotFoundError):
        return UNREACHABLE
    except TimeoutError:
        return HUNG


def _request(method: str, **params: object) -> bytes:
    request = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
    return json.dumps(request).encode() + b"\n"


@dataclass
class Watched:
    """A part that lives throughout, and what was seen of it, by the counts of reconnects."""

    pid: int
    links: Counter[str]
    broken_by: tuple[str, ...]
    """The kinds of breaks that this part notices."""
    points: list[tuple[int, int, Usage]] = field(default_factory=list)
    """Clients so far, breaks so far, and what it used."""

    def look(self, clients: int) -> None:
        breaks = sum(self.links[kind] for kind in self.broken_by)
        self.points.append((clients, breaks, usage_of(self.pid)))


class Soak:
    """The two fleets, what breaks in them, and the clients; one process in a fork for each."""

    def __init__(self, folder: Path, stack: contextlib.ExitStack, seed: int) -> None:
        self.random = random.Random(seed)
        self.breaks: Counter[str] = Counter()
        self.outcomes: Counter[str] = Counter()
        self._running: dict[int, tuple[str, float]] = {}
        self._stack = stack
        self._folder = folder
        self._certificates = make_certificates(
            folder / "tls", HOST, f"user:{USER}", "gateway:robot1"
        )
        recorded = folder / "recorded.json"
        record(recorded)
        standins = folder / "standins"
        standins.mkdir()
        self._started("bench.fleet.standin", str(recorded), str(standins), "3")
        self._sockets = [standins / f"{name_of(index)}.sock" for index in range(3)]
        lasting, second, other = self._sockets
        self.watched: dict[str, Watched] = {}
        self.kinds: dict[str, Callable[[], None]] = {}
        self.paths = self._first_fleet(lasting, second) + self._second_fleet(other)

    def _first_fleet(self, lasting: Path, second: Path) -> list[Path]:
        fleet = self._fleet("first")
        fleet.start_router({USER: "operator"}, {"robot1": ["left", "right"]})
        router = fleet.endpoint
        fleet.endpoint, cut_gateway = self._link(router)
        fleet.start_gateway({"left": lasting})
        fleet.endpoint, cut_portal = self._link(router)
        fleet.start_portal(USER, "operator", ["left", "right"], TTL_S)
        fleet.endpoint = router
        killed = self._second_gateway(fleet, second)
        kinds = ("portal's link", "gateway's link", "gateway killed")
        self.kinds |= dict(zip(kinds, (cut_portal, cut_gateway, killed.restart), strict=True))
        self._watch("router", fleet.router, *kinds)
        self._watch("gateway, link cut", fleet.gateway, "gateway's link")
        self._watch("portal, link cut", fleet.portal, "portal's link")
        return [fleet.socket_path(name) for name in ("left", "right")]

    def _second_fleet(self, path: Path) -> list[Path]:
        fleet = self._fleet("second")
        fleet.start_router({USER: "operator"}, {"robot1": ["left"]})
        fleet.start_gateway({"left": path})
        fleet.start_portal(USER, "operator", ["left"], TTL_S)
        self.kinds["router killed"] = fleet.router.restart
        self._watch("gateway, router killed", fleet.gateway, "router killed")
        self._watch("portal, router killed", fleet.portal, "router killed")
        return [fleet.socket_path("left")]

    def _fleet(self, name: str) -> Fleet:
        short = Path(self._stack.enter_context(tempfile.TemporaryDirectory(prefix="soak-")))
        folder = self._folder / name
        folder.mkdir()
        made = Fleet(folder, short, self._certificates)
        self._stack.callback(kill_all, made)
        return made

    def _second_gateway(self, fleet: Fleet, path: Path) -> Part:
        """Start another gateway of the same machine, whose daemon's channel is `right`."""
        for ending in (".sock", ".stop.sock"):
            link = fleet.short / "litegripd" / f"right{ending}"
            link.symlink_to(path.with_suffix(ending))
        config = fleet.network("robot1", [fleet.endpoint])
        config += f'[gateway]\nsite = "{SITE}"\ngrippers = {{ right = "right" }}\n'
        folder = self._folder / "right"
        part = Part(folder, "gateway", "gateway", config, XDG_RUNTIME_DIR=str(fleet.short))
        self._stack.callback(part.kill)
        return part

    def _watch(self, name: str, part: Part, *broken_by: str) -> None:
        self.watched[name] = Watched(part.process.pid, self.breaks, broken_by)

    def _link(self, endpoint: str) -> tuple[str, Callable[[], None]]:
        """Start a relay to a router; return its endpoint, and what cuts it."""
        port = free_port()
        relay = self._started("bench.fleet.link", str(port), endpoint.rpartition(":")[2], "0")
        return f"tls/{HOST}:{port}", lambda: relay.send_signal(signal.SIGUSR1)

    def _started(self, module: str, *arguments: str) -> "subprocess.Popen[bytes]":
        command = [sys.executable, "-m", module, *arguments]
        process = subprocess.Popen(command, stdout=subprocess.PIPE)
        self._stack.callback(process.kill)
        assert process.stdout is not None
        if process.stdout.readline() != b"listening\n":
            raise RuntimeError(f"{module} does not start")
        return process

    def break_something(self) -> None:
        kind = self.random.choice(sorted(self.kinds))
        self.kinds[kind]()
        self.breaks[kind] += 1

    def start_client(self) -> None:
        path = self.random.choice(self.paths)
        end = self.random.choices(list(ENDS), list(ENDS.values()))[0]
        pid = os.fork()
        if pid == 0:
            code = HUNG
            try:
                code = client(path, end)
            finally:
                os._exit(code)
        self._running[pid] = (end, time.monotonic())

    def reap(self) -> None:
        """Count how the clients that have ended did."""
        while self._running:
            pid, status = os.waitpid(-1, os.WNOHANG)
            if pid == 0:
                return
            if pid not in self._running:
                continue  # a part that was killed; its own Popen finds it gone
            end, _begun_s = self._running.pop(pid)
            code = os.waitstatus_to_exitcode(status)
            names = {DONE: end, UNREACHABLE: "unreachable", HUNG: "HUNG", -9: end}
            self.outcomes[names.get(code, f"FAILED with {code}")] += 1

    @property
    def clients(self) -> int:
        return sum(self.outcomes.values())

    def look(self) -> None:
        for watched in self.watched.values():
            watched.look(self.clients)


def free_port() -> int:
    with socket.socket() as found:
        found.bind((HOST, 0))
        return int(found.getsockname()[1])


def run(soak: Soak, seconds: float, clients_s: float) -> None:
    """Let clients come and things break until the time is up."""
    begun_s = time.monotonic()
    due = {"client": begun_s, "break": begun_s + BREAK_EVERY_S}
    due |= {"look": begun_s + SAMPLE_EVERY_S, "print": begun_s}
    while (now_s := time.monotonic()) < begun_s + seconds:
        soak.reap()
        if now_s >= due["client"]:
            soak.start_client()
            due["client"] += soak.random.expovariate(clients_s)
        if now_s >= due["break"]:
            soak.break_something()
            due["break"] += BREAK_EVERY_S
        if now_s >= due["look"]:
            soak.look()
            due["look"] += SAMPLE_EVERY_S
        if now_s >= due["print"]:
            print(_progress(soak, now_s - begun_s), flush=True)
            due["print"] += PRINT_EVERY_S
        time.sleep(max(0.0, min(0.05, min(due.values()) - time.monotonic())))


def _progress(soak: Soak, at_s: float) -> str:
    used = {name: usage_of(watched.pid) for name, watched in soak.watched.items()}
    cells = ", ".join(
        f"{name}: {use.resident_kb / 1024:.1f} MB, {use.descriptors} fds, {use.threads} threads"
        for name, use in used.items()
    )
    return (
        f"{at_s / 60:.0f} min, {soak.clients} clients, {sum(soak.breaks.values())} breaks; {cells}"
    )


def report(soak: Soak) -> list[str]:
    """Return the table."""
    rows = [
        f"clients: {soak.clients}; {_counts(soak.outcomes)}",
        f"breaks: {sum(soak.breaks.values())}; {_counts(soak.breaks)}",
        (
            f"{'':<24}{'MB begin':>9}{'end':>7}{'thirds: 2nd':>13}{'3rd':>7}{'kB per 1000':>13}"
            f"{'breaks':>8}{'kB per 100':>12}{'fds':>10}{'threads':>10}{'CPU s':>8}"
        ),
        f"{'':<60}{'clients':>13}{'':>8}{'breaks':>12}",
    ]
    return rows + [_row(name, watched.points) for name, watched in soak.watched.items()]


def _row(name: str, points: list[tuple[int, int, Usage]]) -> str:
    warm = points[len(points) // 6 :]
    third = len(points) // 3
    means = [
        sum(use.resident_kb for *_counts, use in some) / max(1, len(some)) / 1024
        for some in (points[third : 2 * third], points[2 * third :])
    ]
    by_clients = slope([(clients, use.resident_kb) for clients, _breaks, use in warm]) * 1000
    by_breaks = slope([(breaks, use.resident_kb) for _clients, breaks, use in warm]) * 100
    first, last = points[0][2], points[-1][2]
    return (
        f"{name:<24}{first.resident_kb / 1024:>9.1f}{last.resident_kb / 1024:>7.1f}"
        f"{means[0]:>13.2f}{means[1]:>7.2f}{by_clients:>13.1f}{points[-1][1]:>8}{by_breaks:>12.1f}"
        f"{f'{first.descriptors}-{last.descriptors}':>10}{f'{first.threads}-{last.threads}':>10}"
        f"{last.cpu_s:>8.1f}"
    )


def _counts(counter: Counter[str]) -> str:
    return ", ".join(f"{name} {count}" for name, count in counter.most_common())


def main() -> int:
    minutes = float(sys.argv[1]) if len(sys.argv) > 1 else 60.0
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    clients_s = float(sys.argv[3]) if len(sys.argv) > 3 else 5.0
    print(f"{minutes:g} min, seed {seed}, {clients_s:g} clients a second", flush=True)
    with tempfile.TemporaryDirectory(prefix="soak-") as name, contextlib.ExitStack() as stack:
        soak = Soak(Path(name), stack, seed)
        run(soak, minutes * 60.0, clients_s)
        print("\n".join(report(soak)))
    bad = [outcome for outcome in soak.outcomes if outcome == "HUNG" or "FAILED" in outcome]
    return 1 if bad else 0


if __name__ == "__main__":
    sys.exit(main())
