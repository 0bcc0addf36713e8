"""install-units into a system of its own: idempotent, careful with configurations, undone again."""

import errno
import importlib.util
import os
import re
import shutil
import subprocess
from contextlib import AbstractContextManager, nullcontext
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
import tomli

from litegrip_client.ctl import install
from litegrip_client.ctl.commands import machine
from litegrip_client.ctl.install import Wanted
from litegrip_client.values import atomic_file
from litegrip_client.values.errors import CommandError, ConnectError
from litegripd.app.main import EXIT_NO_PACKAGES, EXIT_USAGE
from tests.client.units.system import CONFIGURATION, PROGRAMS, RULES, UNIT, UNITS, System

OLD_RULES = "usr/local/lib/udev/rules.d/80-litegrip.rules"
NETWORK = "usr/local/lib/systemd/network/80-litegrip.network"
LINK = "usr/local/lib/systemd/network/80-litegrip.link"
DROP_IN = f"{UNIT}.d/serial.conf"
SOURCES = Path(__file__).parents[3]


def test_the_unit_runs_the_programs_of_the_environment(system: System) -> None:
    assert system.put() == {
        UNIT: "installed",
        f"{UNITS}/litegripd.target": "installed",
        f"{UNITS}/litegripd-web.service": "installed",
        "usr/local/lib/sysusers.d/litegripd.conf": "installed",
        "usr/local/lib/tmpfiles.d/litegripd.conf": "installed",
        CONFIGURATION: "installed",
    }
    unit = system.read(UNIT)
    assert f"ExecStart={PROGRAMS}/litegripd %i\n" in unit
    assert f"ExecReload={PROGRAMS}/litegripctl -c %i restart --hold\n" in unit
    assert "Documentation=file:///opt/grippers/share/man/man8/litegripd.8\n" in unit
    page = system.read(f"{UNITS}/litegripd-web.service")
    assert f"ExecStart={PROGRAMS}/litegripd-web --token-file" in page
    assert "/opt/litegripd/" not in unit + page


def test_a_fleets_parts_are_installed_on_request_and_then_renewed(system: System) -> None:
    unit = f"{UNITS}/litegripd-fleet@.service"
    users = "usr/local/lib/sysusers.d/litegripd-fleet.conf"
    wanted = {unit, users, "etc/litegripd/fleet.toml"}
    assert not wanted & system.put().keys()
    done = system.put("--fleet")
    assert {path for path in wanted if done[path] == "installed"} == wanted
    assert f"ExecStart={PROGRAMS}/litegripd-fleet %i\n" in system.read(unit)
    assert "/opt/litegripd/" not in system.read(unit)
    assert wanted <= system.put().keys()
    for part in ("gateway", "portal", "router"):
        assert f"u litegrip-{part} " in system.read(users)
        assert f"m litegrip-{part} litegrip-fleet" in system.read(users)
    assert wanted <= system.put("--uninstall").keys()  # the configuration is named, and kept
    assert "etc/litegripd/fleet.toml" in system.files()


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
def test_another_group_in_a_directory_of_all_keeps_what_is_its_own(system: System) -> None:
    system.put()
    system.write("etc/passwd", "root:x:0:0::/:/bin/sh\nlitegrip:x:971:972::/:/bin/sh\n")
    system.write("etc/group", "root:x:0:\nlitegrip:x:972:\nrobots:x:973:\n")
    for name in ("run/litegripd", "var/lib/litegripd"):
        of_robots = system.write(f"{name}/can1.sock")
        for path in (of_robots, of_robots.parent):  # as systemd has left it for Group=robots
            os.chown(path, 971, 973)
    command = [str(TMPFILES), "--create", f"--root={system.root}", "litegripd.conf"]
    subprocess.run(command, check=True)
    for name, mode in (("run/litegripd", 0o755), ("var/lib/litegripd", 0o750)):
        found = (system.root / name).stat()
        assert (found.st_uid, found.st_gid, found.st_mode & 0o7777) == (971, 972, mode)
        inside = (system.root / name / "can1.sock").stat()
        assert (inside.st_uid, inside.st_gid) == (971, 973)


def test_all_may_read_it_whatever_the_umask(system: System) -> None:
    before = os.umask(0o077)
    try:
        paths = [system.root / path for path in system.put()]
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


def test_a_second_time_changes_nothing(system: System) -> None:
    system.put("--can=can0", "--serial")
    assert set(system.put("--can=can0", "--serial").values()) == {"unchanged"}


