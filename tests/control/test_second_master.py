"""Another program that commands our motor: reported loudly, and a reason to reject motions."""

from typing import Any

from litegripd.control.authority import QUIET_AFTER_S, REPORT_EVERY_S, SecondMaster
from litegripd.model.motor import CanFrame, MotorPhase, RegisterWrite
from tests.world import CAN_ID, Client, World

FOREIGN = CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF"))


def events(client: Client) -> list[dict[str, Any]]:
    """Return the second master's events that this client was sent."""
    reported = client.events()
    return [event for event in reported if event["kind"] == "second_master"]


def listening(world: World) -> Client:
    client = world.enabled()
    client.result("events.subscribe")
    return client


def test_a_running_motion_ends_and_the_jaws_hold() -> None:
    world = World()
    client = listening(world)
    number = client.send("motion.open")
    world.run(0.2)
    world.inject(FOREIGN)
    assert client.wait(number, 0.1)["error"]["data"]["reason"] == "second_master"
    assert world.in_phase(MotorPhase.ENABLED)
    world.run(0.3)
    held_mm = world.gripper.opening_mm
    world.run(0.3)
    assert abs(world.gripper.opening_mm - held_mm) < 0.1


def test_motions_are_refused_until_it_is_quiet() -> None:
    world = World()
    client = listening(world)
    world.inject(FOREIGN)
    world.run(0.05)
    for method in ("motion.open", "motor.enable", "motion.hold", "motion.zero_gravity"):
        assert client.refusal(method) == "second_master"
    assert client.result("stop")
    client.result("stop.clear")
    world.run(QUIET_AFTER_S)
    assert client.result("motion.open")["ok"]
    assert [event["data"]["active"] for event in events(client)] == [True, False]


def test_a_motor_can_be_disabled_meanwhile() -> None:
    world = World()
    client = listening(world)
    world.inject(FOREIGN)
    world.run(0.05)
    number = client.send("motor.disable")
    world.inject(FOREIGN)
    assert client.wait(number, 1.0)["result"]["ok"]


def test_where_it_is_tolerated_it_is_only_told() -> None:
    world = World()
    world.controller.second_master.is_tolerated = True
    client = listening(world)
    world.inject(FOREIGN)
    assert client.result("motion.open")["ok"]
    assert events(client)


def test_a_stream_of_frames_is_told_now_and_then_with_the_count() -> None:
    master, now_s = SecondMaster(), 0.0
    reported: list[int] = []
    for count in range(1, 3001):
        now_s += 0.01
        event = master.step(now_s, count)
        if event is not None:
            assert isinstance(event.data["frames"], int)
            reported.append(event.data["frames"])
    assert [round(frames, -2) for frames in reported] == [
        0,
        100 * REPORT_EVERY_S,
        200 * REPORT_EVERY_S,
    ]


def test_a_write_is_told_at_once_and_forgotten_when_it_is_quiet() -> None:
    master, save = SecondMaster(), RegisterWrite(None, None)
    begin = master.step(1.0, 1)
    write = master.step(1.1, 2, RegisterWrite("PMAX", 6.0))
    saving = master.step(1.2, 3, save)
    assert master.step(1.3, 4, save) is None  # no other one
    quiet = master.step(1.4 + QUIET_AFTER_S, 4, save)
    again = master.step(9.0, 5, save)
    assert begin is not None
    assert write is not None
    assert saving is not None
    assert quiet is not None
    assert again is not None
    assert "commands the motor on" in begin.message
    assert "writes the motor's register PMAX to 6 on" in write.message
    assert write.data == {"frames": 2, "register": "PMAX", "value": 6.0, "active": True}
    assert "saves the motor's registers on" in saving.message
    assert quiet.data == {"frames": 4, "active": False}
    assert "commands the motor on" in again.message
    assert again.data == {"frames": 5, "active": True}


def test_an_answer_whose_id_was_damaged_is_no_command() -> None:
    """On a bus without checksums 0x018 becomes 0x008 now and then."""
    world = World()
    client = listening(world)
    for head in (0x08, 0x18):
        world.inject(CanFrame(CAN_ID, bytes([head]) + bytes.fromhex("7DA07FF7FF2020")))
        world.run(0.1)
    assert not events(client)
    assert world.machine.motor.counters.foreign_commands == 0
