"""The command line of `litegripctl`: its parsers, and the types of its arguments.

A parser takes half a millisecond to make, so only that of the command that runs is made. The form
of values is checked here; the daemon checks ranges, which are only named here.
"""

from __future__ import annotations

import argparse
import math
import os
import re
import shlex
from argparse import ArgumentTypeError
from collections.abc import Callable, Iterable, Sequence
from difflib import get_close_matches
from functools import partial
from textwrap import fill

from litegrip_client.core.discovery import check_channel
from litegrip_client.core.sockets import CHANNEL_VARIABLE, DEFAULT_CHANNEL, STOP_LEVELS
from litegrip_client.values.errors import CommandError
from litegrip_client.values.figures import PROGRAM
from litegrip_client.values.voices import in_shell_of

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, NoReturn, Protocol, TypeAlias

    class Row(Protocol):
        """A command, as the parser knows it."""

        name: str
        text: str
        reads: bool
        is_local: bool

        def options(self) -> Fill | None:
            """Return what adds its arguments; None where it takes none."""


EXIT_CODES: tuple[tuple[int, str], ...] = (
    (0, 'ok; the verdict "ok" of health'),
    (
        1,
        (
            "the action ended, but not as it should (something blocks the jaws, or nothing is"
            ' held, say), or you said no; the verdict "degraded" of health; doctor has found an'
            " error"
        ),
    ),
    (2, 'wrong usage; the verdict "down" of health'),
    (3, "no daemon to talk to, or no longer"),
    (4, "refused: not calibrated, a value out of its range, no such job or file"),
    (5, "the motor is not enabled, or it or its bus does not work"),
    (6, "busy: another motion is running, or another client has the lease"),
    (7, "stopped: a stop is latched (see: clear)"),
    (8, "the motion was cancelled"),
    (9, "this user's role does not allow it"),
    (70, "a defect, or another version of the daemon"),
    (74, "the output cannot be written: the disk is full, say"),
    (130, "interrupted by Ctrl-C"),
    (141, "the reader of the output has gone"),
)
CLOSING = "A motion continues when litegripctl is killed; Ctrl-C cancels it."

_UNITS = {"mm": "opening_mm", "rad": "position_rad", "%": "openness"}
NUMBER = r"[+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+)"
_TARGET = re.compile(rf"({NUMBER}) ?(mm|rad|%)", re.IGNORECASE)


class UsageError(Exception):
    """The command line is wrong; `usage` says what would be right, the help of `program` more."""

    def __init__(self, message: str, usage: str, program: str) -> None:
        super().__init__(message)
        self.message = message
        self.usage = usage
        self.program = program


class Parser(argparse.ArgumentParser):
    """A parser that leaves it to its caller to say what is wrong."""

    def __init__(self, **settings: Any) -> None:
        super().__init__(
            **settings,
            parents=[common()],
            formatter_class=argparse.RawDescriptionHelpFormatter,
        )

    def error(self, message: str) -> NoReturn:
        """Raise `UsageError`."""
        raise UsageError(message, self.format_usage(), self.prog)

    def _check_value(self, action: argparse.Action, value: Any) -> None:
        """Raise an error that names what comes close, in place of forty names."""
        choices = [str(choice) for choice in action.choices or ()]
        if not choices or str(value) in choices:
            return
        word = str(value).lower()
        meant = _did_you_mean(_OTHER_NAMES.get(word, word), choices)
        if not meant and len(choices) <= _FEW:
            meant = f": {', '.join(choices)}"
        raise argparse.ArgumentError(action, f"there is no {str(value)!r}{meant}")

    def arguments(self) -> list[argparse.Action]:
        """Return the options and the positional arguments, in their order."""
        return self._actions


class LateParser(Parser):
    """The parser of one command, or of one of its actions, which takes what `fill` adds.

    A command's is found by its `row`, as soon as there is something to parse: only its module is
    imported.
    """

    def __init__(
        self, *, row: Row | None = None, fill: Fill | None = None, **settings: Any
    ) -> None:
        self._row = row
        self._fill = fill
        self._settings = settings

    def become(self) -> None:
        """Become a parser."""
        super().__init__(**self._settings)
        fill = self._fill if self._row is None else self._row.options()
        if fill is not None:
            fill(self)

    def parse_known_args(self, args: Any = None, namespace: Any = None) -> Any:
        """Become a parser, and parse.

        Note in `help_of` whose help fits the arguments, and in `usage_of` what returns its usage.
        """
        self.become()
        options, rest = super().parse_known_args(args, namespace)
        if not hasattr(options, "help_of"):  # else an action of this command has noted its own
            options.help_of = self.prog
            options.usage_of = self.format_usage
            options.known = list(self._option_string_actions)
        return options, rest


