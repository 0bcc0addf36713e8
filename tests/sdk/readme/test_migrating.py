"""The SDK's section "Migrating from the 2.2.0 API"."""

import inspect
import json
from pathlib import Path

import pytest

from litegrip_client import (
    CALIB_TEMPLATES,
    CommandError,
    EnableResult,
    HardwareError,
    LiteGrip,
    MotionConfig,
    MoveResult,
)
from litegripd.motor import codec
from tests.drop_in import Daemon, Site, a_site
from tests.geometry import WORK_MM
from tests.sdk.readme.scenes import LEAD_MM_RAD, content, lead_mm, own_file, write_file

OLD_CALLS: dict[str, tuple[str, tuple[float, ...], dict[str, float]]] = {
    "open by position": ("open", (100.0, 2.0, 1.0), {}),
    "open with a gain": ("open", (), {"kp": 100.0}),
    "open in a time": ("open", (), {"duration": 1.0}),
    "close by position": ("close", (100.0, 2.0, 10.0, 1.0), {}),
    "close with a gain": ("close", (), {"kp": 150.0}),
    "close with a force": ("close", (), {"force_n": 10.0}),
    "grasp by position": ("grasp", (10.0, 150.0, 2.0, 3.0), {}),
    "grasp with a gain": ("grasp", (), {"kp": 150.0}),
    "grasp in a time": ("grasp", (), {"duration": 3.0}),
    "grasp by cycles": ("grasp", (), {"stall_cycles": 5}),
}
"""Calls of the 2.2.0 API: the method, its arguments by position and by name."""

SIGNATURES = {
    "open": {"speed_mm_s": None},
    "close": {"speed_mm_s": None},
    "grasp": {"force_n": None, "hold_s": 0.0},
    "enable": {"retries": None},
    "disable": {},
    "zero": {},
}


@pytest.mark.parametrize("call", OLD_CALLS)
def test_old_calls_raise_type_errors_instead_of_doing_something_else(
    daemon: Daemon, gripper: LiteGrip, call: str
) -> None:
    name, by_position, by_name = OLD_CALLS[call]
    with pytest.raises(TypeError):
        getattr(gripper, name)(*by_position, **by_name)
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)


@pytest.mark.parametrize("name", SIGNATURES)
def test_the_signatures(name: str) -> None:
    """Whatever else there is, is by keyword and can be left out."""
    parameters = dict(inspect.signature(getattr(LiteGrip, name)).parameters)
    del parameters["self"]
    by_position = {
        one.name: one.default
        for one in parameters.values()
        if one.kind is inspect.Parameter.POSITIONAL_OR_KEYWORD
    }
    assert by_position == SIGNATURES[name]
    assert all(one.default is not inspect.Parameter.empty for one in parameters.values())


def test_force_has_moved_to_grasp_with_a_default_of_20_n(daemon: Daemon, gripper: LiteGrip) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    assert gripper.grasp(hold_s=2.0).force_n == 20.0
    assert daemon.closing_torque_nm == pytest.approx(2.0, abs=0.1)


def test_enable_returns_a_result_that_is_ok_only_when_the_motor_says_enabled(
    site: Site, daemon: Daemon
) -> None:
    daemon.lose_to_motor = lambda frame: frame.data == codec.ENABLE
    with LiteGrip("can0") as gripper:
        result = gripper.enable()
        assert isinstance(result, EnableResult)
        assert (result.ok, result.state.error_code) == (False, 0)
        daemon.lose_to_motor = lambda _frame: False
        result = gripper.enable()
        assert (result.ok, result.state.error_code) == (True, 1)


def test_code_that_ignores_a_failed_enable_sees_a_hardware_error(
    site: Site, daemon: Daemon
) -> None:
    daemon.lose_to_motor = lambda frame: frame.data == codec.ENABLE
    with LiteGrip("can0") as gripper:
        gripper.enable()
        for move in (gripper.open, gripper.close, gripper.grasp):
            with pytest.raises(HardwareError):
                move()
    assert daemon.gripper.opening_mm == pytest.approx(60.0, abs=0.1)


