"""An SLCAN adapter: python-can opens it and sends by it; its lines are read and judged here.

A serial line has no checksum. python-can's reader raises another class of error for each kind of
damage, and one of them closes the adapter; and it passes over, in silence, what a device sends that
is no SLCAN adapter at all. Here damage is counted and nothing more, and an adapter that brings no
frame is judged by what it brings instead.
"""

import re
import time
from collections.abc import Iterator
from pathlib import Path

import can
from can.interfaces.slcan import slcanBus

from litegripd.model.motor import CanFrame

_FRAME = re.compile(rb"t([0-9A-Fa-f]{3})([0-8])((?:[0-9A-Fa-f]{2})*)")
_OTHER_FRAME = re.compile(rb"[TRrxdDbB][0-9A-Fa-f]{4,}")
"""Extended, remote and CAN FD frames: none is the motor's."""
_ANSWER = re.compile(rb"[zZ]?|[VvNF][0-9A-Za-z ._-]*")
"""Done; sent; version, serial number, status (Lawicel's protocol)."""
_SENT = (b"z", b"Z")
_LINE_END = re.compile(rb"([\r\n\a])")
"""CR by the protocol, CR LF or LF as others print it; a bell is a line that refuses."""
_TIME_STAMP = 4  # hex digits that some adapters add to a frame
_LONGEST_LINE = 256  # a CAN FD frame has 141
_REFUSED = b"\a"

_STRANGE_AT_MOST = 20
"""Lines that are no frames; an adapter that gives nothing else since it was opened is none."""
_ECHOED_AT_MOST = 2
_REFUSED_AT_MOST = 20
_NO_FRAME_S = 5.0
"""For so long damage may hide every frame; then opening the adapter again may help."""
_MUTE_AFTER_S = 1.0
"""An adapter answers the question for its version in milliseconds."""
_MUTE = (
    "nothing has come from the adapter since it was opened, not even an answer to the question for"
    " its version: it may be no SLCAN adapter, speak at another baud rate, or reset when its port"
    " is opened (sleep_after_open = 2 in [bus] waits for that)"
)
_OPENING = (4, 5)
"""Answers to the commands that python-can opens an adapter with: C, S8, an empty one, which some
pass over, O, and O again, which an open adapter may refuse."""
_SHOWN = 24


class AdapterLines:
    """Takes the bytes that come from an adapter apart, and judges those that are no frames.

    `commands` are those that were sent when it was opened: no adapter returns them.
    """

    def __init__(self, commands: frozenset[bytes], now_s: float) -> None:
        self.ignored = 0
        """Lines that are no data frames of classic CAN, damaged ones included."""
        self._commands = commands
        self._opened_s = now_s
        self._is_mute = True
        self._answers: list[bytes] = []
        self._has_version = False
        self._refusal: str | None = None
        self._rest = b""
        self._frames = 0
        self._strange = 0
        self._last_strange = b""
        self._echoed: set[bytes] = set()
        self._refused = 0
        self._good_s = now_s

    def take(self, data: bytes, now_s: float) -> Iterator[CanFrame]:
        """Take what has come; yield the frames in it."""
        self._is_mute = self._is_mute and not data
        parts = _LINE_END.split(self._rest + data)
        self._refused += data.count(_REFUSED)
        self._rest = parts.pop()
        for line, end in zip(parts[::2], parts[1::2], strict=True):
            stripped = line.strip(b"\0")  # what some drivers fill gaps with
            frame = _frame_in(stripped)
            if frame is not None:
                self._frames += 1
                self._strange = self._refused = 0
                self._good_s = now_s
                yield frame
            elif not _ANSWER.fullmatch(stripped):
                self._pass_over(stripped)
            elif stripped in _SENT:
                self._refused = 0
            elif not self._has_version:
                self._note_answer(stripped, end)
        if len(self._rest) > _LONGEST_LINE:
            self._pass_over(self._rest)
            self._rest = b""

    def _note_answer(self, line: bytes, end: bytes) -> None:
        """Keep the answers to the opening; the last of them is the version."""
        if not line:
            self._answers = [*self._answers, end][-max(_OPENING) - 1 :]
            return
        self._has_version = line[:1] in b"Vv"
        if not self._has_version or len(self._answers) not in _OPENING:
            return
        if self._answers[1] == _REFUSED:
            self._refusal = "the adapter refuses 1 Mbit/s (S8), the bit rate of the motor"
        elif self._answers[-2:] == [_REFUSED, _REFUSED]:
            self._refusal = "the adapter refuses to open the bus (O)"

    def _pass_over(self, line: bytes) -> None:
        self.ignored += 1
        if _OTHER_FRAME.fullmatch(line):
            return
        if line in self._commands:
            self._echoed.add(line)
        self._strange += 1
        self._last_strange = line

    def doubt(self, now_s: float) -> str:
        """Return what is doubtful about an adapter that has brought no frame yet, or nothing."""
        if self._frames:
            return ""
        if self._refusal is not None:
            return self._refusal
        if now_s - self._opened_s < _MUTE_AFTER_S:
            return ""
        if self._is_mute:
            return _MUTE
        if self._has_version or not (self._strange or self._rest):
            return ""
        shown = _shown(self._rest or self._last_strange)
        return f"it does not speak SLCAN, or at another baud rate, so far: no frame, but {shown}"

    def verdict(self, now_s: float) -> str | None:
        """Return why what is at the other end is of no use, or None while it may be."""
        shown = (
            f"{self._strange} lines that are no frames, the last one {_shown(self._last_strange)}"
        )
        if self._frames == 0 and len(self._echoed) >= _ECHOED_AT_MOST:
            return (
                "it returns what is sent to it: a console, a modem or a loop-back, no SLCAN adapter"
            )
        if self._frames == 0 and self._strange >= _STRANGE_AT_MOST:
            return f"it does not speak SLCAN, or at another baud rate: {shown}"
        if self._refused >= _REFUSED_AT_MOST:
            return (
                "the adapter refuses what it is to send: it has left the bus, nobody there"
                " acknowledges, or it does not know the bit rate"
            )
        if self._strange >= _STRANGE_AT_MOST and now_s - self._good_s >= _NO_FRAME_S:
            return f"nothing but damage for {_NO_FRAME_S:g} s: {shown}"
        return None


