"""The way to a daemon of another machine: its two sockets, forwarded here by ssh.

Who may log in, and how, is ssh's own to know and to ask for. The sockets here are in a directory
of this user's alone, and go with the command, as does the ssh process.
"""

from __future__ import annotations

import os
import shlex
import subprocess
import tempfile
from contextlib import suppress
from pathlib import Path

from litegrip_client.connection import Connection
from litegrip_client.ctl import ssh
from litegrip_client.ctl.way import Way
from litegrip_client.discovery import SYSTEM_DIRECTORY
from litegrip_client.errors import ConnectError, LiteGripError
from litegrip_client.stopping import stop_path

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from argparse import Namespace

_LOOK_EVERY_S = 0.02
_END_WITHIN_S = 2.0
_FETCH_WITHIN_S = 120.0
_LONGEST_FOLDER = 70
"""The path of a socket has at most 107 bytes (unix(7))."""


class SshWay(Way):
    """To a daemon of the machine `options.ssh_host`, as ssh calls it; `options.socket` is there.

    Nothing is begun before it is needed. An ssh that has ended is begun again, and then may no
    longer ask for a password.
    """

    # Whether anybody listens there, ssh tells by ending the connection and by nothing else.
    not_listening = (*Way.not_listening, LiteGripError)

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
        """Give the socket's end on this machine, which is there then."""
        self._connected().close()
        return [self._here]

    def content(self, path: str) -> bytes:
        """Fetch a file of that machine; raises `OSError`."""
        command = ["ssh", *ssh.OPTIONS, "--", self.options.ssh_host, f"cat -- {shlex.quote(path)}"]
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
        raise self._explained() or ssh.ended(self._said(), self.options.ssh_host)

    def _running(self) -> subprocess.Popen[bytes]:
        if self._ssh is not None and self._ssh.poll() is None:
            return self._ssh
        again = self._ssh is not None
        stop_here = stop_path(self._here)
        for path in (self._here, stop_here):
            Path(path).unlink(missing_ok=True)
        # In this order, so that the one for stops is there when the other one is.
        forwarded = (f"{stop_here}:{stop_path(self._there)}", f"{self._here}:{self._there}")
        self._ssh = ssh.begin(self.options.ssh_host, forwarded, self._complaints, again=again)
        return self._ssh

    def _explained(self) -> ConnectError | None:
        return ssh.explained(self._said(), self.options.ssh_host, self._there)

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
