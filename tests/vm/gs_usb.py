"""A candleLight adapter: what its firmware tells the host's gs_usb driver, and does with frames.

Pure: no socket, no clock, no bus. The wire format is that of the kernel's drivers/net/can/usb/
gs_usb.c, the figures are those of a candleLight (STM32F072, 48 MHz).
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass

from litegripd.model.motor import CanFrame
from tests.vm.usbip import Setup

VENDOR_ID, PRODUCT_ID = 0x1D50, 0x606F
IN, OUT = 1, 2
"""The numbers of the bulk endpoints."""

HOST_FORMAT, BITTIMING, MODE, BERR, BT_CONST, DEVICE_CONFIG, GET_STATE = 0, 1, 2, 3, 4, 5, 14
LISTEN_ONLY, LOOP_BACK, STATES = 1 << 0, 1 << 1, 1 << 13
CLOCK_HZ = 48_000_000
BITRATE = 1_000_000

ERROR_FLAG = 0x2000_0000
NOT_STANDARD = 0xE000_0000
"""Extended, remote and error frames: not the motor's."""
ERROR_CONTROLLER, ERROR_PROTOCOL, ERROR_BUS_OFF, ERROR_BUS = 0x04, 0x08, 0x40, 0x80
CONTROLLER_TX_WARNING, CONTROLLER_TX_PASSIVE = 0x08, 0x20
PROTOCOL_STUFF = 0x04
WARNING_AT, PASSIVE_AT, BUS_OFF_AT = 96, 128, 256
"""Errors in sending, by which a controller warns, then is passive, then leaves the bus."""

ERROR_ACTIVE, BUS_OFF, STOPPED = 0, 3, 4
"""What the firmware calls the states of its controller, of those that this one stays in."""

_FRAME = struct.Struct("<IIBBBB8s")
_RECEIVED = 0xFFFF_FFFF
_DEVICE, _CONFIGURATION, _STRING = 1, 2, 3
_GET_DESCRIPTOR, _GET_STATUS, _GET_CONFIGURATION = 6, 0, 8
_TAKEN = frozenset({1, 3, 5, 9, 11})  # clear and set feature, address, configuration, interface
_SERIAL_INDEX = 3


@dataclass(frozen=True)
class Identity:
    """What USB tells of the adapter."""

    serial: str
    maker: str = "emulated"
    product: str = "candleLight USB to CAN adapter"

    def device_descriptor(self) -> bytes:
        """Tell which device it is: USB 2.0, class by the interface, packets of 64 bytes."""
        ids = (VENDOR_ID, PRODUCT_ID, 0x0100)
        return struct.pack("<BBHBBBBHHHBBBB", 18, 1, 0x0200, 0, 0, 0, 64, *ids, 1, 2, 3, 1)

    @staticmethod
    def configuration_descriptor() -> bytes:
        """Tell of the one interface, which is the vendor's own, with two bulk endpoints."""
        interface = struct.pack("<BBBBBBBBB", 9, 4, 0, 0, 2, 0xFF, 0xFF, 0xFF, 0)
        ends = (0x80 | IN, OUT)
        body = interface + b"".join(struct.pack("<BBBBHB", 7, 5, end, 2, 64, 0) for end in ends)
        return struct.pack("<BBHBBBBB", 9, 2, 9 + len(body), 1, 1, 0, 0x80, 75) + body

    def string_descriptor(self, index: int) -> bytes | None:
        """Return one of its strings; index 0 is the language, English."""
        texts = {1: self.maker, 2: self.product, _SERIAL_INDEX: self.serial}
        if index == 0:
            return struct.pack("<BBH", 4, _STRING, 0x0409)
        if index not in texts:
            return None
        text = texts[index].encode("utf-16-le")
        return struct.pack("<BB", 2 + len(text), _STRING) + text


