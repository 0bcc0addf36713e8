"""What somebody with a certificate can send by hand: nonsense by the thousand, and all again.

LITEGRIPD_FLEET_MESSAGES sets another number of messages, for a long run; LITEGRIPD_FUZZ_SEED
another seed.
"""

import asyncio
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
import zenoh

from bench.hostile.clients import OTHERS_RIGHT
from bench.hostile.lines import HostileLines
from bench.hostile.polite import Polite
from litegrip_fleet.far.gateway import MOST_ASKED_ABOUT
from litegrip_fleet.wire.lateness import MOTION_COUNTS_S, STOP_WITHIN_S
from litegrip_fleet.wire.messages import LONGEST_BYTES, VERSION, Ask, Reply, packed, unpacked
from litegrip_fleet.wire.network import Answered, ask, the_newest
from litegrip_fleet.wire.site import look
from litegripd.app.build import METHODS
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.fleet.fleet_process import Fleet, Part, fleet
from tests.process.fleet.on_network import LEFT, answers, connected

MESSAGES = int(os.environ.get("LITEGRIPD_FLEET_MESSAGES", "3000"))
SEED = int(os.environ.get("LITEGRIPD_FUZZ_SEED", "1"))
UNANSWERED = 200
"""So many at once: the gateway's queue stays full, and nothing is sent into the blue."""

MOST_GROWTH_MB = 64.0
"""Of a process; a hundred thousand messages that are kept would be more."""

ODD: tuple[object, ...] = (
    None,
    True,
    -1,
    2**60,
    1e308,
    float("inf"),
    "x" * 65,
    "\x00",
    [[]] * 9,
    {"a": {}},
    "line",
)


@pytest.fixture
def lab(tmp_path: Path, certificates: Path, gripper: DaemonProcess) -> Iterator[Fleet]:
    """A fleet for each test: what one has sent may still be on its way."""
    sockets, users = {"left": gripper.socket_path}, {"op1": "operator", "viewer": "observer"}
    with fleet(tmp_path / "fleet", certificates, sockets, users=users) as running:
        yield running


