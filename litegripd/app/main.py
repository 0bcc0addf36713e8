"""The command `litegripd`: one daemon for one CAN channel, in the foreground.

The daemon is imported once the command line is right: the manual is made without its packages.
"""

import argparse
import faulthandler
import json
import logging
import sys
from collections.abc import Sequence
from itertools import pairwise
from pathlib import Path
from typing import NoReturn

from litegrip_client.values.version import installed_version
from litegripd.app.config import OWN_MECHANICS, Config, ConfigError, find, load, override
from litegripd.handover.predecessor import SUCCESSOR_OPTION
from litegripd.io.log import BoundedHandler, PriorityFormatter, goes_to_journal
from litegripd.io.sockets import InUseError
from litegripd.model.motor import MUJOCO

_log = logging.getLogger(__name__)

EXIT_NOT_OFF = 1
EXIT_USAGE = 2
EXIT_IN_USE = 3
EXIT_NOT_TAKEN = 4
"""Only for a successor that has not taken over; its predecessor reports why."""
EXIT_NO_PACKAGES = 5
"""For the program `litegripd` beside this file, which cannot import the number."""

EXIT_CODES = (
    (0, "ended by SIGTERM or SIGINT, the motor off or never heard of, or followed by a successor"),
    (EXIT_NOT_OFF, "ended, but the motor did not confirm that it is off"),
    (EXIT_USAGE, "usage or configuration"),
    (
        EXIT_IN_USE,
        "the channel or the socket cannot be had, mostly since it belongs to another process",
    ),
    (EXIT_NO_PACKAGES, "a package is missing, as after a release upgrade of the system"),
)
"""The meaning of each, for the help and the manual page."""

_CHANNEL_CHARACTERS = frozenset("abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_.-")
_MAX_CHANNEL = 64


def main(argv: Sequence[str] | None = None) -> int:
    """Run the daemon; return its exit code."""
    given = sys.argv[1:] if argv is None else list(argv)
    arguments = make_parser(given).parse_args(_spelt_out(given))

    from litegripd.app.build import named_calibration  # noqa: PLC0415
    from litegripd.app.daemon import Daemon, succeed  # noqa: PLC0415
    from litegripd.app.status import (  # noqa: PLC0415
        warn_of_missing_group,
        warn_of_superseded,
    )

    _log_to_standard_error()
    faulthandler.enable()  # after a watchdog's SIGABRT the log shows where the thread was
    logging.getLogger("can").setLevel(logging.CRITICAL)  # it raises what it logs; we report that
    if arguments.successor:
        given.remove(SUCCESSOR_OPTION)
        is_off = succeed(lambda: _config(arguments), given)
        return EXIT_NOT_TAKEN if is_off is None else 0 if is_off else EXIT_NOT_OFF
    try:
        config = _config(arguments)
        warn_of_superseded(config)
        warn_of_missing_group(config)
        if arguments.check:
            calibration = named_calibration(config)
            print(json.dumps({**config.as_info(), "calibration": calibration}, indent=2))
            return EXIT_USAGE if calibration and calibration["problem"] else 0
        daemon = Daemon(config, given)
    except ConfigError as error:
        _log.error("%s", error)
        return EXIT_USAGE
    except (InUseError, OSError) as error:
        _log.error("%s", error)
        return EXIT_IN_USE
    return 0 if daemon.run() else EXIT_NOT_OFF


def _log_to_standard_error() -> None:
    """Log to standard error until the daemon runs and has a log that never waits."""
    handler = BoundedHandler()
    # The journal adds the program's name to each line.
    plain = logging.Formatter("litegripd: %(message)s")
    handler.setFormatter(PriorityFormatter() if goes_to_journal() else plain)
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def _config(arguments: argparse.Namespace) -> Config:
    """Return the configuration; raises `ConfigError`."""
    from litegripd.app.build import check_interface, check_simulated  # noqa: PLC0415

    path = arguments.config or find(arguments.channel)
    config = override(
        load(arguments.channel, path),
        socket=arguments.socket,
        interface=arguments.interface,
        simulate=arguments.simulate,
    )
    is_given = arguments.interface is not None and arguments.simulate is None
    file = "defaults" if config.source is None else config.source
    check_interface(config.bus.interface, "--interface" if is_given else f"{file}: [bus] interface")
    check_simulated(config)
    return config


