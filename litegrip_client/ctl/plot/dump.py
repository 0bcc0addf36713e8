"""Reads a dump of the flight recorder: an MCAP file, into columns and events.

What the fields mean is written in the file itself; here are only the names that are drawn.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.reader import McapReader, make_reader

from litegrip_client.errors import CommandError

STALE_AFTER_S = 0.15
"""A disabled motor is asked at 20 Hz; one that has missed three questions is silent."""


@dataclass(frozen=True)
class Happening:
    """One event of the dump, at its time of CLOCK_MONOTONIC."""

    at_s: float
    kind: str
    message: str
    data: Mapping[str, Any]


@dataclass(frozen=True)
class Dump:
    """The ticks in order, each with the fields that were known in it, and what happened."""

    about: Mapping[str, str]
    ended_ns: int
    ticks: list[dict[str, Any]]
    events: list[Happening]

    def column(self, name: str) -> list[float]:
        """Return one field of all ticks; NaN, which is not drawn, where it was unknown."""
        return [float(tick.get(name, math.nan)) for tick in self.ticks]

    def measured(self, name: str) -> list[float]:
        """Return one field of the feedback; NaN where that is too old to say anything."""
        return [
            float(tick.get(name, math.nan)) if tick.get("age_s", 0.0) <= STALE_AFTER_S else math.nan
            for tick in self.ticks
        ]


def read(path: str) -> Dump:
    """Read a dump; raises `CommandError` for a file that is none."""
    try:
        with Path(path).open("rb") as file:
            found = _read(make_reader(file))
    except OSError as error:
        raise _unreadable(path, error.strerror or str(error)) from error
    except (McapError, ValueError, KeyError, EOFError) as error:
        raise _unreadable(path, f"it is no whole MCAP file of the recorder: {error}") from error
    if not found.ticks:
        raise _unreadable(path, "there are no ticks in it")
    return found


def _read(reader: McapReader) -> Dump:
    about: dict[str, str] = {}
    for metadata in reader.iter_metadata():
        about |= metadata.metadata
    ticks: list[dict[str, Any]] = []
    events: list[Happening] = []
    ended_ns = 0
    for _schema, channel, message in reader.iter_messages():
        content = json.loads(message.data)
        if channel.topic.endswith("/tick"):
            ticks.append(content)
            ended_ns = message.log_time
        elif channel.topic.endswith("/event"):
            events.append(
                Happening(
                    content["monotonic_s"], content["name"], content["message"], content["data"]
                )
            )
    return Dump(about, ended_ns, ticks, events)


def _unreadable(path: str, why: str) -> CommandError:
    return CommandError(
        f"cannot draw {path}: {why}",
        reason="dump_unreadable",
        data={"hint": "give a file that 'litegripctl dump' names"},
    )
