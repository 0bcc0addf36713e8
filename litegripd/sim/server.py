"""Serves a simulated gripper in real time: on a pseudo-terminal as an SLCAN adapter, or on a bus.

Here live the simulator's file descriptors and its clock. One thread, no timer: each frame advances
the physics to its own time, and a pause between frames is bridged every `ADVANCE_S`. `SlcanDevice`
is the device side of SLCAN, the serial protocol of Lawicel's CAN adapters, without a port or a
clock: a command ends with a carriage return; the answer is one, too, or BEL for a refusal; an
accepted frame is answered with z or Z. Classic frames only.
"""

from __future__ import annotations

import os
import select
import time
import tty
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import can

from litegripd.model.motor import CanFrame
from litegripd.sim.interface import Arrival, MotorWire

OK, ERROR = b"\r", b"\a"

# The longest command: T, 8 digits of id, a length, 16 digits of data, and 4 of a time stamp.
_LONGEST = 32
_HEX = frozenset(b"0123456789abcdefABCDEF")
_TIMESTAMP_MS = 60_000  # Lawicel: the time stamp counts milliseconds and restarts each minute


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
        """Reset, as when the host closes the port."""
        self._line = bytearray()
        self._overlong = False
        self.is_open = False
        """True if the host has opened the channel."""
        self._listen_only = False
        self._timestamps = False

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
        if not self.is_open:
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
            return b"F00" + OK if self.is_open else ERROR
        if letter == b"Z":
            return self._set_timestamps(rest)
        return OK if self._switch(letter, rest) else ERROR

    def _switch(self, letter: bytes, rest: bytes) -> bool:
        """Open, close or set the bit rate; return True if that was allowed."""
        if letter in (b"O", b"L") and not rest and not self.is_open:
            self.is_open = True
            self._listen_only = letter == b"L"
            return True
        if letter == b"C" and not rest and self.is_open:
            self.is_open = False
            return True
        if letter == b"S":
            return not self.is_open and len(rest) == 1 and rest in b"012345678"
        if letter == b"s":
            return not self.is_open and len(rest) == 4 and _HEX.issuperset(rest)
        return False

    def _set_timestamps(self, rest: bytes) -> bytes:
        if self.is_open or rest not in (b"0", b"1"):
            return ERROR
        self._timestamps = rest == b"1"
        return OK

    def _transmit(self, letter: bytes, rest: bytes, frames: list[CanFrame]) -> bytes:
        """Take a frame from the host; only classic data frames mean anything to the motor."""
        digits = 8 if letter in b"TR" else 3
        most = 0x1FFFFFFF if letter in b"TR" else 0x7FF
        if not self.is_open or self._listen_only or not _HEX.issuperset(rest):
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


ADVANCE_S = 0.02
_READ_BYTES = 4096


class StopSignal:
    """Lets another context, for example a signal handler, end a server's loop at once."""

    def __init__(self) -> None:
        self.read_fd, self._write_fd = os.pipe()
        os.set_blocking(self._write_fd, False)
        self.is_set = False

    def set(self) -> None:
        """Ask the loop to end; safe from a signal handler, and more than once."""
        if not self.is_set:
            self.is_set = True
            os.write(self._write_fd, b"\0")

    def close(self) -> None:
        """Close the pipe."""
        os.close(self.read_fd)
        os.close(self._write_fd)


