"""The loop that drives motors on a bus, which is the daemon's: every use raises."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, ClassVar

from .._refused import Refused

__all__ = ["MotorController"]


class MotorController(Refused):
    """Motors on one bus. `CommandError` says which call of `LiteGrip` does the same."""

    _INSTEAD: ClassVar[Mapping[str, str]] = {
        "add_motor": "LiteGrip(channel, can_id).connect()",
        "remove_motor": "LiteGrip.disconnect()",
        "get_motor": "LiteGrip.get_state()",
        "get_motor_by_can_id": "LiteGrip.get_state()",
        "motors": "LiteGrip.get_info()",
        "send_command": "LiteGrip.enable(), disable() and clear_fault()",
        "enable": "LiteGrip.enable()",
        "disable": "LiteGrip.disable()",
        "clear_fault": "LiteGrip.clear_fault()",
        "set_zero": "LiteGrip.write_zero()",
        "refresh_status": "LiteGrip.refresh_status()",
        "switch_control_mode": "nothing: the daemon drives the motor in its mode MIT",
        "control_mit": "LiteGrip.send_mit_frame(q, kp, kd, dq, tau)",
        "read_param": "LiteGrip.read_param(rid)",
        "write_param": "nothing: the daemon writes no register of the motor for programs",
        "save_params": "nothing: the daemon writes no register of the motor for programs",
        "poll": "LiteGrip.poll()",
        "poll_until": "LiteGrip.poll(timeout_s)",
        "close": "LiteGrip.disconnect()",
    }

    def __init__(self, transport: Any = None) -> None:
        super().__init__()
        self.transport = transport
