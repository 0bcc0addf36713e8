"""The trajectories that clients send: counted and bounded, and gone with their connection.

The contents lie in the helper process. Here is only who has sent how much under which number.
"""

from dataclasses import dataclass

from litegripd.model.errors import Refusal
from litegripd.model.trajectory import MAX_BYTES

MOST_PER_CONNECTION = 4
MOST_BYTES = 4 * MAX_BYTES
"""Of all connections together, by the sizes that were announced."""

MOST_PIECES = 4
"""Of a connection on their way to the helper process, whose queue belongs to all."""


@dataclass(slots=True)
class Upload:
    """One trajectory of a connection, whole or still coming; `pieces` are on their way now."""

    number: int
    client: int
    sha256: str
    total: int
    is_whole: bool = False
    pieces: int = 0

    @property
    def key(self) -> str:
        """What the helper process keeps it under."""
        return f"upload {self.number}"


class Uploads:
    """All uploads that are kept or coming."""

    def __init__(self) -> None:
        self._uploads: dict[int, Upload] = {}
        self._last = 0

    def get(self, client: int, number: int) -> Upload | None:
        """Return a whole upload of this connection."""
        upload = self._uploads.get(number)
        mine = upload is not None and upload.client == client and upload.is_whole
        return upload if mine else None

    def take(self, client: int, sha256: str, total: int, offset: int) -> Upload | Refusal:
        """Return the upload that a piece belongs to; the first piece begins it, or begins it anew.

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
        """Forget what a connection has sent; return what it was."""
        dropped = [one for one in self._uploads.values() if one.client == client]
        for upload in dropped:
            self.drop(upload)
        return dropped

    def _limit(self, client: int, total: int) -> Refusal | None:
        mine = sum(one.client == client for one in self._uploads.values())
        if mine >= MOST_PER_CONNECTION:
            text = (
                f"this connection has {MOST_PER_CONNECTION} uploads already: delete one"
                " (trajectory.delete with its number), or give it a name"
            )
            return Refusal("too_many_requests", text, {"limit": MOST_PER_CONNECTION})
        if sum(one.total for one in self._uploads.values()) + total > MOST_BYTES:
            text = f"all uploads together would have more than {MOST_BYTES} bytes: try again later"
            return Refusal("too_many_requests", text, {"limit": MOST_BYTES})
        return None

    def _begin(self, client: int, sha256: str, total: int) -> Upload:
        self._last += 1
        upload = Upload(self._last, client, sha256, total)
        self._uploads[upload.number] = upload
        return upload
