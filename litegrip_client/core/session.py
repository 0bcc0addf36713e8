"""One gripper object at its daemon: connection, lease, and what its end does to the motor.

This module must not know motions.
"""

from __future__ import annotations

import contextlib
import os
import sys
import time
from collections.abc import Callable, Coroutine, Iterable, Iterator, Mapping
from weakref import WeakSet, WeakValueDictionary

from litegrip_client.core.discovery import (
    chosen_channel,
    in_any_shell,
    is_left_out,
    is_socket_given,
    socket_paths,
)
from litegrip_client.core.sockets import CHANNEL_VARIABLE, SOCKET_VARIABLE, STOP_LEVELS
from litegrip_client.line.exchange import LEFT_ALONE, SEE_DOCTOR, or_closed
from litegrip_client.values.checks import (
    check_callback,
    flag,
    given_numbers,
    in_range,
    integer,
    path,
    wrong,
)
from litegrip_client.values.errors import (
    CommandError,
    CommError,
    ConnectError,
    HardwareError,
    LeaseError,
    LiteGripError,
    Origin,
    ParameterError,
    ProtocolError,
)
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.warn import leave, warn

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from collections.abc import Awaitable
    from typing import Any, NoReturn, Protocol, TypeVar

    from litegrip_client.line.exchange import Call, Exchange
    from litegrip_client.values.figures import Here
    from litegrip_client.values.terms import Voice

    _Result = TypeVar("_Result")

    class Wire(Protocol):
        """What waits for the daemon, as coroutines; `connection` does the rest."""

        @property
        def connection(self) -> Exchange:
            """The connection, for all that does not wait."""

        async def run(self, call: Call, timeout_s: float | None = None) -> dict[str, Any]:
            """Send a call, and return its result."""

        async def call(
            self,
            method: str,
            params: Mapping[str, Any] | None = None,
            timeout_s: float | None = None,
        ) -> dict[str, Any]:
            """Make a call and run it."""

        async def notify_guarded(self, method: str, params: Mapping[str, Any]) -> None:
            """Send a guarded request that gets no answer."""

        async def take_refusal(self) -> LiteGripError | None:
            """Return the daemon's refusal of such a request, or None."""

        async def finish(self, begin: Callable[[], Coroutine[Any, Any, None]]) -> None:
            """Await what `begin` returns, to its end even when the task is cancelled again."""

        async def close(self) -> None:
            """End the connection; in a forked child only the child's copy of it."""


ACTION_TIMEOUT_S = 30.0
"""For enabling and disabling: retries and register reads included, the daemon is done by then."""

_GONE_WITHIN_S = 2.0
"""So soon the daemon has noticed a connection's end, and disabled the motor if it has to."""

_FAREWELL_WITHIN_S, _FAREWELL_LOOK_S = 1.0, 0.02
"""So long a daemon that ends is listened to: its last line says whether the motor is off."""

_SESSIONS: WeakSet[DaemonSession] = WeakSet()
"""All of this process."""

_CONNECTED: WeakValueDictionary[int, DaemonSession] = WeakValueDictionary()
"""Those of them that are connected, or were not closed since; a dictionary, as threads share it."""


