"""What a running daemon tells of itself is what its own OpenRPC document says."""

import json

import pytest

from tests.answers import Described
from tests.process.daemon_process import DaemonProcess

READS = (
    "hello",
    "rpc.discover",
    "health",
    "state.get",
    "info.get",
    "clients.list",
    "job.list",
    "calibration.get",
    "calibration.templates",
    "config.get",
    "trajectory.list",
    "recorder.dump",
)


@pytest.mark.parametrize("closed", [False, True])
def test_a_daemons_answers_are_as_it_describes_them(simulated: DaemonProcess, closed: bool) -> None:
    with simulated.connect() as client:
        described = Described(client.result("rpc.discover"), closed=closed)
        client.enabled()
        for method in READS:
            result = client.result(method)
            described.check({"result": result}, method)
            json.dumps(result, allow_nan=False)
        described.check({"result": client.result("calibration.save")}, "calibration.save")
        health = client.result("health")
        del health["control"]["lateness"]["p99_us"]
        assert not described.holds({"result": health}, "health")
