"""A daemon of another machine: its two sockets, forwarded here by ssh.

Who may log in, and how, is ssh's own to know and to ask for. The sockets here are in a directory
of this user's alone, and go with the command, as does the ssh process.
"""

from __future__ import annotations

import ctypes
import os
import shlex
import signal
import subprocess
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path

from litegrip_client.connection import Connection
from litegrip_client.ctl.run import Host
from litegrip_client.discovery import SYSTEM_DIRECTORY, stop_path
from litegrip_client.errors import ConnectError, LiteGripError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from argparse import Namespace


OPTIONS = (
    "-T",
    "-a",
    "-x",
    *("-S", "none"),  # a shared connection would keep the sockets when this process has ended
    *("-o", "ConnectTimeout=10"),
    *("-o", "ServerAliveInterval=3"),
    *("-o", "ServerAliveCountMax=3"),
)

_PR_SET_PDEATHSIG = 1
"""prctl(2): which signal a process gets when its parent has ended."""

_KNOWN = (
    (
        "could not resolve hostname",
        "ssh does not know the machine {host}",
        "look at its name, and at ~/.ssh/config",
    ),
    (
        "host key verification failed",
        "ssh does not trust {host}: its key is unknown, or another one than before",
        "log in once, and look at what ssh says: ssh {host}",
    ),
    (
        "permission denied",
        "{host} does not let this user in",
        "try: ssh {host}; as another user: --host USER@HOST; with a key: ssh-copy-id {host}",
    ),
    (
        "administratively prohibited",
        "the ssh server of {host} does not forward sockets",
        "allow it there, in sshd_config: AllowStreamLocalForwarding yes",
    ),
    (
        "open failed",
        "ssh reaches {host}, but no daemon can be reached at {path} there, by this user at least",
        "see: ssh {host} ls -l /run/litegripd; then name the channel: -c, or the path: --socket",
    ),
)
"""A part of what ssh says, in lower case, what it means, and what to do."""


def begin(
    host: str, forwarded: Sequence[str], complaints: Path, *, again: bool
) -> subprocess.Popen[bytes]:
    """Begin to forward sockets, HERE:THERE each, until it is ended; it ends with this process.

    What it says goes to the file `complaints`. The first asks for a password where it must, at the
    terminal; one that is begun `again` does not. Raises `ConnectError` where there is no ssh.
    """
    libc = ctypes.CDLL(None)

    def prepare() -> None:
        # Ctrl-C is for litegripctl, which then cancels its motion through this very ssh.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        libc.prctl(_PR_SET_PDEATHSIG, signal.SIGTERM)

    ways = [word for pair in forwarded for word in ("-L", pair)]
    quiet = ("-o", "BatchMode=yes") if again else ()
    try:
        with complaints.open("wb") as said:
            return subprocess.Popen(
                ["ssh", "-N", *OPTIONS, *quiet, *ways, "--", host],  # noqa: S607 - the user's own
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=said,
                preexec_fn=prepare,  # noqa: PLW1509 - no other thread runs
            )
    except FileNotFoundError as error:
        raise ConnectError(
            "--host needs the program ssh, which is not installed",
            reason="ssh_failed",
            data={"hint": "sudo apt install openssh-client"},
        ) from error


def explained(said: str, host: str, path: str) -> ConnectError | None:
    """Return the error that ssh has reported, None for what is not known as one."""
    for part, text, hint in _KNOWN:
        if part in said.lower():
            return _error(said, text.format(host=host, path=path), hint.format(host=host))
    return None


def ended(said: str, host: str) -> ConnectError:
    """Return the error of an ssh that has ended: the last line that it printed."""
    last = said.strip().rpartition("\n")[2].strip() or "it ended without a word"
    return _error(said, f"ssh to {host} failed: {last}", f"try: ssh {host}")


def _error(said: str, message: str, hint: str) -> ConnectError:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    return ConnectError(message, reason="ssh_failed", data={"hint": hint, "ssh": lines[-5:]})


