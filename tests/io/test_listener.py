"""The socket's file and the claim of a channel: what is replaced, what is refused, and why."""

import contextlib
import grp
import logging
import os
import select
import socket
import stat
import subprocess
from pathlib import Path

import pytest

from litegripd.io.sockets import (
    ChannelClaim,
    InUseError,
    listen,
    listen_on_all,
    runtime_directory,
)
from tests.process.daemon_process import spawned

HOLDER = """
import socket, sys
from litegripd.io.sockets import ChannelClaim, listen
from pathlib import Path
kept = ChannelClaim("virtual", sys.argv[1]), listen(Path(sys.argv[2]), None)
print("ready", flush=True)
sys.stdin.read()
"""


def holder(channel: str, path: Path) -> contextlib.AbstractContextManager["subprocess.Popen[str]"]:
    """Return a process that owns a channel and a socket, to be run until it is killed."""
    return spawned(HOLDER, channel, str(path), says="ready")


def name(tmp_path: Path) -> str:
    return f"{tmp_path.name}-{os.getpid()}"


def test_the_socket_is_for_user_and_group_alone(tmp_path: Path) -> None:
    path = tmp_path / "new" / "a.sock"
    with listen(path, None):
        status = path.stat()
        assert stat.S_ISSOCK(status.st_mode)
        assert stat.S_IMODE(status.st_mode) == 0o660
        with socket.socket(socket.AF_UNIX) as client:
            client.connect(str(path))


def test_the_umask_is_left_as_it_was(tmp_path: Path) -> None:
    before = os.umask(0o027)
    try:
        listen(tmp_path / "a.sock", None).close()
        assert os.umask(0o027) == 0o027
    finally:
        os.umask(before)


def test_the_socket_is_given_to_the_group(tmp_path: Path) -> None:
    group = grp.getgrgid(os.getgid()).gr_name
    path = tmp_path / "a.sock"
    with listen(path, group):
        assert path.stat().st_gid == os.getgid()