_MECHANICS = "--simulate takes mujoco, mujoco:SCENE.xml, or nothing behind it"
_ONE_CHANNEL = "a daemon has one channel: start one for each"


class _Parser(argparse.ArgumentParser):
    given: Sequence[str] = ()

    def error(self, message: str) -> NoReturn:
        """End, and say of a word that is not known which one may be meant."""
        from difflib import get_close_matches  # noqa: PLC0415 - seldom needed

        for word in message.partition("unrecognized arguments: ")[2].split()[:1]:
            options = [name for name in self._option_string_actions if name != SUCCESSOR_OPTION]
            if close := get_close_matches(word.partition("=")[0], options, 1):
                message += f"; did you mean {close[0]}?"
            elif not word.startswith("-"):
                is_mechanics = ("--simulate", word) in pairwise(self.given)
                message += f"; {_MECHANICS if is_mechanics else _ONE_CHANNEL}"
        super().error(message)


def make_parser(given: Sequence[str] = ()) -> argparse.ArgumentParser:
    """Return the parser of the command line; `given` is that as it was typed, for its errors."""
    parser = _Parser(
        prog="litegripd",
        allow_abbrev=False,  # a typo must not start a daemon that was not meant
        description="Own one CAN channel with a LiteGrip gripper and let many processes use it.",
        epilog=f"Exit codes: {', '.join(f'{code} {text}' for code, text in EXIT_CODES)}.",
    )
    parser.given = given
    parser.add_argument("channel", type=_channel, help="the CAN channel, e.g. can0")
    parser.add_argument("--config", type=Path, metavar="FILE", help="this configuration file only")
    parser.add_argument("--socket", metavar="PATH", help="where clients connect")
    parser.add_argument("--interface", metavar="NAME", help="python-can interface (socketcan)")
    parser.add_argument(
        "--simulate",
        nargs="?",
        const=OWN_MECHANICS,
        type=_mechanics,
        metavar="MECHANICS",
        help="a simulated gripper, no hardware; with MuJoCo's mechanics where they are named:"
        " mujoco, or mujoco:SCENE.xml for a scene of your own",
    )
    parser.add_argument(
        "--check",
        action="store_true",
        help="check the configuration and the calibration file that it or LITEGRIP_CALIB names,"
        " print what they say, and end",
    )
    parser.add_argument(SUCCESSOR_OPTION, action="store_true", help=argparse.SUPPRESS)
    parser.add_argument(
        "--version", action="version", version=f"litegripd {installed_version('litegripd')}"
    )
    return parser


def _spelt_out(given: Sequence[str]) -> list[str]:
    """Return the command line with each `--simulate` that names no mechanics spelt out.

    The parser would take the word behind it, which is mostly the channel.
    """
    return [
        f"{word}={OWN_MECHANICS}" if word == "--simulate" and not _is_mujoco(after) else word
        for word, after in zip(given, [*given[1:], ""], strict=False)
    ]


def _is_mujoco(text: str) -> bool:
    return text == MUJOCO or text.startswith(f"{MUJOCO}:")


def _mechanics(text: str) -> str:
    """Return the name of mechanics, with the absolute path of a scene."""
    if text != OWN_MECHANICS and not _is_mujoco(text):
        raise argparse.ArgumentTypeError(f"{text!r}: it is mujoco, mujoco:SCENE.xml, or left out")
    name, separator, scene = text.partition(":")
    return f"{name}:{Path(scene).absolute()}" if separator else text


def _channel(text: str) -> str:
    if not 0 < len(text) <= _MAX_CHANNEL or text[0] == "." or not set(text) <= _CHANNEL_CHARACTERS:
        raise argparse.ArgumentTypeError(
            f"{text!r}: a channel's name has letters, digits, _ . - (at most {_MAX_CHANNEL}, no"
            " leading dot); give a device path as [bus] channel in the configuration"
        )
    if text.endswith(".stop"):
        raise argparse.ArgumentTypeError(
            f"{text!r}: a channel's name does not end in .stop: {text}.sock is the stop socket of"
            f" channel {text.removesuffix('.stop')}"
        )
    return text


if __name__ == "__main__":
    sys.exit(main())
