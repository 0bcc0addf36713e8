"""The doctor and the parts of a fleet: whose gripper it is, what their own program has found."""

import json
from pathlib import Path

import pytest

from litegrip_client.ctl.doctor import gather
from litegrip_client.ctl.findings import error, ok, read, warning
from litegrip_client.ctl.main import main

FOUND: list[dict[str, str | None]] = [
    {"check": "key", "level": "ok", "text": "k", "command": None, "advice": None},
    {"check": "network", "level": "error", "text": "t", "command": "c", "advice": "a"},
]


@pytest.fixture(autouse=True)
def directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "etc"
    path.mkdir()
    monkeypatch.setattr(gather, "DIRECTORY", path)
    return path


def fleet_program(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str) -> Path:
    program = tmp_path / "litegripd-fleet"
    program.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    program.chmod(0o755)
    monkeypatch.setattr(gather, "program_of", lambda _name: str(program))
    return program


def test_what_the_fleets_program_finds_stands_among_the_findings(
    tmp_path: Path,
    directory: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    (directory / "fleet.toml").touch()
    told = tmp_path / "told.json"
    told.write_text(json.dumps({"ok": False, "findings": FOUND}), encoding="utf-8")
    asked = tmp_path / "asked"
    fleet_program(tmp_path, monkeypatch, f'echo "$@" >{asked}; cat {told}; exit 1')
    assert main(["-c", "lab.left", "doctor", "--json"]) == 1
    data = json.loads(capsys.readouterr().out)
    named = {row["check"]: row for row in data["findings"]}
    assert named["fleet-network"] == {**FOUND[1], "check": "fleet-network"}
    assert asked.read_text().split() == [
        "--config",
        str(directory / "fleet.toml"),
        "check",
        "--json",
    ]
    # Nothing of a gripper that is another machine's is to be started or plugged in here.
    text = json.dumps(data)
    assert "litegripd@" not in text
    assert "simulate" not in text
    assert "link" not in named


def test_a_machine_without_a_fleet_does_not_ask(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet_program(tmp_path, monkeypatch, "exit 1")
    assert gather.gather("nodaemon7", None, channel_chosen=True).fleet == ()


def test_a_gripper_of_another_machine_needs_a_fleet(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet_program(tmp_path, monkeypatch, f"echo '{json.dumps({'findings': FOUND})}'")
    found = gather.gather("lab.left", None, channel_chosen=True)
    assert found.is_remote
    assert [name for name, _finding in found.fleet] == ["fleet-key", "fleet-network"]


def test_a_channel_with_a_dot_and_a_configuration_is_of_this_machine(directory: Path) -> None:
    (directory / "lab.left.toml").touch()
    assert not gather.is_remote_name("lab.left")
    assert gather.is_remote_name("lab.right")
    assert not gather.is_remote_name("can0")
    assert not gather.is_remote_name("a.b.c")


@pytest.mark.parametrize(
    ("script", "says"),
    [
        ("echo 'litegripd-fleet: no zenoh' >&2; exit 1", "ended with 1: litegripd-fleet: no zenoh"),
        ("exit 3", "ended with 3: no word"),
        ("echo '[1]'", "something else than findings"),
        ("echo '{\"findings\": [1]}'", "something else than findings"),
    ],
)
def test_a_program_that_finds_nothing_is_told_of(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, says: str
) -> None:
    fleet_program(tmp_path, monkeypatch, script)
    ((name, finding),) = gather.fleet_check("/etc/fleet.toml")
    assert (name, finding.level) == ("fleet", "warning")
    assert says in finding.text


def test_a_program_that_hangs_is_not_waited_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fleet_program(tmp_path, monkeypatch, "exec tail -f /dev/null")
    monkeypatch.setattr(gather, "FLEET_CHECK_WITHIN_S", 0.2)
    ((_name, finding),) = gather.fleet_check("f")
    assert "timed out" in finding.text


def test_without_the_program_that_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(gather, "program_of", lambda _name: None)
    ((_name, finding),) = gather.fleet_check("f")
    assert finding.text == "f was not checked: the program litegripd-fleet is not found here"


def test_findings_are_read_as_they_come() -> None:
    assert read({"findings": [*FOUND, {"check": "new", "level": "strange"}]}) == [
        ("key", ok("k")),
        ("network", error("t", "c", "a")),
        ("new", warning("None")),
    ]
