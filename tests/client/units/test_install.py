"""install-units into a system of its own: idempotent, careful with configurations, undone again."""

import errno
import importlib.util
import json
import os
import re
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest
import tomli

from litegrip_client.ctl import install
from litegrip_client.ctl.commands import machine
from litegrip_client.ctl.install import Wanted
from litegrip_client.ctl.main import main
from litegrip_client.values import atomic_file
from litegrip_client.values.errors import CommandError, ConnectError
from litegripd.app.main import EXIT_NO_PACKAGES, EXIT_USAGE

PROGRAMS = "/opt/grippers/bin"
UNITS = "usr/local/lib/systemd/system"
OLD_RULES = "usr/local/lib/udev/rules.d/80-litegrip.rules"
NETWORK = "usr/local/lib/systemd/network/80-litegrip.network"
LINK = "usr/local/lib/systemd/network/80-litegrip.link"
RULES = "usr/local/lib/udev/rules.d/85-litegrip.rules"
CONFIGURATION = "etc/litegripd/litegripd.toml"
SOURCES = Path(__file__).parents[3]


def put(root: Path, *channels: str, serial: bool = False, fleet: bool = False) -> dict[str, str]:
    done = install.install(root, Wanted(channels, serial, fleet), PROGRAMS)
    return {str(Path(one.path).relative_to(root)): one.what for one in done}


def enable(root: Path, name: str, by: str = "litegripd.target") -> Path:
    link = root / f"etc/systemd/system/{by}.wants/{name}"
    link.parent.mkdir(parents=True, exist_ok=True)
    link.symlink_to(f"/{UNITS}/litegripd@.service")
    return link


def start(root: Path, name: str) -> None:
    """Have systemd note that a unit runs."""
    note = root / f"run/systemd/units/invocation:{name}"
    note.parent.mkdir(parents=True, exist_ok=True)
    note.symlink_to("0123456789abcdef0123456789abcdef")


def test_the_unit_runs_the_programs_of_the_environment(tmp_path: Path) -> None:
    done = put(tmp_path)
    assert done == {
        f"{UNITS}/litegripd@.service": "installed",
        f"{UNITS}/litegripd.target": "installed",
        f"{UNITS}/litegripd-web.service": "installed",
        "usr/local/lib/sysusers.d/litegripd.conf": "installed",
        "usr/local/lib/tmpfiles.d/litegripd.conf": "installed",
        CONFIGURATION: "installed",
    }
    unit = (tmp_path / UNITS / "litegripd@.service").read_text()
    assert f"ExecStart={PROGRAMS}/litegripd %i\n" in unit
    assert f"ExecReload={PROGRAMS}/litegripctl -c %i restart --hold\n" in unit
    assert "Documentation=file:///opt/grippers/share/man/man8/litegripd.8\n" in unit
    page = (tmp_path / UNITS / "litegripd-web.service").read_text()
    assert f"ExecStart={PROGRAMS}/litegripd-web --token-file" in page
    assert "/opt/litegripd/" not in unit + page


def test_a_fleets_parts_are_installed_on_request_and_then_renewed(tmp_path: Path) -> None:
    wanted = {
        f"{UNITS}/litegripd-fleet@.service",
        "usr/local/lib/sysusers.d/litegripd-fleet.conf",
        "etc/litegripd/fleet.toml",
    }
    assert not wanted & put(tmp_path).keys()
    done = put(tmp_path, fleet=True)
    assert {path for path in wanted if done[path] == "installed"} == wanted
    unit = (tmp_path / UNITS / "litegripd-fleet@.service").read_text()
    assert f"ExecStart={PROGRAMS}/litegripd-fleet %i\n" in unit
    assert "/opt/litegripd/" not in unit
    assert wanted <= put(tmp_path).keys()
    users = (tmp_path / "usr/local/lib/sysusers.d/litegripd-fleet.conf").read_text()
    for part in ("gateway", "portal", "router"):
        assert f"u litegrip-{part} " in users
        assert f"m litegrip-{part} litegrip-fleet" in users
    removed = {str(Path(one.path).relative_to(tmp_path)) for one in install.uninstall(tmp_path)}
    assert wanted <= removed  # the configuration is named, and kept
    assert (tmp_path / "etc/litegripd/fleet.toml").exists()


