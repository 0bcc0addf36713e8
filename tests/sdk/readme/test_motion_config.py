"""The SDK's section "Tuning: MotionConfig": the type, and how its fields are set."""

import time
from dataclasses import fields, is_dataclass

import pytest

from litegrip_client import CommandError, LiteGrip, MotionConfig
from tests.drop_in import Daemon, Site
from tests.sdk import table
from tests.sdk.readme.scenes import speed_mm_s


def test_every_tunable_lives_on_one_dataclass_with_these_defaults(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    specified = dict(table.read("specification")["types"]["litegrip.MotionConfig"]["fields"])
    specified |= {"sleep_fn": time.sleep, "monotonic_fn": time.monotonic}
    del specified["press_safety"]  # the daemon has its own way of approaching softly
    assert is_dataclass(MotionConfig)
    ours = {one.name: getattr(gripper.motion_config, one.name) for one in fields(MotionConfig)}
    assert ours.pop("force_rate_n_s") > 0.0  # the daemon's own
    assert ours == specified
    in_force = gripper.info()["motion"]
    numbers = {name: value for name, value in ours.items() if not name.endswith("_fn")}
    daemons = {name: value for name, value in numbers.items() if name in in_force}
    assert {name: in_force[name] for name in daemons} == daemons
    assert numbers.keys() - daemons.keys() == {"force_ramp_n_s", "stop_speed_ratio"}
    config = MotionConfig()
    for name in numbers.keys() - {"frame_interval", "stop_speed_ratio"}:  # the daemon's own
        setattr(config, name, numbers[name] + 1)
        assert getattr(config, name) == numbers[name] + 1


def test_what_has_an_argument_is_overridden_per_call(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.motion_config = MotionConfig(speed_mm_s=25.0, force_n=10.0, enable_retries=9)
    with site.recorded(daemon) as moments:
        gripper.open(speed_mm_s=80.0)
    assert speed_mm_s(moments, 65.0, 80.0) == pytest.approx(80.0, rel=0.05)
    daemon.gripper.put_object(width_mm=60.0)
    assert gripper.grasp(force_n=15.0, hold_s=2.0).force_n == 15.0
    assert daemon.closing_torque_nm == pytest.approx(1.5, abs=0.1)
    gripper.disable()
    daemon.lose_to_motor = lambda frame: frame.data[-1] == 0xFC
    assert gripper.enable(retries=2).tries == 2


def test_what_a_field_cannot_be_is_refused_before_anything_moves(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.motion_config = MotionConfig(stall_ratio=1.5)
    with pytest.raises(CommandError, match="stall_ratio"):
        gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)
