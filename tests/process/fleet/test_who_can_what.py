"""Who can read, move and stop over a fleet, and whom he can keep from it: each cell is tried.

Others are those who use the gripper by op1's portal. The table stands in docs/fleet-security.md.
"""

import contextlib
import json
import os
import pwd
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path

import pytest
import zenoh

from litegrip_fleet.near.portal import MOST_STOP_CLIENTS
from litegrip_fleet.wire.messages import Ask, Reply, packed, unpacked
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.fleet.fleet_process import Fleet, reach
from tests.process.fleet.on_network import LEFT, answers, connected

PAGE = Path(__file__).parents[3] / "docs/fleet-security.md"
FLEET = {"users": {"op1": "operator", "op2": "operator", "viewer": "observer"}, "ttl_s": 2.0}
COLUMNS = ("read", "move", "stop", "keep others: reading", "moving", "stopping")

YES, NO = "yes", "no"
TABLE: Mapping[str, tuple[str, ...]] = {
    "the certificate of an observer": (YES, NO, YES, NO, YES, NO),
    "the certificate of an operator": (YES, YES, YES, NO, YES, NO),
    "a certificate without a row": (NO, NO, NO, NO, NO, NO),
    "no certificate": (NO, NO, NO, NO, NO, NO),
    "a shell beside the portal, in the group": (YES, YES, YES, YES, YES, NO),
    "a shell beside the portal, without the group": (NO, NO, NO, NO, NO, NO),
}
"""Who stops keeps all others from moving; who uses a portal may use up the sessions of its user."""

STOP = b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"hold"}}\n'
MOVE = (
    b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"wait":false,"speed_mm_s":10,'
    b'"if_busy":"replace"}}\n'
)
READ = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\n'
MANY = 80
"""More than the sessions of a gripper, and than the connections of a portal's socket."""


def until(found: Callable[[], bool], within_s: float = 3.0) -> bool:
    ends_s = time.monotonic() + within_s
    while not found():
        if time.monotonic() > ends_s:
            return False
    return True


class Network:
    """Somebody on the network with a certificate, perhaps without being let in."""

    def __init__(self, session: zenoh.Session, user: str, role: str) -> None:
        self._session, self._user, self._role = session, user, role
        self._count = 0
        self._heard = session.declare_subscriber(LEFT.to(user, "*"), zenoh.handlers.FifoChannel(64))

    def begins(self, role: str) -> str | None:
        """Begin a session; return its key, None if nobody answers or it is refused."""
        self._count += 1
        key = LEFT.rpc(self._user, f"s-{self._count}", role)
        for _ in range(2):  # who has just connected may not be heard at once
            found = answers(self._session, key, b"", packed(Ask("open", ttl_s=5.0)), within_s=0.7)
            if found:
                return None if unpacked(Reply, found[0].attached).gone else key
        return None

    def asks(self, role: str, line: bytes) -> bool:
        """Return True if a request is carried out."""
        if (key := self.begins(role)) is None:
            return False
        answers(self._session, key, line, packed(Ask("line", 1, at_s=time.monotonic())))

        def is_answered() -> bool:
            sample = self._heard.try_recv()
            return sample is not None and b'"result"' in sample.payload.to_bytes()

        done = until(is_answered)
        answers(self._session, key, b"", packed(Ask("close")))
        return done

    def reads(self) -> bool:
        return self.asks("observer", READ)

    def moves(self) -> bool:
        return any(self.asks(role, MOVE) for role in ("observer", "operator"))

    def stops(self) -> bool:
        return bool(answers(self._session, LEFT.stop(self._user), STOP))

    @contextlib.contextmanager
    def disturbing(self) -> Iterator[None]:
        """Take all sessions that there are, and stop again and again."""
        keys: list[str] = []
        while len(keys) < MANY and (key := self.begins(self._role)) is not None:
            keys.append(key)
        over, begun = threading.Event(), threading.Event()

        def act() -> None:
            nothing = zenoh.handlers.Callback(lambda _reply: None, lambda: None)
            while not over.is_set():
                answers(self._session, LEFT.stop(self._user), STOP, within_s=0.2)
                for key in keys:
                    live = packed(Ask("live"))
                    self._session.get(key, handler=nothing, attachment=live, timeout=1.0)
                begun.set()
                over.wait(0.05)

        thread = threading.Thread(target=act)
        thread.start()
        begun.wait(DEADLINE_S)
        try:
            yield
        finally:
            over.set()
            thread.join()
            for key in keys:
                answers(self._session, key, b"", packed(Ask("close")), within_s=0.3)


class Outside:
    """Somebody whom nobody lets in: what he tries fails."""

    def __init__(self, attempt: Callable[[], bool]) -> None:
        self._attempt = attempt

    def reads(self) -> bool:
        return self._attempt()

    moves = stops = reads

    @contextlib.contextmanager
    def disturbing(self) -> Iterator[None]:
        over = threading.Event()

        def act() -> None:
            while not over.is_set():
                self._attempt()
                over.wait(0.2)

        thread = threading.Thread(target=act)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


