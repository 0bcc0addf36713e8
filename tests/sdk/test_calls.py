"""What each call needs and does: before `connect()`, before `enable()`, and after."""

import json
import logging
from collections.abc import Callable
from typing import Any

import pytest

import litegrip
from litegrip import LiteGrip
from tests.drop_in import Daemon, Site

Use = Callable[[LiteGrip], Any]
_TAUGHT = litegrip.Trajectory([litegrip.TrajectorySample(0.0, 0.5, -0.8)], mount="normal")

NEEDS_CONNECTION: dict[str, Use] = {
    "enable": lambda g: g.enable(),
    "disable": lambda g: g.disable(),
    "clear_fault": lambda g: g.clear_fault(),
    "refresh_status": lambda g: g.refresh_status(),
    "get_state": lambda g: g.get_state(),
    "get_position": lambda g: g.get_position(),
    "get_force": lambda g: g.get_force(),
    "get_position_rad": lambda g: g.get_position_rad(),
    "get_torque": lambda g: g.get_torque(),
    "get_error": lambda g: g.get_error(),
    "get_temperature": lambda g: g.get_temperature(),
    "is_moving": lambda g: g.is_moving(),
    "is_grasped": lambda g: g.is_grasped(),
    "read_param": lambda g: g.read_param(21),
}
NEEDS_ENABLED: dict[str, Use] = {
    "enter_zero_gravity": lambda g: g.enter_zero_gravity(),
    "open": lambda g: g.open(),
    "close": lambda g: g.close(),
    "grasp": lambda g: g.grasp(10.0, 1.0),
    "zero": lambda g: g.zero(),
    "write_zero": lambda g: g.write_zero(),
    "home": lambda g: g.home(),
    "goto": lambda g: g.goto(10.0),
    "goto_rad": lambda g: g.goto_rad(-0.5),
    "move_to": lambda g: g.move_to(-0.5),
    "move_at_speed": lambda g: g.move_at_speed(10.0),
    "move_at_speed_rad": lambda g: g.move_at_speed_rad(-0.5),
    "set_force": lambda g: g.set_force(10.0),
    "calibrate": lambda g: g.calibrate(),
    "calibrate_guided": lambda g: g.calibrate_guided(),
    "calibrate_manual": lambda g: g.calibrate_manual(),
    "record_start": lambda g: g.record_start(),
    "record": lambda g: g.record(1.0),
    "play_start": lambda g: g.play_start(_TAUGHT),
    "play": lambda g: g.play(_TAUGHT),
    "teleop_start": lambda g: g.teleop_start("master"),
    "actions.open": lambda g: g.actions.open(),
}
QUIET_BEFORE: dict[str, tuple[Use, Any]] = {
    "disconnect": (lambda g: g.disconnect(), None),
    "stop": (lambda g: g.stop(), None),
    "send_mit_frame": (lambda g: g.send_mit_frame(0.0, 100.0, 2.0), False),
    "poll": (lambda g: g.poll(), False),
    "wait_for_ready": (lambda g: g.wait_for_ready(0.0), False),
    "exit_zero_gravity": (lambda g: g.exit_zero_gravity(), None),
    "session": (lambda g: g.session, None),
    "is_connected": (lambda g: g.is_connected, False),
    "is_enabled": (lambda g: g.is_enabled, False),
    "teleop_status": (lambda g: g.teleop_status(), {"active": False, "mode": None}),
    "teleop_stop": (lambda g: g.teleop_stop(), {"active": False, "mode": None}),
    "trajectory_status": (lambda g: g.trajectory_status(), {"active": False, "kind": None}),
    "play_stop": (lambda g: g.play_stop(), {"active": False, "kind": None}),
}


@pytest.mark.parametrize("name", NEEDS_CONNECTION | NEEDS_ENABLED)
def test_before_connect_only_that_is_raised(name: str) -> None:
    with pytest.raises(litegrip.NotInitializedError):
        (NEEDS_CONNECTION | NEEDS_ENABLED)[name](LiteGrip("can0", mount="normal"))


@pytest.mark.parametrize("name", QUIET_BEFORE)
def test_before_connect_these_answer(name: str) -> None:
    use, answer = QUIET_BEFORE[name]
    assert use(LiteGrip("can0")) == answer