class HostileMessages:
    """Messages from nearly right to nonsense, for a few sessions of one user."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        methods = [method for method in METHODS if method.name not in OTHERS_RIGHT]
        self._lines = HostileLines(chance, methods)

    def message(self) -> tuple[str, bytes, bytes]:
        """Return a key, what is attached, and the payload."""
        chance = self._chance
        session = f"s-{chance.randrange(8)}"
        key = LEFT.rpc("op1", session, chance.choice(("operator", "observer")))
        if chance.random() < 0.02:
            key = chance.choice((LEFT.about, f"{key}/more", f"{LEFT.key}/rpc/op1/{session}/none"))
        return key, self._attached(), self._lines.line()

    def _attached(self) -> bytes:
        chance = self._chance
        right = packed(self._ask())
        kind = chance.randrange(6)
        if kind == 0:
            return chance.randbytes(chance.choice((0, 1, 40, LONGEST_BYTES, LONGEST_BYTES + 1)))
        if kind == 1:
            return b"[" * chance.choice((500, LONGEST_BYTES))
        if kind == 2:
            at = chance.randrange(len(right))
            return right[:at] + chance.randbytes(1) + right[at + 1 :]
        if kind == 3:
            return right[: chance.randrange(len(right))]
        if kind == 4:
            members = {"v": VERSION, **asdict(self._ask())}
            members[chance.choice(list(members))] = chance.choice(ODD)
            return json.dumps(members).encode()
        return right

    def _ask(self) -> Ask:
        chance = self._chance
        return Ask(
            chance.choice(("open", "line", "line", "line", "eof", "live", "close")),
            chance.randrange(6),
            chance.choice((0, 1, 2**40)),
            chance.random() < 0.5,
            chance.choice((None, 0.0, time.monotonic(), 1e9)),
            chance.choice((None, 0, 2**40)),
            chance.choice((None, 0.0, 1.0, 1e9)),
            chance.choice((None, "x", "")),
        )


def send(session: zenoh.Session, count: int) -> None:
    """Send so many hostile messages, as quickly as they are answered or dropped."""
    hostile, room = HostileMessages(random.Random(SEED)), threading.Semaphore(UNANSWERED)
    done = zenoh.handlers.Callback(lambda _reply: None, room.release)
    for _ in range(count):
        assert room.acquire(timeout=DEADLINE_S), "nothing is answered any more"
        key, attached, payload = hostile.message()
        session.get(key, handler=done, payload=payload, attachment=attached, timeout=2.0)
    for _ in range(UNANSWERED):
        assert room.acquire(timeout=DEADLINE_S)


def memory_mb(part: Part) -> float:
    status = Path(f"/proc/{part.process.pid}/status").read_text("ascii")
    (line,) = (line for line in status.splitlines() if line.startswith("VmRSS"))
    return int(line.split()[1]) / 1024.0


@pytest.mark.timeout(120 + MESSAGES // 25)
def test_hostile_messages_harm_nobody(lab: Fleet, gripper: DaemonProcess) -> None:
    """A client that behaves well is served beside them all the time, and moves."""
    with gripper.connect() as local:
        local.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        before = len(local.result("clients.list")["clients"])
        parts = (lab.gateway, lab.router)
        sizes_mb = [memory_mb(part) for part in parts]
        over = threading.Event()
        begun_s = time.monotonic()
        with (
            connected(lab, "op1") as session,
            Polite(lab.socket_path()) as polite,
            ThreadPoolExecutor(1) as aside,
        ):
            served = aside.submit(polite.work, over.is_set)
            try:
                send(session, MESSAGES)
            finally:
                over.set()
            served.result(DEADLINE_S)
            took_s = time.monotonic() - begun_s
            print(
                f"{MESSAGES} messages in {took_s:.0f} s; {len(polite.latencies_s)} reads beside,"
                f" the slowest in {max(polite.latencies_s) * 1e3:.0f} ms, {polite.motions} motions"
            )
            assert polite.motions > 0
        local.until(lambda _state: len(local.result("clients.list")["clients"]) == before)
        health = local.result("health")
        assert health["control"]["tick_errors"] == 0
        assert not [reason for reason in health["reasons"] if "defect" in reason]
        for part, size_mb in zip(parts, sizes_mb, strict=True):
            print(f"{part.kind}: {size_mb:.1f} MB before, {memory_mb(part):.1f} MB after")
            assert memory_mb(part) - size_mb < MOST_GROWTH_MB
            assert part.process.poll() is None
            assert "Traceback" not in part.log


def test_a_message_of_a_megabyte_is_not_taken_and_the_others_go_on(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    with Client(lab.socket_path()) as client:
        client.result("hello")
        with connected(lab, "op1") as session:
            big = b"x" * 1024 * 1024
            key = LEFT.rpc("op1", "s-9", "operator")
            assert answers(session, key, big, packed(Ask("open"))) == []
        assert client.result("state.get")["stop"] is None
    for part in (lab.gateway, lab.router):
        assert part.process.poll() is None
        assert "Traceback" not in part.log


# Again --------------------------------------------------------------------------------------------

OPEN = b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"wait":false,"speed_mm_s":10}}\n'


def reply_to(session: zenoh.Session, name: str, ask: Ask, payload: bytes = b"") -> Reply:
    """Send a message of a session until it is answered: who has just connected may not be heard."""
    key, ends_s = LEFT.rpc("op1", name, "operator"), time.monotonic() + DEADLINE_S
    while not (found := answers(session, key, payload, packed(ask))):
        assert time.monotonic() < ends_s
    return unpacked(Reply, found[0].attached)


def answer_to(
    session: zenoh.Session, name: str, heard: "zenoh.Subscriber[Any]", number: int
) -> dict[str, Any]:
    """Return the answer to a request that the gateway has sent, asking for it again and again."""
    ends_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < ends_s:
        sample = heard.try_recv()
        if sample is None:
            reply_to(session, name, Ask("live", again=True))
            continue
        message: dict[str, Any] = json.loads(sample.payload.to_bytes())
        if message.get("id") == number:
            return message
    raise AssertionError(f"no answer to {number}")


def motions(local: Client) -> int:
    """Count the motions that there were."""
    return len(local.result("job.list")["jobs"])


def test_a_message_that_is_repeated_moves_nothing_twice(lab: Fleet, gripper: DaemonProcess) -> None:
    with gripper.connect() as local, connected(lab, "op1") as session:
        local.enabled()
        before = motions(local)
        begun = reply_to(session, "s-1", Ask("open", ttl_s=5.0))
        assert begun.about is not None
        motion = Ask("line", 1, at_s=begun.now_s + 0.3)  # it counts, even if this machine is busy
        for _ in range(3):
            assert reply_to(session, "s-1", motion, OPEN).took == 1
        # What the daemon has been asked before this line, it has done by its answer.
        heard = session.declare_subscriber(LEFT.to("op1", "s-1"), the_newest())
        asked = b'{"jsonrpc":"2.0","id":2,"method":"state.get"}\n'
        assert reply_to(session, "s-1", Ask("line", 2), asked).took == 2
        assert "result" in answer_to(session, "s-1", heard, 2)
        assert motions(local) == before + 1
        reply_to(session, "s-1", Ask("close"))
        gone = reply_to(session, "s-1", motion, OPEN).gone
        assert gone is not None
        assert gone["data"]["reason"] == "unreachable"
        assert motions(local) == before + 1


@pytest.mark.parametrize("name", ["s-1", "s-2"], ids=["its own", "a new one"])
def test_a_captured_motion_in_a_session_that_begins_later_is_too_late(
    lab: Fleet, gripper: DaemonProcess, name: str
) -> None:
    with gripper.connect() as local, connected(lab, "op1") as session:
        begun = reply_to(session, "s-1", Ask("open", ttl_s=5.0))
        motion = Ask("line", 1, at_s=begun.now_s)
        reply_to(session, "s-1", motion, OPEN)
        reply_to(session, "s-1", Ask("close"))
        # The daemon's clock is the gateway's.
        late_s = begun.now_s + MOTION_COUNTS_S
        local.until(lambda state: bool(state["monotonic_s"] > late_s))
        before = motions(local)
        heard = session.declare_subscriber(LEFT.to("op1", name), the_newest())
        assert reply_to(session, name, Ask("open", ttl_s=5.0)).about is not None
        assert reply_to(session, name, motion, OPEN).took == 1
        answer = answer_to(session, name, heard, 1)
        assert answer["error"]["data"]["reason"] == "too_late"
        assert motions(local) == before


def test_a_flood_of_questions_how_it_is_costs_one_connection(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    """While the daemon hangs, some wait for its one answer; the others get none."""

    async def flooded(session: zenoh.Session) -> list[Answered]:
        loop = asyncio.get_running_loop()
        asking = [
            ask(session, LEFT.about, b"", None, loop, within_s=DEADLINE_S) for _ in range(300)
        ]
        done, waiting = set[asyncio.Future[list[Answered]]](), set(asking)
        try:
            while len(done) < len(asking) - MOST_ASKED_ABOUT:
                more, waiting = await asyncio.wait(waiting, return_when=asyncio.FIRST_COMPLETED)
                done |= more
            assert descriptors() <= before + 1
        finally:
            gripper.process.send_signal(signal.SIGCONT)
        return [answered for future in asking for answered in await future]

    def descriptors() -> int:
        return len(list(Path(f"/proc/{lab.gateway.process.pid}/fd").iterdir()))

    with connected(lab, "op1") as session:
        answers(session, LEFT.about)
        before = descriptors()
        gripper.process.send_signal(signal.SIGSTOP)
        given = asyncio.run(flooded(session))
        assert 1 <= len(given) <= MOST_ASKED_ABOUT
        assert all({"version", "error"} & json.loads(one.payload).keys() for one in given)
        assert len(answers(session, LEFT.about)) == 1


def test_a_stop_that_was_not_confirmed_does_nothing_after_a_later_clearing(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    """The gateway's clock is this machine's; what is sent here is as old as it says."""
    stop = b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"hold"}}\n'

    def sent(at_s: float | None) -> dict[str, Any]:
        message = None if at_s is None else packed(Ask("line", at_s=at_s))
        (answer,) = answers(session, LEFT.stop("op1"), stop, message)
        said: dict[str, Any] = json.loads(answer.payload)
        return said

    with gripper.connect() as local, connected(lab, "op1") as session:
        reply_to(session, "s-1", Ask("open", ttl_s=5.0))  # from now on it is heard
        begun_s = time.monotonic()
        assert "result" in sent(begun_s)
        local.result("stop.clear")
        local.until(lambda state: bool(state["monotonic_s"] > begun_s + STOP_WITHIN_S + 0.1))
        assert sent(begun_s)["error"]["data"]["reason"] == "too_late"
        assert local.result("state.get")["stop"] is None
        assert "came after it was cleared" in lab.gateway.log
        assert "result" in sent(time.monotonic())
        local.result("stop.clear")
        assert "result" in sent(None)
        assert local.result("state.get")["stop"] is not None


# A flood ------------------------------------------------------------------------------------------


def test_a_flood_of_questions_how_it_is_leaves_the_list_right(lab: Fleet) -> None:
    over, room = threading.Event(), threading.Semaphore(10 * UNANSWERED)
    done = zenoh.handlers.Callback(lambda _reply: None, room.release)
    with (
        connected(lab, "viewer") as flooding,
        connected(lab, "op1") as session,
        ThreadPoolExecutor(1) as aside,
    ):

        def flood() -> int:
            count = 0
            while not over.is_set():
                if room.acquire(timeout=0.1):
                    flooding.get(LEFT.about, handler=done, timeout=1.0)
                    count += 1
            return count

        while not answers(session, LEFT.about):
            continue
        sent = aside.submit(flood)
        try:
            rows = [asyncio.run(look(session)) for _ in range(10)]
        finally:
            over.set()
        print(f"{sent.result(DEADLINE_S)} questions beside")
        assert [[(row.place, row.facts.get("error")) for row in found] for found in rows] == [
            [(LEFT, None)]
        ] * 10


READS = """
import sys
from tests.process.daemon_process import Client
with Client(sys.argv[1]) as client:
    for _ in range(1000):
        client.result("state.get")
