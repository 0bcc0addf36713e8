"""What the flight recorder holds of a scene: each tick as it was, and what happened."""

import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from litegripd.model.state import Event
from litegripd.motor import codec
from litegripd.recorder import recorder
from litegripd.recorder.files import Recording, read, tick_fields
from litegripd.recorder.recorder import Recorder, memory_bytes, tick_slots
from tests.world import CAN_ID, PERIOD_S, World, ready


def recorded(world: World) -> Recording:
    return read(bytes(world.disk.memory))


def fields(recording: Recording) -> list[dict[str, Any]]:
    return [tick_fields(tick, recording.programs) for tick in recording.ticks]


def test_a_minute_is_kept_in_memory_whose_size_never_changes() -> None:
    world = World().start()
    size = len(world.disk.memory)
    world.run(65.0)
    ticks = recorded(world).ticks
    assert len(ticks) == 12_000
    assert [tick.number for tick in ticks] == list(range(ticks[0].number, ticks[0].number + 12_000))
    assert ticks[-1].at_s == world.now_s
    assert recorded(world).duration_s == pytest.approx(60.0 - PERIOD_S)
    assert len(world.disk.memory) == size == memory_bytes(tick_slots(PERIOD_S))


def test_each_tick_tells_the_frame_that_really_went_out() -> None:
    world = World()
    world.enabled().result("motion.move", opening_mm=40, speed_mm_s=100)
    sent: dict[float, bytes] = {}
    for one in world.sent:
        if one.frame.can_id == CAN_ID:
            sent[one.at_s] = one.frame.data
    ticks = recorded(world).ticks
    assert {tick.at_s: tick.sent for tick in ticks if tick.flags & recorder.HAS_SENT} == sent
    kinds = {tick["sent"] for tick in fields(recorded(world)) if "sent" in tick}
    assert {"command", "enable"} <= kinds


def test_a_tick_tells_command_feedback_and_whose_motion_it_was() -> None:
    world, client = ready()
    number = client.send("motion.move", opening_mm=40, speed_mm_s=100)
    world.run(0.3)
    state, last = world.state, fields(recorded(world))[-1]
    assert not client.has_answer(number)
    for name in ("position_rad", "torque_nm", "opening_mm", "requested_rad"):
        assert last[name] == pytest.approx(getattr(state, name), abs=1e-5), name
    assert last["command_rad"] == pytest.approx(state.command_rad, abs=2 * 12.5 / 65535)
    assert last["age_s"] == pytest.approx(PERIOD_S)
    assert (last["motor"], last["phase"], last["mode"]) == ("enabled", "enabled", "moving")
    assert (last["job"], last["job_kind"]) == (2, "move")
    peer = client.session.peer
    assert (last["pid"], last["client"]) == (peer.pid, client.session.identity)
    assert last["program"] == peer.program
    assert (last["bus"], last["failed"], last["stopped"]) == ("up", False, False)


def test_what_is_unknown_is_left_out() -> None:
    world = World(calibrated=False)
    world.tick()
    (first,) = fields(recorded(world))
    assert first["motor"] == "unknown"
    assert not first.keys() & {"position_rad", "opening_mm", "command_rad", "job", "pid", "age_s"}


def test_a_silent_motor_and_withheld_commands_are_seen() -> None:
    world = World()
    world.enabled()
    world.lose_from_motor = lambda _frame: True
    world.run(0.2)
    last = fields(recorded(world))[-1]
    assert (last["motor"], last["phase"]) == ("silent", "lost")
    assert last["unanswered"] > 3
    assert last["age_s"] > 0.15
    assert "sent" not in last


def test_a_stop_and_slack_jaws_are_seen() -> None:
    world, client = ready()
    client.result("stop", level="relax")
    world.run(0.1)
    last = fields(recorded(world))[-1]
    assert (last["mode"], last["stopped"], last["kp"]) == ("relaxed", True, 0.0)
    assert "command_mm" not in last