class PtyServer:
    """An SLCAN adapter on a pseudo-terminal, with the gripper on its bus.

    Clients may come and go. A client that does not read loses frames, which `dropped` counts; it
    never holds up the simulation. `link` is a symbolic link that leads to the terminal while there
    is one; `announce` gets its path.

    Raises `OSError` when there is no terminal, or the link cannot be made.
    """

    def __init__(
        self,
        wire: MotorWire,
        link: Path | None = None,
        announce: Callable[[str], None] = lambda _path: None,
    ) -> None:
        self.wire = wire
        self.dropped = 0
        self._device = SlcanDevice()
        self._unsent = b""
        self._link = link
        self._announce = announce
        self._fd: int | None = None
        self._path = ""
        self.plug()

    def plug(self) -> None:
        """Open a terminal. Raises `ValueError` when there is one."""
        if self._fd is not None:
            raise ValueError("the adapter is plugged in already")
        fd, client_fd = os.openpty()
        try:
            self._path = os.ttyname(client_fd)
            tty.setraw(client_fd)
            os.set_blocking(fd, False)
            if self._link is not None:
                self._link.unlink(missing_ok=True)
                self._link.symlink_to(self._path)
        except OSError:
            os.close(fd)
            raise
        finally:
            # Without a client the terminal reports a hang-up: so a leaving client is noticed.
            os.close(client_fd)
        self._fd = fd
        self._announce(self._path)

    def unplug(self) -> None:
        """Close the terminal; its path and the link vanish. Raises `ValueError` without one."""
        if self._fd is None:
            raise ValueError("the adapter is unplugged already")
        self.close()
        self.wire.lose_late()

    def inject(self, frame: CanFrame) -> None:
        """Let another node on the bus send a frame."""
        now_s = time.monotonic()
        self._tell([(now_s, frame), *self.wire.deliver(now_s, now_s, frame)])

    def close(self) -> None:
        """Close the terminal, where there is one."""
        if self._fd is None:
            return
        link = self._link
        if link is not None and link.is_symlink() and str(link.readlink()) == self._path:
            link.unlink()
        os.close(self._fd)
        self._fd = None
        self._forget_client()

    def run(self, stop: StopSignal) -> None:
        """Serve until `stop` is set."""
        while not stop.is_set:
            now_s = time.monotonic()
            self._tell(self.wire.late(now_s))
            wait_s = min(ADVANCE_S, max(self.wire.next_s - now_s, 0.0))
            if self._fd is None:
                _wait(wait_s, stop.read_fd)
                self.wire.gripper.advance(time.monotonic())
                continue
            event = _wait(wait_s, stop.read_fd, self._fd).get(self._fd, 0)
            if event & select.POLLIN:
                self._serve_input(self._fd)
            else:
                self.wire.gripper.advance(time.monotonic())
                if event & select.POLLHUP:
                    self._forget_client()
                    _wait(ADVANCE_S / 2, stop.read_fd)

    def _forget_client(self) -> None:
        self._device.reset()
        self._unsent = b""

    def _serve_input(self, fd: int) -> None:
        try:
            data = os.read(fd, _READ_BYTES)
        except OSError:
            return  # The client left between poll and read; poll reports that next.
        now_s = time.monotonic()
        result = self._device.feed(data)
        answers: list[Arrival] = []
        for frame in result.frames:
            answers += self.wire.carry(now_s, now_s, frame)
        self._tell(answers, result.reply)

    def _tell(self, arrivals: list[Arrival], before: bytes = b"") -> None:
        """Report frames to the client, behind what answers its own lines."""
        output = before + b"".join(self._device.encode(frame, at_s) for at_s, frame in arrivals)
        if output and self._fd is not None:
            self._write(self._fd, output)

    def _write(self, fd: int, output: bytes) -> None:
        """Write without waiting; what does not fit is dropped in whole answers and counted."""
        if self._unsent:
            self._unsent = self._unsent[_write_some(fd, self._unsent) :]
        if self._unsent:
            self.dropped += 1
            return
        written = _write_some(fd, output)
        if written == 0:
            self.dropped += 1
        else:
            self._unsent = output[written:]


class BusServer:
    """The motor on an open bus of python-can."""

    def __init__(self, wire: MotorWire, bus: can.BusABC) -> None:
        self.wire = wire
        self._bus = bus

    def run(self, is_stopped: Callable[[], bool]) -> None:
        """Answer as the motor would, until `is_stopped` returns True.

        Raises `can.CanError` when the bus fails.
        """
        while not is_stopped():
            self._send(self.wire.late(time.monotonic()))
            wait_s = min(ADVANCE_S, max(self.wire.next_s - time.monotonic(), 0.0))
            message = self._bus.recv(timeout=wait_s)
            now_s = time.monotonic()
            self.wire.gripper.advance(now_s)
            if message is not None and not _is_foreign(message):
                frame = CanFrame(message.arbitration_id, bytes(message.data))
                self._send(self.wire.carry(now_s, now_s, frame))

    def _send(self, arrivals: list[Arrival]) -> None:
        for _, frame in arrivals:
            self._bus.send(
                can.Message(arbitration_id=frame.can_id, is_extended_id=False, data=frame.data)
            )


def _wait(timeout_s: float, *fds: int) -> dict[int, int]:
    """Wait until one of `fds` can be read or fails; return the events by descriptor."""
    poller = select.poll()
    for fd in fds:
        poller.register(fd, select.POLLIN)
    return dict(poller.poll(timeout_s * 1000))


def _write_some(fd: int, output: bytes) -> int:
    try:
        return os.write(fd, output)
    except OSError:
        return 0  # Full, or nobody there.


def _is_foreign(message: can.Message) -> bool:
    """Return True if this is anything but a classic data frame of a standard id."""
    return (
        message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd
    )
