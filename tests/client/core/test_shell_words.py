"""Commands of litegripctl in errors of a Python program: each is for the program's own gripper."""

import shlex

import pytest

from litegrip_client import BusyError, CommandError, ConnectError, LiteGripError
from tests.client.rig import Bench, Heard, Kind, Refuse

CANCEL = "in a shell: litegripctl{} cancel; "


@pytest.fixture
def left(site: Bench) -> Heard:
    daemon = Heard("left")
    site.add(daemon)
    return daemon


def busy(kind: Kind, daemon: Heard, *arguments: str, **settings: str) -> str:
    """Return what a program is told whose gripper another client moves."""
    other = daemon.client()
    other.result("motor.enable")
    other.result("motion.open", wait=False)
    with kind.gripper(*arguments, **settings) as gripper, pytest.raises(BusyError) as caught:
        gripper.close()
    return str(caught.value)


def test_a_command_names_the_channel(left: Heard, kind: Kind) -> None:
    assert CANCEL.format(" -c left") in busy(kind, left, "left")


def test_that_of_the_default_needs_no_name(daemon: Heard, kind: Kind) -> None:
    assert CANCEL.format("") in busy(kind, daemon, "can0")


def test_it_has_one_where_a_shell_may_have_another_default(
    daemon: Heard, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIP_CHANNEL", "left")
    assert CANCEL.format(" -c can0") in busy(kind, daemon, "can0")


def test_a_socket_that_was_given_is_named(
    site: Bench, left: Heard, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = "/run/litegripd/left.sock"
    told = CANCEL.format(f" --socket {shlex.quote(path)}")
    assert told in busy(kind, left, "left", socket_path=path)
    monkeypatch.setenv("LITEGRIPD_SOCKET", path)
    site.run(9.0)
    assert told in busy(kind, left, "left")


def test_so_do_the_texts_of_this_side(left: Heard, kind: Kind) -> None:
    left.instead["motion.hold"] = Refuse("unknown_method", -32601, "there is no motion.hold")
    with kind.gripper("left") as gripper:
        with pytest.raises(CommandError) as older:
            gripper.hold()
        left.freeze()
        with pytest.raises(ConnectError) as silent:
            gripper.get_state()
        left.thaw()
    assert older.value.hint is not None
    assert older.value.hint.endswith("litegripctl -c left restart --hold")
    assert silent.value.hint == "see what is wrong: litegripctl -c left doctor"


def test_so_does_a_motion_whose_daemon_falls_silent(site: Bench, left: Heard, kind: Kind) -> None:
    with kind.gripper("left") as gripper:
        gripper.enable()
        site.after(0.3, left.freeze)
        with pytest.raises(ConnectError) as caught:
            gripper.close(speed_mm_s=10.0)
        left.thaw()
    assert caught.value.hint == "see what is wrong: litegripctl -c left doctor"


def test_words_of_the_programs_own_stay(left: Heard, kind: Kind) -> None:
    said = {"job.cancel": "litegripctl cancel"}
    with kind.gripper("left", voice=lambda method, *_: said.get(method)) as gripper:
        other = left.client()
        other.result("motor.enable")
        other.result("motion.open", wait=False)
        with pytest.raises(LiteGripError, match="litegripctl cancel"):
            gripper.close()
