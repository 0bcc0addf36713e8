"""What the SDK's reading members return, its values, and what a script says of its gripper."""

import re
from pathlib import Path

import pytest

from litegrip_client import (
    CalibrationData,
    CANTimeoutError,
    CommandError,
    GripperConfig,
    HardwareError,
    LiteGrip,
    MoveProgress,
    NotInitializedError,
    ParameterError,
    Trajectory,
    TrajectorySample,
    default_calib_path,
    resolve_path,
    trajectory_dir,
)
from litegripd.model.gripper import MOTOR_TYPES
from tests.drop_in import Daemon, Site
from tests.geometry import STROKE_MM


def test_what_is_measured_is_a_number(site: Site, daemon: Daemon, gripper: LiteGrip) -> None:
    site.run(0.2)
    state = gripper.get_state(wait=True)
    assert gripper.get_position() == state.position_mm == state.aperture_mm == state.opening_mm
    assert gripper.get_position() == pytest.approx(60.0, abs=0.5)
    assert gripper.get_position_rad() == pytest.approx(daemon.gripper.position_rad, abs=0.001)
    assert (gripper.get_torque(), gripper.get_force()) == pytest.approx((0.0, 0.0), abs=0.3)
    assert gripper.get_temperature() == (state.temperature_mos, state.temperature_coil)
    assert (gripper.get_error(), state.is_error, state.is_enabled) == (1, False, True)
    assert (gripper.is_enabled, gripper.can_id, gripper.mst_id) == (True, 8, 0x18)
    assert (gripper.is_moving(), gripper.is_grasped(), gripper.poll()) == (False, False, True)
    assert f"{gripper.get_position():.1f} {gripper.get_temperature()[0]:+.0f}" == "60.0 +25"
    daemon.gripper.put_object(width_mm=30.0)
    assert gripper.grasp(10.0, until="verdict")
    site.run(1.0)
    assert gripper.is_grasped()
    assert gripper.get_force() == pytest.approx(10.0, abs=1.0)  # on both mounts


