"""The daemon's machine behind its real bus object, while the link to the motor fails and recovers.

After a loss of the link that is longer than the motor's own watchdog, the motor is disabled until
a client enables it; no frame of before reaches it later as a motion.
"""

from collections.abc import Callable

import pytest

from litegripd.control.authority import QUIET_AFTER_S
from litegripd.model.motor import CanFrame, MotorPhase
from litegripd.motor import codec
from litegripd.sim.faults import BusFaults
from tests.bus_world import BusWorld
from tests.sim.driving import ENABLE, command
from tests.world import CAN_ID, Client

REOPENED_WITHIN_S = 6.0  # an adapter that is gone is looked for every 5 s at least
Switch = Callable[[BusFaults], None]

FAULTS = [
    pytest.param(BusFaults.link_down, BusFaults.link_up, id="link down"),
    pytest.param(BusFaults.unplug, BusFaults.replug, id="unplugged"),
    pytest.param(BusFaults.bus_off, BusFaults.recover, id="bus-off"),
    pytest.param(BusFaults.stall, BusFaults.unstall, id="not acknowledged"),
]


def check_recovered(world: BusWorld, client: Client) -> None:
    """The daemon finds its motor, disabled, and a client can use it again."""
    world.run_until(lambda: world.machine.is_disabled, REOPENED_WITHIN_S)
    world.run(0.2)
    assert world.machine.is_disabled
    assert world.gripper.motor.status != 1
    assert world.state.bus == "up"
    assert client.result("motor.enable")["ok"]
    assert client.result("motion.open")["outcome"] == "pressed_home"


def test_without_a_fault_it_is_a_world_like_any_other() -> None:
    with BusWorld() as world:
        client = world.enabled()
        assert client.result("motion.open")["outcome"] == "pressed_home"
        assert world.bus.counters.errors == 0
        # What the daemon sends is what comes to the motor, in its order.
        assert [sent.frame for sent in world.sent] == [sent.frame for sent in world.at_motor]


@pytest.mark.parametrize(("begin", "end"), FAULTS)
@pytest.mark.parametrize("lasts_s", [0.3, 2.5])
@pytest.mark.parametrize("doing", ["disabled", "holding", "moving"])
def test_after_a_long_loss_of_the_link_only_a_client_enables_the_motor(
    begin: Switch, end: Switch, lasts_s: float, doing: str
) -> None:
    with BusWorld() as world:
        client = world.start().client() if doing == "disabled" else world.enabled()
        number = client.send("motion.open") if doing == "moving" else None
        world.run(0.3)
        lost_s = world.now_s
        begin(world.faults)
        world.run(lasts_s)
        assert world.in_phase(MotorPhase.SILENT)
        if number is not None:
            reason = client.wait(number, 0.0)["error"]["data"]["reason"]
            assert reason in ("bus_down", "motor_silent")
        if doing != "disabled":
            assert world.gripper.motor.status == 0xD  # its own watchdog has disarmed it
        stood_rad = world.gripper.position_rad
        end(world.faults)
        world.run(REOPENED_WITHIN_S if doing == "holding" else 1.0)
        assert world.gripper.position_rad == pytest.approx(stood_rad, abs=0.003)
        assert world.enables_at_motor(lost_s) == []
        check_recovered(world, client)


@pytest.mark.parametrize("within_s", [0.0, 0.005, 0.01, 0.015, 0.02, 0.025, 0.03])
def test_frames_that_waited_for_power_move_and_enable_nothing(within_s: float) -> None:
    """The motor loses its power while it is used or enabled; with the power come all the frames."""
    with BusWorld() as world:
        client = world.start().client()
        client.send("motor.enable", retries=10)
        world.run(within_s)
        client.send("motion.close")
        world.run(0.01)
        world.faults.stall()
        world.gripper.power_off()
        world.run(3.0)
        back_s, stood_rad = world.now_s, world.gripper.position_rad
        world.gripper.power_on()
        world.faults.unstall()
        waited = [sent.frame for sent in world.at_motor if sent.at_s >= back_s]
        assert len(waited) == 10
        assert CanFrame(CAN_ID, codec.ENABLE) not in waited
        assert set(world.track(0.5, lambda: world.gripper.motor.status)) == {0}
        assert world.gripper.position_rad == stood_rad
        check_recovered(world, client)


