"""The lines by which a person or a test injects faults into a running simulator, as one table.

`parse` is pure: text in, an action out, carried out by its caller. `Console` reads the lines from a
file descriptor without waiting, and raises for none of them: a line that cannot be carried out is
answered with a sentence. The end of the input changes nothing.
"""

from __future__ import annotations

import os
import select
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Protocol

from litegripd.model.motor import CanFrame
from litegripd.sim import registers as reg
from litegripd.sim.faults import FrameFaults
from litegripd.sim.interface import MotorWire
from litegripd.sim.motor import REGISTER_CAN_ID, WRITE


class Simulator(Protocol):
    """What the commands act on: a gripper behind its wire, and the adapter that serves it."""

    wire: MotorWire

    def inject(self, frame: CanFrame) -> None:
        """Let another node on the bus send a frame."""

    def unplug(self) -> None:
        """Let the adapter vanish. Raises `ValueError` where that is not possible."""

    def plug(self) -> None:
        """Let the adapter come back. Raises `ValueError` where that is not possible."""


Action = Callable[[Simulator], str | None]
"""Carries a command out and returns what is to be said, if anything.

Raises `ValueError` for a figure out of range, or where the command is not possible now; it has
changed nothing then.
"""

_Reader = Callable[[Sequence[str]], Action]


@dataclass(frozen=True, slots=True)
class Entry:
    """One command: how it is written, what it does, and who reads what follows its name."""

    usage: str
    meaning: str
    read: _Reader


def parse(line: str) -> Action:
    """Read one line; a line without words does nothing.

    Raises `ValueError` for an unknown command, and for arguments that do not fit it.
    """
    words = line.split()
    if not words:
        return lambda _: None
    entry = TABLE.get(words[0])
    if entry is None:
        raise ValueError(f"unknown command {words[0]!r}; 'help' lists the commands")
    try:
        return entry.read(words[1:])
    except ValueError as error:
        raise ValueError(f"{error}; write: {entry.usage}") from None


def help_text() -> str:
    """Return one line for each command."""
    width = max(len(entry.usage) for entry in TABLE.values())
    return "\n".join(f"  {entry.usage:{width}}  {entry.meaning}" for entry in TABLE.values())


def _bare(act: Action) -> _Reader:
    """Read a command without arguments."""

    def read(words: Sequence[str]) -> Action:
        _expect(words, 0, 0)
        return act

    return read


def _with_number(act: Callable[[Simulator, float], None]) -> _Reader:
    """Read a command with one number."""

    def read(words: Sequence[str]) -> Action:
        _expect(words, 1, 1)
        value = _number(words[0])
        return lambda simulator: act(simulator, value)

    return read


def _with_integer(act: Callable[[Simulator, int], None]) -> _Reader:
    """Read a command with one whole number, for example 3 or 0xB."""

    def read(words: Sequence[str]) -> Action:
        _expect(words, 1, 1)
        value = _integer(words[0])
        return lambda simulator: act(simulator, value)

    return read


def _with_direction(act: Callable[[FrameFaults, float], None]) -> _Reader:
    """Read a command with a number and perhaps a direction; without one it is for both."""

    def read(words: Sequence[str]) -> Action:
        _expect(words, 1, 2)
        value, direction = _number(words[0]), words[1] if len(words) > 1 else "both"
        if direction not in ("to", "from", "both"):
            raise ValueError(f"{direction!r} is no direction")

        def do(simulator: Simulator) -> None:
            wire = simulator.wire
            if direction != "from":
                act(wire.to_motor, value)
            if direction != "to":
                act(wire.from_motor, value)

        return do

    return read


def _read_power(words: Sequence[str]) -> Action:
    _expect(words, 1, 1)
    if words[0] not in ("on", "off"):
        raise ValueError(f"power is 'on' or 'off', not {words[0]!r}")
    if words[0] == "off":
        return lambda simulator: simulator.wire.gripper.power_off()
    return lambda simulator: simulator.wire.gripper.power_on()


