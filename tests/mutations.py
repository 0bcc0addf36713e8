"""Damage to contents, for tests that nothing is ever half read.

LITEGRIPD_FUZZ_MUTATIONS sets another number of them, for a long run; LITEGRIPD_FUZZ_SEED another
seed.
"""

import os
import random
from collections.abc import Iterator

MUTATIONS = int(os.environ.get("LITEGRIPD_FUZZ_MUTATIONS", "20000"))
SEED = int(os.environ.get("LITEGRIPD_FUZZ_SEED", "1"))


def mutated(whole: bytes, *, header: int = 1) -> Iterator[bytes]:
    """Return contents with one to four faults each, of which every second lies in the `header`."""
    chance = random.Random(SEED)
    for _ in range(MUTATIONS):
        content = bytearray(whole)
        for _ in range(chance.choice((1, 1, 2, 4))):
            end = min(chance.choice((header, len(content))), len(content))
            at = chance.randrange(end) if end else 0
            how = chance.randrange(5)
            if how == 0 and end:
                content[at] ^= 1 << chance.randrange(8)
            elif how == 1 and end:
                content[at] = chance.choice((0, 0x7F, 0x80, 0xFF, chance.randrange(256)))
            elif how == 2:
                del content[at : at + chance.choice((1, 8, 40))]
            elif how == 3:
                content[at:at] = content[: chance.choice((1, 8, 40))]
            elif end:
                content[at] = chance.choice(b'0123456789.-+eE,:"[]{}')
        yield bytes(content)