@pytest.mark.parametrize("name", NEEDS_ENABLED)
def test_before_enable_no_motion(daemon: Daemon, name: str) -> None:
    with LiteGrip("can0", mount="normal") as gripper:
        with pytest.raises(litegrip.NotInitializedError, match="enable"):
            NEEDS_ENABLED[name](gripper)
        assert gripper.send_mit_frame(0.0, 100.0, 2.0) is False
        gripper.stop()
        gripper.exit_zero_gravity()
        assert not daemon.is_energised


_IN_THE_TRAVEL = [
    *("open", "close", "grasp", "home", "goto", "goto_rad", "move_to", "move_at_speed"),
    *("move_at_speed_rad", "set_force", "actions.open"),
]


@pytest.mark.parametrize("name", _IN_THE_TRAVEL)
def test_without_a_calibration_no_motion(daemon: Daemon, name: str) -> None:
    """The daemon has one, but a script of the SDK has none before it loads one."""
    with LiteGrip("can0") as gripper:
        assert gripper.enable()
        with pytest.raises(litegrip.CommandError, match="not calibrated"):
            NEEDS_ENABLED[name](gripper)


def test_connecting(site: Site, daemon: Daemon) -> None:
    with pytest.raises(litegrip.ConnectError, match="can7"):
        LiteGrip("can7").connect()
    gripper = LiteGrip("can0")
    assert (gripper.mst_id, str(gripper)) == (None, repr(gripper))
    assert "mst_id=auto" in repr(gripper)
    assert gripper.connect() is True
    assert gripper.connect() is True
    assert (gripper.is_connected, gripper.mst_id, gripper.config.calibrated) == (True, 0x18, False)
    assert "mst_id=0x18" in repr(gripper)
    gripper.disconnect()
    gripper.disconnect()
    assert not gripper.is_connected


def test_arguments_yield_to_the_configuration() -> None:
    config = litegrip.GripperConfig(can_channel="can3", can_id=9)
    gripper = LiteGrip(config=config)
    assert gripper.config is config
    assert (gripper.channel, gripper.can_id) == ("can3", 9)
    assert LiteGrip("can1", 0x0A, config=config).channel == "can1"
    assert (config.can_channel, config.can_id) == ("can1", 0x0A)
    gripper.motion_config = tunables = litegrip.MotionConfig(speed_mm_s=10.0)
    assert gripper.actions.config is tunables
    gripper.actions.config = litegrip.MotionConfig()
    assert gripper.motion_config is gripper.actions.config


def test_canfd_and_another_motor_are_taken_with_a_warning(
    daemon: Daemon, caplog: pytest.LogCaptureFixture
) -> None:
    gripper = LiteGrip("can0", canfd_mode=True, motor_type=litegrip.DM_Motor_Type.DM4340)
    gripper.connect()
    assert [record.name for record in caplog.records if record.levelno == logging.WARNING] == [
        "litegrip",
        "litegrip",
    ]
    assert gripper.get_info().motor_type == "DM4340"
    gripper.disconnect()


def test_enable_is_false_where_the_motor_does_not_confirm(site: Site, daemon: Daemon) -> None:
    with LiteGrip("can0") as gripper:
        daemon.gripper.power_off()
        site.run(0.5)
        result = gripper.enable()
        assert (bool(result), result.ok, result.tries) == (False, False, 3)
        assert not gripper.is_enabled


def test_a_state_has_the_programs_millimetres(gripper: LiteGrip, daemon: Daemon) -> None:
    state = gripper.get_state()
    assert state.position_mm == pytest.approx(daemon.gripper.opening_mm, abs=0.1)
    assert (state.is_enabled, state.has_data, state.is_stale) == (True, True, False)
    assert type(state.temperature_mos) is type(state.temperature_coil) is int
    gripper.config.rad_to_mm *= 2.0
    assert gripper.get_position() == pytest.approx(2.0 * state.position_mm, abs=0.1)
    assert gripper.get_temperature() == (state.temperature_mos, state.temperature_coil)
    assert gripper.get_error() == 1


