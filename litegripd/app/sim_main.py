"""The command `litegrip-sim`: a simulated gripper in a process of its own.

It reads the command line, opens the terminal or the bus, and ends cleanly on SIGTERM and SIGINT.
`litegripd.sim.server` serves the gripper. python-can is imported once the command line is right:
the manual is made without it.
"""

from __future__ import annotations

import argparse
import contextlib
import signal
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from litegrip_client.values.version import installed_version
from litegripd.model.gripper import DM4310, MOTOR_TYPES
from litegripd.sim.gripper import SimulatedGripper, build_gripper
from litegripd.sim.plant import MOUNTS

if TYPE_CHECKING:
    from litegripd.sim.server import StopSignal

EXIT_OK, EXIT_BUS, EXIT_USAGE = 0, 1, 2
EXIT_CODES = (
    (EXIT_OK, "a signal ended it"),
    (EXIT_BUS, "the bus or the terminal cannot be opened, or fails"),
    (EXIT_USAGE, "wrong usage"),
)
"""The meaning of each, for the help and the manual page."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the simulator until a signal ends it; return the exit code.

    0 after a signal, 1 when the bus or the terminal cannot be opened or fails, 2 for bad usage.
    """
    arguments = make_parser().parse_args(argv)
    try:
        gripper = build_gripper(
            mount=arguments.mount,
            seed=arguments.seed,
            object_mm=arguments.object_mm,
            object_stiffness_nm_rad=arguments.object_stiffness,
            can_id=arguments.can_id,
            master_id=arguments.master_id,
            watchdog_s=arguments.watchdog,
            comm_loss_s=arguments.comm_loss,
            idle_loss_s=arguments.idle_loss,
            unasked_hz=arguments.unasked_hz,
            motor_type=arguments.motor_type,
        )
        link: Path | None = arguments.link
        if link is not None and link.exists() and not link.is_symlink():
            raise ValueError(f"--link {link} exists and is no symbolic link; choose another path")
        if not arguments.pty and arguments.channel is None:
            raise ValueError("--interface needs --channel, for example --channel vcan0")
        if arguments.pty and (arguments.channel is not None or arguments.bitrate is not None):
            raise ValueError("--channel and --bitrate belong to --interface, not to --pty")
        if not arguments.pty and arguments.link is not None:
            raise ValueError("--link belongs to --pty")
    except ValueError as error:
        print(f"litegrip-sim: {error}", file=sys.stderr)
        return EXIT_USAGE
    return _serve(gripper, arguments)


def _serve(gripper: SimulatedGripper, arguments: argparse.Namespace) -> int:
    import can  # noqa: PLC0415

    from litegripd.io.can.bus import explain  # noqa: PLC0415
    from litegripd.sim.interface import MotorWire  # noqa: PLC0415
    from litegripd.sim.server import BusServer, PtyServer, StopSignal  # noqa: PLC0415

    wire = MotorWire(gripper)
    if arguments.seed is not None:
        wire.seed(arguments.seed)
    options = {} if arguments.bitrate is None else {"bitrate": arguments.bitrate}
    with contextlib.closing(StopSignal()) as stop, _set_by_signals(stop):
        try:
            if arguments.pty:
                terminal = PtyServer(wire, arguments.link, lambda path: print(path, flush=True))
                with contextlib.closing(terminal):
                    terminal.run(stop)
                    if terminal.dropped:
                        _say(f"{terminal.dropped} answers dropped, the client did not read them")
                return EXIT_OK
            with can.Bus(
                interface=arguments.interface,
                channel=arguments.channel,
                ignore_config=True,
                **options,
            ) as bus:
                print(f"serving on {arguments.interface} {arguments.channel}", flush=True)
                BusServer(wire, bus).run(lambda: stop.is_set)
        except (can.CanError, OSError, ValueError, ImportError, NotImplementedError) as error:
            why = explain(error, str(error), arguments.interface or "", arguments.channel or "")
            _say(f"the bus cannot be used: {why}")
            return EXIT_BUS
    return EXIT_OK


def make_parser() -> argparse.ArgumentParser:
    """Return the parser of the command line."""
    parser = argparse.ArgumentParser(
        prog="litegrip-sim",
        allow_abbrev=False,
        description="A simulated LiteGrip gripper on a CAN bus.",
        epilog=f"exit codes: {', '.join(f'{code} {text}' for code, text in EXIT_CODES)}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--version", action="version", version=f"%(prog)s {installed_version('litegripd')}"
    )
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument(
        "--pty",
        action="store_true",
        help="serve as an SLCAN adapter on a pseudo-terminal; its path is the first line printed",
    )
    where.add_argument("--interface", metavar="NAME", help="serve on this python-can interface")
    parser.add_argument("--channel", metavar="CH", help="channel of --interface, for example vcan0")
    parser.add_argument("--bitrate", type=int, help="bit rate of --interface in bit/s")
    parser.add_argument("--link", type=Path, help="also make a symbolic link to the terminal")
    parser.add_argument("--mount", choices=MOUNTS, default="normal")
    parser.add_argument(
        "--seed", type=int, help="add reproducible noise to the reports, and vary the faults"
    )
    parser.add_argument("--object-mm", type=float, help="width of an object between the jaws")
    parser.add_argument(
        "--object-stiffness", type=float, default=250.0, metavar="NM_RAD", help="in N·m/rad"
    )
    parser.add_argument(
        "--motor-type",
        default=DM4310.name,
        metavar="TYPE",
        help=f"type of the motor: {', '.join(MOTOR_TYPES)} (default: %(default)s)",
    )
    parser.add_argument(
        "--watchdog",
        type=float,
        default=0.1,
        metavar="S",
        help="time without a command after which the motor faults, in its register TIMEOUT; 0.4 "
        "bears a busy machine (default: %(default)s)",
    )
    parser.add_argument(
        "--comm-loss",
        type=float,
        metavar="S",
        help="time after which it really faults, whatever the register holds; 0.1, 0.4 and 0.9 "
        "were seen, 0 is never (default: the register's)",
    )
    parser.add_argument(
        "--idle-loss",
        type=float,
        default=0.0,
        metavar="S",
        help="time without a command after which it faults while it is disabled, as motors do "
        "after about 0.9; 0 is never (default: 0)",
    )
    parser.add_argument(
        "--unasked-hz",
        type=float,
        default=0.0,
        metavar="HZ",
        help="how often it reports by itself while it is enabled; about 10 was seen (default: 0)",
    )
    parser.add_argument("--can-id", type=_identifier, default=0x08, help="the motor's id")
    parser.add_argument("--master-id", type=_identifier, default=0x18, help="id of its answers")
    return parser


def _identifier(text: str) -> int:
    """Return the number of an identifier, for example 8 or 0x08."""
    return int(text, 0)


def _say(text: str) -> None:
    print(f"litegrip-sim: {text}", file=sys.stderr, flush=True)


@contextlib.contextmanager
def _set_by_signals(stop: StopSignal) -> Iterator[None]:
    """Take SIGTERM and SIGINT as a request to end; afterwards restore the old handlers."""
    before = {
        number: signal.signal(number, lambda *_: stop.set())
        for number in (signal.SIGTERM, signal.SIGINT)
    }
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


if __name__ == "__main__":
    sys.exit(main())
