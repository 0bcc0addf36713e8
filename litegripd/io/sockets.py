"""The daemon's places in the system: its sockets, and the locks that make it the only one.

A name in the abstract socket namespace can be taken by anybody, a lock file in the run directory
only by users who may run its daemon: so both are held. The three sockets (`Places`: the claim on
the channel, the stop socket, the socket of all other requests) are handed to a successor and are
never closed in between, so no attempt to connect fails while one process replaces another.
"""

import ctypes
import errno
import fcntl
import grp
import hashlib
import logging
import os
import socket
import stat
import struct
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from litegripd.rpc.sessions import Peer

_log = logging.getLogger(__name__)

RUN_DIRECTORY = Path("/run/litegripd")
_MODE = 0o600


class LockedError(RuntimeError):
    """Another process holds the lock."""


class ChannelLock:
    """The lock of one claim, held as long as any process has `descriptor` open."""

    def __init__(self, descriptor: int, path: Path) -> None:
        self.descriptor = descriptor
        self._path = path

    def remove(self) -> None:
        """Remove the file, while it is locked: at the end of a daemon that has no successor."""
        self._path.unlink(missing_ok=True)

    def close(self) -> None:
        """Close the descriptor."""
        os.close(self.descriptor)


def lock_path(claim: str) -> Path:
    """Return a claim's lock file; CAN interfaces belong to a network namespace."""
    namespace = Path("/proc/self/ns/net").stat().st_ino
    digest = hashlib.sha256(f"{namespace}/{claim}".encode()).hexdigest()
    return RUN_DIRECTORY / f"{digest[:32]}.lock"


def lock_channel(claim: str) -> ChannelLock | None:
    """Take the lock of a claim; None if this user may not use the run directory.

    Raises `LockedError` if another process has it.
    """
    path = lock_path(claim)
    while True:
        try:
            path.parent.mkdir(mode=0o755, exist_ok=True)
            flags = os.O_RDWR | os.O_CREAT | os.O_CLOEXEC | os.O_NOFOLLOW | os.O_NONBLOCK
            descriptor = os.open(path, flags, _MODE)
        except OSError as error:
            _log.debug("there is no lock in %s: %s", path.parent, error)
            return None
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            if os.fstat(descriptor).st_ino == path.stat().st_ino:
                return ChannelLock(descriptor, path)
        except BlockingIOError:
            os.close(descriptor)
            raise LockedError from None
        except FileNotFoundError:
            _log.debug("%s was removed by its last owner just now", path)
        os.close(descriptor)


SOCKET_MODE = 0o660
LISTEN_BACKLOG = 128
_MAX_NAME_BYTES = 107  # of a Unix socket's address (sun_path less one)
_UCRED = struct.Struct("3i")


class InUseError(RuntimeError):
    """Another process has the socket or the channel; the message says which."""


def runtime_directory() -> Path:
    """Return /run/litegripd if it can be used, else the user's own runtime directory.

    Raises `InUseError` if neither is possible: then the socket's path must be given.
    """
    shared = Path("/run/litegripd")
    if os.access(shared, os.W_OK | os.X_OK) or os.access(shared.parent, os.W_OK | os.X_OK):
        return shared
    own = Path(os.environ.get("XDG_RUNTIME_DIR") or f"/run/user/{os.getuid()}")
    if os.access(own, os.W_OK | os.X_OK):
        return own / "litegripd"
    raise InUseError(
        f"neither /run/litegripd nor {own} can be written by uid {os.getuid()}:"
        " give the socket's path with --socket, or set XDG_RUNTIME_DIR to a directory of yours,"
        " for the daemon and its clients"
    )


