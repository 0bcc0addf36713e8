"""The daemon's store of trajectories by name, and whose they are."""

import contextlib
import hashlib
import json
import os
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from litegrip_client.values.atomic_file import why_not_written
from litegrip_client.values.trajectory_format import ENDING, HEADER, MAX_BYTES, SAMPLE, Header
from litegripd.io.helper import atomic_file
from litegripd.io.helper.atomic_file import REAL, FileSystem
from litegripd.io.helper.files import state_directory
from litegripd.model.sentence import sentence, with_terms
from litegripd.trajectories.content import (
    Content,
    Grips,
    StoreError,
    content_of,
    decoded,
    encoded,
    entry_of,
    facts_beside,
    grips_beside,
    load_grips,
    open_file,
    recorded_grips,
    remove_grips,
    save_grips,
    sent_grips,
    unknown,
    unopened,
)
from litegripd.trajectories.values import PIECE_BYTES, TEMPORARY, name_problem

OWNER_ENDING = ".uid"

MB = 1_000_000
_LONGEST = 12  # bytes; the largest uid has ten digits
_MAX_UID = 2**32 - 2


@dataclass(frozen=True, slots=True)
class Limits:
    """The most named trajectories, and the most bytes of them together, for one user."""

    most: int = 500
    most_bytes: int = 500 * MB

    @classmethod
    def of(cls, arguments: Sequence[str]) -> "Limits":
        """Return the limits that `arguments` has written; without any, the defaults."""
        return cls(*map(int, arguments))

    def arguments(self) -> tuple[str, str]:
        """Return the limits as arguments of a process."""
        return str(self.most), str(self.most_bytes)


