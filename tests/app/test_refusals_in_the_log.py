"""What the log says of a refusal: what was called, by the protocol's name, and what to do."""

import logging

import pytest

from litegripd.app.status import log_event
from tests.world import World


def logged_refusal(world: World, caplog: pytest.LogCaptureFixture) -> str:
    """Return what the log says of the only request that was refused."""
    (event,) = [event for event in world.service.take_events() if event.kind == "refused"]
    with caplog.at_level(logging.INFO):
        log_event(event, "sim8")
    return caplog.messages[-1].partition("): ")[2]


@pytest.mark.parametrize(
    ("method", "params"),
    [
        ("lease.acquire", {}),
        ("lease.take", {"why": "shift"}),
        ("calibration.load", {"template": "normal"}),
        ("trajectory.record_start", {}),
    ],
)
def test_what_an_observer_called_is_named_by_the_protocol(
    method: str, params: dict[str, object], caplog: pytest.LogCaptureFixture
) -> None:
    world = World().start()
    assert world.client(role="observer").refusal(method, **params) == "not_permitted"
    assert logged_refusal(world, caplog).startswith(f"{method}: ")


def test_parameters_are_named_as_the_protocol_does(caplog: pytest.LogCaptureFixture) -> None:
    world = World().start()
    assert world.client().refusal("motion.grasp", width_mm=10.0) == "invalid_params"
    assert logged_refusal(world, caplog).startswith("motion.grasp: width_mm is given")


def test_what_is_to_be_done_stays_a_command(caplog: pytest.LogCaptureFixture) -> None:
    world = World().start()
    world.client().refusal("no such method")
    assert "litegripctl -c sim8 discover lists them" in logged_refusal(world, caplog)
