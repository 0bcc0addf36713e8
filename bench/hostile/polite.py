"""A client that behaves well beside hostile ones: it reads the state, moves, and checks all of it.

It has the lease, so that what the others may do cannot be the reason for a motion that fails.
"""

import array
import itertools
import json
import random
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

DEADLINE_S = 60.0
OPENINGS_MM = (40.0, 44.0)
SPEED_MM_S = 40.0
NEAR_MM = 1.5
POWER_LOST = frozenset({"motor_fault", "motor_silent", "not_enabled", "not_confirmed"})
"""Why a motion may fail: a machine that stops all processes makes the motor's watchdog act."""


class WrongAnswerError(RuntimeError):
    """A well-formed request was not answered as it must be."""


class Polite:
    """One connection that holds the lease; `latencies_s` are those of `state.get`."""

    def __init__(self, path: Path) -> None:
        self.latencies_s = array.array("d")
        self.motions = 0
        self.power_losses = 0
        self._socket = socket.socket(socket.AF_UNIX)
        self._socket.settimeout(DEADLINE_S)
        self._socket.connect(str(path))
        self._lines = self._socket.makefile("rb")
        self._ids = itertools.count(1)
        self._targets = itertools.cycle(OPENINGS_MM)
        self._motion: tuple[int, float] | None = None
        self._last_seq = 0
        self.result("lease.acquire", purpose="to be left alone")
        self.enable()

    def __enter__(self) -> "Polite":
        return self

    def __exit__(self, *_exception: object) -> None:
        self._lines.close()
        self._socket.close()

    def work(self, is_enough: Callable[[], bool], pause_s: float = 0.0) -> None:
        """Read the state again and again beside one motion after the other, until it is enough.

        Between two reads it pauses for a random time of at most `pause_s`.
        """
        while not is_enough() or self._motion is not None:
            if self._motion is None:
                self._begin_motion()
            self._read_state()
            if pause_s:
                time.sleep(random.uniform(0.0, pause_s))

    def result(self, method: str, **params: object) -> dict[str, Any]:
        """Call a method that must succeed, while no motion runs."""
        answer = self._answer(self._send(method, **params))
        if "result" not in answer:
            raise WrongAnswerError(f"{method}: {answer}")
        result: dict[str, Any] = answer["result"]
        return result

    def until(self, method: str, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Call a method again and again until its result is as awaited; return that."""
        ends_s = time.monotonic() + DEADLINE_S
        while not condition(result := self.result(method)):
            if time.monotonic() > ends_s:
                raise WrongAnswerError(f"did not happen in time: {result}")
        return result

    def enable(self) -> None:
        """Enable the motor as soon as it lets itself be enabled."""
        ends_s = time.monotonic() + DEADLINE_S
        while "result" not in (answer := self._answer(self._send("motor.enable"))):
            is_late = time.monotonic() > ends_s
            if is_late or answer["error"]["data"]["reason"] not in POWER_LOST:
                raise WrongAnswerError(f"motor.enable: {answer}")

    def _send(self, method: str, **params: object) -> int:
        number = next(self._ids)
        request = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
        self._socket.sendall(json.dumps(request).encode() + b"\n")
        return number

    def _answer(self, number: int) -> dict[str, Any]:
        """Return the answer to a request; only that of the motion may come before it."""
        while True:
            line = self._lines.readline()
            if not line:
                raise WrongAnswerError("the daemon has closed the connection")
            message: dict[str, Any] = json.loads(line)
            if message.get("id") == number:
                return message
            if self._motion is None or message.get("id") != self._motion[0]:
                raise WrongAnswerError(f"nobody asked for {message}")
            self._check_motion(message, self._motion[1])
            self._motion = None

    def _read_state(self) -> None:
        asked_s = time.perf_counter()
        answer = self._answer(self._send("state.get"))
        self.latencies_s.append(time.perf_counter() - asked_s)
        state = answer.get("result", {})
        seq = state.get("seq", 0)
        if seq < self._last_seq or state.get("bus") != "up" or state.get("stop") is not None:
            raise WrongAnswerError(answer)
        self._last_seq = seq

    def _begin_motion(self) -> None:
        target_mm = next(self._targets)
        number = self._send("motion.move", opening_mm=target_mm, speed_mm_s=SPEED_MM_S)
        self._motion = number, target_mm

    def _check_motion(self, answer: dict[str, Any], target_mm: float) -> None:
        if answer.get("error", {}).get("data", {}).get("reason") in POWER_LOST:
            self._motion = None
            self.power_losses += 1
            self.enable()
            return
        result = answer.get("result", {})
        is_there = abs(result["state"]["opening_mm"] - target_mm) < NEAR_MM if result else False
        if not is_there or not result["ok"]:
            raise WrongAnswerError(f"to {target_mm} mm: {answer}")
        self.motions += 1
