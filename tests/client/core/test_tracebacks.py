"""What a traceback shows: the user's line, and what a callback of the user's has called."""

import os
import subprocess
import sys
import traceback
from pathlib import Path

import pytest

import litegrip_client
from litegrip_client import CommandError, ConnectError, LiteGripError
from tests.client.fake_daemon import FakeDaemon
from tests.client.rig import Bench, Heard, Refuse, Threads

OURS = Path(litegrip_client.__file__).parent


def frames_of(error: BaseException) -> list[str]:
    """Return the functions in a traceback that are this package's, behind this file's."""
    frames = traceback.extract_tb(error.__traceback__)
    assert frames[0].filename == __file__
    return [frame.name for frame in frames if frame.filename.startswith(str(OURS))]


WRAPPER = ["call"] if sys.version_info < (3, 11) else []
"""Python 3.10 shows what shortens a traceback, too."""


def test_a_traceback_ends_at_the_method_that_was_called(site: Bench, daemon: Heard) -> None:
    with Threads(site).gripper() as gripper:
        with pytest.raises(LiteGripError) as refused:
            gripper.open()
        assert frames_of(refused.value) == [*WRAPPER, "open"]
        with pytest.raises(LiteGripError) as wrong:
            gripper.grasp(force_n="x")  # type: ignore[arg-type]
        assert frames_of(wrong.value) == [*WRAPPER, "grasp"]
        daemon.instead["state.get"] = Refuse("internal", -32603)
        with pytest.raises(LiteGripError) as wrong:
            gripper.get_position()
        assert frames_of(wrong.value) == [*WRAPPER, "get_position"]
        daemon.instead["lease.renew"] = Refuse("lease_lost", -32010)
        with pytest.raises(LiteGripError) as wrong:
            gripper.lease().renew()
        assert frames_of(wrong.value) == [*WRAPPER, "renew"]
        with pytest.raises(LiteGripError) as wrong:
            gripper.states(-1.0)
        assert frames_of(wrong.value) == [*WRAPPER, "states"]
    with pytest.raises(ConnectError) as missing:
        Threads(site).gripper("can1").connect()
    assert frames_of(missing.value) == [*WRAPPER, "connect"]
    with pytest.raises(ConnectError) as missing, Threads(site).gripper("can1"):
        pass
    assert frames_of(missing.value) == [*WRAPPER, "__enter__"]
    with pytest.raises(CommandError) as wrong:
        Threads(site).gripper("../can0")
    assert [*WRAPPER, "__init__"] == [name for name in frames_of(wrong.value) if name != "gripper"]


@pytest.mark.parametrize(
    "raised", [CommandError("mine", reason="invalid_params"), KeyboardInterrupt()], ids=type
)
def test_a_traceback_keeps_what_a_callback_has_called(
    site: Bench, daemon: Heard, raised: BaseException
) -> None:
    """As if somebody had typed Ctrl-C there, for one of them."""

    def report(_progress: object) -> None:
        raise raised

    with Threads(site).gripper() as gripper:
        gripper.enable()
        with pytest.raises(type(raised)) as caught:
            gripper.open(progress=report)
    assert frames_of(caught.value) == [*WRAPPER, "open"]
    names = [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]
    assert names[-1] == "report"


THREADS = """
from litegrip_client import LiteGrip
with LiteGrip() as gripper:
    gripper.{call}
"""
ASYNCIO = """
import asyncio
from litegrip_client.aio import LiteGrip
async def main():
    async with LiteGrip() as gripper:
        await gripper.{call}
asyncio.run(main())
"""


@pytest.mark.parametrize("script", [THREADS, ASYNCIO], ids=["threads", "asyncio"])
@pytest.mark.parametrize("call", ["open()", "get_state()", "lease().acquire()", "goto('x')"])
@pytest.mark.parametrize("options", [[], ["-X", "dev"]], ids=["as usual", "dev"])
def test_the_printed_traceback_names_the_users_line_and_one_of_ours(
    tmp_path: Path, script: str, call: str, options: list[str]
) -> None:
    path = tmp_path / "script.py"
    path.write_text(script.format(call=call))
    with FakeDaemon(tmp_path / "can0.sock") as daemon:
        for method in ("motion.open", "state.get", "lease.acquire"):
            daemon.handlers[method] = lambda request: request.fail("busy", -32011)
        done = subprocess.run(
            [sys.executable, *options, str(path)],
            env={**os.environ, "LITEGRIPD_SOCKET": daemon.path, "PYTHONPATH": str(OURS.parent)},
            capture_output=True,
            text=True,
            check=False,
        )
    printed = [line for line in done.stderr.splitlines() if line.startswith('  File "')]
    ours = [line for line in printed if str(OURS) in line]
    assert done.returncode == 1
    assert f'"{path}", line' in "".join(printed)
    if options:
        assert len(ours) > 1
    else:
        assert len(ours) == 1 + len(WRAPPER), done.stderr
        assert ours[-1].endswith(f"in {call.partition('(')[0]}" if "." not in call else "acquire")


def test_the_printed_traceback_without_a_daemon_is_short(tmp_path: Path) -> None:
    done = subprocess.run(
        [sys.executable, "-c", THREADS.format(call="open()")],
        env={**os.environ, "LITEGRIPD_SOCKET": str(tmp_path / "no.sock")},
        capture_output=True,
        text=True,
        check=False,
        cwd=OURS.parent,
    )
    ours = [line for line in done.stderr.splitlines() if str(OURS) in line]
    assert len(ours) == 1 + len(WRAPPER), done.stderr
