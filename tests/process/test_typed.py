"""README and tutorial, typed line by line in a shell beside `make run`: each succeeds, as they say.

The lines are the pages' own, those in the text for the simulator included.
"""

import contextlib
import os
import re
import select
import shlex
import subprocess
import sys
import time
from pathlib import Path

import pytest

from litegrip_client import ConnectError
from litegrip_client.threads.blocking import connect
from tests.process.daemon_process import DEADLINE_S
from tests.process.run_simulated import run

ROOT = Path(__file__).parents[2]
OTHER = {"make run", "make demo", "litegripctl calibration load reverse"}
"""Typed in a terminal of its own; tried in `test_demo.py`; for a motor the other way round."""
LINES = re.compile(r"^```\n(.*?)^```|^```python\n(.*?)^```|`(litegripctl sim [^`]+)`", re.M | re.S)
EXPECTED = {
    "litegripctl grasp --force 10": "object held",
    "litegripctl release": "release: reached",
    "litegripctl close": "close: pressed home",
    "litegripctl zero": "measured",
    "litegripctl move 50%": "reached",
}


def section(text: str, title: str) -> str:
    """Return a section of a page."""
    found = re.search(rf"^## {re.escape(title)}\n(.*?)(?=^## |\Z)", text, re.M | re.S)
    assert found, title
    return found[1]


def typed(page: str) -> list[str]:
    """Return the lines to type, in their order; a Python program is one."""
    text = (ROOT / page).read_text("utf-8")
    if page == "README.md":
        text = section(text, "Try it without hardware") + section(text, "Use it from Python")
    else:
        titles = [title for title in re.findall(r"^## (.*)$", text, re.M) if title[0].isdigit()]
        text = "".join(section(text, title) for title in titles if "With hardware" not in title)
    lines: list[str] = []
    for block, program, inline in LINES.findall(text):
        if program:
            lines.append(f"python -c {shlex.quote(f'exec({program!r})')}")
        elif inline:
            lines.append(inline)
        elif not block.startswith("["):  # a configuration
            lines += [line.partition("  #")[0].strip() for line in block.splitlines()]
    return [line for line in lines if line not in OTHER]


class Shell:
    """A shell at a terminal, where somebody types."""

    def __init__(self, folder: Path) -> None:
        self._terminal, inner = os.openpty()
        environment = {
            **os.environ,
            "HOME": str(folder),
            "STATE_DIRECTORY": str(folder),
            "PS1": "",
            "TERM": "dumb",
            "PROMPT_COMMAND": "",
        }
        environment.pop("LITEGRIP_CHANNEL", None)
        self._process = subprocess.Popen(
            ["bash", "--norc", "--noprofile", "-i"],
            stdin=inner,
            stdout=inner,
            stderr=inner,
            cwd=ROOT,
            env=environment,
            start_new_session=True,
        )
        os.close(inner)
        self.type("stty -echo; PS1=; PS2=; set +o history")

    def type(self, line: str) -> str:
        """Type a line, and yes where it asks; return what it showed. It must succeed."""
        os.write(self._terminal, f'{line}; echo "=$?="\n'.encode())
        shown = ""
        ends_s = time.monotonic() + 2 * DEADLINE_S
        while not (done := re.search(r"=(\d+)=\r?\n", shown)):
            assert time.monotonic() < ends_s, f"{line} does not end: {shown}"
            if select.select([self._terminal], [], [], 1.0)[0]:
                shown += os.read(self._terminal, 65_536).decode()
            if shown.endswith("in mm? [85] "):  # Enter takes it
                os.write(self._terminal, b"\n")
                shown += "\n"
            if shown.endswith("[y/N] "):
                os.write(self._terminal, b"y\n")
                shown += "yes"
        assert done[1] == "0", f"{line}: {shown}"
        return shown

    def close(self) -> None:
        self._process.kill()
        self._process.wait()
        os.close(self._terminal)


@pytest.mark.parametrize(
    ("target", "runs"),
    [
        ("run", ["examples/run_simulated.py"]),
        ("run-mujoco", ["examples/run_simulated.py", "mujoco"]),
    ],
)
def test_make_run_is_what_is_run_here(target: str, runs: list[str]) -> None:
    done = subprocess.run(
        ["make", "--no-print-directory", "--dry-run", "--old-file", ".venv/.runs", target],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split()[-len(runs) :] == runs


@pytest.mark.alone
@pytest.mark.timeout(300)
@pytest.mark.parametrize("page", ["README.md", "docs/tutorial.md"])
def test_each_line_of_a_page_succeeds(page: str, tmp_path: Path) -> None:
    lines = typed(page)
    assert "litegripctl grasp --force 10" in lines
    with contextlib.suppress(ConnectError):
        connect("sim0").close()
        pytest.skip("a daemon of sim0 runs already")
    with run(tmp_path) as started, contextlib.closing(Shell(tmp_path)) as shell:
        assert started.page
        for line in lines:
            own = f"{sys.prefix}/bin/activate"
            shown = shell.type(line.replace(".venv/bin/activate", own))
            assert EXPECTED.get(line, "") in shown, (line, shown)
            if line.startswith("python"):
                assert "object_held" in shown, shown
