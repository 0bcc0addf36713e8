"""The manual pages, in roff, from the parsers of the programs and from the configuration's table.

What argparse prints is not used: it differs between versions of Python. The pages are made when a
package is built, so all that is imported here needs the standard library alone.

    python -m docs.manual DIRECTORY [PAGE ...]     write them, or only these: litegripctl.1
"""

import argparse
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path

from docs.configuration_page import has_default, sentence
from litegrip_client.core.sockets import CHANNEL_VARIABLE, SOCKET_VARIABLE
from litegrip_client.ctl.commands import COMMANDS
from litegrip_client.ctl.parser import (
    CLOSING,
    EXIT_CODES,
    LateParser,
    common,
    whole_parser,
)
from litegrip_client.values.trajectory import DIRECTORY_VARIABLE
from litegrip_fleet.admin import options as fleet
from litegrip_web import options as web
from litegripd.app import main as daemon
from litegripd.app import sim_main as simulator
from litegripd.app.config import KEYS, TABLES

DATE = "2026-11-24"
"""Of the last change of what the pages say; set by hand."""

ENVIRONMENT = (
    (CHANNEL_VARIABLE, "the channel, where --channel does not name it"),
    (SOCKET_VARIABLE, "the daemon's socket, where --socket does not name it"),
    (DIRECTORY_VARIABLE, "where this user's trajectories are (~/.litegrip/trajectories)"),
)
CLIENT_FILES = (
    ("/run/litegripd/CHANNEL.sock", "the socket of a daemon of the system"),
    ("$XDG_RUNTIME_DIR/litegripd/CHANNEL.sock", "that of a daemon of a user"),
)
DAEMON_FILES = (
    ("/etc/litegripd/CHANNEL.toml", "the configuration of a channel"),
    ("/etc/litegripd/litegripd.toml", "the configuration of channels that have none of their own"),
    *CLIENT_FILES,
    ("/run/litegripd/CHANNEL.stop.sock", "takes stops before everything else; any line is one"),
    ("/var/lib/litegripd", "what the daemon keeps: calibration, trajectories, dumps"),
)
FLEET_FILES = (
    ("/etc/litegripd/fleet.toml", "the configuration of gateway, portal and router"),
    ("/run/litegripd-portal/SITE.GRIPPER.sock", "a gripper of another machine"),
    ("/run/litegripd-portal/SITE.GRIPPER.stop.sock", "the same for stops alone"),
)
WEB_FILES = (
    ("/etc/litegripd/web.env", "CHANNELS=can0 can1 and OPTIONS=--operate for the unit"),
    ("/run/litegripd-web/token", "the secret of the page that the unit serves"),
    ("/run/litegripd/CHANNEL.sock", "where the daemon of a channel listens"),
)
SIGNALS = (
    ("SIGTERM, SIGINT, SIGHUP", "end, with the motor disabled"),
    ("SIGUSR1", "stop, as a client does: the jaws hold"),
)
REMOTE = """\
Where a portal is set up (litegripd-fleet(8)), a gripper of another machine is a channel named
SITE.GRIPPER, and every command works on it. Without one, ssh(1) forwards the daemon's sockets:

  ssh -N -L /tmp/can0.sock:/run/litegripd/can0.sock \\
         -L /tmp/can0.stop.sock:/run/litegripd/can0.stop.sock user@robot &
  litegripctl --socket /tmp/can0.sock state
"""
NOT_AN_EMERGENCY_STOP = "A software stop is not an emergency stop: cut the motor's power for that."


def client_page() -> str:
    """Make litegripctl(1)."""
    parser = whole_parser(COMMANDS)
    (commands,) = (one for one in parser.arguments() if one.dest == "command")
    return _page(
        ("litegripctl", 1, "look at a LiteGrip gripper and drive it"),
        r"\fBlitegripctl\fR [\fIOPTION\fR ...] \fICOMMAND\fR [\fIARGUMENT\fR ...]",
        _section("DESCRIPTION", _text(f"{parser.description}\n\n{CLOSING}")),
        _section(
            "OPTIONS",
            "Every command takes these, in front of its name or behind it; --version stands alone.",
        )
        + list(_options(parser.arguments())),
        [".SH COMMANDS", *_commands(commands, "")],
        _section("OTHER MACHINES", _text(REMOTE)),
        [".SH EXIT STATUS", *_tagged((str(code), text) for code, text in EXIT_CODES)],
        [".SH ENVIRONMENT", *_tagged(ENVIRONMENT)],
        [".SH FILES", *_tagged(CLIENT_FILES)],
        _section("NOTES", NOT_AN_EMERGENCY_STOP),
        _see_also("litegripd(8)", "litegrip-sim(1)", "ssh(1)"),
    )


