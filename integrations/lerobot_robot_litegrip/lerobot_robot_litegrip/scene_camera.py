"""A camera of the scene that MuJoCo moves, which LeRobot reads like any other.

It draws the running daemon's scene: for each image it asks where all bodies are, so that an image
shows the moment at which it was asked for. The daemon itself draws nothing.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from lerobot.cameras import Camera

from lerobot_robot_litegrip.config import LiteGripSceneCameraConfig
from litegrip_client import ConnectError
from litegrip_client.core.discovery import chosen_channel
from litegrip_client.line.connection import Connection
from litegrip_client.threads.blocking import connect


class LiteGripSceneCamera(Camera):
    """`type: litegrip_scene`. One thread connects and reads: what draws belongs to it."""

    def __init__(self, config: LiteGripSceneCameraConfig) -> None:
        super().__init__(config)
        self.config = config
        self._channel = chosen_channel(config.channel)
        self._daemon: Connection | None = None
        self._model: Any = None
        self._data: Any = None
        self._renderer: Any = None

    @staticmethod
    def find_cameras() -> list[dict[str, Any]]:
        """Return none: which daemons' scenes have cameras is nowhere listed."""
        return []

    @property
    def is_connected(self) -> bool:
        """True from `connect` to `disconnect`."""
        return self._renderer is not None

    def connect(self, warmup: bool = True) -> None:
        """Load the daemon's scene and draw it once, which costs more than later.

        Raises `ConnectError` where no daemon answers or its scene is another machine's,
        `CommandError` for a daemon without a scene, `ValueError` for a camera that the scene does
        not have, and `ImportError` without MuJoCo.
        """
        os.environ.setdefault("MUJOCO_GL", "egl")  # is read by the import: it needs no display
        import mujoco  # noqa: PLC0415

        try:
            self._daemon = connect(self._channel)
            file = Path(self._daemon.call("sim.scene")["file"])
            if not file.exists():
                raise ConnectError(
                    f"{self._channel}: its scene is {file}, which this machine does not have",
                    reason="not_connected",
                )
            self._model = mujoco.MjModel.from_xml_path(str(file))
            look = self._model.vis
            look.global_.offwidth = max(look.global_.offwidth, self.width)
            look.global_.offheight = max(look.global_.offheight, self.height)
            if self.config.plain:
                look.quality.shadowsize = look.quality.offsamples = 0
            self._data = mujoco.MjData(self._model)
            self._renderer = mujoco.Renderer(self._model, self.height, self.width)
            self.read()
        except BaseException:
            self.disconnect()
            raise

    def read(self) -> Any:
        """Return an image of the scene as it is now: height x width x 3 bytes, RGB.

        Raises `ConnectError` while it is not connected, and when the daemon is gone.
        """
        if self._daemon is None:
            raise ConnectError(f"{self._channel}: not connected", reason="not_connected")
        import mujoco  # noqa: PLC0415

        self._data.qpos[:] = self._daemon.call("sim.scene")["qpos"]
        mujoco.mj_forward(self._model, self._data)
        self._renderer.update_scene(self._data, self.config.camera)
        return self._renderer.render()

    def async_read(self, timeout_ms: float = 200.0) -> Any:
        """Do as `read`: no image is made before it is asked for, so none waits."""
        return self.read()

    def read_latest(self, max_age_ms: int = 500) -> Any:
        """Do as `read`."""
        return self.read()

    def disconnect(self) -> None:
        """Disconnect, and let go of what draws."""
        renderer, self._renderer = self._renderer, None
        if renderer is not None:
            renderer.close()
        daemon, self._daemon = self._daemon, None
        if daemon is not None:
            daemon.close()