def test_disable_still_returns_a_bool(daemon: Daemon, gripper: LiteGrip) -> None:
    assert gripper.disable() is True
    assert not daemon.is_energised


def test_gains_belong_to_the_gripper_config_and_motion_tunables_to_the_motion_config(
    site: Site, home: Path, mount: str
) -> None:
    """Where the daemon differs: `config` is read-only, gains come with a calibration file.

    They are those of a hold. A motion is as stiff as the SDK's default, or softer; softer gains of
    a file make it press less on the way.
    """
    own_file(home, "can0", mount, kp=60.0, kd=1.5)
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        gripper.load_calibration()
        assert (gripper.config.kp, gripper.config.kd) == (60.0, 1.5)
        gripper.enable()
        with site.recorded(daemon) as moments:
            gripper.close()
        gripper.hold()
        site.run(0.05)
        held = daemon.command_now()
        with pytest.raises(AttributeError):
            gripper.config.kp = 80.0
    used = {
        (round(m.command.kp_nm_rad), round(m.command.kd_nm_s_rad, 1))
        for m in moments[:-1]
        if m.command is not None
    }
    assert (100, 2.0) in used
    assert all(kp <= 100 and kd <= 2.0 for kp, kd in used)
    leads_nm = [m.command.kp_nm_rad * lead_mm(m) / LEAD_MM_RAD for m in moments[1:-1] if m.command]
    assert max(leads_nm) < 2.0 + 0.1
    assert held is not None
    assert (held.kp_nm_rad, held.kd_nm_s_rad) == pytest.approx((60.0, 0.6), abs=0.1)  # of kd 1.5
    assert not hasattr(MotionConfig(), "kp")


def test_what_is_new_is_there(daemon: Daemon, gripper: LiteGrip) -> None:
    assert callable(gripper.zero)
    assert callable(gripper.actions.zero)
    assert isinstance(gripper.motion_config, MotionConfig)
    assert gripper.disable_on_disconnect is True


def test_either_ordering_of_the_limits_works_and_is_a_mount(
    site: Site, home: Path, mount: str
) -> None:
    """pos_open_rad >= pos_closed_rad used to raise."""
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    own_file(home, "can0", mount)
    with LiteGrip("can0") as gripper:
        gripper.load_calibration()
        config = gripper.config
        assert config.pos_open_rad is not None
        assert config.pos_closed_rad is not None
        assert (config.pos_open_rad >= config.pos_closed_rad) is (mount == "reverse")
        assert gripper.mount == mount
        gripper.enable()
        assert gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


def test_a_never_calibrated_config_raises_and_shows_no_placeholders(site: Site, mount: str) -> None:
    """Where the daemon differs: where the SDK has placeholder limits, here is None."""
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        config = gripper.config
        assert config.calibrated is False
        assert (config.pos_closed_rad, config.pos_open_rad, config.close_sign) == (None,) * 3
        gripper.enable()
        for move in (gripper.open, gripper.close, gripper.grasp):
            with pytest.raises(CommandError):
                move()
        gripper.load_template(mount)
        assert gripper.config.calibrated
        assert gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


def test_the_truth_of_a_move_result_is_ok(daemon: Daemon, gripper: LiteGrip) -> None:
    """For open and close the opposite of what it was: `reached and not stalled`."""
    results: list[MoveResult] = [gripper.open(), gripper.close(), gripper.open()]
    daemon.gripper.put_object(width_mm=50.0)
    results.append(gripper.close())
    assert [bool(result) for result in results] == [True, True, True, False]
    for result in results[:3]:
        assert bool(result) is not (result.reached and not result.stalled)


