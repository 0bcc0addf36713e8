"""Where each message of the daemon goes: to the call or to the subscription that waits for it.

No I/O and no waiting: the reader of the connection hands over its lines. This module must not know
what the methods mean.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable

from litegrip_client.calls import Call, Message
from litegrip_client.errors import ConnectError, from_error_object

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, Protocol, TypeAlias
    from weakref import ref

    class Listener(Protocol):
        """What takes the notifications of a subscription."""

        def deliver(self, message: Message) -> None:
            """Take one notification's parameters, perhaps of one that came already."""


Key: TypeAlias = "tuple[str, int]"
"""The notification's method and the subscription's number."""

_UNSUBSCRIBING = {
    "state.sample": "state.unsubscribe",
    "state.batch": "state.unsubscribe",
    "event": "events.unsubscribe",
}
"""The notifications of subscriptions, and what ends them."""

_raw_decode = json.JSONDecoder().raw_decode


class Router:
    """Routes what comes. `calls` are those that wait, by number, `listeners` the subscriptions.

    Listeners are held weakly, so that a subscription that nobody has any more can be ended:
    `on_orphan` is called with the key of one for which something came. `refusal` is the newest
    that a request without an answer got, until somebody takes it. `ending` says why nothing
    more can come, once that is so.

    Routing a line twice does no harm, so that a reader may be interrupted in between.
    """

    def __init__(self, on_orphan: Callable[[Key], None]) -> None:
        self.calls: dict[int, Call] = {}
        self.listeners: dict[Key, ref[Listener]] = {}
        self.refusal: Message | None = None
        self.ending: ConnectError | None = None
        self._on_orphan = on_orphan
        self._parting_error: Any = None

    def take(self, lines: Iterable[bytes]) -> str | None:
        """Route complete lines; return what is wrong, if that is not the protocol."""
        try:
            for line in lines:
                self._route(_decode(line))
        except (ValueError, KeyError, TypeError, AttributeError) as error:
            return f"the daemon sent what is not the protocol: {error!r}"
        return None

    def end(self, message: str, reason: str) -> None:
        """Return why nothing more comes: what the daemon said at last, else `message`."""
        data: dict[str, Any] = {"retryable": True}
        code = None
        if self._parting_error is not None:
            parting = from_error_object(self._parting_error)
            message = f"{message}: {parting.message}"
            reason, code, data = parting.reason or reason, parting.code, parting.data
        if self.ending is None:
            self.ending = ConnectError(message, reason=reason, code=code, data=data)

    def check(self) -> None:
        """Raise `ConnectError` when nothing more can come."""
        if self.ending is not None:
            # A new object for each raise: a traceback belongs to one thread or task.
            raise ConnectError(
                self.ending.message,
                reason=self.ending.reason,
                code=self.ending.code,
                data=self.ending.data,
            )

    def _route(self, message: Message) -> None:
        if "method" in message:
            self._route_notification(message)
        elif (identity := message["id"]) is None:
            self._parting_error = message["error"]
        elif (call := self.calls.get(identity)) is not None and not call.answered:
            if isinstance(result := message.get("result"), dict):
                call.result = result
                if call.on_result is not None:
                    call.on_result(result)
            call.inbox.append(message)
            call.answered = True
            self.calls.pop(identity, None)

    def _route_notification(self, message: Message) -> None:
        method, params = message["method"], message["params"]
        if method == "job.progress":
            call = self.calls.get(params.get("request"))
            if call is not None and not call.answered:
                call.job = params["job"]
                call.inbox.append(message)
        elif method in _UNSUBSCRIBING:
            self._deliver((method, params["subscription"]), params)
        elif method == "stream.refused":
            self.refusal = params

    def _deliver(self, key: Key, params: Message) -> None:
        held = self.listeners.get(key)
        if held is None:
            return
        listener = held()
        if listener is not None:
            listener.deliver(params)
        else:
            del self.listeners[key]
            self._on_orphan(key)


def unsubscribing(notification: str, number: int) -> tuple[str, dict[str, Any]]:
    """Return the method and the parameters that end a subscription."""
    return _UNSUBSCRIBING[notification], {"subscription": number}


def no_answer(message: str, timeout_s: float) -> ConnectError:
    """Make the error for a daemon that does not do something in time."""
    hint = "see whether it runs: systemctl status 'litegripd@*'"
    return ConnectError(
        f"{message} within {timeout_s:g} s",
        reason="no_answer",
        data={"retryable": True, "hint": hint},
    )


def _decode(line: bytes) -> Message:
    text = line.decode()
    message, end = _raw_decode(text)
    if end != len(text) or not isinstance(message, dict):
        raise ValueError(f"not one object in a line: {text:.80}")
    return message
