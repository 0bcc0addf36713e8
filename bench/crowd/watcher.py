"""Reads all that one daemon tells: every event, and the state in every tick.

A thread of its own reads, so that the daemon never has to drop anything for it.
"""

import json
import socket
import threading
import time
from pathlib import Path
from typing import Any

from bench.crowd.audit import Audit, Sample
from litegripd.rpc.subscriptions import EVENT_KINDS

FIELDS = ("seq", "monotonic_s", "mode", "job", "command_rad", "command_torque_nm")
SAMPLES_IN_A_BATCH = 20
ANSWER_WITHIN_S = 10.0
_REQUESTS = (
    ("events.subscribe", {"kinds": EVENT_KINDS}),
    ("state.subscribe", {"hz": 200, "batch": SAMPLES_IN_A_BATCH, "fields": FIELDS}),
)


class Watcher(threading.Thread):
    """One connection that only listens. `audit` and `samples` grow while the thread runs."""

    def __init__(self, path: Path) -> None:
        """Subscribe; raises `OSError`, and `RuntimeError` where the daemon refuses."""
        super().__init__(daemon=True)
        self.audit = Audit()
        self.samples: list[Sample] = []
        self.dropped = 0
        self._ended = threading.Event()
        self.subscribed = threading.Event()
        self._socket = socket.socket(socket.AF_UNIX)
        try:
            self._socket.connect(str(path))
            for number, (method, params) in enumerate(_REQUESTS):
                request = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
                self._socket.sendall(json.dumps(request).encode() + b"\n")
        except OSError:
            self._socket.close()
            raise
        self.start()
        if not self.subscribed.wait(ANSWER_WITHIN_S):
            raise RuntimeError("the daemon did not begin the subscriptions")

    def run(self) -> None:
        """Take what comes until the connection ends."""
        try:
            with self._socket.makefile("rb") as lines:
                for line in lines:
                    self._take(json.loads(line))
        finally:
            self._ended.set()

    def pass_by(self, until_s: float) -> None:
        """Watch until then, or until the daemon ends the connection."""
        if self._ended.wait(max(0.0, until_s - time.monotonic())):
            raise RuntimeError("the daemon has closed the watcher's connection")

    def in_charge(self) -> list[int]:
        """Return the pids of whoever has the lease, and of whoever moves."""
        holder, running = self.audit.holder, self.audit.running
        return [one.pid for one in (holder, running) if one is not None]

    def close(self) -> None:
        """End the connection, and wait until all that came is taken."""
        self._socket.shutdown(socket.SHUT_RDWR)
        self.join(ANSWER_WITHIN_S)
        self._socket.close()

    def _take(self, message: dict[str, Any]) -> None:
        if "error" in message:
            raise RuntimeError(f"the daemon refused to tell all: {message}")
        if "method" not in message:
            if message["id"] == len(_REQUESTS) - 1:
                self.subscribed.set()
        elif message["method"] == "event":
            self.audit.take(message["params"])
        elif message["method"] == "state.batch":
            self.dropped = message["params"]["dropped"]
            self.samples += map(_sample, message["params"]["rows"])


def _sample(row: list[Any]) -> Sample:
    seq, at_s, mode, job, command_rad, command_torque_nm = row
    commanded = command_rad is not None or command_torque_nm is not None
    return Sample(seq, at_s, mode, None if job is None else job["job"], commanded)
