"""The completion scripts in real shells; each is left out where its shell is not installed."""

import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from litegrip_client.ctl.completion.scripts import SCRIPTS
from tests.client.ctl_terminal import ROOT
from tests.client.fake_daemon import DEADLINE_S

CASES = [
    ("litegripctl tele", {"teleop"}),
    ("litegripctl stop --level ", {"hold", "relax", "disable"}),
    ("litegripctl grasp --fo", {"--force"}),
    ("litegripctl --host bob@robot cal", {"calibration"}),
    ("litegripctl calibration load ", {"normal", "reverse", "a file.json", "folder"}),
    ("litegripctl calibration load a", {"a file.json"}),
    ("litegripctl fly ", set[str]()),
]
BASH = """
COMP_LINE=$1 COMP_POINT=${#1} COMP_CWORD=$(($# - 2)) COMP_WORDS=("${@:2}")
_litegripctl litegripctl "${@: -1}" "${@: -2:1}"
printf '%s\\n' "${COMPREPLY[@]}"
"""
ZSH = """
zmodload zsh/zpty
zpty shell zsh --no-rcs -i
zpty -w shell 'autoload -Uz compinit; compinit -u -d $PWD/../dump; . ../script
compadd() {
    local -a given
    builtin compadd -A given "$@"
    print -rl -- $given >>../found
    builtin compadd "$@"
}
print completion is ready'
zpty -r -m shell shown '*completion is ready*completion is ready*'
zpty -w -n shell "$1"$'\\t'
zpty -w -n shell $'\\C-u'"exit"$'\\n'
while zpty -r shell shown; do :; done
"""


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a directory with files, where litegripctl is on the path."""
    programs = tmp_path / "bin"
    programs.mkdir()
    program = programs / "litegripctl"
    python = f"{shlex.quote(sys.executable)} -m litegrip_client.ctl"
    program.write_text(
        f'#!/bin/sh\nPYTHONPATH={shlex.quote(str(ROOT))} exec {python} "$@"\n', encoding="utf-8"
    )
    program.chmod(0o755)
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    inner = tmp_path / "here"
    (inner / "folder").mkdir(parents=True)
    (inner / "a file.json").touch()
    return inner


def run(folder: Path, *command: str) -> list[str]:
    done = subprocess.run(
        command, cwd=folder, capture_output=True, text=True, timeout=DEADLINE_S, check=False
    )
    assert (done.returncode, done.stderr) == (0, "")
    return [line for line in done.stdout.splitlines() if line]


def needs(shell: str) -> str:
    path = shutil.which(shell)
    if path is None:
        pytest.skip(f"{shell} is not installed")
    return path


@pytest.mark.parametrize(("line", "found"), CASES)
def test_bash(folder: Path, line: str, found: set[str]) -> None:
    bash = needs("bash")
    arguments = [line, *line.split(), *([""] if line.endswith(" ") else [])]
    assert set(run(folder, bash, "-c", SCRIPTS["bash"] + BASH, "bash", *arguments)) == found


def test_bash_takes_what_is_behind_an_equals_sign(folder: Path) -> None:
    line = "litegripctl stop --level=re"
    words = [line, "litegripctl", "stop", "--level", "=", "re"]
    script = SCRIPTS["bash"] + BASH
    assert run(folder, needs("bash"), "-c", script, "bash", *words) == ["relax"]


@pytest.mark.parametrize(("line", "found"), CASES)
def test_fish(folder: Path, line: str, found: set[str]) -> None:
    fish = needs("fish")
    script = f"{SCRIPTS['fish']}\ncomplete --do-complete {shlex.quote(line)}"
    rows = run(folder, fish, "--no-config", "-c", script)
    assert {row.partition("\t")[0].rstrip("/").replace("\\", "") for row in rows} == found


@pytest.mark.parametrize(("line", "found"), [CASES[1], CASES[4], CASES[6]])
def test_zsh(folder: Path, line: str, found: set[str]) -> None:
    zsh = needs("zsh")
    (folder.parent / "script").write_text(SCRIPTS["zsh"], encoding="utf-8")
    completed = folder.parent / "found"
    completed.touch()
    run(folder, zsh, "--no-rcs", "-c", ZSH, "zsh", line)
    rows = completed.read_text(encoding="utf-8").splitlines()
    assert {row.replace("\\", "") for row in rows if row} == found
