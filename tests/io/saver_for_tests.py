"""A program that saves calibrations until it is killed, for tests that kill it.

`python -m tests.io.saver_for_tests ROOT` forks one child for each command on its standard input
and writes "E" when the child has ended. The child writes its process id and a line's end, and then:

- command "f": "." at the start of each save; it saves without an end, in both directories in turn;
- "0" to "9": saves this variant of the normal mount once, and before each call on the file system
  it writes "." and waits for any byte.
"""

import os
import sys
import traceback
from itertools import count
from pathlib import Path
from typing import Any

from litegripd.io.helper.atomic_file import REAL, FileSystem
from litegripd.io.helper.files import save_calibration

CHANNEL = "can7"
MOUNTS = {"normal": (0.1, -1.5), "reverse": (-1.5, 0.1)}


class Stepping(FileSystem):
    """The real file system; whoever started this program decides when each call is made."""

    def __getattribute__(self, name: str) -> Any:
        os.write(1, b".")
        os.read(0, 1)
        return super().__getattribute__(name)


def content(mount: str, variant: int) -> dict[str, object]:
    """Return one of several calibrations of a mount: their travel tells them apart."""
    closed_rad, open_rad = MOUNTS[mount]
    return {
        "channel": CHANNEL,
        "zero_position_rad": closed_rad,
        "max_position_rad": open_rad,
        "rad_to_mm": 70.0 + variant,
        "note": "x" * 100 * variant,
    }


def save(root: Path, mount: str, variant: int, file_system: FileSystem = REAL) -> None:
    """Save a calibration in the mount's own state directory."""
    os.environ["STATE_DIRECTORY"] = str(root / mount)
    parameters = {"channel": CHANNEL, "content": content(mount, variant)}
    save_calibration(parameters, file_system)


def save_for_ever(root: Path) -> None:
    """Save this and that, and tell each time."""
    for number in count():
        for mount in MOUNTS:
            os.write(1, b".")
            save(root, mount, number % 2)


def serve(root: Path) -> None:
    """Fork a child for each command and reap it."""
    while command := os.read(0, 1):
        child = os.fork()
        if child == 0:
            try:
                os.write(1, b"%d\n" % os.getpid())
                if command == b"f":
                    save_for_ever(root)
                else:
                    save(root, "normal", int(command), Stepping())
            except BaseException:  # noqa: BLE001 - a fork must never return into the loop
                traceback.print_exc()
                os._exit(1)
            os._exit(0)
        os.waitpid(child, 0)
        os.write(1, b"E")


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
