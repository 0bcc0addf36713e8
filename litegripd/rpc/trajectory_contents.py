"""The methods on what is kept of trajectories: listed, sent, fetched and removed.

All contents lie in the helper process; they pass through here in pieces, unread.
"""

from collections.abc import Callable, Mapping
from typing import Any, TypeAlias

from litegripd.control.engine import Engine
from litegripd.control.loading import outcome_of
from litegripd.control.trajectories import recording_key
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.trajectory import name_problem
from litegripd.rpc.answers import Deleted
from litegripd.rpc.calls import Answer, Call, Deferred, Function, Result
from litegripd.rpc.session import Session
from litegripd.rpc.trajectory_table import MAX_PIECE_BYTES
from litegripd.rpc.uploads import Upload, Uploads

Then: TypeAlias = Callable[[Mapping[str, Any]], Mapping[str, Any]]

_SHA256_DIGITS = 64


class TrajectoryContents:
    """Functions on the trajectories that are kept, by name or for a connection."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._uploads = Uploads()

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "trajectory.list": self._list,
            "trajectory.get": self._get,
            "trajectory.put": self._put,
            "trajectory.delete": self._delete,
        }

    def session_ended(self, session: Session) -> None:
        """Drop the uploads of a connection that is gone."""
        keys = [upload.key for upload in self._uploads.drop_all(session.identity)]
        if keys:
            self._do(None, "trajectory.drop", {"keys": keys}, lambda _result: None)

    def _list(self, call: Call) -> Answer:
        wanted = {"after": call.params.get("after"), "uid": call.owner.uid}
        return self._errand(call, "trajectory.list", wanted)

    def _get(self, call: Call) -> Answer:
        source, params = self.source("trajectory.get", call), call.params
        if isinstance(source, Refusal):
            return source
        wanted = {
            "source": source,
            "offset": params.get("offset", 0),
            "length": params.get("length", MAX_PIECE_BYTES),
            "format": params.get("format", "lgt"),
        }
        return self._errand(call, "trajectory.read", wanted)

    def _put(self, call: Call) -> Answer:
        params, name = call.params, call.params.get("name")
        sha256 = params["sha256"].lower()
        if len(sha256) != _SHA256_DIGITS or not set(sha256) <= set("0123456789abcdef"):
            text = f"trajectory.put: sha256 must have {_SHA256_DIGITS} hexadecimal digits"
            return Refusal("invalid_params", text, {"parameter": "sha256"})
        offset, total = params["offset"], params["total"]
        client = call.session.identity
        upload = name_refusal(name) or self._uploads.take(client, sha256, total, offset)
        if isinstance(upload, Refusal):
            return upload
        upload.pieces += 1
        wanted = {
            "key": upload.key,
            "offset": offset,
            "total": total,
            "grip_bytes": params.get("grip_bytes", 0),
            "sha256": sha256,
            "data": params["data"],
            "name": name,
            "uid": call.owner.uid,
            "header": None,
        }
        deferred = Deferred()

        def done(result: ErrandResult) -> None:
            deferred.resolve(self._note_piece(upload, outcome_of(result, "not_saved")))

        self._do(call, "trajectory.put", wanted, done)
        return deferred

    def _note_piece(self, upload: Upload, answer: Mapping[str, Any] | Refusal) -> Result:
        """Count what has become of a piece; nothing is kept of an upload that was refused."""
        upload.pieces -= 1
        if isinstance(answer, Refusal):
            self._uploads.drop(upload)
            return answer
        if not answer["complete"]:
            return answer
        if answer["name"] is not None:
            self._uploads.drop(upload)
            return {"upload": None, **answer}
        upload.is_whole = True
        return {"upload": upload.number, **answer}

    def _delete(self, call: Call) -> Answer:
        source = self.source("trajectory.delete", call)
        if isinstance(source, Refusal):
            return source
        if "name" in source:
            return self._errand(call, "trajectory.delete", source, failed="not_saved")
        upload = self._uploads.get(call.session.identity, call.params["upload"])
        if upload is not None:
            self._uploads.drop(upload)
        dropped: Deleted = {"deleted": True}
        keys = {"keys": [source["kept"]]}
        return self._errand(call, "trajectory.drop", keys, lambda _value: dropped)

    def source(self, method: str, call: Call) -> dict[str, Any] | Refusal:
        """Find which trajectory is meant: exactly one of name, upload and recording."""
        params = call.params
        given = [name for name in ("name", "upload", "recording") if name in params]
        if len(given) != 1:
            text = f"{method} takes exactly one of name, upload and recording"
            if method == "trajectory.delete":
                text = f"{method} takes exactly one of name and upload"
            return Refusal("invalid_params", text, {"parameter": (given or ["name"])[0]})
        if "name" in params:
            return name_refusal(params["name"]) or {"name": params["name"]}
        if "recording" in params:
            return {"kept": recording_key(params["recording"])}
        upload = self._uploads.get(call.session.identity, params["upload"])
        if upload is None:
            text = f"this connection has no upload {params['upload']}, or it is not whole"
            return Refusal("unknown_trajectory", text, {"requested": params["upload"]})
        return {"kept": upload.key}

    def _do(
        self,
        call: Call | None,
        operation: str,
        parameters: Mapping[str, Any],
        on_result: Callable[[ErrandResult], None],
    ) -> None:
        uid = None if call is None else call.owner.uid
        self._engine.errands.append(Errand(operation, parameters, on_result, uid))

    def _errand(
        self,
        call: Call,
        operation: str,
        parameters: Mapping[str, Any],
        then: Then | None = None,
        failed: str = "trajectory_unreadable",
    ) -> Deferred:
        """Have something done by the helper process, and answer with what it answers."""
        deferred = Deferred()

        def done(result: ErrandResult) -> None:
            answer = outcome_of(result, failed)
            if isinstance(answer, Refusal) or then is None:
                deferred.resolve(answer)
            else:
                deferred.resolve(then(answer))

        self._do(call, operation, parameters, done)
        return deferred


def name_refusal(name: str | None) -> Refusal | None:
    """Say why a trajectory cannot have this name, if so."""
    problem = None if name is None else name_problem(name)
    if problem is None:
        return None
    text = f"{name!r:.80} cannot be a trajectory's name: {problem}"
    return Refusal("invalid_params", text, {"parameter": "name"})
