"""The SDK's section "Tuning: MotionConfig": the type, and how its fields are set."""

import time
from collections.abc import Callable
from dataclasses import fields, is_dataclass

import pytest

from litegrip_client import CommandError, LiteGrip, MotionConfig
from tests.drop_in import Daemon, Site
from tests.sdk.readme.scenes import speed_mm_s

DEFAULTS: dict[str, object] = {
    "speed_mm_s": 50.0,
    "grasp_speed_mm_s": 50.0,
    "margin": 0.05,
    "frame_interval": 0.005,
    "sample_interval": 0.05,
    "settle_s": 0.3,
    "reach_tol": 0.02,
    "stall_cycles": 5,
    "stall_ratio": 0.2,
    "stall_delta": 0.0015,
    "max_lead_mm": 4.0,
    "press_overshoot": 0.05,
    "press_zone_mm": 2.0,
    "stop_lead_mm": 0.7,
    "stop_tol": 0.02,
    "force_n": 20.0,
    "hold_interval": 0.2,
    "hold_kp": 150.0,
    "hold_kd": 2.0,
    "enable_retries": 3,
    "enable_retry_interval": 0.2,
    "calib_kp": 20.0,
    "calib_kd": 2.0,
    "calib_step_rad": 0.05,
    "calib_tau_limit": 2.0,
    "calib_stall_delta": 0.0015,
    "calib_stall_cycles": 5,
    "calib_max_iter": 200,
    "sleep_fn": time.sleep,
    "monotonic_fn": time.monotonic,
}
"""The SDK's table."""

NOT_IN_THE_TABLE = {
    *("force_rate_n_s", "force_ramp_n_s", "stop_speed_ratio"),
    *("stop_torque_nm", "stop_torque_cycles", "stop_release_s"),
}


def test_every_tunable_lives_on_one_dataclass_with_these_defaults(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    assert is_dataclass(MotionConfig)
    assert {one.name for one in fields(MotionConfig)} == DEFAULTS.keys() | NOT_IN_THE_TABLE
    assert {name: getattr(gripper.motion_config, name) for name in DEFAULTS} == DEFAULTS
    in_force = gripper.info()["motion"]
    numbers = {name: value for name, value in DEFAULTS.items() if not name.endswith("_fn")}
    assert {name: in_force[name] for name in numbers} == numbers


def test_the_example(site: Site, daemon: Daemon) -> None:
    daemon.gripper.put_object(width_mm=15.0)
    with LiteGrip("can0") as gripper:
        gripper.enable()
        gripper.motion_config = MotionConfig(speed_mm_s=25.0, force_n=10.0)
        with site.recorded(daemon) as moments:
            gripper.close()
        assert speed_mm_s(moments, 55.0, 20.0) == pytest.approx(25.0, rel=0.03)

        gripper.motion_config.force_n = 5.0
        held = []
        site.after(3.0, lambda: held.append(daemon.closing_torque_nm))
        site.after(3.1, interrupt)
        with pytest.raises(KeyboardInterrupt):
            gripper.grasp()
        assert held == pytest.approx([0.5], abs=0.05)


def interrupt() -> None:
    raise KeyboardInterrupt


def test_an_override_belongs_to_its_instance(site: Site, daemon: Daemon, gripper: LiteGrip) -> None:
    gripper.open()
    gripper.disable_on_disconnect = False
    gripper.disconnect()
    with LiteGrip("can0", disable_on_disconnect=False) as another:
        another.enable()
        another.motion_config = MotionConfig(speed_mm_s=100.0)
        with site.recorded(daemon) as moments:
            another.close()
        assert speed_mm_s(moments, 77.0, 30.0) == pytest.approx(100.0, rel=0.05)
    gripper.connect()
    with site.recorded(daemon) as moments:
        gripper.open()
    assert speed_mm_s(moments, 30.0, 77.0) == pytest.approx(50.0, rel=0.03)
    assert gripper.motion_config.speed_mm_s == 50.0


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


@pytest.mark.parametrize("name", DEFAULTS)
def test_every_field_is_writable_by_itself(name: str) -> None:
    config = MotionConfig()
    value = DEFAULTS[name]
    if isinstance(value, int):
        value += 1
    elif isinstance(value, float) and name != "frame_interval":
        value *= 1.5
    setattr(config, name, value)
    assert getattr(config, name) == value


@pytest.mark.parametrize("name", ["sleep_fn", "monotonic_fn"])
def test_the_clock_is_the_daemons_and_other_seams_are_refused(gripper: LiteGrip, name: str) -> None:
    """Where the daemon differs: it simulates by itself (`litegripd --simulate`)."""
    make: Callable[..., MotionConfig] = MotionConfig
    with pytest.raises(CommandError, match="--simulate"):
        make(**{name: lambda *_: 0.0})
    with pytest.raises(CommandError, match="--simulate"):
        setattr(gripper.motion_config, name, lambda *_: 0.0)


def test_frame_interval_is_the_daemons_period_and_cannot_be_changed(gripper: LiteGrip) -> None:
    """Where the daemon differs: its configuration sets the rate, for all clients."""
    gripper.motion_config.frame_interval = 0.005
    assert gripper.close()
    with pytest.raises(CommandError, match="read-only"):
        gripper.motion_config.frame_interval = 0.01


def test_what_a_field_cannot_be_is_refused_before_anything_moves(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.motion_config = MotionConfig(stall_ratio=1.5)
    with pytest.raises(CommandError, match="stall_ratio"):
        gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)
