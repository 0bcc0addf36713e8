"""The samples of a trajectory without a disk: judged one by one, as text, and as a path.

`Loading` fetches a checked trajectory from the helper process, piece by piece, while the jaws hold.
"""

import base64
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from litegrip_client.values.errors import TrajectoryFormatError
from litegrip_client.values.trajectory_format import (
    HEADER,
    SAMPLE,
    SAMPLE_FIELDS,
    Header,
    TaughtGrip,
    check_finite,
    read_header,
)
from litegripd.model.errors import Refusal
from litegripd.model.sentence import read_sentence
from litegripd.model.state import HelperTask, TaskResult

MAX_NAME = 64
MAX_NAME_BYTES = 200
"""With its suffixes, also that of a temporary file, a name fits into a file system's 255 bytes."""

TEMPORARY = "tmp/"
"""So begin the names of those that end with their connection; no other name has a slash."""

CSV_HEAD = ",".join(SAMPLE_FIELDS) + "\n"


@dataclass(frozen=True, slots=True)
class Summary:
    """The result of checking the samples.

    `max_rate_s` is the fastest change of the openness per second: infinite for a jump. Without
    samples all values are 0.
    """

    duration_s: float = 0.0
    max_rate_s: float = 0.0


def read(content: memoryview) -> tuple[Header, Summary]:
    """Check a whole file; raises `TrajectoryFormatError` with the reason.

    The longest file takes about half a second.
    """
    header = read_header(content)
    return header, summarize(content[HEADER.size :])


def summarize(samples: memoryview) -> Summary:
    """Check the samples; raises `TrajectoryFormatError` with the number of the wrong one."""
    first_s = last_s = last = fastest = 0.0
    for number, values in enumerate(SAMPLE.iter_unpack(samples)):
        t_s, openness = values[:2]
        check_finite(number, values)
        if not 0.0 <= openness <= 1.0:
            raise TrajectoryFormatError(
                f"sample {number}: openness is {openness}, it must be 0 to 1"
            )
        if number == 0:
            first_s = t_s
        elif t_s < last_s:
            raise TrajectoryFormatError(
                f"sample {number}: time runs backwards, {last_s} to {t_s} s"
            )
        elif openness != last:
            rate_s = math.inf if t_s == last_s else abs(openness - last) / (t_s - last_s)
            fastest = max(fastest, rate_s)
        last_s, last = t_s, openness
    return Summary(last_s - first_s, fastest)


def csv_line(values: tuple[float, ...]) -> str:
    """Return a sample as a line of CSV; each number reads back exactly."""
    return ",".join(map(repr, values)) + "\n"


def name_problem(name: str) -> str | None:
    """Return why a trajectory cannot have this name, or None."""
    if not name or len(name) > MAX_NAME:
        return f"it must have 1 to {MAX_NAME} characters"
    if "/" in name or "\\" in name:
        return "it must have no / and no \\: it is a name, not a path"
    if name.startswith("."):
        return "it must not begin with a dot"
    if name != name.strip() or not name.isprintable():
        return "it must be printable, and not begin or end with a space"
    if len(name.encode()) > MAX_NAME_BYTES:
        return f"it must have at most {MAX_NAME_BYTES} bytes in UTF-8"
    return None


PIECE_SAMPLES = 800
PIECE_BYTES = PIECE_SAMPLES * SAMPLE.size
"""32,000 bytes: as base64 it fits into one packet between control thread and helper process."""


class Path:
    """The openness over the time since the first sample, linear between the samples.

    `pieces` have `PIECE_SAMPLES` samples each, the last one the remainder; `samples` is above 0.
    """

    def __init__(self, pieces: Sequence[bytes], samples: int) -> None:
        self.samples = samples
        self._pieces = pieces
        self._first_s = self._sample(0)[0]
        self.duration_s = self._sample(samples - 1)[0] - self._first_s

    def openness_at(self, elapsed_s: float) -> float:
        """Return the openness; before the start and after the end, that of the nearest sample.

        If several samples have the same time, the last one counts.
        """
        after = self._first_after(elapsed_s)
        if after == 0:
            return self._sample(0)[1]
        before_s, before = self._sample(after - 1)
        if after == self.samples:
            return before
        next_s, following = self._sample(after)
        share = (elapsed_s - (before_s - self._first_s)) / (next_s - before_s)
        return before + (following - before) * min(max(share, 0.0), 1.0)

    def _first_after(self, elapsed_s: float) -> int:
        """Return the number of the first later sample, by bisection."""
        low, high = 0, self.samples
        while low < high:
            middle = (low + high) // 2
            if self._sample(middle)[0] - self._first_s > elapsed_s:
                high = middle
            else:
                low = middle + 1
        return low

    def _sample(self, number: int) -> tuple[float, float]:
        """Return time and openness of a sample."""
        piece, index = divmod(number, PIECE_SAMPLES)
        t_s, openness, *_ = SAMPLE.unpack_from(self._pieces[piece], index * SAMPLE.size)
        return t_s, openness


LOAD_WITHIN_S = 10.0
"""The longest time for an answer; checking the longest trajectory takes half a second."""

_MOST_UNANSWERED = 3


def outcome_of(result: TaskResult, failed: str) -> Mapping[str, Any] | Refusal:
    """Return the result of a task; an unexpected failure has the reason `failed`."""
    if result.error is not None or not isinstance(result.value, Mapping):
        return Refusal(result.reason or failed, str(result.error))
    refused = result.value.get("refused")
    if refused is not None:
        terms = refused.get("terms", {}).get("message")
        return Refusal(refused["reason"], read_sentence(refused["message"], terms), refused["data"])
    return result.value


class Loading:
    """One trajectory that is being fetched; `step` returns the tasks, one per tick.

    At the end there is a `path`, or `failure` says why not. A trajectory without samples has no
    path. The times of its `grips` count from the first sample; `grip_problem` says why they cannot
    be used.
    """

    def __init__(self, name: str) -> None:
        self.path: Path | None = None
        self.failure: Refusal | None = None
        self.max_rate_s = 0.0
        self.grips: tuple[TaughtGrip, ...] = ()
        self.grip_problem: str | None = None
        self._name = name
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
            return HelperTask("trajectory.open", {"name": self._name}, self._opened)
        unanswered = self._asked - len(self._pieces)
        if self._facts is None or unanswered >= _MOST_UNANSWERED or self._asked >= self._count:
            return None
        number, self._asked = self._asked, self._asked + 1
        sha256, offset = self._facts["sha256"], number * PIECE_BYTES
        parameters = {"name": self._name, "sha256": sha256, "offset": offset}
        return HelperTask(
            "trajectory.samples", parameters, lambda result: self._take(number, result)
        )

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