class Shell:
    """A shell whose user may open the portal's sockets."""

    def __init__(self, lab: Fleet) -> None:
        self._path = lab.socket_path()

    def asks(self, line: bytes) -> bool:
        with Client(self._path) as client:
            return "result" in client.raw(line)

    def reads(self) -> bool:
        return self.asks(READ)

    def moves(self) -> bool:
        return self.asks(MOVE)

    def stops(self) -> bool:
        return stopped_at(self._path)

    @contextlib.contextmanager
    def disturbing(self) -> Iterator[None]:
        with contextlib.ExitStack() as held:
            for _ in range(MANY):
                client = held.enter_context(Client(self._path))
                client.send("stop", level="hold")
                message = client.read()
                if "error" in message:
                    break
            for _ in range(MOST_STOP_CLIENTS + 6):
                idle = held.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
                idle.connect(str(self._path.with_suffix(".stop.sock")))
            yield


def stopped_at(path: Path) -> bool:
    """Return True if a stop by the portal's socket for stops is confirmed."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as connected_to:
        connected_to.settimeout(DEADLINE_S)
        connected_to.connect(str(path.with_suffix(".stop.sock")))
        connected_to.sendall(STOP)
        with connected_to.makefile("rb") as received:
            return "result" in json.loads(received.readline())


def by_nobody(path: Path) -> bool:
    """Return True if a user without groups can open a socket."""
    nobody, python = pwd.getpwnam("nobody"), shutil.which("python3", path="/usr/bin:/bin")
    if python is None:
        pytest.skip("there is no Python that every user may start")
    code = f"import socket; socket.socket(socket.AF_UNIX).connect({str(path)!r})"
    done = subprocess.run(
        [python, "-c", code],
        user=nobody.pw_uid,
        group=nobody.pw_gid,
        extra_groups=[],
        cwd="/",
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0 or "PermissionError" in done.stderr, done.stderr
    return done.returncode == 0


@contextlib.contextmanager
def acting(who: str, lab: Fleet) -> Iterator[Network | Outside | Shell]:
    certificates = {
        "the certificate of an observer": ("viewer", "observer"),
        "the certificate of an operator": ("op2", "operator"),
        "a certificate without a row": ("former", "operator"),
    }
    if who in certificates:
        name, role = certificates[who]
        with connected(lab, name) as session:
            yield Network(session, name, role)
    elif who == "no certificate":

        def is_let_in() -> bool:
            try:
                with connected(lab, None):
                    return True
            except zenoh.ZError:
                return False

        yield Outside(is_let_in)
    elif who == "a shell beside the portal, in the group":
        yield Shell(lab)
    else:
        if os.geteuid() != 0:
            pytest.skip("only root can act as another user")
        for folder in (lab.short, lab.runtime_directory(), lab.socket_path().parent):
            folder.chmod(0o755)
        paths = (lab.socket_path(), lab.socket_path().with_suffix(".stop.sock"))
        yield Outside(lambda: any(map(by_nobody, paths)))


def others_read(lab: Fleet) -> bool:
    with contextlib.suppress(BrokenPipeError), Client(lab.socket_path()) as client:
        client.send("state.get")
        return "result" in client.read()
    return False


@pytest.mark.parametrize("who", TABLE)
def test_each_cell_is_as_the_table_says(lab: Fleet, gripper: DaemonProcess, who: str) -> None:
    def motions() -> int:
        return sum(job["kind"] == "open" for job in local.result("job.list")["jobs"])

    def does(action: Callable[[], bool]) -> str:
        """Let the motor be enabled and nothing latched, then try."""
        local.result("stop", level="hold")  # whatever moves ends
        local.result("stop.clear")
        local.despite_silence("motor.enable")
        return YES if action() else NO

    def other_moves() -> bool:
        """Try; the portal may not have heard of the last clearing yet, nor the motor be there."""
        answer = other.call("motion.open", wait=False, speed_mm_s=10)
        if "result" not in answer:
            local.call("motor.enable")
        return "result" in answer

    with gripper.connect() as local, acting(who, lab) as somebody, reach(lab) as other:
        local.enabled()
        row = [does(somebody.reads)]
        before = motions()
        tried = does(somebody.moves)
        if tried != TABLE[who][1]:  # on a busy machine the motor may just have fallen silent
            tried = does(somebody.moves)
        row.append(tried)
        assert (motions() > before) == (row[-1] == YES)
        row.append(does(somebody.stops))
        assert (local.result("state.get")["stop"] is not None) == (row[-1] == YES)
        does(lambda: True)
        with somebody.disturbing():
            keeps = [NO if others_read(lab) else YES]
            keeps.append(NO if until(other_moves) else YES)
            keeps.append(NO if stopped_at(lab.socket_path()) else YES)
        row += keeps
    print(who, row)
    assert tuple(row) == TABLE[who]


def test_nobody_can_keep_others_from_stopping() -> None:
    assert {row[COLUMNS.index("stopping")] for row in TABLE.values()} == {NO}


def test_the_page_has_this_table() -> None:
    lines = [f"| with | {' | '.join(COLUMNS)} |", "| --- " * (1 + len(COLUMNS)) + "|"]
    lines += [f"| {who} | {' | '.join(row)} |" for who, row in TABLE.items()]
    assert "\n".join(lines) in PAGE.read_text(encoding="utf-8")