def test_what_only_a_person_can_mend_is_not_tried_again() -> None:
    unit = install.units(PROGRAMS)[0].content
    named = " ".join(re.findall(r"^RestartPreventExitStatus=(.*)$", unit, re.M)).split()
    assert named[:2] == [str(EXIT_USAGE), str(EXIT_NO_PACKAGES)]
    no_program, no_such_group, no_such_user = "203", "216", "217"
    assert {no_program, no_such_group, no_such_user} < set(named)
    assert all(200 <= int(code) <= 243 for code in named[2:]), "the daemon itself ends with none"
    no_descriptors, no_memory, no_journal, no_cgroup = "202", "204", "209", "219"
    assert not {no_descriptors, no_memory, no_journal, no_cgroup} & set(named), "these may pass"
    full_tmp, full_disk, full_credentials = "226", "238", "243"
    assert not {full_tmp, full_disk, full_credentials} & set(named)


def test_no_unit_gives_directories_of_all_to_its_own_group() -> None:
    """systemd would give all that is in them to the Group= of the unit that starts."""
    unit = install.units(PROGRAMS)[0].content
    assert not re.findall(r"^(Runtime|State|Cache|Logs)Directory=", unit, re.M)
    assert "\nReadWritePaths=-/run/litegripd -/var/lib/litegripd\n" in unit


TMPFILES = shutil.which("systemd-tmpfiles")


@pytest.mark.skipif(TMPFILES is None or os.getuid() != 0, reason="it takes systemd, and root")
def test_another_group_in_a_directory_of_all_keeps_what_is_its_own(tmp_path: Path) -> None:
    put(tmp_path)
    (tmp_path / "etc/passwd").write_text("root:x:0:0::/:/bin/sh\nlitegrip:x:971:972::/:/bin/sh\n")
    (tmp_path / "etc/group").write_text("root:x:0:\nlitegrip:x:972:\nrobots:x:973:\n")
    for name in ("run/litegripd", "var/lib/litegripd"):
        of_robots = tmp_path / name / "can1.sock"
        of_robots.parent.mkdir(parents=True)
        of_robots.touch()
        for path in (of_robots, of_robots.parent):  # as systemd has left it for Group=robots
            os.chown(path, 971, 973)
    command = [str(TMPFILES), "--create", f"--root={tmp_path}", "litegripd.conf"]
    subprocess.run(command, check=True)
    for name, mode in (("run/litegripd", 0o755), ("var/lib/litegripd", 0o750)):
        found = (tmp_path / name).stat()
        assert (found.st_uid, found.st_gid, found.st_mode & 0o7777) == (971, 972, mode)
        inside = (tmp_path / name / "can1.sock").stat()
        assert (inside.st_uid, inside.st_gid) == (971, 973)


def test_all_may_read_it_whatever_the_umask(tmp_path: Path) -> None:
    before = os.umask(0o077)
    try:
        paths = [tmp_path / path for path in put(tmp_path)]
    finally:
        os.umask(before)
    assert {path.stat().st_mode & 0o777 for path in paths} == {0o644}
    assert {path.parent.stat().st_mode & 0o777 for path in paths} == {0o755}


def test_what_is_installed_is_what_the_sources_have() -> None:
    assert sorted(path.name for path in (install.DATA / "systemd").iterdir()) == sorted(
        path.name for path in (SOURCES / "systemd").iterdir()
    )
    assert install.units(install.PROGRAMS.rstrip("/"))[0].content == (
        SOURCES / "systemd/litegripd@.service"
    ).read_text(encoding="utf-8")


def test_a_second_time_changes_nothing(tmp_path: Path) -> None:
    put(tmp_path, "can0", serial=True)
    assert set(put(tmp_path, "can0", serial=True).values()) == {"unchanged"}


def test_an_older_unit_is_replaced_but_no_configuration(tmp_path: Path) -> None:
    put(tmp_path)
    (tmp_path / UNITS / "litegripd@.service").write_text("of an older version")
    (tmp_path / CONFIGURATION).write_text("# mine")
    done = put(tmp_path)
    assert done[f"{UNITS}/litegripd@.service"] == "replaced"
    assert done[CONFIGURATION] == "kept"
    assert (tmp_path / CONFIGURATION).read_text() == "# mine"


