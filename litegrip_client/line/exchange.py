"""JSON-RPC without I/O: the text of requests, and which request an answer belongs to.

The connections of threads and of event loops add I/O and waiting to `Exchange`. This
module must not know what the methods do.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import os
import time
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping
from json import scanner
from weakref import ref

from litegrip_client.values.errors import (
    BusyError,
    CommandError,
    ConnectError,
    LiteGripError,
    ParameterError,
    ProtocolError,
    StoppedError,
    from_error_object,
)
from litegrip_client.values.tracebacks import is_of_handler

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, Protocol, TypeAlias

    class Listener(Protocol):
        """Receives the notifications of a subscription."""

        def deliver(self, message: Message) -> None:
            """Take a notification's parameters; the same notification may come twice."""

    class Subscribing(Listener, Protocol):
        """A listener with what begins its subscription, see `feeds.Feed`."""

        notification: str
        method: str
        params: Message
        voice: Voice | None

        @property
        def key(self) -> Key:
            """The name under which its notifications come, once it has begun."""

        def begin(self, result: Message) -> None:
            """Take the answer to the subscription; again does nothing."""

    from litegrip_client.values.errors import Origin
    from litegrip_client.values.figures import Here
    from litegrip_client.values.terms import Voice

MAX_LINE_BYTES = 16_384
"""A longer line makes the daemon close the connection."""

Message: TypeAlias = "dict[str, Any]"
Progress: TypeAlias = "Callable[[Message], None]"

_encode = json.JSONEncoder(separators=(",", ":"), allow_nan=False).encode
_quote = json.encoder.encode_basestring_ascii


class Call:
    """One request, to be given to `run` of a connection once.

    `inbox` gets its progress notifications and then its answer. `job` is the number of the job
    that it started, once a notification names it. `is_sent` is true once the daemon may have got
    it, `answered` once the answer has come; `result` is its result, None for an error. `on_result`
    is called with the result where it is read, before anything behind it is read. With `keep`, an
    answer that comes after an interrupt is still taken, until `forget`.
    """

    job: int | None = None
    result: Message | None = None
    is_sent = False
    answered = False
    keep = False
    on_result: Progress | None = None

    def __init__(
        self,
        identity: int,
        method: str,
        params: Mapping[str, Any] | None = None,
        on_progress: Progress | None = None,
    ) -> None:
        self.identity = identity
        self.method = method
        self.params = params
        self.on_progress = on_progress
        self.inbox: deque[Message] = deque()

    def line(self) -> bytes:
        """Return the request as it is sent; raises `CommandError` when it cannot be."""
        return request_line(self.identity, self.method, self.params)


def request_line(identity: int | None, method: str, params: Mapping[str, Any] | None) -> bytes:
    """Return a request as it is sent; `identity` None makes it one that gets no answer.

    Raises `CommandError` when it cannot be sent.
    """
    try:
        tail = f',"params":{_encode(params)}' if params else ""
    except (ValueError, TypeError, RecursionError) as error:
        raise _unsendable(f"{method}: a parameter is not JSON: {error}") from error
    number = "" if identity is None else f'"id":{identity},'
    line = f'{{"jsonrpc":"2.0",{number}"method":{_quote(method)}{tail}}}\n'.encode()
    if len(line) > MAX_LINE_BYTES:
        text = f"{method}: the request is {len(line)} bytes long, {MAX_LINE_BYTES} at most"
        raise _unsendable(text)
    return line


def guarded(
    params: Mapping[str, Any], stop_generation: int | None, *, has_clock: bool
) -> dict[str, Any]:
    """Add to `params` when they were sent and of which stop their sender knew.

    For what must never run after a stop that comes before the daemon reads it. The time says
    something only where the daemon's clock can be read: `has_clock`.
    """
    guards: dict[str, Any] = {"sent_s": time.monotonic()} if has_clock else {}
    if stop_generation is not None:
        guards["stop_generation"] = stop_generation
    return {**params, **guards}


def generation_of(result: Mapping[str, Any]) -> int | None:
    """Return the stop generation that a result or error data holds, or None."""
    if isinstance(generation := result.get("stop_generation"), int):
        return generation
    if isinstance(generation := result.get("generation"), int):
        return generation
    state = result.get("state")
    generation = state.get("stop_generation") if isinstance(state, dict) else None
    return generation if isinstance(generation, int) else None


def _unsendable(message: str) -> CommandError:
    return ParameterError(message, reason="invalid_params")


