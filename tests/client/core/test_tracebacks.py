"""What a traceback shows: the user's line, and what a callback of the user's has called."""

import traceback
from pathlib import Path

import pytest

import litegrip_client
from litegrip_client import CommandError, ConnectError, LiteGripError
from tests.client.rig import Bench, Heard, Threads


def frames_of(error: BaseException) -> list[str]:
    """Return the functions in a traceback that are this package's, behind this file's."""
    frames = traceback.extract_tb(error.__traceback__)
    assert frames[0].filename == __file__
    ours = str(Path(litegrip_client.__file__).parent)
    return [frame.name for frame in frames if frame.filename.startswith(ours)]


def test_a_traceback_ends_at_the_users_line(site: Bench, daemon: Heard) -> None:
    with Threads(site).gripper() as gripper:
        with pytest.raises(LiteGripError) as refused:
            gripper.open()
        assert frames_of(refused.value) == ["open", "complete"]
        with pytest.raises(LiteGripError) as wrong:
            gripper.grasp(force_n="x")  # type: ignore[arg-type]
        assert frames_of(wrong.value) == ["grasp", "complete"]
    with pytest.raises(ConnectError) as missing:
        Threads(site).gripper("can1").connect()
    assert frames_of(missing.value) == ["connect", "complete"]
    with pytest.raises(ConnectError) as missing, Threads(site).gripper("can1"):
        pass
    assert frames_of(missing.value) == ["__enter__"]


def test_a_traceback_keeps_what_a_callback_has_called(site: Bench, daemon: Heard) -> None:
    def report(_progress: object) -> None:
        raise CommandError("mine", reason="invalid_params")

    with Threads(site).gripper() as gripper:
        gripper.enable()
        with pytest.raises(CommandError) as caught:
            gripper.open(progress=report)
    names = [frame.name for frame in traceback.extract_tb(caught.value.__traceback__)]
    assert names[-1] == "report"
