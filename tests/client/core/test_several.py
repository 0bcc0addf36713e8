"""Errors in a program with two grippers: each says which one it is about."""

import asyncio
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import litegrip_client
from litegrip_client import ConnectError, LiteGrip, LiteGripError, ParameterError, StoppedError, aio
from tests.client.fake_daemon import FakeDaemon
from tests.client.rig import Asyncio, Bench, Heard, Kind


@pytest.fixture
def left(site: Bench) -> Heard:
    daemon = Heard("left")
    site.add(daemon)
    return daemon


@pytest.fixture
def right(site: Bench) -> Heard:
    daemon = Heard("right")
    site.add(daemon)
    return daemon


@pytest.mark.usefixtures("left")
def test_an_error_beside_another_gripper_begins_with_its_channel(right: Heard, kind: Kind) -> None:
    right.client().result("stop")
    with kind.gripper("left") as one, kind.gripper("right") as other:
        with pytest.raises(StoppedError) as caught:
            other.open()
        with pytest.raises(ParameterError) as wrong:
            one.grasp(force_n="x")  # type: ignore[arg-type]
    assert caught.value.channel == "right"
    assert caught.value.message.startswith("a stop (hold) by ")
    assert str(caught.value).startswith("right: a stop (hold) by ")
    assert wrong.value.channel == "left"
    assert str(wrong.value) == f"left: {wrong.value.text}"


@pytest.mark.usefixtures("left")
def test_so_does_that_of_a_task_which_is_one_of_two(right: Heard, tasks: Asyncio) -> None:
    async def scene() -> None:
        async with aio.LiteGrip("left") as one, aio.LiteGrip("right") as other:
            await asyncio.gather(one.enable(), other.enable())
            right.client().result("stop")
            await asyncio.gather(one.open(), other.open())

    with pytest.raises(StoppedError) as caught:
        tasks.run(scene())
    assert (caught.value.channel, str(caught.value)[:14]) == ("right", "right: a stop ")


@pytest.mark.usefixtures("left", "right")
def test_grippers_that_connect_at_the_same_time_know_of_each_other(tasks: Asyncio) -> None:
    async def scene() -> None:
        one, other = aio.LiteGrip("left"), aio.LiteGrip("right")
        await asyncio.gather(one.connect(), other.connect())
        for gripper in (one, other):
            with pytest.raises(LiteGripError) as caught:
                await gripper.open()
            assert str(caught.value).startswith(f"{gripper.channel}: ")
            await gripper.disconnect()

    tasks.run(scene())


@pytest.mark.parametrize(
    "fail",
    [
        lambda gripper: gripper.stream().set_target(),
        lambda gripper: gripper.lease().renew(),
        lambda gripper: gripper.manual_calibration().mark_open(),
        lambda gripper: next(gripper.states(-1.0)),
        lambda gripper: gripper.goto(20.0),
    ],
    ids=["stream", "lease", "calibration", "states", "motion"],
)
def test_all_that_a_gripper_gives_out_knows_its_channel(
    gripper: LiteGrip, fail: Callable[[LiteGrip], Any]
) -> None:
    with pytest.raises(LiteGripError) as caught:
        fail(gripper)
    assert caught.value.channel == "can0"
    assert str(caught.value) == caught.value.text, "there is no other one"


@pytest.mark.usefixtures("left")
def test_a_lost_connection_is_named_by_what_reads_from_it(right: Heard, kind: Kind) -> None:
    one, other = kind.gripper("left"), kind.gripper("right")
    with one, other, other.states() as states, other.latest() as latest:
        next(states)
        latest.wait_newer()
        right.hang_up()
        with pytest.raises(ConnectError) as ended:
            list(states)
        with pytest.raises(ConnectError) as stale:
            print(latest.state)
    assert [caught.value.channel for caught in (ended, stale)] == ["right", "right"]


@pytest.mark.usefixtures("left")
def test_a_second_gripper_that_cannot_connect_is_named(kind: Kind) -> None:
    gone = kind.gripper("right")
    with kind.gripper("left"), pytest.raises(ConnectError) as caught:
        gone.connect()
    assert caught.value.channel == "right"
    assert str(caught.value).startswith("right: ")


@pytest.mark.usefixtures("left", "right")
def test_grippers_one_after_the_other_are_not_named(kind: Kind) -> None:
    """So it is in a test run: each test has a channel of its own."""
    grippers = [kind.gripper("left"), kind.gripper("right")]
    for gripper in grippers:
        with gripper, pytest.raises(LiteGripError) as caught:
            gripper.open()
        assert str(caught.value) == caught.value.text


@pytest.mark.usefixtures("left", "right")
def test_a_message_that_begins_with_the_channel_is_not_named_twice(kind: Kind) -> None:
    one, other = kind.gripper("left"), kind.gripper("right")
    with one, other, pytest.raises(LiteGripError) as caught:
        other.open()
    caught.value.message = "right: the motor could not be disabled"
    assert str(caught.value).startswith("right: the motor could not be")


def test_an_error_of_no_gripper_has_no_channel() -> None:
    assert LiteGripError("no").channel is None
    with pytest.raises(ParameterError) as caught:
        LiteGrip("../can0")
    assert caught.value.channel is None


SCRIPT = """
from litegrip_client import LiteGrip, LiteGripError
with LiteGrip() as gripper:
    try:
        gripper.open()
    except LiteGripError as error:
        print(error.channel)
"""


def test_errors_in_python_s_development_mode_have_it_as_well(tmp_path: Path) -> None:
    with FakeDaemon(tmp_path / "can0.sock") as daemon:
        daemon.handlers["motion.open"] = lambda request: request.fail("busy", -32011)
        path = str(Path(litegrip_client.__file__).parent.parent)
        done = subprocess.run(
            [sys.executable, "-X", "dev", "-c", SCRIPT],
            env={**os.environ, "LITEGRIPD_SOCKET": daemon.path, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            check=True,
        )
    assert done.stdout == "can0\n"
