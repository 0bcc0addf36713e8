"""What a traceback shows: the user's line, and what a callback of the user's has called."""

import asyncio
import functools
import os
import re
import subprocess
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import litegrip_client
from litegrip_client import CommandError, ConnectError, LiteGrip, LiteGripError, Trajectory, aio
from litegrip_client.core.sockets import SYSTEM_DIRECTORY
from litegrip_client.testing import SimulatedDaemon
from litegrip_client.values.tracebacks import STOPPED_ALL_THE_SAME
from tests.client.fake_daemon import FakeDaemon
from tests.client.rig import Asyncio, Bench, Heard, Kind, Refuse, Threads

OURS = Path(litegrip_client.__file__).parent


def frames_of(error: BaseException) -> list[str]:
    """Return the functions in a traceback that are this package's, behind this file's."""
    frames = traceback.extract_tb(error.__traceback__)
    assert frames[0].filename == __file__
    return [frame.name for frame in frames if frame.filename.startswith(str(OURS))]


WRAPPER = ["call"] if sys.version_info < (3, 11) else []
"""Python 3.10 shows what shortens a traceback, too."""


def test_a_daemon_that_is_killed_during_a_calibration_by_hand_is_told_once(
    site: Bench, daemon: Heard, caplog: pytest.LogCaptureFixture
) -> None:
    gripper = Threads(site).gripper()
    gripper.connect()
    gripper.enable()
    site.after(1.0, daemon.hang_up)
    with pytest.raises(ConnectError, match="ended the connection") as caught:
        gripper.calibrate_manual(12)
    assert frames_of(caught.value) == [*WRAPPER, "calibrate_manual"]
    assert caught.value.__context__ is None
    assert str(caught.value).endswith("; after that, begin again: gripper.calibrate_manual()")
    assert not caplog.messages
    with pytest.raises(ConnectError):
        gripper.disconnect()


def told_by_pytest(caught: pytest.ExceptionInfo[Any]) -> str:
    """Return what pytest prints of a test that fails so."""
    return str(caught.getrepr(style="long"))


