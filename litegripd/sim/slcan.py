r"""The device side of SLCAN, the serial protocol of Lawicel's CAN adapters: bytes in, bytes out.

A pure core: no port, no clock. Commands end with `\r`; an answer is `\r` for yes and `\a` for no,
`z\r` and `Z\r` for a frame that was accepted. Classic frames only.
"""

from __future__ import annotations

from dataclasses import dataclass

from litegripd.model.frame import CanFrame

OK, ERROR = b"\r", b"\a"

# The longest command: T, 8 digits of id, a length, 16 digits of data, and 4 of a time stamp.
_LONGEST = 32
_HEX = frozenset(b"0123456789abcdefABCDEF")
_TIMESTAMP_MS = 60_000  # Lawicel: the time stamp counts milliseconds and starts anew each minute


@dataclass(frozen=True, slots=True)
class SlcanResult:
    """What came of some bytes from the host: bytes to send back, and frames for the bus."""

    reply: bytes
    frames: tuple[CanFrame, ...]


class SlcanDevice:
    """One adapter, closed at first. It never raises, whatever the host sends."""

    def __init__(self) -> None:
        self.reset()

    def reset(self) -> None:
        """Start anew, as when the host closes the port."""
        self._line = bytearray()
        self._overlong = False
        self._open = False
        self._listen_only = False
        self._timestamps = False

    @property
    def is_open(self) -> bool:
        """Whether the host has opened the channel."""
        return self._open

    def feed(self, data: bytes) -> SlcanResult:
        """Take bytes from the host, in whatever pieces they come."""
        reply = bytearray()
        frames: list[CanFrame] = []
        for byte in data:
            if byte != 0x0D:
                if len(self._line) < _LONGEST:
                    self._line.append(byte)
                else:
                    self._overlong = True
                continue
            line, overlong = bytes(self._line), self._overlong
            self._line.clear()
            self._overlong = False
            reply += ERROR if overlong else self._command(line, frames)
        return SlcanResult(bytes(reply), tuple(frames))

    def encode(self, frame: CanFrame, now_s: float) -> bytes:
        """Return the line that reports a frame of the bus to the host; nothing while closed."""
        if not self._open:
            return b""
        line = f"t{frame.can_id:03X}{len(frame.data):d}{frame.data.hex().upper()}"
        if self._timestamps:
            line += f"{int(now_s * 1000) % _TIMESTAMP_MS:04X}"
        return line.encode() + OK

    def _command(self, line: bytes, frames: list[CanFrame]) -> bytes:
        """Carry out one line and return its answer; an empty line is answered like by a modem."""
        if not line:
            return OK
        letter, rest = line[:1], line[1:]
        if letter in b"tTrR":
            return self._transmit(letter, rest, frames)
        if letter == b"V" and not rest:
            return b"V1013" + OK
        if letter == b"N" and not rest:
            return b"NSIM0" + OK
        if letter == b"F" and not rest:
            return b"F00" + OK if self._open else ERROR
        if letter == b"Z":
            return self._set_timestamps(rest)
        return OK if self._switch(letter, rest) else ERROR

    def _switch(self, letter: bytes, rest: bytes) -> bool:
        """Open, close or set the bit rate; return whether that was allowed."""
        if letter in (b"O", b"L") and not rest and not self._open:
            self._open = True
            self._listen_only = letter == b"L"
            return True
        if letter == b"C" and not rest and self._open:
            self._open = False
            return True
        if letter == b"S":
            return not self._open and len(rest) == 1 and rest in b"012345678"
        if letter == b"s":
            return not self._open and len(rest) == 4 and _HEX.issuperset(rest)
        return False

    def _set_timestamps(self, rest: bytes) -> bytes:
        if self._open or rest not in (b"0", b"1"):
            return ERROR
        self._timestamps = rest == b"1"
        return OK

    def _transmit(self, letter: bytes, rest: bytes, frames: list[CanFrame]) -> bytes:
        """Take a frame from the host; only classic data frames mean anything to the motor."""
        digits = 8 if letter in b"TR" else 3
        most = 0x1FFFFFFF if letter in b"TR" else 0x7FF
        if not self._open or self._listen_only or not _HEX.issuperset(rest):
            return ERROR
        if len(rest) <= digits or not ord("0") <= rest[digits] <= ord("8"):
            return ERROR
        can_id, count = int(rest[:digits], 16), rest[digits] - ord("0")
        data = rest[digits + 1 :]
        if can_id > most or len(data) != (count * 2 if letter in b"tT" else 0):
            return ERROR
        if letter == b"t":
            frames.append(CanFrame(can_id, bytes.fromhex(data.decode())))
        return (b"Z" if letter in b"TR" else b"z") + OK