_LOOK_EVERY_S = 0.02
_END_WITHIN_S = 2.0
_FETCH_WITHIN_S = 120.0
_LONGEST_FOLDER = 70
"""The path of a socket has at most 107 bytes (unix(7))."""


class SshHost(Host):
    """The machine `options.ssh_host`, as ssh calls it; `options.socket` is a path there.

    ssh is not started before it is needed. An ssh that has ended is begun again, and then may no
    longer ask for a password.
    """

    # If nobody listens there, ssh ends the connection; it reports this in no other way.
    not_listening = (*Host.not_listening, LiteGripError)

    def __init__(self, options: Namespace) -> None:
        super().__init__(options)
        self._there = options.socket or f"{SYSTEM_DIRECTORY}/{options.channel}.sock"
        self._folder = tempfile.TemporaryDirectory(prefix="litegripctl-", dir=_short_folder())
        self._here = f"{self._folder.name}/d.sock"
        self._complaints = Path(self._folder.name, "complaints")
        self._ssh: subprocess.Popen[bytes] | None = None

    def connect(self) -> Connection:
        """Connect through ssh; raises `ConnectError` that says what does not work."""
        try:
            return super().connect()
        except ConnectError as error:
            raise self._explained() or error from error

    def paths(self) -> list[str]:
        """Return the socket's end on this machine, which is there then."""
        self._connected().close()
        return [self._here]

    def content(self, path: str) -> bytes:
        """Fetch a file of that machine; raises `OSError`."""
        command = ["ssh", *OPTIONS, "--", self.options.ssh_host, f"cat -- {shlex.quote(path)}"]
        try:
            done = subprocess.run(
                command, capture_output=True, timeout=_FETCH_WITHIN_S, check=False
            )
        except subprocess.TimeoutExpired as error:
            raise TimeoutError(0, f"it did not come within {_FETCH_WITHIN_S:g} s") from error
        if done.returncode != 0:
            text = done.stderr.decode(errors="replace").strip().rpartition("\n")[2]
            raise OSError(0, f"ssh {self.options.ssh_host}: {text}")
        return done.stdout

    def close(self) -> None:
        """End ssh."""
        self._end_ssh()
        self._folder.cleanup()

    def _connected(self) -> Connection:
        """Connect as soon as ssh listens; raises `ConnectError` when it ends instead."""
        process = self._running()
        while process.poll() is None:
            with suppress(FileNotFoundError, ConnectionRefusedError):
                return Connection(self._here)
            with suppress(subprocess.TimeoutExpired):
                process.wait(_LOOK_EVERY_S)
        raise self._explained() or ended(self._said(), self.options.ssh_host)

    def _running(self) -> subprocess.Popen[bytes]:
        if self._ssh is not None and self._ssh.poll() is None:
            return self._ssh
        again = self._ssh is not None
        stop_here = stop_path(self._here)
        for path in (self._here, stop_here):
            Path(path).unlink(missing_ok=True)
        # In this order, so that the one for stops is there when the other one is.
        forwarded = (f"{stop_here}:{stop_path(self._there)}", f"{self._here}:{self._there}")
        self._ssh = begin(self.options.ssh_host, forwarded, self._complaints, again=again)
        return self._ssh

    def _explained(self) -> ConnectError | None:
        return explained(self._said(), self.options.ssh_host, self._there)

    def _said(self) -> str:
        return self._complaints.read_text(encoding="utf-8", errors="replace")

    def _end_ssh(self) -> None:
        if self._ssh is None:
            return
        self._ssh.terminate()
        try:
            self._ssh.wait(_END_WITHIN_S)
        except subprocess.TimeoutExpired:
            self._ssh.kill()
            self._ssh.wait()


def _short_folder() -> str:
    """Return where to make the private directory: paths of sockets must be short."""
    usual = tempfile.gettempdir()
    return usual if len(os.fsencode(usual)) <= _LONGEST_FOLDER else "/tmp"  # noqa: S108 - see above