def test_pytest_shows_the_line_of_the_test_and_none_of_ours(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    of_the_simulator = SimulatedDaemon("can0", f"{SYSTEM_DIRECTORY}/can0.sock")
    for ask in (lambda: gripper.goto(500), lambda: of_the_simulator.fault("foo")):
        with pytest.raises(LiteGripError) as caught:
            ask()
        told = told_by_pytest(caught)
        assert "litegrip_client/" not in told
        if not kind.awaits:  # else asyncio's lines, of the test's bench, are the last
            assert Path(__file__).name in told.splitlines()[-1]


def test_pytest_shows_a_defect_of_ours_whole(
    site: Bench, daemon: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("litegrip_client.core.actions.number", None)
    with Threads(site).gripper() as gripper, pytest.raises(TypeError) as caught:
        gripper.goto(500)
    assert "core/actions.py" in told_by_pytest(caught)


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
    "assign",
    [
        lambda gripper: setattr(gripper.motion_config, "force_n", "a"),
        lambda gripper: setattr(gripper.config, "max_stroke_mm", "85"),
        lambda gripper: setattr(gripper.config, "kp", 3.0),
    ],
    ids=["motion_config", "config", "read_only"],
)
def test_a_traceback_of_a_wrong_value_ends_at_the_assignment(
    site: Bench, daemon: Heard, assign: Callable[[LiteGrip], None]
) -> None:
    with Threads(site).gripper() as gripper, pytest.raises(CommandError) as wrong:
        assign(gripper)
    assert frames_of(wrong.value) == [*WRAPPER, "__setattr__"]


@pytest.mark.parametrize(
    "raised",
    [CommandError("mine", reason="invalid_params"), KeyboardInterrupt(), ZeroDivisionError()],
    ids=type,
)
def test_a_traceback_keeps_what_a_callback_has_called(
    site: Bench, daemon: Heard, raised: BaseException
) -> None:
    """As if somebody had typed Ctrl-C there, for one of them; another is the user's own."""

    def report(_progress: object) -> None:
        raise raised

    with Threads(site).gripper() as gripper:
        gripper.enable()
        with pytest.raises(type(raised)) as caught:
            gripper.open(progress=report)
    assert frames_of(caught.value) == [*WRAPPER, "open"]
    names = [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]
    assert names[-1] == "report"


def test_a_defect_of_ours_is_shown_whole(
    site: Bench, daemon: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    with Threads(site).gripper() as gripper, monkeypatch.context() as broken:
        broken.setattr(gripper._session, "_wire", 3)
        with pytest.raises(AttributeError) as caught:
            gripper.health()
    assert len(frames_of(caught.value)) > 2


@pytest.mark.parametrize("call", ["enable", "move_at_speed", "states"])
def test_a_cancelled_task_shows_one_line_of_ours(
    site: Bench, daemon: Heard, tasks: Asyncio, call: str
) -> None:
    """The very exception that asyncio has thrown goes on, and cancels the task."""
    thrown: list[BaseException] = []

    async def use(gripper: aio.LiteGrip) -> None:
        try:
            if call == "enable":
                daemon.late["motor.enable"] = 1.0
                await gripper.enable()
            elif call == "move_at_speed":
                await gripper.move_at_speed(5, 5)
            else:
                async for _ in gripper.states(5):
                    pass
        except asyncio.CancelledError as error:
            thrown.append(error)
            raise

    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            await gripper.enable()
            task = asyncio.create_task(use(gripper))
            await asyncio.sleep(0.3)
            task.cancel("by the test")
            with pytest.raises(asyncio.CancelledError) as caught:
                await task
            assert task.cancelled()
            if sys.version_info >= (3, 11):  # before, a task makes another one for who waits
                assert caught.value is thrown[0]
            assert str(thrown[0]) == "by the test"

    tasks.run(main())
    name = "__anext__" if call == "states" else call
    named = [frame.name for frame in traceback.extract_tb(thrown[0].__traceback__)]
    ours = ["call_and_wait"] if WRAPPER else []
    assert [one for one in named if one in (name, "call_and_wait", "run")] == [*ours, name]


MADE_FIRST = r"^LiteGrip is the class: make an object first, as `gripper = LiteGrip\('can0'\)`$"


@pytest.mark.parametrize("call", ["enable()", "goto(40)", "open(20)", "software_stop()", "jobs()"])
def test_a_call_of_the_class_says_that_an_object_is_missing(call: str) -> None:
    with pytest.raises(TypeError, match=MADE_FIRST) as caught:
        eval(f"LiteGrip.{call}")
    assert caught.value.__suppress_context__
    with pytest.raises(TypeError, match=MADE_FIRST):
        asyncio.run(eval(f"aio.LiteGrip.{call}"))


def test_each_class_is_named_by_a_call_of_it() -> None:
    with pytest.raises(TypeError, match=r"^Trajectory is the class: make an object first$"):
        Trajectory.save("pick")  # type: ignore[call-arg,arg-type]


def test_a_traceback_of_what_is_no_method_of_a_gripper_has_one_line_of_ours(
    site: Bench, daemon: Heard, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path))
    (tmp_path / "bad.lgt").write_text("hello")

    def shown(call: Callable[[], object], text: str) -> list[str]:
        with pytest.raises(LiteGripError, match=text) as caught:
            call()
        assert caught.value.__context__ is None or caught.value.__suppress_context__
        return frames_of(caught.value)

    assert shown(lambda: Trajectory.load("bad"), "no .lgt file$") == [*WRAPPER, "load"]
    assert shown(lambda: Trajectory.load("nothere"), "nothere") == [*WRAPPER, "load"]
    assert shown(lambda: Trajectory().save(""), "must be text") == [*WRAPPER, "save"]
    (tmp_path / "full.lgt").mkdir()
    assert shown(lambda: Trajectory().save("full"), "cannot be written") == [*WRAPPER, "save"]
    gripper = Threads(site).gripper()

    def set_speed() -> None:
        gripper.motion_config.speed_mm_s = "fast"  # type: ignore[assignment]

    assert shown(set_speed, "must be a number") == [*WRAPPER, "__setattr__"]


def test_a_traceback_of_a_simulated_daemon_has_one_line_of_ours(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "can0.sock") as fake:
        fake.handlers["sim.fault"] = lambda request: request.fail("invalid_params", -32602)
        daemon = SimulatedDaemon("can0", str(fake.path))
        with pytest.raises(CommandError) as caught:
            daemon.fault("nonsense")
    assert frames_of(caught.value) == [*WRAPPER, "fault"]


MISUSED = {
    "open(speed=20)": "LiteGrip.open() has no argument 'speed': did you mean 'speed_mm_s'? it",
    "grasp(force=10)": "LiteGrip.grasp() has no argument 'force': did you mean 'force_n'? it",
    "goto(positoin_mm=9)": "did you mean 'position_mm'? it takes: position_mm, kp, kd, duration,",
    "goto(9, colour=1)": "LiteGrip.goto() has no argument 'colour': it takes: position_mm, ",
    "goto(9, speed=3)": "argument 'speed': use move_at_speed(target_mm, speed_mm_s); it takes: ",
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
    if wrong is CommandError:
        is_level = "level" in call or "soft'" in call or "hand')" in call
        assert ("level is" in str(caught.value), "why is" in str(caught.value)) == (
            is_level,
            not is_level,
        )


def test_an_object_with_wrong_arguments_is_not_made(kind: Kind) -> None:
    text = r"^LiteGrip\(\) has no argument 'chanel': did you mean 'channel'\? it takes: channel, "
    with pytest.raises(TypeError, match=text):
        kind.gripper(chanel="can1")
    with pytest.raises(TypeError, match=r"has no argument 'force': it takes: "):  # not 'voice'
        kind.gripper(force=3)


def test_a_wrong_call_of_a_class_names_it() -> None:
    told = r"^Trajectory\.load\(\): missing a required argument: 'name'; it takes: name$"
    with pytest.raises(TypeError, match=told):
        Trajectory.load()  # type: ignore[call-arg]


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


class Awaited:
    """What is called as an async function."""

    def __init__(self, function: Any) -> None:
        self._function = function

    async def __call__(self, *arguments: object) -> None:
        await self._function(*arguments)


@pytest.mark.parametrize("wrap", [lambda function: function, functools.partial, Awaited])
def test_an_async_callback_is_refused_before_anything_moves(
    daemon: Heard, kind: Kind, wrap: Callable[[Any], Any]
) -> None:
    async def report(_progress: object) -> None:
        raise AssertionError

    with kind.gripper() as gripper:
        gripper.enable()
        for move in (gripper.open, gripper.zero):
            with pytest.raises(CommandError, match=r"^progress is an async .* and not awaited$"):
                move(progress=wrap(report))
    assert not {"motion.open", "calibration.zero"} & set(daemon.methods())


def test_a_loop_in_asyncio_without_async_is_named(daemon: Heard, tasks: Asyncio) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            states: Any = gripper.states()
            with pytest.raises(TypeError, match=r"^this Subscription is for asyncio: `async for`$"):
                list(states)

    tasks.run(main())


@pytest.mark.parametrize(
    ("make", "kind"),
    [
        (lambda g: g.lease(), "Lease"),
        (lambda g: g.stream(), "SetpointStream"),
        (lambda g: g.manual_calibration(), "ManualCalibration"),
        (lambda g: g.states(), "Subscription"),
        (lambda g: g.events(), "EventSubscription"),
        (lambda g: g.latest(), "Latest"),
    ],
)
def test_a_block_in_asyncio_without_async_is_named(
    daemon: Heard, tasks: Asyncio, make: Callable[[aio.LiteGrip], Any], kind: str
) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            told = f"^this {kind} is for asyncio: `async with`$"
            with pytest.raises(TypeError, match=told) as caught, make(gripper):
                pass
            assert frames_of(caught.value)[-1:] == ["__enter__"]

    tasks.run(main())


def test_a_callback_with_wrong_arguments_is_named(site: Bench, daemon: Heard) -> None:
    told = r"^progress must be a function of a MoveProgress: too many positional arguments$"
    with Threads(site).gripper() as gripper:
        gripper.enable()
        with pytest.raises(CommandError, match=told) as caught:
            gripper.open(progress=lambda: None)  # type: ignore[misc,arg-type]
        assert frames_of(caught.value) == [*WRAPPER, "open"]
        assert "motion.open" not in daemon.methods()

        def wrong(_progress: object) -> None:
            len(3)  # type: ignore[arg-type]

        with pytest.raises(TypeError, match=r"^object of type 'int' has no len\(\)$"):
            gripper.open(progress=wrong)


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
