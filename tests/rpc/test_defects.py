"""What goes wrong inside, or comes as a flood, is told, logged in portions and survived."""

import json

import pytest

from litegripd.rpc.subscriptions import EVENTS_PER_TICK
from tests.rpc.raw import Raw, answered, request
from tests.world import World, enabled_world, found_world, reason_of


def broken(*_arguments: object, **_named: object) -> None:
    raise ZeroDivisionError("a defect")


def test_a_defect_in_a_handler_is_told_and_logged_but_not_raised(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    world = World()
    world.enabled()
    world.take_log()
    monkeypatch.setattr(world.controller, "settle", broken)
    raw = Raw(world)
    answer = raw.error(request("motion.hold", 5))
    assert (answer["id"], raw.client.session.counters.refused) == (5, 1)
    assert answer["error"]["data"]["reason"] == "internal_error"
    assert "ZeroDivisionError" in answer["error"]["message"]
    assert raw.is_alive()
    assert any("ZeroDivisionError" in event.message for event in world.service.take_events())


@pytest.mark.parametrize(
    "line", [request("state.get", 6), b'{"jsonrpc":"2.0","id":6,"method":"state.get"}']
)
def test_a_defect_in_the_state_is_told_to_who_asks(
    monkeypatch: pytest.MonkeyPatch, line: bytes
) -> None:
    world = World().start()
    raw = Raw(world)
    with monkeypatch.context() as patch:
        patch.setattr(world.service.reporter, "state", broken)
        world.service.reporter.refresh()
        answer = raw.error(line)
    assert (answer["id"], answer["error"]["data"]["reason"]) == (6, "internal_error")
    assert raw.is_alive()


def test_a_defect_in_one_answer_leaves_the_others(monkeypatch: pytest.MonkeyPatch) -> None:
    world = World()
    first, second = world.enabled(), world.client()
    motion = first.send("motion.open")
    job = world.state.job
    assert job is not None
    waits = second.send("job.wait", job=job.job)
    monkeypatch.setattr(world.service.reporter, "result", broken)
    world.run_until(lambda: answered(second, waits))
    assert reason_of(first.answered(motion)) == "internal_error"
    assert second.answers[waits]["result"]["state"] == "done"


def test_a_number_that_is_not_finite_is_null_on_the_wire() -> None:
    world, client = enabled_world()
    feedback = world.controller.motor.feedback
    assert feedback is not None
    object.__setattr__(feedback, "torque_nm", float("nan"))
    client.world.service.reporter.refresh()
    client.send("state.get")
    (line,) = client.session.outgoing
    assert b"NaN" not in line
    assert json.loads(line)["result"]["torque_nm"] is None


def test_a_flood_of_refused_requests_is_logged_in_bounded_portions() -> None:
    world = World().start()
    world.take_log()
    raw = Raw(world)
    for _ in range(1000):
        raw.error(b"flood")
    raw.send(request("stop"))
    portions = []
    while portion := world.service.take_events():
        portions.append(portion)
    events = [event for portion in portions for event in portion]
    assert max(map(len, portions)) <= EVENTS_PER_TICK + 1
    assert len(events) < 100
    assert [event for event in events if event.kind == "stop"]
    (left_out,) = [event.data["left_out"] for event in events if "left_out" in event.data]
    assert isinstance(left_out, int)
    assert left_out + sum(event.data.get("reason") == "parse_error" for event in events) == 1000


def test_a_refusal_names_the_client_by_the_name_that_it_gave() -> None:
    world, client = found_world()
    client.result("hello", client="my script")
    client.refusal("motion.open")
    messages = [e.message for _ in range(9) for e in world.service.take_events()]
    assert [m for m in messages if "my script" in m and str(client.session.peer.pid) in m]
