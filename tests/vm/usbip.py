"""USB/IP, the side of the device: requests of the kernel's `vhci_hcd` in, answers out.

Only what a device with a control endpoint and one pair of bulk endpoints needs. The kernel is given
one end of a socket pair; what it sends there is in Documentation/usb/usbip_protocol.rst.
"""

from __future__ import annotations

import errno
import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

CMD_SUBMIT, CMD_UNLINK, RET_SUBMIT, RET_UNLINK = 1, 2, 3, 4
DIRECTION_OUT, DIRECTION_IN = 0, 1
FULL_SPEED = 2

_SUBMIT = struct.Struct(">5I I4i 8s")
_ANSWER = struct.Struct(">5I 5i 8x")
_UNLINK = struct.Struct(">5I I 24x")


@dataclass(frozen=True)
class Setup:
    """What a control transfer begins with."""

    request_type: int
    request: int
    value: int
    index: int
    length: int

    @classmethod
    def parse(cls, data: bytes) -> Setup:
        """Read the eight bytes."""
        return cls(*struct.unpack("<BBHHH", data))

    @property
    def is_in(self) -> bool:
        """True if the device is to send something."""
        return bool(self.request_type & 0x80)


@dataclass(frozen=True)
class Handlers:
    """What the device does.

    `control` returns its answer, or None for a stall; `bulk_in` a packet for the host, or None
    while there is none.
    """

    control: Callable[[Setup, bytes], bytes | None]
    bulk_out: Callable[[bytes], None]
    bulk_in: Callable[[], bytes | None]


class Endpoints:
    """The transfers of one plugged device, in pieces as a socket gives them.

    A transfer towards the host waits until there is something to send; the host can take it back.
    """

    def __init__(self, handlers: Handlers) -> None:
        self._handlers = handlers
        self._input = bytearray()
        self._waiting: deque[int] = deque()

    def feed(self, data: bytes) -> bytes:
        """Take bytes of the host; return what is to be sent to it."""
        self._input += data
        output = bytearray()
        while (request := self._take()) is not None:
            output += self._carry_out(*request)
        return bytes(output) + self.flush()

    def flush(self) -> bytes:
        """Return the packets for which the host is waiting, as they are to be sent."""
        output = bytearray()
        while self._waiting and (packet := self._handlers.bulk_in()) is not None:
            output += _answer(RET_SUBMIT, self._waiting.popleft(), 0, len(packet)) + packet
        return bytes(output)

    def _take(self) -> tuple[bytes, bytes] | None:
        """Take a whole request off the input: its header, and the data behind it."""
        if len(self._input) < _SUBMIT.size:
            return None
        header = bytes(self._input[: _SUBMIT.size])
        command, _, _, direction, _, _, length, *_ = _SUBMIT.unpack(header)
        size = _SUBMIT.size
        if command == CMD_SUBMIT and direction == DIRECTION_OUT:
            size += length
        if len(self._input) < size:
            return None
        data = bytes(self._input[_SUBMIT.size : size])
        del self._input[:size]
        return header, data

    def _carry_out(self, header: bytes, data: bytes) -> bytes:
        command, number, _, direction, endpoint, _, length, *_, setup = _SUBMIT.unpack(header)
        if command == CMD_UNLINK:
            return self._unlink(number, _UNLINK.unpack(header)[5])
        if command != CMD_SUBMIT:
            raise ValueError(f"USB/IP command {command} is none of a host's: 1 or 2 is")
        if endpoint == 0:
            return self._control(number, Setup.parse(setup), data)
        if direction == DIRECTION_IN:
            self._waiting.append(number)
            return b""
        self._handlers.bulk_out(data)
        return _answer(RET_SUBMIT, number, 0, length)

    def _control(self, number: int, setup: Setup, data: bytes) -> bytes:
        answer = self._handlers.control(setup, data)
        if answer is None:
            return _answer(RET_SUBMIT, number, -errno.EPIPE, 0)
        if not setup.is_in:
            return _answer(RET_SUBMIT, number, 0, len(data))
        answer = answer[: setup.length]
        return _answer(RET_SUBMIT, number, 0, len(answer)) + answer

    def _unlink(self, number: int, unlinked: int) -> bytes:
        """Take a transfer back, where it has not been answered yet."""
        if unlinked not in self._waiting:
            return _answer(RET_UNLINK, number, 0, 0)
        self._waiting.remove(unlinked)
        return _answer(RET_UNLINK, number, -errno.ECONNRESET, 0)


def _answer(command: int, number: int, status: int, length: int) -> bytes:
    return _ANSWER.pack(command, number, 0, 0, 0, status, length, 0, 0, 0)
