"""Which socket belongs to a channel, and what to say when no daemon answers there."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Awaitable, Callable, Mapping

from litegrip_client.errors import ConnectError, ParameterError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeVar

    _Connected = TypeVar("_Connected")

SOCKET_VARIABLE = "LITEGRIPD_SOCKET"
SYSTEM_DIRECTORY = "/run/litegripd"
ENABLED_DIRECTORY = "/etc/systemd/system/litegripd.target.wants"
UNIT_DIRECTORIES = (
    "/etc/systemd/system",
    "/run/systemd/system",
    "/usr/local/lib/systemd/system",
    "/usr/lib/systemd/system",
    "/lib/systemd/system",
)
GROUP = "litegrip"

_CHANNEL = re.compile(r"[A-Za-z0-9_-][A-Za-z0-9_.-]{0,63}")


def check_channel(channel: str) -> str:
    """Return `channel` if it can be one; raises `CommandError`.

    A channel becomes part of a path, so it must not be able to leave the directory.
    """
    if not isinstance(channel, str) or _CHANNEL.fullmatch(channel) is None:
        raise ParameterError(
            f"{channel!r:.80} cannot be a channel: 1 to 64 letters, digits, '_', '-' and '.', "
            "and no '.' in front",
            reason="invalid_params",
            data={"hint": "name the daemon's channel, can0 for example"},
        )
    return channel


def socket_paths(
    channel: str, path: str | None = None, environment: Mapping[str, str] | None = None
) -> list[str]:
    """List where the daemon of `channel` may be found, in the order to try.

    An explicit `path` or else `LITEGRIPD_SOCKET` is the only one when given.
    """
    check_channel(channel)
    environment = os.environ if environment is None else environment
    chosen = path if path is not None else environment.get(SOCKET_VARIABLE)
    if chosen:
        return [os.fspath(chosen)]
    return [f"{directory}/{channel}.sock" for directory in _directories(environment)]


def is_socket_given(path: str | None = None) -> bool:
    """Return True if `path` or `LITEGRIPD_SOCKET` names a socket; its channel is unknown then."""
    return bool(path if path is not None else os.environ.get(SOCKET_VARIABLE))


def running_channels(environment: Mapping[str, str] | None = None) -> list[str]:
    """List the channels whose sockets there are, as far as this user can see them.

    A daemon that was killed may have left one: whether somebody answers is seen by connecting.
    """
    environment = os.environ if environment is None else environment
    names = {name for directory in _directories(environment) for name in _names(directory)}
    return sorted(
        name.removesuffix(".sock")
        for name in names
        if name.endswith(".sock") and not name.endswith(".stop.sock")
    )


def is_enabled(channel: str) -> bool:
    """Return True if systemd starts a channel's daemon; one that is down was stopped or failed."""
    return os.path.lexists(f"{ENABLED_DIRECTORY}/litegripd@{channel}.service")


def is_unit_installed() -> bool:
    """Return True if systemd has the daemons' unit; without it, it can start none."""
    paths = [f"{directory}/litegripd@.service" for directory in UNIT_DIRECTORIES]
    return any(os.path.exists(path) for path in paths)  # noqa: PTH110 - see _names


def _names(directory: str) -> list[str]:
    try:
        return os.listdir(directory)  # noqa: PTH208 - pathlib takes long to import
    except OSError:
        return []  # there is none, or it is not for this user


def _directories(environment: Mapping[str, str]) -> tuple[str, str]:
    own = environment.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}"
    return SYSTEM_DIRECTORY, f"{own}/litegripd"


async def reach(
    channel: str, path: str | None, attempt: Callable[[str], Awaitable[_Connected]]
) -> _Connected:
    """Connect to the daemon of `channel` by `attempt`, which raises `OSError` where none answers.

    Raises `ConnectError` that lists the attempts.
    """
    failures: list[tuple[str, OSError]] = []
    for candidate in socket_paths(channel, path):
        try:
            return await attempt(candidate)
        except OSError as error:  # noqa: PERF203 - two turns at most
            failures.append((candidate, error))
    raise _no_daemon(channel, failures)


def _no_daemon(channel: str, failures: list[tuple[str, OSError]]) -> ConnectError:
    """Say what was tried; a single path was given, so that it and not the channel was asked for."""
    of_channel = f" for channel {channel}" if len(failures) > 1 else ""
    tried = "; ".join(f"{path}: {_why(path, error)}" for path, error in failures)
    unit = f"'systemctl start litegripd@{channel}' or " if is_unit_installed() else ""
    hint = (
        f"start one with {unit}'litegripd {channel}', or try "
        f"without hardware: 'litegripd {channel} --simulate'"
    )
    if not of_channel:  # which channel the socket is of, and so which unit, is not known
        path = failures[0][0]
        hint = (
            f"start its daemon: 'litegripd CHANNEL --socket {path}', without hardware with"
            " --simulate"
        )
    elif is_enabled(channel):
        hint = f"see why it does not run: systemctl status litegripd@{channel}"
    denied = [path for path, error in failures if error.errno in (errno.EACCES, errno.EPERM)]
    if denied:
        group = _group_of(denied[0])
        hint = (
            f"join the group {group} ('sudo usermod -aG {group} $USER', then log in again); {hint}"
        )
    return ConnectError(
        f"no daemon can be reached{of_channel} ({tried})",
        reason="no_daemon",
        data={"retryable": True, "hint": hint, "tried": [path for path, _ in failures]},
    )


def _group_of(path: str) -> str:
    """Name the group that may open a socket, as far as this user can see it."""
    import grp  # noqa: PLC0415 - seldom needed

    try:
        name = grp.getgrgid(os.stat(path).st_gid).gr_name  # noqa: PTH116 - see _names
    except (OSError, KeyError):
        return GROUP
    return GROUP if name == "root" else name  # nobody is told to join that one


def _why(path: str, error: OSError) -> str:
    if error.errno in (errno.EACCES, errno.EPERM):
        return f"permission denied: only for the group {_group_of(path)}"
    known = {
        errno.ENOENT: "missing",
        errno.ECONNREFUSED: "refused: nobody listens",
        errno.EAGAIN: "the daemon accepts no connection in time",
    }
    return known.get(error.errno or 0, error.strerror or str(error))