def test_udev_brings_exactly_the_named_interfaces_up(tmp_path: Path) -> None:
    put(tmp_path, "can0", "arm_can1")
    rule = (tmp_path / RULES).read_text()
    assert ' ENV{.LITEGRIP_NAME}=="can0|arm_can1", ATTR{tx_queue_len}="10", RUN+=' in rule
    assert re.findall(r"can\d", re.sub(r"^#.*", "", rule, flags=re.M)) == ["can0", "can1"]


def test_an_interface_is_known_by_its_last_name_and_not_by_the_kernels(tmp_path: Path) -> None:
    """At its next plug one that was renamed comes as can0 again."""
    put(tmp_path, "left")
    rule = tmp_path / RULES
    assert rule.name > "80-net-setup-link.rules"  # which gives the name; udev sorts by file name
    naming, line = [one for one in rule.read_text().splitlines() if one[:1] not in ("", "#")]
    assert naming.endswith(', ENV{.LITEGRIP_NAME}="$name"')
    assert ', ENV{.LITEGRIP_NAME}=="left",' in line
    assert "KERNEL" not in naming + line
    assert set(re.findall(r"ip link set (\S+)", line)) == {"$name"}


def test_an_adapter_that_refuses_to_restart_by_itself_comes_up_all_the_same(tmp_path: Path) -> None:
    put(tmp_path, "can0")
    assert re.findall(
        r'RUN\+="/sbin/ip link set \$name ([^"]*)"', (tmp_path / RULES).read_text()
    ) == [
        "type can bitrate 1000000",
        "type can restart-ms 100",
        "up",
    ]


def test_interfaces_of_an_earlier_call_stay(tmp_path: Path) -> None:
    put(tmp_path, "can0", "arm_can1")
    put(tmp_path, "can7", "can0")
    assert '_NAME}=="can0|arm_can1|can7"' in (tmp_path / RULES).read_text()


def test_an_upgrade_renews_what_earlier_calls_installed(tmp_path: Path) -> None:
    put(tmp_path, "can0", "can1", serial=True)
    drop_in = tmp_path / UNITS / "litegripd@.service.d/serial.conf"
    rule = tmp_path / RULES
    contents = [path.read_text() for path in (rule, drop_in)]
    rule.write_text('# old\nACTION=="add", SUBSYSTEM=="net", KERNEL=="can0|can1", RUN+="old"\n')
    drop_in.write_text("# old")
    done = put(tmp_path)
    assert (done[RULES], done[str(drop_in.relative_to(tmp_path))]) == ("replaced", "replaced")
    assert [path.read_text() for path in (rule, drop_in)] == contents


@pytest.mark.usefixtures("usable")
def test_with_serial_ports_others_are_kept_off_them_by_a_rule_behind_theirs(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install-units", "--root", str(tmp_path), "--serial", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert [command for command in told["next"] if command.startswith("udevadm")] == [
        "udevadm control --reload",
        "udevadm trigger --subsystem-match=tty",
    ]
    rule = tmp_path / install.SERIAL_RULES
    assert rule.name > "90-brltty-device.rules"
    lines = rule.read_text(encoding="utf-8").splitlines()
    labels = {line.split('"')[1] for line in lines if line.startswith("LABEL")}
    jumps = {part.split('"')[1] for line in lines for part in line.split("GOTO=")[1:]}
    assert jumps == labels
    assert sum('GOTO="litegrip_serial"' in line for line in lines) >= 7
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1", ENV{ID_MM_PORT_IGNORE}="1"' in lines
    assert main(["install-units", "--root", str(tmp_path), "--serial", "--json"]) == 0
    again = json.loads(capsys.readouterr().out)["next"]
    assert not any("trigger" in command for command in again)


def use_networkd(root: Path) -> None:
    wants = root / "etc/systemd/system/multi-user.target.wants"
    wants.mkdir(parents=True)
    (wants / "systemd-networkd.service").symlink_to("/lib/systemd/system/systemd-networkd.service")


def write(root: Path, name: str, content: str) -> Path:
    path = root / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(content)
    return path


def of_earlier_versions(root: Path) -> list[Path]:
    """Install what they did: with systemd-networkd the last two, else the first."""
    return [
        write(root, OLD_RULES, '# old\nACTION=="add", SUBSYSTEM=="net", KERNEL=="can0", RUN+=""\n'),
        write(root, NETWORK, "# old\n\n[Match]\nName=can1 can2\n\n[CAN]\nRestartSec=100ms\n"),
        write(root, LINK, "# old\n\n[Match]\nOriginalName=can1 can2\n"),
    ]