def test_an_older_unit_is_replaced_but_no_configuration(system: System) -> None:
    system.put()
    system.write(UNIT, "of an older version")
    system.write(CONFIGURATION, "# mine")
    done = system.put()
    assert (done[UNIT], done[CONFIGURATION]) == ("replaced", "kept")
    assert system.read(CONFIGURATION) == "# mine"


def test_udev_brings_exactly_the_named_interfaces_up(system: System) -> None:
    system.put("--can=can0", "--can=arm_can1")
    rule = system.read(RULES)
    assert ' ENV{.LITEGRIP_NAME}=="can0|arm_can1", ATTR{tx_queue_len}="10", RUN+=' in rule
    assert re.findall(r"can\d", re.sub(r"^#.*", "", rule, flags=re.M)) == ["can0", "can1"]


def test_an_interface_is_known_by_its_last_name_and_not_by_the_kernels(system: System) -> None:
    """At its next plug one that was renamed comes as can0 again."""
    system.put("--can=left")
    by_name = RULES.rpartition("/")[2]  # by which udev sorts
    assert by_name > "80-net-setup-link.rules"  # which gives the name
    naming, line = [one for one in system.read(RULES).splitlines() if one[:1] not in ("", "#")]
    assert naming.endswith(', ENV{.LITEGRIP_NAME}="$name"')
    assert ', ENV{.LITEGRIP_NAME}=="left",' in line
    assert "KERNEL" not in naming + line
    assert set(re.findall(r"ip link set (\S+)", line)) == {"$name"}


def test_an_adapter_that_refuses_to_restart_by_itself_comes_up_all_the_same(
    system: System,
) -> None:
    system.put("--can=can0")
    assert re.findall(r'RUN\+="/sbin/ip link set \$name ([^"]*)"', system.read(RULES)) == [
        "type can bitrate 1000000",
        "type can restart-ms 100",
        "up",
    ]


def test_interfaces_of_an_earlier_call_stay(system: System) -> None:
    system.put("--can=can0", "--can=arm_can1")
    system.put("--can=can7", "--can=can0")
    assert '_NAME}=="can0|arm_can1|can7"' in system.read(RULES)


def test_an_upgrade_renews_what_earlier_calls_installed(system: System) -> None:
    system.put("--can=can0", "--can=can1", "--serial")
    contents = [system.read(path) for path in (RULES, DROP_IN)]
    system.write(RULES, '# old\nACTION=="add", SUBSYSTEM=="net", KERNEL=="can0|can1", RUN+="old"\n')
    system.write(DROP_IN, "# old")
    done = system.put()
    assert (done[RULES], done[DROP_IN]) == ("replaced", "replaced")
    assert [system.read(path) for path in (RULES, DROP_IN)] == contents


def test_with_serial_ports_others_are_kept_off_them_by_a_rule_behind_theirs(
    system: System,
) -> None:
    assert [command for command in system.next("--serial") if command.startswith("udevadm")] == [
        "udevadm control --reload",
        "udevadm trigger --subsystem-match=tty",
    ]
    assert install.SERIAL_RULES.rpartition("/")[2] > "90-brltty-device.rules"
    lines = system.read(install.SERIAL_RULES).splitlines()
    labels = {line.split('"')[1] for line in lines if line.startswith("LABEL")}
    jumps = {part.split('"')[1] for line in lines for part in line.split("GOTO=")[1:]}
    assert jumps == labels
    assert sum('GOTO="litegrip_serial"' in line for line in lines) >= 7
    assert 'ENV{ID_MM_DEVICE_IGNORE}="1", ENV{ID_MM_PORT_IGNORE}="1"' in lines
    assert not any("trigger" in command for command in system.next("--serial"))


def use_networkd(system: System) -> None:
    system.write("etc/systemd/system/multi-user.target.wants/systemd-networkd.service")


def of_earlier_versions(system: System) -> set[str]:
    """Install what they did: with systemd-networkd the last two, else the first."""
    rule = '# old\nACTION=="add", SUBSYSTEM=="net", KERNEL=="can0", RUN+=""\n'
    system.write(OLD_RULES, rule)
    system.write(NETWORK, "# old\n\n[Match]\nName=can1 can2\n\n[CAN]\nRestartSec=100ms\n")
    system.write(LINK, "# old\n\n[Match]\nOriginalName=can1 can2\n")
    return {OLD_RULES, NETWORK, LINK}


