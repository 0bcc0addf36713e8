import asyncio
import grp
import os
import pwd
import socket
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegrip_client import GripperConfig, LiteGrip
from litegrip_client.aio import LiteGrip as AioLiteGrip
from litegrip_client.core import discovery, sockets
from litegrip_client.core.discovery import check_channel, socket_paths
from litegrip_client.core.sockets import stop_path
from litegrip_client.threads import blocking
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import CommandError, ConnectError
from tests.client.fake_daemon import FakeDaemon


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where all sockets, and the files of units, are looked for."""
    monkeypatch.setattr(sockets, "SYSTEM_DIRECTORY", str(tmp_path))
    monkeypatch.setattr(discovery, "ENABLED_DIRECTORY", str(tmp_path))
    monkeypatch.setattr(discovery, "UNIT_DIRECTORIES", (str(tmp_path),))
    return tmp_path


def test_where_the_daemon_is_looked_for() -> None:
    xdg = {"XDG_RUNTIME_DIR": "/xdg"}
    assert socket_paths("can1", None, xdg) == [
        "/run/litegripd/can1.sock",
        "/xdg/litegripd/can1.sock",
    ]
    assert socket_paths("can1", None, {})[1] == f"/run/user/{os.getuid()}/litegripd/can1.sock"
    assert socket_paths("can1", None, {"LITEGRIPD_SOCKET": "/s"} | xdg) == ["/s"]
    assert socket_paths("can1", "/p", {"LITEGRIPD_SOCKET": "/s"}) == ["/p"]


@pytest.mark.parametrize("channel", ["can0", "vcan-1", "a.b_c", "0", "-", "_", "x" * 64])
def test_channels(channel: str) -> None:
    assert check_channel(channel) == channel


@pytest.mark.parametrize(
    "channel",
    ["", ".", "..", ".can0", "../can0", "a/b", "can 0", "can0\n", "\0", "kän0", "x" * 65, 5, None],
)
def test_what_cannot_be_a_channel(channel: object) -> None:
    with pytest.raises(CommandError, match="cannot be a channel") as caught:
        check_channel(channel)  # type: ignore[arg-type]
    assert caught.value.reason == "invalid_params"


@pytest.mark.parametrize(("channel", "is_device"), [("/dev/ttyACM0", True), ("can 0", False)])
def test_the_path_of_a_device_is_told_where_it_belongs(channel: str, is_device: bool) -> None:
    with pytest.raises(CommandError) as caught:
        check_channel(channel)
    told = "; a device path is [bus] channel in the daemon's configuration"
    assert str(caught.value.hint).endswith(told) is is_device


@given(st.text(max_size=70))
def test_no_channel_leaves_the_directory(channel: str) -> None:
    try:
        paths = socket_paths(channel, None, {"XDG_RUNTIME_DIR": "/xdg"})
    except CommandError:
        return
    directories = ["/run/litegripd", "/xdg/litegripd"]
    if "." in channel:  # it may be a gripper of another machine, SITE.GRIPPER
        directories.append("/run/litegripd-portal")
    assert [str(Path(os.path.normpath(path)).parent) for path in paths] == directories


def test_a_gripper_of_another_machine_is_found_at_the_portals_sockets() -> None:
    paths = socket_paths("lab.left", None, {"XDG_RUNTIME_DIR": "/xdg"})
    assert paths[-1] == "/run/litegripd-portal/lab.left.sock"
    assert len(socket_paths("left", None, {"XDG_RUNTIME_DIR": "/xdg"})) == 2


def test_without_a_daemon_the_error_tells_what_was_tried_and_what_to_do(
    machine: Path,
) -> None:
    dead = machine / "can3.sock"
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(dead))
    with pytest.raises(ConnectError) as caught:
        connect("can3")
    own = f"{machine}/xdg/litegripd/can3.sock"
    assert caught.value.message == (
        f"no daemon can be reached for channel can3 ({dead}: refused: nobody listens; "
        f"{own}: missing)"
    )
    assert "start can3's with 'litegripd can3', or try without" in str(caught.value)
    assert "systemctl" not in str(caught.value)  # which has no such unit
    assert "litegripd can3 --simulate" in str(caught.value)
    assert GROUP_HINT not in str(caught.value)
    assert caught.value.data["tried"] == [str(dead), own]
    assert caught.value.reason == "no_daemon"


@pytest.mark.parametrize("kind", ["file", "folder"])
def test_where_no_socket_can_be_it_says_so_and_what_to_move(machine: Path, kind: str) -> None:
    blocked = machine / "can3.sock"
    blocked.mkdir() if kind == "folder" else blocked.write_text("mine")
    for path in (None, str(blocked)):
        with pytest.raises(ConnectError) as caught:
            connect("can3", path)
        why = f"{blocked}: not a socket, but a file or folder: nobody can listen there"
        assert why in caught.value.message
        assert "nobody listens" not in caught.value.message
        assert caught.value.data["hint"].startswith(f"move {blocked} away")


def test_what_no_daemon_can_listen_at_is_no_place_to_start_one(tmp_path: Path) -> None:
    """Each remedy is another one than to start the daemon there, which would end at once."""
    paths = {name: tmp_path / f"{name}.sock" for name in ("dangling", "loop", "datagrams", "file")}
    paths["dangling"].symlink_to(tmp_path / "nowhere")
    paths["loop"].symlink_to(paths["loop"])
    paths["file"].touch()
    long = tmp_path / ("x" * 150)
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as other:
        other.bind(str(paths["datagrams"]))
        for path, why, remedy in (
            (paths["dangling"], "a link to", "move"),
            (paths["loop"], "lead to one another", "move"),
            (paths["datagrams"], "another program", "move"),
            (paths["file"] / "can0.sock", "a file, no folder", "name a path"),
            (long, "too long: .* 107 bytes at most", "name a shorter path"),
        ):
            with pytest.raises(ConnectError, match=why) as caught:
                connect("can0", str(path))
            assert caught.value.data["hint"].startswith(remedy)


def test_the_socket_for_stops_is_no_place_to_connect(tmp_path: Path) -> None:
    """It takes all that comes for a stop, a greeting, too."""
    path = tmp_path / "can0.sock"
    with FakeDaemon(Path(stop_path(str(path)))) as stops:
        with pytest.raises(CommandError, match="is for stops alone"):
            LiteGrip("can0", socket_path=stops.path).connect()
        with pytest.raises(CommandError, match="is for stops alone") as caught:
            asyncio.run(AioLiteGrip("can0", socket_path=stops.path).connect())
        assert caught.value.data["hint"].endswith(f": {path}")
    assert stops.methods() == []


def test_a_channel_is_no_way_to_the_socket_for_stops(machine: Path) -> None:
    with (
        FakeDaemon(machine / "can0.stop.sock") as stops,
        pytest.raises(CommandError, match="is for stops alone"),
    ):
        connect("can0.stop")
    assert stops.methods() == []


def test_a_socket_that_is_named_is_of_no_known_unit(monkeypatch: pytest.MonkeyPatch) -> None:
    start = (
        "start its daemon: 'litegripd CHANNEL --socket /no/such.sock', without hardware with"
        " --simulate"
    )
    unset = "LITEGRIPD_SOCKET names that socket, whatever the channel: unset it, or "
    monkeypatch.setenv("LITEGRIPD_SOCKET", "/no/such.sock")
    for path, hint in (("/no/such.sock", start), (None, f"{unset}{start}")):
        with pytest.raises(ConnectError) as caught:
            connect("can0", path)
        assert caught.value.data["hint"] == hint


def test_a_daemon_that_systemd_should_run_is_looked_at_before_it_is_started_again(
    machine: Path,
) -> None:
    (machine / "litegripd@.service").touch()
    (machine / "litegripd@can3.service").symlink_to("/usr/lib/litegripd@.service")
    with pytest.raises(ConnectError, match=r"systemctl status litegripd@can3") as caught:
        connect("can3")
    assert "systemctl start" not in str(caught.value)
    with pytest.raises(ConnectError, match=r"systemctl start litegripd@can4"):
        connect("can4")


GROUP_HINT = "group litegrip"


def test_without_the_right_the_error_names_the_group_of_the_socket(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(path: str, timeout_s: float) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(blocking, "Connection", refuse)
    with pytest.raises(ConnectError, match="permission denied") as caught:
        connect("can0", "/somewhere")
    assert GROUP_HINT in str(caught.value)
    assert "start" not in caught.value.data["hint"]  # a daemon is there, of another user
    closed = tmp_path / "can0.sock"
    closed.touch()
    number = closed.stat().st_gid
    for group, told in (("robots", "only for the group robots"), ("root", GROUP_HINT)):
        found = grp.struct_group((group, "x", number, []))
        monkeypatch.setattr(grp, "getgrgid", {number: found}.__getitem__)
        monkeypatch.setattr(
            grp, "getgrnam", {"litegrip": grp.struct_group(("litegrip", "x", 1, []))}.__getitem__
        )
        with pytest.raises(ConnectError, match=told) as caught:
            connect("can0", str(closed))
        named = "robots" if group == "robots" else "litegrip"
        assert f"sudo usermod -aG {named} $USER" in str(caught.value)


@pytest.mark.parametrize(("first_person", "is_private"), [(0, True), (2**32, False)])
def test_nobody_is_sent_into_the_group_of_one_person(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, first_person: int, is_private: bool
) -> None:
    """A service's group has mostly its name, too: that one is for others to join."""

    def refuse(path: str, timeout_s: float) -> None:
        raise PermissionError(13, "Permission denied")

    closed = tmp_path / "can0.sock"
    closed.touch()
    owner = pwd.struct_passwd(("simon", "x", os.getuid(), os.getgid(), "", "/", "/"))
    monkeypatch.setattr(pwd, "getpwuid", lambda _uid: owner)
    own = grp.struct_group(("simon", "x", os.getgid(), []))
    monkeypatch.setattr(grp, "getgrgid", lambda _gid: own)
    monkeypatch.setattr(discovery, "FIRST_PERSON_UID", first_person)
    monkeypatch.setattr(blocking, "Connection", refuse)
    with pytest.raises(ConnectError) as caught:
        connect("can0", str(closed))
    asks = caught.value.hint == "ask simon, whose configuration opens it to others by [rpc] group"
    assert asks is is_private
    assert ("usermod -aG simon" in str(caught.value)) is not is_private
    assert ("denied: only for simon)" in caught.value.message) is is_private


