"""What `litegripd` refuses before it is a daemon: wrong usage, and configurations with a mistake.

How such a process ends, with its line in the journal, is tried in tests/process/test_hardware.py.
"""

import faulthandler
import grp
import logging
import sys
from pathlib import Path
from typing import NoReturn

import pytest

from litegripd.app.config import Config
from litegripd.app.main import EXIT_USAGE, main


@pytest.fixture(autouse=True)
def _left_as_it_was(monkeypatch: pytest.MonkeyPatch) -> None:
    """The program sets up its process, which is not to be this one."""
    monkeypatch.setattr(faulthandler, "enable", lambda: None)
    monkeypatch.setattr(logging.getLogger("can"), "level", logging.NOTSET)


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        ((), "the following arguments are required: channel"),
        (("../x",), "'../x'"),
        (("can0.stop",), "can0.stop"),
        (("typo0", "--simulat"), "--simulat"),
        (("can0", "--simulate=gazebo"), "'gazebo': it is mujoco, mujoco:SCENE.xml, or left out"),
        (("--simulate", "mujoco"), "the following arguments are required: channel"),
    ],
)
def test_wrong_usage_is_told(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], told: str
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == EXIT_USAGE
    assert told in capsys.readouterr().err


@pytest.mark.parametrize(
    ("content", "told"),
    [
        (None, "cannot be read: No such file"),
        ("[motor]\ncan_id = 0x800\n", "[motor] can_id"),
        ("[control]\nrate = 200\n", "[control] rate is unknown"),
        ("[rpc\n", "not valid TOML"),
        (
            '[access]\nadmins = ["@no-such-group"]\n',
            "[access] admins: there is no group 'no-such-group'; allowed",
        ),
    ],
)
def test_a_configuration_error_is_told_with_its_file(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: str | None, told: str
) -> None:
    path = tmp_path / "wrong.toml"
    if content is not None:
        path.write_text(content, encoding="utf-8")
    assert main(["can0", "--config", str(path)]) == EXIT_USAGE
    assert told in caplog.text
    assert str(path) in caplog.text
    assert "Traceback" not in caplog.text


@pytest.mark.parametrize(
    ("mechanics", "told"),
    [
        ("gazebo", "mechanics must be mujoco or mujoco:SCENE.xml, not 'gazebo'"),
        ("mujoco:scene.xml", "its scene must be an absolute path"),
        ("mujoco:/no/such.xml", "MuJoCo cannot load /no/such.xml"),
    ],
)
def test_mechanics_that_cannot_be_are_told(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, mechanics: str, told: str
) -> None:
    path = tmp_path / "wrong.toml"
    bus = f'[bus]\ninterface = "litegrip_sim"\nmechanics = "{mechanics}"\n'
    path.write_text(bus, encoding="utf-8")
    assert main(["can0", "--config", str(path)]) == EXIT_USAGE
    assert told in caplog.text


