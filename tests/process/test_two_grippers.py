"""The example for two grippers, with a daemon for each."""

import os
import subprocess
import sys
from pathlib import Path

from tests.process.by_portal import Met
from tests.process.daemon_process import SIMULATED, WORK_MM, DaemonProcess, configured, ran

EXAMPLE = Path(__file__).parents[2] / "examples" / "two_grippers.py"
WITH_OBJECT = SIMULATED.replace("[bus]\n", "[bus]\nobject_mm = 40.0\n")


def run(places: Path, channels: list[str]) -> "subprocess.CompletedProcess[str]":
    environment = {**os.environ, "XDG_RUNTIME_DIR": str(places)}
    environment.pop("LITEGRIPD_SOCKET", None)
    return ran(
        sys.executable, str(EXAMPLE), "--left", channels[0], "--right", channels[1], env=environment
    )


def disabled(running: DaemonProcess) -> None:
    with running.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))


def test_one_holds_while_the_other_works(met: Met, tmp_path: Path) -> None:
    """A daemon that is kept off the processor may lose its motor: then a user tries again."""
    places = tmp_path / "places"
    (places / "litegripd").mkdir(parents=True)
    channels = [f"{side}-{os.getpid()}" for side in ("left", "right")]
    for channel in channels:
        socket_path = tmp_path / channel / "rpc.sock"
        (places / "litegripd" / f"{channel}.sock").symlink_to(socket_path)
    with (
        configured(tmp_path / channels[0], channels[0], WITH_OBJECT) as holds,
        configured(tmp_path / channels[1], channels[1]) as works,
        met(holds, works) as lab,
    ):
        if lab is not None:
            places, channels = lab.runtime_directory(), ["lab.left", "lab.right"]
        for _ in range(4):
            disabled(holds)
            disabled(works)
            done = run(places, channels)
            if "the motor" not in done.stderr:
                break
        assert (done.returncode, done.stderr) == (0, "")
        assert done.stdout.splitlines() == [
            f"open: {WORK_MM:g} mm {WORK_MM:g} mm",
            "left: object_held",
            "right: reached",
            "left still holds: True",
        ]
        disabled(holds)
        disabled(works)
