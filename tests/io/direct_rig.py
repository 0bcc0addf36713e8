"""A `DirectBus` on fake adapters, which give and raise what a test says."""

import errno
from collections import deque

import can
import pytest

from litegripd.io.can import bus as direct_bus
from litegripd.io.can.bus import DirectBus
from litegripd.model.motor import BusSettings, CanFrame

FRAME = CanFrame(0x08, bytes(range(8)))
MESSAGE = can.Message(arbitration_id=0x18, data=bytes(8), is_extended_id=False)
SETTINGS = BusSettings("socketcan", "can0", 1_000_000)


class FakeBus:
    """An adapter that gives and raises what a test says."""

    def __init__(self) -> None:
        self.to_receive: deque[can.Message | Exception] = deque()
        self.send_error: Exception | None = None
        self.sent: list[can.Message] = []
        self.is_open = True

    def recv(self, timeout: float) -> can.Message | None:
        assert timeout == 0
        if not self.to_receive:
            return None
        item = self.to_receive.popleft()
        if isinstance(item, Exception):
            raise item
        return item

    def send(self, message: can.Message) -> None:
        if self.send_error is not None:
            raise self.send_error
        self.sent.append(message)

    def shutdown(self) -> None:
        self.is_open = False
        raise can.CanOperationError("gone", error_code=errno.EBADF)


class Rig:
    """A bus on fake adapters; `open_error` makes opening fail."""

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        monkeypatch.setattr(direct_bus, "open_bus", self.open)
        self.opened: list[FakeBus] = []
        self.open_error: Exception | None = None
        self.now_s = 100.0
        self.bus = DirectBus(SETTINGS)

    def open(self, settings: BusSettings) -> FakeBus:
        assert settings is SETTINGS
        if self.open_error is not None:
            raise self.open_error
        self.opened.append(FakeBus())
        return self.opened[-1]

    @property
    def state(self) -> str:
        return self.bus.condition.state

    def is_up(self) -> bool:
        return self.bus.condition.is_usable

    @property
    def fake(self) -> FakeBus:
        return self.opened[-1]

    def tick(self, after_s: float = 0.005) -> list[CanFrame]:
        self.now_s += after_s
        received = self.bus.receive(self.now_s)
        self.bus.send((FRAME,), self.now_s)
        return received


def operation_error(code: int | None, text: str = "failed") -> can.CanOperationError:
    return can.CanOperationError(text, error_code=code)