def test_the_pressing_lead_is_07_mm_and_can_be_raised_to_the_old_1_mm(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    assert gripper.motion_config.stop_lead_mm == 0.7
    torques = []
    for lead in (None, 1.0):
        if lead is not None:
            gripper.motion_config.stop_lead_mm = lead
        with site.recorded(daemon) as moments:
            assert gripper.close()
        torques.append(moments[-5].closing_torque_nm)
    assert torques == pytest.approx([0.94, 1.34], abs=0.08)


def test_default_paths_are_per_channel_and_the_old_file_is_still_a_fallback(
    site: Site, home: Path
) -> None:
    """Where the daemon differs: it saves in its own directory; ~/.litegrip is read."""
    own_file(home, "can0", "reverse", rad_to_mm=53.0)
    legacy = write_file(home / ".litegrip" / "litegrip_calibration.json", "reverse", rad_to_mm=54.0)
    for channel, rad_to_mm in (("can0", 53.0), ("can1", 54.0)):
        site.add(Daemon(channel, "reverse", calibrated=False))
        with LiteGrip(channel) as gripper:
            assert gripper.load_calibration()
            assert gripper.config.rad_to_mm == rad_to_mm
            path = Path(gripper.save_calibration())
            assert path.name == f"{channel}_calibration.json"
            assert path != legacy
            assert json.loads(path.read_text(encoding="utf-8"))["channel"] == channel


def test_a_can0_calibration_no_longer_answers_a_can1_load(site: Site, home: Path) -> None:
    own_file(home, "can0", "normal")
    write_file(home / ".litegrip" / "litegrip_calibration.json", "normal", channel="can0")
    site.add(Daemon("can1", "reverse", calibrated=False))
    with LiteGrip("can1") as gripper:
        assert gripper.load_calibration() is False
        gripper.enable()
        with pytest.raises(CommandError):
            gripper.close()


def test_litegrip_calib_still_overrides_everything(home: Path) -> None:
    pinned = write_file(home / "pinned.json", "reverse", rad_to_mm=73.0)
    own_file(home, "can0", "normal")
    with a_site(home, {"LITEGRIP_CALIB": str(pinned)}) as site:
        site.add(Daemon("can0", "reverse", calibrated=False))
        with LiteGrip("can0") as gripper:
            assert gripper.load_calibration()
            assert (gripper.mount, gripper.config.rad_to_mm) == ("reverse", 73.0)
            gripper.enable()
            data = gripper.zero()
            assert Path(gripper.save_calibration()) == pinned
    saved = json.loads(pinned.read_text(encoding="utf-8"))
    assert saved["zero_position_rad"] == data.zero_position_rad


def test_the_templates_carry_only_direction_and_geometry() -> None:
    assert list(CALIB_TEMPLATES) == ["normal", "reverse"]
    for mount, path in CALIB_TEMPLATES.items():
        keys = json.loads(Path(path).read_text(encoding="utf-8"))
        motor = keys.pop("motor_type")
        assert motor == "DM4310"
        assert keys == pytest.approx(content(mount, work_stroke_mm=WORK_MM))


def test_loading_a_mount_does_not_rewrite_the_can_ids(site: Site, home: Path, mount: str) -> None:
    own_file(home, "can0", mount, can_id=8, mst_id=24)
    site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0", can_id=0x08) as gripper:
        gripper.load_calibration()
        for template in ("normal", "reverse"):
            gripper.load_template(template)
            assert (gripper.config.can_id, gripper.config.mst_id) == (0x08, 0x18)
        assert gripper.enable()


@pytest.mark.parametrize("how", ["load_template", "mount="])
def test_loading_a_mount_does_not_rewrite_tuned_gains(
    site: Site, home: Path, mount: str, how: str
) -> None:
    own_file(home, "can0", mount, kp=60.0, kd=1.5)
    site.add(Daemon(mount=mount, boots=True))
    with LiteGrip("can0", mount=mount if how == "mount=" else None) as gripper:
        gripper.load_template(mount)
        assert (gripper.config.kp, gripper.config.kd) == (60.0, 1.5)
