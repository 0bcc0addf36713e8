"""How long a stop from the page takes while others do their worst: python -m bench.hostile.page

Two grippers on one page. Measured is the stop of the healthy one, from the message to the answer:
alone; with the other's daemon frozen and asked for 100 stops; beside a flood of stops at the other
one; and while 1,100 connections without the secret are opened. Reported, never asserted.
"""

import contextlib
import itertools
import json
import os
import signal
import socket
import statistics
import tempfile
import threading
import time
from collections.abc import Iterator
from pathlib import Path

from websockets.sync.client import ClientConnection, connect
from websockets.typing import Origin

from tests.process.daemon_process import DaemonProcess, daemon
from tests.process.web.page_process import Page, page, prove, request, welcome

STOPS = 50
STRANGERS = 1100
HEALTHY, OTHER = "healthy", "other"


@contextlib.contextmanager
def browser(shown: Page, channel: str) -> Iterator[ClientConnection]:
    """Connect to a gripper as the page does."""
    host, own = f"127.0.0.1:{shown.port}", shown.url.rstrip("/")
    with connect(f"ws://{host}/ws/{channel}", origin=Origin(own), proxy=None) as opened:
        prove(opened, shown.token, host)
        welcome(opened)
        yield opened


def report(what: str, opened: ClientConnection) -> None:
    """Stop again and again, and print how long that took."""
    took_ms = []
    for number in range(STOPS):
        began_s = time.perf_counter()
        opened.send(request("stop", level="hold"))
        while json.loads(opened.recv()).get("id") != 1:
            continue
        took_ms.append(1e3 * (time.perf_counter() - began_s))
        time.sleep(0.01 if number else 0.2)
    print(f"| {what} | {statistics.median(took_ms):.1f} ms | {max(took_ms):.1f} ms |", flush=True)


def frozen(shown: Page, running: DaemonProcess, healthy: ClientConnection) -> None:
    """Measure beside a daemon that is frozen, and asked for stops."""
    running.process.send_signal(signal.SIGSTOP)
    try:
        with browser(shown, OTHER) as other:
            for _ in range(100):
                other.send(request("stop", level="hold"))
            report("the other daemon is frozen, 100 stops wait for it", healthy)
    finally:
        running.process.send_signal(signal.SIGCONT)


def flooded(shown: Page, healthy: ClientConnection) -> None:
    """Measure beside a flood of stops."""
    ended = threading.Event()

    def flood() -> None:
        with browser(shown, OTHER) as other:
            reader = threading.Thread(target=lambda: list(other), daemon=True)
            reader.start()
            while not ended.is_set():
                other.send(request("stop", level="hold"))

    threading.Thread(target=flood, daemon=True).start()
    report("a flood of stops at the other one", healthy)
    ended.set()


def besieged(shown: Page, healthy: ClientConnection) -> None:
    """Measure while connections without the secret are opened."""
    ended = threading.Event()

    def besiege() -> None:
        strangers = []
        for number in itertools.count():
            if ended.is_set():
                break
            with contextlib.suppress(OSError):
                strangers.append(socket.create_connection(("127.0.0.1", shown.port), timeout=5))
            if number >= STRANGERS:
                strangers.pop(0).close()
        for stranger in strangers:
            stranger.close()

    thread = threading.Thread(target=besiege)
    thread.start()
    report(f"{STRANGERS} connections without the secret", healthy)
    ended.set()
    thread.join()


def main() -> None:
    """Print the table."""
    with tempfile.TemporaryDirectory(dir="/tmp") as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        os.environ["XDG_RUNTIME_DIR"] = name
        (folder / "litegripd").mkdir()
        daemons = {}
        for channel in (HEALTHY, OTHER):
            running = stack.enter_context(daemon(folder / channel, channel, "--simulate"))
            stack.enter_context(running.connect())
            for ending in (".sock", ".stop.sock"):
                link = folder / "litegripd" / f"{channel}{ending}"
                link.symlink_to(running.socket_path.with_name(f"rpc{ending}"))
            daemons[channel] = running
        with page(channels=(HEALTHY, OTHER)) as shown, browser(shown, HEALTHY) as healthy:
            print("| a stop of the healthy gripper | median | longest |\n| --- | ---: | ---: |")
            report("alone", healthy)
            frozen(shown, daemons[OTHER], healthy)
            flooded(shown, healthy)
            besieged(shown, healthy)


if __name__ == "__main__":
    main()
