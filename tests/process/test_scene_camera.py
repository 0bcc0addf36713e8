"""LeRobot's camera of MuJoCo's scene: what it sees is where the running daemon has the jaws."""

import ctypes.util
from collections.abc import Iterator
from typing import Any

import pytest

from lerobot_robot_litegrip import LiteGripSceneCamera, LiteGripSceneCameraConfig
from litegrip_client import CommandError, ConnectError
from litegrip_client.testing import SimulatedDaemon, simulated
from tests.integrations.lerobot.sight import ROW, expected_px, seen_px

WIDTH, HEIGHT = 320, 240
MOST_OFF_PX = 1.5
"""Both edges are at whole pixels."""

draws = pytest.mark.skipif(
    ctypes.util.find_library("EGL") is None, reason="libEGL is missing (Mesa)"
)


@pytest.fixture
def on_mujoco(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimulatedDaemon]:
    with simulated(mechanics="mujoco") as daemon:
        monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.socket_path)
        yield daemon


def a_camera(**settings: Any) -> LiteGripSceneCamera:
    return LiteGripSceneCamera(
        LiteGripSceneCameraConfig(width=WIDTH, height=HEIGHT, fps=15, **settings)
    )


def off_px(image: Any, opening_mm: float) -> float:
    """Return by how much the jaws' opening in an image is not as it must be."""
    assert (image.shape, str(image.dtype)) == ((HEIGHT, WIDTH, 3), "uint8")
    row = image[int(ROW * HEIGHT)].mean(axis=1).round().astype(int).tolist()
    seen = seen_px(row)
    assert seen is not None
    return abs(seen - expected_px(opening_mm, HEIGHT))


@draws
def test_an_image_shows_the_jaws_where_they_are(on_mujoco: SimulatedDaemon) -> None:
    camera = a_camera()
    camera.connect()
    with on_mujoco.gripper() as gripper:
        gripper.enable()
        for opening_mm in (75.0, 40.0):
            gripper.goto(opening_mm)
            assert off_px(camera.read(), opening_mm) < MOST_OFF_PX
        gripper.open(60.0)
        assert gripper.grasp(10.0, until="verdict").outcome == "object_held"
        for image in (camera.async_read(), camera.read_latest()):
            assert off_px(image, 29.8) < MOST_OFF_PX
    camera.disconnect()
    assert not camera.is_connected
    with pytest.raises(ConnectError, match="not connected"):
        camera.read()


@draws
def test_an_image_may_be_larger_than_the_scene_says(on_mujoco: SimulatedDaemon) -> None:
    camera = LiteGripSceneCamera(LiteGripSceneCameraConfig(width=1600, height=32, fps=15))
    camera.connect()
    assert camera.is_connected
    assert camera.read().shape == (32, 1600, 3)
    camera.disconnect()


@draws
def test_a_camera_that_the_scene_does_not_have_is_refused(on_mujoco: SimulatedDaemon) -> None:
    camera = a_camera(camera="wrist")
    with pytest.raises(ValueError, match="wrist"):
        camera.connect()
    assert not camera.is_connected


@draws
def test_a_daemon_that_is_gone_gives_no_more_images(monkeypatch: pytest.MonkeyPatch) -> None:
    camera = a_camera()
    with simulated(mechanics="mujoco") as daemon:
        monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.socket_path)
        camera.connect()
    with pytest.raises(ConnectError):
        camera.read()
    camera.disconnect()


def test_a_gripper_without_bodies_has_no_camera(monkeypatch: pytest.MonkeyPatch) -> None:
    with simulated() as daemon:
        monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.socket_path)
        camera = a_camera()
        with pytest.raises(CommandError, match="no bodies"):
            camera.connect()
        assert not camera.is_connected