def test_a_motor_that_is_silent_has_no_figures_and_is_not_ready(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    daemon.lose_from_motor = lambda _frame: True
    site.run(1.0)
    for read in (gripper.get_position, gripper.get_force, gripper.get_temperature):
        with pytest.raises(CANTimeoutError, match="has not answered lately"):
            read()
    assert gripper.poll(0.2) is False
    began_s = site.now_s
    assert gripper.wait_for_ready(timeout=1.0) is False
    assert site.now_s - began_s == pytest.approx(1.0, abs=0.1)
    with pytest.raises(CANTimeoutError):
        gripper.open()
    daemon.lose_from_motor = lambda _frame: False
    assert gripper.wait_for_ready() is False  # it has latched that communication was lost
    assert gripper.clear_fault() is True
    assert gripper.wait_for_ready() is True
    assert gripper.get_position() == pytest.approx(60.0, abs=0.5)


def test_a_motion_without_an_enabled_motor_is_not_initialized(daemon: Daemon) -> None:
    with LiteGrip("can0") as gripper, pytest.raises(NotInitializedError):
        gripper.open()
    assert issubclass(NotInitializedError, HardwareError)


def test_progress_has_the_sdks_fields(gripper: LiteGrip) -> None:
    seen: list[MoveProgress] = []
    gripper.move_at_speed(20.0, 40.0, progress=seen.append)
    assert {one.phase for one in seen} == {"move"}
    assert seen[0].delta_rad == 0.0
    for number, one in enumerate(seen[1:], 1):
        assert one.delta_rad == pytest.approx(one.pos_rad - seen[number - 1].pos_rad)
        assert one.win_delta_rad == pytest.approx(one.pos_rad - seen[max(number - 5, 0)].pos_rad)
        assert one.temperature_coil is not None
    assert abs(seen[10].win_delta_rad) > 0.1


# What a script says of its gripper


@pytest.mark.parametrize(
    "right",
    [
        {"mst_id": 0x18, "canfd_mode": False, "motor_type": "DM4310"},
        {"config": GripperConfig()},
        {"config": GripperConfig(can_id=8, mst_id=0x18, kp=100.0)},
    ],
)
def test_what_is_as_the_script_says_is_connected_to(
    daemon: Daemon, right: dict[str, object]
) -> None:
    make: type = LiteGrip
    with make("can0", **right) as gripper:
        assert gripper.is_connected


@pytest.mark.parametrize(
    ("wrong", "name"),
    [
        ({"mst_id": 0x19}, "mst_id 0x18, not 0x19"),
        ({"motor_type": "DM4340"}, "motor_type DM4310, not DM4340"),
        ({"motor_type": "DM1"}, "motor_type DM4310, not DM1"),
        ({"config": GripperConfig(kp=150.0)}, "kp 100.0, not 150.0"),
        ({"config": GripperConfig(can_id=9)}, "can_id 0x08, not 0x09"),
    ],
)
def test_what_is_not_as_the_script_says_is_not_connected_to(
    daemon: Daemon, wrong: dict[str, object], name: str
) -> None:
    make: type = LiteGrip
    gripper = make("can0", **wrong)
    with pytest.raises(CommandError, match=name) as caught:
        gripper.connect()
    assert caught.value.reason == "wrong_gripper"
    assert not gripper.is_connected


def test_who_names_another_type_of_motor_is_told_where_the_types_stand(daemon: Daemon) -> None:
    make: type = LiteGrip
    with pytest.raises(CommandError) as caught:
        make("can0", motor_type="DM1").connect()
    page = re.search(r"docs/\S+\.md", str(caught.value.hint))
    assert page is not None
    text = (Path(__file__).parents[3] / page[0]).read_text(encoding="utf-8")
    assert all(f"\n| `{name}`" in text for name in MOTOR_TYPES)


def test_can_fd_and_what_is_no_config_are_rejected_at_once() -> None:
    make: type = LiteGrip
    with pytest.raises(ParameterError, match="classic CAN"):
        make("can0", canfd_mode=True)
    with pytest.raises(ParameterError, match="it must be a GripperConfig"):
        make("can0", config={"kp": 1})


def test_a_config_object_can_be_filled_and_the_daemons_cannot(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    mine = GripperConfig()
    mine.can_channel = "can3"  # type: ignore[misc] # the SDK's scripts do
    mine.kp = 120.0
    assert (mine.channel, mine.kp, mine.mount, mine.max_stroke_mm) == (
        "can3",
        120.0,
        None,
        STROKE_MM,
    )
    theirs = gripper.config
    assert (theirs.mount, theirs.nm_to_n) == (daemon.mount, 10.0)
    assert theirs.max_stroke_mm == STROKE_MM
    with pytest.raises(AttributeError, match=r"config\.kp cannot be set"):
        theirs.kp = 150.0
    with LiteGrip("can0", config=theirs) as again:
        assert again.config == theirs


# Values without a gripper


def test_a_trajectory_is_made_filled_and_asked() -> None:
    taught = Trajectory()
    assert (len(taught), taught.duration) == (0, 0.0)
    with pytest.raises(ParameterError):
        taught.openness_at(0.0)
    samples = taught.samples
    assert isinstance(samples, list)
    samples += [TrajectorySample(t, t / 2.0, 0.0, 0.0, 0.0) for t in (0.0, 1.0, 2.0)]
    assert (len(taught), taught.duration) == (3, 2.0)
    assert [taught.openness_at(t) for t in (-1.0, 0.5, 1.5, 9.0)] == [0.0, 0.25, 0.75, 1.0]
    assert Trajectory.from_bytes(taught.to_bytes()).samples == samples
    samples.append(TrajectorySample(1.0, 0.5, 0.0, 0.0, 0.0))
    with pytest.raises(CommandError, match="time runs backwards"):
        taught.to_bytes()


def test_constants_and_paths(site: Site) -> None:
    assert (CalibrationData().mount, CalibrationData().calibrated) == ("normal", False)
    assert default_calib_path("can1").endswith("/.litegrip/can1_calibration.json")
    assert resolve_path("pick") == f"{trajectory_dir()}/pick.lgt"


def test_a_time_limit_below_0_is_refused(gripper: LiteGrip) -> None:
    with pytest.raises(ParameterError, match=r"^timeout is -1, it must be 0 or more$"):
        gripper.wait_for_ready(-1)
    with pytest.raises(ParameterError, match=r"^timeout_s is -1, it must be 0 or more$"):
        gripper.poll(-1)