_CLOSE = 0.7
"""From so much likeness on (of 1) a name is asked for: --socket is none for --force."""
_HALTING = ("halt", "freeze", "abort", "emergency")
_OTHER_NAMES = {
    "goto": "move",
    "status": "state",
    "log": "events",
    "off": "disable",
    "on": "enable",
    **dict.fromkeys((*_HALTING, "estop"), "stop"),
    **dict.fromkeys(("unlock", "unstop", "resume"), "clear"),
    "reset": "clear-fault",
    **dict.fromkeys(("relax", "zero-gravity", "zero_gravity"), "slack"),
    "grab": "grasp",
    "grip": "grasp",
    "squeeze": "force",
    "recordings": "trajectories",
}
"""What Python and other programs call it."""
_WHERE = ("-c", "--channel", "--socket")
_FEW = 12
"""Names that are listed where none comes close."""

_SHIFTED = (
    ("grasp", rf"({NUMBER})N?", "a force is an option: --force {0}"),
    ("open|close", f"({_TARGET.pattern})", f"to an opening or a position: {PROGRAM} move {{0}}"),
    (
        "open|close",
        f"({NUMBER})",
        f"to an opening: {PROGRAM} move {{0}}mm; a speed is an option: --speed {{0}}",
    ),
    ("close|move", "(--force|-f).*", f"to hold an object with a force: {PROGRAM} grasp --force N"),
    ("release", rf"({NUMBER})(?:mm)?", "a distance is an option: --by {0}"),
    ("stop", f"({'|'.join(STOP_LEVELS)})", "a level is an option: --level {0}"),
    ("stop", "([^-].*)", "a reason is an option: --why TEXT"),
    ("dump|trajectories (?:get|export)", "([^-].*)", "a file is an option: -o {0}"),
)
"""By command: what users put behind it that it does not take, and what they are told then."""

Fill: TypeAlias = "Callable[[LateParser], None]"
"""Adds what a command takes to its parser."""


def _did_you_mean(given: str, names: Iterable[str]) -> str:
    """Return the question, if a name comes close to what was given, else nothing."""
    close = get_close_matches(given, list(names), 1, _CLOSE)
    return f"; did you mean {close[0]!r}?" if close else ""


def _meant(given: str, options: argparse.Namespace) -> str:
    """Return what a word that a command does not take was meant to be, if that is known."""
    command, word = options.help_of.removeprefix(f"{PROGRAM} "), given.strip()
    for commands, pattern, said in _SHIFTED:
        found = re.fullmatch(pattern, word, re.IGNORECASE)
        if found is not None and re.fullmatch(commands, command):
            return "; " + said.format(found[1])
    if re.fullmatch("-[a-z]", word):
        long = [one for one in options.known if one.startswith(f"-{word}") and one != "--help"]
        return f"; did you mean {long[0]!r}?" if len(long) == 1 else ""
    return _did_you_mean(word.partition("=")[0], options.known)


def common() -> argparse.ArgumentParser:
    """Return the options that every command takes, in front of its name and behind it."""
    # Without defaults, so that the later place does not undo the earlier.
    parser = argparse.ArgumentParser(add_help=False, argument_default=argparse.SUPPRESS)
    where = parser.add_mutually_exclusive_group()
    where.add_argument(
        "-c",
        "--channel",
        help=f"the daemon's channel (default: ${CHANNEL_VARIABLE}, else {DEFAULT_CHANNEL})",
    )
    where.add_argument("--socket", metavar="PATH", help="the daemon's socket")
    parser.add_argument("--json", action="store_true", help="print results and errors as JSON")
    return parser


