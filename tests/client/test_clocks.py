"""A daemon of another machine has another clock, by which nothing of this one was sent."""

import time
from typing import Any

import pytest

from litegrip_client import LiteGrip, aio
from tests.client.aio_helpers import run
from tests.client.fake_daemon import HELLO, MOVE, FakeDaemon


@pytest.mark.parametrize(
    ("ahead_s", "remote", "guards"),
    [
        (0.0, None, {"sent_s", "stop_generation"}),
        (0.0, {"site": "lab"}, {"stop_generation"}),
        (-3600.0, None, {"stop_generation"}),
        (+3600.0, None, {"stop_generation"}),
        (None, None, {"sent_s", "stop_generation"}),
    ],
)
def test_the_time_of_sending_is_told_where_the_clock_is_the_daemons(
    daemon: FakeDaemon, ahead_s: float | None, remote: object, guards: set[str]
) -> None:
    def hello(_request: object) -> dict[str, Any]:
        own = {**HELLO, "remote": remote}
        return own if ahead_s is None else {**own, "monotonic_s": time.monotonic() + ahead_s}

    daemon.handlers["hello"] = hello
    daemon.handlers["motion.open"] = lambda request: MOVE
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.open()

    async def again() -> None:
        async with aio.LiteGrip(socket_path=daemon.path) as gripper:
            await gripper.open()

    run(again())
    told = [set(request.params) for request in daemon.requests if request.method == "motion.open"]
    assert len(told) == 2
    for names in told:
        assert names & {"sent_s", "stop_generation"} == guards
