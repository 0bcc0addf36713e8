"""Calls and subscriptions over one connection to the daemon, for any number of threads.

This module knows JSON-RPC and what every request has in common; it must not know what the
methods do.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from types import TracebackType

from litegrip_client.calls import (
    Call,
    Message,
    Progress,
    generation_of,
    guarded,
    request_line,
)
from litegrip_client.errors import LiteGripError, ProtocolError, StoppedError, from_error_object
from litegrip_client.multiplexer import Multiplexer

TYPE_CHECKING = False
if TYPE_CHECKING:  # dataclasses takes longer to import than all the rest of the client
    from typing import Any, TypeVar

    from litegrip_client.subscription import StateSample, StateSubscription

    _Item = TypeVar("_Item")

PROTOCOL = 1
DEFAULT_TIMEOUT_S = 5.0
FOREVER_S = math.inf
"""Time limit of a call that may take as long as a motion takes."""


class Connection:
    """A connection to the daemon at the socket `path`.

    Threads may share it. Processes may not: after a fork the child makes its own.
    `stop_generation` is the newest that an answer told; None when that is not known.
    """

    def __init__(self, path: str, timeout_s: float = DEFAULT_TIMEOUT_S) -> None:
        """Connect; raises `OSError`. `timeout_s` limits the calls that do not say otherwise."""
        self.path = path
        self.timeout_s = timeout_s
        self.stop_generation: int | None = None
        self._multiplexer = Multiplexer(path, timeout_s)
        self._ids = itertools.count(1)

    def call(
        self,
        method: str,
        params: Mapping[str, Any] | None = None,
        timeout_s: float | None = None,
        on_progress: Progress | None = None,
    ) -> dict[str, Any]:
        """Ask the daemon and return its result.

        `timeout_s` None means the connection's, `math.inf` for ever. `on_progress` is called in
        this thread with the parameters of each progress notification of this request (to be
        asked for by `"progress": True`), and may itself make calls. Raises the exception of
        the daemon's error, and `ConnectError` when the connection is gone or no answer comes in
        time. An answer that comes after an interrupt or a time-out is dropped; the connection
        stays usable.
        """
        return self.run(self.prepare(method, params, on_progress), timeout_s)

    def prepare(
        self,
        method: str,
        params: Mapping[str, Any] | None = None,
        on_progress: Progress | None = None,
    ) -> Call:
        """Make a call to be run: for who must know afterwards how far it came."""
        return Call(next(self._ids), method, params, on_progress)

    def prepare_guarded(
        self, method: str, params: Mapping[str, Any], on_progress: Progress | None = None
    ) -> Call:
        """Like `prepare`, for what must never run after a stop that the sender did not know."""
        return self.prepare(method, guarded(params, self.stop_generation), on_progress)

    def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
        """Send a prepared call and wait for its result, as described for `call`."""
        multiplexer = self._multiplexer
        multiplexer.check_usable()
        limit_s = self.timeout_s if timeout_s is None else timeout_s
        line = call.line()
        try:
            multiplexer.calls[call.identity] = call
            multiplexer.send(line, self.timeout_s)
            while True:
                multiplexer.wait(call.inbox, limit_s, call.method)
                message = call.inbox.popleft()
                if "method" not in message:
                    return self._result(message, call.method)
                if call.on_progress is not None:
                    call.on_progress(message["params"])
        finally:
            if not call.keep:
                self.forget(call)

    def forget(self, call: Call) -> None:
        """Drop what still comes for `call`: for whoever set its `keep`."""
        self._multiplexer.calls.pop(call.identity, None)

    def notify_guarded(self, method: str, params: Mapping[str, Any]) -> None:
        """Send, as `prepare_guarded` does, a request that gets no answer.

        Raises `ConnectError` when the connection is gone. Look at `take_refusal` before.
        """
        self._multiplexer.check_usable()
        line = request_line(None, method, guarded(params, self.stop_generation))
        self._multiplexer.send(line, self.timeout_s)

    def take_refusal(self) -> LiteGripError | None:
        """Return why the daemon refused what `notify_guarded` sent, once it has said so."""
        multiplexer = self._multiplexer
        multiplexer.check_usable()
        multiplexer.poll()
        refusal, multiplexer.refusal = multiplexer.refusal, None
        if refusal is None:
            return None
        data = {"reason": refusal.get("reason"), **refusal.get("data", {})}
        return self._error({**refusal, "data": data})

    def _error(self, error_object: Any) -> LiteGripError:
        error = from_error_object(error_object)
        if isinstance(error, StoppedError):
            # Who is told of a stop knows of it: what it sends next is meant to come after,
            # and `sent_s` alone guards it until an answer tells the new number.
            self.stop_generation = generation_of(error.data)
        return error

    def _result(self, answer: Message, method: str) -> dict[str, Any]:
        if "error" in answer:
            raise self._error(answer["error"])
        result = answer.get("result")
        if not isinstance(result, dict):
            raise ProtocolError(f"the daemon answered {method} with no object: {result!r:.80}")
        generation = generation_of(result)
        if generation is not None and generation > (self.stop_generation or -1):
            self.stop_generation = generation
        return result

    def greet(self, client: str) -> dict[str, Any]:
        """Say hello; return what the daemon says of itself. Checks the protocol's version."""
        hello = self.call("hello", {"client": client})
        if hello.get("protocol") != PROTOCOL:
            raise ProtocolError(
                f"the daemon speaks protocol {hello.get('protocol')!r}, this client {PROTOCOL}",
                reason="wrong_protocol",
                data={"hint": "install the litegrip_client of the daemon's version"},
            )
        return hello

    def subscribe_state(
        self, hz: float = 20.0, fields: Sequence[str] | None = None
    ) -> StateSubscription[StateSample]:
        """Get the state `hz` times a second (0.1 to 200), or only some `fields` of it."""
        return self.subscribe(hz, fields, lambda sample: sample)

    def subscribe(
        self,
        hz: float,
        fields: Sequence[str] | None,
        convert: Callable[[StateSample], _Item],
    ) -> StateSubscription[_Item]:
        """Like `subscribe_state`, with each sample made into something else."""
        from litegrip_client.subscription import StateSubscription  # noqa: PLC0415 - see above

        multiplexer = self._multiplexer
        subscription = StateSubscription(self, hz, convert)

        def begin(result: Message) -> None:
            subscription.begin(result)
            multiplexer.listeners[subscription.identity] = subscription

        call = self.prepare("state.subscribe", {"hz": float(hz)})
        if fields is not None:
            call.params = {"hz": float(hz), "fields": list(fields)}
        call.on_result = begin
        try:
            self.run(call)
        except BaseException:
            if not self.closed:
                self._abandon(call, subscription.identity)
            raise
        return subscription

    def _abandon(self, call: Call, identity: int) -> None:
        """End a subscription whose caller was interrupted, now or when its number comes."""
        calls, listeners = self._multiplexer.calls, self._multiplexer.listeners

        def end(result: Message) -> None:
            calls.pop(call.identity, None)
            params = {"subscription": result["subscription"]}
            self._multiplexer.send(self.prepare("state.unsubscribe", params).line(), self.timeout_s)

        if listeners.pop(identity, None) is not None:
            end({"subscription": identity})
        elif not call.answered:
            call.on_result = end
            calls[call.identity] = call

    def next_sample(self, subscription: StateSubscription[Any], timeout_s: float) -> None:
        """Wait until `subscription` has something in its inbox."""
        self._multiplexer.check_usable()
        self._multiplexer.wait(subscription.inbox, timeout_s, "with a state sample")

    def unsubscribe(self, identity: int) -> None:
        """End a subscription; there is nothing to do when the connection has ended."""
        try:
            if identity in self._multiplexer.listeners and not self.closed:
                self.call("state.unsubscribe", {"subscription": identity})
        finally:
            self._multiplexer.listeners.pop(identity, None)

    @property
    def closed(self) -> bool:
        """Whether no further call can succeed."""
        return self._multiplexer.closed

    @property
    def is_own(self) -> bool:
        """Whether this process made the connection, and not the parent that it was forked from."""
        return self._multiplexer.is_own

    @property
    def is_waiting_here(self) -> bool:
        """Whether this very thread waits for an answer: so in a signal handler during a call."""
        return self._multiplexer.is_waiting_here

    def close(self) -> None:
        """End the connection; again does nothing. In a forked child only its copy is closed."""
        self._multiplexer.close()

    def __enter__(self) -> Connection:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
