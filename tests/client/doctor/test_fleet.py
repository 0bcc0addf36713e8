"""The doctor and the parts of a fleet: whose gripper it is, what their own program has found."""

import json
from pathlib import Path

import pytest

from litegrip_client.ctl.doctor import gather
from litegrip_client.ctl.findings import error, ok, read, warning
from tests.client.doctor.conftest import Programs
from tests.client.helpers import Ctl

FOUND: list[dict[str, str | None]] = [
    {"check": "key", "level": "ok", "text": "k", "command": None, "advice": None},
    {"check": "network", "level": "error", "text": "t", "command": "c", "advice": "a"},
]


def test_what_the_fleets_program_finds_stands_among_the_findings(
    tmp_path: Path, directory: Path, programs: Programs, litegripctl: Ctl
) -> None:
    (directory / "fleet.toml").touch()
    told, asked = tmp_path / "told.json", tmp_path / "asked"
    told.write_text(json.dumps({"ok": False, "findings": FOUND}), encoding="utf-8")
    programs.says("litegripd-fleet", f'echo "$@" >{asked}; /bin/cat {told}; exit 1')
    code, text, _ = litegripctl("-c", "lab.left", "doctor", "--json")
    named = {row["check"]: row for row in json.loads(text)["findings"]}
    assert code == 1
    assert named["fleet-network"] == {**FOUND[1], "check": "fleet-network"}
    assert asked.read_text() == f"--config {directory}/fleet.toml check --json\n"
    # Nothing of a gripper that is another machine's is to be started or plugged in here.
    assert "litegripd@" not in text
    assert "simulate" not in text
    assert "link" not in named


def test_a_gripper_of_another_machine_needs_a_fleet(directory: Path, programs: Programs) -> None:
    programs.says("litegripd-fleet", f"echo '{json.dumps({'findings': FOUND})}'")
    found = gather.gather("lab.left", None, channel_chosen=True)
    assert found.is_remote
    assert [name for name, _finding in found.fleet] == ["fleet-key", "fleet-network"]
    assert gather.gather("nodaemon7", None, channel_chosen=True).fleet == ()


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
    programs: Programs, script: str, says: str
) -> None:
    programs.says("litegripd-fleet", script)
    ((name, finding),) = gather.fleet_check("/etc/fleet.toml")
    assert (name, finding.level) == ("fleet", "warning")
    assert says in finding.text


def test_a_program_that_hangs_is_not_waited_for(
    programs: Programs, monkeypatch: pytest.MonkeyPatch
) -> None:
    programs.says("litegripd-fleet", "exec /usr/bin/tail -f /dev/null")
    monkeypatch.setattr(gather, "FLEET_CHECK_WITHIN_S", 0.2)
    ((_name, finding),) = gather.fleet_check("f")
    assert "timed out" in finding.text


@pytest.mark.usefixtures("programs")
def test_without_the_program_that_is_said() -> None:
    ((_name, finding),) = gather.fleet_check("f")
    assert finding.text == "f was not checked: the program litegripd-fleet is not found here"


def test_findings_are_read_as_they_come() -> None:
    assert read({"findings": [*FOUND, {"check": "new", "level": "strange"}]}) == [
        ("key", ok("k")),
        ("network", error("t", "c", "a")),
        ("new", warning("None")),
    ]
