"""Follower, leader and composite as LeRobot's loops use them, at the daemon's core."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import pytest

from lerobot_robot_litegrip import (
    LiteGripFollower,
    LiteGripFollowerConfig,
    LiteGripLeader,
    LiteGripLeaderConfig,
    LiteGripLeaderWithArm,
    LiteGripLeaderWithArmConfig,
    LiteGripWithArm,
    LiteGripWithArmConfig,
)
from lerobot_robot_litegrip.watched import StaleFiguresError
from lerobot_robot_trialarm import TrialCameraConfig
from litegrip_client import (
    CommandError,
    ConnectError,
    HardwareError,
    LeaseError,
    LiteGrip,
    StoppedError,
    TeleopBusyError,
    TeleopNotActiveError,
    TeleopNotReady,
)
from tests.client.rig import Bench, Heard
from tests.drop_in import Moment
from tests.world import PERIOD_S

FPS = 30


def a_follower(**settings: Any) -> LiteGripFollower:
    return LiteGripFollower(LiteGripFollowerConfig(channel="follow", **settings))


def a_leader(**settings: Any) -> LiteGripLeader:
    return LiteGripLeader(LiteGripLeaderConfig(channel="lead", **settings))


@contextmanager
def connected(device: Any) -> Iterator[Any]:
    device.connect()
    try:
        yield device
    finally:
        device.disconnect()


def loop(site: Bench, robot: Any, action: Callable[[], dict[str, Any]], seconds: float) -> Any:
    """Play LeRobot's loop for a while; return its last observation."""
    seen = None
    for _ in range(round(seconds * FPS)):
        seen = robot.get_observation()
        robot.send_action(action())
        site.run(1.0 / FPS)
    return seen


def to(pos: float, torque_nm: float = 1.0) -> Callable[[], dict[str, Any]]:
    return lambda: {"gripper.pos": pos, "gripper.torque": torque_nm}


def test_a_follower_goes_where_actions_send_it_and_tells_where_it_is(
    site: Bench, follow: Heard
) -> None:
    with connected(a_follower()) as robot:
        assert robot.is_connected
        assert robot.is_calibrated
        seen = loop(site, robot, to(25.0), 3.0)
        assert seen.keys() == robot.observation_features.keys()
        assert seen["gripper.pos"] == pytest.approx(25.0, abs=1.0)
        assert seen["gripper.vel"] == pytest.approx(0.0, abs=2.0)
        assert 0.0 < seen["gripper.age_s"] < 0.05
        assert seen["gripper.grasped"] == 0.0
        assert follow.is_energised
    assert not robot.is_connected
    site.run(0.5)
    assert not follow.is_energised


def test_what_was_sent_is_returned_clipped_by_the_names_of_the_features(
    site: Bench, follow: Heard
) -> None:
    with connected(a_follower()) as robot:
        assert robot.send_action({"gripper.pos": 140.0, "gripper.torque": 9.0}) == {
            "gripper.pos": 100.0,
            "gripper.torque": 3.0,
        }
        assert follow.asked("stream.set")[-1]["openness"] == 1.0
    with connected(a_follower(torque_action=False, torque_nm=0.6)) as robot:
        assert list(robot.action_features) == ["gripper.pos"]
        assert robot.send_action({"gripper.pos": 50.0}) == {"gripper.pos": 50.0}
        assert follow.asked("stream.set")[-1]["torque_nm"] == 0.6


def test_features_are_known_before_anything_is_connected(site: Bench) -> None:
    camera = TrialCameraConfig(fps=FPS, width=64, height=48)
    robot = a_follower(cameras={"front": camera})
    assert robot.observation_features["front"] == (48, 64, 3)
    assert robot.observation_features["gripper.stamp_s"] is float
    assert list(robot.action_features) == ["gripper.pos", "gripper.torque"]
    assert len(robot.cameras) == 1
    assert not robot.is_connected
    assert "gripper.stamp_s" not in a_follower(stamps=False).observation_features
    assert list(a_leader().action_features) == ["gripper.pos", "gripper.torque"]
    assert a_leader().feedback_features == {}


