"""The bus: its frames can be made here, but only the daemon opens it."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, NoReturn

from .._refused import refuse

__all__ = ["CANFD_MTU", "CAN_MTU", "CAN_SFF_MASK", "CanFrame", "CanMode", "CanTransport"]

CAN_MTU = 16
CANFD_MTU = 72
CAN_SFF_MASK = 0x7FF


class CanMode(IntEnum):
    """Classic CAN, or CAN FD."""

    CAN = 0
    CANFD = 1


@dataclass
class CanFrame:
    """A frame of the bus."""

    can_id: int
    data: bytes
    is_extended: bool = False
    is_fd: bool = False
    timestamp: float = 0.0

    @property
    def dlc(self) -> int:
        """How many bytes of data it has."""
        return len(self.data)


class CanTransport:
    """A channel's bus, which is the daemon's: `open` raises `CommandError` that says the way."""

    def __init__(self, channel: str, mode: CanMode = CanMode.CAN) -> None:
        self.channel = channel
        self.mode = mode

    @property
    def is_open(self) -> bool:
        """False."""
        return False

    def open(self) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.open", "LiteGrip(channel).connect()")

    def close(self) -> None:
        """Do nothing: it is not open."""

    def set_id_filter(self, ids: Iterable[int]) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.set_id_filter", "candump, which hears the whole bus")

    def add_id_filter(self, can_id: int) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.add_id_filter", "candump, which hears the whole bus")

    def send(self, can_id: int, data: bytes, timeout: float = 0.1) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.send", "LiteGrip.send_mit_frame(q, kp, kd)")

    def send_multi(
        self, can_id: int, data: bytes, count: int, interval_s: float = 0.002
    ) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.send_multi", "LiteGrip.send_mit_frame(q, kp, kd)")

    def recv(self, timeout_s: float = 0.0) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.recv", "LiteGrip.poll() and LiteGrip.get_state()")

    def drain(self) -> NoReturn:
        """Raise `CommandError`."""
        refuse("CanTransport.drain", "LiteGrip.poll() and LiteGrip.get_state()")

    def __enter__(self) -> Any:
        self.open()

    def __exit__(self, *_error: object) -> None:
        self.close()
