"""What gateway and portal say of many sessions at once: samples of the state, and signs of life.

One message for all of a machine's grippers in place of one for each: what a message costs, not its
length, is what a network of many grippers costs. As everywhere, what arrives may be anything.
"""

import json
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, TypeGuard

from litegrip_fleet.wire.daemon_lines import is_sample
from litegrip_fleet.wire.messages import VERSION, BadMessageError, Reply

TOGETHER = "together"
"""Of what a gateway says of itself to `open`: the gripper by whose keys such messages go."""

LONGEST_BYTES = 57_344
"""Of a message; zenoh's longest is 64 KiB, which it sends undivided."""

MOST_LIVES = 128
"""So many sessions in one message."""

_ROW_BYTES = 96
"""Of a row's names and number in the table of a message, at most."""


@dataclass(frozen=True, slots=True)
class Sample:
    """A sample of the state on its way to a session: the daemon's line, with its newline.

    `generation` is the count of stops that the gateway knew of.
    """

    gripper: str
    session: str
    generation: int | None
    line: bytes


@dataclass(frozen=True, slots=True)
class Life:
    """That a session's client lived at `at_s`, and the last push that it got; as in `Ask`."""

    gripper: str
    session: str
    got: int
    at_s: float | None


def packed_samples(samples: Iterable[Sample]) -> Iterator[bytes]:
    """Return messages that have all samples, each as long as it may be."""
    rows: list[Sample] = []
    size_bytes = 0
    for sample in samples:
        own_bytes = len(sample.line) + _ROW_BYTES
        if rows and size_bytes + own_bytes > LONGEST_BYTES:
            yield _with_table(rows)
            rows, size_bytes = [], 0
        rows.append(sample)
        size_bytes += own_bytes
    if rows:
        yield _with_table(rows)


def _with_table(rows: Sequence[Sample]) -> bytes:
    table = [[row.gripper, row.session, row.generation] for row in rows]
    head = json.dumps({"v": VERSION, "to": table}, separators=(",", ":")).encode()
    return b"".join((head, b"\n", *(row.line for row in rows)))


def samples_in(payload: bytes) -> list[Sample]:
    """Return the samples of a message; raises `BadMessageError`."""
    head, _newline, body = payload.partition(b"\n")
    table = _rows_in(head, "to")[1]
    *lines, rest = body.split(b"\n")
    if len(table) != len(lines) or rest:
        raise BadMessageError(f"{len(table)} samples are announced, {len(lines)} are there")
    samples = []
    for row, line in zip(table, lines, strict=True):
        gripper, session, generation = _fitting(row, 3)
        if not (_is_count(generation) or generation is None) or not is_sample(line):
            raise BadMessageError("a row is no sample")
        samples.append(Sample(_text(gripper), _text(session), generation, line + b"\n"))
    return samples


def packed_lives(lives: Iterable[Life]) -> bytes:
    """Return the message that says of at most `MOST_LIVES` sessions that they live."""
    rows = [[one.gripper, one.session, one.got, one.at_s] for one in lives]
    return json.dumps({"v": VERSION, "lives": rows}, separators=(",", ":")).encode()


def lives_in(payload: bytes) -> list[Life]:
    """Return which sessions live; raises `BadMessageError`."""
    rows = _rows_in(payload, "lives")[1]
    lives = []
    for row in rows[:MOST_LIVES]:
        gripper, session, got, at_s = _fitting(row, 4)
        if not _is_count(got) or not (at_s is None or _is_number(at_s)):
            raise BadMessageError("a row is no sign of life")
        lives.append(Life(_text(gripper), _text(session), got, at_s))
    return lives


def packed_replies(now_s: float, replies: Iterable[tuple[Life, Reply]]) -> bytes:
    """Return the answer to signs of life, which has the replies to those that could be taken."""
    rows = [
        [life.gripper, life.session, reply.took, reply.sent, reply.generation, reply.gone]
        for life, reply in replies
    ]
    return json.dumps({"v": VERSION, "now_s": now_s, "lives": rows}, separators=(",", ":")).encode()


def replies_in(payload: bytes) -> dict[tuple[str, str], Reply]:
    """Return the replies by gripper and session; raises `BadMessageError`."""
    value, rows = _rows_in(payload, "lives")
    now_s = value.get("now_s")
    if not _is_number(now_s):
        raise BadMessageError("an answer without a time")
    replies = {}
    for row in rows[:MOST_LIVES]:
        gripper, session, took, sent, generation, gone = _fitting(row, 6)
        is_one = _is_count(took) and _is_count(sent)
        is_one = is_one and (generation is None or _is_count(generation))
        if not is_one or not (gone is None or isinstance(gone, dict)):
            raise BadMessageError("a row is no reply")
        reply = Reply(took, sent, now_s, generation, gone)
        replies[_text(gripper), _text(session)] = reply
    return replies


def _rows_in(payload: bytes, name: str) -> tuple[dict[str, Any], list[Any]]:
    try:
        value = json.loads(payload)
    except (ValueError, RecursionError) as error:
        raise BadMessageError(f"what came is not JSON: {error}") from error
    if not isinstance(value, dict) or value.get("v") != VERSION:
        raise BadMessageError(f"only version {VERSION} is spoken here")
    rows = value.get(name)
    if not isinstance(rows, list):
        raise BadMessageError(f"{name} is missing")
    return value, rows


def _fitting(row: object, count: int) -> list[Any]:
    """Return a row's first members; a newer minor version may have more."""
    if not isinstance(row, list) or len(row) < count:
        raise BadMessageError(f"a row has {count} members")
    return row[:count]


def _text(value: object) -> str:
    if not isinstance(value, str) or len(value) > 32:
        raise BadMessageError("a row has no name")
    return value


def _is_count(value: object) -> bool:
    return type(value) is int and 0 <= value < 2**53


def _is_number(value: object) -> TypeGuard[float]:
    return type(value) in (int, float) and abs(value) < 2**53  # type: ignore[arg-type] # NaN is not
