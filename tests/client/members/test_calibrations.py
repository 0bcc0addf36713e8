"""Calibrations of a script on both mounts: by a probe, by hand, from files; gains and strokes."""

import json
import time
from pathlib import Path

import pytest

from litegrip_client import CalibrationData, CommandError, LiteGrip, ParameterError
from tests.drop_in import Daemon, Site
from tests.geometry import SPAN_MM, STROKE_MM, TRAVEL_RAD, WORK_MM
from tests.sdk.readme.scenes import write_file
from tests.sdk.readme.trajectories import push


def test_the_travel_is_probed_with_the_gains_and_the_torque_that_are_given(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    with site.recorded(daemon) as moments:
        data = gripper.calibrate(15.0, 1.5, 0.04, 0.002, 6, 150, 1.5)
    assert (data.mount, data.calibrated) == (daemon.mount, True)
    assert data.travel_range == pytest.approx(1.605, abs=0.06)
    probing = [moment.command for moment in moments[20:200] if moment.command is not None]
    assert len(probing) > 100
    assert {round(command.kp_nm_rad) for command in probing} == {15}
    assert max(abs(moment.closing_torque_nm) for moment in moments[20:200]) < 1.6


def test_a_calibration_that_a_script_has_made_is_used(daemon: Daemon, gripper: LiteGrip) -> None:
    present = gripper.config
    assert present.pos_closed_rad is not None
    assert present.pos_open_rad is not None
    mine = CalibrationData(
        zero_position_rad=present.pos_closed_rad,
        max_position_rad=present.pos_open_rad,
        travel_range_rad=abs(present.pos_closed_rad - present.pos_open_rad),
        rad_to_mm=55.0,
        kp=90.0,
        kd=1.8,
    )
    assert gripper.use_calibration(mine) is True
    now = gripper.config
    assert (now.rad_to_mm, now.kp, now.kd, now.mount) == (55.0, 90.0, 1.8, daemon.mount)


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


def test_a_calibration_by_hand_takes_the_extremes_and_the_stroke_of_the_script(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    push(site, daemon, (0.5, 0.4), (2.0, -0.4), (5.0, 0.0))
    data = gripper.calibrate_manual(duration=6.0, settle_time=0.5)
    assert data.mount == daemon.mount
    assert data.travel_range == pytest.approx(TRAVEL_RAD, abs=0.08)
    assert data.travel_mm == pytest.approx(SPAN_MM)
    assert data.calibration_time == pytest.approx(time.time(), abs=60.0)
    assert gripper.config.pos_closed_rad == pytest.approx(data.zero_position)
    assert gripper.get_state().mode == "holding"
    gripper.load_template(daemon.mount)
    gripper.config.max_stroke_mm = 84.0
    push(site, daemon, (0.5, 0.4), (2.0, -0.4), (5.0, 0.0))
    data = gripper.calibrate_manual(duration=6.0, settle_time=0.5)
    assert data.stroke_mm == pytest.approx(84.0)
    assert (data.work_stroke_mm, gripper.config.work_stroke_mm) == (WORK_MM, WORK_MM)


def test_a_calibration_by_hand_needs_a_hand(daemon: Daemon, gripper: LiteGrip) -> None:
    before = gripper.config
    with pytest.raises(CommandError, match="push them to both stops"):
        gripper.calibrate_manual(1.0, 0.0)
    assert gripper.config == before
    with pytest.raises(ParameterError, match="duration is 0"):
        gripper.calibrate_manual(0.0)


def test_a_calibration_is_loaded_and_a_mount_read_before_connecting(daemon: Daemon) -> None:
    gripper = LiteGrip("can0")
    assert gripper.load_calibration(template=daemon.mount) is True
    assert gripper.mount == daemon.mount
    assert gripper.connect() is True
    gripper.disconnect()
    with pytest.raises(ConnectionError):
        _ = gripper.mount
    assert LiteGrip("can0").mount == daemon.mount


def test_a_zero_takes_about_a_quarter_of_a_minute(site: Site, gripper: LiteGrip) -> None:
    began_s = site.now_s
    gripper.zero(progress=lambda _one: None)
    assert site.now_s - began_s == pytest.approx(15.0, abs=2.0)


def test_a_calibration_by_hand_needs_a_mount(site: Site) -> None:
    site.add(Daemon("can1", calibrated=False))
    with LiteGrip("can1") as gripper:
        gripper.enable()
        with pytest.raises(CommandError, match="mount"):
            gripper.calibrate_manual(1.0)


def gains(gripper: LiteGrip) -> tuple[float, float]:
    return gripper.config.kp, gripper.config.kd


def test_gains_of_one_programs_file_do_not_stay_for_the_next_one(
    site: Site, tmp_path: Path
) -> None:
    site.add(Daemon())
    stiff = write_file(tmp_path / "stiff.json", "normal", kp=60.0, kd=1.5)
    plain = write_file(tmp_path / "plain.json", "normal")
    with LiteGrip("can0") as first:
        assert first.load_calibration(stiff)
        assert gains(first) == (60.0, 1.5)
        assert first.load_template("normal")  # geometry only: this program's own gains stay
        assert gains(first) == (60.0, 1.5)
    with LiteGrip("can0") as second:
        assert gains(second) == (60.0, 1.5)  # that calibration is still in use
        assert second.load_calibration(plain)
        assert gains(second) == (100.0, 2.0)
        assert second.load_template("reverse")
        assert gains(second) == (100.0, 2.0)


def test_the_daemons_own_gains_come_back(site: Site, home: Path, tmp_path: Path) -> None:
    write_file(home / ".litegrip" / "can0_calibration.json", "normal", kp=80.0, kd=1.2)
    site.add(Daemon(boots=True))
    stiff = write_file(tmp_path / "stiff.json", "normal", kp=60.0, kd=1.5)
    with LiteGrip("can0") as first:
        assert gains(first) == (80.0, 1.2)
        assert first.load_calibration(stiff)
    with LiteGrip("can0") as second:
        assert second.load_template("normal")
        assert gains(second) == (80.0, 1.2)
