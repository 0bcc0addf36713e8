"""Which sockets belong to a channel, and what to say when no daemon answers."""

from __future__ import annotations

import errno
import grp
import os
import re
import socket
import stat
import sys
from collections.abc import Awaitable, Callable, Iterator, Mapping

from litegrip_client.core import sockets
from litegrip_client.core.sockets import CHANNEL_VARIABLE, DEFAULT_CHANNEL, SOCKET_VARIABLE
from litegrip_client.values.errors import ConnectError, ParameterError
from litegrip_client.values.tracebacks import is_of_handler

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeVar

    from litegrip_client.values.figures import Here

    _Connected = TypeVar("_Connected")

ENABLED_DIRECTORY = "/etc/systemd/system/litegripd.target.wants"
UNIT_DIRECTORIES = (
    "/etc/systemd/system",
    "/run/systemd/system",
    "/usr/local/lib/systemd/system",
    "/usr/lib/systemd/system",
    "/lib/systemd/system",
)
LONGEST_PATH = 107
"""Bytes of a Unix socket's address (sun_path less one)."""

GROUP = "litegrip"
FLEET_PROGRAM = "litegripd-fleet"
"""Gateway, portal and router; this package starts it, and does not import it."""

_CHANNEL = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")


def chosen_channel(channel: str | None) -> str:
    """Return `channel`, or else that of LITEGRIP_CHANNEL, or can0; raises `CommandError`."""
    if channel is None:
        channel = os.environ.get(CHANNEL_VARIABLE) or DEFAULT_CHANNEL
    return check_channel(channel)


def is_left_out(channel: str | None) -> bool:
    """Return True if neither this nor LITEGRIP_CHANNEL names a channel."""
    return channel is None and not os.environ.get(CHANNEL_VARIABLE)


def check_channel(channel: str) -> str:
    """Return `channel` if it can be one; raises `CommandError`.

    A channel becomes part of a path, so it must not be able to leave the directory.
    """
    if not isinstance(channel, str) or _CHANNEL.fullmatch(channel) is None:
        of = f"{CHANNEL_VARIABLE}: " if channel == os.environ.get(CHANNEL_VARIABLE) else ""
        hint = "name the daemon's channel, can0 for example"
        if isinstance(channel, str) and channel.startswith("/"):
            hint += "; a device path is [bus] channel in the daemon's configuration"
        raise ParameterError(
            f"{of}{channel!r:.80} cannot be a channel: a string of 1 to 64 letters, digits, '_',"
            " '-' and '.', and no '.' in front",
            reason="invalid_params",
            data={"hint": hint},
        )
    return channel


def socket_paths(
    channel: str, socket_path: str | None = None, environment: Mapping[str, str] | None = None
) -> list[str]:
    """Return the paths where the daemon of `channel` may be found, in the order to try.

    An explicit `socket_path` or else `LITEGRIPD_SOCKET` is the only one when given.
    """
    check_channel(channel)
    return sockets.paths(channel, socket_path, os.environ if environment is None else environment)


def is_socket_given(socket_path: str | None = None) -> bool:
    """Return True if this or `LITEGRIPD_SOCKET` names a socket; its channel is unknown then."""
    return bool(socket_path if socket_path is not None else os.environ.get(SOCKET_VARIABLE))


def in_any_shell(channel: str, socket_path: str | None = None) -> Here:
    """Return what puts into a text of ours how litegripctl is called for a program's gripper.

    The gripper is named wherever a command without could act on another: who reads a program's
    error types into a shell of their own, where its variables are not set.
    """

    def here(text: str) -> str:
        chosen = socket_path if socket_path is not None else os.environ.get(SOCKET_VARIABLE)
        if chosen:
            import shlex  # noqa: PLC0415 - seldom needed

            options = f"--socket {shlex.quote(chosen)}"
        elif channel != DEFAULT_CHANNEL or os.environ.get(CHANNEL_VARIABLE):
            options = f"-c {channel}"
        else:
            return text
        return text.replace("litegripctl ", f"litegripctl {options} ")

    return here


def channels_with_socket(environment: Mapping[str, str] | None = None) -> list[str]:
    """Return the channels that have a socket, as far as this user can see.

    A daemon that was killed may have left one.
    """
    return sorted({channel for channel, _path in _sockets(environment)})