def parse(given: list[str], rows: Sequence[Row]) -> argparse.Namespace:
    """Read the command line of a command of `rows`; raises `UsageError` when it is wrong.

    `channel_chosen` is true if a channel was asked for, by option or by environment. `only_reads`
    is true if the command changes nothing. `here` puts into texts of ours how the same gripper is
    called again, and `voice` tells the daemon's so.
    """
    parser = whole_parser(rows)
    if not given:
        raise UsageError("say a COMMAND", f"{parser.format_help()}\n", PROGRAM)
    words = ["--version"] if given == ["version"] else list(given)
    if words[:1] == ["help"]:
        words = [*words[1:], "--help"]
    if "move" in words:  # 45 mm is 45mm
        for at in range(len(words) - 1, 0, -1):
            if words[at].lower() in _UNITS and _TARGET.fullmatch(words[at - 1] + words[at]):
                words[at - 1 : at + 1] = [words[at - 1] + words[at]]
    # A target below zero looks like an option; behind a space it is none.
    words = [f" {one}" if one.startswith("-") and _TARGET.fullmatch(one) else one for one in words]
    options, rest = parser.parse_known_args(words)
    if rest:
        message = f"unrecognized arguments: {' '.join(rest)}{_meant(rest[0], options)}"
        raise UsageError(message, options.usage_of(), options.help_of)
    chosen = getattr(options, "channel", None) or os.environ.get(CHANNEL_VARIABLE)
    options.channel_chosen = chosen is not None
    options.only_reads = any(row.reads for row in rows if row.name == options.command)
    options.here = partial(for_gripper, _call(options), rows)
    options.voice = in_shell_of(options.here)
    options.socket = getattr(options, "socket", None)
    options.json = getattr(options, "json", False)
    if options.command == "grasp" and (options.width is None) != (options.tolerance is None):
        missing = "--tolerance 2" if options.tolerance is None else "--width 20"
        message = f"grasp: --width and --tolerance go together: give {missing}, too, say (mm)"
        raise UsageError(message, options.usage_of(), options.help_of)
    if options.command == "stop" and options.all and options.socket:
        message = "stop: --all is for the grippers of this machine, and takes no --socket"
        raise UsageError(message, options.usage_of(), options.help_of)
    try:
        options.channel = check_channel(chosen or DEFAULT_CHANNEL)
    except CommandError as error:
        parser.error(error.message)
    return options


def meant_stop(given: list[str], rows: Sequence[Row]) -> argparse.Namespace | None:
    """Return the stop that a wrong command line means, None where it is none for sure.

    It stands in the command's place, in whatever spelling: one stop too many does less harm than
    one too few. Options before it have to be right: they may name another gripper. Of the rest, a
    level and the gripper count.
    """
    names = {row.name for row in rows} - {"stop"}
    words = [part for word in given for part in (word.split() if _sounds(word) else [word])]
    named = [at + 1 for at, word in enumerate(words) if word in _WHERE]
    at = next(
        (
            at
            for at, word in enumerate(words)
            if at not in named and (word in names or _sounds(word))
        ),
        None,
    )
    if at is None or words[at] in names:
        return None
    before, behind = words[:at], words[at + 1 :]
    if not any(word.startswith("-") for word in before):
        before = []  # "please"
    try:
        known, others = Parser(add_help=False).parse_known_args(behind)
        where = [f"--{name}={value}" for name, value in vars(known).items() if name != "json"]
        values = [one.rpartition("=")[2].strip("-") for one in others]
        level = next((one for one in values if one in STOP_LEVELS), "hold")
        is_one = any(word.startswith("--socket") for word in words)
        every = ["--all"] if "all" in values and not is_one else []
        options = parse([*before, *where, "stop", "--level", level, *every], rows)
    except UsageError:
        return None
    options.json = "--json" in given
    return options if options.command == "stop" else None


def sounds_like_stop(given: list[str]) -> bool:
    """Return True if a word of a command line that is wrong may have been meant to stop."""
    return any(_sounds(word) for word in given)


def _sounds(given: str) -> bool:
    """Return True for `stop` as somebody may type it in a hurry, alone or with more behind it."""
    found = re.match(r"\W{0,2}([a-z]+(?:[-.][a-z]+)?)\W{0,3}(?:\s|$)", given.lower())
    if found is None:
        return False
    word = found[1].replace("-", "")
    if word in _HALTING or ("stop" in word and not word.startswith("un")):
        return True
    return word.startswith("s") and bool(get_close_matches(word, ["stop"], 1, _CLOSE))


def _call(options: argparse.Namespace) -> str:
    """Return the program with the options that name the gripper, for a shell."""
    named = (("channel", "-c"), ("socket", "--socket"))
    words = [
        word
        for name, option in named
        if (value := getattr(options, name, None)) is not None
        for word in (option, value)
    ]
    return " ".join([PROGRAM, *map(shlex.quote, words)])


def for_gripper(call: str, rows: Sequence[Row], text: str) -> str:
    """Return a text of ours; the commands in it that are for a gripper begin with `call`."""
    if call == PROGRAM:
        return text
    names = "|".join(row.name for row in rows if not row.is_local or row.name == "doctor")
    return re.sub(rf"\b{PROGRAM}(?= (?:{names})\b)", lambda _: call, text)


