"""A scripted daemon on a real Unix socket: it answers what a test tells it to."""

import contextlib
import json
import socket
import threading
import time
from collections.abc import Callable
from pathlib import Path
from types import TracebackType
from typing import Any

from litegripd.model.sentence import terms_of
from tests.geometry import SPAN_MM, STROKE_MM, WORK_MM

DEADLINE_S = 20.0

STATE: dict[str, Any] = {
    "seq": 7,
    "monotonic_s": 100.0,
    "feedback_s": 99.998,
    "age_s": 0.002,
    "stale": False,
    "bus": "up",
    "motor": "enabled",
    "error_code": 1,
    "status": "enabled",
    "enabled": True,
    "mode": "holding",
    "position_rad": 0.25,
    "velocity_rad_s": 0.0,
    "torque_nm": 0.5,
    "force_n": 5.0,
    "opening_mm": 35.25,
    "openness": 0.5,
    "driver_temperature_c": 31.0,
    "coil_temperature_c": 33.0,
    "command_rad": 0.26,
    "requested_rad": 0.27,
    "command_torque_nm": 0.4,
    "requested_torque_nm": 0.5,
    "force_set_n": None,
    "is_grasped": False,
    "clamp_n": None,
    "loss_detection": None,
    "loss_detection_from_n": None,
    "pressing_n": None,
    "limited": [],
    "calibrated": True,
    "mount": "reverse",
    "work_stroke_mm": None,
    "scale_doubt": None,
    "job": None,
    "stop": None,
    "stop_generation": 3,
}

MOVE = {
    "job": 4,
    "ok": True,
    "outcome": "pressed",
    "reached": False,
    "stalled": True,
    "target_rad": 1.05,
    "limit_rad": 1.0,
    "final_command_rad": 1.01,
    "steps": 200,
    "protected": False,
    "state": STATE,
}

GRASP = {
    "job": 5,
    "ok": True,
    "outcome": "object_held",
    "reached": False,
    "stalled": True,
    "target_rad": 0.95,
    "force_n": 20.0,
    "cycles": 15,
    "width_mm": 31.5,
    "held_s": 3.0,
    "state": STATE,
}

RAD_TO_MM = SPAN_MM / 1.617457
"""That of a gripper of the bench, 53.17."""
CONTENT = {
    "channel": "can0",
    "can_id": 8,
    "mst_id": 24,
    "canfd_mode": False,
    "calibrated": True,
    "zero_position_rad": 0.104334,
    "max_position_rad": -1.513123,
    "travel_range_rad": 1.617457,
    "rad_to_mm": RAD_TO_MM,
    "work_stroke_mm": WORK_MM,
    "motor_type": "DM4310",
    "kp": 100.0,
    "kd": 2.0,
    "grasp_torque_threshold": 0.5,
    "note": "left arm",
}
"""A calibration file of the field, with a key that is not the SDK's."""

CALIBRATION = {
    "calibrated": True,
    "mount": "normal",
    "closed_rad": 0.104334,
    "open_rad": -1.513123,
    "travel_rad": 1.617457,
    "travel_mm": SPAN_MM,
    "rad_to_mm": RAD_TO_MM,
    "work_stroke_mm": WORK_MM,
    "kp": 100.0,
    "kd": 2.0,
    "file": "/var/lib/litegripd/can0_calibration.json",
    "scale_warning": None,
    "content": CONTENT,
}

ZERO = {
    "job": 6,
    "ok": True,
    "outcome": "measured",
    "closed_rad": 0.104334,
    "open_rad": -1.513123,
    "travel_rad": 1.617457,
    "rad_to_mm": RAD_TO_MM,
    "content": CONTENT,
    "path": "/var/lib/litegripd/can0_calibration.json",
    "message": None,
    "state": STATE,
}

HELLO = {
    "daemon": "litegripd",
    "version": "0.1.0",
    "protocol": 1,
    "channel": "can0",
    "pid": 1,
    "epoch": "e",
    "simulated": True,
    "stop_generation": 3,
    "motor": {"type": "DM4310", "can_id": 8, "master_id": 24, "serial": None},
    "gripper": {
        "calibrated": True,
        "mount": "normal",
        "travel_mm": SPAN_MM,
        "closed_rad": 0.104334,
        "open_rad": -1.513123,
        "rad_to_mm": RAD_TO_MM,
        "nm_to_n": 10.0,
        "stroke_mm": STROKE_MM,
        "work_stroke_mm": WORK_MM,
        "kp": 100.0,
        "kd": 2.0,
    },
    "limits": {},
}