def test_a_directory_that_refuses_is_what_the_error_names(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(path: str, timeout_s: float) -> None:
        raise PermissionError(13, "Permission denied")

    def enter(path: str, mode: int) -> bool:
        return path != str(closed)

    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    owner = pwd.getpwuid(os.getuid()).pw_name
    monkeypatch.setattr(blocking, "Connection", refuse)
    monkeypatch.setattr(os, "access", enter)
    with pytest.raises(ConnectError, match=f"its directory {closed} is only for {owner}") as caught:
        connect("can0", f"{closed}/x.sock")
    assert str(caught.value.hint).startswith(f"ask {owner} for a socket in a directory that you")
    assert "group" not in str(caught.value)
    closed.chmod(0o750)
    robots = grp.struct_group(("robots", "x", 1, []))
    monkeypatch.setattr(grp, "getgrgid", lambda _gid: robots)
    told = f"its directory {closed} is only for {owner} and the group robots"
    with pytest.raises(ConnectError, match=told) as caught:
        connect("can0", f"{closed}/x.sock")
    assert str(caught.value.hint).startswith("join the group robots ('sudo usermod -aG robots")


def test_nobody_is_sent_into_a_group_that_is_not_there(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def refuse(path: str, timeout_s: float) -> None:
        raise PermissionError(13, "Permission denied")

    closed = tmp_path / "can0.sock"
    closed.touch()
    root = grp.struct_group(("root", "x", closed.stat().st_gid, []))
    monkeypatch.setattr(grp, "getgrgid", {root.gr_gid: root}.__getitem__)
    monkeypatch.setattr(grp, "getgrnam", {}.__getitem__)
    monkeypatch.setattr(blocking, "Connection", refuse)
    with pytest.raises(ConnectError, match="denied: only for who started it") as caught:
        connect("can0", str(closed))
    assert caught.value.data["hint"] == "'litegripctl doctor' says what opens it to you"


def test_the_daemons_that_run_are_named_where_another_one_was_asked_for(
    machine: Path,
) -> None:
    (machine / "can8.sock").touch()
    with (
        FakeDaemon(machine / "can7.sock"),
        FakeDaemon(machine / "can7.stop.sock"),
        pytest.raises(
            ConnectError, match="\nrunning: can7; start left's with 'litegripd left'"
        ) as caught,
    ):
        connect("left")
    assert "can8" not in str(caught.value)


def test_a_name_that_comes_close_is_asked_for_whether_its_daemon_runs_or_not(
    machine: Path,
) -> None:
    (machine / "left.sock").touch()
    for typed in ("lef", "LEFT", "Left"):
        with pytest.raises(ConnectError, match=rf"\ndid you mean left\? start {typed}'s with"):
            connect(typed)


def test_the_other_one_of_numbered_grippers_is_not_asked_for(machine: Path) -> None:
    with (
        FakeDaemon(machine / "left1.sock"),
        FakeDaemon(machine / "lift2.sock"),
        pytest.raises(
            ConnectError, match=r"\ndid you mean lift2\? running: left1, lift2; start left2's"
        ),
    ):
        connect("left2")
    with FakeDaemon(machine / "arm1.sock"), pytest.raises(ConnectError) as caught:
        connect("arm2")
    assert caught.value.hint is not None
    assert caught.value.hint.startswith("running: arm1; start arm2's with 'litegripd arm2'")


def test_a_daemon_that_is_closed_to_this_user_is_named_as_that(
    machine: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (machine / "simx.sock").touch()
    monkeypatch.setattr(discovery, "_how", lambda path: "closed")
    told = r"running: simx, closed to this user \('litegripctl -c simx doctor' says what"
    with pytest.raises(ConnectError, match=told):
        connect("can3")


def test_the_channel_is_the_argument_or_the_environments_or_can0(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LITEGRIP_CHANNEL", "can5")
    for kind in (LiteGrip, AioLiteGrip):
        assert kind()._session.channel == "can5"
        assert kind("can0")._session.channel == "can0"
        assert kind(config=GripperConfig(channel="can6"))._session.channel == "can6"
        assert kind("can0", config=GripperConfig(channel="can6"))._session.channel == "can0"
    monkeypatch.setenv("LITEGRIP_CHANNEL", "../etc")
    with pytest.raises(CommandError, match="cannot be a channel"):
        LiteGrip()
    monkeypatch.delenv("LITEGRIP_CHANNEL")
    assert LiteGrip()._session.channel == "can0"


def test_a_daemon_of_the_user_is_found(machine: Path) -> None:
    (machine / "xdg/litegripd").mkdir(parents=True)
    with FakeDaemon(machine / "xdg/litegripd/can4.sock") as daemon, connect("can4") as connection:
        assert connection.socket_path == daemon.path
        assert connection.greet("test")["daemon"] == "litegripd"


@pytest.mark.parametrize("kind", [LiteGrip, AioLiteGrip])
def test_who_names_no_channel_is_told_how_to_choose_one_that_runs(
    machine: Path, monkeypatch: pytest.MonkeyPatch, kind: "type[LiteGrip] | type[AioLiteGrip]"
) -> None:
    async def connect(gripper: AioLiteGrip) -> None:
        await gripper.connect()

    def refused(channel: str | None = None) -> str:
        gripper = kind(channel)
        with pytest.raises(ConnectError) as caught:
            gripper.connect() if isinstance(gripper, LiteGrip) else asyncio.run(connect(gripper))
        return str(caught.value.hint)

    monkeypatch.delenv("LITEGRIP_CHANNEL", raising=False)
    with FakeDaemon(machine / "py8a.sock"), FakeDaemon(machine / "py8b.sock"):
        how = "(choose: LiteGrip('py8a'), or LITEGRIP_CHANNEL=py8a)"
        assert refused().startswith(f"running: py8a, py8b {how}; start can0's with ")
        assert refused("can0").startswith("running: py8a, py8b; start can0's with ")
        monkeypatch.setenv("LITEGRIP_CHANNEL", "can0")
        assert refused().startswith("running: py8a, py8b; start can0's with ")
