"""States of a machine's grippers as one publication: who gets them, and who does not; real TLS."""

import json
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import zenoh

from litegrip_fleet.wire.keys import PREFIX, Place
from litegrip_fleet.wire.messages import Ask, Push, Reply, packed, unpacked
from litegrip_fleet.wire.together import Sample, packed_samples, samples_in
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess
from tests.process.fleet.fleet_process import Fleet, fleet
from tests.process.fleet.on_network import LEFT, answers, connected

RIGHT = Place("lab", "right")
USERS = {"op1": "operator", "op2": "operator", "viewer": "observer"}
FOREVER = 10**9
"""No gripper has sent so many samples."""


@pytest.fixture(scope="module")
def site(
    tmp_path_factory: pytest.TempPathFactory, certificates: Path, shared: DaemonProcess
) -> Iterator[Fleet]:
    """One fleet for all tests of this module, where two names are the same gripper."""
    shared.connect().close()
    sockets = dict.fromkeys(("left", "right"), shared.socket_path)
    folder = tmp_path_factory.mktemp("site")
    with fleet(folder, certificates, sockets, users=USERS) as running:
        yield running


def subscribed(client: Client, hz: float = 50.0) -> Client:
    """Have a client get states."""
    client.result("state.subscribe", hz=hz)
    return client


def samples(client: Client, count: int) -> list[dict[str, Any]]:
    """Return so many samples that a client gets."""
    found: list[dict[str, Any]] = []
    while len(found) < count:
        message = client.read()
        assert message, "the session has ended"
        assert "error" not in message, message
        if message.get("method") == "state.sample":
            found.append(message["params"])
    return found


class Heard:
    """What somebody hears on the network by a key."""

    def __init__(self, session: zenoh.Session, key: str) -> None:
        self.by_key: dict[str, list[bytes]] = {}
        self._subscriber = session.declare_subscriber(key, self._take)

    def _take(self, sample: zenoh.Sample) -> None:
        self.by_key.setdefault(str(sample.key_expr), []).append(sample.payload.to_bytes())


def test_the_states_of_all_grippers_come_as_one_publication_and_nothing_else_does(
    lab: Fleet,
) -> None:
    with (
        connected(lab, "op1") as spy,
        Client(lab.socket_path("left")) as left,
        Client(lab.socket_path("right")) as right,
    ):
        heard = Heard(spy, f"{PREFIX}/*/*/to/op1/*")
        subscribed(left).result("health")
        subscribed(right)
        own = [samples(client, 30) for client in (left, right)]
        (together,) = [key for key in heard.by_key if key.endswith("-all")]
        assert together.startswith(LEFT.to("op1", ""))
        rows = [row for payload in heard.by_key[together] for row in samples_in(payload)]
        assert {row.gripper for row in rows} == {"left", "right"}
        tunnel = [one for key, some in heard.by_key.items() if key != together for one in some]
        assert any(b'"result":' in payload for payload in tunnel)
        assert not any(b"state.sample" in payload for payload in tunnel)
    for some in own:
        numbers = [sample["seq"] for sample in some]
        assert numbers == sorted(set(numbers))
        assert all(sample["state"]["stop_generation"] is not None for sample in some)


@pytest.mark.parametrize("certificate", ["op2", "viewer", "former", "forger"])
def test_nobody_else_hears_the_states_of_a_users_sessions(lab: Fleet, certificate: str) -> None:
    """He may ask for a session of his own, if he is in the table: then the states are his."""
    with connected(lab, certificate) as spy, connected(lab, "op1") as own:
        heard = [Heard(spy, key) for key in (f"{PREFIX}/**", f"{PREFIX}/*/*/to/op1/*")]
        control = Heard(own, f"{PREFIX}/*/*/to/op1/*")
        with Client(lab.socket_path("left")) as client:
            samples(subscribed(client), 40)
        assert control.by_key
        assert [one.by_key for one in heard] == [{}, {}]


@pytest.mark.parametrize("certificate", ["op2", "forger"])
def test_nobody_else_publishes_states(lab: Fleet, certificate: str) -> None:
    with connected(lab, "op1") as spy, connected(lab, certificate) as forger:
        heard = Heard(spy, f"{PREFIX}/*/*/to/op1/*")
        with Client(lab.socket_path("left")) as client:
            samples(subscribed(client), 20)
            (key,) = [key for key in heard.by_key if key.endswith("-all")]
            row = samples_in(heard.by_key[key][-1])[-1]
            forged = json.loads(row.line)
            forged["params"]["seq"] = FOREVER
            line = json.dumps(forged, separators=(",", ":")).encode() + b"\n"
            for payload in packed_samples([Sample("left", row.session, None, line)]):
                for _ in range(50):
                    forger.put(key, payload)
            assert max(sample["seq"] for sample in samples(client, 40)) < FOREVER
        assert b'"seq":%d' % FOREVER not in b"".join(heard.by_key[key])