def daemon_page() -> str:
    """Make litegripd(8)."""
    parser = daemon.make_parser()
    return _page(
        ("litegripd", 8, "the daemon of a LiteGrip gripper"),
        f"{_bold('litegripd')} {_synopsis(parser._actions)}",  # noqa: SLF001 - argparse's only list
        _section("DESCRIPTION", _text(parser.description or "")),
        [".SH OPTIONS", *_options(parser._actions)],  # noqa: SLF001
        _section(
            "CONFIGURATION", "TOML. An unknown key or an impossible value is refused at start."
        )
        + list(_configuration()),
        [".SH SIGNALS", *_tagged(SIGNALS)],
        [".SH EXIT STATUS", *_tagged((str(code), text) for code, text in daemon.EXIT_CODES)],
        [".SH FILES", *_tagged(DAEMON_FILES)],
        _section("NOTES", NOT_AN_EMERGENCY_STOP),
        _see_also("litegripctl(1)", "litegrip-sim(1)", "systemctl(1)", "ip(8)"),
    )


def web_page() -> str:
    """Make litegripd-web(8)."""
    parser = web.make_parser()
    return _page(
        ("litegripd-web", 8, "a page in the browser for LiteGrip grippers"),
        f"{_bold('litegripd-web')} {_synopsis(parser._actions)}",  # noqa: SLF001
        _section("DESCRIPTION", _text(parser.description or "")),
        [".SH OPTIONS", *_options(parser._actions)],  # noqa: SLF001
        [".SH EXIT STATUS", *_tagged((str(code), text) for code, text in web.EXIT_CODES)],
        [".SH FILES", *_tagged(WEB_FILES)],
        _section("NOTES", NOT_AN_EMERGENCY_STOP),
        _see_also("litegripd(8)", "litegripctl(1)", "systemctl(1)"),
    )


def fleet_page() -> str:
    """Make litegripd-fleet(8)."""
    parser = fleet.make_parser()
    commands = next(
        action
        for action in parser._actions  # noqa: SLF001
        if isinstance(action, argparse._SubParsersAction)  # noqa: SLF001
    )
    listed = [(one.dest, one.help or "") for one in commands._choices_actions]  # noqa: SLF001
    options = [action for action in parser._actions if action is not commands]  # noqa: SLF001
    return _page(
        ("litegripd-fleet", 8, "LiteGrip grippers of other machines"),
        f"{_bold('litegripd-fleet')} [{_bold('--config')} FILE] COMMAND ...",
        _section("DESCRIPTION", _text(parser.description or "")),
        [".SH COMMANDS", *_tagged(listed)],
        [".SH OPTIONS", *_options(options)],
        [".SH EXIT STATUS", *_tagged((str(code), text) for code, text in fleet.EXIT_CODES)],
        [".SH FILES", *_tagged(FLEET_FILES)],
        _section("NOTES", NOT_AN_EMERGENCY_STOP),
        _see_also("litegripd(8)", "litegripctl(1)", "systemctl(1)"),
    )


def simulator_page() -> str:
    """Make litegrip-sim(1)."""
    parser = simulator.make_parser()
    return _page(
        ("litegrip-sim", 1, "a simulated LiteGrip gripper on a CAN bus"),
        f"{_bold('litegrip-sim')} {_synopsis(parser._actions)}",  # noqa: SLF001
        _section("DESCRIPTION", _text(parser.description or "")),
        [".SH OPTIONS", *_options(parser._actions)],  # noqa: SLF001
        [".SH EXIT STATUS", *_tagged((str(code), text) for code, text in simulator.EXIT_CODES)],
        _see_also("litegripd(8)", "litegripctl(1)"),
    )


PAGES: Mapping[str, Callable[[], str]] = {
    "litegripctl.1": client_page,
    "litegrip-sim.1": simulator_page,
    "litegripd.8": daemon_page,
    "litegripd-web.8": web_page,
    "litegripd-fleet.8": fleet_page,
}