def test_images_come_with_the_figures(site: Bench, follow: Heard) -> None:
    camera = TrialCameraConfig(fps=FPS, width=64, height=48)
    with connected(a_follower(cameras={"front": camera}, stamps=False)) as robot:
        seen = robot.get_observation()
        assert seen.keys() == robot.observation_features.keys()
        assert seen["front"].shape == (48, 64, 3)
        assert robot.cameras["front"].is_connected
    assert not robot.cameras["front"].is_connected


def test_stamps_rise_also_for_a_loop_that_is_faster_than_the_motor_reports(
    site: Bench, follow: Heard
) -> None:
    with connected(a_follower()) as robot:
        stamps = [robot.get_observation()["gripper.stamp_s"] for _ in range(50)]
    assert 0.0 < stamps[0] < 0.05
    assert all(before < after for before, after in pairwise(stamps))
    assert stamps[-1] < 0.6


def fastest_mm_s(moments: list[Moment], beyond_mm: float = 0.0) -> float:
    """Return the jaws' fastest speed where they are opened further."""
    return max(
        abs(two.opening_mm - one.opening_mm) / PERIOD_S
        for one, two in pairwise(moments)
        if two.opening_mm > beyond_mm
    )


def test_the_jaws_come_from_afar_slowly_and_follow_as_fast_as_they_may(
    site: Bench, follow: Heard
) -> None:
    near_mm = 2 * 8.7  # a tenth of the travel from 10 %
    with connected(a_follower()) as robot, site.recorded(follow) as moments:
        loop(site, robot, to(10.0), 2.0)
        assert 40.0 < fastest_mm_s(moments, near_mm) < 65.0
        moments.clear()
        for pos in range(10, 90, 5):  # 130 mm/s
            loop(site, robot, to(float(pos)), 1.0 / FPS)
        assert fastest_mm_s(moments) > 110.0
        site.run(1.0)  # a policy that hangs, and then wants something else
        moments.clear()
        loop(site, robot, to(10.0), 1.0)
        assert 40.0 < fastest_mm_s(moments, near_mm) < 65.0


def test_jaws_hold_when_no_action_comes(site: Bench, follow: Heard) -> None:
    with connected(a_follower()) as robot:
        loop(site, robot, to(10.0), 0.5)
        site.run(0.3)
        with LiteGrip("follow") as watching:
            first = watching.get_state()
            assert (first.mode, first.enabled) == ("holding", True)
            assert first.openness is not None
            assert first.openness > 0.2, "it is on its way yet"
            site.run(2.0)
            assert watching.get_state().opening_mm == pytest.approx(first.opening_mm, abs=0.5)
        seen = loop(site, robot, to(10.0), 2.5)
        assert seen["gripper.pos"] == pytest.approx(10.0, abs=1.0)


def test_an_object_that_a_stream_squeezes_is_seen(site: Bench, follow: Heard) -> None:
    follow.gripper.put_object(width_mm=40.0)
    with connected(a_follower()) as robot:
        seen = loop(site, robot, to(0.0), 3.0)
        assert seen["gripper.grasped"] == 1.0
        assert seen["gripper.pos"] > 40.0
        assert seen["gripper.torque"] == pytest.approx(1.0, abs=0.2)
        assert loop(site, robot, to(90.0), 3.0)["gripper.grasped"] == 0.0


def test_figures_of_a_motor_that_is_silent_are_refused(site: Bench, follow: Heard) -> None:
    with connected(a_follower()) as robot:
        robot.get_observation()
        follow.gripper.power_off()
        begun_s = site.now_s
        with pytest.raises(StaleFiguresError, match=r"gripper follow: .*refused, they are \d+ ms"):
            [robot.get_observation() for _ in range(60)]
        assert site.now_s - begun_s < 2.0


def test_a_daemon_that_says_nothing_any_more_is_not_waited_for(site: Bench, follow: Heard) -> None:
    follow.instead["state.subscribe"] = {"subscription": 5, "state": follow.wire_state}
    follow.instead["state.unsubscribe"] = {"subscription": 5}
    begun_s = site.now_s
    site.run(0.2)
    with pytest.raises(ConnectError, match=r"did not answer with a state sample within 0\.5 s"):
        a_follower().connect()
    assert site.now_s - begun_s < 2.0


