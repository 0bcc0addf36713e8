"""Released versions beside the sources: the same commands with each, in turn, three times.

python -m bench.beside [SHARE of the usual rounds and times, default 1]

The released ones are the wheels in tests/released. Of what a command prints only the rows of the
daemon or the client are shown: what is beside them there is the same for all versions. A command
that a version cannot run, since it lacks what that needs, is said so. Needs to be root, and
valgrind.
"""

import os
import re
import subprocess
import sys
import tempfile
from pathlib import Path
from typing import NamedTuple

from tests.versions.released import RELEASED, unpacked

ROOT = Path(__file__).parents[1]
ROUNDS = 3


class Figure(NamedTuple):
    """A command, how much of it, and which rows of it are the version's own."""

    module: str
    amount: float | None
    rows: str


FIGURES = (
    Figure("bench.timing.reads", 20, r"get_state\(\)"),
    Figure("bench.timing.instructions", 5, ": litegripd$"),
    Figure("bench.timing.startup", None, "litegripctl (stop|state)$"),
    Figure("bench.timing.stop", 60, "^(stop|other) socket"),
    Figure("bench.timing.holding", 10, "^holding"),
    Figure("bench.timing.pump", 8, "real-time"),
)


def rows(figure: Figure, share: float, sources: str) -> list[str]:
    """Run a command with the packages of a version; return its rows, or why there are none."""
    amounts = [] if figure.amount is None else [f"{max(figure.amount * share, 1):g}"]
    done = subprocess.run(
        [sys.executable, "-P", "-m", figure.module, *amounts],
        env={**os.environ, "PYTHONPATH": sources},
        capture_output=True,
        text=True,
        check=False,
    )
    if done.returncode:
        return [f"cannot run it: {done.stderr.rstrip().rpartition(chr(10))[2]}"]
    return [row for row in done.stdout.splitlines() if re.search(figure.rows, row)]


def main() -> None:
    """Print what each version reaches, figure by figure."""
    share = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    with tempfile.TemporaryDirectory() as folder:
        sources = {
            version: f"{unpacked(version, Path(folder, version)).folder}:{ROOT}"
            for version in RELEASED
        }
        sources["now"] = str(ROOT)
        width = max(map(len, sources))
        for figure in FIGURES:
            print(figure.module)
            for _ in range(ROUNDS):
                for version, path in sources.items():
                    for row in rows(figure, share, path):
                        print(f"  {version:<{width}}  {row}", flush=True)


if __name__ == "__main__":
    main()