def write_pages(folder: Path, names: Iterable[str] = PAGES) -> list[Path]:
    """Write these pages into a folder; return their files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = [folder / name for name in names]
    for file in files:
        file.write_text(PAGES[file.name](), encoding="utf-8")
    return files


# Pages


def _page(head: tuple[str, int, str], synopsis: str, *sections: Iterable[str]) -> str:
    name, number, purpose = head
    lines = [
        r".\" Made by docs/manual.py; not to be edited.",
        f".TH {_plain(name.upper())} {number} {DATE} litegripd",
        ".SH NAME",
        f"{_plain(name)} \\- {_plain(purpose)}",
        ".SH SYNOPSIS",
        synopsis,
        *(line for section in sections for line in section),
    ]
    return "\n".join(lines) + "\n"


def _section(title: str, body: str | Iterable[str]) -> list[str]:
    return [f".SH {title}", *([_plain(body)] if isinstance(body, str) else body)]


def _see_also(*pages: str) -> list[str]:
    named = [page.rstrip(")").split("(") for page in pages]
    lines = [f".BR {_plain(name)} ({number})" for name, number in named]
    return [".SH SEE ALSO", *(f"{line} ," for line in lines[:-1]), lines[-1]]


def _configuration() -> Iterator[str]:
    for table, about in TABLES.items():
        yield f".SS [{table}]"
        yield _plain(about)
        for key in (key for key in KEYS if key.table == table):
            default = f" Default: {key.shown}." if has_default(key) else ""
            yield from _tagged([(key.name, sentence(key) + default)])


# Parsers


def _commands(action: argparse.Action, before: str) -> Iterator[str]:
    """Describe the commands, and after each its actions."""
    parsers: Mapping[str, LateParser] = action.choices  # type: ignore[assignment]
    texts = {one.dest: one.help for one in action._get_subactions()}  # type: ignore[attr-defined]  # noqa: SLF001
    shared = {one.dest for one in common()._actions}  # noqa: SLF001
    for name, parser in parsers.items():
        parser.become()
        own = [one for one in parser.arguments() if one.dest not in (*shared, "help", "action")]
        full = f"{before}{name}"
        yield f".SS {_plain(full)} {_synopsis(own)}".rstrip()
        yield from _text(_sentence(parser.description or texts[name] or ""))
        yield from _options(own)
        if parser.epilog:
            yield from (".PP", *_text(parser.epilog))
        for inner in parser.arguments():
            if isinstance(inner.choices, Mapping):
                yield from _commands(inner, f"{full} ")


def _sentence(text: str) -> str:
    return text if text.rstrip().endswith((".", ":")) else f"{text[0].upper()}{text[1:]}."


def _options(actions: Sequence[argparse.Action]) -> Iterator[str]:
    for action in actions:
        if action.help == argparse.SUPPRESS or isinstance(action.choices, Mapping):
            continue
        text = (action.help or "") % {"default": action.default, "prog": ""}
        yield from [".TP", _written(action), _plain(text)]


def _synopsis(actions: Sequence[argparse.Action]) -> str:
    parts = []
    for action in actions:
        if action.help != argparse.SUPPRESS and action.dest != "help":
            text = _written(action, short=True)
            parts.append(text if action.required and action.nargs != "?" else f"[{text}]")
    return " ".join(parts)


def _written(action: argparse.Action, *, short: bool = False) -> str:
    value = "" if action.nargs == 0 else _value(action)
    if not action.option_strings:
        return f"{value} ..." if action.nargs == "+" else value
    names = action.option_strings[-1:] if short else action.option_strings
    return ", ".join(map(_bold, names)) + (f" {value}" if value else "")


def _value(action: argparse.Action) -> str:
    if action.choices:
        return "|".join(rf"\fI{_plain(str(choice))}\fR" for choice in action.choices)
    default = action.dest.upper() if action.option_strings else action.dest
    return rf"\fI{_plain(str(action.metavar or default))}\fR"


# roff


def _tagged(rows: Iterable[tuple[str, str]]) -> Iterator[str]:
    for tag, text in rows:
        yield from (".TP", _bold(tag), _plain(text))


def _text(text: str, *, is_example: bool = False) -> Iterator[str]:
    """Make paragraphs; indented lines, and those of an example, stay as they are."""
    was_example, begins = False, False
    for line in text.strip("\n").splitlines():
        indented = is_example or line.startswith("  ")
        if indented != was_example:
            yield from (".PP", ".RS 4", ".nf") if indented else (".fi", ".RE")
            was_example, begins = indented, False
        if not line.strip():
            begins = True
            continue
        if begins and not indented:
            yield ".PP"
        begins = False
        yield _plain(line if is_example else line.strip() if not indented else line[2:])
    if was_example:
        yield from (".fi", ".RE")


def _bold(text: str) -> str:
    return rf"\fB{_plain(text)}\fR"


def _plain(text: str) -> str:
    """Write a text so that roff takes nothing in it for its own."""
    text = text.replace("\\", r"\e").replace("-", r"\-").replace("~", r"\(ti").replace("'", r"\(aq")
    text = text.replace("^", r"\(ha").replace("`", r"\(ga")
    text = "".join(one if one.isascii() else rf"\[u{ord(one):04X}]" for one in text)
    return rf"\&{text}" if text.startswith(".") else text


if __name__ == "__main__":
    write_pages(Path(sys.argv[1]), sys.argv[2:] or PAGES)