def running_channels(environment: Mapping[str, str] | None = None) -> list[str]:
    """Return the channels whose daemons listen to this user; one that hangs listens, too."""
    return _channels("listens", environment)


def served_channels() -> list[str]:
    """Return the channels that a daemon serves, also one that does not listen to this user."""
    return sorted({*running_channels(), *_channels("closed")})


def _channels(how: str, environment: Mapping[str, str] | None = None) -> list[str]:
    return sorted({channel for channel, path in _sockets(environment) if _how(path) == how})


def _sockets(environment: Mapping[str, str] | None) -> Iterator[tuple[str, str]]:
    """Yield channels and the paths of their sockets."""
    environment = os.environ if environment is None else environment
    for directory in (*sockets.directories(environment), sockets.PORTAL_DIRECTORY):
        for name in _names(directory):
            if name.endswith(".sock") and not sockets.is_for_stops(name):
                yield name.removesuffix(".sock"), f"{directory}/{name}"


def _how(path: str) -> str:
    """Return how a socket is for this user: it "listens", or is "closed", or "left" by a daemon."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(path)
        except PermissionError:
            return "closed"
        except BlockingIOError:
            return "listens"  # more wait there than have a place: it hangs, or is busy
        except OSError:
            return "left"
    return "listens"


def is_enabled(channel: str) -> bool:
    """Return True if systemd starts a channel's daemon; one that is down was stopped or failed."""
    return os.path.lexists(f"{ENABLED_DIRECTORY}/litegripd@{channel}.service")


def enabled_channels() -> list[str]:
    """Return the channels whose daemons systemd starts."""
    ends = ("litegripd@", ".service")
    names = [name for name in _names(ENABLED_DIRECTORY) if name.startswith(ends[0])]
    return sorted(name.removeprefix(ends[0]).removesuffix(ends[1]) for name in names)


def is_unit_installed() -> bool:
    """Return True if systemd has the daemons' unit; without it, it can start none."""
    paths = [f"{directory}/litegripd@.service" for directory in UNIT_DIRECTORIES]
    return any(os.path.exists(path) for path in paths)  # noqa: PTH110 - see _names


def program_of(name: str) -> str | None:
    """Find a program beside the Python that runs this one, else where a shell finds it."""
    import shutil  # noqa: PLC0415 - seldom needed

    beside = shutil.which(name, path=os.path.dirname(sys.executable))  # noqa: PTH120 - see _names
    return beside or shutil.which(name)


def _names(directory: str) -> list[str]:
    try:
        return os.listdir(directory)  # noqa: PTH208 - pathlib takes long to import
    except OSError:
        return []  # there is none, or it is not for this user


async def reach(
    channel: str,
    socket_path: str | None,
    attempt: Callable[[str], Awaitable[_Connected]],
    *,
    left_out: bool = False,
    here: Here = str,
) -> _Connected:
    """Connect to the daemon of `channel` by `attempt`, which raises `OSError` where none answers.

    Raises `ConnectError` that lists the attempts, `CommandError` for a socket that takes all for a
    stop. With `left_out` a Python program has named no channel: the error says how to. `here` names
    the gripper in commands of the error.
    """
    failures: list[tuple[str, OSError]] = []
    for candidate in socket_paths(channel, socket_path):
        if sockets.is_for_stops(candidate):
            raise _only_for_stops(candidate)
        try:
            return await attempt(candidate)
        except OSError as error:
            if is_of_handler(error):
                raise
            failures.append((candidate, error))
    by_variable = socket_path is None
    raise _no_daemon(channel, failures, here, is_by_variable=by_variable, left_out=left_out)


def _only_for_stops(path: str) -> ParameterError:
    meant = f"{path.removesuffix(sockets.STOP_END)}.sock"
    return ParameterError(
        f"{path} is for stops alone, and what connects there stops the gripper: nothing was sent",
        reason="invalid_params",
        data={"hint": f"name the daemon's other socket: {meant}"},
    )