def _read_object(words: Sequence[str]) -> Action:
    _expect(words, 1, 2)
    if words == ["none"]:
        return lambda simulator: simulator.wire.gripper.remove_object()
    width_mm = _number(words[0])
    stiffness_nm_rad = _number(words[1]) if len(words) > 1 else 250.0
    return lambda simulator: simulator.wire.gripper.put_object(
        width_mm=width_mm, stiffness_nm_rad=stiffness_nm_rad
    )


def _read_comm_loss(words: Sequence[str]) -> Action:
    _expect(words, 1, 1)
    seconds = None if words == ["register"] else _number(words[0])
    return lambda simulator: simulator.wire.gripper.set_comm_loss(seconds)


def _read_inject(words: Sequence[str]) -> Action:
    _expect(words, 1, 1)
    can_id, mark, data = words[0].partition("#")
    try:
        frame = CanFrame(int(can_id, 16), bytes.fromhex(data))
    except ValueError:
        raise ValueError(f"{words[0]!r} is no frame in hexadecimal digits") from None
    if not mark or not 0 <= frame.can_id <= 0x7FF or len(frame.data) > 8:
        raise ValueError(f"{words[0]!r} is no frame of an id to 7FF and at most 8 bytes")
    return lambda simulator: simulator.inject(frame)


def _read_register(words: Sequence[str]) -> Action:
    _expect(words, 2, 2)
    number = _integer(words[0])
    raw = reg.encode(number, _number(words[1]))

    def write(simulator: Simulator) -> None:
        motor = simulator.wire.gripper.motor
        head = motor.registers.can_id.to_bytes(2, "little") + bytes((WRITE, number))
        simulator.inject(CanFrame(REGISTER_CAN_ID, head + raw))

    return write


def _silence(simulator: Simulator) -> None:
    simulator.wire.to_motor.drop(1.0)
    simulator.wire.from_motor.drop(1.0)


def _expect(words: Sequence[str], fewest: int, most: int) -> None:
    if not fewest <= len(words) <= most:
        expected = str(most) if fewest == most else f"{fewest} or {most}"
        raise ValueError(f"{len(words)} arguments in place of {expected}")