def test_a_stop_ends_the_loop_of_either_end_and_says_whose_it_is(
    site: Bench, lead: Heard, follow: Heard
) -> None:
    with connected(a_leader()) as leader, connected(a_follower()) as robot:
        loop(site, robot, leader.get_action, 0.5)
        for channel in ("follow", "lead"):
            with LiteGrip(channel) as other:
                other.software_stop("relax", "lunch")
        site.run(0.1)
        says = r"gripper {} is stopped \(relax\) by .*: lunch\n.*litegripctl -c {} clear"
        with pytest.raises(StoppedError, match=says.format("follow", "follow")):
            robot.send_action(to(50.0)())
        with pytest.raises(StoppedError, match=says.format("lead", "lead")):
            leader.get_action()
    for channel in ("lead", "follow"):
        with LiteGrip(channel) as other:
            other.clear_stop()


def test_a_gripper_of_somebody_else_is_refused_and_nothing_stays_connected(
    site: Bench, lead: Heard, follow: Heard
) -> None:
    for channel, device in (("follow", a_follower()), ("lead", a_leader())):
        with LiteGrip(channel) as other, other.lease("sorting"):
            with pytest.raises(LeaseError, match=rf"for sorting: .*litegripctl -c {channel} "):
                device.connect()
            assert not device.is_connected


def test_a_motor_that_does_not_obey_is_refused(site: Bench, follow: Heard) -> None:
    follow.gripper.power_off()
    with pytest.raises(HardwareError):
        a_follower().connect()
    with pytest.raises(ConnectError, match="not connected"):
        a_follower().get_observation()


def test_the_jaws_go_on_holding_where_that_is_wanted(site: Bench, follow: Heard) -> None:
    with connected(a_follower(disable_torque_on_disconnect=False)):
        pass
    site.run(1.0)
    assert follow.is_energised


def test_a_leader_is_slack_and_says_where_a_hand_has_its_jaws(site: Bench, lead: Heard) -> None:
    with connected(a_leader(torque_nm=0.7)) as leader:
        assert leader.is_connected
        with LiteGrip("lead") as watching:
            assert watching.get_state().mode == "relaxed"
        lead.gripper.push(lead.gripper.parameters.close_sign * 0.3)
        first = leader.get_action()
        site.run(0.5)
        second = leader.get_action()
        assert second["gripper.pos"] < first["gripper.pos"] - 5.0
        assert second["gripper.torque"] == 0.7
        lead.gripper.push(lead.gripper.parameters.close_sign * -3.0)
        site.run(2.0)
        with LiteGrip("lead") as watching:
            assert watching.get_state().openness == 1.0
        assert leader.get_action()["gripper.pos"] == 100.0
        lead.gripper.power_off()
        with pytest.raises(StaleFiguresError):
            [leader.get_action() for _ in range(60)]


def test_a_follower_follows_a_leader_of_the_other_mount(
    site: Bench, lead: Heard, follow: Heard
) -> None:
    with connected(a_leader()) as leader, connected(a_follower()) as robot:
        lead.gripper.push(lead.gripper.parameters.close_sign * 0.3)
        loop(site, robot, leader.get_action, 0.6)
        lead.gripper.push(0.0)
        seen = loop(site, robot, leader.get_action, 2.0)
        assert seen["gripper.pos"] == pytest.approx(leader.get_action()["gripper.pos"], abs=1.0)


# The daemons teleoperate


def by_the_daemons() -> tuple[LiteGripLeader, LiteGripFollower]:
    return a_leader(mode="daemon"), a_follower(mode="daemon", leader_host="127.0.0.1")


def test_the_daemons_teleoperate_and_lerobot_watches(
    site: Bench, lead: Heard, follow: Heard
) -> None:
    leader, robot = by_the_daemons()
    with connected(leader), connected(robot):
        assert follow.asked("teleop.start")[-1]["reflect"] is True
        assert lead.asked("teleop.start")[-1]["reflect_n"] == 4.0
        lead.gripper.push(lead.gripper.parameters.close_sign * 0.3)
        loop(site, robot, leader.get_action, 0.6)
        lead.gripper.push(0.0)
        seen = loop(site, robot, leader.get_action, 1.0)
        assert seen["gripper.pos"] == pytest.approx(leader.get_action()["gripper.pos"], abs=1.0)
        assert seen["gripper.pos"] < 65.0
        assert follow.asked("stream.set") == []


