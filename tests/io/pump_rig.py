"""A pump's two ends without its process: a child that says what a test wants, and its adapter."""

import os
import sys
from collections import deque
from collections.abc import Sequence

import can
import pytest

from litegripd.io.can import pump_main
from litegripd.io.can.pumped import pack_send_request
from litegripd.model.motor import CanFrame


class FakeChild:
    """A pump as `PumpedBus` sees it: `says` is what it has told and is not read yet."""

    pid = 1
    failure: str | None = None

    def __init__(self) -> None:
        self.says: deque[bytes] = deque()
        self.orders: list[bytes] = []
        self.has_ended = False

    def receive(self) -> bytes | None:
        return self.says.popleft() if self.says else None

    @property
    def is_cut(self) -> bool:
        return self.has_ended

    def send(self, packet: bytes) -> bool:
        self.orders.append(packet)
        return True

    def close(self, _grace_s: float = 0.0) -> None:
        self.has_ended = True


class PumpEndsError(BaseException):
    """Ends the pump's endless loops; no `Exception`, which a loop would handle."""


class FakeAdapter:
    """Gives and raises in turn what a test says, then ends the pump; so does its sending."""

    def __init__(
        self,
        receives: Sequence[can.Message | Exception | None] = (),
        send_errors: Sequence[Exception | None] = (),
    ) -> None:
        self.receives = deque(receives)
        self.send_errors = deque(send_errors)
        self.sent: list[bytes] = []

    def recv(self, _timeout: float) -> can.Message | None:
        if not self.receives:
            raise PumpEndsError
        item = self.receives.popleft()
        if isinstance(item, Exception):
            raise item
        return item

    def send(self, message: can.Message) -> None:
        error = self.send_errors.popleft() if self.send_errors else None
        if error is not None:
            raise error
        self.sent.append(bytes(message.data))


class Pump:
    """The loops of `pump_main` on a fake adapter; `told` is what the daemon was told."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.told: list[bytes] = []
        self._orders: deque[bytes] = deque()
        monkeypatch.setattr(sys, "argv", ["pump", '["gs_usb", "can9", 1000000, {}]'])
        monkeypatch.setattr(os, "_exit", self._end)

    def read(self, adapter: FakeAdapter) -> None:
        """Read the adapter until it has nothing more to give, or the pump ends itself."""
        with pytest.raises(PumpEndsError):
            pump_main._read(adapter, self)  # type: ignore[arg-type]

    def write(self, adapter: FakeAdapter, orders: Sequence[Sequence[CanFrame]]) -> None:
        """Carry out `orders`, none of which comes too late."""
        self._orders.extend(pack_send_request(frames, float("inf")) for frames in orders)
        with pytest.raises(PumpEndsError):
            pump_main._write(adapter, self, self, 0.01)  # type: ignore[arg-type]
        self.told = [packet for packet in self.told if packet[:1] != b"l"]

    def send(self, packet: bytes) -> None:
        """Take what the pump tells, as its socket does."""
        self.told.append(packet)

    def get(self) -> bytes:
        """Give the next order, as the pump's queue does."""
        if not self._orders:
            raise PumpEndsError
        return self._orders.popleft()

    def _end(self, _code: int) -> None:
        raise PumpEndsError