Key: TypeAlias = "tuple[str, int]"
"""The notification's method and the subscription's number."""

_UNSUBSCRIBING = {
    "state.sample": "state.unsubscribe",
    "state.batch": "state.unsubscribe",
    "event": "events.unsubscribe",
}
"""The notifications of subscriptions, and what ends them."""

_scan = scanner.make_scanner(json.JSONDecoder())  # type: ignore[arg-type]
_VIOLATIONS = (StopIteration, ValueError, KeyError, TypeError, AttributeError)
"""What comes of lines that are not the protocol; the first is of `_scan`."""


@contextlib.contextmanager
def or_closed() -> Iterator[None]:
    """Take it for an end when another thread or task closes the connection meanwhile."""
    try:
        yield
    except ConnectError as error:
        if error.reason != "closed":
            raise


class Router:
    """Routes what comes. `calls` are those that wait, by number, `listeners` the subscriptions.

    Listeners are held weakly, so that a subscription that nobody has any more can be ended:
    `on_orphan` is called with the key of one for which something came. `refusal` is the newest
    that a request without an answer got, until somebody takes it. `ending` says why nothing
    more can come, once that is so; `how_to_go_on` returns the hint to that. `is_silent` is true
    from a time-out on until something comes, `is_danger_told` if somebody was told meanwhile to
    cut the motor's power. `here` names the gripper in commands of litegripctl.

    Routing a line twice does no harm, so that a reader may be interrupted in between.
    """

    def __init__(
        self,
        on_orphan: Callable[[Key], None],
        how_to_go_on: Callable[[LiteGripError], str | None],
    ) -> None:
        self.calls: dict[int, Call] = {}
        self.listeners: dict[Key, ref[Listener]] = {}
        self.refusal: Message | None = None
        self.ending: ConnectError | None = None
        self.is_silent = self.is_danger_told = False
        self.here: Here = str
        self._on_orphan = on_orphan
        self._how_to_go_on = how_to_go_on
        self._parting_error: Any = None

    def take(self, lines: Iterable[bytes]) -> str | None:
        """Route complete lines; return what violates the protocol, or None."""
        try:
            for line in lines:
                self._route(_decode(line))
                self.is_silent = self.is_danger_told = False
        except _VIOLATIONS as error:
            if is_of_handler(error):
                raise
            return f"the daemon sent what is not the protocol: {error!r}"
        return None

    def end(self, message: str, reason: str) -> None:
        """Record that nothing more comes, and why: the daemon's last error, or `message`."""
        data: dict[str, Any] = {"retryable": True}
        code = None
        if self._parting_error is not None:
            parting = from_error_object(self._parting_error)
            message = f"{message}: {parting.message}"
            reason, code, data = parting.reason or reason, parting.code, parting.data
        if self.ending is None:
            self.ending = ConnectError(message, reason=reason, code=code, data=data)

    def check(self, *, is_asked_late: bool = False) -> None:
        """Raise `ConnectError` when nothing more can come.

        What is asked after the end, `is_asked_late`, cannot succeed here.
        """
        if self.ending is None:
            return
        data = dict(self.ending.data)
        if is_asked_late:
            data["retryable"] = False
        if "hint" not in data and (hint := self._how_to_go_on(self.ending)) is not None:
            data["hint"] = hint
        # A new object for each raise: a traceback belongs to one thread or task.
        raise ConnectError(
            self.ending.message, reason=self.ending.reason, code=self.ending.code, data=data
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
        elif method == "teleop.send":
            self._deliver((method, 0), params)

    def _deliver(self, key: Key, params: Message) -> None:
        held = self.listeners.get(key)
        if held is None:
            return
        listener = held()
        if listener is not None:
            listener.deliver(params)
        else:
            del self.listeners[key]
            if key[0] in _UNSUBSCRIBING:
                self._on_orphan(key)


def unsubscribing(notification: str, number: int) -> tuple[str, dict[str, Any]]:
    """Return the method and the parameters that end a subscription."""
    return _UNSUBSCRIBING[notification], {"subscription": number}


SEE_DOCTOR = "see what is wrong: litegripctl doctor"


def no_answer(message: str, timeout_s: float, here: Here) -> ConnectError:
    """Make the error for a daemon that does not do something in time."""
    return ConnectError(
        f"{message.rstrip()} within {timeout_s:g} s",
        reason="no_answer",
        data={"retryable": True, "hint": here(SEE_DOCTOR)},
    )


def not_answered(quiet_s: float) -> str:
    """Return what to say of a silent daemon while the motor may be enabled."""
    return (
        f"the daemon has not answered for {quiet_s:.0f} s: what the jaws do is not known; to be"
        " sure, cut the motor's power"
    )


LEFT_ALONE = (
    "if it is gone, the motor should soon let go by itself, and what was held falls; if it does"
    " not, cut its power"
)
"""What a connection's end means for a motor that may be enabled, see docs/motor-watchdog.md."""

_QUIET_S, _ANSWERED_WITHIN_S = 1.9, 2.9
"""So that the fourth and the tenth look find it: who waits looks twice a second."""
_GAP_S = 1.0
"""Between looks so far apart this process did not run."""


class Watch:
    """Finds out, for a call that may take long, that the daemon has fallen silent.

    After a while without a message for the call, the daemon is asked for its state. The answer is
    put into the call's own inbox, which ends the silence as any message does.
    """

    def __init__(self, exchange: Exchange, call: Call) -> None:
        self._exchange = exchange
        self._call = call
        self._question: Call | None = None
        self.restart()

    def restart(self) -> None:
        """Begin to count: a message has come."""
        self._quiet_s = 0.0
        self._asked_at_s: float | None = None
        self._looked_s = time.monotonic()

    def look(self) -> None:
        """Ask if it is time for that; raise `ConnectError` if no answer came in time."""
        now_s = time.monotonic()
        passed_s = now_s - self._looked_s
        if passed_s > _GAP_S:  # what has come meanwhile is not read yet
            self.restart()
            return
        self._looked_s = now_s
        self._quiet_s += passed_s
        if self._asked_at_s is None:
            if self._quiet_s >= _QUIET_S or self._exchange.is_silent:
                self._asked_at_s = self._quiet_s
                self.end()
                self._question = self._exchange.question(self._call)
        elif self._quiet_s - self._asked_at_s >= _ANSWERED_WITHIN_S:
            self._exchange.note_silence(is_danger_told=True)
            raise ConnectError(
                not_answered(self._quiet_s),
                reason="no_answer",
                data={"retryable": True, "hint": self._exchange.here(SEE_DOCTOR)},
            )

    def end(self) -> None:
        """Drop an answer that is still to come."""
        if self._question is not None:
            self._exchange.forget(self._question)


def answer_in(line: bytes, identity: int) -> Message | None:
    """Return the answer to a request if a line is that; `Router.take` says what else is wrong."""
    try:
        text = line.decode()
        message, end = _scan(text, 0)
        is_answer = end == len(text) and message["id"] == identity and "method" not in message
    except _VIOLATIONS as error:
        if is_of_handler(error):
            raise
        return None
    return message if is_answer else None


def _decode(line: bytes) -> Message:
    text = line.decode()
    message, end = _scan(text, 0)
    if end != len(text) or not isinstance(message, dict):
        raise ValueError(f"not one object in a line: {text:.80}")
    return message


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

    It is None if that is not known, and so is `client`, the daemon's number for the connection;
    and `stop_socket`, where it takes stops before everything else. `has_enabled` is for its
    user, from whose enabling to whose disabling it is true: then a lost lease is got again by
    enabling, too, and errors name that. `has_clock` is true if this
    machine's CLOCK_MONOTONIC is the daemon's, which it is not behind a portal or a forwarded
    socket. `voice` puts the daemon's errors into the reader's words; None means those of Python.
    `daemon_version` is for them, too, and so is `origin`, the gripper of its user.
    """

    def __init__(self, socket_path: str, timeout_s: float) -> None:
        """`timeout_s` limits the calls that do not say otherwise."""
        self.socket_path = socket_path
        self.timeout_s = timeout_s
        self.stop_generation: int | None = None
        self.client: int | None = None
        self.stop_socket: str | None = None
        self.daemon_version: str | None = None
        self.has_enabled = False
        self.has_clock = True
        self.voice: Voice | None = None
        self.origin: Origin | None = None
        self._is_accepted = False
        self._router = Router(self._end_orphan, self._how_to_go_on)
        self._ids = itertools.count(1)

    @property
    def closed(self) -> bool:
        """True if the connection has ended: every further call fails."""
        raise NotImplementedError

    @property
    def is_own(self) -> bool:
        """True if this process made the connection, not the parent process before a fork."""
        raise NotImplementedError

    @property
    def daemon_pid(self) -> int:
        """The process id of the other end, 0 if unknown."""
        raise NotImplementedError

    def check_open(self) -> None:
        """Raise `ConnectError` when nothing more can come here."""
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
        """Return a call for `run`; the caller can check later what became of it."""
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

    def post(
        self, method: str, params: Mapping[str, Any], on_result: Progress | None = None
    ) -> None:
        """Send a request for which nobody waits; `on_result` gets its result where it is read."""
        call = self.prepare(method, params)
        if on_result is not None:
            call.on_result = on_result
            self._router.calls[call.identity] = call
        self._post(call.line())

    @property
    def here(self) -> Here:
        """Puts into a text of ours how litegripctl is called for the gripper of this connection."""
        return self._router.here

    @here.setter
    def here(self, value: Here) -> None:
        self._router.here = value

    @property
    def is_silent(self) -> bool:
        """True if the daemon did not answer in time, and nothing has come since then."""
        return self._router.is_silent

    @property
    def is_danger_told(self) -> bool:
        """True if somebody was told since then that the motor's power is to be cut."""
        return self._router.is_danger_told

    def note_silence(self, *, is_danger_told: bool = False) -> None:
        """Note that the daemon did not answer in time."""
        self._router.is_silent = True
        self._router.is_danger_told |= is_danger_told

    def question(self, call: Call) -> Call:
        """Ask the daemon something that it answers at once, to wake who waits for `call`."""
        question = self.prepare("state.get")
        question.inbox = call.inbox
        self._router.calls[question.identity] = question
        self._post(question.line())
        return question

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
                self.post(*request)

        call.on_result = take_back
        self._router.calls[call.identity] = call
        if call.answered:
            self.forget(call)
            if call.result is not None:
                take_back(call.result)

    def asked_by(self, method: str) -> str:
        """Name the call that has asked a method, for who gets no answer; "" for the greeting."""
        if method == "hello":
            return ""
        from litegrip_client.values.voices import in_python  # noqa: PLC0415 - an error

        said = (self.voice or in_python)(method, None, None)
        return said if said and ": " not in said else method  # else it is advice, and no name

    def _how_to_go_on(self, ended: LiteGripError) -> str | None:
        """Return how to go on after the end, None where the reader cannot, or never was here."""
        from litegrip_client.values.voices import connecting, in_python  # noqa: PLC0415 - an error

        connect = connecting(self.voice) if self._is_accepted else None
        if connect is None:
            return None
        enable = (self.voice or in_python)("motor.enable", None, None)
        is_down = ended.reason == "shutting_down" and not ended.data.get("followed")
        start = "start the daemon again; " if is_down else ""
        return f"{start}{connect} connects again" + (f", then: {enable}" if enable else "")

    # Answers

    def accept(self, hello: Mapping[str, Any]) -> None:
        """Store the daemon's `hello`; raises `ProtocolError` for another protocol."""
        if hello.get("protocol") != PROTOCOL:
            raise ProtocolError(
                f"the daemon speaks protocol {hello.get('protocol')!r}, this client {PROTOCOL}",
                reason="wrong_protocol",
                data={"hint": "install the litegrip_client of the daemon's version"},
            )
        self._is_accepted = True
        version = hello.get("version")
        self.daemon_version = version if isinstance(version, str) else None
        client = hello.get("client")
        self.client = client if isinstance(client, int) else None
        stop_socket = hello.get("stop_socket")
        self.stop_socket = stop_socket if isinstance(stop_socket, str) else None
        clock_s = hello.get("monotonic_s")
        self.has_clock = hello.get("remote") is None and (
            not isinstance(clock_s, int | float)
            or abs(clock_s - time.monotonic()) < _CLOCKS_AGREE_S
        )

    def note_stops(self, result: Mapping[str, Any]) -> None:
        """Store the stop generation of a result from any source."""
        generation = generation_of(result)
        if generation is not None and generation > (self.stop_generation or -1):
            self.stop_generation = generation

    def _take(self, call: Call) -> dict[str, Any] | None:
        """Take the first message for `call`: return its result, or None after another one."""
        message = call.inbox.popleft()
        if "method" not in message:
            is_own = message["id"] == call.identity  # else it is the answer to a `question`
            return self._result(message, call.method) if is_own else None
        if call.on_progress is not None:
            call.on_progress(message["params"])
        return None

    def _result(self, answer: Message, method: str) -> dict[str, Any]:
        if "error" in answer:
            raise self.error_of(answer["error"], method)
        result = answer.get("result")
        if not isinstance(result, dict):
            raise ProtocolError(f"the daemon answered {method} with no object: {result!r:.80}")
        if self.stop_generation is None or result.get("stop_generation") != self.stop_generation:
            self.note_stops(result)
        return result

    def error_of(self, error_object: Any, method: str) -> LiteGripError:
        """Return the exception for an error of `method`; its caller knows of a stop then."""
        import re  # noqa: PLC0415 - an error, as the next

        from litegrip_client.values.voices import (  # noqa: PLC0415
            enabling_again,
            ending_its_own,
            in_python,
            setting_right,
        )

        error = from_error_object(error_object, method, self.voice, self.daemon_version)
        field = error.data.get("field") if error.data.get("parameter") == "config" else None
        if field and (self.voice or in_python)(None, "config", method) == "motion_config":
            error.data.setdefault("hint", setting_right(field))
        if error.reason == "lease_lost" and self.has_enabled:
            voice = enabling_again(self.voice)
            error = from_error_object(error_object, method, voice, self.daemon_version)
        if isinstance(error, StoppedError) or error.data.get("cause") == "stopped":
            # A caller that gets this error knows the stop: its next request is meant to come after,
            # and `sent_s` alone guards it until an answer has the new number.
            self.stop_generation = generation_of(error.data)
        if isinstance(error, BusyError) and self.has_clock:
            owner = error.data.get("owner")
            if isinstance(owner, dict) and owner.get("pid") == os.getpid():
                if (kind := error.data.get("kind")) is not None:
                    voice = ending_its_own(self.voice, kind)
                    error = from_error_object(error_object, method, voice, self.daemon_version)
                own = rf"(\(pid {os.getpid()})(?=[,)])"
                error.message = re.sub(own, r"\1, this very program", error.message, count=1)
                enable = (self.voice or in_python)("motor.enable", None, None)
                if error.reason == "lease_held" and enable is not None:
                    rule = "takes it over between motions, unless a block of lease() has it"
                    error.message += f"; {enable} {rule}"
        _name_the_user(error)
        if error.reason == "older_daemon" and error.hint is not None:
            error.data["hint"] = self.here(error.hint)
        if error.reason == "shutting_down" and (how := self._how_to_go_on(error)) is not None:
            error.data.setdefault("hint", how)
        return error

    def _newest_refusal(self) -> LiteGripError | None:
        """Take the newest refusal of a request that gets no answer, or None."""
        refusal, self._router.refusal = self._router.refusal, None
        if refusal is None:
            return None
        data = {"reason": refusal.get("reason"), **refusal.get("data", {})}
        return self.error_of({**refusal, "data": data}, "stream.set")

    # Subscriptions

    def _subscribing(self, feed: Subscribing) -> Call:
        """Return the call that begins `feed`."""

        def begin(result: Message) -> None:
            feed.begin(result)
            self._router.listeners[feed.key] = ref(feed)

        feed.voice = self.voice
        call = self.prepare(feed.method, feed.params)
        call.on_result = begin
        call.keep = True  # for `_abandon_subscribing`
        return call

    def _abandon_subscribing(self, call: Call, feed: Subscribing) -> None:
        """End a subscription whose caller was interrupted, now or when its number comes."""
        self._router.listeners.pop(feed.key, None)
        self.abandon(call, lambda result: unsubscribing(feed.notification, result["subscription"]))

    def _end_orphan(self, key: Key) -> None:
        self.post(*unsubscribing(*key))


def _name_the_user(error: LiteGripError) -> None:
    """Put the name of this user, whom the daemon knows by number, where the role is refused.

    Behind the last such number in the message nothing is of other users' words.
    """
    uid = error.data.get("uid") if error.reason == "not_permitted" else None
    name = None if uid is None else _user_name(uid)
    if name is None:
        return
    before, number, after = error.message.rpartition(f"uid {uid} is")
    if number:
        error.message = f"{before}{name} (uid {uid}) is{after}"
    if error.hint is not None:
        error.data["hint"] = error.hint.replace(f"uid {uid} ", f"{name} ", 1)


def _user_name(uid: object) -> str | None:
    import pwd  # noqa: PLC0415 - only this error needs it

    try:
        return pwd.getpwuid(uid).pw_name if isinstance(uid, int) else None
    except (KeyError, OverflowError):
        return None
