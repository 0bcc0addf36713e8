"""What LeRobot demands of a plug-in before it makes anything of it."""

import dataclasses
import sys
import typing
from pathlib import Path
from typing import Any

import pytest
from draccus import ChoiceRegistry
from lerobot.cameras import CameraConfig, make_cameras_from_configs
from lerobot.robots import Robot, RobotConfig
from lerobot.teleoperators import Teleoperator, TeleoperatorConfig

import lerobot_robot_litegrip as plugin
from lerobot_robot_litegrip import (
    LiteGripFollowerConfig,
    LiteGripLeaderConfig,
    LiteGripLeaderWithArmConfig,
    LiteGripSceneCamera,
    LiteGripSceneCameraConfig,
    LiteGripWithArmConfig,
)

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FOLDER = Path(__file__).parents[3] / "integrations" / "lerobot_robot_litegrip"
CONFIGS: dict[type, tuple[str, type[ChoiceRegistry]]] = {
    LiteGripFollowerConfig: ("litegrip_follower", RobotConfig),
    LiteGripWithArmConfig: ("litegrip_with_arm", RobotConfig),
    LiteGripLeaderConfig: ("litegrip_leader", TeleoperatorConfig),
    LiteGripLeaderWithArmConfig: ("litegrip_leader_with_arm", TeleoperatorConfig),
}
ENDLESS = (RobotConfig, TeleoperatorConfig)


def endless(config: Any) -> list[str]:
    """Return the fields that LeRobot's parser would expand without end, inner ones too."""
    found = []
    for name, kind in typing.get_type_hints(config).items():
        if typing.get_origin(kind) is typing.ClassVar:
            continue
        for part in (kind, *typing.get_args(kind)):
            if not isinstance(part, type):
                continue
            if issubclass(part, ENDLESS):
                found.append(name)
            elif dataclasses.is_dataclass(part):
                found += [f"{name}.{inner}" for inner in endless(part)]
    return found


@pytest.mark.parametrize("config", CONFIGS)
def test_no_field_is_a_robots_configuration(config: type) -> None:
    assert len(typing.get_type_hints(config)) > 5
    assert endless(config) == []


def test_such_a_field_would_be_found() -> None:
    @dataclasses.dataclass
    class Inner:
        robot: RobotConfig | None = None

    @dataclasses.dataclass
    class Outer:
        inner: Inner
        arms: dict[str, TeleoperatorConfig]

    Outer.__annotations__["inner"] = Inner
    assert endless(Outer) == ["inner.robot", "arms"]


@pytest.mark.parametrize("config", CONFIGS)
def test_each_is_chosen_by_its_name_and_its_device_is_found_beside_it(config: type) -> None:
    name, of = CONFIGS[config]
    assert of.choices[name] is config
    device = getattr(plugin, config.__name__.removesuffix("Config"))
    assert device.name == name
    assert device.config_class is config
    assert issubclass(device, Robot if of is RobotConfig else Teleoperator)
    assert config.__module__.rpartition(".")[0] == plugin.__name__


def test_the_camera_is_chosen_by_its_name_and_draws_the_channel_of_the_environment(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LITEGRIP_CHANNEL", "scene")
    assert CameraConfig.choices["litegrip_scene"] is LiteGripSceneCameraConfig
    config = LiteGripSceneCameraConfig(width=320, height=240, fps=15)
    camera = make_cameras_from_configs({"front": config})["front"]
    assert isinstance(camera, LiteGripSceneCamera)
    assert (camera.width, camera.height, camera.fps) == (320, 240, 15)
    assert camera._channel == "scene"


def test_lerobot_finds_the_distribution_by_its_modules_name() -> None:
    project = tomllib.loads((FOLDER / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert project["name"] == plugin.__name__
    assert project["name"].startswith("lerobot_robot_")
    own = [one for one in project["dependencies"] if not one.startswith("lerobot>")]
    assert own == ["litegrip-client"]


@pytest.mark.parametrize(
    ("settings", "says"),
    [
        ({"mode": "fast"}, "mode is 'fast', it must be one of stream, daemon"),
        ({"mode": "daemon"}, "needs leader_host"),
        ({"max_age_s": 0.0}, "max_age_s is 0.0"),
    ],
)
def test_what_cannot_be_is_refused_before_anything_connects(
    settings: dict[str, Any], says: str
) -> None:
    for config in (LiteGripFollowerConfig, LiteGripWithArmConfig):
        with pytest.raises(ValueError, match=says):
            config(**settings)
    if settings != {"mode": "daemon"}:
        for leader in (LiteGripLeaderConfig, LiteGripLeaderWithArmConfig):
            with pytest.raises(ValueError, match=says):
                leader(**settings)
