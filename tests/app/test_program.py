"""The program `litegripd`, as it is installed."""

import subprocess
import sys
import venv
from pathlib import Path

from litegripd.app.main import EXIT_NO_PACKAGES

PROGRAM = Path(__file__).parents[2] / "litegripd/app/litegripd"


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [*command, PROGRAM, "--version"], capture_output=True, text=True, timeout=60.0, check=False
    )


def test_it_is_the_daemon() -> None:
    done = run(sys.executable)
    assert (done.returncode, done.stderr) == (0, "")
    assert done.stdout.startswith("litegripd ")


def test_without_its_packages_it_says_in_one_line_what_to_do(tmp_path: Path) -> None:
    venv.create(tmp_path, symlinks=True)
    done = run(str(tmp_path / "bin/python3"), "-I")
    assert (done.returncode, done.stdout) == (EXIT_NO_PACKAGES, "")
    assert done.stderr.startswith("litegripd: No module named 'litegripd': Python 3.")
    assert f"make the environment {tmp_path} anew" in done.stderr
    assert done.stderr.count("\n") == 1
