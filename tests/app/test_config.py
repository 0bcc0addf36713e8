"""The configuration: defaults, the whole of an example, and every kind of mistake."""

import dataclasses
from pathlib import Path

import pytest

from litegripd.app.config import (
    OWN_MECHANICS,
    Access,
    ConfigError,
    ControlConfig,
    GripperConfig,
    MotorConfig,
    RpcConfig,
    TeleopConfig,
    find,
    load,
    override,
)
from litegripd.model.gripper import STROKE_MM
from litegripd.model.motor import BusSettings

EXAMPLE = """
[bus]                      # handed to python-can
interface = "socketcan"    # "slcan", "gs_usb", "virtual", "litegrip_sim", ...
channel = "can0"           # default: the daemon's channel; a device path for slcan
bitrate = 1000000
[motor]
type = "DM4310"
can_id = 0x08
# master_id = 0x18         # found by itself when left out
[gripper]
# mount = "normal"         # or a calibration file; without either the daemon's own chain of files
stroke_mm = 85.0
[control]
rate_hz = 200
priority = 50              # SCHED_FIFO, 0 = ordinary
[rpc]
# socket = "/run/litegripd/can0.sock"
group = "litegrip"
"""


def written(tmp_path: Path, content: str) -> Path:
    path = tmp_path / "can0.toml"
    path.write_text(content, encoding="utf-8")
    return path


def test_without_a_file_the_defaults_count() -> None:
    config = load("can3", None)
    assert config.bus == BusSettings("socketcan", "can3", 1_000_000, {})
    assert config.motor == MotorConfig("DM4310", 0x08, None)
    assert config.gripper == GripperConfig(None, STROKE_MM)
    assert config.control == ControlConfig(200, 50, ())
    assert config.rpc == RpcConfig(None, "litegrip")
    assert config.access == Access("operator", {}, {})
    assert config.source is None


def test_the_example_says_the_defaults(tmp_path: Path) -> None:
    path = written(tmp_path, EXAMPLE)
    config = load("can0", path)
    defaults = load("can0", None)
    for part in ("channel", "bus", "motor", "gripper", "control", "rpc", "access"):
        assert getattr(config, part) == getattr(defaults, part)
    assert config.source == path


def test_the_installed_file_and_an_empty_one_say_the_defaults(tmp_path: Path) -> None:
    installed = Path(__file__).parents[2] / "etc" / "litegripd.toml"
    for path in (installed, written(tmp_path, "")):
        assert dataclasses.replace(load("can0", path), source=None) == load("can0", None)


@pytest.mark.parametrize(
    ("content", "told"),
    [
        ('[motor]\ncan_id = "0x08"', "an integer, 1 to 2046, without quotes"),
        ('[control]\nrate_hz = "200"', ", without quotes"),
        ("[rpc]\ngroup = 5", "it must be a string"),
    ],
)
def test_a_number_in_quotes_is_none(tmp_path: Path, content: str, told: str) -> None:
    with pytest.raises(ConfigError, match=f"{told}$"):
        load("can0", written(tmp_path, content))


def test_every_key_can_be_set(tmp_path: Path) -> None:
    content = """
    [bus]
    interface = "slcan"
    channel = "/dev/ttyACM0"
    bitrate = 500000
    sleep_after_open = 0.5
    listen_only = false
    [motor]
    can_id = 0x21
    master_id = 0x31
    [gripper]
    mount = "/etc/litegripd/mine.json"
    stroke_mm = 100
    [control]
    rate_hz = 500
    priority = 0
    cpus = [2, 3]
    [rpc]
    socket = "/tmp/x.sock"
    group = "robot"
    [access]
    default = "observer"
    admins = ["root", 1000]
    operators = [1000, 1001]
    observers = []
    [teleop]
    zenoh_config = "/etc/litegripd/mine.json"
    """
    mine = tmp_path / "mine.json"
    mine.touch()
    content = content.replace("/etc/litegripd/mine.json", str(mine))
    config = load("left", written(tmp_path, content))
    options = {"sleep_after_open": 0.5, "listen_only": False}
    assert config.bus == BusSettings("slcan", "/dev/ttyACM0", 500_000, options)
    assert config.motor == MotorConfig("DM4310", 0x21, 0x31)
    assert config.gripper == GripperConfig(str(mine), 100)
    assert config.control == ControlConfig(500, 0, (2, 3))
    assert config.rpc == RpcConfig("/tmp/x.sock", "robot")
    assert config.teleop == TeleopConfig(str(mine))
    assert config.access == Access("observer", {0: "admin", 1000: "admin", 1001: "operator"}, {})