class ChannelClaim:
    """Makes this process the owner of a CAN channel until `close`, or until it dies.

    The lock is a name in the abstract socket namespace: the kernel frees it with the process, so
    nothing stale can be left. It belongs to the network namespace, as the CAN interface does.
    Anybody can bind it. A process that also holds the lock in the run directory does without the
    name if a user has it who may not run a daemon there. Raises `InUseError` with the owner's pid
    and uid. Register it with the loop: it accepts connections from processes that ask for the
    owner, and closes them.
    """

    def __init__(
        self,
        interface: str,
        channel: str,
        claimed: socket.socket | None = None,
        lock_descriptor: int | None = None,
    ) -> None:
        """Claim the channel, or continue with the claim and the lock of a predecessor."""
        self._lock: ChannelLock | None = None
        if claimed is None:
            self._lock = _lock(interface, channel)
            try:
                claimed = _claim(interface, channel, has_lock=self._lock is not None)
            except InUseError:
                self.remove()
                if self._lock is not None:
                    self._lock.close()
                raise
        elif lock_descriptor is not None:
            path = lock_path(_claim_text(interface, channel))
            self._lock = ChannelLock(lock_descriptor, path)
        self._socket = claimed
        self._socket.setblocking(False)

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What a successor gets: the claim, and the lock if there is one."""
        return () if self._lock is None else (self._lock.descriptor,)

    def remove(self) -> None:
        """Remove the lock's file: no successor continues with it."""
        if self._lock is not None:
            self._lock.remove()

    def name_owner(self) -> None:
        """Let the kernel name this process to a process that asks for the owner."""
        self._socket.listen()

    def fileno(self) -> int:
        """Return the descriptor that is readable when a process asks for the owner."""
        return self._socket.fileno()

    def on_event(self, _mask: int) -> None:
        """Close one asker's connection; the kernel has named the owner already."""
        try:
            self._socket.accept()[0].close()
        except OSError as error:
            _log.debug("an asker for the channel's owner was gone: %s", error)

    def close(self) -> None:
        """Free the channel."""
        self._socket.close()
        if self._lock is not None:
            self._lock.close()


def _lock(interface: str, channel: str) -> ChannelLock | None:
    try:
        return lock_channel(_claim_text(interface, channel))
    except LockedError:
        owner = _owner_of(_claim_name(interface, channel))
        raise InUseError(_owned(channel, owner)) from None


def _owned(channel: str, owner: "_Owner | None") -> str:
    return (
        f"channel {channel} is owned by the daemon with {owner or 'no pid'}:"
        " one motor has one owner; stop that daemon first"
    )


def _claim(interface: str, channel: str, *, has_lock: bool) -> socket.socket:
    name = _claim_name(interface, channel)
    claimed = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        claimed.bind(name)
        claimed.listen()
    except OSError as error:
        claimed.close()
        if error.errno != errno.EADDRINUSE:
            raise InUseError(f"channel {channel} cannot be claimed: {error}") from error
        owner = _owner_of(name)
        if has_lock and owner is not None and owner.is_outsider:
            _log.warning(
                "%s has taken the name of channel %s without the lock in %s, and is passed over;"
                " if it commands the motor, end it",
                owner,
                channel,
                RUN_DIRECTORY,
            )
            claimed = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            claimed.bind("")  # a name chosen by the kernel
            claimed.listen()
            return claimed
        raise InUseError(_owned(channel, owner)) from None
    return claimed


def _claim_name(interface: str, channel: str) -> str:
    name = f"\0litegripd/{_claim_text(interface, channel)}"
    if len(name.encode()) <= _MAX_NAME_BYTES:
        return name
    return f"\0litegripd/{hashlib.sha256(name.encode()).hexdigest()}"


def _claim_text(interface: str, channel: str) -> str:
    """Return what a claim is of: the channel by the name that the configuration gives it.

    The device behind a path is locked by the pump that has it open: /dev/ttyACM0 is another adapter
    once two are plugged in again in another order.
    """
    return f"{interface}/{channel}"


