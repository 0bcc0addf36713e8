"""Events over a real socket: all of them to who reads, and the end of who never does."""

from typing import Any

from litegrip_fleet.near.portal import MOST_UNREAD_BYTES
from litegripd.io.connection import MAX_UNSENT_BYTES
from tests.process.daemon_process import Client, DaemonProcess

PORTION = 50
PORTIONS_AT_MOST = 400


def next_event(client: Client) -> dict[str, Any]:
    """Return the next event that comes to a client."""
    while (message := client.read()).get("method") != "event":
        assert message, "the daemon has closed the connection"
    event: dict[str, Any] = message["params"]
    return event


def refused(client: Client, number: int) -> None:
    """Send requests that are refused, and take the answers."""
    client.socket.sendall(b'{"jsonrpc":"2.0","id":1,"method":"no such method"}\n' * number)
    for _ in range(number):
        assert client.read()["error"]["data"]["reason"] == "unknown_method"


def last_message(client: Client) -> dict[str, Any]:
    """Read what was sent to a client until the daemon closed it; return the last message."""
    last: dict[str, Any] = {}
    while True:
        try:
            message = client.read()
        except ValueError:
            continue  # the line that was cut off
        if not message:
            return last
        last = message


def test_what_one_client_does_the_others_are_told(simulated: DaemonProcess) -> None:
    with simulated.connect() as mover, simulated.connect() as watcher:
        mover.enabled()
        kinds = ["job_started", "job_ended", "stop", "stop_cleared"]
        told = watcher.result("events.subscribe", kinds=kinds)
        assert told["state"]["bus"] == "up"
        assert told["events"][-1]["kind"] == "job_ended"
        mover.call("motor.disable")
        mover.result("stop", why="a test")
        mover.result("stop.clear")
        found = [next_event(watcher) for _ in range(4)]
        assert [event["kind"] for event in found] == kinds
        assert {event["subscription"] for event in found} == {told["subscription"]}
        sequences = [told["events"][-1]["seq"], *(event["seq"] for event in found)]
        assert sequences == sorted(set(sequences))
        assert "a test" in found[2]["message"]


def test_who_never_reads_its_events_is_closed_and_the_others_miss_none(
    simulated: DaemonProcess,
) -> None:
    with (
        simulated.connect() as deaf,
        simulated.connect() as good,
        simulated.connect() as flooder,
    ):
        flooder.result("hello", client="x" * 250)  # told in each event, which are larger so
        good.result("events.subscribe", kinds=["refused"])
        number = deaf.result("hello")["client"]
        for _ in range(8):
            deaf.result("events.subscribe", kinds=["refused"])
        sequences: list[int] = []
        is_connected = True
        while is_connected:
            assert len(sequences) < PORTION * PORTIONS_AT_MOST, "the deaf client is not closed"
            refused(flooder, PORTION)
            sequences += [next_event(good)["seq"] for _ in range(PORTION)]
            clients = good.result("clients.list")["clients"]
            is_connected = number in [client["client"] for client in clients]
        assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
        error = last_message(deaf)["error"]
        assert error["data"]["reason"] == "backlog_full"
        limit = MOST_UNREAD_BYTES if simulated.remote_as else MAX_UNSENT_BYTES
        assert error["data"]["limit"] == limit
        refused(flooder, PORTION)
        sequences += [next_event(good)["seq"] for _ in range(PORTION)]
        assert sequences == list(range(sequences[0], sequences[0] + len(sequences)))
        (me,) = [c for c in good.result("clients.list")["clients"] if c["is_me"]]
        assert me["bytes_out"] > 300 * len(sequences)
        assert me["worst_latency_ms"] > 0.0
        assert good.result("health")["control"]["tick_errors"] == 0