class Owners:
    """The owners of the trajectories in a directory.

    The files themselves are counted. So two daemons of one directory that save at the same instant
    may together exceed a limit by one trajectory; the next one is rejected.
    """

    def __init__(self, limits: Limits, file_system: FileSystem = REAL) -> None:
        self._limits = limits
        self._file_system = file_system

    def usage(self, directory: Path, uid: int) -> dict[str, int]:
        """Return what a user has in `directory`, and may have; raises `OSError`."""
        names = lgt_names(directory, self._file_system)
        owned = [
            name for name in names if self._owner_in(f"{directory}/{name}{OWNER_ENDING}") == uid
        ]
        sizes = [_size_of(directory / f"{name}{ENDING}") for name in owned]
        return {
            "uid": uid,
            "named": len(sizes),
            "bytes": sum(sizes),
            "most_named": self._limits.most,
            "most_bytes": self._limits.most_bytes,
        }

    def check(self, path: Path, uid: int, size: int) -> None:
        """Raise `StoreError` if `size` bytes more at `path` would exceed a limit of the user.

        A replacement of the user's own file that is no larger is never rejected. Raises `OSError`.
        """
        usage = self.usage(path.parent, uid)
        before = _size_of(path) if self.owner_of(path) == uid and os.path.lexists(path) else None
        if before is None and usage["named"] >= self._limits.most:
            text = sentence(
                "uid {uid} has {named} named trajectories, of {most} that [trajectories]"
                " most_per_user allows{remedy}",
                uid=uid,
                named=usage["named"],
                most=self._limits.most,
                remedy=_REMEDY,
            )
            raise StoreError("trajectories_full", text, _data(usage, size))
        growth = size - (before or 0)
        if growth > 0 and usage["bytes"] + growth > self._limits.most_bytes:
            text = sentence(
                "this trajectory has {size} bytes, and the {named} that uid {uid} has under names"
                " have {bytes}, of {most_bytes} that [trajectories] most_mb_per_user"
                " allows{remedy}",
                size=size,
                uid=uid,
                named=usage["named"],
                bytes=usage["bytes"],
                most_bytes=self._limits.most_bytes,
                remedy=_REMEDY,
            )
            raise StoreError("trajectories_full", text, _data(usage, size))

    def owner_of(self, path: Path) -> int | None:
        """Return the uid of a trajectory's owner, or None."""
        return self._owner_in(str(path_beside(path)))

    @staticmethod
    def _owner_in(beside: str) -> int | None:
        """Return the uid in a file beside a trajectory; one answer may read thousands of them."""
        try:
            # A link could lead anywhere; and opening a pipe must not wait for its other end.
            descriptor = os.open(beside, os.O_RDONLY | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
            try:
                text = os.read(descriptor, _LONGEST + 1).strip()
            finally:
                os.close(descriptor)
        except OSError:
            return None
        if len(text) > _LONGEST or not text.isdigit():
            return None
        uid = int(text)
        return uid if uid <= _MAX_UID else None

    @contextlib.contextmanager
    def owned(self, path: Path, uid: int) -> Iterator[None]:
        """Make `uid` the owner of what the block writes at `path`; if it fails, restore the owner.

        The owner is written first, so no new file is ever without one. Raises `OSError`.
        """
        before = self.owner_of(path)
        if before != uid:
            self._save(path, uid)
        try:
            yield
        except OSError:
            with contextlib.suppress(OSError):  # if that fails, `uid` stays the owner
                if before is None:
                    self.forget(path)
                elif before != uid:
                    self._save(path, before)
            raise

    def forget(self, path: Path) -> None:
        """Remove the file with a trajectory's owner, if it exists; raises `OSError`."""
        beside = path_beside(path)
        if os.path.lexists(beside):
            self._file_system.remove(beside)
            self._file_system.sync_directory(beside.parent)

    def _save(self, path: Path, uid: int) -> None:
        content = f"{uid}\n".encode()
        atomic_file.write(path_beside(path), content, file_system=self._file_system)


def lgt_names(directory: Path, file_system: FileSystem) -> list[str]:
    """Return the names of the trajectories in a directory, sorted; raises `OSError`."""
    try:
        found = file_system.names(directory)
    except FileNotFoundError:
        return []
    names = (name.removesuffix(ENDING) for name in found if name.endswith(ENDING))
    return sorted(name for name in names if name_problem(name) is None)


def path_beside(path: Path) -> Path:
    """Return the path of the file with the owner of a trajectory's file."""
    return path.with_name(path.name.removesuffix(ENDING) + OWNER_ENDING)


_REMEDY = sentence(
    " in the daemon's configuration: make room ({trajectory.delete}), or have an administrator"
    " raise it and restart the daemon"
)


def _data(usage: Mapping[str, int], size: int) -> dict[str, Any]:
    return {"usage": dict(usage), "requested": size}


def _size_of(path: Path) -> int:
    """Return the bytes of a trajectory's file and its grips; 0 for a missing file."""
    size = 0
    for one in (path, grips_beside(path)):
        with contextlib.suppress(FileNotFoundError):
            size += one.lstat().st_size
    return size


LISTED_BYTES = 40_000
"""The most bytes of a list in one answer, which must fit into a packet."""

_MAX_CACHED = 2


class TrajectoryStore:
    """The operations `trajectory.*` of the helper process; each takes and returns plain values.

    A name that begins with `TEMPORARY` is one of those in memory, any other that of a file.
    """

    def __init__(
        self,
        directory: Callable[[], Path] = lambda: state_directory() / "trajectories",
        file_system: FileSystem = REAL,
        clock: Callable[[], float] = time.time,
        limits: Limits = Limits(),
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
                entry |= facts_beside(path)
            entries.append(entry)
            size += len(json.dumps(entries[-1]))
            if size > LISTED_BYTES:
                break
        usage = self._owners.usage(directory, parameters["uid"])
        return {"trajectories": entries, "more": len(entries) < len(usable), "usage": usage}

    def open(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Check a whole trajectory and return the facts about it."""
        content, grips = self._both(parameters["name"])
        return {**content.facts(), **grips.facts(), "grip_rows": grips.rows(content.whole)}

    def samples(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return `PIECE_BYTES` of samples, from byte `offset` on."""
        content = self._content(parameters["name"])
        if content.sha256 != parameters["sha256"]:
            raise StoreError("trajectory_unreadable", "it was changed while it was being loaded")
        begins = HEADER.size + int(parameters["offset"])
        return {"data": encoded(content.whole[begins : begins + PIECE_BYTES])}

    def read(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Return a piece of a whole trajectory: the file, CSV, or the file of its grips."""
        name, file_format = parameters["name"], parameters["format"]
        if file_format == "grip":
            _, grips = self._both(name)
            if grips.problem is not None:
                raise StoreError("trajectory_unreadable", grips.problem)
            whole, sha256 = grips.whole, hashlib.sha256(grips.whole).hexdigest()
        else:
            content = self._content(name)
            whole, sha256 = content.whole, content.sha256
        if file_format == "csv":
            if self._csv is None or self._csv[0] != content.sha256:
                self._csv = (content.sha256, content.as_csv())
            whole = self._csv[1]
            sha256 = hashlib.sha256(whole).hexdigest()
        offset, length = int(parameters["offset"]), int(parameters["length"])
        if offset > len(whole):
            text = f"offset is {offset}, beyond the end: there are {len(whole)} bytes"
            raise StoreError("out_of_limits", text)
        data = encoded(whole[offset : offset + length])
        return {"data": data, "offset": offset, "total": len(whole), "sha256": sha256}

    # Writing

    def put(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Take a piece of the temporary trajectory `key`; the last piece completes it.

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
            remove_grips(path, self._file_system)
            self._owners.forget(path)
            self._file_system.sync_directory(path.parent)
        except FileNotFoundError:
            raise unknown(parameters["name"], path.parent) from None
        except OSError as error:
            raise StoreError("not_saved", f"{path}: cannot be removed: {error.strerror}") from None
        return {"name": parameters["name"], "deleted": True}

    def drop(self, parameters: Mapping[str, Any]) -> dict[str, Any]:
        """Forget temporary trajectories, complete or not."""
        for name in parameters["names"]:
            self._coming.pop(name, None)
            self._kept.pop(name, None)
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
        make: Callable[[bytes, bytes, str], Grips] = sent_grips
        if header is not None:
            samples = len(lgt) // SAMPLE.size
            lgt = Header(samples, created_s=self._clock(), **header).pack() + lgt
            make = recorded_grips
        content = Content.of(lgt)
        return content, make(beside, lgt, content.sha256) if beside else Grips()

    def _write(self, name: str, content: Content, grips: Grips, uid: int) -> str:
        """Write both files; between the two writes the digest keeps old grips from the new file."""
        path = self._path(name)
        self._check_room(path, uid, len(content.whole) + len(grips.whole))
        try:
            with self._owners.owned(path, uid):
                atomic_file.write(path, content.whole, file_system=self._file_system)
                save_grips(path, grips, self._file_system)
        except OSError as error:
            why = why_not_written(error, path)
            text = f"{path}, or its grips beside it: cannot be written: {why}"
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

    def _both(self, name: str) -> tuple[Content, Grips]:
        """Return a checked trajectory, and its grips."""
        if name.startswith(TEMPORARY):
            return self._in_memory(name)
        content = self._content(name)
        return content, load_grips(self._path(name), content.whole, content.sha256)

    def _in_memory(self, name: str) -> tuple[Content, Grips]:
        kept = self._kept.get(name)
        if kept is None:
            text = f"{name} is no longer kept: send or record it again"
            raise StoreError("unknown_trajectory", text)
        return kept

    def _content(self, name: str) -> Content:
        """Return a checked trajectory; a file is checked again only if it has changed."""
        if name.startswith(TEMPORARY):
            return self._in_memory(name)[0]
        path = self._path(name)
        try:
            with open_file(path) as file:
                status = os.fstat(file.fileno())
                key = (str(path), status.st_ino, status.st_mtime_ns, status.st_size)
                if key not in self._cached:
                    content = content_of(path, file.read(MAX_BYTES + 1))
                    while len(self._cached) >= _MAX_CACHED:
                        del self._cached[next(iter(self._cached))]
                    self._cached[key] = content
        except OSError as error:
            raise unopened(name, path, error) from None
        return self._cached[key]


def _refusing(
    do: Callable[[Mapping[str, Any]], dict[str, Any]],
) -> Callable[[Mapping[str, Any]], object]:
    """Return an operation that answers with `refused` instead of raising `StoreError`."""

    def answer(parameters: Mapping[str, Any]) -> object:
        try:
            return do(parameters)
        except StoreError as error:
            told = {"reason": error.reason, "message": error.message, "data": error.data}
            return {"refused": with_terms(told)}

    return answer
