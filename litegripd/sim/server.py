"""Serves a simulated gripper in real time: on a pseudo-terminal as an SLCAN adapter, or on a bus.

Here live the simulator's file descriptors and its clock. One thread, no timer: each frame advances
the physics to its own time, and a pause between frames is bridged every `ADVANCE_S`, when commands
are looked for as well.
"""

from __future__ import annotations

import os
import select
import time
import tty
from collections.abc import Callable
from pathlib import Path

import can

from litegripd.model.frame import CanFrame
from litegripd.sim.console import Console
from litegripd.sim.slcan import SlcanDevice
from litegripd.sim.wire import Arrival, MotorWire

ADVANCE_S = 0.02
_READ_BYTES = 4096


class StopSignal:
    """Lets another context, such as a signal handler, end a server's loop at once."""

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
    is one; `announce` is told its path.

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
            # Without a client the terminal reports a hang-up, which tells when one leaves.
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

    def run(self, stop: StopSignal, console: Console) -> None:
        """Serve until `stop` is set."""
        while not stop.is_set:
            console.serve()
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

    def run(self, is_stopped: Callable[[], bool], console: Console) -> None:
        """Answer as the motor would, until `is_stopped` says so.

        Raises `can.CanError` when the bus fails.
        """
        while not is_stopped():
            console.serve()
            self._send(self.wire.late(time.monotonic()))
            wait_s = min(ADVANCE_S, max(self.wire.next_s - time.monotonic(), 0.0))
            message = self._bus.recv(timeout=wait_s)
            now_s = time.monotonic()
            self.wire.gripper.advance(now_s)
            if message is not None and not _is_foreign(message):
                frame = CanFrame(message.arbitration_id, bytes(message.data))
                self._send(self.wire.carry(now_s, now_s, frame))

    def inject(self, frame: CanFrame) -> None:
        """Send a frame as another node on the bus would. Raises `can.CanError` when that fails."""
        now_s = time.monotonic()
        self._send([(now_s, frame), *self.wire.deliver(now_s, now_s, frame)])

    def unplug(self) -> None:
        """Raise `ValueError`: the adapter is not ours."""
        raise ValueError("only the pseudo-terminal of --pty can be unplugged")

    def plug(self) -> None:
        """Raise `ValueError`: the adapter is not ours."""
        raise ValueError("only the pseudo-terminal of --pty can be plugged in")

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
    """Whether this is anything but a classic data frame of a standard id."""
    return (
        message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd
    )
