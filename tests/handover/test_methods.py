"""The restart over the wire: who may, in which form, and how its end is told."""

import pytest

from litegripd.handover.state import OnRestarted
from litegripd.model.errors import Refusal
from litegripd.model.state import Restarted
from litegripd.rpc.sessions import Role
from tests.world import World


@pytest.mark.parametrize("role", ["observer", "operator"])
def test_only_an_admin_restarts(role: Role) -> None:
    world = World().start()
    world.restart = lambda told: told(Restarted(1, 0.0))
    client = world.client()
    client.session.role = role
    assert client.refusal("daemon.restart", hold_through_restart=True) == "not_permitted"


def test_the_form_that_lets_go_is_the_service_managers() -> None:
    world = World().start()
    asked: list[OnRestarted] = []
    world.restart = asked.append
    error = world.client().call("daemon.restart", hold_through_restart=False)["error"]
    assert error["data"]["reason"] == "invalid_params"
    assert "systemctl restart" in error["message"]
    assert world.client().refusal("daemon.restart") == "invalid_params"
    assert asked == []


def test_the_answer_comes_when_the_successor_has_taken_over() -> None:
    world = World().start()
    asked: list[OnRestarted] = []
    world.restart = asked.append
    client = world.client()
    number = client.send("daemon.restart", hold_through_restart=True)
    world.run(0.5)
    assert not client.has_answer(number)
    asked[0](Restarted(77, 0.005))
    assert client.has_answer(number)
    assert client.answers[number]["result"] == {"pid": 77, "gap_s": 0.005}


def test_why_there_is_no_restart_is_told_at_once_or_later() -> None:
    world = World().start()
    client = world.client()
    assert client.refusal("daemon.restart", hold_through_restart=True) == "restart_failed"
    world.restart = lambda _told: Refusal("busy", "a motion runs")
    assert client.refusal("daemon.restart", hold_through_restart=True) == "busy"
    world.restart = lambda told: told(Refusal("restart_failed", "it is broken"))
    error = client.call("daemon.restart", hold_through_restart=True)["error"]
    assert error["message"] == "it is broken"


def test_at_the_end_whatever_would_be_lost_is_refused_but_a_stop_and_reads_are_not() -> None:
    world = World()
    client = world.enabled()
    world.controller.shut_down()
    for method, params in (
        ("config.set", {"config": {"force_n": 5}}),
        ("stop.clear", {}),
        ("lease.acquire", {}),
        ("motion.open", {}),
    ):
        assert client.refusal(method, **params) == "shutting_down"
    generation = client.result("state.get")["stop_generation"]
    assert client.result("stop")["generation"] == generation + 1
