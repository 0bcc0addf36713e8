"""litegripctl fleet: what it asks of litegripd-fleet, and what it says where that is missing."""

import json
import os
from pathlib import Path

import pytest

from litegrip_client.core import discovery
from litegrip_client.ctl.commands import fleet
from litegrip_client.ctl.main import main


class BecameError(Exception):
    """What the process was replaced by."""


@pytest.fixture
def replaced(monkeypatch: pytest.MonkeyPatch) -> None:
    def execv(_program: str, command: list[str]) -> None:
        raise BecameError(*command)

    monkeypatch.setattr(os, "execv", execv)
    monkeypatch.setattr(fleet, "program_of", lambda name: f"/bin/{name}")


@pytest.mark.parametrize(
    ("given", "asked"),
    [
        ("", "list"),
        ("lab", "list lab"),
        ("--config f lab", "--config f list lab"),
        ("stop lab", "stop lab"),
        ("stop lab --level relax --why lunch", "stop lab --level relax --why lunch"),
        ("stop *", "stop *"),
    ],
)
@pytest.mark.usefixtures("replaced")
def test_it_becomes_the_fleets_program(given: str, asked: str) -> None:
    with pytest.raises(BecameError) as became:
        main(["fleet", *given.split()])
    assert became.value.args == ("/bin/litegripd-fleet", *asked.split())


@pytest.mark.parametrize(
    "given",
    ["stop", "lab --level hold", "lab --why x", "lab left", "stop lab --level off"],
)
@pytest.mark.usefixtures("replaced")
def test_what_makes_no_sense_is_wrong_usage(capsys: pytest.CaptureFixture[str], given: str) -> None:
    assert main(["fleet", *given.split(), "--json"]) == 2
    assert json.loads(capsys.readouterr().out)["error"]["data"]["reason"] == "wrong_usage"


def test_where_the_program_is_missing_it_says_what_to_install(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.executable", str(tmp_path / "python"))
    monkeypatch.setenv("PATH", str(tmp_path))
    assert main(["fleet"]) == 4
    told = capsys.readouterr().err
    assert "litegripd-fleet is not found" in told
    assert "pip install litegrip-fleet" in told


def test_a_program_beside_the_interpreter_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for folder in ("beside", "path"):
        (tmp_path / folder).mkdir()
        (tmp_path / folder / "thing").touch(0o755)
    monkeypatch.setattr("sys.executable", str(tmp_path / "beside/python"))
    monkeypatch.setenv("PATH", str(tmp_path / "path"))
    assert discovery.program_of("thing") == str(tmp_path / "beside/thing")
    (tmp_path / "beside/thing").unlink()
    assert discovery.program_of("thing") == str(tmp_path / "path/thing")


@pytest.mark.parametrize(
    ("code", "reason", "exit_code"), [(3, "unreachable", 3), (2, "wrong_usage", 2), (1, None, 70)]
)
def test_its_complaint_is_an_error_in_json(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    code: int,
    reason: str | None,
    exit_code: int,
) -> None:
    program = tmp_path / "litegripd-fleet"
    program.write_text(f"#!/bin/sh\necho 'litegripd-fleet: alas' >&2\nexit {code}\n")
    program.chmod(0o755)
    monkeypatch.setattr(fleet, "program_of", lambda _name: str(program))
    assert main(["fleet", "--json"]) == exit_code
    error = json.loads(capsys.readouterr().out)["error"]
    assert "alas" in error["message"]
    assert error["data"].get("reason") == reason
    assert "litegripd-fleet check" in error["data"]["hint"]
