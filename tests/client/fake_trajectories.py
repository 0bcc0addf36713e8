"""The scripted daemon's trajectories: recordings that take as many looks as a test wants."""

import base64
import hashlib
from typing import Any

from litegrip_client import Trajectory
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.trajectories import PIECE_BYTES, lgt

PLAYED: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "completed",
    "loops": 1,
    "frames": 200,
    "largest_lag_mm": 1.25,
    "final_command_rad": 0.1,
    "state": STATE,
}
CONTENT = lgt([(number / 100, (number % 100) / 100) for number in range(300)])
"""Two pieces long."""
TAUGHT = Trajectory.from_bytes(CONTENT)


class FakeTrajectories:
    """What the daemon keeps, by name, and what of it was begun."""

    def __init__(self, daemon: FakeDaemon, looks: int = 2) -> None:
        """A recording is over after `looks` looks at its status."""
        self.kept: dict[str, bytes] = {}
        self.grips: dict[str | None, bytes] = {}
        self.uploads: dict[str, bytes] = {}
        self.is_of_0_1_0 = False
        """True if what ends with its connection has a number, and no name."""
        self._daemon = daemon
        self._looks = looks
        self._wanted = 0
        self._status = {**self._common("record"), "active": False, "kind": None}
        self._coming = b""
        handlers = {
            "record_start": self._start,
            "record_stop": self._stop,
            "status": lambda _request: self._look(),
            "list": self._list,
            "get": self._get,
            "put": self._put,
            "delete": self._delete,
            "play": lambda _request: PLAYED,
        }
        for name, handler in handlers.items():
            daemon.handlers[f"trajectory.{name}"] = handler

    def asked(self, method: str) -> list[dict[str, Any]]:
        """Return with which parameters a method was called, its guards left out."""
        guards = ("sent_s", "stop_generation")
        return [
            {name: value for name, value in request.params.items() if name not in guards}
            for request in self._daemon.requests
            if request.method == f"trajectory.{method}"
        ]

    def _common(self, kind: str) -> dict[str, Any]:
        return {"kind": kind, "job": 3, "samples": 0, "missed": 0, "error": None, "duration_s": 0.0}

    def _start(self, request: Request) -> dict[str, Any]:
        self._wanted = request.params.get("max_samples", 1000)
        self._status = {**self._common("record"), "active": True}
        return self._status

    def _look(self) -> dict[str, Any]:
        self._looks -= 1
        is_over = self._looks <= 0
        samples = self._wanted if is_over else self._wanted // 2
        return {
            **self._status,
            "active": not is_over and self._status["active"],
            "samples": samples,
        }

    def _stop(self, request: Request) -> dict[str, Any]:
        self._status["active"] = False
        name = request.params.get("name")
        if name is not None:
            self.kept[name] = CONTENT
        facts = {"samples": self._wanted, "duration_s": 2.99, "missed": 0}
        if None in self.grips:
            facts["grips"] = 1
        temporary = None if self.is_of_0_1_0 else "tmp/recording-1"
        return {"recording": None if name else 1, "name": name or temporary, **facts}

    def _list(self, request: Request) -> dict[str, Any]:
        """One at a time, so that whoever lists must ask for more."""
        names = [name for name in sorted(self.kept) if name > request.params.get("after", "")]
        rows = [
            {
                "name": name,
                "bytes": len(self.kept[name]),
                "samples": 300,
                "duration_s": 2.99,
                "sample_hz": 100.0,
                "created_s": 1.7e9,
                "mount": "normal",
                "grips": int(name in self.grips),
                "uid": 1000 if name == "pick" else None,
                "error": None if self.kept[name] == CONTENT else "sample 1 is odd",
            }
            for name in names[:1]
        ]
        return {"trajectories": rows, "more": len(names) > 1}

    def _get(self, request: Request) -> dict[str, Any] | None:
        params = request.params
        stored = params.get("name") if params.get("name") != "tmp/recording-1" else None
        if "/" in (stored or ""):
            request.fail("invalid_params", -32602, "it cannot be a name: it is a path")
            return None
        if stored is not None and stored not in self.kept:
            request.fail("unknown_trajectory", -32015, f"no trajectory {stored!r}")
            return None
        whole = CONTENT if stored is None else self.kept[stored]
        if params.get("format") == "csv":
            whole = b"t_s,openness\n0.0,0.5\n"
        elif params.get("format") == "grip":
            whole = self.grips.get(stored, b"")
        at = params["offset"]
        data = base64.b64encode(whole[at : at + PIECE_BYTES]).decode()
        sha256 = hashlib.sha256(whole).hexdigest()
        return {"data": data, "offset": at, "total": len(whole), "sha256": sha256}

    def _put(self, request: Request) -> dict[str, Any]:
        params = request.params
        assert len(request.raw["params"]["data"]) <= 4 * PIECE_BYTES // 3 + 4
        whole = b"" if params["offset"] == 0 else self._coming
        assert len(whole) == params["offset"]
        self._coming = whole + base64.b64decode(params["data"])
        if len(self._coming) < params["total"]:
            return {"received": len(self._coming), "complete": False}
        assert hashlib.sha256(self._coming).hexdigest() == params["sha256"]
        name, number = params.get("name"), None
        beside = params.get("grip_bytes", 0)
        if beside:
            self.grips[name] = self._coming[-beside:]
            self._coming = self._coming[:-beside]
        if name is None:
            number = len(self.uploads) + 1
            self.uploads[f"tmp/upload-{number}"] = self._coming
            name = None if self.is_of_0_1_0 else f"tmp/upload-{number}"
        else:
            self.kept[name] = self._coming
        return {"complete": True, "upload": number, "name": name, "samples": 300}

    def _delete(self, request: Request) -> dict[str, Any]:
        name = request.params.get("name") or f"tmp/upload-{request.params['upload']}"
        if name in self.uploads:
            self.uploads[name] = b""
        else:
            del self.kept[name]
        return {"deleted": True}
