"""The demo of the README: one daemon, one process that moves the jaws, one that watches both."""

import re
import subprocess
import sys
from pathlib import Path

DEMO = Path(__file__).parents[2] / "examples" / "demo.py"


def test_the_demo_opens_closes_and_is_watched() -> None:
    done = subprocess.run(
        [sys.executable, str(DEMO)], capture_output=True, text=True, timeout=100, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    watched = [line for line in done.stdout.splitlines() if line.startswith("watcher |")]
    assert any("moving    open" in line for line in watched)
    assert any("moving    close" in line for line in watched)
    assert re.search(r"ok=True \(pressed_home\), -?0\.[012] mm open", done.stdout)
    assert done.stdout.rstrip().endswith("The demo worked: one gripper, two processes.")
