"""A curve as text: filled columns of block characters over a line of time.

It must not know what is drawn.
"""

from __future__ import annotations

from collections.abc import Sequence

_EIGHTHS = " ▁▂▃▄▅▆▇█"


def block_chart(
    points: Sequence[tuple[float, float]],
    *,
    top: float,
    unit: str,
    width: int = 72,
    height: int = 10,
    spans: Sequence[tuple[float, float]] = (),
    span_label: str = "",
) -> list[str]:
    """Return the lines of a chart, `width` columns wide besides its labels.

    `points` are times in s, which never run backwards, and values of 0 to `top`; what is outside
    is drawn at the edge. A column shows the value at its middle, on the line between the points.
    `spans`, from when to when, are marked below, each in one column at least.
    """
    labels = [f"{share * top:.0f} {unit}" for share in (1.0, 0.5, 0.0)]
    margin = max(map(len, labels))
    levels = [round(_share(value, top) * height * 8) for value in _resampled(points, width)]
    lines = []
    for row in range(height):
        below = (height - 1 - row) * 8
        label = {0: labels[0], height // 2: labels[1], height - 1: labels[2]}.get(row, "")
        blocks = "".join(_EIGHTHS[min(max(level - below, 0), 8)] for level in levels)
        lines.append(f"{label:>{margin}} ┤{blocks}".rstrip())
    first, last = (f"{points[end][0]:.2f} s" for end in (0, -1))
    lines.append(f"{'':>{margin}} └{'─' * width}")
    if spans:
        lines.append(f"{span_label:>{margin}}  {_marks(points, spans, width)}".rstrip())
    lines.append(f"{'':>{margin}}  {first}{last:>{max(width - len(first), len(last) + 1)}}")
    return lines


def _share(value: float, top: float) -> float:
    return min(max(value / top, 0.0), 1.0)


def _marks(
    points: Sequence[tuple[float, float]], spans: Sequence[tuple[float, float]], width: int
) -> str:
    begin_s, span_s = points[0][0], points[-1][0] - points[0][0]
    marks = [" "] * width
    for from_s, to_s in spans:
        first, last = (
            min(int(width * (at_s - begin_s) / span_s), width - 1) if span_s > 0.0 else 0
            for at_s in (from_s, to_s)
        )
        marks[first : last + 1] = "━" * (last + 1 - first)
    return "".join(marks)


def _resampled(points: Sequence[tuple[float, float]], width: int) -> list[float]:
    begin_s, span_s = points[0][0], points[-1][0] - points[0][0]
    values, at = [], 0
    for column in range(width):
        time_s = begin_s + span_s * (column + 0.5) / width
        while at + 1 < len(points) and points[at + 1][0] <= time_s:
            at += 1
        (here_s, here), (next_s, after) = points[at], points[min(at + 1, len(points) - 1)]
        share = (time_s - here_s) / (next_s - here_s) if next_s > here_s else 0.0
        values.append(here + (after - here) * share)
    return values