def test_events_are_those_of_the_ticks_that_are_kept() -> None:
    world, client = ready()
    client.result("motion.move", opening_mm=40, speed_mm_s=100)
    kinds = [event.content["kind"] for event in recorded(world).events]
    assert kinds.count("job_started") == kinds.count("job_ended") == 2
    assert kinds.count("owner") == 1  # reported once, not per motion
    world.run(61.0)
    assert recorded(world).events == ()
    assert recorded(world).programs  # the name is still known


def test_refused_requests_push_nothing_out_but_each_other() -> None:
    world, client = ready()
    for _ in range(recorder.EVENTS + 10):
        client.send("no.such.method")
    kinds = [event.content["kind"] for event in recorded(world).events]
    assert kinds.count("refused") == recorder.REFUSALS
    assert "job_started" in kinds


def test_what_flaps_pushes_nothing_of_another_kind_out() -> None:
    world, client = ready()
    client.result("stop", why="the one that matters")
    for number in range(recorder.EVENTS + 100):
        world.controller.events.append(Event("bus", f"CAN bus: up -> down, {number}"))
        if number % 8 == 0:
            world.tick()
    world.tick()
    events = recorded(world).events
    kinds = [event.content["kind"] for event in events]
    assert kinds.count("stop") == 1
    assert kinds.count("bus") == recorder.EVENTS  # each once, though the newest are kept twice
    assert [event.number for event in events] == sorted(event.number for event in events)
    assert "the one that matters" in events[kinds.index("stop")].content["message"]


@settings(deadline=None)
@given(message=st.text(max_size=2000), data=st.dictionaries(st.text(max_size=20), st.text()))
def test_an_event_of_any_length_fits_its_slot(message: str, data: dict[str, str]) -> None:
    memory = bytearray(memory_bytes(1))
    made = Recorder(memoryview(memory), 1, {"channel": "can0"})
    made.event(Event("motor", message, data), 5.0)
    (event,) = read(bytes(memory)).events
    assert event.at_s == 5.0
    assert event.content["kind"] == "motor"
    whole = {"kind": "motor", "message": message, "data": data}
    if len(json.dumps(whole)) <= recorder.TEXT_BYTES:
        assert event.content == whole
    else:
        assert event.content["is_cut"]
        assert message.startswith(event.content["message"])


def test_an_event_may_hold_what_json_cannot() -> None:
    memory = bytearray(memory_bytes(1))
    made = Recorder(memoryview(memory), 1, {"channel": "can0"})
    made.event(Event("heat", "warm", {"nm": float("nan"), "what": object}), 1.0)
    (event,) = read(bytes(memory)).events
    assert event.content["data"]["nm"] is None


@pytest.mark.parametrize("memory", [b"", b"x" * 11, bytes(memory_bytes(2)), b"LGREC"])
def test_what_is_no_recorders_memory_is_refused(memory: bytes) -> None:
    with pytest.raises(ValueError, match="recorder"):
        read(memory)


def test_a_memory_of_another_size_is_refused() -> None:
    with pytest.raises(ValueError, match="needs"):
        Recorder(memoryview(bytearray(100)), 10, {})
    memory = bytearray(memory_bytes(3))
    Recorder(memoryview(memory), 3, {})
    with pytest.raises(ValueError, match="needs"):
        read(bytes(memory[:-1]))


def test_what_was_sent_is_read_back_in_the_ranges_of_its_motor() -> None:
    world = World()
    world.enabled().result("motion.move", opening_mm=40, speed_mm_s=100)
    at_s, command = world.commands_since(0.0)[-1]
    tick = next(tick for tick in recorded(world).ticks if tick.at_s == at_s)
    assert codec.decode_command(tick.sent, world.ranges) == command
    assert tick_fields(tick, {})["command_rad"] == pytest.approx(command.position_rad, abs=2e-6)
