"""Sessions on the zenoh network, with one configuration for all parts.

No discovery, no shared memory, and no message longer than a piece. zenoh calls back on threads of
its own: here they only hand over what came to the event loop.
"""

import asyncio
import contextlib
import json
import logging
import os
import socket
import threading
import time
from collections import deque
from collections.abc import Callable, Collection, Coroutine, Mapping, Sequence
from concurrent import futures
from dataclasses import dataclass
from ipaddress import ip_address
from pathlib import Path
from typing import Any, Generic, TypeVar

import zenoh

_log = logging.getLogger(__name__)
_Item = TypeVar("_Item")

LEASE_MS = 2000
"""A neighbour that is frozen or cut off is gone after so long."""

DROP_AFTER_US = 20_000
"""So long the event loop waits at most for room in a queue of zenoh's; then a message is dropped,
and asked for again."""

MAX_MESSAGE_BYTES = 65_536
MOST_WAITING = 1024
"""So many messages wait for an event loop; then the oldest gives way, and is asked for again."""

MOST_SESSIONS = 4096
"""With a router, which takes 45 kB for each; 1000 is zenoh's default."""

QUERY_WITHIN_S = 1.0
CONNECT_WITHIN_S = 3.0
"""So long a command waits for a router."""

RETRY_EVERY_MS = 1000
"""So often a session that is out tries to connect; by default zenoh waits up to 4 s."""


class NetworkError(Exception):
    """The network cannot be used; the message says why."""


@dataclass(frozen=True, slots=True)
class Tls:
    """The files of TLS, as PEM: whom to believe, and who we are."""

    ca: str
    certificate: str
    key: str


@dataclass(frozen=True, slots=True)
class Network:
    """Where the network is. Without `tls` nothing is encrypted, and nobody has to be anybody."""

    connect: Sequence[str] = ()
    listen: Sequence[str] = ()
    tls: Tls | None = None
    rules: Mapping[str, Any] | None = None
    """zenoh's access control, for a router."""


def configuration(network: Network, mode: str) -> zenoh.Config:
    """Return zenoh's configuration; raises `NetworkError` for what zenoh does not take."""
    values: dict[str, object] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "scouting/gossip/enabled": False,
        "connect/endpoints": list(network.connect),
        "connect/timeout_ms": -1,
        "connect/exit_on_failure": False,
        "connect/retry": {
            "period_init_ms": RETRY_EVERY_MS,
            "period_max_ms": RETRY_EVERY_MS,
            "period_increase_factor": 1,
        },
        "listen/endpoints": list(network.listen),
        # Payloads from 3072 bytes are lost by it without a word (zenoh issue 2628).
        "transport/shared_memory": {"enabled": False, "mode": "lazy"},
        "transport/unicast/max_sessions": MOST_SESSIONS,
        "transport/link/tx/lease": LEASE_MS,
        "transport/link/rx/max_message_size": MAX_MESSAGE_BYTES,
        # By default 1 ms: on a busy machine, one message in a hundred was dropped.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": DROP_AFTER_US,
    }
    if network.tls is not None:
        values["transport/link/tls"] = {
            "root_ca_certificate": network.tls.ca,
            "enable_mtls": True,
            "verify_name_on_connect": True,
            "listen_certificate": network.tls.certificate,
            "listen_private_key": network.tls.key,
            "connect_certificate": network.tls.certificate,
            "connect_private_key": network.tls.key,
            "close_link_on_expiration": True,
        }
    if network.rules is not None:
        values["access_control"] = network.rules
    config: zenoh.Config = zenoh.Config()
    key = ""
    try:
        for key, value in values.items():
            config.insert_json5(key, json.dumps(value))
    except zenoh.ZError as error:
        raise NetworkError(f"zenoh does not take {key}: {error}") from error
    return config


def opened(network: Network, mode: str = "client") -> zenoh.Session:
    """Open a session; a client's waits until a router lets it in. Raises `NetworkError`."""
    try:
        return zenoh.open(configuration(network, mode))
    except zenoh.ZError as error:
        raise NetworkError(str(error)) from error


def opening(network: Network) -> futures.Future[zenoh.Session]:
    """Open a session, however long that takes, on a thread that no end of the process waits for."""
    future: futures.Future[zenoh.Session] = futures.Future()
    future.set_running_or_notify_cancel()  # it cannot be cancelled any more

    def connect() -> None:
        try:
            future.set_result(opened(network))
        except NetworkError as error:
            future.set_exception(error)

    threading.Thread(target=connect, name="connect", daemon=True).start()
    return future


def reached(network: Network) -> zenoh.Session:
    """Return a session; raises `NetworkError` where none is possible, or no router answers."""
    try:
        return opening(network).result(CONNECT_WITHIN_S)
    except futures.TimeoutError:
        where = ", ".join(network.connect)
        text = f"no router answers at {where} within {CONNECT_WITHIN_S:g} s"
        raise NetworkError(f"{text}; look with: litegripd-fleet check") from None


def close(session: zenoh.Session) -> None:
    """Close a session; it takes 10 s where the network does not answer, and is then logged."""
    try:
        session.close()
    except zenoh.ZError as error:
        _log.warning("the network has not taken the session's end: %s", error)


