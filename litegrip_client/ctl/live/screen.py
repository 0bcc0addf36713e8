"""The terminal of the live view: taken when it begins, and given back however it ends."""

from __future__ import annotations

import contextlib
import os
import signal
import sys
import time
from collections.abc import Callable, Iterable, Iterator

from rich.console import Console
from rich.live import Live

from litegrip_client.ctl.live.view import picture
from litegrip_client.ctl.watching import Scene

_SHORTEST_S = 0.05
"""Between two pictures: nobody sees more, and a slow terminal has time for them."""

_TERMINATED = 128 + signal.SIGTERM


def show(scenes: Iterable[Scene], name: str, for_gripper: Callable[[str], str]) -> None:
    """Show scenes of the gripper `name` until there are no more of them; see `Output`."""
    shown_s = 0.0
    with (
        Live(console=Console(), screen=True, auto_refresh=False) as live,
        _giving_back(live),
    ):
        for scene in scenes:
            now_s = time.monotonic()
            if now_s - shown_s >= _SHORTEST_S:
                live.update(picture(scene, name, for_gripper), refresh=True)
                shown_s = now_s


@contextlib.contextmanager
def _giving_back(live: Live) -> Iterator[None]:
    """Give the terminal back on SIGTERM, and while Ctrl-Z stops this program."""

    def pause(*_: object) -> None:
        live.stop()
        os.kill(os.getpid(), signal.SIGSTOP)
        live.start(refresh=True)

    handlers = {signal.SIGTERM: lambda *_: sys.exit(_TERMINATED), signal.SIGTSTP: pause}
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
