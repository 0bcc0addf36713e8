"""Released versions beside the sources: the same commands with each, in turn; times three times.

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


class Figure(NamedTuple):
    """A command, how much of it, which rows of it are the version's own, and how often it runs.

    Without an amount the command takes the folder of the packages, and else it runs with them.
    """

    module: str
    amount: float | None
    rows: str
    rounds: int = 3


FIGURES = (
    Figure("bench.timing.reads", 20, r"get_state\(\)"),
    Figure("bench.timing.instructions", 10, ": litegripd$", 1),
    Figure("bench.timing.startup", None, "litegripctl (stop|state)$", 1),
    Figure("bench.timing.stop", 60, "^(stop|other) socket"),
    Figure("bench.timing.holding", 10, "^holding"),
)


def rows(figure: Figure, share: float, sources: str, folder: str) -> list[str]:
    """Run a command with the packages of a version; return its rows, or why there are none.

    It runs in a folder that has no modules: Python looks there first.
    """
    if figure.amount is None:
        words, path = [sources.partition(":")[0]], str(ROOT)
    else:
        words, path = [f"{max(figure.amount * share, 1):g}"], sources
    done = subprocess.run(
        [sys.executable, "-m", figure.module, *words],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": path},
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
            for _ in range(figure.rounds):
                for version, path in sources.items():
                    for row in rows(figure, share, path, folder):
                        print(f"  {version:<{width}}  {row}", flush=True)


if __name__ == "__main__":
    main()
