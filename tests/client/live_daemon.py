"""A fake daemon that answers all that the live view of litegripctl asks for."""

import contextlib
import itertools
import threading
from collections.abc import Iterator
from typing import Any

from tests.client.fake_daemon import STATE, FakeDaemon, Handler, Request
from tests.client.helpers import event

OWNER = {"program": "pick.py", "pid": 77, "uid": 1000, "purpose": "picking\x1b[2J"}
PERIOD_S = 0.02
HEALTH = {"verdict": "degraded", "reasons": ["late ticks"]}


def answering(answer: dict[str, Any]) -> Handler:
    return lambda request: answer


def live(daemon: FakeDaemon, states: int = 5) -> FakeDaemon:
    """Let a daemon send so many states, and answer all that the view asks for."""

    def subscribe(request: Request) -> None:
        request.reply({"subscription": 1, "state": STATE})
        for seq in range(states - 1):
            sample = {"subscription": 1, "seq": seq, "dropped": 0, "monotonic_s": 1.0}
            request.notify("state.sample", {**sample, "state": STATE})

    answers: dict[str, Any] = {
        "state.unsubscribe": {"subscription": 1},
        "events.subscribe": {"subscription": 5, "state": STATE, "events": [event(None, 980)]},
        "events.unsubscribe": {"subscription": 5},
        "clients.list": {"clients": [{"is_me": True}, {"is_me": False}]},
        "lease.get": {"owner": OWNER, "mine": False, "waiting": 0},
        "health": HEALTH,
    }
    for method, answer in answers.items():
        daemon.handlers[method] = answering(answer)
    daemon.handlers["state.subscribe"] = subscribe
    return daemon


@contextlib.contextmanager
def streaming(daemon: FakeDaemon) -> Iterator[dict[str, Any]]:
    """Let a daemon answer all that the view asks for, and send a state until this ends.

    Gives that state, to be changed.
    """
    state = dict(STATE)
    ended = threading.Event()
    senders: list[threading.Thread] = []

    def subscribe(request: Request) -> None:
        request.reply({"subscription": 1, "state": STATE})
        senders.append(threading.Thread(target=send, args=(request,)))
        senders[-1].start()

    def send(request: Request) -> None:
        sample = {"subscription": 1, "dropped": 0, "monotonic_s": 1.0, "state": state}
        with contextlib.suppress(OSError):  # the view has gone
            for seq in itertools.count():
                request.notify("state.sample", {**sample, "seq": seq})
                if ended.wait(PERIOD_S):
                    return

    live(daemon).handlers["state.subscribe"] = subscribe
    try:
        yield state
    finally:
        ended.set()
        for sender in senders:
            sender.join()
