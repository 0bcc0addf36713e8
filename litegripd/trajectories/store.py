"""The stored trajectories: files by name, and uploads and recordings without a name.

It is in the helper process, the only process that reads and checks whole trajectories. An expected
refusal is an answer with `refused`: a reason of the error table and a sentence.
"""

import hashlib
import json
import os
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from litegrip_client.protocol.lgt import HEADER, MAX_BYTES, SAMPLE, Header
from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import REAL, FileSystem
from litegripd.io.helper.files import state_directory
from litegripd.trajectories import grip_files as trajectory_grips
from litegripd.trajectories.content import (
    ENDING,
    Content,
    StoreError,
    content_of,
    decoded,
    encoded,
    entry_of,
    open_file,
    unknown,
    unopened,
)
from litegripd.trajectories.grip_files import Grips
from litegripd.trajectories.owners import Limits, Owners, lgt_names
from litegripd.trajectories.values import PIECE_BYTES, name_problem

LISTED_BYTES = 40_000
"""The most bytes of a list in one answer, which must fit into a packet."""

_MAX_CACHED = 2


class TrajectoryStore:
    """The operations `trajectory.*` of the helper process; each takes and returns plain values.

    A `source` is {"name": ...} for a file, or {"kept": ...} for an upload or a recording.
    """

    def __init__(
        self,
        directory: Callable[[], Path] = lambda: state_directory() / "trajectories",
        file_system: FileSystem = REAL,
        clock: Callable[[], float] = time.time,
        limits: Limits = Limits(),  # noqa: B008 - frozen
    ) -> None:
        self._directory = directory
        self._file_system = file_system
        self._clock = clock
        self._owners = Owners(limits, file_system)
        self._coming: dict[str, bytearray] = {}
        self._kept: dict[str, tuple[Content, Grips]] = {}
        self._cached: dict[tuple[str, int, int, int], Content] = {}
        self._csv: tuple[str, bytes] | None = None

    def operations(self) -> dict[str, Callable[[Mapping[str, Any]], object]]:
        """Return the operations by their names."""
        functions = {
            "list": self.list_names,
            "open": self.open,
            "samples": self.samples,
            "read": self.read,
            "put": self.put,
            "delete": self.delete,
            "drop": self.drop,
        }
        return {f"trajectory.{name}": _refusing(do) for name, do in functions.items()}

    # Reading

    def list_names(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return the files after the name `after`, sorted; `more` is True if others follow.

        `usage` is what the asking user `uid` has of all files, and may have.
        """
        directory, after = self._directory(), parameters["after"] or ""
        usable = [name for name in lgt_names(directory, self._file_system) if name > after]
        entries: list[dict[str, Any]] = []
        size = 0
        for name in usable:
            path = self._path(name)
            entry = {**entry_of(name, path), "uid": self._owners.owner_of(path)}
            if entry["error"] is None:
                entry |= trajectory_grips.facts_beside(path)
            entries.append(entry)
            size += len(json.dumps(entries[-1]))
            if size > LISTED_BYTES:
                break
        usage = self._owners.usage(directory, parameters["uid"])
        return {"trajectories": entries, "more": len(entries) < len(usable), "usage": usage}

    def open(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Check a whole trajectory and return the facts about it."""
        content, grips = self._both(parameters["source"])
        return {**content.facts(), **grips.facts(), "grip_rows": grips.rows(content.whole)}

    def samples(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return `PIECE_BYTES` of samples, from byte `offset` on."""
        content = self._content(parameters["source"])
        if content.sha256 != parameters["sha256"]:
            raise StoreError("trajectory_unreadable", "it was changed while it was being loaded")
        begins = HEADER.size + int(parameters["offset"])
        return {"data": encoded(content.whole[begins : begins + PIECE_BYTES])}

    def read(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return a piece of a whole trajectory: the file, CSV, or the file of its grips."""
        source, file_format = parameters["source"], parameters["format"]
        if file_format == "grip":
            _, grips = self._both(source)
            if grips.problem is not None:
                raise StoreError("trajectory_unreadable", grips.problem)
            whole, sha256 = grips.whole, hashlib.sha256(grips.whole).hexdigest()
        else:
            content = self._content(source)
            whole, sha256 = content.whole, content.sha256
        if file_format == "csv":
            whole = self._as_csv(content)
            sha256 = hashlib.sha256(whole).hexdigest()
        offset, length = int(parameters["offset"]), int(parameters["length"])
        if offset > len(whole):
            text = f"offset is {offset}, beyond the end: there are {len(whole)} bytes"
            raise StoreError("out_of_limits", text)
        data = encoded(whole[offset : offset + length])
        return {"data": data, "offset": offset, "total": len(whole), "sha256": sha256}

    # Writing

    def put(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Take a piece of the upload or recording `key`; the last piece completes it.

        Once complete, it is checked, and written under `name` if there is one. Its last
        `grip_bytes` are the file of its grips. With `header` the pieces are the samples and grips
        of a recording, and the files are made here. If anything is wrong, nothing of it stays. A
        named trajectory counts for the user `uid`; without room the first piece is rejected.
        """
        key, offset, total = parameters["key"], int(parameters["offset"]), int(parameters["total"])
        before = self._coming.pop(key, None)
        coming = before if offset else bytearray()
        data = decoded(parameters["data"])
        if coming is None or len(coming) != offset:
            has = 0 if coming is None else len(coming)
            text = f"offset is {offset}, but {has} bytes are here: begin again at 0, in order"
            raise StoreError("out_of_limits", text)
        if offset + len(data) > total or (not data and total > 0):
            text = f"a piece of {len(data)} bytes at {offset} does not go with a total of {total}"
            raise StoreError("out_of_limits", text)
        name, path = parameters["name"], None
        if name is not None and offset == 0 and parameters["header"] is None:
            self._check_room(self._path(name), parameters["uid"], total)
        coming += data
        if len(coming) < total:
            self._coming[key] = coming
            return {"received": len(coming), "complete": False}
        content, grips = self._finished(bytes(coming), parameters)
        if name is None:
            self._kept[key] = content, grips
        else:
            path = self._write(name, content, grips, parameters["uid"])
        facts = {**content.facts(), **grips.facts()}
        return {"received": total, "complete": True, "name": name, "path": path, **facts}

    def delete(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Delete the trajectory with a name."""
        path = self._path(parameters["name"])
        try:
            self._file_system.remove(path)
            trajectory_grips.remove(path, self._file_system)
            self._owners.forget(path)
            self._file_system.sync_directory(path.parent)
        except FileNotFoundError:
            raise unknown(parameters["name"]) from None
        except OSError as error:
            raise StoreError("not_saved", f"{path}: cannot be removed: {error.strerror}") from None
        return {"name": parameters["name"], "deleted": True}

    def drop(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Forget the uploads and recordings with these keys, complete or not."""
        for key in parameters["keys"]:
            self._coming.pop(key, None)
            self._kept.pop(key, None)
        return {}

    # Inside

    def _finished(self, whole: bytes, parameters: Mapping[str, Any]) -> tuple[Content, Grips]:
        sha256, header = parameters["sha256"], parameters["header"]
        if sha256 is not None and hashlib.sha256(whole).hexdigest() != sha256:
            text = "what arrived does not have the SHA-256 that was announced: send it again"
            raise StoreError("trajectory_unreadable", text)
        grip_bytes = int(parameters.get("grip_bytes", 0))
        if grip_bytes > len(whole):
            text = f"grip_bytes is {grip_bytes}, but there are {len(whole)} bytes in all"
            raise StoreError("out_of_limits", text)
        lgt, beside = whole[: len(whole) - grip_bytes], whole[len(whole) - grip_bytes :]
        make: Callable[[bytes, bytes, str], Grips] = trajectory_grips.sent
        if header is not None:
            samples = len(lgt) // SAMPLE.size
            lgt = Header(samples, created_s=self._clock(), **header).pack() + lgt
            make = trajectory_grips.recorded
        content = Content.of(lgt)
        return content, make(beside, lgt, content.sha256) if beside else Grips()

    def _write(self, name: str, content: Content, grips: Grips, uid: int) -> str:
        """Write both files; between the two writes the digest keeps old grips from the new file."""
        path = self._path(name)
        self._check_room(path, uid, len(content.whole) + len(grips.whole))
        try:
            with self._owners.owned(path, uid):
                atomic_file.write(path, content.whole, file_system=self._file_system)
                trajectory_grips.save(path, grips, self._file_system)
        except OSError as error:
            text = f"{path}, or its grips beside it: cannot be written: {error.strerror}"
            raise StoreError("not_saved", text) from None
        return str(path)

    def _check_room(self, path: Path, uid: int, size: int) -> None:
        try:
            self._owners.check(path, uid, size)
        except OSError as error:
            text = f"{path.parent}: what is kept there cannot be counted: {error.strerror}"
            raise StoreError("not_saved", text) from None

    def _path(self, name: str) -> Path:
        problem = name_problem(name)
        if problem is not None:
            text = f"{name[:80]!r} cannot be a trajectory's name: {problem}"
            raise StoreError("out_of_limits", text)
        return self._directory() / f"{name}{ENDING}"

    def _both(self, source: Mapping[str, Any]) -> tuple[Content, Grips]:
        """Return a checked trajectory, and its grips."""
        if "kept" in source:
            return self._in_memory(source["kept"])
        content = self._content(source)
        path = self._path(source["name"])
        return content, trajectory_grips.load(path, content.whole, content.sha256)

    def _in_memory(self, key: str) -> tuple[Content, Grips]:
        kept = self._kept.get(key)
        if kept is None:
            text = "this upload or recording is no longer kept: send or record it again"
            raise StoreError("unknown_trajectory", text)
        return kept

    def _content(self, source: Mapping[str, Any]) -> Content:
        """Return a checked trajectory; a file is checked again only if it has changed."""
        if "kept" in source:
            return self._in_memory(source["kept"])[0]
        path = self._path(source["name"])
        try:
            with open_file(path) as file:
                status = os.fstat(file.fileno())
                key = (str(path), status.st_ino, status.st_mtime_ns, status.st_size)
                if key not in self._cached:
                    self._keep_in_cache(key, content_of(path, file.read(MAX_BYTES + 1)))
        except OSError as error:
            raise unopened(source["name"], path, error) from None
        return self._cached[key]

    def _keep_in_cache(self, key: tuple[str, int, int, int], content: Content) -> None:
        while len(self._cached) >= _MAX_CACHED:
            del self._cached[next(iter(self._cached))]
        self._cached[key] = content

    def _as_csv(self, content: Content) -> bytes:
        if self._csv is None or self._csv[0] != content.sha256:
            self._csv = (content.sha256, content.as_csv())
        return self._csv[1]


def _refusing(
    do: Callable[[Mapping[str, Any]], dict[str, Any]],
) -> Callable[[Mapping[str, Any]], object]:
    """Return an operation that answers with `refused` instead of raising `StoreError`."""

    def answer(parameters: Mapping[str, Any]) -> object:
        try:
            return do(parameters)
        except StoreError as error:
            return {"refused": {"reason": error.reason, "message": str(error), "data": error.data}}

    return answer
