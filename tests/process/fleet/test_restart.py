"""A daemon is restarted under a remote client, and holds what it has; then the client works on."""

from pathlib import Path

from tests.process.daemon_process import Client
from tests.process.fleet.fleet_process import Fleet, fleet
from tests.process.restarting import (
    Restartable,
    held,
    holds,
    is_of_silence,
    restartable,
    wait_for_end,
)


def again(lab: Fleet) -> Client:
    """Connect by the portal as soon as the daemon answers there."""
    while True:
        client = Client(lab.socket_path())
        client.send("hello")
        message = client.read()
        if "result" in message:
            return client
        assert message["error"]["data"]["reason"] == "unreachable", message
        client.close()


def restarted(lab: Fleet, daemon: Restartable) -> int:
    """Restart by the portal while the object is held; return the pid before.

    What a busy machine has kept from answering tells nothing: then the next one counts.
    """
    while True:
        with again(lab) as client:
            held(client)
            pid = daemon.pid
            answer = daemon.restart(client)
        if "result" in answer:
            return pid
        assert is_of_silence(answer), answer


def test_a_remote_client_restarts_the_daemon_and_the_object_stays_held(
    tmp_path: Path, certificates: Path
) -> None:
    with restartable(tmp_path) as daemon:
        sockets = {"left": daemon.first.socket_path}
        with fleet(tmp_path / "fleet", certificates, sockets, role="admin") as lab:
            mark = len(daemon.log)
            before = restarted(lab, daemon)
            wait_for_end(before)
            with again(lab) as client:
                hello = client.result("hello")
                assert (hello["channel"], hello["pid"]) == ("lab.left", daemon.pid)
                assert daemon.pid != before
                state = client.result("state.get")
                assert holds(state) or daemon.disturbed_since(mark), state
                assert client.result("motion.open")["ok"]
