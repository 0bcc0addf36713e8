"""Serves a simulated gripper in real time: on a pseudo-terminal as an SLCAN adapter, or on a bus.

Here live the simulator's file descriptors and its clock. One thread, no timer: each frame advances
the physics to its own time, and a pause between frames is bridged every `ADVANCE_S`.
"""

from __future__ import annotations

import os
import select
import time
import tty
from collections.abc import Callable

import can

from litegripd.model.frame import CanFrame
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.slcan import SlcanDevice

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
    never holds up the simulation.
    """

    def __init__(self, gripper: SimulatedGripper) -> None:
        self._gripper = gripper
        self._device = SlcanDevice()
        self._unsent = b""
        self.dropped = 0
        self._fd, client_fd = os.openpty()
        self.path = os.ttyname(client_fd)
        tty.setraw(client_fd)
        os.set_blocking(self._fd, False)
        # Without a client the terminal reports a hang-up, which tells when one leaves.
        os.close(client_fd)

    def close(self) -> None:
        """Close the terminal; its path vanishes."""
        os.close(self._fd)

    def run(self, stop: StopSignal) -> None:
        """Serve until `stop` is set."""
        poller = select.poll()
        poller.register(self._fd, select.POLLIN)
        poller.register(stop.read_fd, select.POLLIN)
        pause = select.poll()
        pause.register(stop.read_fd, select.POLLIN)
        while not stop.is_set:
            events = dict(poller.poll(ADVANCE_S * 1000))
            event = events.get(self._fd, 0)
            if event & select.POLLIN:
                self._serve_input()
            elif event & select.POLLHUP:
                self._device.reset()
                self._unsent = b""
                self._gripper.advance(time.monotonic())
                pause.poll(ADVANCE_S / 2 * 1000)
            else:
                self._gripper.advance(time.monotonic())

    def _serve_input(self) -> None:
        try:
            data = os.read(self._fd, _READ_BYTES)
        except OSError:
            return  # The client left between poll and read; poll reports that next.
        now_s = time.monotonic()
        result = self._device.feed(data)
        output = bytearray(result.reply)
        for frame in result.frames:
            for answer in self._gripper.receive(now_s, frame):
                output += self._device.encode(answer, now_s)
        if output:
            self._write(bytes(output))

    def _write(self, output: bytes) -> None:
        """Write without waiting; what does not fit is dropped in whole answers and counted."""
        if self._unsent:
            self._unsent = self._unsent[self._write_some(self._unsent) :]
        if self._unsent:
            self.dropped += 1
            return
        written = self._write_some(output)
        if written == 0:
            self.dropped += 1
        else:
            self._unsent = output[written:]

    def _write_some(self, output: bytes) -> int:
        try:
            return os.write(self._fd, output)
        except OSError:
            return 0  # Full, or nobody there.


def serve_bus(gripper: SimulatedGripper, bus: can.BusABC, is_stopped: Callable[[], bool]) -> None:
    """Answer on an open bus as the motor would, until `is_stopped` says so.

    Raises `can.CanError` when the bus fails.
    """
    while not is_stopped():
        message = bus.recv(timeout=ADVANCE_S)
        now_s = time.monotonic()
        gripper.advance(now_s)
        if message is None or _is_foreign(message):
            continue
        frame = CanFrame(message.arbitration_id, bytes(message.data))
        for answer in gripper.receive(now_s, frame):
            bus.send(
                can.Message(arbitration_id=answer.can_id, is_extended_id=False, data=answer.data)
            )


def _is_foreign(message: can.Message) -> bool:
    """Whether this is anything but a classic data frame of a standard id."""
    return (
        message.is_error_frame or message.is_remote_frame or message.is_extended_id or message.is_fd
    )
