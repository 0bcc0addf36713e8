"""A calibration's gains: whose they are."""

from pathlib import Path

from litegrip_client import LiteGrip
from tests.drop_in import Daemon, Site
from tests.sdk_compat.scenes import write_file


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
