"""Every command that the programs print, gathered from their sources: it is one that can be typed.

A text that is put together counts with words in its gaps that could stand there.
"""

import ast
import re
import shlex
import subprocess
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest

from litegrip_client.ctl.commands import COMMANDS
from litegrip_client.ctl.parser import UsageError, for_gripper, parse
from litegripd.app import main as daemon
from tests.client.doctor.test_checks import failing
from tests.symptoms.test_symptoms import ROWS

ROOT = Path(__file__).parents[2]
END = r"(?:[^;'\"`()\n,.#&|]|\.(?=\w))*"
"""To the end of a command in a sentence."""
NAMES = "|".join(row.name for row in COMMANDS)
OF_CLIENT = re.compile(rf"\blitegripctl(?: -c \w+)? (?:{NAMES})\b{END}")
OF_DAEMON = re.compile(rf"(?<![/\w])litegripd (?:\w+) --{END}")
OF_SYSTEM = re.compile(
    rf"\b(?:systemctl|ip link|udevadm|modprobe|journalctl|usermod|groupadd|networkctl) {END}"
)
KNOWN = re.compile(
    r"systemctl (start|stop|status|restart|reload|enable|disable|edit|daemon-reload)\b"
    r"|ip link (set [\w{}]+ (up|down|txqueuelen 10|type can (bitrate|termination|restart-ms) \d+)"
    r"|add dev \w+ type)"
    r"|(udevadm (control|trigger) --|modprobe \w|journalctl (-u litegripd@can0|-t litegripd)$)"
    r"|(usermod (-aG|--append --groups) \w+ |groupadd --system \w|networkctl reload$)"
)
"""What begins as the system's programs are called."""

PLACEHOLDER = re.compile(r"(?<![$\w])(?!PMAX|VMAX|TMAX)[A-Z]{2,}(?!\w)")
UNKNOWN = {
    "usermod --append --groups litegrip USER": "who is to use the grippers",
    "litegripctl trajectories keep NAME": "how a recording is to be called",
    "litegripctl trajectories keep --partial NAME": "how a recording is to be called",
    "litegripctl trajectories delete NAME": "which one can go",
    "litegripctl record NAME": "how it is to be called",
    "litegripctl lease take REASON": "why somebody takes it",
    "litegripctl calibration rescale --stroke-mm MM": "what a caliper measures",
    "litegripctl -c can0 calibration rescale --stroke-mm MM": "what a caliper measures",
    "litegripd CHANNEL --socket /tmp/s": "only a socket was named",
}
"""Commands with a word that only their reader knows, and what that is."""

GAPS = {
    "ctl": "litegripctl -c can0",
    "path": "/tmp/s",
    "socket": "/tmp/s",
    "unit": "litegripd@can0",
    "settings": " type can bitrate 1000000",
    "verb": "restart",
    "mount": "normal",
    "setting": "calib_kp=30",
    "action": "get",
    "log_of": "-u litegripd@can0",
}


def gap(value: ast.expr) -> str:
    """Return a word that could stand where an expression is in a text."""
    return GAPS.get(ast.unparse(value).rpartition(".")[2], "can0")


def texts(tree: ast.Module) -> Iterator[str]:
    """Return what a module says, but for its documentation."""
    nodes = list(ast.walk(tree))
    documentation = {id(node.value) for node in nodes if isinstance(node, ast.Expr)}
    parts = {id(part) for node in nodes if isinstance(node, ast.JoinedStr) for part in node.values}
    for node in nodes:
        if id(node) in documentation or id(node) in parts:
            continue
        if isinstance(node, ast.JoinedStr):
            yield "".join(
                gap(part.value) if isinstance(part, ast.FormattedValue) else part.value  # type: ignore[attr-defined]
                for part in node.values
            )
        elif isinstance(node, ast.Constant) and isinstance(node.value, str):
            yield node.value


@cache
def said() -> tuple[str, ...]:
    """Return all that is said: by the sources, and by doctor wherever it is tried."""
    sources = [
        text
        for package in ("litegripd", "litegrip_client")
        for path in sorted((ROOT / package).rglob("*.py"))
        for text in texts(ast.parse(path.read_text(encoding="utf-8")))
    ]
    doctor = [text for found in failing() for text in (found.command, found.advice) if text]
    return (*sources, *doctor, *ROWS)


def commands(pattern: re.Pattern[str]) -> list[str]:
    """Return the different commands of a kind."""
    found = {
        match[0].partition("  ")[0].strip() for text in said() for match in pattern.finditer(text)
    }
    return sorted(found)


def all_commands() -> list[str]:
    return [*commands(OF_CLIENT), *commands(OF_DAEMON), *commands(OF_SYSTEM)]


def test_there_are_commands_of_each_kind() -> None:
    counts = [len(commands(kind)) for kind in (OF_CLIENT, OF_DAEMON, OF_SYSTEM)]
    assert all(count >= least for count, least in zip(counts, (70, 3, 30), strict=True)), counts


def parse_help(words: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parse(words, COMMANDS)
    assert ended.value.code == 0


@pytest.mark.parametrize("line", commands(OF_CLIENT))
def test_litegripctl_takes_its_own(line: str) -> None:
    words = shlex.split(line)[1:]
    if line in UNKNOWN:
        words = [*words[:-1], "7"]
    is_name = not any(word.startswith("-") for word in words)
    try:
        parse(words, COMMANDS)
    except UsageError:
        assert is_name, "not the name of a command either, in a sentence"
        parse_help([*words, "--help"])
    except SystemExit:
        parse_help(words)


@pytest.mark.parametrize("line", commands(OF_DAEMON))
def test_litegripd_takes_its_own(line: str) -> None:
    assert daemon.make_parser().parse_args(shlex.split(line)[1:])


@pytest.mark.parametrize("line", commands(OF_SYSTEM))
def test_the_system_s_programs_are_called_as_they_can_be(line: str) -> None:
    assert KNOWN.match(line)
    done = subprocess.run(["sh", "-n", "-c", line], capture_output=True, check=False)
    assert (done.returncode, done.stderr) == (0, b"")


def test_no_command_has_a_placeholder_for_what_is_known() -> None:
    assert {line for line in all_commands() if PLACEHOLDER.search(line)} == set(UNKNOWN)


def test_a_command_is_for_the_gripper_that_was_named() -> None:
    call = "litegripctl -c lab.left"
    for line in commands(OF_CLIENT):
        name = line.split()[1]
        local = {row.name for row in COMMANDS if row.is_local} - {"doctor"}  # it looks at a gripper
        is_for_all = name == "-c" or name in local
        assert for_gripper(call, COMMANDS, line) == (line if is_for_all else f"{call} {line[12:]}")