def test_a_reader_is_told_once_the_gateway_is_gone_and_reads_nothing_as_new(lab: Fleet) -> None:
    with Client(lab.socket_path("left")) as client:
        samples(subscribed(client), 20)
        lab.gateway.kill()
        messages = []
        while message := client.read():
            messages.append(message)
    assert messages[-1]["error"]["data"]["reason"] == "unreachable"
    numbers = [message["params"]["seq"] for message in messages[:-1]]
    assert numbers == sorted(set(numbers))


def test_states_come_while_the_tunnel_is_flooded(lab: Fleet) -> None:
    is_over, answered = threading.Event(), 0

    def flood(client: Client) -> None:
        nonlocal answered
        while not is_over.is_set():
            for number in [client.send("health") for _ in range(100)]:
                client.answer(number)
                answered += 1

    with Client(lab.socket_path("left")) as reader, Client(lab.socket_path("right")) as other:
        subscribed(reader)
        flooding = threading.Thread(target=flood, args=(other,), daemon=True)
        flooding.start()
        try:
            while answered < 200:
                samples(reader, 1)
            before = answered
            samples(reader, 100)
            during = answered - before
        finally:
            is_over.set()
            flooding.join(DEADLINE_S)
    assert during > 0


def test_a_restarted_gateways_states_come_to_the_next_session(lab: Fleet) -> None:
    with Client(lab.socket_path("left")) as client:
        samples(subscribed(client), 5)
        lab.gateway.restart()
        while client.read():
            pass
    lab.mend()
    with Client(lab.socket_path("left")) as client:
        assert len(samples(subscribed(client), 20)) == 20


# Older ones ---------------------------------------------------------------------------------------


@pytest.mark.parametrize("together", [None, "*", "old-1/x", "$*"])
def test_an_older_portal_gets_states_in_the_tunnel(lab: Fleet, together: str | None) -> None:
    """One that does not say in `open` where it takes what is for many sessions, or no such name."""
    key = LEFT.rpc("op2", "old-1", "operator")
    line = b'{"jsonrpc":"2.0","id":1,"method":"state.subscribe","params":{"hz":50}}\n'
    with connected(lab, "op2") as session:
        heard = Heard(session, LEFT.to("op2", "*"))
        (opened,) = answers(session, key, b"", packed(Ask("open", ttl_s=5.0, together=together)))
        assert unpacked(Reply, opened.attached).about is not None
        assert answers(session, key, line, packed(Ask("line", 1)))
        ends_s = time.monotonic() + DEADLINE_S
        while not any(b"state.sample" in one for some in heard.by_key.values() for one in some):
            assert time.monotonic() < ends_s
            assert answers(session, key, b"", packed(Ask("live")))
        assert list(heard.by_key) == [LEFT.to("op2", "old-1")]
        answers(session, key, b"", packed(Ask("close")))


def test_an_older_gateway_sends_states_in_the_tunnel(lab: Fleet) -> None:
    """One that says nothing of what goes together, and drops what it does not understand."""
    lab.gateway.kill()
    asked: list[tuple[str, Ask]] = []
    sample = b'{"jsonrpc":"2.0","method":"state.sample","params":{"subscription":1,"seq":%d}}\n'
    with connected(lab, "robot1") as session:

        def take(query: zenoh.Query) -> None:
            key, attached = str(query.key_expr), query.attachment
            ask = unpacked(Ask, None if attached is None else attached.to_bytes())
            asked.append((key, ask))
            about = {"site": "lab", "gripper": "left"} if ask.op == "open" else None
            with query:
                reply = Reply(ask.number, 0, 1.0, about=about)
                query.reply(query.key_expr, b"", attachment=packed(reply))
            name = key.split("/")[6]
            number = len(asked)
            session.put(LEFT.to("op1", name), sample % number, attachment=packed(Push(None)))

        rpc = session.declare_queryable(f"{LEFT.key}/rpc/**", take)
        with Client(lab.socket_path("left")) as first, Client(lab.socket_path("left")) as second:
            for client in (first, second):
                client.send("hello")
                found = samples(client, 8)  # one with each sign of life
                assert [one["seq"] for one in found] == sorted(one["seq"] for one in found)
        rpc.undeclare()
    lives = [key for key, ask in asked if ask.op == "live"]
    assert len({*lives}) == 2
    assert {ask.op for _key, ask in asked} <= {"open", "line", "live", "close"}
