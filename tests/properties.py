"""How property tests choose their examples: always the same ones, or other ones every night.

`make check` plays the same examples each time, 50 where a test does not say how many, so that only
a change makes it fail, and no machine that is slow.
LITEGRIPD_PROPERTIES=nightly plays four times as many, and other ones each time; `make nightly` does
so with the day as the seed. A failure prints how it is played again; the same variable and
`pytest --hypothesis-seed=SEED` play the whole night again.
"""

import os
from typing import Any

from hypothesis import settings

NIGHTLY = "nightly"
NIGHTLY_FACTOR = 4

settings.register_profile("usual", derandomize=True, deadline=None, max_examples=50)
settings.register_profile(
    NIGHTLY, derandomize=False, deadline=None, print_blob=True, max_examples=50 * NIGHTLY_FACTOR
)


def chosen() -> str:
    """Return the profile of this run; `tests/conftest.py` loads it for tests that say nothing."""
    return os.environ.get("LITEGRIPD_PROPERTIES", "usual")


def examples(count: int, profile: str | None = None, **more: Any) -> settings:
    """Return the settings of a property test with `count` examples, more of them at night.

    `profile` is that of LITEGRIPD_PROPERTIES by default; an unknown name raises
    `InvalidArgument` of Hypothesis.
    """
    profile = profile or chosen()
    factor = NIGHTLY_FACTOR if profile == NIGHTLY else 1
    return settings(settings.get_profile(profile), max_examples=factor * count, **more)
