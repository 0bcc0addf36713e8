"""What is asked of the system: iproute2, the kernel's files, devices, users, sockets."""

import json
import os
import pwd
import socket
import subprocess
from pathlib import Path

import pytest

from litegrip_client.ctl.doctor import daemon_checks, gather
from litegrip_client.ctl.doctor.facts import Configuration, Device, Socket, System
from litegrip_client.socketcan import link as can_link
from litegrip_client.socketcan.link import Link
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


@pytest.fixture
def programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the one directory in which programs are looked for."""
    path = tmp_path / "bin"
    path.mkdir()
    monkeypatch.setenv("PATH", str(path))
    monkeypatch.setattr(can_link, "_ADMIN_PATHS", ())
    return path


def ip_says(programs: Path, script: str) -> None:
    program = programs / "ip"
    program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    program.chmod(0o755)


def test_iproute2_is_asked_for_one_link(net: Path, programs: Path) -> None:
    expected = "-details -statistics -json link show can0"
    answer = (LINKS / "healthy.json").read_text(encoding="utf-8")
    ip_says(programs, f"[ \"$*\" = '{expected}' ] && [ $LC_ALL = C ] && echo '{answer}'")
    assert gather.system("socketcan", "can0", net) == System(
        link("healthy"), None, ("can0", "can1"), "gs_usb", "candleLight USB to CAN adapter"
    )


def rename_can0(net: Path, programs: Path) -> None:
    """Rename can0 to gripper0, in the kernel's files and in what iproute2 says."""
    (net / "can0").rename(net / "gripper0")
    links = json.loads((LINKS / "healthy.json").read_text(encoding="utf-8"))
    answer = json.dumps([{**links[0], "ifname": "gripper0", "ifindex": 3}])
    ip_says(
        programs,
        f'[ "$5" = show ] && [ "$6" = gripper0 ] && echo \'{answer}\' && exit 0\n'
        f"echo 'Device \"'$6'\" does not exist.' >&2; exit 1",
    )


def test_an_interface_that_is_renamed_is_found_by_its_number(net: Path, programs: Path) -> None:
    rename_can0(net, programs)
    asked = gather.system("socketcan", "can0", net, held_index=3)
    assert asked.renamed_from == "can0"
    assert asked.link is not None
    assert (asked.link.name, asked.link.index, asked.link.is_up) == ("gripper0", 3, True)
    assert asked.driver == "gs_usb"


def test_another_interface_under_the_old_name_is_not_taken_for_the_daemons(
    net: Path, programs: Path
) -> None:
    (net / "can0").rename(net / "gripper0")
    (net / "can1").rename(net / "can0")  # without iproute2: the kernel's files tell
    asked = gather.system("socketcan", "can0", net, held_index=3)
    assert (asked.renamed_from, asked.link and asked.link.name) == ("can0", "gripper0")


def test_an_interface_that_is_gone_is_not_called_renamed(net: Path, programs: Path) -> None:
    rename_can0(net, programs)
    for held_index in (None, 99):
        asked = gather.system("socketcan", "can0", net, held_index=held_index)
        assert (asked.renamed_from, asked.link) == (None, None)


def test_the_interface_under_its_own_name_is_not_called_renamed(net: Path, programs: Path) -> None:
    asked = gather.system("socketcan", "can0", net, held_index=3)
    assert (asked.renamed_from, asked.link and asked.link.name) == (None, "can0")