def test_an_upgrade_replaces_what_brought_interfaces_up_before(system: System) -> None:
    paths = of_earlier_versions(system)
    done = system.put()
    assert done[RULES] == "installed"
    assert {done[path] for path in paths} == {"removed"}
    assert '_NAME}=="can0|can1|can2",' in system.read(RULES)
    assert set(system.put().values()) <= {"unchanged", "kept"}


def test_what_earlier_versions_installed_is_removed(system: System) -> None:
    paths = of_earlier_versions(system)
    assert system.put("--uninstall") == dict.fromkeys(paths, "removed")
    assert not system.files()


def test_systemd_networkd_has_no_say_in_it(system: System) -> None:
    """It leaves alone what it has no file for; with RestartSec= it fails on some drivers."""
    use_networkd(system)
    assert system.put("--can=can0")[RULES] == "installed"
    assert not [path for path in system.files() if path.endswith(".network")]


def test_removal_takes_all_but_configuration_and_data(system: System) -> None:
    system.put("--can=can0", "--serial")
    data = "var/lib/litegripd/can0_calibration.json"
    system.write(data, "{}")
    told = system.shows("--uninstall")
    assert f"removed    {system.root}/{UNITS}/litegripd.target" in told
    assert system.files() == {CONFIGURATION, data}
    assert not (system.root / f"{UNIT}.d").exists()
    assert system.put("--uninstall") == {CONFIGURATION: "kept"}


@pytest.mark.parametrize("word", ["--serial", "--fleet", "--can=can0"])
def test_removal_is_of_everything(system: System, word: str) -> None:
    assert system.refusal("--uninstall", word)[0] == "--uninstall removes everything"


def test_a_drop_in_of_the_administrator_stays(system: System) -> None:
    system.put("--serial")
    mine = system.write(f"{UNIT}.d/mine.conf", "[Service]\n")
    system.put("--uninstall")
    assert mine.exists()


@pytest.mark.parametrize("is_enabled", [True, False])
def test_nothing_is_removed_while_a_daemon_is_enabled_or_runs(
    system: System, *, is_enabled: bool
) -> None:
    system.put()
    if is_enabled:
        system.enable("litegripd@can0.service")
        system.enable("litegripd@can0.service", "sys-subsystem-net-devices-can0.device")
        system.enable("litegripd.target", "multi-user.target")
    else:
        system.start("litegripd@can0")
    before = sorted(system.root.rglob("*"))
    message, hint = system.refusal("--uninstall")
    names = "litegripd.target litegripd@can0" if is_enabled else "litegripd@can0"
    assert message == f"enabled or running: {names.replace(' ', ', ')}"
    assert hint == f"first: systemctl disable --now {names}"
    assert sorted(system.root.rglob("*")) == before


def test_a_place_that_cannot_be_written_is_named(system: System) -> None:
    system.write("usr", "a file in place of the directory")
    assert "litegripd@.service cannot be written" in system.refusal()[0]


@pytest.mark.parametrize(
    "name", ["etc/litegripd/litegripd.toml", "usr/local/lib/systemd/system/litegripd@.service"]
)
def test_what_is_no_plain_file_is_refused_and_never_read(system: System, name: str) -> None:
    """Who reads a pipe waits until somebody writes."""
    path = system.root / name
    path.parent.mkdir(parents=True)
    os.mkfifo(path)
    message, hint = system.refusal()
    assert message == f"{path} cannot be written: it is there, and no plain file"
    assert "remove it" in hint
    path.unlink()
    system.run()


def test_drop_ins_that_are_no_plain_files_are_no_ones_users(system: System) -> None:
    folder = system.root / "etc/systemd/system/litegripd@.service.d"
    folder.mkdir(parents=True)
    os.mkfifo(folder / "pipe.conf")
    (folder / "folder.conf").mkdir()
    system.write("etc/systemd/system/litegripd@.service.d/own.conf", "[Service]\nUser=me\n")
    assert [note.partition(" sets ")[2][:7] for note in system.run()["notes"]] == ["User=me"]


