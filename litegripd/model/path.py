"""The path of a trajectory by time, read sample by sample out of bytes that were judged before.

Cheap enough for a tick, however long the trajectory is: nothing is parsed beforehand.
"""

from collections.abc import Sequence

from litegripd.model.trajectory import SAMPLE

PIECE_SAMPLES = 800
PIECE_BYTES = PIECE_SAMPLES * SAMPLE.size
"""32,000 bytes: as base64 it fits into one packet between control thread and helper process."""


class Path:
    """The openness over the time since the first sample, straight between the samples.

    `pieces` have `PIECE_SAMPLES` samples each, the last one what is left; `samples` is above 0.
    """

    def __init__(self, pieces: Sequence[bytes], samples: int) -> None:
        self.samples = samples
        self._pieces = pieces
        self._first_s = self._sample(0)[0]
        self.duration_s = self._sample(samples - 1)[0] - self._first_s

    def openness_at(self, elapsed_s: float) -> float:
        """Return the openness; before the start that of the start, past the end that of the end.

        Where several samples have the same time the last one counts.
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
        """Return the number of the first sample that is later, by bisection."""
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