def _no_daemon(
    channel: str,
    failures: list[tuple[str, OSError]],
    here: Here,
    *,
    is_by_variable: bool,
    left_out: bool,
) -> ConnectError:
    """Return the error with all attempts; a single one was by a given path, not by the channel."""
    of_channel = f" for channel {channel}" if len(failures) > 1 else ""
    tried = "; ".join(f"{path}: {_why(path, error)}" for path, error in failures)
    if of_channel and not os.environ.get("XDG_RUNTIME_DIR"):
        tried += "; XDG_RUNTIME_DIR, where else it may be, is not set"
    unit = f"'systemctl start litegripd@{channel}' or " if is_unit_installed() else ""
    hint = (
        f"start {channel}'s with {unit}'litegripd {channel}', or try "
        f"without hardware: 'litegripd {channel} --simulate'"
    )
    if not of_channel:  # which channel the socket is of, and so which unit, is not known
        path = failures[0][0]
        hint = (
            f"start its daemon: 'litegripd CHANNEL --socket {path}', without hardware with"
            " --simulate"
        )
        if is_by_variable:
            hint = f"{SOCKET_VARIABLE} names that socket, whatever the channel: unset it, or {hint}"
    elif "." in channel and not is_enabled(channel):
        hint = (
            "a gripper of another machine needs a portal on this one:"
            f" 'litegripctl -c {channel} doctor' says what is missing"
        )
    elif is_enabled(channel):
        hint = f"see why it does not run: systemctl status litegripd@{channel}"
    else:
        hint = f"{_others(channel, left_out=left_out)}{hint}"
    blocked = next(filter(None, (_unblocked(path, error) for path, error in failures)), None)
    if blocked is not None:
        hint = f"{blocked}; then {hint}"
    denied = [path for path, error in failures if error.errno in (errno.EACCES, errno.EPERM)]
    if denied:
        hint = _opening(denied[0], here)
    return ConnectError(
        f"no daemon can be reached{of_channel} ({tried})",
        reason="no_daemon",
        data={
            "retryable": True,
            "hint": hint,
            "tried": [path for path, _ in failures],
            "blocked": blocked,
        },
    )


def _opening(path: str, here: Here) -> str:
    """Return what opens a socket that is closed to this user.

    A daemon is there: another one for this channel could not be started.
    """
    closed = closed_directory(path)
    if closed is None and (alone := private_owner(path)) is not None:
        return asking_for_group(alone)
    group = group_of(path) if closed is None else closed[2]
    if group is not None:
        return (
            f"join the group {group} ('sudo usermod -aG {group} $USER', then log in again);"
            + here(" 'litegripctl doctor' says what else is missing")
        )
    ask = "" if closed is None else f"{asking(closed[1])}; "
    return ask + here("'litegripctl doctor' says what opens it to you")


_CLOSE = 0.7
"""From so much likeness on (of 1) a channel is asked for."""


def _others(channel: str, *, left_out: bool) -> str:
    """Return which channel may be meant in place of `channel`, and whose daemons run."""
    from difflib import get_close_matches  # noqa: PLC0415 - seldom needed

    # left1 is no slip for left2: where grippers are numbered, both names are meant.
    stem = channel.rstrip("0123456789")
    others = [c for c in channels_with_socket() if c.rstrip("0123456789") != stem]
    alike = {other.lower(): other for other in others}
    close = [] if left_out else get_close_matches(channel.lower(), alike, 1, _CLOSE)
    meant = f"did you mean {alike[close[0]]}? " if close else ""
    if others := [other for other in running_channels() if other != channel]:
        how = f" (choose: LiteGrip({others[0]!r}), or {CHANNEL_VARIABLE}={others[0]})"
        return f"{meant}running: {', '.join(others)}{how if left_out else ''}; "
    if closed := [other for other in _channels("closed") if other != channel]:
        how = f"'litegripctl -c {closed[0]} doctor' says what opens it"
        return f"{meant}running: {', '.join(closed)}, closed to this user ({how}); "
    return meant


def closed_directory(path: str) -> tuple[str, str, str | None] | None:
    """Return what keeps this user from a path: a directory, whose it is, the group that may enter.

    None where all directories of the path are open to this user, or are not there.
    """
    parts, directory = os.path.abspath(path).split("/")[1:], "/"  # noqa: PTH100 - see _names
    for part in parts:
        try:
            status = os.stat(directory)  # noqa: PTH116 - see _names
        except (OSError, ValueError):
            return None
        if stat.S_ISDIR(status.st_mode) and not os.access(directory, os.X_OK):
            owner = _user_name(status.st_uid)
            group = _group_name(status.st_gid) if status.st_mode & stat.S_IXGRP else None
            is_closed = group == "root" or _is_private(group, owner, status.st_uid)
            return directory, owner, None if is_closed else group
        directory = f"{directory.rstrip('/')}/{part}"
    return None