"""
"""A program that behaves well; its session lives one second without its portal's signs of life."""


@pytest.mark.alone
def test_one_users_flood_ends_no_session_of_anothers(
    tmp_path: Path, certificates: Path, gripper: DaemonProcess
) -> None:
    line = b'{"jsonrpc":"2.0","id":1,"method":"motion.open","params":{"x":[%b1]}}\n' % (
        b"1," * 4000
    )
    key, over = LEFT.rpc("op2", "s-1", "operator"), threading.Event()
    nothing = zenoh.handlers.Callback(lambda _reply: None, lambda: None)
    sockets, users = {"left": gripper.socket_path}, {"op1": "operator", "op2": "operator"}
    with (
        fleet(tmp_path / "crowded", certificates, sockets, users=users, ttl_s=1.0) as lab,
        connected(lab, "op2") as session,
        ThreadPoolExecutor(1) as aside,
    ):
        while not answers(session, key, b"", packed(Ask("open", ttl_s=5.0))):
            pass

        def flood() -> int:
            number = 0
            while not over.is_set():
                number += 1
                late = packed(Ask("line", number, got=2**40, at_s=0.0))
                session.get(key, handler=nothing, payload=line, attachment=late, timeout=1.0)
                if number % 50 == 0:
                    live = packed(Ask("live"))
                    session.get(key, handler=nothing, attachment=live, timeout=1.0)
            return number

        flooding = aside.submit(flood)
        try:
            command = [sys.executable, "-c", READS, str(lab.socket_path())]
            root = Path(__file__).parents[3]
            done = subprocess.run(command, capture_output=True, text=True, cwd=root, check=False)
        finally:
            over.set()
        print(f"{flooding.result(DEADLINE_S)} lines beside")
        assert done.returncode == 0, done.stderr