class Request:
    """One request as the daemon got it."""

    def __init__(self, data: dict[str, Any], peer: socket.socket) -> None:
        self.identity = data.get("id")
        self.method: str = data["method"]
        self.params: dict[str, Any] = data.get("params", {})
        self.raw = data
        self._peer = peer

    def reply(self, result: Any) -> None:
        self.send({"jsonrpc": "2.0", "id": self.identity, "result": result})

    def fail(self, reason: str, code: int, message: str = "no", **data: Any) -> None:
        detail = {"reason": reason, "retryable": False, **data}
        if terms := terms_of({"message": message, **data}):
            detail["terms"] = terms
        error = {"code": code, "message": message, "data": detail}
        self.send({"jsonrpc": "2.0", "id": self.identity, "error": error})

    def progress(
        self, step: int = 1, job: int = 4, phase: str = "travel", total_steps: int = 10
    ) -> None:
        self.notify(
            "job.progress",
            {
                "job": job,
                "request": self.identity,
                "kind": "open",
                "phase": phase,
                "step": step,
                "total_steps": total_steps,
                "command_rad": 0.1,
                "position_rad": 0.2,
                "torque_nm": 0.3,
                "opening_mm": 12.5,
            },
        )

    def notify(self, method: str, params: Any) -> None:
        self.send({"jsonrpc": "2.0", "method": method, "params": params})

    def send(self, message: Any) -> None:
        self.send_bytes(json.dumps(message).encode() + b"\n")

    def send_bytes(self, data: bytes) -> None:
        self._peer.sendall(data)

    def hang_up(self) -> None:
        self._peer.shutdown(socket.SHUT_RDWR)


Handler = Callable[[Request], Any]


class FakeDaemon:
    """Answers by `handlers[method]`: its result at once, or nothing when it returns None.

    What is not handled stays unanswered, for the test to answer.
    """

    def __init__(self, path: Path) -> None:
        self.path = str(path)
        self.handlers: dict[str, Handler] = {
            "hello": lambda request: HELLO,
            "state.get": lambda request: STATE,
            "info.get": lambda request: HELLO,
            "lease.acquire": lambda request: {"lease": "e:1", "number": 1, "state": STATE},
            "lease.release": lambda request: {"released": True},
            "lease.renew": lambda request: {"number": 1},
            "lease.take": lambda request: {"lease": "e:2", "number": 2, "state": STATE},
            "motor.enable": lambda request: {"ok": True, "tries": 1, "state": STATE},
            "motor.disable": lambda request: {"ok": True, "state": STATE},
        }
        self.requests: list[Request] = []
        self.failures: list[BaseException] = []
        self._arrived = threading.Condition()
        self._peers: list[socket.socket] = []
        self._threads: list[threading.Thread] = []
        self._listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._listener.bind(self.path)
        self._listener.listen(16)
        self._start(self._accept)

    def methods(self) -> list[str]:
        return [request.method for request in self.requests]

    def wait_for(self, method: str, count: int = 1) -> list[Request]:
        """Wait until `count` requests of `method` came."""
        deadline_s = time.monotonic() + DEADLINE_S
        with self._arrived:
            while len(found := [r for r in self.requests if r.method == method]) < count:
                if not self._arrived.wait(deadline_s - time.monotonic()):
                    raise TimeoutError(f"{method} did not come; there were {self.methods()}")
            return found

    def hang_up(self) -> None:
        """End as a daemon ends: the listener, and all connections."""
        for one in (self._listener, *self._peers):
            with contextlib.suppress(OSError):  # the other side was first
                one.shutdown(socket.SHUT_RDWR)

    def close(self) -> None:
        self.hang_up()
        for thread in self._threads:
            thread.join(DEADLINE_S)
        for one in (self._listener, *self._peers):
            one.close()
        if self.failures:
            raise self.failures[0]

    def __enter__(self) -> "FakeDaemon":
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()

    def _start(self, target: Callable[..., None], *arguments: Any) -> None:
        thread = threading.Thread(target=target, args=arguments, daemon=True)
        self._threads.append(thread)
        thread.start()

    def _accept(self) -> None:
        while True:
            try:
                peer, _ = self._listener.accept()
            except OSError:
                return
            self._peers.append(peer)
            self._start(self._serve, peer)

    def _serve(self, peer: socket.socket) -> None:
        try:
            with peer.makefile("rb") as lines:
                for line in lines:
                    self._take(Request(json.loads(line), peer))
        except OSError:
            return  # the client went away
        except BaseException as failure:  # noqa: BLE001 - shown by the test's thread
            self.failures.append(failure)

    def _take(self, request: Request) -> None:
        with self._arrived:
            self.requests.append(request)
            self._arrived.notify_all()
        handler = self.handlers.get(request.method)
        result = handler(request) if handler is not None else None
        if result is not None:
            request.reply(result)
