"""The page on two grippers, typed: daemons and page in terminals of their own, the rest in one."""

import contextlib
import re
import shlex
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from litegrip_client import ConnectError
from litegrip_client.threads.blocking import connect
from tests.process.daemon_process import DEADLINE_S, wait_a_moment
from tests.process.test_typed import ROOT, Shell

PAGE = ROOT / "docs" / "two-grippers.md"
ACTIVATE = ". .venv/bin/activate"
SERVICES = ("litegripd ", "litegripd-web ")


def typed() -> tuple[list[str], list[str]]:
    """Return the lines that start what serves, and those of the terminal after them."""
    blocks = re.findall(r"^```(python|)\n(.*?)^```", PAGE.read_text("utf-8"), re.M | re.S)
    services: list[str] = []
    lines: list[str] = []
    for language, block in blocks:
        if language:
            lines.append(f"python -c {shlex.quote(block)}")
            continue
        for line in block.splitlines():
            (services if line.startswith(SERVICES) else lines).append(line)
    return services, [line for line in lines if line != ACTIVATE]


@contextlib.contextmanager
def serving(line: str) -> Iterator["subprocess.Popen[bytes]"]:
    program, *arguments = line.split()
    command = [str(Path(sys.executable).parent / program), *arguments]
    process = subprocess.Popen(command, cwd=ROOT, stdout=subprocess.PIPE)
    try:
        yield process
    finally:
        process.terminate()
        process.communicate(timeout=DEADLINE_S)


@pytest.mark.alone
def test_each_line_succeeds_and_both_grippers_move(tmp_path: Path) -> None:
    services, lines = typed()
    channels = ("left", "right")
    config = "--config examples/simulated.toml"  # whose motor bears a busy machine
    assert services == [*(f"litegripd {name} {config}" for name in channels), services[2]]
    with contextlib.ExitStack() as stack:
        for channel, line in zip(channels, services, strict=False):
            process = stack.enter_context(serving(line))
            while True:
                with contextlib.suppress(ConnectError), connect(channel) as connection:
                    assert connection.call("hello")["pid"] == process.pid
                    break
                assert process.poll() is None
                wait_a_moment(process)
        page = stack.enter_context(serving(services[2] + " --port 0"))
        assert page.stdout is not None
        assert b"#" in page.stdout.readline()
        shell = stack.enter_context(contextlib.closing(Shell(tmp_path)))
        shell.type(f". {sys.prefix}/bin/activate")
        for line in lines:
            shown = shell.type(line)
            if "two_grippers.py" in line:
                assert "left still holds: True" in shown
            elif line.startswith("python -c"):
                assert "object_held reached" in shown
