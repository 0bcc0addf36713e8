"""A helper process with one heavy operation: parsing a 10-minute trajectory at 200 Hz."""

import struct
from collections.abc import Iterator

from litegripd.app.helper_main import PIECE_BYTES, Parameters, serve

_SAMPLE = struct.Struct("<5d")
_SAMPLES = 600 * 200


def load_trajectory(_parameters: Parameters) -> Iterator[bytes]:
    """Unpack 120,000 samples, check each, and pass the 4.8 MB on in pieces."""
    packed = b"".join(
        _SAMPLE.pack(index / 200, (index % 400) / 400, 0.1, 0.0, 0.0) for index in range(_SAMPLES)
    )
    samples = list(_SAMPLE.iter_unpack(packed))
    if any(not 0.0 <= sample[1] <= 1.0 for sample in samples):
        raise ValueError("openness outside [0, 1]")
    for start in range(0, len(packed), PIECE_BYTES):
        yield packed[start : start + PIECE_BYTES]


if __name__ == "__main__":
    serve({"load_trajectory": load_trajectory})
