"""One certificate opens as many connections to the router as it can: others still get in."""

import contextlib
from collections.abc import Iterator
from pathlib import Path

import pytest
import zenoh

from litegrip_fleet.admin.guests import MOST_OF_ONE, MOST_WITHOUT_A_ROW
from tests.process.daemon_process import DaemonProcess
from tests.process.fleet.fleet_process import Fleet, fleet, reach
from tests.process.fleet.on_network import configuration_of, connected
from tests.process.fleet.test_ids import until


@pytest.fixture
def lab(tmp_path: Path, certificates: Path, gripper: DaemonProcess) -> Iterator[Fleet]:
    """A fleet for each test, with two users."""
    users, sockets = {"op1": "operator", "op2": "operator"}, {"left": gripper.socket_path}
    with fleet(tmp_path / "fleet", certificates, sockets, users=users) as running:
        yield running


@contextlib.contextmanager
def many(lab: Fleet, name: str, count: int) -> Iterator[list[zenoh.Session]]:
    """Open so many sessions with one certificate; each tries again and again."""
    config = configuration_of(lab, name)
    config.insert_json5("connect/timeout_ms", "0")
    with contextlib.ExitStack() as stack:
        opened = []
        for _ in range(count):
            opened.append(zenoh.open(config))
            stack.callback(opened[-1].close)
        yield opened


@pytest.mark.parametrize(("name", "most"), [("forger", MOST_WITHOUT_A_ROW), ("op2", MOST_OF_ONE)])
def test_one_certificate_has_room_of_its_own(lab: Fleet, name: str, most: int) -> None:
    with many(lab, name, most + 12) as sessions:
        lab.router.until_says(f"{name} has {most} connections, as many as one certificate may have")

        def others_are_closed() -> bool:
            return sum(bool(session.info.routers_zid()) for session in sessions) == most

        until(others_are_closed, lab.router, "more have stayed")
        with connected(lab, "op1") as user:
            assert user.info.routers_zid()
        with reach(lab) as client:
            assert client.result("state.get")
