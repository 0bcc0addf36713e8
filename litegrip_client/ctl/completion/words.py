"""What completes an argument beyond its parser's choices: what there is here, and at the daemon.

A daemon that does not answer soon completes nothing; one behind ssh is not asked, for that may want
a password.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Mapping

from litegrip_client.blocking import connect
from litegrip_client.ctl.parser import CHANNEL_VARIABLE, DEFAULT_CHANNEL
from litegrip_client.discovery import running_channels
from litegrip_client.errors import LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.ctl.completion.reading import Words

FILES = "files"
"""The shell's own completion of paths."""

_ANSWER_WITHIN_S = 1.0


def words_of(sources: Iterable[str], given: Mapping[str, str]) -> Words:
    """Return what the sources know, with the values that are `given` on the command line."""
    return [word for name in sources if name != FILES for word in _SOURCES[name](given)]


def _channels(_given: Mapping[str, str]) -> Words:
    return [(channel, "a daemon's") for channel in running_channels()]


def _trajectories(given: Mapping[str, str]) -> Words:
    rows = _asked(given, "trajectory.list").get("trajectories", ())
    return [(str(row["name"]), f"{row.get('samples')} samples") for row in rows]


def _own_trajectories(_given: Mapping[str, str]) -> Words:
    from litegrip_client.trajectory_files import list_trajectories  # noqa: PLC0415 - seldom needed

    return [(file.name, "of this user") for file in list_trajectories()]


def _jobs(given: Mapping[str, str]) -> Words:
    rows = _asked(given, "job.list").get("jobs", ())
    return [(str(row["job"]), str(row.get("kind"))) for row in rows if row["state"] == "running"]


def _fields(_given: Mapping[str, str]) -> Words:
    from dataclasses import fields  # noqa: PLC0415 - seldom needed

    from litegrip_client.motion_config import MotionConfig  # noqa: PLC0415

    return [(field.name, "") for field in fields(MotionConfig)]


def _settings(given: Mapping[str, str]) -> Words:
    return [(f"{name}=", text) for name, text in _fields(given)]


def _templates(_given: Mapping[str, str]) -> Words:
    return [("normal", "a template"), ("reverse", "a template")]


def _asked(given: Mapping[str, str], method: str) -> dict[str, Any]:
    if "ssh_host" in given:
        return {}
    channel = given.get("channel") or os.environ.get(CHANNEL_VARIABLE) or DEFAULT_CHANNEL
    try:
        with connect(channel, given.get("socket"), _ANSWER_WITHIN_S) as connection:
            return connection.call(method)
    except LiteGripError:
        return {}  # a shell has no place for what is wrong; the command itself will tell


_SOURCES: Mapping[str, Callable[[Mapping[str, str]], Words]] = {
    "channels": _channels,
    "trajectories": _trajectories,
    "own_trajectories": _own_trajectories,
    "jobs": _jobs,
    "fields": _fields,
    "settings": _settings,
    "templates": _templates,
}