def test_a_group_that_does_not_exist_is_said_and_survived(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getuid", lambda: 0)
    with listen(tmp_path / "a.sock", "no-such-group"):
        group = grp.getgrgid(os.getgid()).gr_name
        assert "there is no group 'no-such-group'" in caplog.text
        assert f"stays with group {group}" in caplog.text


def test_a_user_who_runs_a_daemon_of_his_own_needs_no_group(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(os, "getuid", lambda: 1000)
    with listen(tmp_path / "a.sock", "no-such-group"):
        assert [record for record in caplog.records if record.levelno >= logging.INFO] == []


def test_a_stale_socket_is_replaced(tmp_path: Path) -> None:
    path = tmp_path / "a.sock"
    listen(path, None).close()
    assert path.exists()
    with listen(path, None), socket.socket(socket.AF_UNIX) as client:
        client.connect(str(path))


def test_a_live_socket_is_refused_with_the_pid_of_its_owner(tmp_path: Path) -> None:
    path = tmp_path / "a.sock"
    with holder(name(tmp_path), path) as process:
        with pytest.raises(InUseError, match=rf"pid {process.pid} of uid {os.getuid()} listens on"):
            listen(path, None)
        assert path.exists()


def test_another_kind_of_socket_is_not_taken_for_stale(tmp_path: Path) -> None:
    path = tmp_path / "a.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.bind(str(path))
        with pytest.raises(InUseError, match="cannot be made"):
            listen(path, None)
        assert path.exists()


def test_a_socket_with_a_full_backlog_is_in_use(tmp_path: Path) -> None:
    path = tmp_path / "a.sock"
    with contextlib.ExitStack() as stack:
        owner = stack.enter_context(socket.socket(socket.AF_UNIX))
        owner.bind(str(path))
        owner.listen(0)
        waiting = stack.enter_context(socket.socket(socket.AF_UNIX))
        waiting.connect(str(path))
        with pytest.raises(InUseError, match="unknown pid"):
            listen(path, None)


def test_what_is_not_a_socket_is_left_alone(tmp_path: Path) -> None:
    path = tmp_path / "a.sock"
    path.write_text("precious", encoding="utf-8")
    with pytest.raises(InUseError, match="not a socket"):
        listen(path, None)
    assert path.read_text(encoding="utf-8") == "precious"


@pytest.mark.parametrize("bad", ["x" * 120, "file/a.sock", "a\0b", "\udcff" * 60])
def test_an_unusable_path_is_refused_with_the_reason(tmp_path: Path, bad: str) -> None:
    (tmp_path / "file").touch()
    with pytest.raises(InUseError, match="cannot be made"):
        listen(tmp_path / bad, None)


def test_where_one_socket_cannot_be_made_none_is(tmp_path: Path) -> None:
    first, second, taken = (tmp_path / name for name in ("a.sock", "b.sock", "c.sock"))
    taken.touch()
    with pytest.raises(InUseError, match=r"c\.sock exists and is not a socket"):
        listen_on_all((first, second, taken), None)
    assert list(tmp_path.iterdir()) == [taken]
    taken.unlink()
    with contextlib.ExitStack() as stack:
        for listener in listen_on_all((first, second, taken), None):
            stack.enter_context(listener)
        assert all(stat.S_ISSOCK(path.stat().st_mode) for path in (first, second, taken))


def test_a_channel_has_one_owner_whose_pid_is_told(tmp_path: Path) -> None:
    channel = name(tmp_path)
    with holder(channel, tmp_path / "a.sock") as process:
        with pytest.raises(InUseError, match=rf"owned by the daemon with pid {process.pid}"):
            ChannelClaim("virtual", channel)
        ChannelClaim("virtual", channel + "x").close()
        ChannelClaim("socketcan", channel).close()
        process.kill()
        process.wait()
        ChannelClaim("virtual", channel).close()


def test_a_closed_claim_frees_the_channel(tmp_path: Path) -> None:
    for _ in range(2):
        ChannelClaim("virtual", name(tmp_path)).close()


def test_adapters_that_have_changed_their_device_files_keep_nobody_from_his_own(
    tmp_path: Path,
) -> None:
    """Two are unplugged, and plugged in again in another order; then one daemon starts again."""
    device, left, right = tmp_path / "ttyACM0", tmp_path / "left-id", tmp_path / "right-id"
    device.touch()
    left.symlink_to(device)
    claim = ChannelClaim("slcan", str(left))
    try:
        left.unlink()
        right.symlink_to(device)
        ChannelClaim("slcan", str(right)).close()
        with pytest.raises(InUseError, match=f"pid {os.getpid()}"):
            ChannelClaim("slcan", str(left))
    finally:
        claim.close()


def test_a_very_long_channel_can_be_claimed_once(tmp_path: Path) -> None:
    long = "socket://" + "h" * 200 + name(tmp_path)
    claim = ChannelClaim("slcan", long)
    try:
        with pytest.raises(InUseError):
            ChannelClaim("slcan", long)
        ChannelClaim("slcan", long + "x").close()
    finally:
        claim.close()


def test_who_asks_for_the_owner_is_let_go(tmp_path: Path) -> None:
    claim = ChannelClaim("virtual", name(tmp_path))
    try:
        claim.on_event(select.EPOLLIN)  # nobody asks
        with socket.socket(socket.AF_UNIX) as asker:
            asker.connect(f"\0litegripd/virtual/{name(tmp_path)}")
            assert select.select([claim.fileno()], [], [], 20.0)[0]
            claim.on_event(select.EPOLLIN)
            asker.settimeout(20.0)
            assert asker.recv(1) == b""
    finally:
        claim.close()


def test_the_users_own_directory_is_the_second_choice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    usable: set[str] = {str(tmp_path)}
    monkeypatch.setattr(os, "access", lambda path, _mode: str(path) in usable)
    assert runtime_directory() == tmp_path / "litegripd"
    usable.add("/run")
    assert runtime_directory() == Path("/run/litegripd")
    usable.clear()
    with pytest.raises(InUseError, match="--socket, or set XDG_RUNTIME_DIR"):
        runtime_directory()
