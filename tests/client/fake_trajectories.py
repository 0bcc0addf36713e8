"""The scripted daemon's trajectories: recordings that take as many looks as a test wants."""

import base64
import hashlib
from typing import Any

from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.taught import CONTENT
from tests.trajectories import PIECE_BYTES

__all__ = ["CONTENT", "FakeTrajectories"]


class FakeTrajectories:
    """What the daemon keeps, by name, and what of it was begun."""

    def __init__(self, daemon: FakeDaemon, looks: int = 2) -> None:
        """A recording is over after `looks` looks at its status."""
        self.kept: dict[str, bytes] = {}
        self._looks = looks
        self._wanted, self._active = 0, False
        self._status = {"kind": "record", "job": 3, "missed": 0, "error": None, "duration_s": 0.0}
        for name, handler in {
            "record_start": self._start,
            "record_stop": self._stop,
            "status": self._look,
            "list": lambda _request: {"trajectories": [], "more": False},
            "get": self._get,
        }.items():
            daemon.handlers[f"trajectory.{name}"] = handler

    def _start(self, request: Request) -> dict[str, Any]:
        self._wanted, self._active = request.params["max_samples"], True
        return {**self._status, "active": True, "samples": 0}

    def _look(self, _request: Request) -> dict[str, Any]:
        self._looks -= 1
        is_over = self._looks <= 0
        samples = self._wanted if is_over else self._wanted // 2
        return {**self._status, "active": self._active and not is_over, "samples": samples}

    def _stop(self, request: Request) -> dict[str, Any]:
        name = request.params["name"]
        self._active, self.kept[name] = False, CONTENT
        facts = {"samples": self._wanted, "duration_s": 2.99, "missed": 0}
        return {"recording": None, "name": name, **facts}

    def _get(self, request: Request) -> dict[str, Any] | None:
        name, at = request.params["name"], request.params["offset"]
        if name not in self.kept:
            request.fail("unknown_trajectory", -32015, f"no trajectory {name!r}")
            return None
        whole = b"" if request.params.get("format") == "grip" else self.kept[name]
        data = base64.b64encode(whole[at : at + PIECE_BYTES]).decode()
        sha256 = hashlib.sha256(whole).hexdigest()
        return {"data": data, "offset": at, "total": len(whole), "sha256": sha256}
