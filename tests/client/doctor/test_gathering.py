"""What is asked of the system: iproute2, the kernel's files, devices, users, sockets."""

import grp
import json
import os
import pwd
import socket
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NoReturn

import pytest

from litegrip_client.core import discovery
from litegrip_client.ctl.doctor import daemon_checks, gather
from litegrip_client.ctl.doctor.facts import Configuration, Device, Socket, System
from litegrip_client.socketcan import link as can_link
from litegrip_client.socketcan.link import Link
from tests.client.doctor.conftest import Programs
from tests.client.doctor.known import LINKS, link


@pytest.fixture
def net(tmp_path: Path) -> Path:
    """Return a /sys/class/net with a USB adapter, an interface without driver, and no CAN one."""
    usb = tmp_path / "devices" / "usb1"
    (usb / "1-1.0").mkdir(parents=True)
    (usb / "product").write_text("candleLight USB to CAN adapter\n", encoding="utf-8")
    (tmp_path / "drivers" / "gs_usb").mkdir(parents=True)
    (usb / "1-1.0" / "driver").symlink_to(tmp_path / "drivers" / "gs_usb")
    root = tmp_path / "net"
    for number, (name, kind) in enumerate((("can0", "280"), ("can1", "280"), ("eth0", "1")), 3):
        (root / name).mkdir(parents=True)
        (root / name / "type").write_text(f"{kind}\n", encoding="ascii")
        (root / name / "flags").write_text("0x40081\n", encoding="ascii")
        (root / name / "tx_queue_len").write_text("10\n", encoding="ascii")
        (root / name / "ifindex").write_text(f"{number}\n", encoding="ascii")
    (root / "can0" / "device").symlink_to(usb / "1-1.0")
    return root


def test_iproute2_is_asked_for_one_link(net: Path, programs: Programs) -> None:
    expected = "-details -statistics -json link show can0"
    answer = (LINKS / "healthy.json").read_text(encoding="utf-8")
    programs.says("ip", f"[ \"$*\" = '{expected}' ] && [ $LC_ALL = C ] && echo '{answer}'")
    assert gather.system("socketcan", "can0", net) == System(
        link("healthy"), None, ("can0", "can1"), "gs_usb", "candleLight USB to CAN adapter"
    )


def rename_can0(net: Path, programs: Programs) -> None:
    """Rename can0 to gripper0, in the kernel's files and in what iproute2 says."""
    (net / "can0").rename(net / "gripper0")
    links = json.loads((LINKS / "healthy.json").read_text(encoding="utf-8"))
    answer = json.dumps([{**links[0], "ifname": "gripper0", "ifindex": 3}])
    programs.says(
        "ip",
        f'[ "$5" = show ] && [ "$6" = gripper0 ] && echo \'{answer}\' && exit 0\n'
        f"echo 'Device \"'$6'\" does not exist.' >&2; exit 1",
    )


def test_an_interface_that_is_renamed_is_found_by_its_number(net: Path, programs: Programs) -> None:
    rename_can0(net, programs)
    asked = gather.system("socketcan", "can0", net, held_index=3)
    assert asked.renamed_from == "can0"
    assert asked.link is not None
    assert (asked.link.name, asked.link.index, asked.link.is_up) == ("gripper0", 3, True)
    assert asked.driver == "gs_usb"
    for held_index in (None, 99):  # one that is gone
        asked = gather.system("socketcan", "can0", net, held_index=held_index)
        assert (asked.renamed_from, asked.link) == (None, None)


@pytest.mark.parametrize(
    ("renames", "renamed_from", "name"),
    [
        ([], None, "can0"),
        # Another interface under the old name is not taken for the daemon's.
        ([("can0", "gripper0"), ("can1", "can0")], "can0", "gripper0"),
    ],
)
@pytest.mark.usefixtures("programs")  # without iproute2: the kernel's files tell
def test_what_has_the_name_is_the_daemons_only_with_its_number(
    net: Path, renames: list[tuple[str, str]], renamed_from: str | None, name: str
) -> None:
    for before, after in renames:
        (net / before).rename(net / after)
    asked = gather.system("socketcan", "can0", net, held_index=3)
    assert (asked.renamed_from, asked.link and asked.link.name) == (renamed_from, name)


