"""What a process uses, from /proc."""

import os
from dataclasses import dataclass
from pathlib import Path

_TICK_S = 1.0 / os.sysconf("SC_CLK_TCK")


@dataclass(frozen=True, slots=True)
class Usage:
    """At one moment; `cpu_s` since the process began."""

    cpu_s: float
    resident_kb: int
    descriptors: int
    threads: int


def usage_of(pid: int) -> Usage:
    """Read what a process uses; raises `OSError` once it has ended."""
    proc = Path(f"/proc/{pid}")
    after_name = (proc / "stat").read_text().rpartition(")")[2].split()
    lines = (proc / "status").read_text().splitlines()
    status = dict(line.split(":", 1) for line in lines if ":" in line)
    return Usage(
        cpu_s=(int(after_name[11]) + int(after_name[12])) * _TICK_S,
        resident_kb=int(status["VmRSS"].split()[0]),
        descriptors=sum(1 for _descriptor in (proc / "fd").iterdir()),
        threads=int(status["Threads"]),
    )


def slope(points: list[tuple[float, float]]) -> float:
    """Return the slope of the line through points, by least squares; 0 for fewer than two."""
    if len(points) < 2:
        return 0.0
    mean_x = sum(x for x, _y in points) / len(points)
    mean_y = sum(y for _x, y in points) / len(points)
    square = sum((x - mean_x) ** 2 for x, _y in points)
    return sum((x - mean_x) * (y - mean_y) for x, y in points) / square if square else 0.0
