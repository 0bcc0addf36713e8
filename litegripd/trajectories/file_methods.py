"""The methods on stored trajectories: list, upload, download and delete.

All contents are in the helper process; they pass through here in pieces, unread.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Literal, TypedDict

from litegrip_client.values.trajectory_format import MAX_BYTES, MAX_GRIP_BYTES, Header
from litegripd.control.controller import Controller
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Mount
from litegripd.model.sentence import sentence
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
)
from litegripd.rpc.sessions import Session
from litegripd.trajectories.values import MAX_NAME, TEMPORARY, Summary, name_problem, outcome_of

MOST_PER_CONNECTION = 4
MOST_BYTES = 4 * MAX_BYTES
"""For all connections together, by the announced sizes."""

MOST_PIECES = 4
"""For one connection, on the way to the helper process, whose queue all share."""


@dataclass(slots=True)
class Temporary:
    """A trajectory that ends with its connection, complete or not.

    `pieces` counts those of an upload that are on their way now.
    """

    kind: Literal["upload", "recording"]
    number: int
    client: int
    sha256: str | None = None
    total: int = 0
    is_whole: bool = False
    pieces: int = 0

    @property
    def name(self) -> str:
        """Its name, also for the helper process, which has the content."""
        return f"{TEMPORARY}{self.kind}-{self.number}"


class Temporaries:
    """All uploads, complete or not, and the latest recording without a name."""

    NOT_CARRIED = ("_all", "_controller", "_uploads")

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._all: dict[str, Temporary] = {}
        self._uploads = 0

    def check(self, client: int, name: str) -> None:
        """Raise `Refused` for the name of none, or of one that is incomplete or another's."""
        found = self._all.get(name)
        if found is None or found.client != client or not found.is_whole:
            text = (
                f"this connection has no whole trajectory {name}: one ends with its connection, and"
                " a recording with the next one"
            )
            raise Refused(Refusal("unknown_trajectory", text, {"requested": name}))

    def of_recording(self, client: int) -> Temporary:
        """Begin to keep a recording, in place of the one before."""
        self.drop([name for name, one in self._all.items() if one.kind == "recording"])
        self._controller.recordings += 1
        return self._begin(Temporary("recording", self._controller.recordings, client))

    def of_piece(self, client: int, sha256: str, total: int, offset: int) -> Temporary:
        """Return the upload of a piece; the first piece begins it, or restarts it.

        The pieces of one upload have the same SHA-256 and the same total. Raises `Refused`.
        """
        coming = (one for one in self._all.values() if one.client == client and not one.is_whole)
        upload = next((one for one in coming if one.sha256 == sha256), None)
        if upload is not None and upload.pieces >= MOST_PIECES:
            text = f"{MOST_PIECES} pieces wait for their answers already: send one after the other"
            raise Refused(Refusal("too_many_requests", text, {"limit": MOST_PIECES}))
        if upload is not None and upload.total == total:
            return upload
        if upload is not None or offset > 0:
            text = f"nothing of this trajectory is here, but offset is {offset}: begin at 0"
            if upload is not None:
                text = f"total is {total}, in the pieces before it was {upload.total}"
            raise Refused(Refusal("invalid_params", text, {"parameter": "offset"}))
        self._check_room(client, total)
        self._uploads += 1
        return self._begin(Temporary("upload", self._uploads, client, sha256, total))

    def kept(self, one: Temporary, answer: Mapping[str, Any]) -> dict[str, Any]:
        """Note that one is whole, or no longer temporary; return the answer with what it is called.

        By its number, clients of 0.1.0 call it.
        """
        if answer["name"] is not None:
            self.forget(one.name)
            return {one.kind: None, **answer}
        one.is_whole = True
        return {one.kind: one.number, **answer, "name": one.name}

    def forget(self, name: str) -> None:
        """Forget one that the helper process does not have."""
        self._all.pop(name, None)

    def drop(self, names: Sequence[str]) -> None:
        """Forget some, here and in the helper process."""
        for name in names:
            self.forget(name)
        if names:
            task = HelperTask("trajectory.drop", {"names": names}, lambda _done: None)
            self._controller.tasks.append(task)

    def session_ended(self, session: Session) -> None:
        """Drop those of a connection that has ended."""
        self.drop([name for name, one in self._all.items() if one.client == session.identity])

    def _check_room(self, client: int, total: int) -> None:
        uploads = [one for one in self._all.values() if one.kind == "upload"]
        if sum(one.client == client for one in uploads) >= MOST_PER_CONNECTION:
            text = sentence(
                "this connection has {most} uploads already: delete one ({trajectory.delete}), or"
                " give it a name",
                most=MOST_PER_CONNECTION,
            )
            raise Refused(Refusal("too_many_requests", text, {"limit": MOST_PER_CONNECTION}))
        if sum(one.total for one in uploads) + total > MOST_BYTES:
            why = f"all uploads together would have more than {MOST_BYTES} bytes: try again later"
            raise Refused(Refusal("too_many_requests", why, {"limit": MOST_BYTES}))

    def _begin(self, begun: Temporary) -> Temporary:
        self._all[begun.name] = begun
        return begun


