"""A daemon is restarted under a remote client, and holds what it has; then the client works on."""

import time
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S
from tests.process.fleet.fleet_process import Fleet, fleet, reach
from tests.process.restarting import (
    Restartable,
    held,
    holds,
    is_of_silence,
    restartable,
    wait_for_end,
)

pytestmark = pytest.mark.alone  # what delays the simulator ends the hold


def held_through_a_restart(lab: Fleet, daemon: Restartable) -> bool:
    """Restart by the portal while the object is held; return True if it is held afterwards.

    A restart in which this machine has kept the simulator from answering tells nothing: the hold by
    force is lost by that, restart or not. Then the next one counts.
    """
    ends_s = time.monotonic() + 2.5 * DEADLINE_S
    while time.monotonic() < ends_s:
        with reach(lab) as client:
            held(client)
            client.result("calibration.templates")  # by now the helper has written the log
            mark, pid = len(daemon.log), daemon.pid
            answer = daemon.restart(client)
        if "result" not in answer:
            assert is_of_silence(answer), answer
            continue
        wait_for_end(pid)
        with reach(lab) as client:
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
            with reach(lab) as client:
                assert client.despite_silence("motion.open")["ok"]
