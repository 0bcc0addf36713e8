"""Frames without stiffness: slack jaws and torques, which lapse; and how a follower keeps up."""

import math

import pytest

import litegrip
from litegrip import LiteGrip
from tests.drop_in import Daemon, Site
from tests.sdk.programs.hand_and_twin import follow

PERIOD_S = 0.005


def at_200_hz(site: Site, seconds: float) -> range:
    return range(round(seconds / PERIOD_S))


def test_slack_jaws_give_way_to_a_hand_and_then_hold(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    sign = daemon.gripper.parameters.close_sign
    site.after(0.3, lambda: daemon.gripper.push(-0.5 * sign))
    before_mm = daemon.gripper.opening_mm
    for _ in at_200_hz(site, 0.6):
        assert gripper.send_mit_frame(0.0, 0.0, 0.0)
        site.run(PERIOD_S)
    assert daemon.gripper.opening_mm > before_mm + 3.0
    daemon.gripper.push(0.0)
    site.run(1.0)  # no frame for longer than 0.2 s: the jaws hold
    held_mm = daemon.gripper.opening_mm
    daemon.gripper.push(-0.5 * sign)
    site.run(0.5)
    assert daemon.gripper.opening_mm == pytest.approx(held_mm, abs=0.7)


def test_a_torque_squeezes_as_a_force_and_lapses(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    daemon.gripper.put_object(width_mm=50.0)
    sign = gripper.config.close_sign
    speeds = []
    before_mm = daemon.gripper.opening_mm
    for step in at_200_hz(site, 3.0):
        tau = sign * min(1.5, 0.5 + 0.005 * step)
        assert gripper.send_mit_frame(0.0, 0.0, 0.0, tau=tau)
        site.run(PERIOD_S)
        speeds.append(abs(daemon.gripper.opening_mm - before_mm) / PERIOD_S)
        before_mm = daemon.gripper.opening_mm
    assert gripper.get_force() == pytest.approx(15.0, rel=0.15)
    assert max(speeds) < 200.0
    site.run(1.0)
    assert daemon.is_energised


def test_a_torque_beyond_the_grips_is_refused(gripper: LiteGrip, daemon: Daemon) -> None:
    with pytest.raises(litegrip.CommandError, match="push_nm"):
        gripper.send_mit_frame(0.0, 0.0, 0.0, tau=9.0)


def test_stop_fifty_times_a_second_is_cheap_and_latches_nothing(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    before = len(list(daemon.controller.jobs))
    for _ in range(100):
        gripper.stop()
        assert gripper.refresh_status()
        site.run(0.02)
    assert len(list(daemon.controller.jobs)) <= before + 1
    assert gripper.open()


def test_a_twin_keeps_up_with_a_sweep_of_110_mm_s(site: Site) -> None:
    site.add(Daemon("can1", "reverse"))
    twin = LiteGrip("can1", mount="reverse", disable_on_disconnect=False)
    twin.connect()
    twin.enable()
    sweep = [0.5 - 0.45 * math.cos(2.0 * math.pi * t / 50.0 / 2.2) for t in range(165)]
    fastest_mm_s = 0.45 * 87.0 * 2.0 * math.pi / 2.2
    assert fastest_mm_s == pytest.approx(110.0, abs=5.0)
    assert follow(twin, sweep, site.run) < 12.0
    twin.disconnect()