def listen(path: Path, group: str | None) -> socket.socket:
    """Bind a Unix socket at `path`, mode 0660, group `group` if it exists.

    A file on which no process listens any more is replaced. Raises `InUseError` if one does, if
    something else has the name, or if the path is not usable.
    """
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        path.parent.mkdir(mode=0o755, parents=True, exist_ok=True)
        _remove_stale(path)
        # Set before the socket exists: nobody can connect before its mode is right.
        umask = os.umask(0o777 & ~SOCKET_MODE)
        try:
            listener.bind(str(path))
        finally:
            os.umask(umask)
        _give_to_group(path, group)
        listener.listen(LISTEN_BACKLOG)  # from now on the file does not look stale
    except InUseError:
        listener.close()
        raise
    except (OSError, ValueError) as error:  # the latter: not encodable, or with a NUL inside
        listener.close()
        raise InUseError(f"the socket {path} cannot be made: {error}") from error
    return listener


def listen_on_all(paths: Sequence[Path], group: str | None) -> list[socket.socket]:
    """Bind a Unix socket at each path, as `listen` does, or at none if one fails."""
    listeners: list[socket.socket] = []
    try:
        for path in paths:
            listeners.append(listen(path, group))  # noqa: PERF401 - those before are closed below
    except InUseError:
        for listener, path in zip(listeners, paths, strict=False):
            listener.close()
            path.unlink()
        raise
    return listeners


def _remove_stale(path: Path) -> None:
    try:
        mode = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(mode):
        raise InUseError(
            f"{path} exists and is not a socket: move it away or give another --socket"
        )
    owner = _owner_of(str(path))
    if owner is not None:
        raise InUseError(f"the process with {owner} listens on {path}: stop it first")
    _log.info("replacing %s, on which nobody listens any more", path)
    path.unlink()


@dataclass(frozen=True, slots=True)
class _Owner:
    """The listener on an address, as the kernel knows it; no pid if the kernel does not give it."""

    pid: int | None = None
    uid: int | None = None

    @property
    def is_outsider(self) -> bool:
        """True for a user who is neither root nor the one who runs this daemon."""
        return self.uid is not None and self.uid not in (0, os.getuid())

    def __str__(self) -> str:
        return "an unknown pid" if self.pid is None else f"pid {self.pid} of uid {self.uid}"


def _owner_of(address: str) -> _Owner | None:
    """Return the process that listens on an address, or None.

    Raises `OSError` if this is unknown, as for another user's socket.
    """
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.setblocking(False)
        try:
            probe.connect(address)
        except BlockingIOError:
            return _Owner()  # it is listened on, with a full backlog
        except (ConnectionRefusedError, FileNotFoundError):
            return None
        credentials = probe.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    pid, uid, _gid = _UCRED.unpack(credentials)
    return _Owner(pid, uid)


def _give_to_group(path: Path, group: str | None) -> None:
    if group is None:
        return
    try:
        gid = grp.getgrnam(group).gr_gid
        if path.lstat().st_gid != gid:  # as in a unit with that Group=, which may not change owners
            os.chown(path, -1, gid, follow_symlinks=False)  # whatever has replaced it since
    except KeyError:
        # Who runs a daemon of his own needs no group; a system's daemon is meant for others, too.
        level = logging.WARNING if os.getuid() == 0 else logging.DEBUG
        _log.log(
            level, "there is no group %r: %s stays with group %s", group, path, _group_of(path)
        )
    except PermissionError:
        _log.warning(
            "not allowed to give %s to group %r: it stays with %s; a unit needs Group=%s as well"
            " (systemctl edit), and a restart",
            path,
            group,
            _group_of(path),
            group,
        )


def _group_of(path: Path) -> str:
    gid = path.lstat().st_gid
    try:
        return grp.getgrgid(gid).gr_name
    except KeyError:
        return str(gid)


_SOCKETS = 3
STOP_ENDING = ".stop.sock"


