"""What the SDK's reading members return, its values, and what a script says of its gripper."""

import json
import math
import time
from collections.abc import Callable
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
    UnitConversion,
    default_calib_path,
    resolve_path,
    trajectory_dir,
)
from litegripd.model.gripper import FASTEST_RAD_S
from tests.drop_in import Daemon, Site
from tests.geometry import SPAN_MM, STROKE_MM, TRAVEL_RAD, WORK_MM
from tests.sdk.readme.trajectories import push


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
    assert gripper.get_force() == pytest.approx(10.0, abs=1.0)


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


@pytest.mark.parametrize(
    "wrong",
    [
        lambda g: g.grasp(force_n="much"),
        lambda g: g.goto(500.0),
        lambda g: g.goto(math.nan),
        lambda g: g.goto(50.0, 10_000.0),
        lambda g: g.open(speed_mm_s=-1.0),
        lambda g: g.teleop_start("sideways"),
        lambda g: g.record(0.0),
        lambda g: g.load_template("sideways"),
    ],
)
def test_a_bad_argument_is_a_value_error_too(gripper: LiteGrip, wrong: object) -> None:
    assert callable(wrong)
    with pytest.raises(ParameterError) as caught:
        wrong(gripper)
    assert isinstance(caught.value, CommandError)
    assert isinstance(caught.value, ValueError)


def test_a_missing_trajectory_is_a_missing_file(site: Site) -> None:
    with pytest.raises(FileNotFoundError, match="there is no trajectory") as caught:
        Trajectory.load("nothing")
    assert isinstance(caught.value, CommandError)


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


def test_calling_connect_twice_is_true_both_times(daemon: Daemon) -> None:
    gripper = LiteGrip("can0")
    assert gripper.connect() is True
    assert gripper.connect() is True
    gripper.disconnect()


def test_a_calibration_is_loaded_and_a_mount_read_before_connecting(daemon: Daemon) -> None:
    gripper = LiteGrip("can0")
    assert gripper.load_calibration(template=daemon.mount) is True
    assert gripper.mount == daemon.mount
    assert gripper.connect() is True
    gripper.disconnect()
    with pytest.raises(ConnectionError):
        _ = gripper.mount
    assert LiteGrip("can0").mount == daemon.mount


