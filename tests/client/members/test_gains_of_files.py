"""A calibration's gains and ids: whose they are, and what is said of another motor's."""

from pathlib import Path

import pytest

from litegrip_client import LiteGrip
from litegripd.motor import codec
from tests.drop_in import Daemon, Site
from tests.sdk.readme.scenes import write_file


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


@pytest.mark.parametrize(("can_id", "told"), [(9, True), (8, False)])
def test_a_calibration_of_another_motor_is_named_in_the_log(
    site: Site, tmp_path: Path, can_id: int, told: bool
) -> None:
    daemon = site.add(Daemon())
    file = write_file(tmp_path / "other.json", "normal", can_id=can_id)
    watching = daemon.client()
    watching.result("events.subscribe")
    with LiteGrip("can0") as gripper:
        assert gripper.load_calibration(file)
        site.run(0.1)
    watching.read()
    messages = [
        one["params"]["message"] for one in watching.notifications if one["method"] == "event"
    ]
    (loaded,) = [text for text in messages if text.startswith("calibration given by a client")]
    assert ("it has can_id 0x09, and this motor is 0x08" in loaded) is told


def test_an_enabling_that_the_motor_does_not_confirm_has_its_reason(site: Site) -> None:
    daemon = site.add(Daemon())
    gripper = LiteGrip("can0")
    gripper.connect()
    daemon.lose_to_motor = lambda frame: frame.data == codec.ENABLE
    result = gripper.enable()
    assert (result.ok, result.reason) == (False, "not_confirmed")
    assert result.message
    gripper.disconnect()