def test_poll_counts_reports_since_the_last_poll(gripper: LiteGrip, site: Site) -> None:
    assert gripper.poll()
    assert not gripper.poll()
    site.run(0.005)
    gripper.get_state()
    gripper.stop()
    assert gripper.poll()
    assert gripper.poll(timeout_s=0.02)


def test_refresh_status_waits_for_a_newer_report(gripper: LiteGrip, site: Site) -> None:
    began_s = site.now_s
    assert gripper.refresh_status()
    assert site.now_s - began_s < 0.011


def test_wait_for_ready_is_enabled_and_still(site: Site, daemon: Daemon) -> None:
    with LiteGrip("can0", mount=daemon.mount) as gripper:
        assert not gripper.wait_for_ready(0.2)
        gripper.enable()
        assert gripper.wait_for_ready()


def test_is_grasped_is_a_torque(gripper: LiteGrip, daemon: Daemon) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    assert gripper.grasp(10.0, 0.2)
    assert gripper.is_grasped()
    gripper.config.grasp_torque_threshold = 5.0
    assert not gripper.is_grasped()


def test_registers(gripper: LiteGrip) -> None:
    assert gripper.read_param(litegrip.can.protocol.DM_REG.PMAX) == 12.5
    assert gripper.read_param(10) == 1.0
    with pytest.raises(ValueError, match="99"):
        gripper.read_param(99)


def test_clear_fault_enables(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    daemon.gripper.latch_fault(0xE)
    site.run(0.1)
    assert gripper.get_state().is_error
    assert gripper.clear_fault() is True
    assert daemon.is_energised


@pytest.mark.parametrize("value", [float("nan"), float("inf"), "fast", None])
def test_what_is_no_finite_number_is_refused(gripper: LiteGrip, value: Any) -> None:
    calls: list[Callable[[], object]] = [
        lambda: gripper.goto(value),
        lambda: gripper.goto_rad(value),
        lambda: gripper.move_at_speed(value),
        lambda: gripper.set_force(value),
        lambda: gripper.send_mit_frame(value, 100.0, 2.0),
        lambda: gripper.send_mit_frame(0.0, 100.0, 2.0, tau=value),
    ]
    if value is not None:
        calls += [lambda: gripper.grasp(value, 1.0), lambda: gripper.open(value)]
    for call in calls:
        with pytest.raises(litegrip.CommandError):
            call()


def test_a_daemon_that_is_gone_is_a_comm_error(gripper: LiteGrip, site: Site) -> None:
    assert gripper.daemon is not None
    site.kill(gripper.daemon)
    with pytest.raises(litegrip.CommError):
        gripper.get_state()
    with pytest.raises(litegrip.CommError):
        gripper.open()


def test_a_latched_stop_is_a_command_error(gripper: LiteGrip) -> None:
    assert gripper.daemon is not None
    gripper.daemon.software_stop(why="a hand is in it")
    with pytest.raises(litegrip.CommandError, match="a hand is in it"):
        gripper.open()


def test_the_object_can_be_left_holding(site: Site, daemon: Daemon) -> None:
    gripper = LiteGrip("can0", mount=daemon.mount, disable_on_disconnect=False)
    gripper.connect()
    gripper.enable()
    gripper.disconnect()
    site.run(1.0)
    assert daemon.is_energised
    with LiteGrip("can0") as again:
        again.enable()
    assert not daemon.is_energised


def test_every_status_is_json(gripper: LiteGrip) -> None:
    gripper.record_start(zero_gravity=False)
    assert gripper.session == "record"
    json.dumps(gripper.trajectory_status(), allow_nan=False)
    gripper.record_stop()
    json.dumps(gripper.teleop_status(), allow_nan=False)
    assert gripper.session is None


def test_loggers_have_the_sdks_names_and_no_handler(
    gripper: LiteGrip, caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO, "litegrip"):
        gripper.load_template("normal" if gripper.mount == "normal" else "reverse")
        gripper.open()
        gripper.record_start(zero_gravity=False)
        gripper.record_stop()
    names = {record.name for record in caplog.records if record.levelno == logging.INFO}
    assert {"litegrip", "litegrip.trajectory"} <= names
    assert logging.getLogger("litegrip").handlers == []