class _WholeParser(Parser):
    def format_help(self) -> str:
        lines = (
            fill(text, 79, initial_indent=f"  {code:<5}", subsequent_indent=" " * 7)
            for code, text in EXIT_CODES
        )
        self.epilog = "\n".join(("exit codes:", *lines, "", CLOSING, ""))
        return super().format_help()


class _Version(argparse.Action):
    """Prints the version and exits; it is looked up only then, for that takes long."""

    def __init__(self, option_strings: list[str], dest: str, help: str) -> None:  # noqa: A002
        super().__init__(option_strings, dest, nargs=0, default=argparse.SUPPRESS, help=help)

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        from litegrip_client import __version__  # noqa: PLC0415 - seldom needed

        print(f"{parser.prog} {__version__}")
        parser.exit()


def whole_parser(rows: Sequence[Row]) -> Parser:
    """Return the parser of all commands."""
    parser = _WholeParser(
        prog=PROGRAM,
        description="Look at a LiteGrip gripper and drive it, through its daemon.",
    )
    parser.add_argument("--version", action=_Version, help="print the version and exit")
    commands = parser.add_subparsers(
        dest="command", required=True, metavar="COMMAND", parser_class=LateParser
    )

    for row in rows:
        commands.add_parser(row.name, help=row.text, description=row.text, row=row)
    return parser


def target(text: str) -> tuple[str, float]:
    """Read a target with its unit; gives the parameter of motion.move, and its value."""
    found = _TARGET.fullmatch(text.strip())
    if found is None:
        if re.fullmatch(r"[+-]?[0-9]+,[0-9]+ ?(?:mm|rad|%)", text.strip(), re.IGNORECASE):
            raise ArgumentTypeError(f"{text!r} has a comma: say {text.strip().replace(',', '.')}")
        if other := re.fullmatch(rf"({NUMBER}) ?(cm|m)", text.strip()):
            value_mm = float(other[1]) * {"cm": 10.0, "m": 1000.0}[other[2]]
            raise ArgumentTypeError(f"{text.strip()!r} is no target: say {value_mm:g}mm")
        raise ArgumentTypeError(
            f"{text.strip()!r} is no target: say 45mm (opening), -0.3rad (position of the motor) "
            "or 50% (of the travel, 0% is closed)"
        )
    value, unit = float(found[1]), found[2].lower()
    if unit != "%":
        return _UNITS[unit], value
    if not 0.0 <= value <= 100.0:
        raise ArgumentTypeError(f"{text.strip()!r} is outside of the travel: say 0% to 100%")
    return _UNITS[unit], value / 100.0


def number(text: str) -> float:
    """Read a number."""
    value = _number(text)
    if math.isnan(value):
        raise ArgumentTypeError(f"{text!r} is no number")
    return value


def positive(text: str) -> float:
    """Read a number above 0."""
    value = _number(text)
    if not value > 0.0:
        raise ArgumentTypeError(f"{text!r} is not a number above 0")
    return value


def not_negative(text: str) -> float:
    """Read a number of 0 or more."""
    value = _number(text)
    if not value >= 0.0:
        raise ArgumentTypeError(f"{text!r} is not a number of 0 or more")
    return value


def in_unit(
    read: Callable[[str], float], unit: str, allowed: str | None = None
) -> Callable[[str], float]:
    """Return what reads as `read` does, and takes the unit, which is known, behind the number.

    What it does not take is told with the unit, and with what is `allowed`.
    """
    known = (unit, unit.replace("·", ""))

    def read_in_unit(text: str) -> float:
        found = re.fullmatch(rf"({NUMBER}) ?([^\d.]\D*)", text.strip())
        if found is not None and found[2] not in known:
            raise ArgumentTypeError(f"{text!r} is not in {unit}: give it in {unit}, or as a number")
        try:
            return read(text if found is None else found[1])
        except ArgumentTypeError as error:
            more = f", in {unit}" if allowed is None else f": say {allowed} {unit}"
            raise ArgumentTypeError(f"{error}{more}") from None

    return read_in_unit


def _number(text: str) -> float:
    """Return the number, NaN for what is none or not finite."""
    try:
        value = float(text)
    except ValueError:
        return math.nan
    return value if math.isfinite(value) else math.nan


def count(text: str) -> int:
    """Read a whole number of 1 or more."""
    if not text.isascii() or not text.isdigit() or int(text) < 1:
        raise ArgumentTypeError(f"{text!r} is not a whole number of 1 or more")
    return int(text)
