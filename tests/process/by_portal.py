"""Lets a daemon be met at a portal's sockets: gateway, router and portal are between, by TLS."""

import contextlib
import os
from collections.abc import Callable, Iterator
from pathlib import Path

from tests.process.daemon_process import DaemonProcess
from tests.process.fleet.fleet_process import Fleet, fleet

NAMES = ("left", "right", "third")
REMOTE_AS = "op1@lab via gateway"
VARIABLE = "LITEGRIPD_THROUGH_PORTAL"

Met = Callable[..., "contextlib.AbstractContextManager[Fleet | None]"]
"""Takes daemons; while its block runs, they are met as the variable says."""


def is_remote() -> bool:
    """Return True if daemons are to be met through a portal."""
    return os.environ.get(VARIABLE) == "1"


@contextlib.contextmanager
def by_portal(folder: Path, certificates: Path, *daemons: DaemonProcess) -> Iterator[Fleet]:
    """Let daemons be met as `lab.NAME`; the user of the portal is an admin.

    The daemons listen already, and trust this user as a gateway's.
    """
    own = dict(zip(NAMES, (running.socket_path for running in daemons), strict=False))
    with fleet(folder, certificates, own, role="admin") as remote:
        for name, running in zip(own, daemons, strict=True):
            running.socket_path, running.remote_as = remote.socket_path(name), REMOTE_AS
        yield remote
        for name, running in zip(own, daemons, strict=True):
            running.socket_path, running.remote_as = own[name], None