class DaemonSession:
    """A daemon, by channel, and the connection to it while there is one.

    `chosen` is the channel that is looked for. Where a socket alone is named, its daemon may have
    any: `channel` is then known once connected.

    `enabled_here` is true from this session's enabling on until its disabling; only then does its
    end do anything to the motor. `keeps_lease` is true if it wants the lease until its end,
    `leased` that it has it, as far as it knows. Both outlive a loss of the lease, however it is got
    again, and whoever has enabled meanwhile: else the motor would stay enabled at the end, or after
    a crash, of who has said that it is disabled then. `handed_over` is true while a newer object
    answers for both in its place. `voice` puts the daemon's texts into the words of
    the program, or of Python. `here` puts into a text of ours how litegripctl is called
    for this gripper. `cancels` counts the calls of `cancel_own`, `waits` what
    waits for it without a job of the daemon.
    """

    def __init__(
        self,
        channel: str | None,
        can_id: int | None,
        socket_path: str | None,
        *,
        disable_on_disconnect: bool,
        expected: Mapping[str, Any] | None = None,
        voice: Voice | None = None,
    ) -> None:
        """Expect the values of `expected` in the daemon's `GripperConfig`, by its fields.

        Raises `CommandError` for a `voice` that cannot be called, and what else cannot be.
        """
        if voice is not None:
            what = "a method, a parameter and the method that was asked"
            check_callback("voice", voice, 3, what)
            voice = _kept(voice)
        given: Any = can_id
        if given in ("normal", "reverse"):
            raise ParameterError(
                f"can_id is {can_id!r}, it must be a number; a mount: mount={can_id!r}",
                reason="invalid_params",
                data={"parameter": "can_id"},
            )
        self._expected = expected or {}
        self.chosen = chosen_channel(channel)
        self.channel_left_out = is_left_out(channel)
        self._by_variable = channel is None  # or by default
        self.can_id = None if can_id is None else integer("can_id", can_id)
        self.socket_path = None if socket_path is None else path("socket_path", socket_path)
        socket_alone = self._socket_alone
        self.origin = Origin(self.chosen if socket_alone is None else socket_alone)
        self.here = in_any_shell(self.chosen, self.socket_path)
        self.voice: Voice = voice or for_gripper(self.name_call, self.here)
        self.disable_on_disconnect = flag("disable_on_disconnect", disable_on_disconnect)
        self.keeps_lease = False
        self.handed_over = False
        self._leases = 0
        self._on_lost: str | None = None
        self._wire: Wire | None = None
        self._connect_first: Callable[[], Awaitable[object]] | None = None
        self.cancels = self.waits = 0
        _SESSIONS.add(self)

    async def _connect(self) -> Wire:
        """Connect to the daemon; raises `ConnectError`."""
        raise NotImplementedError

    async def reach(self, path: str, timeout_s: float) -> Wire:
        """Connect to another socket of the same daemon; raises `OSError`."""
        raise NotImplementedError

    async def ask(
        self, method: str, params: Mapping[str, Any] | None = None, timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call, even from a signal handler whose thread waits for an answer."""
        return await self.wire.call(method, params, timeout_s)

    async def command(
        self, method: str, params: Mapping[str, Any], timeout_s: float | None = None
    ) -> dict[str, Any]:
        """Make a call that must never act after a stop that this program did not know of."""
        wire = self.wire
        return await wire.run(wire.connection.prepare_guarded(method, params), timeout_s)

    async def cancel_own(self) -> bool:
        """Cancel what moves for this session's connection; return True if anything did."""
        self.cancels += 1
        wire, is_waited = self.wire, self.waits > 0
        listed = (await wire.call("job.list"))["jobs"]
        ended = [
            await wire.call("job.cancel", {"job": number})
            for number in own_jobs(wire.connection, listed)
        ]
        return is_waited or any(job["state"] == "cancelled" for job in ended)

    async def run_blocking(self, function: Callable[..., _Result], *arguments: Any) -> _Result:
        """Run a function that works with files, and so may block; return its result."""
        raise NotImplementedError

    async def pause(self, seconds: float) -> None:
        """Wait for a while."""
        raise NotImplementedError

    @property
    def is_open(self) -> bool:
        """True if calls can be made."""
        return self._wire is not None and not self._wire.connection.closed

    @property
    def enabled_here(self) -> bool:
        """True from the enabling by this connection on until its disabling."""
        return self._wire is not None and self._wire.connection.has_enabled

    @enabled_here.setter
    def enabled_here(self, value: bool) -> None:
        if self._wire is not None:  # else another thread has disconnected meanwhile
            self._wire.connection.has_enabled = value

    @property
    def leased(self) -> bool:
        """True if anybody who uses this session still wants the lease."""
        return (self.keeps_lease and not self.handed_over) or self._leases > 0

    @property
    def wire(self) -> Wire:
        """The connection; raises `ConnectError` when there is none."""
        if self._wire is None:
            from litegrip_client.values.voices import connecting  # noqa: PLC0415 - an error

            connect = connecting(self.voice)
            is_awaited = connect is not None and connect.startswith("await ")
            block = f"'{'async ' if is_awaited else ''}with LiteGrip(...) as gripper:'"
            is_path = self.channel == self._socket_alone
            raise ConnectError(
                f"not connected to the daemon of {'' if is_path else 'channel '}{self.channel}",
                reason="not_connected",
                data={"hint": f"call {connect or 'connect()'} first, or use {block}"},
            )
        return self._wire

    @property
    def channel(self) -> str:
        """The daemon's channel; where a socket alone is named, its path until connected."""
        return self.origin.channel

    @property
    def _socket_alone(self) -> str | None:
        """The path of the socket that is named without a channel, None where that is not so."""
        is_alone = self.channel_left_out and is_socket_given(self.socket_path)
        return socket_paths(self.chosen, self.socket_path)[0] if is_alone else None

    @staticmethod
    def name_call(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        """Name a call of `LiteGrip` or an argument, as this kind of program makes it."""
        from litegrip_client.values.voices import in_python  # noqa: PLC0415 - seldom needed

        return in_python(method, parameter, asked)

    # Connecting

    def connects_first(self, connect: Callable[[], Awaitable[object]]) -> None:
        """Use `connect` in `open_first`."""
        self._connect_first = connect

    async def open_first(self) -> None:
        """Connect if not connected: the SDK's calls on calibrations work before `connect`."""
        connect = self._connect_first
        if connect is not None and self._wire is None:
            await connect()

    async def open(self, begin: Callable[[Wire], Awaitable[None]]) -> None:
        """Connect if not connected. Others see the connection once `begin` has returned.

        Raises `ConnectError`, `CommandError` when the daemon there drives something else, and
        what `begin` raises.
        """
        if self.is_open:
            return
        if self._socket_alone is None:  # else which it is, is not known yet
            self._note_others()  # what now fails is one of several, too
        wire = await self.connect_apart(begin)
        old = self._wire
        if old is not None and not old.connection.closed:  # another task was faster
            await wire.close()
            return
        self._wire = wire
        _CONNECTED[id(self)] = self
        self._note_others()
        self._connect_first = None
        self.keeps_lease = self.handed_over = False
        self._leases, self._on_lost = 0, None
        if old is not None:
            await old.close()

    def _note_others(self) -> None:
        """Have the errors of all name their gripper once the program is connected to another."""
        for held in _CONNECTED.valuerefs():
            other = held()
            if other is not None and other.channel != self.channel:
                self.origin.is_one_of_several = other.origin.is_one_of_several = True

    async def connect_apart(self, begin: Callable[[Wire], Awaitable[None]] | None = None) -> Wire:
        """Return a connection of its own, with which `begin` has begun; raises as `open` does."""
        wire = await self._connect()
        wire.connection.voice = self.voice
        wire.connection.origin = self.origin
        wire.connection.here = self.here
        try:
            hello = await wire.call("hello", {"client": _program()})
            wire.connection.accept(hello)
            self._check(hello, wire.connection.socket_path)
            if begin is not None:
                await begin(wire)
        except GeneratorExit:
            raise
        except BaseException:
            await wire.close()
            raise
        return wire

    def _check(self, hello: Mapping[str, Any], path: str) -> None:
        try:
            channel, can_id = hello["channel"], hello["motor"]["can_id"]
        except (KeyError, TypeError) as error:
            raise ProtocolError(f"what answers at {path} is no litegripd: {hello!r:.80}") from error
        if channel != self.chosen and self._socket_alone is None:
            ways = [f"ask for channel {channel}", "for the socket of the other daemon"]
            if self.socket_path is None and is_socket_given():
                ways.insert(0, f"unset {SOCKET_VARIABLE}, which names that socket")
            if self._by_variable and os.environ.get(CHANNEL_VARIABLE):
                ways.append(f"unset {CHANNEL_VARIABLE}, which names {self.chosen}")
            raise different("channel", self.chosen, channel, path, ", or ".join(ways))
        self.origin.channel = str(channel)
        if self.can_id is not None and can_id != self.can_id:
            raise different("can_id", f"{self.can_id:#04x}", f"{can_id:#04x}", path)
        if self._expected:
            from litegrip_client.core.expected import check_expected  # noqa: PLC0415 - seldom needed

            check_expected(self._expected, hello, path)

    async def close(self) -> None:
        """End the connection; first take care of the motor if this session enabled it.

        That is: disable it, or, without `disable_on_disconnect`, make sure that the daemon
        keeps holding. Raises the error of that; the connection is closed all the same. In a forked
        child only the child's copy is closed.
        """
        wire, self._wire = self._wire, None
        _CONNECTED.pop(id(self), None)
        if wire is None:
            return
        enabled_here, leased = wire.connection.has_enabled and not self.handed_over, self.leased
        self.keeps_lease = False
        self._leases = 0
        try:
            if enabled_here and wire.connection.is_own and self.disable_on_disconnect:
                await self._disable(wire)
            if leased and wire.connection.is_own:
                await _release(wire)
        finally:
            await wire.close()

    async def _disable(self, wire: Wire) -> None:
        channel = self.channel
        is_told = wire.connection.is_danger_told
        cannot = f"{channel}: the motor could not be disabled, cut its power"
        try:
            done = (await wire.call("motor.disable", None, ACTION_TIMEOUT_S)).get("ok")
        except LeaseError as error:  # the motor is another's to disable
            warn(f"{channel}: the end of this block leaves the motor as it is: {error.message}")
            return
        except HardwareError as error:
            error.message = f"{cannot}: {error.message}"
            raise
        except ConnectError as error:
            why = error.message
            if error.reason == "shutting_down":
                last = await self._farewell(wire, error)
                why = last.message
                error.data.update(last.data)
                is_off = error.data.get("motor_off")
                doubt = "" if is_off else "nothing has confirmed that the motor is off: "
                error.message = f"{channel}: {doubt}{why}"
                raise
            if error.reason == "no_answer":
                why = "the daemon does not answer"
                error.is_told = is_told
            elif error.reason == "connection_lost":
                cannot, why = f"{channel}: the motor could not be disabled", f"{why}: {LEFT_ALONE}"
            error.message = f"{cannot}: {why}"
            raise
        if not done:
            raise HardwareError(
                f"{channel}: the motor did not confirm that it is disabled, cut its power",
                reason="not_confirmed",
                data={"retryable": True},
            )

    async def _farewell(self, wire: Wire, error: ConnectError) -> ConnectError:
        """Return the last that a daemon which ends says, after `error`."""
        ends_s = time.monotonic() + _FAREWELL_WITHIN_S
        while "motor_off" not in error.data and time.monotonic() < ends_s:
            await self.pause(_FAREWELL_LOOK_S)
            try:
                await wire.call("state.get")
            except ConnectError as later:
                if later.reason != "shutting_down":
                    break
                error = later
        return error

    # The lease

    async def acquire(
        self,
        purpose: str | None = None,
        ttl_s: float | None = None,
        wait_s: float = 0.0,
        on_lost: str | None = None,
    ) -> dict[str, Any]:
        """Get the lease, or change its options; the purpose is the program by default.

        What is not given stays as it was, as what `enable` has said the jaws do when it is lost.
        Only this, or `take`, gets a lost lease again. Until then the daemon refuses all that moves.
        """
        numbers = given_numbers(ttl_s=ttl_s, wait_s=wait_s or None)
        params = self._kept_options() if on_lost is None else {"on_lost": on_lost}
        params |= numbers
        if purpose is not None or not self.leased:
            params["purpose"] = purpose or _program()
        return await self._get("lease.acquire", params, numbers.get("wait_s", 0.0))

    async def acquire_to_enable(self, on_lost: str) -> None:
        """Get the lease to keep it; an older object of this program hands it over.

        So the cell of a notebook that connects and enables may be run again. What the older one
        enabled is this session's then. It hands over only between motions, and only what it keeps
        since its own `enable`: a block of `lease` is meant. One that nobody can reach any more is
        closed first, which does to the motor what its `disable_on_disconnect` says.
        """
        try:
            await self.acquire(on_lost=on_lost)
        except LeaseError as error:
            owner = error.data.get("owner")
            if not isinstance(owner, dict) or owner.get("pid") != os.getpid():
                raise
            import gc  # noqa: PLC0415 - seldom needed

            gc.collect()
            others = (one for one in _SESSIONS if one is not self and one.leases_of(self.wire))
            older = next(others, None)
            if older is None:  # the daemon notices in a moment that it is gone
                await self.acquire(on_lost=on_lost, wait_s=_GONE_WITHIN_S)
                return
            if older.is_in_block or (await self.ask("state.get")).get("job") is not None:
                raise
            why = "a newer object of the same program enables the motor"
            params = {"why": why, "purpose": _program(), "on_lost": on_lost}
            await self._get("lease.take", params, 0.0)
            older.handed_over = True

    @property
    def is_in_block(self) -> bool:
        """True inside a block of `lease`."""
        return self._leases > 0

    def leases_of(self, wire: Wire) -> bool:
        """Return True if this session has the lease of the daemon at the end of `wire`."""
        if self._wire is None or not self.is_open or not self.leased:
            return False
        connection = self._wire.connection
        return connection.is_own and connection.daemon_pid == wire.connection.daemon_pid

    async def _get(self, method: str, params: dict[str, Any], wait_s: float) -> dict[str, Any]:
        wire = self.wire
        call = wire.connection.prepare(method, params)
        call.keep = True
        try:
            granted = await wire.run(call, wait_s + ACTION_TIMEOUT_S)
        except BaseException:
            wire.connection.abandon(call, self._unwanted)
            raise
        self.handed_over = False
        self._on_lost = params.get("on_lost", self._on_lost)
        return granted

    def _kept_options(self) -> dict[str, Any]:
        """Return what the jaws do at a loss, as it was said: a lease that was lost forgets it."""
        return {} if self._on_lost is None else {"on_lost": self._on_lost}

    def _unwanted(self, granted: dict[str, Any]) -> tuple[str, dict[str, Any]] | None:
        """Return the request that gives back a lease, None if somebody still wants it."""
        return None if self.leased else ("lease.release", {"lease": granted["lease"]})

    def enter_lease(self) -> Wire:
        """Count a user of the acquired lease; return the connection, for `leave_lease`."""
        wire = self.wire
        self._leases += 1
        return wire

    async def leave_lease(self, wire: Wire) -> None:
        """Count a user less; the last one gives the lease back."""
        if wire is self._wire:
            self._leases -= 1
            await self.let_go()

    async def let_go(self) -> None:
        """Give the lease back, unless somebody here wants it; the jaws stay as they are."""
        if not self.leased and self.is_open:
            self._on_lost = None
            await _release(self.wire)

    async def take(self, why: str, jaws: str) -> None:
        """Take the lease from its present owner, and keep it.

        Of a motor that is enabled this session answers for the end then: its owner does no more.
        """
        params = {"why": why, "purpose": _program()} | ({} if jaws == "hold" else {"jaws": jaws})
        params |= self._kept_options()
        await self._get("lease.take", params, 0.0)
        self.keeps_lease = True
        if not self.enabled_here and (await self.ask("state.get"))["enabled"]:
            self.enabled_here = True
            await self.acquire(on_lost="disable" if self.disable_on_disconnect else "hold")


def for_gripper(voice: Voice, here: Here) -> Voice:
    """Return a voice of ours that names the gripper in its commands."""

    def speak(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        name = voice(method, parameter, asked)
        return None if name is None else here(name)

    return speak


class AsyncBlock:
    """What is for `async with`, and says so to who writes `with`."""

    if not TYPE_CHECKING:  # else a type checker would allow it

        def __enter__(self) -> NoReturn:
            raise TypeError(f"this {type(self).__name__} is for asyncio: `async with`")

        __exit__ = __enter__


LEASE_RANGES = {"ttl_s": (0.1, 86_400.0), "wait_s": (0.0, 86_400.0)}
"""What the protocol allows, in seconds."""


@shortened
class Lease(AsyncBlock):
    """The lease of one gripper, for `async with`: taken at the start, returned at the end.

    Without a block, `acquire` and `release` do the same. It is kept while another block, or
    `enable`, of the same gripper object needs it. `token` names it, for another connection of the
    same program (`lease` of the raw methods).
    """

    def __init__(self, session: DaemonSession, options: dict[str, Any]) -> None:
        """Raise `CommandError` for what no lease can have."""
        for name, (least_s, most_s) in LEASE_RANGES.items():
            if options[name] is not None:
                in_range(name, options[name], least_s, most_s, "s")
        purpose, on_lost = options["purpose"], options["on_lost"]
        if not isinstance(purpose, str | None):
            raise wrong("purpose", f"is {purpose!r:.60}, it must be text")
        if on_lost is not None and on_lost not in STOP_LEVELS:
            levels = " or ".join(map(repr, STOP_LEVELS))
            raise wrong("on_lost", f"is {on_lost!r:.60}, it must be {levels}")
        self._token: str | None = None
        self._session = session
        self._options = options
        self._wire: Wire | None = None

    def __repr__(self) -> str:
        purpose = self._options["purpose"]
        named = "" if purpose is None else f" {purpose!r:.60}"
        return f"<Lease{named} of {self._session.channel}{'' if self._token else ', not taken'}>"

    @property
    def token(self) -> str | None:
        """The name of the lease, until it is released."""
        return self._token

    async def acquire(self) -> None:
        """Take the lease, until `release`; one that was lost is taken again.

        Raises `LeaseError`, which names the owner, when it is not free within `wait_s` seconds.
        """
        session = self._session
        granted = await session.acquire(**self._options)
        if self._wire is not session.wire:  # else it is counted already
            self._wire = session.enter_lease()
        self._token = str(granted["lease"])

    async def release(self) -> None:
        """Give the lease back, unless this gripper object needs it for more; again does nothing.

        The jaws stay as they are.
        """
        self._token = None
        wire, self._wire = self._wire, None
        if wire is not None:
            await self._session.leave_lease(wire)

    async def __aenter__(self) -> Lease:
        await self.acquire()
        return self

    async def __aexit__(self, _kind: object, error: BaseException | None, _: object) -> None:
        await leave(self.release, error)

    async def renew(self) -> None:
        """Restart `ttl_s`, as every call does. Raises `LeaseError` when the lease is lost."""
        await self._session.wire.call("lease.renew")


UNDER_WAY = ("running", "queued")
"""States of a job that has not ended."""


def own_jobs(connection: Exchange, listed: Iterable[Mapping[str, Any]]) -> list[int]:
    """Return the numbers of a connection's jobs that have not ended, of those that are listed."""
    return [
        int(job["job"])
        for job in listed
        if job["state"] in UNDER_WAY and _is_own(connection, job["owner"])
    ]


def _is_own(connection: Exchange, owner: Mapping[str, Any]) -> bool:
    """Return True if a job is of this connection, or, where unknown, of this process."""
    if connection.client is not None and "client" in owner:
        return bool(owner["client"] == connection.client)
    return bool(owner["pid"] == os.getpid())


def _kept(voice: Voice) -> Voice:
    """Return a program's own voice as one that never fails: no text is lost by it.

    What it raises, or returns that is no text, is logged once, and the daemon's name stays.
    """
    is_logged = False

    def speak(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        nonlocal is_logged
        try:
            said: object = voice(method, parameter, asked)
        except Exception as error:  # noqa: BLE001 - of whatever kind: it must hide no other one
            wrong = f"has raised {type(error).__name__}: {error}"
        else:
            if said is None or isinstance(said, str):
                return said
            wrong = f"has returned {said!r:.60}, which is no text"
        if not is_logged:
            is_logged = True
            warn(f"voice({method!r}, {parameter!r}, {asked!r}) {wrong}; the protocol's name stays")
        return None

    return speak


@contextlib.contextmanager
def naming_the_danger(here: Here) -> Iterator[None]:
    """Have an error of disabling say that the motor may be enabled, and what to do about that."""
    try:
        yield
    except CommError as error:
        error.message = f"the motor is not known to be off, cut its power: {error.message}"
        error.data.setdefault("hint", here(SEE_DOCTOR))
        raise


async def _release(wire: Wire) -> None:
    """Give the lease back, unless it is lost already, or by a closing of the connection."""
    with contextlib.suppress(LeaseError), or_closed():
        await wire.call("lease.release")


def _program() -> str:
    name = sys.argv[0].rpartition("/")[2][:64] if sys.argv else ""
    return name if name and not name.startswith("-") else "python"  # of python -c, for one


def different(
    what: str, wanted: str, found: str, path: str, hint: str | None = None
) -> CommandError:
    """Return the error for a daemon that drives another gripper than was named."""
    hint = hint or f"ask for {what} {found}, or for the socket of the other daemon"
    text = f"the daemon at {path} has {what} {found}, not {wanted}"
    return CommandError(text, reason="wrong_gripper", data={"hint": hint})
