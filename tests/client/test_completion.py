"""Completion in shells: the scripts, and what real shells make of them if they are installed."""

import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from docs.completion import CHOICES, COMPLETERS, completion_script
from litegrip_client.ctl.main import main
from tests.client.ctl_commands import every_command, every_parser
from tests.client.fake_daemon import DEADLINE_S

SCRIPTS = {shell: completion_script(shell) for shell in ("bash", "zsh", "fish")}
CASES = [
    ("tele", {"teleop"}),
    ("stop --level ", {"hold", "relax", "disable"}),
    ("grasp --fo", {"--force"}),
    ("-c lab.left cal", {"calibration"}),
    ("-c can0 trajectories ", {"list", "get", "put", "delete", "keep", "export"}),
    ("calibration load ", {"normal", "reverse", "a file.json", "folder"}),
    ("calibration load a", {"a file.json"}),
    ("dump -o ", {"a file.json", "folder"}),
    ("install-units --root ", {"folder"}),
    ("-c completed-", {"completed-1", "completed-2"}),
    ("config set force_", {"force_n=", "force_rate_n_s="}),
    ("grasp --force ", set[str]()),
]
"""Behind the program's name: what is typed, and what is offered."""


@pytest.mark.parametrize("shell", SCRIPTS)
def test_the_scripts_are_printed(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    assert capsys.readouterr().out == SCRIPTS[shell]


def test_a_source_tree_without_what_makes_the_scripts_says_so(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(sys.modules, "shtab", None)
    assert main(["completion", "bash"]) == 4
    assert capsys.readouterr().err.startswith(
        "litegripctl: a source tree has no script for bash, and shtab, which makes it,"
    )


@pytest.mark.parametrize("shell", SCRIPTS)
def test_every_command_is_in_the_scripts(shell: str) -> None:
    script = SCRIPTS[shell]
    for command in every_command():
        name = command.replace("-", "_").replace(" ", "_")
        words = {"bash": f"_{name}_option_strings=", "zsh": f"_{name}_options="}
        assert words.get(shell, f"_using {command}' ") in script, command


def test_every_path_has_a_completer_and_every_completer_an_argument() -> None:
    arguments = [one for parser in every_parser() for one in parser.arguments()]
    names = {str(one.metavar or one.dest) for one in arguments}
    paths = {name for name in names if {*name.split("|")} & {"PATH", "FILE", "DIR", "PNG"}}
    assert paths <= set(COMPLETERS) <= names
    assert set(CHOICES) <= names


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return a directory with files, beside what looks like the sockets of two daemons."""
    sockets = tmp_path / "run" / "litegripd"
    sockets.mkdir(parents=True)
    for name in ("completed-1.sock", "completed-1.stop.sock", "completed-2.sock", "lock"):
        (sockets / name).touch()
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(sockets.parent))
    inner = tmp_path / "here"
    (inner / "folder").mkdir(parents=True)
    (inner / "a file.json").touch()
    for shell, script in SCRIPTS.items():
        (tmp_path / shell).write_text(script, encoding="utf-8")
    return inner


def run(folder: Path, shell: str, *arguments: str) -> list[str]:
    if shutil.which(shell) is None:
        pytest.skip(f"{shell} is not installed")
    done = subprocess.run(
        [shell, *arguments],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
        check=False,
    )
    assert (done.returncode, done.stderr) == (0, "")
    return [line for line in done.stdout.splitlines() if line]


BASH = """
. "$1"
COMP_WORDS=("${@:2}") COMP_CWORD=$(($# - 2))
compopt() { :; } # which wants a real completion
_shtab_litegripctl
printf '%s\\n' "${COMPREPLY[@]}"
"""
ZSH = """
zmodload zsh/zpty
zpty shell zsh --no-rcs -i
zpty -w shell 'autoload -Uz compinit; compinit -u -d $PWD/../dump; eval "$(<'$1')"
compadd() {
    local -a given
    builtin compadd -A given "$@"
    print -rl -- $given >>../found
    builtin compadd "$@"
}
complete-and-say() { zle complete-word; print -r -- "that was "all }
zle -N complete-and-say
bindkey "^I" complete-and-say
print completion is ready'
zpty -r -m shell shown '*completion is ready*completion is ready*'
zpty -w -n shell "$2"$'\\t'
zpty -r -m shell shown '*that was all*' # what is typed meanwhile may end the completing
zpty -w -n shell $'\\C-u'"exit"$'\\n'
while zpty -r shell shown; do :; done
"""


@pytest.mark.parametrize(("line", "found"), CASES)
def test_bash(folder: Path, line: str, found: set[str]) -> None:
    words = ["litegripctl", *line.split(), *([""] if line.endswith(" ") else [])]
    script = str(folder.parent / "bash")
    assert set(run(folder, "bash", "--norc", "-c", BASH, "bash", script, *words)) == found


@pytest.mark.parametrize(("line", "found"), CASES)
def test_fish(folder: Path, line: str, found: set[str]) -> None:
    typed = shlex.quote(f"litegripctl {line}")
    script = f"source {shlex.quote(str(folder.parent / 'fish'))}\ncomplete --do-complete {typed}"
    rows = run(folder, "fish", "--no-config", "-c", script)
    assert {row.partition("\t")[0].rstrip("/").replace("\\", "") for row in rows} == found


@pytest.mark.parametrize(("line", "found"), CASES)
def test_zsh(folder: Path, line: str, found: set[str]) -> None:
    completed = folder.parent / "found"
    completed.touch()
    script = str(folder.parent / "zsh")
    run(folder, "zsh", "--no-rcs", "-c", ZSH, "zsh", script, f"litegripctl {line}")
    rows = completed.read_text(encoding="utf-8").splitlines()
    assert {row.replace("\\", "") for row in rows if row} == found