class Adapter:
    """One adapter with one channel, between the host and a bus.

    `carry` puts a frame of the host on the bus. While the wires are `shorted`, and at another bit
    rate than the motor's, whatever is sent is an error; at 256 of them the controller has left the
    bus, and stays away until the host starts it anew.
    """

    def __init__(self, identity: Identity, carry: Callable[[CanFrame], None]) -> None:
        self.identity = identity
        self.shorted = False
        self._to_host: deque[bytes] = deque()
        self._carry = carry
        self.unplug()

    def unplug(self) -> None:
        """Lose all that was set, as without power."""
        self.state = STOPPED
        self.bitrate = 0
        self.errors_in_sending = 0
        self._configuration = 0
        self._to_host.clear()

    def control(self, setup: Setup, data: bytes) -> bytes | None:
        """Answer a control transfer; None for what is not known."""
        kind = setup.request_type & 0x60
        if kind == 0x00:
            return self._standard(setup)
        if kind == 0x40:
            return self._tell(setup.request) if setup.is_in else self._set(setup.request, data)
        return None

    def from_host(self, packet: bytes) -> None:
        """Send a frame of the host's; it comes back to the host once it has been sent."""
        _, can_id, length, *_, data = _FRAME.unpack(packet[: _FRAME.size])
        if self.state == STOPPED:
            return
        if not self._is_on_bus():
            self._fail_to_send()
            return
        self._to_host.append(packet[: _FRAME.size])
        if not can_id & NOT_STANDARD:
            self._carry(CanFrame(can_id, data[:length]))

    def from_bus(self, frame: CanFrame) -> None:
        """Let a frame of the bus go to the host."""
        if self._is_on_bus():
            self._report(frame.can_id, frame.data)

    def next_packet(self) -> bytes | None:
        """Take the next packet for the host, None while there is none."""
        return self._to_host.popleft() if self._to_host else None

    def report_error(self) -> None:
        """Let the host know of an error in a frame of the bus."""
        if self.state not in (STOPPED, BUS_OFF):
            self._report_error(ERROR_PROTOCOL | ERROR_BUS, third=PROTOCOL_STUFF)

    def _is_on_bus(self) -> bool:
        is_running = self.state not in (STOPPED, BUS_OFF)
        return is_running and not self.shorted and self.bitrate == BITRATE

    def _fail_to_send(self) -> None:
        """Send with an error again and again: from active by way of passive off the bus.

        The host's frame is lost with it, and never confirmed.
        """
        if self.state == BUS_OFF:
            return
        self.errors_in_sending = WARNING_AT
        self._report_error(ERROR_CONTROLLER, second=CONTROLLER_TX_WARNING)
        self.errors_in_sending = PASSIVE_AT
        self._report_error(ERROR_CONTROLLER, second=CONTROLLER_TX_PASSIVE)
        self.state, self.errors_in_sending = BUS_OFF, BUS_OFF_AT
        self._report_error(ERROR_BUS_OFF)

    def _report_error(self, kind: int, *, second: int = 0, third: int = 0) -> None:
        counter = min(self.errors_in_sending, 255)
        self._report(ERROR_FLAG | kind, bytes((0, second, third, 0, 0, 0, counter, 0)))

    def _report(self, can_id: int, data: bytes) -> None:
        self._to_host.append(
            _FRAME.pack(_RECEIVED, can_id, len(data), 0, 0, 0, data.ljust(8, b"\0"))
        )

    def _standard(self, setup: Setup) -> bytes | None:
        """Answer what every USB device knows."""
        if setup.request == _GET_DESCRIPTOR and setup.is_in:
            return self._descriptor(setup.value >> 8, setup.value & 0xFF)
        if setup.request == _GET_STATUS and setup.is_in:
            return bytes(2)
        if setup.request == _GET_CONFIGURATION and setup.is_in:
            return bytes((self._configuration,))
        if setup.request in _TAKEN and not setup.is_in:
            if setup.request == 9:
                self._configuration = setup.value
            return b""
        return None

    def _descriptor(self, kind: int, index: int) -> bytes | None:
        if kind == _DEVICE:
            return self.identity.device_descriptor()
        if kind == _CONFIGURATION:
            return self.identity.configuration_descriptor()
        return self.identity.string_descriptor(index) if kind == _STRING else None

    def _tell(self, request: int) -> bytes | None:
        if request == DEVICE_CONFIG:
            return struct.pack("<4BII", 0, 0, 0, 0, 2, 1)
        if request == BT_CONST:
            features = LISTEN_ONLY | LOOP_BACK | STATES
            return struct.pack("<10I", features, CLOCK_HZ, 1, 16, 1, 8, 4, 1, 1024, 1)
        if request == GET_STATE:
            return struct.pack("<3I", self.state, 0, min(self.errors_in_sending, 255))
        return None

    def _set(self, request: int, data: bytes) -> bytes | None:
        if request == BITTIMING:
            propagation, phase_1, phase_2, _, prescaler = struct.unpack("<5I", data)
            self.bitrate = CLOCK_HZ // (prescaler * (1 + propagation + phase_1 + phase_2))
        elif request == MODE:
            self._start_or_stop(is_started=struct.unpack("<2I", data)[0] == 1)
        elif request not in (HOST_FORMAT, BERR):
            return None
        return b""

    def _start_or_stop(self, *, is_started: bool) -> None:
        self.state = ERROR_ACTIVE if is_started else STOPPED
        self.errors_in_sending = 0
        self._to_host.clear()
