"""The methods on stored trajectories: list, upload, download and delete.

All contents are in the helper process; they pass through here in pieces, unread.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias, TypedDict

from litegrip_client.values.trajectory_format import MAX_BYTES, MAX_GRIP_BYTES, Header
from litegripd.control.controller import Controller
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Mount
from litegripd.model.sentence import method_name, sentence
from litegripd.model.state import HelperTask, TaskResult
from litegripd.rpc.method import (
    Answer,
    Call,
    Deferred,
    Method,
    Param,
    Refused,
    Result,
    Shape,
    accepted,
)
from litegripd.rpc.sessions import Session
from litegripd.trajectories.requests import recording_key
from litegripd.trajectories.values import MAX_NAME, Summary, name_problem, outcome_of

MOST_PER_CONNECTION = 4
MOST_BYTES = 4 * MAX_BYTES
"""For all connections together, by the announced sizes."""

MOST_PIECES = 4
"""For one connection, on the way to the helper process, whose queue all share."""


@dataclass(slots=True)
class Upload:
    """One upload of a connection, complete or not; `pieces` counts those on their way now."""

    number: int
    client: int
    sha256: str
    total: int
    is_whole: bool = False
    pieces: int = 0

    @property
    def key(self) -> str:
        """The key under which the helper process stores it."""
        return f"upload {self.number}"


class Uploads:
    """All uploads, complete or not."""

    NOT_CARRIED = ("_last", "_uploads")

    def __init__(self) -> None:
        self._uploads: dict[int, Upload] = {}
        self._last = 0

    def get(self, client: int, number: int) -> Upload | None:
        """Return a complete upload of this connection, or None."""
        upload = self._uploads.get(number)
        mine = upload is not None and upload.client == client and upload.is_whole
        return upload if mine else None

    def take(self, client: int, sha256: str, total: int, offset: int) -> Upload | Refusal:
        """Return the upload of a piece; the first piece begins it, or restarts it.

        The pieces of one upload have the same SHA-256 and the same total.
        """
        coming = (one for one in self._uploads.values() if one.client == client)
        same = (one for one in coming if one.sha256 == sha256 and not one.is_whole)
        upload = next(same, None)
        if upload is not None and upload.pieces >= MOST_PIECES:
            text = f"{MOST_PIECES} pieces wait for their answers already: send one after the other"
            return Refusal("too_many_requests", text, {"limit": MOST_PIECES})
        if upload is not None and upload.total == total:
            return upload
        if upload is not None or offset > 0:
            text = f"nothing of this trajectory is here, but offset is {offset}: begin at 0"
            if upload is not None:
                text = f"total is {total}, in the pieces before it was {upload.total}"
            return Refusal("invalid_params", text, {"parameter": "offset"})
        return self._limit(client, total) or self._begin(client, sha256, total)

    def drop(self, upload: Upload) -> None:
        """Forget an upload."""
        self._uploads.pop(upload.number, None)

    def drop_all(self, client: int) -> list[Upload]:
        """Forget the uploads of a connection, and return them."""
        dropped = [one for one in self._uploads.values() if one.client == client]
        for upload in dropped:
            self.drop(upload)
        return dropped

    def _limit(self, client: int, total: int) -> Refusal | None:
        mine = sum(one.client == client for one in self._uploads.values())
        if mine >= MOST_PER_CONNECTION:
            text = sentence(
                "this connection has {most} uploads already: delete one ({trajectory.delete} with"
                " its number), or give it a name",
                most=MOST_PER_CONNECTION,
            )
            return Refusal("too_many_requests", text, {"limit": MOST_PER_CONNECTION})
        if sum(one.total for one in self._uploads.values()) + total > MOST_BYTES:
            why = f"all uploads together would have more than {MOST_BYTES} bytes: try again later"
            return Refusal("too_many_requests", why, {"limit": MOST_BYTES})
        return None

    def _begin(self, client: int, sha256: str, total: int) -> Upload:
        self._last += 1
        upload = Upload(self._last, client, sha256, total)
        self._uploads[upload.number] = upload
        return upload


Then: TypeAlias = Callable[[Mapping[str, Any]], Mapping[str, Any]]

_SHA256_DIGITS = 64


class Whole(TypedDict):
    """A complete, stored trajectory."""

    name: str | None
    path: str | None
    sha256: str
    total: int
    grips: int
    grip_problem: str | None


class _Complete(TypedDict):
    """The members that only the last piece of an upload has."""

    received: int
    complete: Literal[True]
    upload: int | None


class PieceTaken(TypedDict):
    """A piece of an upload was stored, and others must follow."""

    received: int
    complete: Literal[False]


PUT = (PieceTaken, Shape("TrajectoryUploaded", (_Complete, Whole, Header, Summary)))


class Listed(TypedDict):
    """One stored trajectory."""

    name: str
    error: None
    bytes: int
    samples: int
    sample_hz: float
    created_s: float
    mount: Mount | None
    duration_s: float | None
    grips: int
    grip_problem: str | None
    uid: int | None


class ListedBroken(TypedDict):
    """One stored trajectory that cannot be used, and why."""

    name: str
    error: str
    uid: int | None


class TrajectoryUsage(TypedDict):
    """How many named trajectories, and bytes of them, one user has and may have."""

    uid: int
    named: int
    bytes: int
    most_named: int
    most_bytes: int


class TrajectoryList(TypedDict):
    """Some of the stored trajectories; `more` is True if others follow."""

    trajectories: list[Listed | ListedBroken]
    more: bool
    usage: TrajectoryUsage


class Piece(TypedDict):
    """A piece of a trajectory, as base64."""

    data: str
    offset: int
    total: int
    sha256: str


class _Deleted(TypedDict):
    deleted: Literal[True]


class Deleted(_Deleted, total=False):
    """A trajectory was deleted; with its name, if it had one."""

    name: str


MAX_PIECE_BYTES = 8192
_MAX_BASE64 = 10_924

NAME = Param(
    "name",
    "string",
    f"The name that the daemon keeps it under: 1 to {MAX_NAME} characters, no / or \\, no dot at"
    " the beginning.",
)
UPLOAD = Param("upload", "integer", "The number of an upload of this connection.", minimum=1)
RECORDING = Param("recording", "integer", "The number of the latest recording.", minimum=1)
_OFFSET = Param("offset", "integer", "Where the piece begins.", minimum=0, maximum=2**31)


class TrajectoryFileMethods:
    """Methods on stored trajectories, by name or for a connection."""

    NOT_CARRIED = ("_controller", "_uploads")

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._uploads = Uploads()

    def session_ended(self, session: Session) -> None:
        """Drop the uploads of a connection that has ended."""
        keys = [upload.key for upload in self._uploads.drop_all(session.identity)]
        if keys:
            self._do(None, "trajectory.drop", {"keys": keys}, lambda _result: None)

    @Method(
        "trajectory.list",
        "List the trajectories that the daemon keeps, by name, and how much of the room is used.",
        "trajectories: of each name, bytes, samples, sample_hz, created_s (unix time), mount,"
        " duration_s (from the first to the last sample; null for times that cannot be), grips"
        " (how many are kept with it), grip_problem (why its grips cannot be used, else null), and"
        " error, which says why it cannot be used, if so, and uid, the user who saved it last (null"
        " where that is not known, and it counts for nobody); more: whether others follow; usage:"
        " the asking user's uid, named (how many), bytes (with their grips), most_named and"
        " most_bytes, which the daemon's configuration allows each user.",
        TrajectoryList,
        (replace(NAME, name="after", description="Only those after this name."),),
        waits=True,
    )
    def _list(self, call: Call) -> Answer:
        wanted = {"after": call.params.get("after"), "uid": call.owner.uid}
        return self._task(call, "trajectory.list", wanted)

    @Method(
        "trajectory.get",
        "Fetch a piece of a trajectory.",
        "data (base64), offset, total (bytes) and sha256 of the whole.",
        Piece,
        (
            NAME,
            UPLOAD,
            RECORDING,
            replace(_OFFSET, description="Where the piece begins (default 0)."),
            Param(
                "length",
                "integer",
                f"Bytes at most (default {MAX_PIECE_BYTES}).",
                minimum=1,
                maximum=MAX_PIECE_BYTES,
            ),
            Param(
                "format",
                "string",
                "The file itself (lgt, the default), its samples as CSV, or the file of its grips"
                " (grip), which is empty where there are none.",
                choices=("lgt", "csv", "grip"),
            ),
        ),
        waits=True,
    )
    def _get(self, call: Call) -> Answer:
        source, params = self.source("trajectory.get", call), call.params
        wanted = {
            "source": source,
            "offset": params.get("offset", 0),
            "length": params.get("length", MAX_PIECE_BYTES),
            "format": params.get("format", "lgt"),
        }
        return self._task(call, "trajectory.read", wanted)

    @Method(
        "trajectory.put",
        "Send a piece of a trajectory, in order. With the last one it is checked as a whole, and"
        " kept: under a name, in place of any before, or until this connection ends, to be played"
        " from there. What is wrong leaves nothing behind. A name for which the user has no room is"
        " refused with the first piece.",
        "received (bytes) and complete; with the last piece also upload (its number; null with a"
        " name), name, path, samples, duration_s, max_rate_s, grips, and what its header says.",
        PUT,
        (
            NAME,
            replace(_OFFSET, required=True),
            Param(
                "total",
                "integer",
                "The size of the whole.",
                required=True,
                minimum=1,
                maximum=MAX_BYTES + MAX_GRIP_BYTES,
            ),
            Param(
                "grip_bytes",
                "integer",
                "So many bytes at the end of the whole are the file of its grips (default 0).",
                minimum=0,
                maximum=MAX_GRIP_BYTES,
            ),
            Param("sha256", "string", "Of the whole, as hexadecimal digits.", required=True),
            Param(
                "data",
                "string",
                f"The piece, base64, at most {MAX_PIECE_BYTES} bytes.",
                required=True,
                longest=_MAX_BASE64,
            ),
        ),
        role="operator",
        waits=True,
    )
    def _put(self, call: Call) -> Answer:
        params, name = call.params, call.params.get("name")
        sha256 = params["sha256"].lower()
        if len(sha256) != _SHA256_DIGITS or not set(sha256) <= set("0123456789abcdef"):
            text = sentence(
                "{trajectory.put}: {.sha256} must have {digits} hexadecimal digits",
                digits=_SHA256_DIGITS,
            )
            return Refusal("invalid_params", text, {"parameter": "sha256"})
        offset, total = params["offset"], params["total"]
        client = call.session.identity
        check_name(name)
        upload = accepted(self._uploads.take(client, sha256, total, offset))
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

        def done(result: TaskResult) -> None:
            deferred.resolve(self._note_piece(upload, outcome_of(result, "not_saved")))

        self._do(call, "trajectory.put", wanted, done)
        return deferred

    def _note_piece(self, upload: Upload, answer: Mapping[str, Any] | Refusal) -> Result:
        """Count a stored piece, or drop a rejected upload; return the result."""
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

    @Method(
        "trajectory.delete",
        "Remove a trajectory that the daemon keeps, or an upload of this connection.",
        "deleted.",
        Deleted,
        (NAME, UPLOAD),
        role="operator",
        waits=True,
    )
    def _delete(self, call: Call) -> Answer:
        source = self.source("trajectory.delete", call)
        if "name" in source:
            return self._task(call, "trajectory.delete", source, failed="not_saved")
        upload = self._uploads.get(call.session.identity, call.params["upload"])
        if upload is not None:
            self._uploads.drop(upload)
        dropped: Deleted = {"deleted": True}
        keys = {"keys": [source["kept"]]}
        return self._task(call, "trajectory.drop", keys, lambda _value: dropped)

    def source(self, method: str, call: Call) -> dict[str, Any]:
        """Return the trajectory that is meant, by exactly one of name, upload and recording."""
        params = call.params
        given = [name for name in ("name", "upload", "recording") if name in params]
        if len(given) != 1:
            text = sentence(
                "{method} takes exactly one of {.name}, {.upload} and {.recording}",
                method=method_name(method),
            )
            if method == "trajectory.delete":
                text = sentence(
                    "{method} takes exactly one of {.name} and {.upload}",
                    method=method_name(method),
                )
            raise Refused(Refusal("invalid_params", text, {"parameter": (given or ["name"])[0]}))
        if "name" in params:
            check_name(params["name"])
            return {"name": params["name"]}
        if "recording" in params:
            return {"kept": recording_key(params["recording"])}
        upload = self._uploads.get(call.session.identity, params["upload"])
        if upload is None:
            why = f"this connection has no upload {params['upload']}, or it is not whole"
            raise Refused(Refusal("unknown_trajectory", why, {"requested": params["upload"]}))
        return {"kept": upload.key}

    def _do(
        self,
        call: Call | None,
        operation: str,
        parameters: Mapping[str, Any],
        on_result: Callable[[TaskResult], None],
    ) -> None:
        uid = None if call is None else call.owner.uid
        self._controller.tasks.append(HelperTask(operation, parameters, on_result, uid))

    def _task(
        self,
        call: Call,
        operation: str,
        parameters: Mapping[str, Any],
        then: Then | None = None,
        failed: str = "trajectory_unreadable",
    ) -> Deferred:
        """Send a task to the helper process; its answer is the answer."""
        deferred = Deferred()

        def done(result: TaskResult) -> None:
            answer = outcome_of(result, failed)
            if isinstance(answer, Refusal) or then is None:
                deferred.resolve(answer)
            else:
                deferred.resolve(then(answer))

        self._do(call, operation, parameters, done)
        return deferred


def check_name(name: str | None) -> None:
    """Reject a name that a trajectory cannot have."""
    problem = None if name is None else name_problem(name)
    if problem is not None:
        text = f"{name!r:.80} cannot be a trajectory's name: {problem}"
        raise Refused(Refusal("invalid_params", text, {"parameter": "name"}))