_SHA256_DIGITS = 64


class Whole(TypedDict):
    """A complete, stored trajectory; a temporary one has no path."""

    name: str
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


class Deleted(TypedDict):
    """A trajectory was deleted."""

    name: str
    deleted: Literal[True]


MAX_PIECE_BYTES = 8192
_MAX_BASE64 = 10_924

NAME = Param(
    "name",
    "string",
    f"The name that the daemon keeps it under: 1 to {MAX_NAME} characters, no / or \\, no dot at"
    " the beginning.",
)
WHICH = replace(
    NAME,
    required=True,
    description=f"Its name; that of a temporary one of this connection begins with {TEMPORARY}.",
)


def of_older(params: Mapping[str, Any]) -> Mapping[str, Any]:
    """Return the parameters of 0.1.0, which called a temporary trajectory by its number, as now."""
    for kind in ("upload", "recording"):
        if isinstance(params.get(kind), int) and "name" not in params:
            others = {name: value for name, value in params.items() if name != kind}
            return {**others, "name": f"{TEMPORARY}{kind}-{params[kind]}"}
    return params


_OFFSET = Param("offset", "integer", "Where the piece begins.", minimum=0, maximum=2**31)


class TrajectoryFileMethods:
    """Methods on stored trajectories."""

    NOT_CARRIED = ("_controller", "temporaries")

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self.temporaries = Temporaries(controller)

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
            WHICH,
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
        of_older=of_older,
    )
    def _get(self, call: Call) -> Answer:
        params = call.params
        wanted = {
            "name": self.named(call),
            "offset": params.get("offset", 0),
            "length": params.get("length", MAX_PIECE_BYTES),
            "format": params.get("format", "lgt"),
        }
        return self._task(call, "trajectory.read", wanted)

    @Method(
        "trajectory.put",
        "Send a piece of a trajectory, in order. With the last one it is checked as a whole, and"
        " kept: under a name, in place of any before; without one until this connection ends, with"
        " a temporary name, which the answer says. What is wrong leaves nothing behind. A name for"
        " which the user has no room is refused with the first piece.",
        "received (bytes) and complete; with the last piece also name, upload (the number in a"
        " temporary one, else null), path, samples, duration_s, max_rate_s, grips, and what its"
        " header says.",
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
        check_name(name)
        upload = self.temporaries.of_piece(call.session.identity, sha256, total, offset)
        upload.pieces += 1
        wanted = {
            "key": upload.name,
            "offset": offset,
            "total": total,
            "grip_bytes": params.get("grip_bytes", 0),
            "sha256": sha256,
            "data": params["data"],
            "name": name,
            "uid": call.owner.uid,
            "header": None,
        }

        def noted(answer: Mapping[str, Any] | Refusal) -> Result:
            upload.pieces -= 1
            if isinstance(answer, Refusal):
                self.temporaries.forget(upload.name)
                return answer
            return self.temporaries.kept(upload, answer) if answer["complete"] else answer

        return self._task(call, "trajectory.put", wanted, "not_saved", noted)

    @Method(
        "trajectory.delete",
        "Remove a trajectory that the daemon keeps, or a temporary one of this connection.",
        "deleted, and its name.",
        Deleted,
        (WHICH,),
        role="operator",
        waits=True,
        of_older=of_older,
    )
    def _delete(self, call: Call) -> Answer:
        name = self.named(call)
        if not name.startswith(TEMPORARY):
            return self._task(call, "trajectory.delete", {"name": name}, "not_saved")
        self.temporaries.drop([name])
        return {"name": name, "deleted": True}

    def named(self, call: Call) -> str:
        """Return the name of the trajectory that is meant; raises `Refused` if it cannot be one."""
        name: str = call.params["name"]
        if name.startswith(TEMPORARY):
            self.temporaries.check(call.session.identity, name)
        else:
            check_name(name)
        return name

    def _task(
        self,
        call: Call,
        operation: str,
        parameters: Mapping[str, Any],
        failed: str = "trajectory_unreadable",
        noted: Callable[[Mapping[str, Any] | Refusal], Result] = lambda answer: answer,
    ) -> Deferred:
        """Send a task to the helper process; its answer, as it is noted, is the answer."""
        deferred = Deferred()

        def done(result: TaskResult) -> None:
            deferred.resolve(noted(outcome_of(result, failed)))

        self._controller.tasks.append(HelperTask(operation, parameters, done, call.owner.uid))
        return deferred


def check_name(name: str | None) -> None:
    """Reject a name that a trajectory cannot have."""
    problem = None if name is None else name_problem(name)
    if problem is not None:
        text = f"{name!r:.80} cannot be a trajectory's name: {problem}"
        raise Refused(Refusal("invalid_params", text, {"parameter": "name"}))