@pytest.mark.parametrize(
    ("bus", "told"),
    [
        ("objct_mm = 40", "unknown option objct_mm; litegrip_sim takes mount, object_mm"),
        ("receive_own_messages = true", "unknown option receive_own_messages"),
        ('mount = "norml"', "mount must be one of normal, reverse, not 'norml'"),
        ("mount = 1", "mount must be a string, not 1"),
        ("watchdog_s = -1", "watchdog_s must not be negative"),
        ('watchdog_s = "x"', "watchdog_s must be a number, not 'x'"),
        ('object_mm = "40"', "object_mm must be a number, not '40'"),
        ("object_mm = true", "object_mm must be a number, not True"),
        ("object_mm = -3", "object_mm must be 0 to less than 87 mm wide, not -3"),
        ("object_mm = 90", "object_mm must be 0 to less than 87 mm wide, not 90"),
        ("object_stiffness_nm_rad = 9", "object_stiffness_nm_rad needs object_mm"),
        (
            "object_mm = 40\nobject_stiffness_nm_rad = 0",
            "object_stiffness_nm_rad must be more than 0 and at most 5000, not 0",
        ),
        ("seed = 1.5", "seed must be a whole number"),
        ('motor_type = "X"', "motor_type is 'X', no type of the family; it must be DM4310 or"),
        ("bitrate = 500000", "bitrate must be 1000000, as the motor's is, not 500000"),
    ],
)
@pytest.mark.parametrize("check", [("--check",), ()])
def test_a_simulated_gripper_that_cannot_be_is_refused_at_the_start(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, bus: str, told: str, check: tuple[str, ...]
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(f'[bus]\ninterface = "litegrip_sim"\n{bus}\n', encoding="utf-8")
    assert main(["can0", "--config", str(path), *check]) == EXIT_USAGE
    assert f"{path}: [bus] {told}" in caplog.text


@pytest.mark.parametrize(
    ("interface", "meant"),
    [
        ("litegrip-sim", "did you mean litegrip_sim? "),
        ("pcan_usb", "did you mean pcan? "),
        ("SocketCAN", "did you mean socketcan? "),
        ("xyz", ""),
    ],
)
@pytest.mark.parametrize("check", [("--check",), ()])
def test_an_interface_that_there_is_not_is_refused_at_the_start(
    tmp_path: Path,
    caplog: pytest.LogCaptureFixture,
    interface: str,
    meant: str,
    check: tuple[str, ...],
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(f'[bus]\ninterface = "{interface}"\n', encoding="utf-8")
    why = f"is '{interface}', which python-can does not have; {meant}it has: "
    assert main(["can0", "--config", str(path), *check]) == EXIT_USAGE
    assert f"{path}: [bus] interface {why}" in caplog.text
    assert "pcan, " in caplog.text
    caplog.clear()
    assert main(["can0", "--interface", interface, *check]) == EXIT_USAGE
    assert f"--interface {why}" in caplog.text


def test_each_interface_of_python_can_and_its_packages_passes_the_check(
    capsys: pytest.CaptureFixture[str],
) -> None:
    for interface in ("socketcan", "slcan", "gs_usb", "virtual", "litegrip_sim"):
        assert main(["can0", "--interface", interface, "--check"]) == 0
        assert f'"interface": "{interface}"' in capsys.readouterr().out


def test_a_simulated_gripper_that_can_be_passes_the_check(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "right.toml"
    text = (
        '[bus]\ninterface = "litegrip_sim"\nmount = "reverse"\nobject_mm = 40\nseed = 3\n'
        "object_stiffness_nm_rad = 10.5\nwatchdog_s = 0.4\ncomm_loss_s = 0\nidle_loss_s = 0.9\n"
        'unasked_hz = 10\nmotor_type = "DM4340"\n'
    )
    path.write_text(text, encoding="utf-8")
    assert main(["can0", "--config", str(path), "--check"]) == 0
    assert "litegrip_sim" in capsys.readouterr().out


def test_a_missing_mujoco_is_told_with_the_way_to_install_it(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.delitem(sys.modules, "litegripd.sim.mujoco_plant", raising=False)
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert main(["can0", "--simulate", "mujoco"]) == EXIT_USAGE
    assert "MuJoCo's mechanics need its package" in caplog.text
    assert "-m pip install mujoco" in caplog.text


def test_the_word_behind_simulate_is_the_channel_unless_it_names_mechanics(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    checked: list[Config] = []
    monkeypatch.setattr("litegripd.app.build.check_simulated", checked.append)
    monkeypatch.chdir(tmp_path)

    def mechanics(*arguments: str) -> object:
        assert main([*arguments, "--check"]) == 0
        bus = checked[-1].bus
        assert (bus.interface, bus.channel) == ("litegrip_sim", "can7")
        return bus.options.get("mechanics")

    assert mechanics("can7", "--simulate") is mechanics("--simulate", "can7") is None
    assert mechanics("can7", "--simulate", "mujoco") == "mujoco"
    assert mechanics("--simulate=mujoco", "can7") == "mujoco"
    assert mechanics("--simulate", "mujoco:a/b.xml", "can7") == f"mujoco:{tmp_path}/a/b.xml"


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('interface = "litegrip_sim"\n', "interface is a key of [bus]: put it under [bus]"),
        ("stroke_mm = 85\n", "stroke_mm is a key of [gripper]: put it under [gripper]"),
        ("group = 1\n", "group is a key of [rpc]: put it under [rpc]"),
        ("colour = 1\n", "unknown key colour, in no table; allowed tables: bus, motor"),
        ("[interface]\nx = 1\n", "unknown table [interface]; allowed: bus, motor"),
    ],
)
def test_a_key_before_any_table_is_told_where_it_belongs(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, content: str, told: str
) -> None:
    path = tmp_path / "wrong.toml"
    path.write_text(content, encoding="utf-8")
    assert main(["can0", "--config", str(path), "--check"]) == EXIT_USAGE
    assert f"{path}: {told}" in caplog.text


def test_a_group_that_is_not_there_is_said_and_the_default_one_is_no_matter(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(grp, "getgrnam", {"robots": None}.__getitem__)
    path = tmp_path / "a.toml"
    for group, said in (("nogroupx", True), ("robots", False), ("litegrip", False)):
        caplog.clear()
        path.write_text(f'[rpc]\ngroup = "{group}"\n', encoding="utf-8")
        assert main(["can0", "--config", str(path), "--check"]) == 0
        found = f"[rpc] group = '{group}' in {path}: there is no such group, and the sockets stay"
        assert (found in caplog.text) is said
        assert ("WARNING" in caplog.text) is said


def test_a_missing_group_is_said_at_the_start_too(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Started(Exception):  # noqa: N818 - no error
        """The daemon was to be made."""

    def start(*_arguments: object) -> NoReturn:
        raise Started

    monkeypatch.setattr("litegripd.app.daemon.Daemon", start)
    path = tmp_path / "a.toml"
    path.write_text('[rpc]\ngroup = "no-such-group"\n', encoding="utf-8")
    with pytest.raises(Started):
        main(["can0", "--config", str(path)])
    assert "[rpc] group = 'no-such-group'" in caplog.text