def test_whether_systemd_has_the_unit_and_should_run_the_daemon_is_asked(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name, value in (
        ("discovery.UNIT_DIRECTORIES", (str(tmp_path / "a"), str(tmp_path))),
        ("discovery.ENABLED_DIRECTORY", str(tmp_path)),
        ("sockets.SYSTEM_DIRECTORY", str(tmp_path)),
    ):
        monkeypatch.setattr(f"litegrip_client.core.{name}", value)

    def found(channel: str) -> tuple[bool, bool]:
        facts = gather.gather(channel, None, channel_chosen=True)
        return facts.is_unit_installed, facts.is_unit_enabled

    (tmp_path / "litegripd@can3.service").symlink_to("/usr/lib/litegripd@.service")
    assert (found("can3"), found("can4")) == ((False, True), (False, False))
    (tmp_path / "litegripd@.service").touch()
    assert (found("can3"), found("can4")) == ((True, True), (True, False))


CONTENT = {"bus": {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1_000_000}}


def test_litegripd_is_asked_what_a_configuration_says(directory: Path, programs: Programs) -> None:
    own, common = directory / "can0.toml", directory / "litegripd.toml"
    for channel, path in (("can0", own), ("can1", common)):
        assert gather.configuration_file(channel) is None
        path.touch()
        expected = f"{channel} --config {path} --check"
        said = json.dumps(CONTENT)
        programs.says("litegripd", f"[ \"$*\" = '{expected}' ] && echo '{said}'")
        assert gather.configuration_file(channel) == Configuration(str(path), content=CONTENT)


@pytest.fixture
def own(directory: Path) -> str:
    """Return the path of can0's configuration."""
    path = directory / "can0.toml"
    path.write_text("[bus]\n", encoding="utf-8")
    return str(path)


def test_a_configuration_that_is_wrong(own: str, programs: Programs) -> None:
    programs.says("litegripd", "echo 'litegripd: x.toml: [bus] baud is unknown' >&2; exit 2")
    wrong = Configuration(own, error="x.toml: [bus] baud is unknown")
    assert gather.configuration_file("can0") == wrong


def test_a_configuration_is_known_though_the_calibration_that_it_names_is_wrong(
    own: str, programs: Programs
) -> None:
    content = {**CONTENT, "calibration": {"file": "/m.json", "problem": "no calibration: x"}}
    said = json.dumps(content)
    programs.says("litegripd", f"echo '{said}'; echo 'litegripd: x' >&2; exit 2")
    assert gather.configuration_file("can0") == Configuration(own, content=content)


@pytest.mark.parametrize(
    ("script", "why"),
    [
        (None, "the program litegripd is not found here"),
        ("echo 'usage: litegripd' >&2; exit 2", "ended with 2: usage: litegripd"),
        ("echo 'litegripd: it may not be seen' >&2; exit 3", "ended with 3: litegripd: it may not"),
        ("exit 0", "ended with 0: no word"),
        ("read line < /dev/zero", "cannot be run"),
    ],
)
def test_a_configuration_that_cannot_be_checked_is_not_called_wrong(
    own: str, programs: Programs, script: str | None, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "CHECK_WITHIN_S", 0.05 if why == "cannot be run" else 9)
    if script is not None:
        programs.says("litegripd", script)
    found = gather.configuration_file("can0")
    assert found is not None
    assert (found.content, found.error) == (None, None)
    assert why in str(found.unchecked)


def test_a_configuration_that_this_user_may_not_read(
    own: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)
    closed = Configuration(own, unchecked="this user may not read it")
    assert gather.configuration_file("can0") == closed


def test_root_has_a_configuration_read_as_the_user_that_the_daemons_run_as(
    own: str, programs: Programs, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Root may read every file."""
    asked: dict[str, object] = {}

    def run(command: list[str], **options: object) -> subprocess.CompletedProcess[bytes]:
        asked.update(options)
        told = b"litegripd: can0.toml: cannot be read: Permission denied"
        return subprocess.CompletedProcess(command, 2, b"", told)

    monkeypatch.setattr("subprocess.run", run)
    monkeypatch.setattr("os.getuid", lambda: 0)
    monkeypatch.setattr("os.getgrouplist", lambda name, gid: [gid, 20])
    programs.says("litegripd", "exit 0")
    entry = pwd.struct_passwd(("litegrip", "x", 991, 992, "", "/", ""))
    monkeypatch.setattr("pwd.getpwnam", {"litegrip": entry}.__getitem__)
    found = gather.configuration_file("can0")
    why = "can0.toml: cannot be read: Permission denied"
    assert found == Configuration(own, error=why, as_user="litegrip")
    assert (asked["user"], asked["group"], asked["extra_groups"]) == (991, 992, [992, 20])
    for uid, users in ((0, {}), (1000, {"litegrip": entry})):  # not installed; not root
        asked.clear()
        monkeypatch.setattr("os.getuid", lambda uid=uid: uid)
        monkeypatch.setattr("pwd.getpwnam", users.__getitem__)
        found = gather.configuration_file("can0")
        assert found is not None
        assert (found.as_user, "user" in asked) == (None, False)


def test_whether_there_is_a_can_interface_is_asked(
    net: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "NET", net)
    assert [gather.is_can(name) for name in ("can0", "eth0", "can9")] == [True, False, False]


def test_a_link_that_there_is_not(net: Path, programs: Programs) -> None:
    programs.says("ip", "echo 'Device \"can9\" does not exist.' >&2; exit 1")
    assert gather.system("socketcan", "can9", net) == System(None, None, ("can0", "can1"))


@pytest.mark.parametrize(
    ("script", "problem"),
    [
        (None, "ip (iproute2) is not installed"),
        ("echo 'ip: invalid option' >&2; exit 2", "ip ended with 2: ip: invalid option"),
        ("exit 3", "ip ended with 3: no word"),
        ("echo '2: can0: <NOARP,UP>'", "ip gives no JSON: it is not iproute2's, or older"),
    ],
)
def test_without_iproute2_the_kernels_files_tell(
    net: Path, programs: Programs, script: str | None, problem: str
) -> None:
    if script is not None:
        programs.says("ip", script)
    found = gather.system("socketcan", "can1", net)
    assert found.link == Link("can1", True, True, queue_frames=10, index=4)
    assert problem in str(found.ip_problem)
    assert (found.driver, found.adapter) == (None, None)
    assert gather.system("socketcan", "can9", net).link is None


def test_an_iproute2_that_hangs_is_not_waited_for(
    net: Path, programs: Programs, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_link, "IP_WITHIN_S", 0.05)
    programs.says("ip", "read line < /dev/zero")
    assert "cannot be run" in str(gather.system("socketcan", "can1", net).ip_problem)


def test_a_machine_without_can(tmp_path: Path, programs: Programs) -> None:
    problem = "ip (iproute2) is not installed"
    assert gather.system("socketcan", "can0", tmp_path / "none") == System(None, problem)


def test_the_simulator_has_no_adapter(programs: Programs) -> None:
    assert gather.system("litegrip_sim", "sim0") == System()


def device(path: str, root: Path = Path("/")) -> Device:
    """Return what is found of an adapter's file."""
    found = gather.system("slcan", path, root=root).device
    assert found is not None
    return found


@pytest.fixture
def port() -> Iterator[str]:
    """Return the path of a terminal that is there."""
    controller, terminal = os.openpty()
    yield os.ttyname(terminal)
    os.close(controller)
    os.close(terminal)


def test_the_file_of_an_adapter(tmp_path: Path, port: str) -> None:
    found = device(f"{port}@115200")
    assert (found.path, found.is_there, found.is_character_device) == (port, True, True)
    assert found.is_accessible
    missing = tmp_path / "ttyACM7"
    assert device(str(missing)) == Device(str(missing), False)
    missing.touch()
    found = device(str(missing))
    assert (found.is_there, found.is_character_device) == (True, False)
    assert gather.system("pcan", "PCAN_USBBUS1").device is None


def test_who_else_may_open_a_port_and_whether_a_rule_keeps_them_off(
    tmp_path: Path, port: str
) -> None:
    def found() -> tuple[tuple[str, ...], bool]:
        told = device(port, tmp_path)
        return told.probers, told.is_left_alone

    assert found() == ((), False)
    (tmp_path / "usr/sbin").mkdir(parents=True)
    (tmp_path / "usr/sbin/ModemManager").touch()
    assert found() == (("ModemManager",), False)
    number = os.stat(port).st_rdev  # noqa: PTH116 - a path of the terminal
    notes = tmp_path / "run/udev/data"
    notes.mkdir(parents=True)
    noted = notes / f"c{os.major(number)}:{os.minor(number)}"
    noted.write_text("S:serial/by-id/x\nE:ID_MM_CANDIDATE=1\n", encoding="utf-8")
    assert found() == (("ModemManager",), False)
    noted.write_text("E:ID_MM_CANDIDATE=1\nE:ID_MM_DEVICE_IGNORE=1\n", encoding="utf-8")
    assert found() == (("ModemManager",), True)


def test_a_ports_lasting_name_and_the_other_ports_are_found(tmp_path: Path) -> None:
    (tmp_path / "dev/serial/by-id").mkdir(parents=True)
    for name, port in (("ttyACM0", "/dev/null"), ("ttyACM1", "/dev/zero")):
        (tmp_path / "dev" / name).symlink_to(port)
        (tmp_path / f"dev/serial/by-id/usb-{name}").symlink_to(f"../../{name}")
    lasting = f"{tmp_path}/dev/serial/by-id/usb-ttyACM0"
    found = device(str(tmp_path / "dev/ttyACM0"), tmp_path)
    assert (found.lasting_path, found.other_ports) == (lasting, 1)
    found = device(f"{lasting}@115200", tmp_path)
    assert (found.lasting_path, found.other_ports) == (None, 1)


def test_the_user_and_a_group() -> None:
    entry = pwd.getpwuid(os.getuid())
    own = grp.getgrgid(os.getgid()).gr_name
    found = gather.user(own)
    assert (found.name, found.uid, found.group) == (entry.pw_name, os.getuid(), own)
    assert (found.group_exists, found.is_member, found.has_group) == (True, True, True)
    found = gather.user("no-such-group-7")
    assert (found.group_exists, found.is_member, found.has_group) == (False, False, False)


def test_a_group_of_which_this_session_does_not_know(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grp.getgrnam", lambda name: type("G", (), {"gr_gid": 4321}))
    monkeypatch.setattr("os.getgrouplist", lambda name, gid: [gid, 4321])
    found = gather.user("litegrip")
    assert (found.is_member, found.has_group) == (True, False)
    monkeypatch.setattr("os.getgroups", lambda: [4321])
    assert gather.user("litegrip").has_group


def test_a_user_without_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.getuid", lambda: 54321)
    assert gather.user("no-such-group-7").name == "54321"


def test_sockets_are_looked_at_and_not_connected_to(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "can0.sock"
    assert gather.sockets([str(path)]) == ()
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        (tmp_path / "can0.stop.sock").symlink_to(path)
        found = gather.sockets([str(path)])
        assert found == (
            Socket(str(path), True, os.getuid()),
            Socket(str(tmp_path / "can0.stop.sock"), True, os.getuid()),
        )
        monkeypatch.setattr("os.access", lambda path, mode: False)
        assert [one.is_accessible for one in gather.sockets([str(path)])] == [False, False]


@pytest.mark.parametrize("kind", ["file", "folder", "within a file", "loop", "too long"])
def test_what_is_no_socket_is_closed_to_nobody(tmp_path: Path, kind: str) -> None:
    path = tmp_path / "can0.sock"
    if kind == "folder":
        path.mkdir()
    elif kind == "loop":
        path.symlink_to(path)
    else:
        path.touch()
    names = {"within a file": path / "can0.sock", "too long": tmp_path / ("x" * 300)}
    where = str(names.get(kind, path))
    assert gather.sockets([where]) == ()
    found = gather.gather("can0", where, channel_chosen=False)
    assert (found.daemon, found.sockets) == (None, ())
    assert str(found.blocked).startswith("name a " if kind in names else f"move {path} away")
    finding = daemon_checks.daemon(found)
    assert finding is not None
    assert str(finding.advice).startswith(str(found.blocked))


def test_a_folder_that_is_closed_to_this_user(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def closed(_path: Path) -> os.stat_result:
        raise PermissionError

    monkeypatch.setattr(Path, "stat", closed)
    found = gather.sockets([str(tmp_path / "can0.sock")])
    assert [one.is_accessible for one in found] == [False, False]


@pytest.mark.parametrize("name", ["can0.toml.txt", "CAN0.toml", "can0.conf", "can0.toml/"])
def test_a_file_with_another_name_than_a_daemon_reads_is_found(directory: Path, name: str) -> None:
    def found(channel: str) -> str | None:
        return gather.gather(channel, None, channel_chosen=True).misnamed

    assert found("can0") is None
    path = directory / name
    path.mkdir() if name.endswith("/") else path.touch()
    assert (found("can0"), found("can1")) == (str(path), None)


def test_a_socket_that_does_not_answer_names_its_group_itself(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "can0.sock"
    own = grp.struct_group(("robots", "x", os.getgid(), []))
    monkeypatch.setattr(grp, "getgrgid", {os.getgid(): own}.__getitem__)
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        os.chown(path, -1, os.getgid())
        facts = gather.gather("can0", str(path), channel_chosen=False)
    assert facts.sockets[0].closed_by is None
    assert facts.user.group == "robots"


def test_the_directory_that_closes_a_socket_is_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def shut(path: Path, *_options: Any, **_named: Any) -> NoReturn:
        raise PermissionError(13, "Permission denied", str(path))

    allowed = os.access
    closed = tmp_path / "closed"
    closed.mkdir(mode=0o700)
    path = f"{closed}/x.sock"
    monkeypatch.setattr(os, "access", lambda one, how: one != str(closed) and allowed(one, how))
    monkeypatch.setattr(Path, "stat", shut)
    owner = pwd.getpwuid(os.getuid()).pw_name
    found = gather.sockets([path])
    assert [one.closed_by for one in found] == [(str(closed), owner, None)] * 2
    closed.chmod(0o750)
    robots = grp.struct_group(("robots", "x", os.getgid(), []))
    monkeypatch.setattr(grp, "getgrgid", lambda _gid: robots)
    assert gather.sockets([path])[0].closed_by == (str(closed), owner, "robots")


def test_a_socket_or_directory_with_the_group_of_one_person_is_for_that_person_alone(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "can0.sock"
    person = pwd.struct_passwd(("simon", "x", os.getuid(), os.getgid(), "", "/", "/"))
    group = grp.struct_group(("simon", "x", os.getgid(), []))
    monkeypatch.setattr(pwd, "getpwuid", lambda _uid: person)
    monkeypatch.setattr(grp, "getgrgid", lambda _gid: group)
    monkeypatch.setattr(discovery, "FIRST_PERSON_UID", 0)
    allowed, closed = os.access, str(path)
    monkeypatch.setattr(os, "access", lambda one, how: str(one) != closed and allowed(one, how))
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind(str(path))
        (found,) = gather.sockets([str(path)])
    assert found.closed_by == (str(path), "simon", None)
    assert not found.is_accessible
    tmp_path.chmod(0o750)
    closed = str(tmp_path)
    assert discovery.closed_directory(str(path)) == (str(tmp_path), "simon", None)
