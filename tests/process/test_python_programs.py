"""The blocks of docs/python-programs.md, each as a program of its own, beside a real daemon.

They use threads, asyncio and a daemon that is started again: nothing of that is in virtual time.
"""

import contextlib
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S, DaemonProcess, configured, line_of, ran

PAGE = Path(__file__).parents[2] / "docs" / "python-programs.md"
CHANNEL = f"page{os.getpid()}"
FENCE = re.compile(r"^```python\n(.*?)^```$", re.MULTILINE | re.DOTALL)
BLOCKS: list[str] = FENCE.findall(PAGE.read_text("utf-8"))

ENDS = {
    "gripper.jobs()": r"open +done +python .*\n(.*\n)*open done python\n(ok|degraded) \[.*\]\n$",
    "pool.submit": r"60\.\d+\n(.*\n)+reached\n$",
    "threading.Timer": r"^not there after 2 s: the jaws hold\n$",
    "except LeaseError": "^$",
    "motion_config": r"^reached\n$",
    "asyncio.timeout": r"60\.\d+\n(.*\n)+not there after 2 s: the jaws hold\n$",
}
"""What has a block, and what it prints; the others go on, and have tests of their own."""
GO_ON = ("except ConnectError", "object_lost")


def block(part: str) -> str:
    """Return the only block that has this, for this test's daemon."""
    (code,) = (code for code in BLOCKS if part in code)
    return code.replace('"can0"', repr(CHANNEL))


def at(daemon: DaemonProcess) -> dict[str, str]:
    """Return the environment of a program that uses this daemon."""
    return {**os.environ, "LITEGRIPD_SOCKET": str(daemon.socket_path), "PYTHONUNBUFFERED": "1"}


@contextlib.contextmanager
def begun(part: str, daemon: DaemonProcess) -> Iterator["subprocess.Popen[str]"]:
    """Run a block beside the test."""
    command = [sys.executable, "-c", block(part)]
    pipe = subprocess.PIPE
    with subprocess.Popen(command, stdout=pipe, stderr=pipe, text=True, env=at(daemon)) as program:
        try:
            yield program
        finally:
            program.kill()


def test_each_block_has_a_test() -> None:
    assert len(BLOCKS) == len(ENDS) + len(GO_ON)
    assert {block(part) for part in (*ENDS, *GO_ON)} == {
        code.replace('"can0"', repr(CHANNEL)) for code in BLOCKS
    }


@pytest.mark.parametrize("part", ENDS)
def test_it_runs_to_its_end(part: str, tmp_path: Path) -> None:
    if "asyncio.timeout" in part and sys.version_info < (3, 11):
        pytest.skip("the page says what to write in its place")
    with configured(tmp_path, CHANNEL) as daemon, daemon.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        done = ran(sys.executable, "-c", block(part), env=at(daemon))
        assert (done.returncode, done.stderr) == (0, "")
        assert re.search(ENDS[part], done.stdout), done.stdout
        client.until(lambda state: bool(state["motor"] == "disabled"))


def test_who_has_the_lease_is_printed(tmp_path: Path) -> None:
    with configured(tmp_path, CHANNEL) as daemon, daemon.connect() as client:
        client.result("lease.acquire", purpose="packing")
        done = ran(sys.executable, "-c", block("except LeaseError"), env=at(daemon))
        assert (done.returncode, done.stderr) == (0, "")
        assert re.search("has the gripper for packing.*'purpose': 'packing'", done.stdout), (
            done.stdout
        )


def test_the_thread_hears_of_the_loss(tmp_path: Path) -> None:
    with configured(tmp_path, CHANNEL) as daemon, daemon.connect() as client:
        client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        client.result("sim.object", width_mm=40.0)
        with begun("object_lost", daemon) as program:
            client.until(lambda state: bool(state["is_grasped"]))
            client.result("sim.object")
            assert re.match(r"object_lost at \d+\.\d+ the object is lost", line_of(program))
            rest = program.communicate(timeout=DEADLINE_S)
        assert (program.returncode, rest) == (0, ("", ""))


def test_the_loop_connects_to_the_daemon_that_is_started_again(tmp_path: Path) -> None:
    with configured(tmp_path, CHANNEL) as daemon, begun("except ConnectError", daemon) as program:
        until(program, r"\d+\.\d+")
        daemon.end()
        until(program, "again in 1 s: ")
        with configured(tmp_path, CHANNEL) as another:
            until(program, r"\d+\.\d+")
            with another.connect() as client:
                assert client.result("state.get")["motor"] == "enabled"
                program.send_signal(signal.SIGINT)
                assert program.communicate(timeout=DEADLINE_S)[1].endswith("KeyboardInterrupt\n")
                client.until(lambda state: bool(state["motor"] == "disabled"))


def until(program: "subprocess.Popen[str]", pattern: str) -> None:
    """Read what a program prints until a line is like this."""
    while not re.match(pattern, line := line_of(program)):
        assert line or program.poll() is None


@pytest.mark.skipif(sys.version_info < (3, 11), reason="the page says what to write in its place")
@pytest.mark.parametrize("end", ["daemon", "Ctrl-C"])
def test_the_watching_task_leaves_nothing_unsaid(tmp_path: Path, end: str) -> None:
    with configured(tmp_path, CHANNEL) as daemon:
        with daemon.connect() as client:
            client.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        with begun("asyncio.timeout", daemon) as program:
            until(program, r"[78]\d\.\d+")  # open() is under way
            if end == "daemon":
                daemon.end()
            else:
                program.send_signal(signal.SIGINT)
            said = program.communicate(timeout=DEADLINE_S)[1]
    assert "never retrieved" not in said
    if end == "daemon":
        assert said.count("Traceback") == 1, said
    else:
        assert said.endswith("KeyboardInterrupt\n")