def test_the_end_of_teleoperation_ends_the_loop(site: Bench, lead: Heard, follow: Heard) -> None:
    leader, robot = by_the_daemons()
    with connected(leader), connected(robot):
        loop(site, robot, leader.get_action, 0.2)
        robot.gripper._gripper.teleop_stop()
        site.run(0.1)
        with pytest.raises(TeleopNotActiveError, match="gripper follow: teleoperation has ended"):
            robot.send_action(to(50.0)())
        robot.gripper._gripper.stream(2.0).set_target(openness=0.2)
        site.run(0.1)
        with pytest.raises(TeleopNotActiveError):  # also while it moves otherwise
            robot.send_action(to(50.0)())
        with LiteGrip("lead") as other:
            other.software_stop("hold", "lunch")
        site.run(0.1)
        with pytest.raises(StoppedError, match="lunch"):
            leader.get_action()


def test_a_follower_without_its_leader_says_how_far_it_has_come(site: Bench, follow: Heard) -> None:
    with pytest.raises(TeleopNotReady, match="gripper follow does not follow: waiting"):
        by_the_daemons()[1].connect()
    assert site.now_s < 1025.0


def test_daemons_that_teleoperate_already_go_on_afterwards(
    site: Bench, lead: Heard, follow: Heard
) -> None:
    with LiteGrip("lead") as one, LiteGrip("follow") as other:
        one.enable()
        other.enable()
        one.teleop_start("master")
        other.teleop_start("slave", "127.0.0.1")
        leader, robot = by_the_daemons()
        with connected(leader), connected(robot):
            loop(site, robot, leader.get_action, 0.5)
        assert other.teleop_status()["active"]
        assert lead.is_energised
        assert len(follow.asked("teleop.start")) == 1
        wrong = LiteGripFollower(
            LiteGripFollowerConfig(channel="lead", mode="daemon", leader_host="127.0.0.1")
        )
        with pytest.raises(TeleopBusyError, match="gripper lead is a master"):
            wrong.connect()


# Calibration


@pytest.fixture
def bare(site: Bench) -> Heard:
    """Return the daemon of a gripper that is not calibrated, and does not know its mount."""
    daemon = Heard("follow", calibrated=False)
    site.add(daemon)
    return daemon


def answering(monkeypatch: pytest.MonkeyPatch, answer: str | None) -> list[str]:
    asked: list[str] = []

    def ask(question: str) -> str:
        asked.append(question)
        if answer is None:
            raise EOFError
        return answer

    monkeypatch.setattr("builtins.input", ask)
    return asked


