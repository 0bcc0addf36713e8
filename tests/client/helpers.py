"""What several tests of the client need: threads whose errors are seen, and interrupts."""

import os
import signal
import threading
import time
from collections.abc import Callable
from typing import Any, TypeAlias

from litegrip_client.line.connection import Connection
from tests.client.fake_daemon import DEADLINE_S, STATE, Request

Ctl: TypeAlias = Callable[..., tuple[int, str, str]]
"""Runs litegripctl: its arguments in, its exit code and its two outputs out."""


def in_thread(target: Callable[[], Any]) -> Callable[[], Any]:
    """Run `target` in a thread; calling what this returns waits for its result."""
    box: list[Any] = []

    def run() -> None:
        try:
            box.append(target())
        except BaseException as error:  # noqa: BLE001 - raised by the caller's thread
            box.append(error)

    thread = threading.Thread(target=run)
    thread.start()

    def result() -> Any:
        thread.join(DEADLINE_S)
        assert not thread.is_alive()
        if isinstance(box[0], BaseException):
            raise box[0]
        return box[0]

    return result


def interrupt_main_thread() -> None:
    signal.pthread_kill(threading.main_thread().ident or 0, signal.SIGINT)


def until_read(connection: Connection) -> None:
    """Wait until some thread waits for `connection`."""
    deadline_s = time.monotonic() + DEADLINE_S
    while connection._multiplexer._leader is None and time.monotonic() < deadline_s:
        os.sched_yield()


def sample(request: Request, seq: int, **more: Any) -> None:
    """Send a sample of the subscription 5, which `request` began."""
    params = {"subscription": 5, "seq": seq, "dropped": 0, "monotonic_s": seq / 10}
    request.notify("state.sample", {**params, "state": {**STATE, "seq": seq}, **more})


def event(request: Request | None, seq: int, kind: str = "job_ended") -> dict[str, Any]:
    """Send an event of the subscription 5, which `request` began, if given; return it."""
    one = {
        "seq": seq,
        "monotonic_s": seq / 10,
        "kind": kind,
        "message": "the job ended",
        "data": {"job": seq},
    }
    if request is not None:
        request.notify("event", {"subscription": 5, **one})
    return one


def stopped(level: str, call: str = "litegripctl") -> str:
    """Return what litegripctl prints of a stop."""
    kept = f"what is squeezed stays so; to let go: {call} stop --level relax\n"
    return f"stopped: {level}, until: {call} clear\n{kept if level == 'hold' else ''}"
