"""Frames that are lost, late, doubled or changed on their way in one direction."""

from collections.abc import Callable
from itertools import pairwise

import pytest

from litegripd.sim.faults import FrameFaults
from litegripd.sim.interface import FRAME_TIME_S
from tests.sim.driving import command
from tests.sim.faulty import Rig, code_of


def test_frames_are_dropped_on_the_way_to_the_motor(rig: Rig) -> None:
    rig.faults.to_motor.drop_next(2)
    assert [rig.answers() for _ in range(3)] == [0, 0, 1]
    assert len(rig.at_motor) == 1


def test_frames_are_dropped_on_the_way_from_the_motor(rig: Rig) -> None:
    rig.faults.from_motor.drop_next(2)
    assert [rig.answers() for _ in range(3)] == [0, 0, 1]
    assert len(rig.at_motor) == 3


def test_frames_are_dropped_by_chance_and_the_same_for_the_same_seed(rig: Rig) -> None:
    rig.faults.to_motor.drop(0.3)
    runs = []
    for seed in (1, 1, 2):
        rig.faults.seed(seed)
        runs.append([rig.answers() for _ in range(200)])
    assert runs[0] == runs[1] != runs[2]
    assert 110 < sum(runs[0]) < 170


def test_frames_are_late_on_the_way_to_the_motor(rig: Rig) -> None:
    rig.faults.to_motor.delay(0.05)
    sent_s = rig.clock.now_s
    rig.send()
    rig.wait(0.049)
    assert rig.received() == []
    assert rig.at_motor == []
    rig.wait(0.0015)
    assert len(rig.received()) == 1
    assert rig.at_motor[0][0] == pytest.approx(sent_s + 0.05 + FRAME_TIME_S)


def test_frames_are_late_on_the_way_from_the_motor(rig: Rig) -> None:
    rig.faults.from_motor.delay(0.05)
    rig.send()
    assert len(rig.at_motor) == 1
    rig.wait(0.05)
    assert rig.received() == []
    rig.wait(2 * FRAME_TIME_S)
    assert len(rig.received()) == 1


def test_none_overtakes_another_when_the_delay_ends(rig: Rig) -> None:
    rig.faults.to_motor.delay(0.05)
    rig.send(command(q=1.0))
    rig.faults.to_motor.delay(0.0)
    rig.send(command(q=2.0))
    rig.wait(0.04)
    assert rig.received() == []
    rig.wait(0.02)
    assert len(rig.received()) == 2
    assert [frame for _, frame in rig.at_motor] == [command(q=1.0), command(q=2.0)]


def test_frames_come_out_of_order_when_asked(rig: Rig) -> None:
    rig.faults.to_motor.delay(0.05, in_order=False)
    sent = [command(q=number * 0.1) for number in range(20)]
    for frame in sent:
        rig.send(frame)
    rig.wait(0.06)
    assert len(rig.received()) == len(sent)
    came = [frame for _, frame in rig.at_motor]
    assert came != sent
    assert set(came) == set(sent)
    times = [at_s for at_s, _ in rig.at_motor]
    assert all(earlier <= later for earlier, later in pairwise(times))


def test_late_frames_are_lost_with_the_link(rig: Rig) -> None:
    rig.faults.to_motor.delay(0.05)
    rig.send()
    rig.faults.link_down()
    rig.faults.link_up()
    rig.wait(0.1)
    assert code_of(lambda: rig.bus.recv(0)) == 100
    assert rig.received() == []
    assert rig.at_motor == []


def test_frames_are_doubled(rig: Rig) -> None:
    rig.faults.to_motor.double(1.0)
    assert rig.answers() == 2
    rig.faults.from_motor.double(1.0)
    assert rig.answers() == 4
    assert len(rig.at_motor) == 4


def test_frames_are_corrupted(rig: Rig) -> None:
    rig.faults.to_motor.corrupt(1.0)
    for _ in range(50):
        rig.answers(command())
    came = [frame for _, frame in rig.at_motor]
    assert len(came) == 50
    assert command() not in came
    assert all(frame.can_id == 0x08 and len(frame.data) == 8 for frame in came)
    assert len(set(came)) > 40


def test_all_is_switched_off_at_once(rig: Rig) -> None:
    for direction in (rig.faults.to_motor, rig.faults.from_motor):
        direction.drop(1.0)
        direction.drop_next(9)
        direction.delay(1.0)
        direction.double(1.0)
        direction.corrupt(1.0)
        assert rig.answers() == 0
        direction.clear()
    assert rig.works()


@pytest.mark.parametrize("bad", [-0.1, 1.1, float("nan")])
@pytest.mark.parametrize("fault", [FrameFaults.drop, FrameFaults.double, FrameFaults.corrupt])
def test_a_bad_probability_is_refused(
    rig: Rig, fault: Callable[[FrameFaults, float], None], bad: float
) -> None:
    with pytest.raises(ValueError, match="a probability must be 0 to 1"):
        fault(rig.faults.to_motor, bad)
    assert not rig.faults.to_motor.is_used


def test_a_bad_delay_or_number_is_refused(rig: Rig) -> None:
    for bad_s in (-0.1, float("nan"), float("inf")):
        with pytest.raises(ValueError, match="the delay must be finite and not negative"):
            rig.faults.to_motor.delay(bad_s)
    with pytest.raises(ValueError, match="must not be negative"):
        rig.faults.to_motor.drop_next(-1)
    assert not rig.faults.to_motor.is_used
