"""The SDK's section "Migrating from the 2.2.0 API"."""

import inspect
import json
from pathlib import Path

import pytest

from litegrip_client import (
    CALIB_TEMPLATES,
    CommandError,
    HardwareError,
    LiteGrip,
    MotionConfig,
)
from litegripd.motor import codec
from tests.drop_in import Daemon, Site
from tests.geometry import WORK_MM
from tests.sdk.readme.scenes import LEAD_MM_RAD, content, lead_mm, own_file

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


def test_a_never_calibrated_config_raises_and_shows_no_placeholders(site: Site, mount: str) -> None:
    """Where the daemon differs: where the SDK has placeholder limits, here is None."""
    daemon = site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        config = gripper.config
        assert config.calibrated is False
        assert (config.pos_closed_rad, config.pos_open_rad, config.close_sign) == (None,) * 3
        mounts = [gripper.mount]
        gripper.enable()
        for move in (gripper.open, gripper.close, gripper.grasp):
            with pytest.raises(CommandError):
                move()
        gripper.load_template(mount)
        assert gripper.config.calibrated
        assert [*mounts, gripper.mount] == [None, mount]
        assert gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


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
