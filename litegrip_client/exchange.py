"""What a connection to the daemon is apart from its socket: requests made, answers understood.

No I/O and no waiting: the connections of threads and of event loops add that. This module must
not know what the methods do.
"""

from __future__ import annotations

import itertools
import math
import time
from collections.abc import Callable, Mapping

from litegrip_client.calls import Call, Message, Progress, generation_of, guarded, request_line
from litegrip_client.errors import LiteGripError, ProtocolError, StoppedError, from_error_object
from litegrip_client.router import Key, Router, unsubscribing

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from typing import Any, TypeAlias

    from litegrip_client.feeds import Feed
    from litegrip_client.voices import Voice

PROTOCOL = 1
DEFAULT_TIMEOUT_S = 5.0
FOREVER_S = math.inf
"""Time limit of a call that may take as long as a motion takes."""

_CLOCKS_AGREE_S = 10.0
"""Longer than an answer may take. Two machines that were started so close together are taken for
one: then a motion may be refused for so long after a stop, as if it had been sent before."""

Undo: TypeAlias = "Callable[[Message], tuple[str, dict[str, Any]] | None]"
"""Makes of a result the method and the parameters that take back what it began, if anything."""


class Exchange:
    """The base of connections. `stop_generation` is the newest in any answer.

    It is None when that is not known, and so is `client`, the daemon's number for the connection;
    and `stop_socket`, where it takes stops before everything else. `has_clock` is true if this
    machine's CLOCK_MONOTONIC is the daemon's, which it is not behind a forwarded socket. `voice`
    puts the daemon's errors into the reader's words; None means those of Python.
    """

    def __init__(self, path: str, timeout_s: float) -> None:
        """`timeout_s` limits the calls that do not say otherwise."""
        self.path = path
        self.timeout_s = timeout_s
        self.stop_generation: int | None = None
        self.client: int | None = None
        self.stop_socket: str | None = None
        self.has_clock = True
        self.voice: Voice | None = None
        self._router = Router(self._end_orphan)
        self._ids = itertools.count(1)

    @property
    def closed(self) -> bool:
        """True if the connection has ended: every further call fails."""
        raise NotImplementedError

    def _post(self, line: bytes) -> None:
        """Send a line for which nobody waits; not at all when the connection is gone."""
        raise NotImplementedError

    # Requests

    def prepare(
        self,
        method: str,
        params: Mapping[str, Any] | None = None,
        on_progress: Progress | None = None,
    ) -> Call:
        """Return a call to be run; its caller can check later how far it came."""
        return Call(next(self._ids), method, params, on_progress)

    def prepare_guarded(
        self, method: str, params: Mapping[str, Any], on_progress: Progress | None = None
    ) -> Call:
        """Like `prepare`, for what must never run after a stop that the sender did not know."""
        return self.prepare(method, self._guarded(params), on_progress)

    def _guarded_notification(self, method: str, params: Mapping[str, Any]) -> bytes:
        return request_line(None, method, self._guarded(params))

    def _guarded(self, params: Mapping[str, Any]) -> dict[str, Any]:
        return guarded(params, self.stop_generation, has_clock=self.has_clock)

    def forget(self, call: Call) -> None:
        """Drop later messages for `call`; for callers that set its `keep`."""
        self._router.calls.pop(call.identity, None)

    def abandon(self, call: Call, undo: Undo) -> None:
        """Take back what `call` begins, now or when its answer comes: its caller is gone.

        `keep` of the call must have been set.
        """
        if self.closed:
            return

        def take_back(result: Message) -> None:
            request = undo(result)
            if request is not None:
                self._post(self.prepare(*request).line())

        call.on_result = take_back
        self._router.calls[call.identity] = call
        if call.answered:
            self.forget(call)
            if call.result is not None:
                take_back(call.result)

    # Answers

    def accept(self, hello: Mapping[str, Any]) -> None:
        """Store the daemon's `hello`; raises `ProtocolError` for another protocol."""
        if hello.get("protocol") != PROTOCOL:
            raise ProtocolError(
                f"the daemon speaks protocol {hello.get('protocol')!r}, this client {PROTOCOL}",
                reason="wrong_protocol",
                data={"hint": "install the litegrip_client of the daemon's version"},
            )
        client = hello.get("client")
        self.client = client if isinstance(client, int) else None
        stop_socket = hello.get("stop_socket")
        self.stop_socket = stop_socket if isinstance(stop_socket, str) else None
        told_s = hello.get("monotonic_s")
        self.has_clock = (
            not isinstance(told_s, int | float) or abs(told_s - time.monotonic()) < _CLOCKS_AGREE_S
        )

    def note_stops(self, result: Mapping[str, Any]) -> None:
        """Store the stop generation of a result from any source."""
        generation = generation_of(result)
        if generation is not None and generation > (self.stop_generation or -1):
            self.stop_generation = generation

    def _take(self, call: Call) -> dict[str, Any] | None:
        """Take what came first for `call`: its result, or None for a report of its progress."""
        message = call.inbox.popleft()
        if "method" not in message:
            return self._result(message, call.method)
        if call.on_progress is not None:
            call.on_progress(message["params"])
        return None

    def _result(self, answer: Message, method: str) -> dict[str, Any]:
        if "error" in answer:
            raise self._error(answer["error"], method)
        result = answer.get("result")
        if not isinstance(result, dict):
            raise ProtocolError(f"the daemon answered {method} with no object: {result!r:.80}")
        self.note_stops(result)
        return result

    def _error(self, error_object: Any, method: str) -> LiteGripError:
        error = from_error_object(error_object, method, self.voice)
        if isinstance(error, StoppedError):
            # A caller that gets this error knows the stop: its next request is meant to come after,
            # and `sent_s` alone guards it until an answer has the new number.
            self.stop_generation = generation_of(error.data)
        return error

    def _newest_refusal(self) -> LiteGripError | None:
        """Take the newest refusal of a request that gets no answer, or None."""
        refusal, self._router.refusal = self._router.refusal, None
        if refusal is None:
            return None
        data = {"reason": refusal.get("reason"), **refusal.get("data", {})}
        return self._error({**refusal, "data": data}, "stream.set")

    # Subscriptions

    def _subscribing(self, feed: Feed[Any]) -> Call:
        """Make the call that begins `feed`."""
        from weakref import ref  # noqa: PLC0415 - only subscriptions need it

        def begin(result: Message) -> None:
            feed.begin(result)
            self._router.listeners[feed.key] = ref(feed)

        feed.voice = self.voice
        call = self.prepare(feed.method, feed.params)
        call.on_result = begin
        call.keep = True  # for `_abandon_subscribing`
        return call

    def _abandon_subscribing(self, call: Call, feed: Feed[Any]) -> None:
        """End a subscription whose caller was interrupted, now or when its number comes."""
        self._router.listeners.pop(feed.key, None)
        self.abandon(call, lambda result: unsubscribing(feed.notification, result["subscription"]))

    def _end_orphan(self, key: Key) -> None:
        self._post(self.prepare(*unsubscribing(*key)).line())
