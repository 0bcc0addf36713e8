"""The ssh process: how it is begun, and what its complaints mean.

It must not know what goes through it.
"""

from __future__ import annotations

import ctypes
import signal
import subprocess
from collections.abc import Sequence
from pathlib import Path

from litegrip_client.errors import ConnectError

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
    """Make an error of what ssh said, where that is known to be one."""
    for part, text, hint in _KNOWN:
        if part in said.lower():
            return _error(said, text.format(host=host, path=path), hint.format(host=host))
    return None


def ended(said: str, host: str) -> ConnectError:
    """Make an error of whatever an ssh that has ended said."""
    last = said.strip().rpartition("\n")[2].strip() or "it ended without a word"
    return _error(said, f"ssh to {host} failed: {last}", f"try: ssh {host}")


def _error(said: str, message: str, hint: str) -> ConnectError:
    lines = [line.strip() for line in said.splitlines() if line.strip()]
    return ConnectError(message, reason="ssh_failed", data={"hint": hint, "ssh": lines[-5:]})