def asking(owner: str) -> str:
    """Return what to do about a directory that is open to its owner alone."""
    return f"ask {owner} for a socket in a directory that you may enter ([rpc] socket)"


def asking_for_group(owner: str) -> str:
    """Return what to do about a socket that is for its owner alone."""
    return f"ask {owner}, whose configuration opens it to others by [rpc] group"


FIRST_PERSON_UID = 1000
"""From this number on users are persons, as login.defs has it; a service has a smaller one."""


def private_owner(path: str) -> str | None:
    """Return whom alone a socket is for: a person whose own group it has; None for others."""
    try:
        status = os.stat(path)  # noqa: PTH116 - see _names
    except (OSError, ValueError):
        return None
    owner = _user_name(status.st_uid)
    return owner if _is_private(_group_name(status.st_gid), owner, status.st_uid) else None


def _is_private(group: str | None, owner: str, uid: int) -> bool:
    """Return True for the group that has one person's name: nobody else is to join it."""
    return group == owner and group != GROUP and uid >= FIRST_PERSON_UID


def _user_name(uid: int) -> str:
    import pwd  # noqa: PLC0415 - seldom needed

    try:
        return pwd.getpwuid(uid).pw_name
    except KeyError:
        return f"uid {uid}"


def _group_name(gid: int) -> str | None:
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return None


def group_of(path: str) -> str | None:
    """Return the group that opens a socket, as far as this user can see it; None for no group."""
    try:
        name = _group_name(os.stat(path).st_gid)  # noqa: PTH116 - see _names
    except OSError:
        return GROUP
    if name != "root":
        return name or GROUP
    try:  # nobody is advised to join that one
        return grp.getgrnam(GROUP).gr_name
    except KeyError:
        return None


def _why(path: str, error: OSError) -> str:
    if error.errno in (errno.EACCES, errno.EPERM):
        closed = closed_directory(path)
        if closed is not None:
            directory, owner, group = closed
            also = f" and the group {group}" if group else ""
            return f"permission denied: its directory {directory} is only for {owner}{also}"
        if (alone := private_owner(path)) is not None:
            return f"permission denied: only for {alone}"
        group = group_of(path)
        return f"permission denied: only for {f'the group {group}' if group else 'who started it'}"
    if error.errno == errno.ECONNREFUSED and not _is_socket(path):
        return "not a socket, but a file or folder: nobody can listen there"
    if error.errno == errno.ENOENT and os.path.islink(path):  # noqa: PTH114 - see _names
        return f"a link to {os.readlink(path)}, which is missing: nobody can listen there"  # noqa: PTH115
    if error.errno is None and len(os.fsencode(path)) > LONGEST_PATH:
        return f"too long: a socket's path has {LONGEST_PATH} bytes at most"
    known = {
        errno.ELOOP: "links that lead to one another: nobody can listen there",
        errno.ENOTDIR: "a part of this path is a file, no folder: nobody can listen there",
        errno.EPROTOTYPE: "a socket of another program, not of a daemon",
        errno.ENOENT: "missing",
        errno.ECONNREFUSED: "refused: nobody listens",
        errno.EAGAIN: "the daemon accepts no connection in time",
    }
    return known.get(error.errno or 0, error.strerror or str(error))


def _unblocked(path: str, error: OSError) -> str | None:
    """Return what to do first where no daemon can listen at a path, or None."""
    if error.errno is None and len(os.fsencode(path)) > LONGEST_PATH:
        return "name a shorter path"
    if error.errno == errno.ENOTDIR:
        return "name a path in a folder"
    is_dangling = error.errno == errno.ENOENT and os.path.islink(path)  # noqa: PTH114 - see _names
    is_file = error.errno == errno.ECONNREFUSED and not _is_socket(path)
    if is_dangling or is_file or error.errno in (errno.ELOOP, errno.EPROTOTYPE):
        return f"move {path} away, for no daemon can listen there before"
    return None


def _is_socket(path: str) -> bool:
    """Return True for a socket; what cannot be looked at counts as one."""
    if path.startswith("\0"):
        return True
    try:
        return stat.S_ISSOCK(os.stat(path).st_mode)  # noqa: PTH116 - see _names
    except OSError:
        return True
