"""Asks the daemon's program what a channel's configuration says, for a daemon that does not run.

The client reads no TOML, and what a key may be is the daemon's to know.
"""

from __future__ import annotations

import json
import os
import pwd
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

from litegrip_client.doctor.facts import Configuration

DIRECTORY = Path("/etc/litegripd")
CHECK_WITHIN_S = 10.0
USER = "litegrip"
"""As whom systemd runs the daemons."""
_WRONG = 2
"""The exit code of litegripd for a configuration that is wrong, and for its usage."""


def configuration(channel: str) -> Configuration | None:
    """Have the file of `channel` checked, or the common one; None where there is neither."""
    candidates = (DIRECTORY / f"{channel}.toml", DIRECTORY / "litegripd.toml")
    path = next((str(path) for path in candidates if os.path.isfile(path)), None)  # noqa: PTH113
    if path is None:
        return None
    if not os.access(path, os.R_OK):
        return Configuration(path, unchecked="this user may not read it")
    program = _program()
    if program is None:
        return Configuration(path, unchecked="the program litegripd is not found here")
    identity = _daemons_identity()
    as_user = USER if identity else None
    command = [program, channel, "--config", path, "--check"]
    try:
        done = subprocess.run(
            command,
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=CHECK_WITHIN_S,
            check=False,
            **identity,
        )
    except (OSError, subprocess.TimeoutExpired) as error:
        return Configuration(
            path, unchecked=f"litegripd cannot be run{f' as {USER}' if identity else ''}: {error}"
        )
    told = done.stderr.decode(errors="replace").strip()
    if done.returncode == _WRONG and not told.startswith("usage:"):  # of an older litegripd
        why = told.rpartition("\n")[2].removeprefix("litegripd: ")
        return Configuration(path, error=why, as_user=as_user)
    try:
        return Configuration(path, content=json.loads(done.stdout), as_user=as_user)
    except ValueError:
        last = told.rpartition("\n")[2] or "no word"
        why = f"litegripd --check ended with {done.returncode}: {last}"
        return Configuration(path, unchecked=why)


def _daemons_identity() -> dict[str, Any]:
    """Return how a program is run as the daemons' user by root, who may read what that one may not.

    Empty for everybody else, and where there is no such user.
    """
    if os.getuid() != 0:
        return {}
    try:
        entry = pwd.getpwnam(USER)
    except KeyError:
        return {}
    groups = os.getgrouplist(USER, entry.pw_gid)
    return {"user": entry.pw_uid, "group": entry.pw_gid, "extra_groups": groups}


def _program() -> str | None:
    """Find litegripd beside the Python that runs this program, else where a shell finds it."""
    beside = shutil.which("litegripd", path=str(Path(sys.executable).parent))
    return beside or shutil.which("litegripd")