def test_an_upgrade_replaces_what_brought_interfaces_up_before(tmp_path: Path) -> None:
    of_earlier_versions(tmp_path)
    done = put(tmp_path)
    assert done[RULES] == "installed"
    assert {done[path] for path in (OLD_RULES, NETWORK, LINK)} == {"removed"}
    assert '_NAME}=="can0|can1|can2",' in (tmp_path / RULES).read_text()
    assert set(put(tmp_path).values()) <= {"unchanged", "kept"}


def test_what_earlier_versions_installed_is_removed(tmp_path: Path) -> None:
    paths = of_earlier_versions(tmp_path)
    assert {one.what for one in install.uninstall(tmp_path)} == {"removed"}
    assert not any(path.exists() for path in paths)


def test_systemd_networkd_has_no_say_in_it(tmp_path: Path) -> None:
    """It leaves alone what it has no file for; with RestartSec= it fails on some drivers."""
    use_networkd(tmp_path)
    assert put(tmp_path, "can0")[RULES] == "installed"
    assert not list(tmp_path.glob("**/*.network"))


def test_removal_takes_all_but_configuration_and_data(tmp_path: Path) -> None:
    put(tmp_path, "can0", serial=True)
    kept = tmp_path / "var/lib/litegripd/can0_calibration.json"
    kept.parent.mkdir(parents=True)
    kept.write_text("{}")
    install.uninstall(tmp_path)
    left = {path.relative_to(tmp_path) for path in tmp_path.rglob("*") if path.is_file()}
    assert left == {Path(CONFIGURATION), kept.relative_to(tmp_path)}
    assert not (tmp_path / UNITS / "litegripd@.service.d").exists()
    assert [one.what for one in install.uninstall(tmp_path)] == ["kept"]


def test_a_drop_in_of_the_administrator_stays(tmp_path: Path) -> None:
    put(tmp_path, serial=True)
    mine = tmp_path / UNITS / "litegripd@.service.d/mine.conf"
    mine.write_text("[Service]\n")
    install.uninstall(tmp_path)
    assert mine.exists()


def test_nothing_is_removed_while_a_daemon_is_enabled(tmp_path: Path) -> None:
    put(tmp_path)
    link = enable(tmp_path, "litegripd@can0.service")
    enable(tmp_path, "litegripd@can0.service", "sys-subsystem-net-devices-can0.device")
    enable(tmp_path, "litegripd.target", "multi-user.target")
    with pytest.raises(
        CommandError, match=r"enabled or running: litegripd\.target, litegripd@can0"
    ) as refused:
        install.uninstall(tmp_path)
    assert refused.value.hint == "first: systemctl disable --now litegripd.target litegripd@can0"
    assert link.is_symlink()
    assert (tmp_path / UNITS / "litegripd@.service").exists()


def test_nothing_is_removed_while_a_daemon_runs_that_is_not_enabled(tmp_path: Path) -> None:
    put(tmp_path)
    start(tmp_path, "litegripd@can0.service")
    with pytest.raises(CommandError, match=r"enabled or running: litegripd@can0\n") as refused:
        install.uninstall(tmp_path)
    assert refused.value.hint == "first: systemctl disable --now litegripd@can0"
    assert (tmp_path / UNITS / "litegripd@.service").exists()


def test_a_place_that_cannot_be_written_is_named(tmp_path: Path) -> None:
    (tmp_path / "usr").write_text("a file in place of the directory")
    with pytest.raises(CommandError, match=r"litegripd@\.service cannot be written"):
        put(tmp_path)


