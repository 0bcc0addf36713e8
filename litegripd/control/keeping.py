"""Takes a recording to the helper process, piece after piece, which makes the file of it."""

import base64
import json
from collections.abc import Callable, Mapping
from typing import Any

from litegripd.control.capture import Capture
from litegripd.control.engine import Engine
from litegripd.control.loading import outcome_of
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.path import PIECE_BYTES


def recording_key(number: int) -> str:
    """Return what the helper process keeps a recording under."""
    return f"recording {number}"


class Keeping:
    """One recording on its way; `on_kept` is called once, with what is known of the whole.

    With a `name` it is a trajectory of the user `uid`.

    Only the latest recording is kept: the one before goes when this one comes.
    """

    def __init__(
        self,
        engine: Engine,
        capture: Capture,
        number: int,
        on_kept: Callable[[Mapping[str, Any] | Refusal], None],
        *,
        name: str | None,
        uid: int,
    ) -> None:
        self._engine = engine
        self._capture = capture
        self._number = number
        self._name = name
        self._uid = uid
        self._on_kept = on_kept
        self._grips = json.dumps(capture.grips()).encode()
        self._sent = 0

    def begin(self) -> None:
        """Send the first piece."""
        before = {"keys": [recording_key(self._number - 1)]}
        self._engine.errands.append(Errand("trajectory.drop", before, lambda _result: None))
        self._send()

    def _send(self) -> None:
        """Send the next piece: of the samples, then of what is known of the grips."""
        capture = self._capture
        offset = self._sent
        if offset < capture.size:
            data = capture.piece(offset // PIECE_BYTES)
        else:
            data = memoryview(self._grips)[offset - capture.size :][:PIECE_BYTES]
        parameters = {
            "key": recording_key(self._number),
            "offset": offset,
            "total": capture.size + len(self._grips),
            "grip_bytes": len(self._grips),
            "sha256": None,
            "data": base64.b64encode(data).decode("ascii"),
            "name": self._name,
            "uid": self._uid,
            "header": capture.header(self._engine.unit.can_id),
        }
        self._sent += len(data)
        self._engine.errands.append(Errand("trajectory.put", parameters, self._answered))

    def _answered(self, result: ErrandResult) -> None:
        answer = outcome_of(result, "not_saved")
        if isinstance(answer, Refusal):
            self._on_kept(answer)
        elif answer["complete"]:
            number = None if self._name is not None else self._number
            known = {
                key: value for key, value in answer.items() if key not in ("received", "complete")
            }
            self._on_kept({"recording": number, **known})
        else:
            self._send()