@pytest.mark.parametrize(("begin", "end"), FAULTS[::2] + FAULTS[3:])
def test_after_a_short_loss_the_jaws_are_held_where_they_are(begin: Switch, end: Switch) -> None:
    with BusWorld() as world:
        client = world.enabled()
        number = client.send("motion.open")
        world.run(0.3)
        begin(world.faults)
        world.run(0.05)
        stood_rad = world.gripper.position_rad
        end(world.faults)
        world.run(0.5)
        assert world.in_phase(MotorPhase.ENABLED)
        assert world.state.mode == "holding"
        assert world.gripper.position_rad == pytest.approx(stood_rad, abs=0.005)
        assert client.has_answer(number)
        assert "error" in client.answers[number]
        assert client.result("motion.open")["outcome"] == "pressed_home"


def test_the_state_says_that_the_link_is_down_and_that_it_is_up_again() -> None:
    with BusWorld() as world:
        client = world.enabled()
        world.faults.link_down()
        world.run_until(lambda: world.state.bus == "link_down", 0.01)
        world.run(1.0)
        assert client.refusal("motor.enable") == "bus_down"
        world.faults.link_up()
        world.run_until(lambda: world.state.bus == "up", 0.2)
        check_recovered(world, client)


@pytest.mark.parametrize("flap_s", [0.005, 0.02, 0.045])
def test_a_flap_that_no_frame_has_met_does_not_last_while_the_motor_is_silent(
    flap_s: float,
) -> None:
    """Between two polls: receiving detects it, and each poll after it can be sent."""
    with BusWorld() as world:
        client = world.start().client()
        client.result("events.subscribe")
        world.gripper.power_off()
        world.run_until(lambda: world.state.bus == "motor_silent", 1.0)
        world.faults.link_down()
        world.run(flap_s)
        world.faults.link_up()
        world.run_until(lambda: world.state.bus == "motor_silent", 0.2)
        assert client.refusal("motor.enable") == "motor_silent"
        assert "link_down" in [event["data"].get("state") for event in client.events()]


def test_an_adapter_that_comes_back_is_opened_again() -> None:
    with BusWorld() as world:
        client = world.enabled()
        world.faults.unplug()
        world.run(20.0)
        assert world.bus.condition.error == "cannot be opened: [Errno 19] No such device"
        refusal = world.bus.condition.refusal("can0")
        assert refusal is not None
        assert "correct its name" in refusal.message
        assert client.refusal("motor.enable") == "bus_down"
        world.faults.replug()
        check_recovered(world, client)
        assert world.bus.counters.reopened == 1


def test_where_nobody_acknowledges_the_bus_says_so_within_two_seconds() -> None:
    with BusWorld() as world:
        client = world.enabled()
        world.faults.stall()
        world.run_until(lambda: world.state.bus == "bus_stalled", 2.5)
        assert "acknowledges" in str(world.bus.condition.error)
        world.faults.unstall()
        check_recovered(world, client)


def test_error_frames_with_the_id_of_the_feedback_are_no_feedback() -> None:
    with BusWorld() as world:
        client = world.enabled()
        world.run(0.1)
        before = world.machine.motor.counters
        ignored, missed = before.ignored_frames, before.missed_replies
        for _ in range(50):
            world.faults.inject_error(0x08 | 0x10, bytes([0xC8, *bytes(7)]))  # as if too hot
            world.tick()
        counters = world.machine.motor.counters
        assert (counters.ignored_frames, counters.missed_replies) == (ignored, missed)
        assert world.bus.counters.error_frames == 50
        assert world.in_phase(MotorPhase.ENABLED)
        assert client.result("motion.open")["outcome"] == "pressed_home"


def test_a_second_master_is_counted_and_cannot_keep_the_motor_enabled() -> None:
    with BusWorld() as world:
        client = world.start().client()
        world.inject(command(kd=1.0))
        world.inject(ENABLE)
        world.run(0.5)
        assert world.machine.motor.counters.foreign_commands == 2
        assert world.machine.is_disabled
        assert client.refusal("motor.enable") == "second_master"
        world.run(QUIET_AFTER_S)
        check_recovered(world, client)


@pytest.mark.parametrize("seed", range(3))
def test_frames_that_are_lost_doubled_late_or_changed_harm_nothing(seed: int) -> None:
    with BusWorld() as world:
        client = world.enabled()
        world.faults.seed(seed)
        for way in (world.faults.to_motor, world.faults.from_motor):
            way.drop(0.1)
            way.double(0.1)
            way.delay(0.004, in_order=False)
        world.faults.from_motor.corrupt(0.02)
        for method in ("motion.open", "motion.close", "motor.enable", "motion.open"):
            client.call(method, within_s=30.0)
        for way in (world.faults.to_motor, world.faults.from_motor):
            way.clear()
        world.run(1.5)
        assert client.result("motor.disable")["ok"]
        check_recovered(world, client)