def test_a_calibration_asks_before_it_moves(
    site: Bench, bare: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = answering(monkeypatch, " ")
    robot = a_follower(mount="normal")
    with pytest.raises(CommandError, match="the gripper is not calibrated"):
        robot.connect()
    assert len(asked) == 1
    assert "gripper follow: its jaws will move" in asked[0]
    assert bare.asked("calibration.zero") == []
    answering(monkeypatch, "84.5")
    with connected(robot):
        assert robot.is_calibrated
        assert bare.asked("calibration.zero")[0]["stroke_mm"] == 84.5
        robot.get_observation()
        asked = answering(monkeypatch, "")
        robot.calibrate()
        assert len(asked) == 1, "also the next time"
        assert len(bare.asked("calibration.zero")) == 1


def test_nothing_moves_where_nobody_can_answer(
    site: Bench, bare: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    answering(monkeypatch, None)
    with pytest.raises(CommandError, match=r"there is no terminal\n.*litegripctl -c follow zero"):
        a_follower(mount="normal").connect()
    answering(monkeypatch, "wide")
    with pytest.raises(CommandError, match="the opening is 'wide'"):
        a_follower(mount="normal").connect()
    assert bare.asked("motor.enable") == []


def test_one_that_is_not_calibrated_connects_for_lerobot_calibrate_and_stays_disabled(
    site: Bench, bare: Heard
) -> None:
    robot = a_follower()
    robot.connect(calibrate=False)
    assert robot.is_connected
    assert not robot.is_calibrated
    assert bare.asked("motor.enable") == []
    robot.disconnect()


# An arm with this gripper

ARM = {"type": "trial_arm", "port": "nowhere"}


def test_an_arm_has_this_gripper_in_place_of_its_own(
    site: Bench, lead: Heard, follow: Heard
) -> None:
    camera = TrialCameraConfig(fps=FPS, width=64, height=48)
    robot = LiteGripWithArm(
        LiteGripWithArmConfig(channel="follow", arm=ARM, cameras={"front": camera})
    )
    leader = LiteGripLeaderWithArm(
        LiteGripLeaderWithArmConfig(channel="lead", arm={"type": "trial_arm_leader"})
    )
    actions = ["elbow.pos", "gripper.pos", "gripper.torque", "shoulder.pos"]
    assert sorted(robot.action_features) == sorted(leader.action_features) == actions
    assert len(robot.cameras) == 1
    with connected(leader), connected(robot):
        assert leader.is_connected
        assert robot.is_connected
        seen = loop(site, robot, leader.get_action, 2.0)
        assert seen.keys() == robot.observation_features.keys()
        assert seen["shoulder.pos"] > 50.0
        assert seen["gripper.pos"] == pytest.approx(leader.get_action()["gripper.pos"], abs=1.0)
        assert robot.send_action(leader.get_action()).keys() == robot.action_features.keys()
    assert not robot.arm.is_connected
    assert not leader.arm.is_connected


def test_what_arm_it_is_must_be_said(site: Bench) -> None:
    with pytest.raises(ValueError, match=r"arm needs .*'{type: so101_follower, port: ...}'"):
        LiteGripWithArm(LiteGripWithArmConfig(channel="follow"))
    with pytest.raises(ValueError, match=r"arm needs .*'{type: so101_leader, port: ...}'"):
        LiteGripLeaderWithArm(LiteGripLeaderWithArmConfig(arm={"port": "/dev/ttyACM0"}))


def test_a_gripper_that_is_stopped_moves_no_arm(site: Bench, follow: Heard) -> None:
    robot = LiteGripWithArm(LiteGripWithArmConfig(channel="follow", arm=ARM))
    with connected(robot):
        with LiteGrip("follow") as other:
            other.software_stop()
        site.run(0.1)
        with pytest.raises(StoppedError):
            robot.send_action({"shoulder.pos": 9.0, "elbow.pos": 9.0, **to(50.0)()})
        assert robot.arm.get_observation()["shoulder.pos"] == 0.0
    with LiteGrip("follow") as other:
        other.clear_stop()


def test_a_calibration_is_of_the_arm_and_then_of_the_gripper(
    site: Bench, bare: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked = answering(monkeypatch, " ")
    robot = LiteGripWithArm(LiteGripWithArmConfig(channel="follow", arm=ARM))
    leader = LiteGripLeaderWithArm(
        LiteGripLeaderWithArmConfig(channel="follow", arm={"type": "trial_arm_leader"})
    )
    for device in (robot, leader):
        monkeypatch.setattr(device.arm, "calibrate", lambda: asked.append("the arm"))
        device.connect(calibrate=False)
        device.calibrate()
        device.disconnect()
        assert asked.pop(0) == "the arm"
        assert "gripper follow: its jaws will move" in asked.pop(0)


def test_neither_stays_connected_when_one_cannot_be(site: Bench, follow: Heard) -> None:
    robot = LiteGripWithArm(LiteGripWithArmConfig(channel="elsewhere", arm=ARM))
    with pytest.raises(ConnectError):
        robot.connect()
    assert not robot.arm.is_connected
    leader = LiteGripLeaderWithArm(
        LiteGripLeaderWithArmConfig(channel="elsewhere", arm={"type": "trial_arm_leader"})
    )
    with pytest.raises(ConnectError):
        leader.connect()
    assert not leader.arm.is_connected
