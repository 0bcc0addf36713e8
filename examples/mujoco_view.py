"""Look at a gripper that MuJoCo moves: in MuJoCo's viewer, or a picture by one of the cameras.

python examples/mujoco_view.py [--channel can0] [--picture FILE.png [--camera front]]

The gripper is that of `litegripd can0 --simulate mujoco`. This is a process of its own, so that
drawing never holds up the daemon. The viewer needs a display; for a picture without one, set
MUJOCO_GL=egl in the environment.
"""

import argparse
import contextlib
import struct
import sys
import time
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from litegrip_client import LiteGripError
from litegrip_client.core.discovery import chosen_channel
from litegrip_client.threads.blocking import connect

FRAME_S = 0.02
WIDTH, HEIGHT = 960, 640


def main(arguments: Sequence[str] | None = None) -> None:
    """Show the scene until the viewer is closed, or write one picture of it."""
    parser = argparse.ArgumentParser(description="Draw the scene of a gripper that MuJoCo moves.")
    parser.add_argument("--channel", help="default: LITEGRIP_CHANNEL, else can0")
    parser.add_argument("--socket", metavar="PATH", help="another socket than the channel's")
    parser.add_argument("--picture", type=Path, metavar="FILE", help="write a PNG, and end")
    parser.add_argument("--camera", default="front", help="of the scene (default: %(default)s)")
    options = parser.parse_args(arguments)
    import mujoco  # noqa: PLC0415 - the help does without it

    with connect(chosen_channel(options.channel), options.socket) as daemon:
        model = mujoco.MjModel.from_xml_path(daemon.call("sim.scene")["file"])
        data = mujoco.MjData(model)

        def update() -> None:
            data.qpos[:] = daemon.call("sim.scene")["qpos"]
            mujoco.mj_forward(model, data)

        update()
        if options.picture is None:
            show(model, data, update)
            return
        with mujoco.Renderer(model, HEIGHT, WIDTH) as renderer:
            renderer.update_scene(data, options.camera)
            options.picture.write_bytes(png(renderer.render()))


def show(model: Any, data: Any, update: Any) -> None:
    """Show it in MuJoCo's viewer until that is closed."""
    from mujoco import viewer  # noqa: PLC0415 - needs a display

    with viewer.launch_passive(model, data, show_left_ui=False, show_right_ui=False) as window:
        while window.is_running():
            update()
            window.sync()
            time.sleep(FRAME_S)


def png(pixels: Any) -> bytes:
    """Return an array of height x width x 3 bytes as a PNG."""
    height, width, _ = pixels.shape
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)

    def chunk(name: bytes, content: bytes) -> bytes:
        check = struct.pack(">I", zlib.crc32(name + content))
        return struct.pack(">I", len(content)) + name + content + check

    head = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = (chunk(b"IHDR", head), chunk(b"IDAT", zlib.compress(rows)), chunk(b"IEND", b""))
    return b"\x89PNG\r\n\x1a\n" + b"".join(parts)


if __name__ == "__main__":
    with contextlib.suppress(KeyboardInterrupt):
        try:
            main()
        except LiteGripError as error:
            sys.exit(f"mujoco_view: {error}")