def test_a_calibration_by_hand_takes_the_extremes_and_the_stroke_of_the_script(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.load_template(daemon.mount)
    gripper.config.max_stroke_mm = 84.0
    push(site, daemon, (0.5, 0.4), (2.0, -0.4), (5.0, 0.0))
    data = gripper.calibrate_manual(duration=6.0, settle_time=0.5)
    assert data.mount == daemon.mount
    assert data.travel_range == pytest.approx(TRAVEL_RAD, abs=0.08)
    assert data.stroke_mm == pytest.approx(84.0)
    assert data.travel_mm == pytest.approx(85.0)
    assert (data.work_stroke_mm, gripper.config.work_stroke_mm) == (WORK_MM, WORK_MM)
    assert data.calibration_time == pytest.approx(time.time(), abs=60.0)
    assert gripper.config.pos_closed_rad == pytest.approx(data.zero_position)
    assert gripper.get_state().mode == "holding"


@pytest.mark.parametrize("method", ["zero", "calibrate", "calibrate_guided"])
def test_a_script_says_how_far_the_jaws_open_as_the_vendors_readme_does(
    daemon: Daemon, gripper: LiteGrip, method: str
) -> None:
    gripper.config.max_stroke_mm = 83.0
    data = getattr(gripper, method)()
    assert data.rad_to_mm == pytest.approx(84.0 / data.travel_range)
    assert gripper.config.travel_mm == pytest.approx(84.0)
    assert gripper.rescale_calibration(STROKE_MM).travel_mm == pytest.approx(SPAN_MM)
    assert gripper.config.travel_mm == pytest.approx(SPAN_MM)
    assert gripper.config.max_stroke_mm == 83.0
    gripper.config.max_stroke_mm = 120.0
    with pytest.raises(ParameterError, match="the configured stroke is 85 mm"):
        getattr(gripper, method)()


def test_a_work_stroke_is_where_open_goes(daemon: Daemon, gripper: LiteGrip) -> None:
    gripper.load_template(daemon.mount)
    result = gripper.open()
    assert (result.ok, result.reached, result.stalled) == (True, True, False)
    assert daemon.gripper.opening_mm == pytest.approx(WORK_MM, abs=1.0)
    assert gripper.get_state().work_stroke_mm == WORK_MM
    saved = json.loads(Path(gripper.save_calibration()).read_text(encoding="utf-8"))
    assert saved["work_stroke_mm"] == WORK_MM


def test_a_file_of_earlier_versions_is_taken_said_and_corrected(
    site: Site, gripper: LiteGrip, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    old = {"zero_position_rad": 0.1, "max_position_rad": -1.5, "rad_to_mm": 75.0}
    (tmp_path / "old.json").write_text(json.dumps(old), encoding="utf-8")
    assert gripper.load_calibration(tmp_path / "old.json")
    assert "takes the jaws' travel for 120 mm" in caplog.text
    site.run(0.01)
    assert gripper.get_state().scale_doubt == "superseded"
    assert gripper.rescale_calibration().rad_to_mm == pytest.approx(SPAN_MM / 1.6)
    site.run(0.01)
    assert gripper.get_state().scale_doubt is None


@pytest.mark.parametrize("factor", [0.1, 0.5, 0.84, 1.16, 2.0, 10.0])
def test_a_scale_that_cannot_be_this_grippers_is_rejected(
    daemon: Daemon, gripper: LiteGrip, tmp_path: Path, factor: float
) -> None:
    before = gripper.config
    scale = SPAN_MM / TRAVEL_RAD * factor
    wrong = {"zero_position_rad": 0.0, "max_position_rad": -TRAVEL_RAD, "rad_to_mm": scale}
    (tmp_path / "wrong.json").write_text(json.dumps(wrong), encoding="utf-8")
    for load, given in (
        (gripper.load_calibration, tmp_path / "wrong.json"),
        (gripper.use_calibration, CalibrationData.from_content(wrong)),
    ):
        call: Callable[..., bool] = load
        with pytest.raises(CommandError, match="the configured stroke is 85 mm") as caught:
            call(given)
        assert caught.value.reason == "calibration_unreadable"
    assert gripper.config == before


def test_the_motor_is_never_faster_than_its_bound(daemon: Daemon, gripper: LiteGrip) -> None:
    present = gripper.config
    assert present.pos_closed_rad is not None
    assert present.pos_open_rad is not None
    gripper.use_calibration(
        CalibrationData(
            zero_position_rad=present.pos_closed_rad,
            max_position_rad=present.pos_open_rad,
            rad_to_mm=45.0,
        )
    )
    most_mm_s = FASTEST_RAD_S * 45.0
    assert most_mm_s < 149.0
    told = f"at most {most_mm_s:.4g}: the motor turns at no more than {FASTEST_RAD_S:g} rad/s"
    for move in (gripper.open, gripper.close):
        with pytest.raises(CommandError, match=told):
            move(149.0)
    assert gripper.close(most_mm_s - 1.0)


def test_a_calibration_by_hand_needs_a_hand(daemon: Daemon, gripper: LiteGrip) -> None:
    before = gripper.config
    with pytest.raises(CommandError, match="push them to both stops"):
        gripper.calibrate_manual(1.0, 0.0)
    assert gripper.config == before
    with pytest.raises(ParameterError, match="duration is 0"):
        gripper.calibrate_manual(0.0)


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
        ({"mst_id": 0x19}, "mst_id 24, not 25"),
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
    assert UnitConversion.NM_TO_N * UnitConversion.N_TO_NM == 1.0
    assert pytest.approx(1.0) == UnitConversion.RAD_TO_MM * UnitConversion.MM_TO_RAD
    assert (CalibrationData().mount, CalibrationData().calibrated) == ("normal", False)
    assert default_calib_path("can1").endswith("/.litegrip/can1_calibration.json")
    assert resolve_path("pick") == f"{trajectory_dir()}/pick.lgt"