def _frame_in(line: bytes) -> CanFrame | None:
    found = _FRAME.fullmatch(line)
    if found is None:
        return None
    can_id, length, digits = int(found[1], 16), int(found[2]), found[3]
    if can_id > 0x7FF or len(digits) - 2 * length not in (0, _TIME_STAMP):
        return None
    return CanFrame(can_id, bytes.fromhex(digits[: 2 * length].decode()))


def _shown(line: bytes) -> str:
    return repr(line[:_SHOWN])[1:] + ("..." if len(line) > _SHOWN else "")


class SlcanBus(slcanBus):
    """python-can's bus for SLCAN with our own reading; `lines` keeps what has come."""

    def __init__(self, channel: str, **options: object) -> None:
        self._commands: set[bytes] = set()
        self._sends_commands = True
        baud_rate = channel.partition("@")[2]
        if "@" in channel and not baud_rate.isdecimal():
            raise ValueError(
                f"behind the @ of [bus] channel stands {baud_rate!r}, and it must be the adapter's"
                " baud rate, 115200 for example"
            )
        super().__init__(channel, **options)  # type: ignore[arg-type]
        self._write("V")
        self._sends_commands = False
        self.lines = AdapterLines(frozenset(self._commands - {b""}), time.monotonic())

    def read(self) -> list[CanFrame]:
        """Wait for bytes, as long as the port's own time-out says; return the frames in them."""
        port = self.serialPortOrig
        return list(self.lines.take(port.read(max(1, port.in_waiting)), time.monotonic()))

    def _write(self, string: str) -> None:
        if self._sends_commands:
            self._commands.add(string.encode())
        super()._write(string)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        raise NotImplementedError("frames are taken by `read`")


def holders(device: str) -> list[str]:
    """Return the other programs that have a device open, as far as this user may see."""
    target, own = Path(device).resolve(), Path("/proc/self").resolve()
    others = (process for process in Path("/proc").glob("[0-9]*") if process != own)
    return [name for process in others if (name := _name_if_open(process, target)) is not None]


def _name_if_open(process: Path, target: Path) -> str | None:
    """Return the name of a process that has a device open; None for another user's, too."""
    try:
        if all(link.readlink() != target for link in (process / "fd").iterdir()):
            return None
        name = (process / "comm").read_text(encoding="utf-8", errors="replace").strip()
    except OSError:  # it has ended, or is another user's
        return None
    return f"{name} (pid {process.name})"