MISTAKES = {
    "[grippr]\n": ("grippr", "bus, motor, gripper, control, rpc, access, trajectories, teleop"),
    "rate_hz = 200\n": ("rate_hz is a key of [control]", "put it under [control]"),
    "motor = 3\n": ("motor", "[motor]"),
    "[motor]\nid = 8\n": ("[motor] id", "type, can_id, master_id"),
    "[gripper]\nstroke = 120\n": ("[gripper] stroke", "mount, stroke_mm"),
    "[control]\nrate = 200\n": ("[control] rate", "rate_hz, priority, cpus"),
    "[rpc]\nport = 80\n": ("[rpc] port", "socket, group"),
    "[teleop]\nport = 80\n": ("[teleop] port", "zenoh_config"),
    '[teleop]\nzenoh_config = "zenoh.json5"\n': ("[teleop] zenoh_config", "absolute path"),
    '[teleop]\nzenoh_config = "/no/such/file"\n': ("[teleop] zenoh_config", "of a file"),
    "[bus]\ninterface = 7\n": ("[bus] interface", "a string"),
    "[bus]\nchannel = 0\n": ("[bus] channel", "a string"),
    '[bus]\nchanel = "can1"\n': ("[bus] chanel is unknown", "did you mean channel?"),
    "[bus]\nbitrte = 500000\n": ("[bus] bitrte is unknown", "did you mean bitrate?"),
    "[bus]\nbitrate = 1e6\n": ("[bus] bitrate", "an integer"),
    "[bus]\nbitrate = 8000000\n": ("[bus] bitrate", "10000 to 1000000"),
    '[motor]\ntype = "DM4350"\n': ("[motor] type", "DM4310 or DM4340"),
    '[motor]\ncan_id = "8"\n': ("[motor] can_id", "an integer"),
    "[motor]\ncan_id = true\n": ("[motor] can_id", "an integer"),
    "[motor]\ncan_id = 0\n": ("[motor] can_id", "1 to 2046"),
    "[motor]\ncan_id = 0x7FF\n": ("[motor] can_id", "1 to 2046"),
    "[motor]\nmaster_id = -1\n": ("[motor] master_id", "0 to 2046"),
    "[gripper]\nstroke_mm = inf\n": ("[gripper] stroke_mm", "a number"),
    "[gripper]\nstroke_mm = 0\n": ("[gripper] stroke_mm", "1 to 1000"),
    '[gripper]\nmount = ""\n': ("[gripper] mount", "leave the key out"),
    "[gripper]\nmount = 1\n": ("[gripper] mount", "a string"),
    "[control]\nrate_hz = 200.0\n": ("[control] rate_hz", "an integer"),
    "[control]\nrate_hz = 50\n": ("[control] rate_hz", "100 to 1000"),
    "[control]\npriority = 100\n": ("[control] priority", "0 to 99"),
    "[control]\ncpus = 1\n": ("[control] cpus", "an array of integers"),
    "[control]\ncpus = [-1]\n": ("[control] cpus", "an array of integers"),
    "[control]\ncpus = [true]\n": ("[control] cpus", "an array of integers"),
    "[rpc]\nsocket = []\n": ("[rpc] socket", "a string"),
    '[rpc]\ngroup = ""\n': ("[rpc] group", "leave the key out"),
    "[access]\nadmin = []\n": ("[access] admin", "default, admins, operators, observers"),
    '[access]\ndefault = "none"\n': ("[access] default", "observer, operator, admin"),
    '[access]\nadmins = "root"\n': ("[access] admins", "an array of", "a user's name"),
    "[access]\noperators = [true]\n": ("[access] operators", "an array of", "a uid"),
    "[access]\nobservers = [1.5]\n": ("[access] observers", "an array of"),
    '[access]\nadmins = ["nobody-here"]\n': ("[access] admins", "'nobody-here'", "a user's name"),
    '[access]\nobservers = ["@no-lab"]\n': ("[access] observers", "'no-lab'", "group's name"),
    "[access]\noperators = [-1]\n": ("[access] operators", "-1", "0 to 4294967294"),
    "[gripper]\nstroke_mm = 1e400\n": ("[gripper] stroke_mm is 1e400, ", "a number, 1 to 1000"),
    "[gripper]\nstroke_mm = nan\n": ("[gripper] stroke_mm is nan, ", "a number, 1 to 1000"),
    f"[gripper]\nstroke_mm = {10**400}\n": ("[gripper] stroke_mm is 1000", "a number, 1 to 1000"),
    "[control]\nrate_hz = 1e400\n": ("[control] rate_hz is 1e400, ", "an integer, 100 to 1000"),
    "[bus]\ntty_baudrate = inf\n": ("[bus] tty_baudrate is inf, ", "string, number or boolean"),
    f"[bus]\n\nbitrate = {'9' * 5000}\n": ("line 3 has a number of 5000 digits",),
    "[motor\n": ("not valid TOML", "line 1"),
    "[bus]\nbitrate_data = 1979-05-27\n": ("bitrate_data",),
    "[bus]\nignore_config = false\n": ("ignore_config",),
    "[motor]\ncan_id = 0x18\nmaster_id = 0x18\n": ("master_id is can_id",),
    "[control]\ncpus = [4096]\n": ("cpus",),
    '[motor]\ntype = "DM6006"\n': (
        "[motor] type is 'DM6006', a type of the family that cannot",
        "missing: ranges of position, speed and torque, gear ratio, ",
    ),
    '[motor]\ntype = "DM4340P"\n': (
        "except for its ranges of position, speed and torque; miss",
        "missing: gear ratio, rated torque, torque of a long hold, peak",
    ),
    '[motor]\ntype = "dm4310"\n': (
        "'dm4310', no type of the family; it must be DM4310 or DM4",
        "DM8009, DM10010L, DM10010, DMH3510, DMH6215, DMS3519, DMG",
    ),
    '[gripper]\nmount = "sideways"\n': ("one of normal, reverse, or the absolute path",),
    '[gripper]\nmount = "/no/such/file.json"\n': ("there is no file",),
    '[rpc]\nsocket = "here.sock"\n': ("absolute path",),
    "[motor]\ncan_id = 8\ncan_id = 9\n": ("not valid TOML", "overwrite"),
}