def cut(locators: Collection[str]) -> None:
    """End this process's connections with some peers, for which zenoh has no call.

    Their addresses find their sockets among those of this process.
    """
    if not locators:
        return
    peers = set()
    for locator in locators:
        host, _, port = locator.partition("/")[2].partition("?")[0].rpartition(":")
        peers.add((ip_address(host.strip("[]")), int(port)))
    for own in Path("/proc/self/fd").iterdir():
        try:
            descriptor = os.dup(int(own.name))
        except OSError:  # closed meanwhile
            continue
        try:
            found = socket.socket(fileno=descriptor)
        except OSError:  # no socket
            os.close(descriptor)
            continue
        with found:
            if found.family not in (socket.AF_INET, socket.AF_INET6):
                continue
            with contextlib.suppress(OSError):  # it listens, or has ended by itself
                host, port = found.getpeername()[:2]
                if (ip_address(host), port) in peers:
                    found.shutdown(socket.SHUT_RDWR)


def all_in_order(
    loop: asyncio.AbstractEventLoop, take: Callable[[Any], object]
) -> Callable[[Any], None]:
    """Return what has the event loop take what comes, for a queryable or a subscriber.

    zenoh calls it on a thread of its own, and is held up while that is behind; nothing is lost.
    """

    def hand_over_one(item: object) -> None:
        try:
            loop.call_soon_threadsafe(take, item)
        except RuntimeError:  # the loop has ended meanwhile
            _log.debug("something came after the end")

    return hand_over_one


class Ring(Generic[_Item]):
    """Has an event loop take what comes, one after the other; its other work is done between.

    Of what waits the newest `most` are kept.
    """

    def __init__(
        self,
        loop: asyncio.AbstractEventLoop,
        take: Callable[[_Item], Coroutine[Any, Any, None]],
        most: int,
    ) -> None:
        self._take = take
        self._waiting: deque[_Item] = deque(maxlen=most)
        self._taking: asyncio.Task[None] | None = None
        self._is_due = False
        self._loop = loop
        self._wake = all_in_order(loop, self._begin)

    def put(self, item: _Item) -> None:
        """Add one, whatever the thread; it waits for nothing."""
        self._waiting.append(item)
        if not self._is_due:
            self._is_due = True
            self._wake(None)

    def _begin(self, _nothing: None) -> None:
        self._is_due = False  # first: what is put from now on has it called again
        if self._taking is None:
            self._taking = self._loop.create_task(self._take_all())

    async def _take_all(self) -> None:
        while self._waiting:
            try:
                await self._take(self._waiting.popleft())
            except Exception:  # noqa: BLE001 - the next one counts all the same, a stop most of all
                _log.exception("what came was not taken")
            await asyncio.sleep(0)
        self._taking = None


def hand_over(
    source: "zenoh.Queryable[Any] | zenoh.Subscriber[Any] | zenoh.LinkEventsListener[Any]",
    take: Callable[[Any], object],
    name: str,
) -> None:
    """Take what comes from a source of zenoh's, on a thread of its own, until it ends.

    That thread wakes up ten times a second, as long as nothing comes: have none for each gripper.
    """
    queue = source.handler  # the source itself cannot be undeclared while a thread waits at it

    def read() -> None:
        while True:
            try:
                item = queue.recv()
            except zenoh.ZError:  # undeclared, or the session is closed
                return
            try:
                take(item)
            except Exception:  # noqa: BLE001 - the next one counts all the same, a stop most of all
                _log.exception("%s: what came was not taken", name)

    threading.Thread(target=read, name=name, daemon=True).start()


def the_newest() -> "zenoh.handlers.RingChannel[Any]":
    """Return a queue whose oldest entries give way when it is full."""
    queue: zenoh.handlers.RingChannel[Any] = zenoh.handlers.RingChannel(MOST_WAITING)
    return queue


@dataclass(frozen=True, slots=True)
class Answered:
    """One answer to a query: the key that it came from, its payload, what was attached, and when.

    `at_s` is by CLOCK_MONOTONIC.
    """

    key: str
    payload: bytes
    attached: bytes | None
    at_s: float


def ask(
    session: zenoh.Session,
    key: str,
    payload: bytes,
    attached: bytes | None,
    loop: asyncio.AbstractEventLoop,
    *,
    within_s: float = QUERY_WITHIN_S,
    is_stop: bool = False,
) -> "asyncio.Future[list[Answered]]":
    """Send a query; the future has its answers once there are all, or the time is up.

    A stop overtakes everything else, and goes to everybody whom its key reaches.
    """
    future: asyncio.Future[list[Answered]] = loop.create_future()
    answers: list[Answered] = []

    def took(reply: zenoh.Reply) -> None:
        sample = reply.ok
        if sample is not None:
            attachment = sample.attachment
            attached = None if attachment is None else attachment.to_bytes()
            payload, at_s = sample.payload.to_bytes(), time.monotonic()
            answers.append(Answered(str(sample.key_expr), payload, attached, at_s))

    def done() -> None:
        try:
            loop.call_soon_threadsafe(settle)
        except RuntimeError:  # the loop has ended meanwhile
            _log.debug("an answer to %s came after the end", key)

    def settle() -> None:
        if not future.done():
            future.set_result(answers)

    session.get(
        key,
        # On zenoh's own thread: otherwise it starts one for each query, which costs more than the
        # rest of it. What is called there waits for nothing, and asks nothing of zenoh.
        handler=zenoh.handlers.Callback(took, done, indirect=False),
        payload=payload,
        attachment=attached,
        timeout=within_s,
        target=zenoh.QueryTarget.ALL,
        consolidation=zenoh.ConsolidationMode.NONE,
        # Whatever is lost is asked again; the event loop must not wait for the network.
        congestion_control=zenoh.CongestionControl.DROP,
        priority=zenoh.Priority.REAL_TIME if is_stop else zenoh.Priority.INTERACTIVE_HIGH,
        express=True,
    )
    return future
