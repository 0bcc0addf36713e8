"""Who connects with the id of a part of the fleet keeps it out of the router; it comes by another.

Every answer names its gateway's id to whom it is given, and the router lets an id in once: a
certificate of the authority is enough to take it in a gap, also one that is in no table.
"""

import contextlib
import json
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
import zenoh

from tests.process.daemon_process import DEADLINE_S, DaemonProcess, wait_a_moment
from tests.process.fleet.fleet_process import SITE, Fleet, Part, fleet, reach
from tests.process.fleet.on_network import LEFT, configuration_of, connected

THIEF = "forger"
"""His certificate is of the authority, and in no table."""


@pytest.fixture
def lab(tmp_path: Path, certificates: Path, gripper: DaemonProcess) -> Iterator[Fleet]:
    """A fleet for each test: an id is taken once, and what took it may still be there."""
    with fleet(tmp_path / "fleet", certificates, {"left": gripper.socket_path}) as running:
        yield running


def until(condition: Callable[[], bool], part: Part, what: str) -> None:
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s, f"{what}: {part.log}"
        wait_a_moment(part.process)


def id_of_the_gateway(lab: Fleet) -> str:
    """Return what an answer tells to whom it is given."""
    with connected(lab, "op1") as session:
        for _ in range(10):
            for reply in session.get(LEFT.about, timeout=1.0):
                if reply.ok is not None and reply.replier_id is not None:
                    return str(reply.replier_id.zid)
    raise AssertionError("the gateway does not answer")


@contextlib.contextmanager
def trying(lab: Fleet, identity: str) -> Iterator[Callable[[], bool]]:
    """Try to be let in with an id, again and again; yield what says whether he is."""
    config = configuration_of(lab, THIEF)
    config.insert_json5("id", json.dumps(identity))
    opened: list[zenoh.Session] = []
    thread = threading.Thread(target=lambda: opened.append(zenoh.open(config)), daemon=True)
    thread.start()
    try:
        yield lambda: bool(opened) and bool(opened[0].info.routers_zid())
    finally:
        thread.join(DEADLINE_S)
        opened[0].close()


def test_a_gateway_whose_id_is_taken_in_a_gap_comes_by_another_and_says_why(lab: Fleet) -> None:
    taken = id_of_the_gateway(lab)
    with trying(lab, taken) as is_in:
        lab.gateway.freeze()
        until(is_in, lab.router, "the id was not taken")
        lab.gateway.thaw()
        with reach(lab) as client:
            assert client.result("stop", level="hold")["level"] == "hold"
        assert is_in()
        assert id_of_the_gateway(lab) != taken
        lab.gateway.until_says("by another id")


def test_the_router_names_who_has_the_id_of_a_gateway(lab: Fleet) -> None:
    with trying(lab, id_of_the_gateway(lab)) as is_in:
        lab.gateway.freeze()
        until(is_in, lab.router, "the id was not taken")
        lab.gateway.thaw()
        lab.router.until_says(f"{THIEF} has connected with the id of robot1")


def test_the_router_names_a_certificate_that_is_in_no_table(lab: Fleet) -> None:
    with connected(lab, THIEF):
        lab.router.until_says(f"{THIEF} is in no table")


def test_nobody_takes_the_id_of_a_gateway_that_is_connected(lab: Fleet) -> None:
    config = configuration_of(lab, THIEF)
    config.insert_json5("id", json.dumps(id_of_the_gateway(lab)))
    config.insert_json5("connect/timeout_ms", "1500")
    config.insert_json5("connect/exit_on_failure", "true")
    with pytest.raises(zenoh.ZError):
        zenoh.open(config).close()
    reach(lab).close()
    assert f"{SITE}.left: the daemon" not in lab.gateway.log