@pytest.mark.parametrize(
    ("number", "hint"),
    [
        (errno.EACCES, "it takes root: sudo"),
        (errno.EROFS, "that file system can only be read: mount it writable"),
        (errno.ENOTDIR, "look at that place"),
    ],
)
def test_what_helps_where_nothing_can_be_written_depends_on_why(
    tmp_path: Path, number: int, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Root is told to be root by no command, where /etc is part of an image."""

    def refuse(_path: Path, _content: bytes) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(atomic_file, "write", refuse)
    with pytest.raises(CommandError, match=os.strerror(number)) as caught:
        put(tmp_path)
    assert str(caught.value.data["hint"]).startswith(hint)


@pytest.mark.parametrize(
    ("directory", "complaint"),
    [
        ("/home/ann/venv/bin", "cannot see it"),
        ("/tmp/venv/bin", "cannot see it"),
        ("/opt/my venv/bin", "characters"),
        ("/opt/100%/bin", "characters"),
    ],
)
def test_an_environment_that_the_unit_cannot_use_is_refused(
    monkeypatch: pytest.MonkeyPatch, directory: str, complaint: str
) -> None:
    monkeypatch.setattr("sysconfig.get_path", lambda _name: directory)
    monkeypatch.setattr(Path, "is_file", lambda _path: True)
    with pytest.raises(CommandError, match=complaint):
        install.program_directory()


def test_an_environment_without_the_daemon_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr("sysconfig.get_path", lambda _name: str(tmp_path))
    with pytest.raises(CommandError, match="there is no program litegripd"):
        install.program_directory()


@pytest.fixture
def usable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(install, "program_directory", lambda: PROGRAMS)


@pytest.mark.usefixtures("usable")
def test_the_command_tells_what_it_did_and_what_comes_next(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install-units", "--root", str(tmp_path), "--can", "can1"]) == 0
    out = capsys.readouterr().out
    assert f"installed  {tmp_path}/{UNITS}/litegripd@.service" in out
    for command in (
        "systemd-sysusers",
        "systemctl daemon-reload",
        "udevadm trigger --action=add --subsystem-match=net --sysname-match=can1",
        "systemctl enable litegripd.target litegripd@can1",
        "systemctl start litegripd@can1",
    ):
        assert f"\n  {command}" in out


@pytest.mark.usefixtures("usable")
def test_the_command_says_to_read_anew_what_was_removed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    use_networkd(tmp_path)
    of_earlier_versions(tmp_path)
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    upgrading = json.loads(capsys.readouterr().out)["next"]
    assert upgrading[1:4] == [
        "systemctl daemon-reload",
        "networkctl reload",
        "udevadm control --reload",
    ]
    assert not any("trigger" in command for command in upgrading)
    of_earlier_versions(tmp_path)
    assert main(["install-units", "--root", str(tmp_path), "--uninstall", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"] == upgrading[1:4]
    assert main(["install-units", "--root", str(tmp_path), "--uninstall", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"] == []


@pytest.mark.usefixtures("usable")
def test_the_command_names_a_copy_of_what_is_no_longer_installed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = write(tmp_path, "etc/udev/rules.d/80-litegrip.rules", "# mine")
    assert main(["install-units", "--root", str(tmp_path), "--can", "can0"]) == 0
    assert f"note: {own} is a copy of a file of earlier versions" in capsys.readouterr().out


@pytest.mark.usefixtures("usable")
def test_after_an_upgrade_the_command_says_to_restart(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path)
    start(tmp_path, "litegripd@can0.service")
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"][-1] == "systemctl reload litegripd@can0"
    (tmp_path / UNITS / "litegripd@.service").write_text("old")
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"][-1] == "systemctl restart litegripd@can0"


@pytest.mark.usefixtures("usable")
def test_what_is_enabled_and_has_ended_is_started_and_not_reloaded(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path)
    enable(tmp_path, "litegripd@can0.service")
    start(tmp_path, "litegripd@can1.service")
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"][-2:] == [
        "systemctl reload litegripd@can1",
        "systemctl start litegripd@can0",
    ]


@pytest.mark.usefixtures("usable")
def test_page_and_fleet_which_cannot_reload_are_restarted(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path)
    for name in ("litegripd@can0", "litegripd-web", "litegripd-fleet@portal"):
        start(tmp_path, f"{name}.service")
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"][-2:] == [
        "systemctl reload litegripd@can0",
        "systemctl restart litegripd-fleet@portal litegripd-web",
    ]


class Answering:
    """A daemon that says what its motor is."""

    def __init__(self, motor: str) -> None:
        self._motor = motor

    def __enter__(self) -> "Answering":
        return self

    def __exit__(self, *_raised: object) -> None:
        return None

    def call(self, method: str) -> dict[str, str]:
        assert method == "state.get"
        return {"motor": self._motor}


MOTORS = {"can0": "silent", "can1": "enabled", "can2": "unknown"}


def test_a_daemon_whose_power_is_off_is_restarted_where_the_reload_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def answering(channel: str, *, timeout_s: float) -> Answering:
        if channel not in MOTORS:
            raise ConnectError("nobody listens")
        return Answering(MOTORS[channel])

    monkeypatch.setattr(machine, "connect", answering)
    names = [f"litegripd@can{number}" for number in range(4)]
    monkeypatch.setattr(install, "running", lambda _root: names)
    monkeypatch.setattr(install, "enabled", lambda _root: [])
    first, second, third = machine._after_installation(Path("/"), [], [], PROGRAMS)[-3:]
    assert first == "systemctl reload litegripd@can1 litegripd@can3"
    assert third.startswith("systemctl reload litegripd@can2 || {")
    programs = tmp_path / "programs"
    programs.mkdir()
    for motor, reloads, restarts in (
        ("silent", 1, True), ("unknown", 1, True), ("enabled", 1, False), ("silent", 0, False),
    ):  # fmt: skip
        calls = tmp_path / f"calls-{motor}-{reloads}"
        for name, text in (
            ("systemctl", f'echo "$*" >>{calls}; [ "$1" = restart ] || exit {reloads}'),
            ("litegripctl", f"""printf '{{\n "mode": "x", "motor": "{motor}"\n}}'"""),
        ):
            (programs / name).write_text(f"#!/bin/sh\n{text}\n")
            (programs / name).chmod(0o755)
        line = second.replace(PROGRAMS, str(programs))
        path = {"PATH": f"{programs}:{os.environ['PATH']}"}
        done = subprocess.run(["bash", "-c", line], env=path, check=False)
        asked = ["reload litegripd@can0", *(["restart litegripd@can0"] if restarts else [])]
        assert calls.read_text().splitlines() == asked
        assert (done.returncode == 0) == (restarts or reloads == 0)


def without(monkeypatch: pytest.MonkeyPatch, *modules: str) -> None:
    real = importlib.util.find_spec

    def find(name: str, package: str | None = None) -> Any:
        if name.partition(".")[0] in modules:
            if "." in name:
                raise ModuleNotFoundError(name)
            return None
        return real(name, package)

    monkeypatch.setattr("importlib.util.find_spec", find)


WEB = f"{PROGRAMS}/python -m pip install 'websockets>=14.0'"
ZENOH = f"{PROGRAMS}/python -m pip install 'eclipse-zenoh>=1.5'"


@pytest.mark.usefixtures("usable")
def test_a_page_without_its_package_is_told_and_one_in_use_gets_it_first(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["notes"] == []
    without(monkeypatch, "websockets", "zenoh")
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    (note,) = told["notes"]
    assert note.startswith("litegripd-web cannot run without websockets")
    assert note.endswith(WEB)
    assert WEB not in told["next"]
    start(tmp_path, "litegripd-web.service")
    assert main(["install-units", "--root", str(tmp_path), "--fleet", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert told["next"][:2] == [WEB, ZENOH]
    assert told["next"][-1] != WEB
    assert not any("websockets" in note for note in told["notes"])


@pytest.mark.usefixtures("usable")
def test_a_unit_whose_distribution_is_missing_is_told_with_that_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "litegrip_web", "websockets", "litegrip_fleet", "zenoh")
    assert main(["install-units", "--root", str(tmp_path), "--fleet", "--json"]) == 0
    told = json.loads(capsys.readouterr().out)
    said = "\n".join((*told["notes"], *told["next"]))
    assert "litegripd-web cannot run without litegrip-web" in said
    assert "-m pip install 'litegrip-web" in said
    assert "-m pip install 'litegrip-fleet" in said
    assert "websockets" not in said
    assert "zenoh" not in said


def test_the_page_installs_the_packages_of_all_its_units() -> None:
    page = (SOURCES / "docs/installation.md").read_text()
    extras = tomli.loads((SOURCES / "pyproject.toml").read_text())["project"]
    needed = [extra for extra, rows in extras["optional-dependencies"].items()
              if extra != "dev" and any(row.startswith("websockets") for row in rows)]  # fmt: skip
    assert any(row.startswith("eclipse-zenoh") for row in extras["dependencies"])
    assert needed == ["web"]
    asked = set(re.findall(r"bin/pip install (\S+)", page))
    assert asked == {f"'.[{','.join(needed)}]'"}


@pytest.mark.usefixtures("usable")
def test_what_a_fleet_needs_next_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["install-units", "--root", str(tmp_path), "--fleet", "--json"]) == 0
    (note,) = json.loads(capsys.readouterr().out)["notes"]
    assert "/etc/litegripd/fleet.toml" in note
    assert "systemctl enable --now litegripd-fleet@gateway" in note


@pytest.mark.usefixtures("usable")
def test_drop_ins_with_other_users_are_told_of(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    drop_ins = tmp_path / "etc/systemd/system/litegripd@can1.service.d"
    drop_ins.mkdir(parents=True)
    (drop_ins / "override.conf").write_text("[Service]\nGroup=robots\nUser = ann\n")
    (drop_ins / "good.conf").write_text("[Service]\nUser=litegrip\nGroup=robots\n")
    assert main(["install-units", "--root", str(tmp_path), "--json"]) == 0
    (note,) = json.loads(capsys.readouterr().out)["notes"]
    assert note.startswith(f"{drop_ins}/override.conf sets User=ann; /run/litegripd")


@pytest.mark.usefixtures("usable")
def test_a_second_interface_leaves_the_first_daemon_alone(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path, "can0")
    enable(tmp_path, "litegripd@can0.service")
    start(tmp_path, "litegripd@can0.service")
    assert main(["install-units", "--root", str(tmp_path), "--can", "can1", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert {"path": f"{tmp_path}/{RULES}", "what": "replaced"} in result["files"]
    assert result["next"][-4:] == [
        "systemctl reload litegripd@can0",
        "usermod --append --groups litegrip USER   # who may use the grippers",
        "systemctl enable litegripd.target litegripd@can1",
        "systemctl start litegripd@can1",
    ]


@pytest.mark.usefixtures("usable")
def test_a_new_drop_in_counts_from_a_restart_on(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    put(tmp_path)
    start(tmp_path, "litegripd@can0.service")
    assert main(["install-units", "--root", str(tmp_path), "--serial", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["next"][-1] == "systemctl restart litegripd@can0"


@pytest.mark.usefixtures("usable")
def test_the_command_names_a_unit_that_hides_the_installed_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "etc/systemd/system/litegripd@.service"
    own.parent.mkdir(parents=True)
    own.write_text("[Service]\n")
    assert main(["install-units", "--root", str(tmp_path)]) == 0
    assert f"note: {own} is used instead" in capsys.readouterr().out


def test_the_command_removes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    put(tmp_path)
    assert main(["install-units", "--root", str(tmp_path), "--uninstall"]) == 0
    assert f"removed    {tmp_path}/{UNITS}/litegripd.target" in capsys.readouterr().out
    assert main(["install-units", "--uninstall", "--serial"]) == 2


@pytest.mark.parametrize("name", ['can0", RUN+="/bin/sh', "can0 can1", "a" * 16, "", "-x"])
def test_only_names_of_interfaces_get_into_a_rule(tmp_path: Path, name: str) -> None:
    assert main(["install-units", "--root", str(tmp_path), f"--can={name}"]) == 2
    assert not (tmp_path / "usr").exists()


ANALYZE = shutil.which("systemd-analyze")


@pytest.mark.skipif(ANALYZE is None, reason="there is no systemd-analyze")
def test_systemd_accepts_the_units(tmp_path: Path) -> None:
    programs = tmp_path / "bin"
    programs.mkdir()
    for name in ("litegripd", "litegripctl"):
        (programs / name).symlink_to("/bin/true")
    install.install(tmp_path, Wanted(), str(programs))
    folder = tmp_path / UNITS
    unit = folder / "litegripd@can0.service"
    (folder / "litegripd@.service").rename(unit)
    verified = subprocess.run(
        [str(ANALYZE), "verify", "--man=no", str(unit), str(folder / "litegripd.target")],
        capture_output=True,
        text=True,
        check=False,
    )
    later = "Unknown key .*'Restart(Steps|MaxDelaySec)' in section .*, ignoring"
    lines = [line for line in verified.stderr.splitlines() if not re.search(later, line)]
    ours = [line for line in lines if "litegrip" in line]
    assert verified.returncode == 0, verified.stderr
    assert not ours