@pytest.mark.parametrize(
    ("number", "hint"),
    [
        (errno.EACCES, "it takes root: sudo"),
        (errno.EROFS, "that file system can only be read: mount it writable"),
        (errno.ENOTDIR, "look at that place"),
    ],
)
def test_what_helps_where_nothing_can_be_written_depends_on_why(
    system: System, number: int, hint: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Root is told to be root by no command, where /etc is part of an image."""

    def refuse(_path: Path, _content: bytes) -> None:
        raise OSError(number, os.strerror(number))

    monkeypatch.setattr(atomic_file, "write", refuse)
    message, told = system.refusal()
    assert os.strerror(number) in message
    assert told.startswith(hint)


@pytest.mark.parametrize(
    ("directory", "complaint"),
    [
        ("/home/ann/venv/bin", "cannot see it"),
        ("/tmp/venv/bin", "cannot see it"),
        ("/opt/my venv/bin", "characters"),
        ("/opt/100%/bin", "characters"),
        ("/nowhere/bin", "there is no program litegripd"),
    ],
)
def test_an_environment_that_the_unit_cannot_use_is_refused(
    monkeypatch: pytest.MonkeyPatch, directory: str, complaint: str
) -> None:
    monkeypatch.setattr("sysconfig.get_path", lambda _name: directory)
    monkeypatch.setattr(Path, "is_file", lambda path: "nowhere" not in str(path))
    with pytest.raises(CommandError, match=complaint):
        install.program_directory()


def test_the_command_tells_what_it_did_and_what_comes_next(system: System) -> None:
    out = system.shows("--can", "can1")
    assert f"installed  {system.root}/{UNIT}" in out
    for command in (
        "systemd-sysusers",
        "systemctl daemon-reload",
        "udevadm trigger --action=add --subsystem-match=net --sysname-match=can1",
        "systemctl enable litegripd.target litegripd@can1",
        "systemctl start litegripd@can1",
    ):
        assert f"\n  {command}" in out


def test_the_command_says_to_read_anew_what_was_removed(system: System) -> None:
    use_networkd(system)
    of_earlier_versions(system)
    upgrading = system.next()
    assert upgrading[1:4] == [
        "systemctl daemon-reload",
        "networkctl reload",
        "udevadm control --reload",
    ]
    assert not any("trigger" in command for command in upgrading)
    of_earlier_versions(system)
    assert system.next("--uninstall") == upgrading[1:4]
    assert system.next("--uninstall") == []


USER = "usermod --append --groups litegrip USER   # who may use the grippers"


@pytest.mark.parametrize(
    ("running", "enabled", "words", "ends"),
    [
        ("litegripd@can0", "", "", ["systemctl reload litegripd@can0"]),
        # What has a new drop-in counts from a restart on.
        ("litegripd@can0", "", "--serial", ["systemctl restart litegripd@can0"]),
        # What is enabled and has ended is started and not reloaded.
        (
            "litegripd@can1",
            "litegripd@can0",
            "",
            ["systemctl reload litegripd@can1", "systemctl start litegripd@can0"],
        ),
        # Page and fleet cannot reload.
        (
            "litegripd@can0 litegripd-web litegripd-fleet@portal",
            "",
            "",
            [
                "systemctl reload litegripd@can0",
                "systemctl restart litegripd-fleet@portal litegripd-web",
            ],
        ),
        # A second interface leaves the first daemon alone.
        (
            "litegripd@can0",
            "litegripd@can0",
            "--can=can1",
            [
                "systemctl reload litegripd@can0",
                USER,
                "systemctl enable litegripd.target litegripd@can1",
                "systemctl start litegripd@can1",
            ],
        ),
    ],
)
def test_what_runs_follows_an_upgrade(
    system: System, running: str, enabled: str, words: str, ends: list[str]
) -> None:
    system.put("--can=can0")
    system.start(*running.split())
    for name in enabled.split():
        system.enable(f"{name}.service")
    answer = system.run(*words.split())
    replaced = [row["path"] for row in answer["files"] if row["what"] == "replaced"]
    assert replaced == ([f"{system.root}/{RULES}"] if "--can" in words else [])
    assert answer["next"][-len(ends) :] == ends


def test_a_unit_that_was_replaced_counts_from_a_restart_on(system: System) -> None:
    system.put()
    system.start("litegripd@can0")
    system.write(UNIT, "old")
    assert system.next()[-1] == "systemctl restart litegripd@can0"


def test_the_command_names_a_copy_of_what_is_no_longer_installed(system: System) -> None:
    own = system.write("etc/udev/rules.d/80-litegrip.rules", "# mine")
    told = system.shows("--can", "can0")
    assert f"note: {own} is a copy of a file of earlier versions" in told


MOTORS = {"can0": "silent", "can1": "enabled", "can2": "unknown"}


def test_a_daemon_whose_power_is_off_is_restarted_where_the_reload_is_refused(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    def answering(channel: str, *, timeout_s: float) -> AbstractContextManager[Any]:
        if channel not in MOTORS:
            raise ConnectError("nobody listens")
        answers = {"state.get": {"motor": MOTORS[channel]}}
        return nullcontext(SimpleNamespace(call=answers.__getitem__))

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
ZENOH = f"{PROGRAMS}/python -m pip install 'eclipse-zenoh<2,>=1.10'"


def test_a_page_without_its_package_is_told_and_one_in_use_gets_it_first(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert system.run()["notes"] == []
    without(monkeypatch, "websockets", "zenoh")
    told = system.run()
    (note,) = told["notes"]
    assert note.startswith("litegripd-web cannot run without websockets")
    assert note.endswith(WEB)
    assert WEB not in told["next"]
    system.start("litegripd-web")
    told = system.run("--fleet")
    assert told["next"][:2] == [WEB, ZENOH]
    assert told["next"][-1] != WEB
    assert not any("websockets" in note for note in told["notes"])


def test_a_unit_whose_distribution_is_missing_is_told_with_that_alone(
    system: System, monkeypatch: pytest.MonkeyPatch
) -> None:
    without(monkeypatch, "litegrip_web", "websockets", "litegrip_fleet", "zenoh")
    told = system.run("--fleet")
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


def test_what_a_fleet_needs_next_is_said(system: System) -> None:
    (note,) = system.run("--fleet")["notes"]
    assert "/etc/litegripd/fleet.toml" in note
    assert "systemctl enable --now litegripd-fleet@gateway" in note


def test_drop_ins_with_other_users_are_told_of(system: System) -> None:
    drop_ins = "etc/systemd/system/litegripd@can1.service.d"
    other = system.write(f"{drop_ins}/override.conf", "[Service]\nGroup=robots\nUser = ann\n")
    system.write(f"{drop_ins}/good.conf", "[Service]\nUser=litegrip\nGroup=robots\n")
    (note,) = system.run()["notes"]
    assert note.startswith(f"{other} sets User=ann; /run/litegripd")


def test_the_command_names_a_unit_that_hides_the_installed_one(system: System) -> None:
    own = system.write("etc/systemd/system/litegripd@.service", "[Service]\n")
    assert f"note: {own} is used instead" in system.shows()


@pytest.mark.parametrize("name", ['can0", RUN+="/bin/sh', "can0 can1", "a" * 16, "", "-x"])
def test_only_names_of_interfaces_get_into_a_rule(system: System, name: str) -> None:
    assert system.ends(f"--can={name}")[0] == 2
    assert not system.root.exists()


ROOT = Path(__file__).parents[3]
ANALYZE = shutil.which("systemd-analyze")


def test_a_part_of_a_fleet_says_how_it_is_closed_to_strangers() -> None:
    """The page's drop-in is what the unit has to be uncommented."""
    unit = (ROOT / "systemd/litegripd-fleet@.service").read_text(encoding="utf-8")
    page = (ROOT / "docs/fleet-security.md").read_text(encoding="utf-8")
    lines = re.findall(r"^#(IPAddress.*)$", unit, re.MULTILINE)
    assert [line.partition("=")[0] for line in lines] == ["IPAddressDeny", "IPAddressAllow"]
    assert "\n".join(["```ini", "[Service]", *lines, "```"]) in page


@pytest.mark.skipif(ANALYZE is None, reason="there is no systemd-analyze")
def test_systemd_accepts_a_part_that_is_closed_to_strangers(tmp_path: Path) -> None:
    text = (ROOT / "systemd/litegripd-fleet@.service").read_text(encoding="utf-8")
    text = re.sub(r"^#(IPAddress)", r"\1", text, flags=re.MULTILINE)
    assert "\nIPAddressAllow=" in text
    unit = tmp_path / "litegripd-fleet@router.service"
    unit.write_text(re.sub(r"^ExecStart=.*", "ExecStart=/bin/true", text, flags=re.MULTILINE))
    verified = subprocess.run(
        [str(ANALYZE), "verify", "--man=no", str(unit)], capture_output=True, text=True, check=False
    )
    assert "IPAddress" not in verified.stderr
    assert verified.returncode == 0, verified.stderr


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
