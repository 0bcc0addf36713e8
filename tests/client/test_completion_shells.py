"""The completion scripts in real shells; each is left out where its shell is not installed."""

import os
import select
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from litegrip_client.ctl.completion.scripts import SCRIPTS
from tests.client.ctl_terminal import ROOT
from tests.client.fake_daemon import DEADLINE_S, FakeDaemon

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


UGLY = "$(touch ran)`touch ran`;touch ran|'\\\"<&a b"
"""A trajectory's name may hold all of this."""

READY = "echo 'completion is'' ready'\n"
SHELLS = {
    "bash": (["--norc", "--noprofile", "-i"], f". ../script; {READY}"),
    "zsh": (
        ["--no-rcs", "-i"],
        f"autoload -Uz compinit; compinit -u -d $PWD/../dump; . ../script; {READY}",
    ),
    "fish": (["--no-config", "-i"], f"source ../script; {READY}"),
}
CALLED = """case "$1" in __complete) ;; *)
for word; do printf '%s\\n' "$word"; done >../called; echo "is ""called"; exit 0;; esac
"""


class Typing:
    """A shell on a terminal, which is typed at."""

    def __init__(self, folder: Path, shell: str) -> None:
        (folder.parent / "script").write_text(SCRIPTS[shell], encoding="utf-8")
        program = folder.parent / "bin" / "litegripctl"
        text = program.read_text(encoding="utf-8").replace("\n", f"\n{CALLED}", 1)
        program.write_text(text, encoding="utf-8")
        arguments, self._begin = SHELLS[shell]
        self._shown = ""
        self._terminal, inner = os.openpty()
        self._process = subprocess.Popen(
            ["setsid", "--ctty", needs(shell), *arguments],
            cwd=folder,
            env={**os.environ, "TERM": "xterm", "HOME": str(folder.parent)},
            stdin=inner,
            stdout=inner,
            stderr=inner,
        )
        os.close(inner)

    def __enter__(self) -> "Typing":
        self.type(self._begin, "completion is ready")
        return self

    def __exit__(self, *_: object) -> None:
        self._process.kill()
        self._process.wait(DEADLINE_S)
        os.close(self._terminal)

    def type(self, text: str, answer: str) -> None:
        """Type a text, and wait until an answer to it is shown."""
        os.write(self._terminal, text.encode())
        while answer not in self._shown:
            assert select.select([self._terminal], [], [], DEADLINE_S)[0], self._shown
            self._shown += os.read(self._terminal, 4096).decode(errors="replace")
        self._shown = self._shown.partition(answer)[2]


@pytest.mark.parametrize("shell", SHELLS)
@pytest.mark.parametrize(
    "line", ["play ", "play \\$", "play --speed 2 ", "trajectories delete ", "plot \\$"]
)
def test_a_name_is_one_word_and_runs_nothing(
    folder: Path, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, shell: str, line: str
) -> None:
    needs(shell)
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)
    daemon.handlers["trajectory.list"] = lambda request: {"trajectories": [{"name": UGLY}]}
    with Typing(folder, shell) as typing:
        typing.type(f"litegripctl {line}\t\n", "is called")
    called = (folder.parent / "called").read_text(encoding="utf-8").splitlines()
    if (shell, line) == ("bash", "plot \\$"):
        assert called == ["plot", "$"]  # bash itself would not quote it right
    else:
        assert called == [*line.split()[: line.count(" ")], UGLY]
    assert not (folder / "ran").exists()


@pytest.mark.parametrize("line", ["plot a", "play a", "trajectories delete a\\ b"])
@pytest.mark.parametrize("shell", SHELLS)
def test_a_name_with_spaces_is_one_word(
    folder: Path, daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, shell: str, line: str
) -> None:
    needs(shell)
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)
    (folder / "a file.json").unlink()
    name = "a b;touch ran"
    daemon.handlers["trajectory.list"] = lambda request: {"trajectories": [{"name": name}]}
    with Typing(folder, shell) as typing:
        typing.type(f"litegripctl {line}\t\n", "is called")
    called = (folder.parent / "called").read_text(encoding="utf-8").splitlines()
    assert called[-1] == name
    assert not (folder / "ran").exists()
