"""A daemon is restarted under a remote client, and holds what it has; then the client works on."""

import contextlib
import time
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S, Client, wait_a_moment
from tests.process.fleet.fleet_process import Fleet, fleet
from tests.process.restarting import (
    Restartable,
    held,
    holds,
    is_of_silence,
    restartable,
    wait_for_end,
)

pytestmark = pytest.mark.alone  # what delays the simulator ends the hold


def again(lab: Fleet) -> Client:
    """Connect by the portal as soon as the daemon answers there."""
    ends_s = time.monotonic() + DEADLINE_S
    while True:
        client = Client(lab.socket_path())
        with contextlib.suppress(BrokenPipeError):  # the portal has already said why not
            client.send("hello")
        message = client.read()
        if "result" in message:
            return client
        assert not message or message["error"]["data"]["reason"] == "unreachable", message
        assert time.monotonic() < ends_s, message
        client.close()
        wait_a_moment(lab.portal.process)


def held_through_a_restart(lab: Fleet, daemon: Restartable) -> bool:
    """Restart by the portal while the object is held; return True if it is held afterwards.

    A restart in which this machine has kept the simulator from answering tells nothing: the hold by
    force is lost by that, restart or not. Then the next one counts.
    """
    ends_s = time.monotonic() + 2.5 * DEADLINE_S
    while time.monotonic() < ends_s:
        with again(lab) as client:
            held(client)
            client.result("calibration.templates")  # by now the helper has written the log
            mark, pid = len(daemon.log), daemon.pid
            answer = daemon.restart(client)
        if "result" not in answer:
            assert is_of_silence(answer), answer
            continue
        wait_for_end(pid)
        with again(lab) as client:
            after = client.result("state.get")
            hello = client.result("hello")
            assert (hello["channel"], hello["pid"]) == ("lab.left", daemon.pid)
            assert daemon.pid != pid
            client.result("calibration.templates")
        if not daemon.disturbed_since(mark):
            return holds(after)
    raise AssertionError("this machine is too busy: the simulator never answered all the while")


def test_a_remote_client_restarts_the_daemon_and_the_object_stays_held(
    tmp_path: Path, certificates: Path
) -> None:
    with restartable(tmp_path) as daemon:
        sockets = {"left": daemon.first.socket_path}
        with fleet(tmp_path / "fleet", certificates, sockets, role="admin") as lab:
            assert held_through_a_restart(lab, daemon)
            with again(lab) as client:
                assert client.despite_silence("motion.open")["ok"]
