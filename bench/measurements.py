"""Writes docs/generated/measurements.md: what was measured on one machine, each beside its rivals.

python -m bench.measurements [SHARE of the usual rounds and times, default 1]

Every table is what one command has printed. Needs to be root, for real-time rights, and valgrind.
"""

import importlib.metadata
import os
import platform
import subprocess
import sys
import time
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[1]
PAGE = ROOT / "docs/generated/measurements.md"
_HEAD = """\
# Measurements

Written by `make bench` on {date}, of {version} ({revision}): {processors} processors ({model}),
Linux {kernel}, Python {python}. The load was {load} before the first and after the last table. A
busy machine changes times, and ratios of one run less. Measure on your own machine.
"""


class Section(NamedTuple):
    """One command, what it measures, and how much of it: a count or seconds."""

    title: str
    says: str
    module: str
    amounts: tuple[float, ...] = ()
    least: float = 1


SECTIONS = (
    Section(
        "One read of the state",
        "An echo of the same size is the floor. All others hand out one dictionary; the rivals'"
        " processes do nothing else, the daemon has its 200 ticks a second.",
        "bench.timing.rivals",
        (40,),
    ),
    Section(
        "Many reads of the state at once",
        "One client, and 60, each of which asks once a round. Times are those of an epoll loop.",
        "bench.timing.rate",
        (40,),
    ),
    Section(
        "What a read takes a server",
        "Instructions in the user's space, by valgrind: a busy machine changes nothing.",
        "bench.timing.instructions",
        (20,),
    ),
    Section(
        "What a command takes to start",
        "Instructions in the user's space, by valgrind: a busy machine changes nothing.",
        "bench.timing.startup",
    ),
    Section(
        "From a stop to the first frame that stops",
        "Alone, and beside clients that ask as fast as they are answered.",
        "bench.timing.stop",
        (200,),
    ),
    Section(
        "Ticks beside clients",
        "The daemon, the plain design of two threads in one interpreter, and the vendor's pacing.",
        "bench",
        (20,),
    ),
    Section(
        "Holding over SLCAN",
        "What the daemon and the process that drives the adapter take of a processor.",
        "bench.timing.holding",
        (20,),
    ),
    Section(
        "Released versions and now",
        "The same commands with the packages of each, in turn.",
        "bench.beside",
        (1,),
        least=0,
    ),
    Section(
        "SLCAN on a busy machine",
        "Five loops that never wait beside the process that drives the adapter.",
        "bench.timing.pump",
        (20,),
    ),
)


def revision() -> str:
    """Return the commit that is measured, marked where files differ from it."""
    done = subprocess.run(
        ["git", "describe", "--always", "--dirty", "--exclude=*"],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    return done.stdout.strip() or "no repository"


def processor() -> str:
    """Return the processor's own name."""
    rows = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    return next((row.partition(": ")[2] for row in rows if row.startswith("model name")), "?")


def section(one: Section, share: float) -> str:
    """Run a command; return its part of the page."""
    amounts = [f"{max(amount * share, one.least):g}" for amount in one.amounts]
    words = ["-m", one.module, *amounts]
    done = subprocess.run(
        [sys.executable, *words], cwd=ROOT, capture_output=True, text=True, check=False
    )
    if done.returncode:
        raise SystemExit(f"python {' '.join(words)} ended with {done.returncode}:\n{done.stderr}")
    printed = done.stdout.rstrip()
    print(f"\n{one.title}\n{printed}", flush=True)
    return f"## {one.title}\n\n{one.says} `python {' '.join(words)}`:\n\n```\n{printed}\n```\n"


def main() -> None:
    share = float(sys.argv[1]) if len(sys.argv) > 1 else 1.0
    date = time.strftime("%Y-%m-%d")
    before = os.getloadavg()[0]
    parts = [section(one, share) for one in SECTIONS]
    head = _HEAD.format(
        date=date,
        version=f"litegripd {importlib.metadata.version('litegripd')}",
        revision=revision(),
        processors=os.cpu_count(),
        model=processor(),
        kernel=platform.release(),
        python=platform.python_version(),
        load=f"{before:.1f} and {os.getloadavg()[0]:.1f}",
    )
    PAGE.write_text("\n".join([head, *parts]), encoding="utf-8")
    print(f"written: {PAGE.relative_to(ROOT)}")


if __name__ == "__main__":
    main()