def test_whether_systemd_has_the_unit_is_asked(
    tmp_path: Path, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    directories = (str(tmp_path / "a"), str(programs))
    monkeypatch.setattr("litegrip_client.core.discovery.UNIT_DIRECTORIES", directories)
    assert not gather.gather("can4", None, channel_chosen=True).is_unit_installed
    (programs / "litegripd@.service").touch()
    assert gather.gather("can4", None, channel_chosen=True).is_unit_installed


def test_whether_systemd_should_run_the_daemon_is_asked(
    tmp_path: Path, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("litegrip_client.core.discovery.ENABLED_DIRECTORY", str(programs))
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    (programs / "litegripd@can3.service").symlink_to("/usr/lib/litegripd@.service")
    assert gather.gather("can3", None, channel_chosen=True).is_unit_enabled
    assert not gather.gather("can4", None, channel_chosen=True).is_unit_enabled


CONTENT = {"bus": {"interface": "slcan", "channel": "/dev/ttyACM0", "bitrate": 1_000_000}}


@pytest.fixture
def directory(tmp_path: Path, programs: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the directory of configurations, with one for can0; litegripd is in `programs`."""
    path = tmp_path / "etc"
    path.mkdir()
    (path / "can0.toml").write_text("[bus]\n", encoding="utf-8")
    monkeypatch.setattr(gather, "DIRECTORY", path)
    monkeypatch.setattr("sys.executable", str(tmp_path / "nowhere/python"))
    return path


def litegripd_says(programs: Path, script: str) -> None:
    program = programs / "litegripd"
    program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    program.chmod(0o755)


def test_litegripd_is_asked_what_a_configuration_says(directory: Path, programs: Path) -> None:
    own, common = directory / "can0.toml", directory / "litegripd.toml"
    assert gather.configuration_file("can1") is None
    for channel, path in (("can0", own), ("can1", common)):
        path.touch()
        expected = f"{channel} --config {path} --check"
        litegripd_says(programs, f"[ \"$*\" = '{expected}' ] && echo '{json.dumps(CONTENT)}'")
        found = gather.configuration_file(channel)
        assert found == Configuration(str(path), content=CONTENT)


def test_a_configuration_that_is_wrong(directory: Path, programs: Path) -> None:
    litegripd_says(programs, "echo 'litegripd: x.toml: [bus] baud is unknown' >&2; exit 2")
    found = gather.configuration_file("can0")
    path = str(directory / "can0.toml")
    assert found == Configuration(path, error="x.toml: [bus] baud is unknown")


def test_a_configuration_is_known_though_the_calibration_that_it_names_is_wrong(
    directory: Path, programs: Path
) -> None:
    content = {**CONTENT, "calibration": {"file": "/m.json", "problem": "no calibration: x"}}
    litegripd_says(programs, f"echo '{json.dumps(content)}'; echo 'litegripd: x' >&2; exit 2")
    found = gather.configuration_file("can0")
    assert found == Configuration(str(directory / "can0.toml"), content=content)


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
    directory: Path, programs: Path, script: str | None, why: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "CHECK_WITHIN_S", 0.05 if why == "cannot be run" else 9)
    if script is not None:
        litegripd_says(programs, script)
    found = gather.configuration_file("can0")
    assert found is not None
    assert (found.content, found.error) == (None, None)
    assert why in str(found.unchecked)


def test_a_configuration_that_this_user_may_not_read(
    directory: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("os.access", lambda path, mode: False)
    path = str(directory / "can0.toml")
    found = gather.configuration_file("can0")
    assert found == Configuration(path, unchecked="this user may not read it")


def test_root_has_a_configuration_read_as_the_user_that_the_daemons_run_as(
    directory: Path, programs: Path, monkeypatch: pytest.MonkeyPatch
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
    litegripd_says(programs, "exit 0")
    entry = pwd.struct_passwd(("litegrip", "x", 991, 992, "", "/", ""))
    monkeypatch.setattr("pwd.getpwnam", {"litegrip": entry}.__getitem__)
    found = gather.configuration_file("can0")
    why = "can0.toml: cannot be read: Permission denied"
    assert found == Configuration(str(directory / "can0.toml"), error=why, as_user="litegrip")
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


def test_a_link_that_there_is_not(net: Path, programs: Path) -> None:
    ip_says(programs, "echo 'Device \"can9\" does not exist.' >&2; exit 1")
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
    net: Path, programs: Path, script: str | None, problem: str
) -> None:
    if script is not None:
        ip_says(programs, script)
    found = gather.system("socketcan", "can1", net)
    assert found.link == Link("can1", True, True, queue_frames=10, index=4)
    assert problem in str(found.ip_problem)
    assert (found.driver, found.adapter) == (None, None)
    assert gather.system("socketcan", "can9", net).link is None


def test_an_iproute2_that_hangs_is_not_waited_for(
    net: Path, programs: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(can_link, "IP_WITHIN_S", 0.05)
    ip_says(programs, "read line < /dev/zero")
    assert "cannot be run" in str(gather.system("socketcan", "can1", net).ip_problem)


def test_a_machine_without_can(tmp_path: Path, programs: Path) -> None:
    problem = "ip (iproute2) is not installed"
    assert gather.system("socketcan", "can0", tmp_path / "none") == System(None, problem)


def test_the_simulator_has_no_adapter(programs: Path) -> None:
    assert gather.system("litegrip_sim", "sim0") == System()


def test_the_file_of_an_adapter(tmp_path: Path) -> None:
    controller, terminal = os.openpty()
    try:
        path = os.ttyname(terminal)
        found = gather.system("slcan", f"{path}@115200").device
        assert found is not None
        assert (found.path, found.is_there, found.is_character_device) == (path, True, True)
        assert found.is_accessible
    finally:
        os.close(controller)
        os.close(terminal)
    missing = tmp_path / "ttyACM7"
    assert gather.system("slcan", str(missing)).device == Device(str(missing), False)
    missing.touch()
    found = gather.system("slcan", str(missing)).device
    assert found is not None
    assert (found.is_there, found.is_character_device) == (True, False)
    assert gather.system("pcan", "PCAN_USBBUS1").device is None


def test_who_else_may_open_a_port_and_whether_a_rule_keeps_them_off(tmp_path: Path) -> None:
    controller, terminal = os.openpty()
    try:
        path = os.ttyname(terminal)

        def found() -> tuple[tuple[str, ...], bool]:
            device = gather.system("slcan", path, root=tmp_path).device
            assert device is not None
            return device.probers, device.is_left_alone

        assert found() == ((), False)
        (tmp_path / "usr/sbin").mkdir(parents=True)
        (tmp_path / "usr/sbin/ModemManager").touch()
        assert found() == (("ModemManager",), False)
        number = os.stat(path).st_rdev  # noqa: PTH116 - a path of the terminal
        notes = tmp_path / "run/udev/data"
        notes.mkdir(parents=True)
        noted = notes / f"c{os.major(number)}:{os.minor(number)}"
        noted.write_text("S:serial/by-id/x\nE:ID_MM_CANDIDATE=1\n", encoding="utf-8")
        assert found() == (("ModemManager",), False)
        noted.write_text("E:ID_MM_CANDIDATE=1\nE:ID_MM_DEVICE_IGNORE=1\n", encoding="utf-8")
        assert found() == (("ModemManager",), True)
    finally:
        os.close(controller)
        os.close(terminal)


def test_the_user_and_a_group() -> None:
    import grp  # noqa: PLC0415 - beside its use
    import pwd  # noqa: PLC0415

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


def test_a_ports_lasting_name_and_the_other_ports_are_found(tmp_path: Path) -> None:
    (tmp_path / "dev/serial/by-id").mkdir(parents=True)
    for name, port in (("ttyACM0", "/dev/null"), ("ttyACM1", "/dev/zero")):
        (tmp_path / "dev" / name).symlink_to(port)
        (tmp_path / f"dev/serial/by-id/usb-{name}").symlink_to(f"../../{name}")
    own, lasting = str(tmp_path / "dev/ttyACM0"), f"{tmp_path}/dev/serial/by-id/usb-ttyACM0"
    found = gather.system("slcan", own, root=tmp_path).device
    assert found is not None
    assert (found.lasting_path, found.other_ports) == (lasting, 1)
    found = gather.system("slcan", f"{lasting}@115200", root=tmp_path).device
    assert found is not None
    assert (found.lasting_path, found.other_ports) == (None, 1)


@pytest.mark.parametrize("name", ["can0.toml.txt", "CAN0.toml", "can0.conf", "can0.toml/"])
def test_a_file_with_another_name_than_a_daemon_reads_is_found(
    tmp_path: Path, name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(gather, "DIRECTORY", tmp_path / "etc")
    assert gather._misnamed("can0") is None
    path = tmp_path / "etc" / name
    path.parent.mkdir()
    path.mkdir() if name.endswith("/") else path.touch()
    assert gather._misnamed("can0") == str(path)
    assert gather._misnamed("can1") is None
