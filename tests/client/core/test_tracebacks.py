"""What a traceback shows: the user's line, and what a callback of the user's has called."""

import asyncio
import os
import re
import subprocess
import sys
import traceback
from pathlib import Path

import pytest

import litegrip_client
from litegrip_client import CommandError, ConnectError, LiteGrip, LiteGripError, aio
from litegrip_client.values.tracebacks import STOPPED_ALL_THE_SAME
from tests.client.fake_daemon import FakeDaemon
from tests.client.rig import Bench, Heard, Kind, Refuse, Threads

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


MISUSED = {
    "open(speed=20)": "LiteGrip.open() has no argument 'speed': did you mean 'speed_mm_s'? it",
    "grasp(force=10)": "LiteGrip.grasp() has no argument 'force': did you mean 'force_n'? it",
    "goto(positoin_mm=9)": "did you mean 'position_mm'? it takes: position_mm, kp, kd, duration,",
    "goto(9, colour=1)": "LiteGrip.goto() has no argument 'colour': it takes: position_mm, ",
    "hold(9)": "LiteGrip.hold(): too many positional arguments; it takes no arguments",
    "goto()": "LiteGrip.goto(): missing a required argument: 'position_mm'; it takes: position_mm,",
    "open(1, 2)": "it takes: speed_mm_s, progress; only by name: progress",
    "states(rate=3)": "LiteGrip.states() has no argument 'rate': it takes: hz, fields, batch",
    "lease(wait=3)": "LiteGrip.lease() has no argument 'wait': did you mean 'wait_s'? it takes: ",
}


@pytest.mark.parametrize("call", MISUSED)
def test_wrong_arguments_are_answered_by_the_right_ones(gripper: LiteGrip, call: str) -> None:
    with pytest.raises(TypeError) as caught:
        eval(f"gripper.{call}")
    assert MISUSED[call] in str(caught.value)


@pytest.mark.parametrize(
    ("call", "level", "wrong"),
    [
        ("software_stop(reason='a hand')", "hold", TypeError),
        ("software_stop(level='relax', reason='a hand')", "relax", TypeError),
        ("software_stop('disable', 'a hand', 3)", "disable", TypeError),
        ("software_stop('soft', 'a hand', 3)", "hold", CommandError),
        ("software_stop('there is a hand')", "hold", CommandError),
        ("software_stop(why=3)", "hold", CommandError),
        ("software_stop(level=['relax'])", "hold", CommandError),
    ],
)
def test_a_stop_with_wrong_arguments_stops_before_it_says_so(
    enabled: LiteGrip, call: str, level: str, wrong: type[Exception]
) -> None:
    with pytest.raises(wrong, match=re.escape(STOPPED_ALL_THE_SAME)) as caught:
        eval(f"enabled.{call}")
    stopped = enabled.get_state().stop
    assert stopped is not None
    assert stopped["level"] == level
    assert str(caught.value).count(STOPPED_ALL_THE_SAME) == 1


def test_an_object_with_wrong_arguments_is_not_made(kind: Kind) -> None:
    text = r"^LiteGrip\(\) has no argument 'chanel': did you mean 'channel'\? it takes: channel, "
    with pytest.raises(TypeError, match=text):
        kind.gripper(chanel="can1")


def test_the_other_client_is_named_where_a_block_is_of_the_wrong_kind(site: Bench) -> None:
    async def wrong() -> None:
        async with Threads(site).gripper():  # type: ignore[attr-defined]
            pass

    with pytest.raises(TypeError, match=r"`async with`: litegrip_client\.aio\.LiteGrip$") as caught:
        asyncio.run(wrong())
    assert frames_of(caught.value) == [*WRAPPER, "__aenter__"]
    told = r"`with`: litegrip_client\.LiteGrip$"
    with pytest.raises(TypeError, match=told) as caught, aio.LiteGrip():  # type: ignore[attr-defined]
        pass
    assert frames_of(caught.value) == [*WRAPPER, "__enter__"]


def test_a_callback_with_wrong_arguments_is_the_users_own(site: Bench, daemon: Heard) -> None:
    with Threads(site).gripper() as gripper:
        gripper.enable()
        with pytest.raises(TypeError, match=r"takes 0 positional arguments but 1 was given$"):
            gripper.open(progress=lambda: None)  # type: ignore[misc,arg-type]


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
@pytest.mark.parametrize(
    "call", ["open()", "get_state()", "lease().acquire()", "goto('x')", "open(speed=3)"]
)
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
        assert len(ours) > 1 or "speed" in call
    elif "speed" in call:
        assert len(ours) == len(WRAPPER), done.stderr
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