@pytest.mark.parametrize("content", MISTAKES)
def test_a_mistake_is_refused_with_file_key_and_what_is_allowed(
    tmp_path: Path, content: str
) -> None:
    path = written(tmp_path, content)
    with pytest.raises(ConfigError) as caught:
        load("can0", path)
    message = str(caught.value)
    for part in (str(path), *MISTAKES[content]):
        assert part in message


def test_a_file_that_cannot_be_read_is_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"nothing\.toml: cannot be read: No such file"):
        load("can0", tmp_path / "nothing.toml")
    with pytest.raises(ConfigError, match="cannot be read: Is a directory"):
        load("can0", tmp_path)
    (tmp_path / "a.toml").write_bytes(b"\xff\xfe")
    with pytest.raises(ConfigError, match=r"a\.toml: it is in UTF-16"):
        load("can0", tmp_path / "a.toml")


def test_the_channels_own_file_comes_before_the_common_one(tmp_path: Path) -> None:
    assert find("can0", tmp_path) is None
    common = tmp_path / "litegripd.toml"
    common.touch()
    (tmp_path / "can1.toml").touch()
    assert find("can0", tmp_path) == common
    own = tmp_path / "can0.toml"
    own.touch()
    assert find("can0", tmp_path) == own


def test_the_command_line_wins_over_the_file(tmp_path: Path) -> None:
    config = load("can0", written(tmp_path, '[rpc]\nsocket = "/a.sock"\n[bus]\nfd = false\n'))
    changed = override(config, socket="/b.sock", interface="virtual", simulate=None)
    assert changed.rpc.socket == "/b.sock"
    assert changed.bus == BusSettings("virtual", "can0", 1_000_000, {"fd": False})
    assert override(config, socket=None, interface=None, simulate=None) == config


@pytest.mark.parametrize("mount", [None, "normal", "reverse"])
def test_simulate_takes_the_simulated_gripper_of_the_same_mount(
    tmp_path: Path, mount: str | None
) -> None:
    content = '[bus]\ninterface = "slcan"\nsleep_after_open = 1\n'
    content += "" if mount is None else f'[gripper]\nmount = "{mount}"\n'
    config = override(
        load("can0", written(tmp_path, content)),
        socket=None,
        interface=None,
        simulate=OWN_MECHANICS,
    )
    expected = mount or "normal"
    assert config.bus == BusSettings("litegrip_sim", "can0", 1_000_000, {"mount": expected})
    assert config.gripper.mount == expected


def test_simulate_takes_the_configured_type_of_motor(tmp_path: Path) -> None:
    path = written(tmp_path, '[motor]\ntype = "DM4340"\n')
    config = override(load("can0", path), socket=None, interface=None, simulate=OWN_MECHANICS)
    assert config.bus.options == {"mount": "normal", "motor_type": "DM4340"}
    config = override(config, socket=None, interface=None, simulate="mujoco")
    assert config.bus.options["mechanics"] == "mujoco"


@pytest.mark.parametrize("key", ["data_bitrate", "channel_id", "tty_baudrate", "fd", "btr0"])
def test_a_key_of_the_interface_is_no_misspelt_one(tmp_path: Path, key: str) -> None:
    assert load("can0", written(tmp_path, f"[bus]\n{key} = 1\n")).bus.options == {key: 1}


def test_the_calibration_file_that_is_named_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Whoever measures beside it has the old one back at the next start."""
    named = tmp_path / "mine.json"
    named.touch()

    def told(content: str) -> object:
        return load("can0", written(tmp_path, content)).as_info()["gripper"]["calibration"]

    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    assert told("") is None
    assert told('[gripper]\nmount = "normal"\n') is None
    assert told(f'[gripper]\nmount = "{named}"\n') == str(named)
    monkeypatch.setenv("LITEGRIP_CALIB", "/calibrations/other.json")
    assert told("") == "/calibrations/other.json"
    assert told('[gripper]\nmount = "normal"\n') is None
    assert told(f'[gripper]\nmount = "{named}"\n') == str(named)
