"""Fetches a checked trajectory from the helper process, piece by piece, while the jaws hold."""

import base64
from collections.abc import Callable, Mapping
from typing import Any

from litegrip_client.protocol.grips import TaughtGrip
from litegrip_client.protocol.lgt import SAMPLE
from litegripd.model.errors import Refusal
from litegripd.model.state import HelperTask, TaskResult
from litegripd.trajectories.values import PIECE_BYTES, Path

LOAD_WITHIN_S = 10.0
"""The longest time for an answer; checking the longest trajectory takes half a second."""

_MOST_UNANSWERED = 3


def outcome_of(result: TaskResult, failed: str) -> Mapping[str, Any] | Refusal:
    """Return the result of a task; an unexpected failure has the reason `failed`."""
    if result.error is not None or not isinstance(result.value, Mapping):
        return Refusal(result.reason or failed, str(result.error))
    refused = result.value.get("refused")
    if refused is not None:
        return Refusal(refused["reason"], refused["message"], refused["data"])
    return result.value


class Loading:
    """One trajectory that is being fetched; `step` returns the tasks, one per tick.

    At the end there is a `path`, or `failure` says why not. A trajectory without samples has no
    path. The times of its `grips` count from the first sample; `grip_problem` says why they cannot
    be used.
    """

    def __init__(self, source: Mapping[str, object]) -> None:
        self.path: Path | None = None
        self.failure: Refusal | None = None
        self.max_rate_s = 0.0
        self.grips: tuple[TaughtGrip, ...] = ()
        self.grip_problem: str | None = None
        self._source = source
        self._facts: Mapping[str, Any] | None = None
        self._pieces: dict[int, bytes] = {}
        self._asked = 0
        self._is_asked = False
        self._heard_s: float | None = None
        self._heard = 0
        self._heard_before = -1

    def step(self, now_s: float) -> HelperTask | None:
        """Return the task that is due now, or None."""
        if self._heard != self._heard_before:
            self._heard_before, self._heard_s = self._heard, now_s
        elif self._heard_s is not None and now_s - self._heard_s > LOAD_WITHIN_S:
            text = f"the helper process has not answered for {LOAD_WITHIN_S:g} s"
            self.failure = Refusal("trajectory_unreadable", text)
        if not self._is_asked:
            self._is_asked = True
            return HelperTask("trajectory.open", {"source": self._source}, self._opened)
        unanswered = self._asked - len(self._pieces)
        if self._facts is None or unanswered >= _MOST_UNANSWERED or self._asked >= self._count:
            return None
        self._asked += 1
        offset = (self._asked - 1) * PIECE_BYTES
        parameters = {
            "source": self._source,
            "sha256": self._facts["sha256"],
            "offset": offset,
        }
        return HelperTask("trajectory.samples", parameters, self._taker(self._asked - 1))

    @property
    def _count(self) -> int:
        samples = 0 if self._facts is None else int(self._facts["samples"])
        return -(-samples * SAMPLE.size // PIECE_BYTES)

    def _opened(self, result: TaskResult) -> None:
        self._heard += 1
        facts = outcome_of(result, "trajectory_unreadable")
        if isinstance(facts, Refusal):
            self.failure = facts
        elif facts["samples"] == 0:
            self.failure = Refusal("trajectory_unreadable", "the trajectory has no samples")
        else:
            self.max_rate_s = facts["max_rate_s"]
            self.grips = tuple(TaughtGrip(*row) for row in facts["grip_rows"])
            self.grip_problem = facts["grip_problem"]
            self._facts = facts

    def _taker(self, number: int) -> Callable[[TaskResult], None]:
        def take(result: TaskResult) -> None:
            self._take(number, result)

        return take

    def _take(self, number: int, result: TaskResult) -> None:
        self._heard += 1
        answer = outcome_of(result, "trajectory_unreadable")
        if isinstance(answer, Refusal):
            self.failure = answer
            return
        self._pieces[number] = base64.b64decode(answer["data"])
        if self._facts is not None and len(self._pieces) == self._count:
            pieces = [self._pieces[number] for number in range(self._count)]
            samples = int(self._facts["samples"])
            if sum(map(len, pieces)) != samples * SAMPLE.size:
                self.failure = Refusal("trajectory_unreadable", "the pieces do not make a whole")
                return
            self.path = Path(pieces, samples)