def _number(text: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise ValueError(f"{text!r} is no number") from None


def _integer(text: str) -> int:
    try:
        return int(text, 0)
    except ValueError:
        raise ValueError(f"{text!r} is no whole number") from None


_ENTRIES = (
    Entry(
        "drop P [to|from]",
        "lose frames with this probability, 0 to 1",
        _with_direction(FrameFaults.drop),
    ),
    Entry(
        "delay S [to|from]", "let frames arrive S seconds late", _with_direction(FrameFaults.delay)
    ),
    Entry("double P [to|from]", "let frames arrive twice", _with_direction(FrameFaults.double)),
    Entry("corrupt P [to|from]", "change the data of frames", _with_direction(FrameFaults.corrupt)),
    Entry("silence", "the motor hears and answers nothing, until 'drop 0'", _bare(_silence)),
    Entry(
        "inject ID#DATA", "another node sends a frame, such as 008#FFFFFFFFFFFFFFFD", _read_inject
    ),
    Entry(
        "register N VALUE",
        "another node writes a register, such as 32 100, a speed filter of 100 Hz",
        _read_register,
    ),
    Entry(
        "comm-loss S|register",
        "disarm S seconds after a command whatever register 9 says; 0 is never",
        _read_comm_loss,
    ),
    Entry(
        "idle-loss S",
        "let a disabled motor latch a communication loss after S seconds; 0 is never",
        _with_number(lambda simulator, seconds: simulator.wire.gripper.set_idle_loss(seconds)),
    ),
    Entry(
        "unasked HZ",
        "let the motor report so often by itself while it is enabled",
        _with_number(lambda simulator, rate_hz: simulator.wire.gripper.set_unasked(rate_hz)),
    ),
    Entry("power on|off", "switch the motor on or off altogether", _read_power),
    Entry(
        "turns N",
        "switch off and on; the position comes back off by N turns",
        _with_integer(lambda simulator, n: simulator.wire.gripper.power_cycle(turns=n)),
    ),
    Entry(
        "supply V",
        "set the voltage of the power stage; 24 is normal",
        _with_number(lambda simulator, volts: simulator.wire.gripper.set_supply(volts)),
    ),
    Entry(
        "weak SHARE",
        "let the motor make this share of the commanded torque; 1 ends it",
        _with_number(lambda simulator, share: simulator.wire.gripper.weaken(share)),
    ),
    Entry(
        "status CODE",
        "latch a fault, 0x8 to 0xE",
        _with_integer(lambda simulator, code: simulator.wire.gripper.latch_fault(code)),
    ),
    Entry(
        "heat C",
        "let the coil have this temperature in °C",
        _with_number(lambda simulator, coil_c: simulator.wire.gripper.heat_coil(coil_c)),
    ),
    Entry("jam", "let the rotor be stuck", _bare(lambda simulator: simulator.wire.gripper.jam())),
    Entry("free", "let it turn again", _bare(lambda simulator: simulator.wire.gripper.free())),
    Entry(
        "jump RAD",
        "let the reported position jump",
        _with_number(lambda simulator, angle_rad: simulator.wire.gripper.jump(angle_rad)),
    ),
    Entry(
        "push NM",
        "push the jaws by hand with this torque; 0 lets go",
        _with_number(lambda simulator, torque_nm: simulator.wire.gripper.push(torque_nm)),
    ),
    Entry(
        "object MM [NM_RAD]|none", "put an object between the jaws, or take it away", _read_object
    ),
    Entry(
        "yield MM",
        "let the object give way at once",
        _with_number(lambda simulator, way_mm: simulator.wire.gripper.give_way(way_mm)),
    ),
    Entry("unplug", "let the pseudo-terminal vanish", _bare(lambda simulator: simulator.unplug())),
    Entry("plug", "open a new one, with the same link", _bare(lambda simulator: simulator.plug())),
    Entry("help", "list the commands", _bare(lambda _: f"the commands are\n{help_text()}")),
)
TABLE: Mapping[str, Entry] = MappingProxyType({entry.usage.split()[0]: entry for entry in _ENTRIES})
"""The commands by their names."""


_READ_BYTES = 4096
_LONGEST = 200


class Console:
    """The commands that come from `fd`; without one, none come.

    `say` gets the messages: errors of a line, and help.
    """

    def __init__(self, fd: int | None, simulator: Simulator, say: Callable[[str], None]) -> None:
        self._fd = fd
        self._simulator = simulator
        self._say = say
        self._rest = b""
        self._poller = select.poll()
        if fd is not None:
            self._poller.register(fd, select.POLLIN)

    def serve(self) -> None:
        """Carry out the lines that have come."""
        if self._fd is None or not self._poller.poll(0) or _is_in_background(self._fd):
            return
        try:
            data = os.read(self._fd, _READ_BYTES)
        except OSError:
            data = b""  # A terminal that has gone ends the input as well.
        if not data:
            self._fd = None
            data = b"\n"  # A last line may lack its end.
        *lines, rest = (self._rest + data).split(b"\n")
        self._rest = rest[: _LONGEST + 1]
        for line in lines:
            self._carry_out(line)

    def _carry_out(self, line: bytes) -> None:
        try:
            if len(line) > _LONGEST:
                raise ValueError(f"a command has at most {_LONGEST} characters")
            said = parse(line.decode(errors="replace"))(self._simulator)
        except (ValueError, OSError) as error:
            said = str(error)
        if said is not None:
            self._say(said)


def _is_in_background(fd: int) -> bool:
    """Return True if the input is for another program: reading it would stop this process."""
    try:
        return os.isatty(fd) and os.tcgetpgrp(fd) != os.getpgrp()
    except OSError:
        return False  # A terminal that does not control this process stops nobody.
