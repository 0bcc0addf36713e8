"""Whose a channel is when somebody else has taken its name first."""

import contextlib
import grp
import os
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from litegripd.io import sockets
from litegripd.io.sockets import ChannelClaim, InUseError, lock_path
from tests.process.daemon_process import spawned

OUTSIDER = """
import os, socket, sys
if sys.argv[2] != "0":
    os.setgroups([]); os.setgid(int(sys.argv[2])); os.setuid(int(sys.argv[2]))
kept = socket.socket(socket.AF_UNIX)
kept.bind("\\0litegripd/virtual/" + sys.argv[1])
kept.listen()
print("ready", flush=True)
sys.stdin.read()
"""
NOBODY = 30001
as_root = pytest.mark.skipif(os.getuid() != 0, reason="only root can be another user, too")


@pytest.fixture
def run_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    directory = tmp_path / "run"
    monkeypatch.setattr(sockets, "RUN_DIRECTORY", directory)
    return directory


@pytest.fixture
def channel(tmp_path: Path) -> str:
    return f"{tmp_path.name}-{os.getpid()}"


@contextlib.contextmanager
def taken_by(uid: int, channel: str) -> Iterator[int]:
    """Let another process bind the channel's name; yield its pid."""
    with spawned(OUTSIDER, channel, str(uid), says="ready") as process:
        yield process.pid


@as_root
def test_an_outsider_who_has_the_name_keeps_no_daemon_from_its_channel(
    run_directory: Path, channel: str, caplog: pytest.LogCaptureFixture
) -> None:
    with taken_by(NOBODY, channel) as pid:
        claim = ChannelClaim("virtual", channel)
        assert f"pid {pid} of uid {NOBODY}" in caplog.text
        assert len(list(run_directory.iterdir())) == 1
        with pytest.raises(InUseError, match="one motor has one owner"):
            ChannelClaim("virtual", channel)
        claim.remove()
        claim.close()
        assert list(run_directory.iterdir()) == []
        ChannelClaim("virtual", channel).close()


@as_root
def test_without_the_lock_the_refusal_names_the_user(
    channel: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sockets, "RUN_DIRECTORY", Path("/proc/no/such"))
    with (
        taken_by(NOBODY, channel) as pid,
        pytest.raises(InUseError, match=rf"pid {pid} of uid {NOBODY}: one motor"),
    ):
        ChannelClaim("virtual", channel)


@pytest.mark.usefixtures("run_directory")
def test_the_name_of_our_own_user_is_respected(channel: str) -> None:
    with (
        own(channel),
        pytest.raises(InUseError, match=rf"of uid {os.getuid()}: one motor has one owner"),
    ):
        ChannelClaim("virtual", channel)


@contextlib.contextmanager
def own(channel: str) -> Iterator[None]:
    with socket.socket(socket.AF_UNIX) as kept:
        kept.bind(f"\0litegripd/virtual/{channel}")
        kept.listen()
        yield


def test_a_lock_is_handed_over_with_the_sockets(run_directory: Path, channel: str) -> None:
    path = run_directory.parent / "a.sock"
    before = sockets.occupy("virtual", channel, path, None)
    inherited = [os.dup(descriptor) for descriptor in before.descriptors]
    assert len(inherited) == 4
    after = sockets.take_over("virtual", channel, path, inherited)
    for place in (before.claim, before.stops, before.requests):
        place.close()
    with pytest.raises(InUseError, match="one motor has one owner"):
        ChannelClaim("virtual", channel)
    after.remove()
    for place in (after.claim, after.stops, after.requests):
        place.close()
    assert list(run_directory.iterdir()) == []


def test_a_place_that_cannot_be_had_leaves_no_lock(run_directory: Path, channel: str) -> None:
    path = run_directory.parent / "a.sock"
    path.write_text("", encoding="utf-8")
    with pytest.raises(InUseError, match="not a socket"):
        sockets.occupy("virtual", channel, path, None)
    assert list(run_directory.iterdir()) == []


def test_a_file_that_nobody_locks_is_no_obstacle(run_directory: Path, channel: str) -> None:
    run_directory.mkdir()
    lock_path(f"virtual/{channel}").write_text("", encoding="utf-8")
    claim = ChannelClaim("virtual", channel)
    assert len(claim.descriptors) == 1
    claim.close()


def test_no_socket_has_the_name_of_a_stop_socket(tmp_path: Path, channel: str) -> None:
    with pytest.raises(InUseError, match="kept for stop sockets"):
        sockets.occupy("virtual", channel, tmp_path / "can0.stop.sock", None)


@as_root
def test_a_link_in_the_sockets_place_gives_no_other_file_away(tmp_path: Path) -> None:
    victim, link = tmp_path / "victim", tmp_path / "a.sock"
    victim.write_text("", encoding="utf-8")
    link.symlink_to(victim)
    other = next(group for group in grp.getgrall() if group.gr_gid != victim.stat().st_gid)
    sockets._give_to_group(link, other.gr_name)
    assert victim.stat().st_gid == os.getgid()
    assert link.lstat().st_gid == other.gr_gid