@dataclass(frozen=True, slots=True)
class Places:
    """The sockets, and the paths of those that have one."""

    claim: ChannelClaim
    stops: socket.socket
    requests: socket.socket
    stop_path: Path
    path: Path

    @property
    def descriptors(self) -> tuple[int, ...]:
        """What a successor gets."""
        sockets = (self.claim.fileno(), self.stops.fileno(), self.requests.fileno())
        return (*sockets, *self.claim.descriptors)

    def name_owner(self) -> None:
        """Let the kernel name this process to a process that asks who listens."""
        self.claim.name_owner()
        for listener in (self.stops, self.requests):
            listener.listen(LISTEN_BACKLOG)

    def remove(self) -> None:
        """Remove the files; the sockets are closed by those who serve them."""
        for path in (self.path, self.stop_path):
            path.unlink(missing_ok=True)
        self.claim.remove()


def occupy(interface: str, channel: str, path: Path, group: str | None) -> Places:
    """Take the places; raises `InUseError` if one belongs to another process."""
    if path.name.endswith(STOP_ENDING):
        raise InUseError(f"{path}: names that end in {STOP_ENDING} are kept for stop sockets")
    claim = ChannelClaim(interface, channel)
    stop_path = stop_socket_path(path)
    # In this order: a client that has reached the one can stop by the other.
    try:
        stops, requests = listen_on_all((stop_path, path), group)
    except InUseError:
        claim.remove()
        claim.close()
        raise
    return Places(claim, stops, requests, stop_path, path)


def take_over(interface: str, channel: str, path: Path, descriptors: Sequence[int]) -> Places:
    """Return the places that a predecessor has handed over."""
    *sockets, lock = (*descriptors, None) if len(descriptors) == _SOCKETS else descriptors
    claim, stops, requests = (socket.socket(fileno=descriptor) for descriptor in sockets)
    claimed = ChannelClaim(interface, channel, claim, lock)
    return Places(claimed, stops, requests, stop_socket_path(path), path)


def stop_socket_path(path: Path) -> Path:
    """Return where stops are taken: `can0.stop.sock` beside `can0.sock`."""
    return path.parent / f"{path.name.removesuffix('.sock')}{STOP_ENDING}"


SO_PEERGROUPS = 59
"""Of Linux 4.13 and later; the standard library has no name for it."""

_GID_BYTES = 4
_COMM_BYTES = 128  # longer than any process's name, kernel threads included

_libc = ctypes.CDLL(None)
_libc.getsockopt.argtypes = (
    ctypes.c_int,
    ctypes.c_int,
    ctypes.c_int,
    ctypes.c_void_p,
    ctypes.POINTER(ctypes.c_uint32),
)


def peer_of(connected: socket.socket) -> Peer:
    """Return who connected, with the groups that the process then had."""
    credentials = connected.getsockopt(socket.SOL_SOCKET, socket.SO_PEERCRED, _UCRED.size)
    pid, uid, gid = _UCRED.unpack(credentials)
    return Peer(pid, uid, gid, _program(pid), _groups(connected))


def _program(pid: int) -> str:
    """Return a process's name from /proc, with only its printable characters.

    It uses plain system calls: a file object costs seven times as much, for every connection.
    """
    try:
        fd = os.open(f"/proc/{pid}/comm", os.O_RDONLY)
        try:
            name = os.read(fd, _COMM_BYTES)
        finally:
            os.close(fd)
    except OSError:
        # A pid of another namespace is 0 here. Who has ended may have stopped a hung daemon.
        return "a program that has ended" if pid else "?"
    text = name.decode("utf-8", errors="replace").strip()
    return "".join(c if c.isprintable() else "?" for c in text)


def _groups(connected: socket.socket) -> tuple[int, ...]:
    """Return the supplementary groups, of any number; none if the kernel does not give them.

    `socket.getsockopt` takes at most 1024 bytes, too few for a user of a large directory.
    """
    size = ctypes.c_uint32(0)
    question = (connected.fileno(), socket.SOL_SOCKET, SO_PEERGROUPS)
    _libc.getsockopt(*question, None, ctypes.byref(size))  # rejected, but now `size` is known
    groups = (ctypes.c_uint32 * (size.value // _GID_BYTES))()
    if _libc.getsockopt(*question, groups, ctypes.byref(size)) != 0:
        return ()
    return tuple(groups)
