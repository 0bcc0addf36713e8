"""The gateway: an ordinary client of this machine's daemons, for users of other machines.

Each remote session has a connection to the daemon of its own, so that arbitration, roles, limits
and `on_lost` stay where they are. A session that does not show life loses it.
"""

import asyncio
import json
import logging
import secrets
import threading
import time
from collections.abc import Callable
from typing import Any

import zenoh

from litegrip_client.core.sockets import STOP_LEVELS, stop_path
from litegrip_client.core.stop import WHY_CHARACTERS
from litegrip_client.values.errors import LiteGripError, from_error_object
from litegrip_client.values.repeats import EACH, REPEATS
from litegrip_client.values.version import client_version
from litegrip_fleet.far.daemon import (
    STOP_WITHIN_S,
    Lines,
    asked_of,
    connected,
    followed,
    how_it_is,
    told_to_stop,
    unreachable,
)
from litegrip_fleet.far.dead_man import DeadMansSwitch
from litegrip_fleet.far.far_session import FarSession
from litegrip_fleet.far.room import MOST_SESSIONS, why_full
from litegrip_fleet.far.together import Publication, Together
from litegrip_fleet.far.turns import Turns
from litegrip_fleet.wire.answers import (
    TOO_LATE,
    TOO_MANY_CONNECTIONS,
    UNREACHABLE,
    error_line,
    error_object,
)
from litegrip_fleet.wire.daemon_lines import generation_in, is_clearing, is_id, is_single_sample
from litegrip_fleet.wire.keys import Caller, Place, caller_in, is_name, stopper_in
from litegrip_fleet.wire.lateness import is_over
from litegrip_fleet.wire.membership import Membership
from litegrip_fleet.wire.messages import Ask, BadMessageError, Push, Reply, packed, unpacked
from litegrip_fleet.wire.network import MOST_WAITING, Ring, all_in_order
from litegrip_fleet.wire.site import LOOK_WITHIN_S, TWO_GATEWAYS
from litegrip_fleet.wire.together import TOGETHER, Life, Sample

_log = logging.getLogger(__name__)

RECONNECT_EVERY_S = 0.5
MOST_UNREAD_BYTES = 1024 * 1024
"""What a session has sent and its daemon has not read; beyond it, the session is ended."""

MOST_ASKED_ABOUT = 64
"""How many may wait for what a gripper says about itself."""

_ID_CHARACTERS = 64
"""Of a stop; one whose id is longer, or cannot be printed, is answered without it."""

_OVER = error_object(
    TOO_LATE,
    "this stop was reported as not confirmed, and a stop was cleared since: it was not carried out",
)

_ALIVE_ID = secrets.token_hex(16).encode()
"""No client can have it: what it is answered is not passed on."""

_ALIVE = b'{"jsonrpc":"2.0","id":"%b","method":"state.get"}\n' % _ALIVE_ID
_ALIVE_ANSWER = b'{"jsonrpc":"2.0","id":"%b",' % _ALIVE_ID


class Gateway:
    """One gripper of this machine on the network; `run` serves it until it is cancelled."""

    def __init__(
        self,
        network: Membership,
        place: Place,
        channel: str,
        together: Together,
        switch: DeadMansSwitch | None = None,
    ) -> None:
        self.place = place
        self._together = together
        together.takers[place.gripper] = self._lives
        together.looks.append(self._look)
        self._switch = switch
        self._network = network
        self._channel = channel
        self._version = client_version()
        self._connections: dict[str, _Connection] = {}
        self._hello: dict[str, Any] = {}
        self._voided: frozenset[str] = frozenset()
        self._generation: int | None = None
        self._path: str | None = None
        self._cleared_s: float | None = None
        self._offered_by: zenoh.Session | None = None
        self._offered: list[zenoh.Queryable[Any]] = []
        self._is_reached = False
        self._token: zenoh.LivelinessToken | None = None
        self._asking: asyncio.Task[None] | None = None
        self._asked_by: list[zenoh.Query] = []
        self._about_room = threading.Semaphore(MOST_ASKED_ABOUT)
        self._turns: Turns[tuple[zenoh.Query, Caller]] = Turns()

    async def run(self) -> None:
        """Serve until cancelled: stops always, sessions while the daemon answers."""
        try:
            self._offer_anew()
            await self._know_the_daemon()
        finally:
            for connection in list(self._connections.values()):
                connection.close()
            for one in self._offered:
                one.undeclare()

    def _offer_anew(self) -> None:
        """Be asked by the session of the time, where it is another one."""
        session = self._network.session
        if session is not None and session is not self._offered_by:
            self._offer(session)

    def _offer(self, session: zenoh.Session) -> None:
        """Be asked by this session; what was offered by another ends with that."""
        loop = asyncio.get_running_loop()
        self._offered_by = session
        key = self.place.key
        rpc = session.declare_queryable(f"{key}/rpc/**", all_in_order(loop, self._queue))
        take_about = all_in_order(loop, self._asked_about)
        hellos = session.declare_queryable(
            self.place.about, lambda query: self._let_in_about(query, take_about)
        )
        # A flood of them does not hold up other grippers' stops: one that gives way is asked again.
        coming: Ring[zenoh.Query] = Ring(
            self._together.stop_loop, lambda query: self._stop(query, loop), MOST_WAITING
        )
        stops = session.declare_queryable(f"{key}/stop/*", coming.put)
        self._offered = [rpc, hellos, stops]
        if self._is_reached:
            self._show_alive()

    def _show_alive(self) -> None:
        """Say that the daemon can be reached."""
        if (session := self._offered_by) is not None:
            self._token = session.liveliness().declare_token(self.place.alive)

    def _warn_of_another(self) -> None:
        if (session := self._network.session) is None:
            return
        replies = session.liveliness().get(self.place.alive, timeout=LOOK_WITHIN_S)
        if any(reply.ok is not None for reply in replies):
            _log.error("%s: %s", self.place, TWO_GATEWAYS)

    # The daemon -----------------------------------------------------------------------------------

    async def _know_the_daemon(self) -> None:
        await asyncio.to_thread(self._warn_of_another)
        while True:
            await self._watch()
            await asyncio.sleep(RECONNECT_EVERY_S)

    async def _watch(self) -> None:
        """Be connected to the daemon, and known to be alive, until it goes."""
        try:
            reader, writer = await self._connected()
        except LiteGripError as error:
            if self._hello.get("error") != error.message:
                _log.warning("%s: %s", self.place, error.message)
            self._hello = {"error": error.message}
            return
        try:
            hello = await asked_of(reader, writer, "hello", {"client": "gateway"})
            self._generation = hello["stop_generation"]
            self._voided = await _voided(reader, writer)
            self._hello = hello  # from now on there are sessions, and each knows what is voided
            await asked_of(reader, writer, "events.subscribe", {"kinds": ["stop", "stop_cleared"]})
            self._is_reached = True
            self._show_alive()
            _log.info("%s: %s can be reached", self.place, self._channel, extra={REPEATS: True})
            while line := await reader.readline():
                self._note(line)
                if is_clearing(line):
                    self._cleared_s = time.monotonic()
                if not line.startswith(_ALIVE_ANSWER):  # a stop: how many there were by now
                    writer.write(_ALIVE)
        except (LiteGripError, OSError, ValueError, KeyError) as error:
            _log.warning("%s: %s: %s", self.place, self._channel, error)
        finally:
            writer.close()
            if self._is_reached:
                self._is_reached = False
                if self._token is not None:
                    self._token.undeclare()
                _log.warning("%s: %s has gone", self.place, self._channel)
            self._hello = {"error": f"the daemon of {self._channel} has gone"}

    async def _connected(self) -> tuple[asyncio.StreamReader, asyncio.StreamWriter]:
        """Connect to the daemon; raises `ConnectError` where none answers."""
        self._path, reader, writer = await connected(self._channel)
        return reader, writer

    def _note(self, line: bytes) -> None:
        """Learn how many stops there were from a line of the daemon's."""
        generation = generation_in(line)
        if generation is not None:
            self._generation = max(generation, self._generation or 0)

    def _let_in_about(self, query: zenoh.Query, take: Callable[[zenoh.Query], None]) -> None:
        """Hand a query over to the loop, as long as few wait there; on the queries' own thread."""
        if self._about_room.acquire(blocking=False):
            take(query)
        else:
            query.drop()

    def _asked_about(self, query: zenoh.Query) -> None:
        """Have a query answered; who asks while the daemon is asked gets the same answer."""
        self._asked_by.append(query)
        if self._asking is None:
            self._asking = asyncio.get_running_loop().create_task(self._say_how_it_is())
            self._asking.add_done_callback(_log_failure)

    async def _say_how_it_is(self) -> None:
        try:
            about = await self._how_it_is()
        finally:
            self._asking = None
            queries, self._asked_by = self._asked_by, []
            self._about_room.release(len(queries))  # one at least: who had it asked
        answer = json.dumps(about).encode()
        for query in queries:
            with query:
                query.reply(self.place.about, answer)

    async def _how_it_is(self) -> dict[str, Any]:
        """Return the daemon's version, verdict, mode and owner; or why it does not answer."""
        about: dict[str, Any] = {"gateway": self._version, "kept_out": self._network.kept_out}
        if self._switch is not None:
            about["silent"] = self._switch.silent
        try:
            reader, writer = await self._connected()
            try:
                hello = await asked_of(reader, writer, "hello", {"client": "gateway"})
                health = await asked_of(reader, writer, "health")
                state = await asked_of(reader, writer, "state.get")
                lease = await asked_of(reader, writer, "lease.get")
            finally:
                writer.close()
            about |= how_it_is(hello, health, state, lease)
        except (LiteGripError, OSError, ValueError, KeyError) as error:
            about["error"] = str(error)
        return about

    # Sessions -------------------------------------------------------------------------------------

    def _queue(self, query: zenoh.Query) -> None:
        """Have a query of a portal's taken in its turn: a flood waits for everybody else."""
        caller, was_idle = caller_in(str(query.key_expr)), not self._turns
        if caller is None or not self._turns.add(caller.user, caller.session, (query, caller)):
            query.drop()
        elif was_idle:
            asyncio.get_running_loop().call_soon(self._take_turn)

    def _take_turn(self) -> None:
        query, caller = self._turns.take()
        if self._turns:
            asyncio.get_running_loop().call_soon(self._take_turn)
        self._asked(query, caller)

    def _asked(self, query: zenoh.Query, caller: Caller) -> None:
        """Take a query of a portal's; never raises, whatever it holds."""
        key, attached = str(query.key_expr), query.attachment
        try:
            ask = unpacked(Ask, None if attached is None else attached.to_bytes())
        except BadMessageError as error:
            _log.debug("%s: %s", key, error)
            query.drop()
            return
        if ask.op == "lives":
            self._together.take(query, caller)
            return
        connection = self._connections.get(key)
        if connection is not None and not connection.ready:
            query.drop()  # it is being opened: the portal asks again
        elif connection is None and ask.op == "open" and not self._hello:
            query.drop()  # the daemon has not been asked yet: the portal asks again
        elif connection is None and ask.op == "open":
            connection = _Connection(self._network, self.place, caller, self._forget(key))
            self._connections[key] = connection
            task = asyncio.get_running_loop().create_task(self._open(query, connection, ask))
            task.add_done_callback(_log_failure)
            connection.task = task
        elif connection is None:
            _answer(query, self._over())
        else:
            self._serve(query, connection, ask)

    def _over(self) -> Reply:
        text = f"{self.place}: the session has ended: its time to live was up"
        return Reply(0, 0, time.monotonic(), gone=error_object(UNREACHABLE, text))

    def _lives(self, caller: Caller, life: Life) -> Reply | None:
        """Take the sign of life of a session of the caller's; return the reply, if it has begun."""
        key = self.place.rpc(caller.user, life.session, caller.role)
        connection = self._connections.get(key)
        if connection is None:
            return self._over()
        if not connection.ready:
            return None
        self._take(connection, Ask("live", got=life.got, at_s=life.at_s), b"")
        return connection.far.reply(time.monotonic())

    def _forget(self, key: str) -> Any:
        return lambda: self._connections.pop(key, None)

    async def _open(self, query: zenoh.Query, connection: "_Connection", ask: Ask) -> None:
        try:
            about = await self._begin(connection, ask)
        except (LiteGripError, OSError, ValueError, KeyError) as error:
            connection.close()
            gone = _gone(self.place, error)
            _answer(query, Reply(0, 0, time.monotonic(), gone=gone))
            return
        except Exception:
            connection.close()
            raise
        connection.about = about
        _answer(query, connection.far.reply(time.monotonic(), about))
        # What was said last may have to be said again: the portal ends it, or its time is up.
        await connection.pass_on(self._note_for(connection.far))

    async def _begin(self, connection: "_Connection", ask: Ask) -> dict[str, Any]:
        """Open a session's connection to the daemon, in its user's name; return what it is."""
        caller = connection.caller
        self._check_room(caller)
        if "error" in self._hello:
            raise unreachable(str(self._hello["error"]))
        user = f"{caller.user}@{self.place.site}"
        self._path, lines = await followed(self._channel)
        connection.attach(lines)
        params = {"on_behalf": user, "role": caller.role}
        if ask.program is not None:
            params["client"] = ask.program
        hello = await asked_of(lines, lines, "hello", params)
        connection.far = FarSession(
            ask,
            time.monotonic(),
            session=caller.session,
            voided=self._voided,
            to_daemon=connection.to_daemon,
            push=connection.push,
        )
        connection.far.generation = hello["stop_generation"]
        connection.ready = True
        if is_name(ask.together):
            connection.publish(self._together.publication, self._together.key(caller, ask.together))
        return {
            "site": self.place.site,
            "gripper": self.place.gripper,
            "user": user,
            "role": hello["role"],
            "gateway": self._version,
            TOGETHER: str(self._together.carrier),
        }

    def _check_room(self, new: Caller) -> None:
        """Raise `LiteGripError` if there is no room for a session, which is among them already."""
        why = why_full([one.caller for one in self._connections.values()], new)
        if why is not None:
            full = error_object(TOO_MANY_CONNECTIONS, why, limit=MOST_SESSIONS)
            raise from_error_object(full)

    def _note_for(self, far: FarSession) -> Any:
        """Return what learns of stops by a session's lines, for that session alone.

        What a slow portal has left unread may be of a daemon that has ended: the next one counts
        from zero.
        """

        def note(line: bytes) -> None:
            far.generation = max(self._generation or 0, generation_in(line) or 0)

        return note

    def _serve(self, query: zenoh.Query, connection: "_Connection", ask: Ask) -> None:
        payload = query.payload
        line = b"" if payload is None else payload.to_bytes()
        self._take(connection, ask, line)
        # A portal that asks for a session once more has not got the answer.
        about = connection.about if ask.op == "open" else None
        _answer(query, connection.far.reply(time.monotonic(), about))
        if ask.op == "close":
            connection.close()

    def _take(self, connection: "_Connection", ask: Ask, line: bytes) -> None:
        far = connection.far
        far.generation = self._generation
        far.asked(ask, line, time.monotonic())
        if self._switch is not None:
            self._switch.shown(connection.caller.user, ask.at_s, far.ttl_s)
        if ask.op == "live" and far.may_lease and far.renews:
            connection.show_life()
        connection.wake()

    def _look(self, now_s: float) -> None:
        """Look after the offer and all sessions.

        A portal whose life is late is sent no samples; when it is over, its session ends.
        """
        self._offer_anew()
        for connection in list(self._connections.values()):
            if not connection.ready:
                continue
            connection.far.sheds = connection.far.is_late(now_s)
            if connection.far.is_lost(now_s):
                caller = connection.caller
                _log.warning("%s: %s shows no life any more", self.place, caller.user)
                connection.close()

    # Stops ----------------------------------------------------------------------------------------

    async def _stop(self, query: zenoh.Query, loop: asyncio.AbstractEventLoop) -> None:
        """Stop for a user, and answer with what the daemon says; on the stops' own thread."""
        with query:
            user, payload = stopper_in(str(query.key_expr)), query.payload
            if user is None:
                return
            line = b"" if payload is None else payload.to_bytes()
            if is_over(_sent_s(query), time.monotonic(), self._cleared_s):
                _log.warning("%s: a stop by %s came after it was cleared", self.place, user)
                query.reply(self.place.stop(user), error_line(None, _OVER))
                return
            answer = await self._stopped(in_the_name_of(f"{user}@{self.place.site}", line))
            loop.call_soon_threadsafe(self._note, answer)
            became = "stopped" if b'"result":' in answer else "NOT stopped for sure, though asked"
            _log.warning("%s: %s by %s", self.place, became, user, extra=EACH)
            # By our own key: a stop of a whole site was asked by one with a wildcard.
            query.reply(self.place.stop(user), answer)

    async def _stopped(self, line: bytes) -> bytes:
        if self._path is None:
            return error_line(None, error_object(UNREACHABLE, f"no daemon for {self._channel}"))
        try:
            return await asyncio.wait_for(told_to_stop(stop_path(self._path), line), STOP_WITHIN_S)
        except (OSError, asyncio.TimeoutError) as error:
            why = str(error) or f"no answer within {STOP_WITHIN_S:g} s"
            text = f"the stop is not confirmed by the daemon of {self._channel}: {why}"
            return error_line(None, error_object(UNREACHABLE, text))


class _Connection:
    """A remote session's connection to the daemon; once it is `ready`, `far` is there."""

    far: FarSession

    def __init__(self, network: Membership, place: Place, caller: Caller, on_closed: Any) -> None:
        self.caller = caller
        self.ready = False
        self.about: dict[str, Any] | None = None
        self.task: asyncio.Task[None] | None = None
        self._on_closed = on_closed
        self._lines: Lines | None = None
        self._is_held_up = False
        self._awaits_life = False
        self._half_closed = False
        self._network = network
        self._gripper = place.gripper
        self._key = zenoh.KeyExpr(place.to(caller.user, caller.session))
        self._publication: Publication | None = None
        self._published_at = ""

    def attach(self, lines: Lines) -> None:
        """Store the connection to the daemon."""
        self._lines = lines

    def publish(self, publication: Publication, key: str) -> None:
        """Have samples sent to a key, with those of other sessions of the same portal."""
        self._publication, self._published_at = publication, key
        publication.sessions += 1

    def to_daemon(self, line: bytes | None) -> None:
        """Write a line; None is the end of them, and what comes behind it is dropped."""
        if self._lines is None or self._half_closed:
            return
        transport = self._lines.transport
        if line is None:
            self._half_closed = True
            transport.write_eof()
        else:
            transport.write(line)
            if transport.get_write_buffer_size() > MOST_UNREAD_BYTES:
                _log.warning("%s: the daemon does not read what it is sent", self.caller.user)
                self.close()

    def push(self, push: Push, piece: bytes) -> None:
        """Send a message to the portal; one that is lost is asked for again.

        A declared publisher would not send before it had heard of the subscriber: the first
        messages of a session would be lost.
        """
        if push.number is None and self._publication is not None and is_single_sample(piece):
            sample = Sample(self._gripper, self.caller.session, push.generation, piece)
            self._publication.add(self._published_at, sample)
            return
        if (session := self._network.session) is None:
            return
        session.put(
            self._key,
            piece,
            attachment=packed(push),
            congestion_control=zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )

    def show_life(self) -> None:
        """Renew the lease, once the daemon has answered the last time."""
        if not self._awaits_life:
            self._awaits_life = True
            self.to_daemon(_ALIVE)

    def wake(self) -> None:
        """Read on, if the portal is no longer behind."""
        if self._is_held_up and self._lines is not None and self.far.has_room:
            self._is_held_up = False
            self._lines.transport.resume_reading()

    async def pass_on(self, note: Any) -> None:
        """Pass the daemon's lines on until it closes the connection."""

        def take(line: bytes) -> None:
            note(line)
            if line.startswith(_ALIVE_ANSWER):
                self._awaits_life = False
                return
            self.far.said(line)
            if not self._is_held_up and self._lines is not None and not self.far.has_room:
                self._is_held_up = True
                self._lines.transport.pause_reading()

        try:
            if self._lines is not None:
                await self._lines.follow(take)
        except (OSError, ValueError) as error:  # reset, or a line beyond all bounds
            _log.warning("the connection of %s has broken: %s", self.caller.user, error)
        self.far.ended()

    def close(self) -> None:
        """Close the connection: the daemon then does what the session's end means."""
        self.ready = False
        self._on_closed()
        if self._publication is not None:
            self._publication.sessions -= 1
            self._publication = None
        if self._lines is not None:
            self._lines.transport.close()
            self._lines = None
        if self.task is not None and self.task is not asyncio.current_task():
            self.task.cancel()


def _sent_s(query: zenoh.Query) -> float | None:
    """Return when a stop was sent, by this machine's clock; None where that is not known."""
    if (attached := query.attachment) is None:
        return None
    try:
        return unpacked(Ask, attached.to_bytes()).at_s
    except BadMessageError as error:
        _log.debug("a stop is of unknown age: %s", error)
        return None


def _log_failure(task: "asyncio.Task[None]") -> None:
    if not task.cancelled() and (error := task.exception()) is not None:
        _log.error("the gateway has a defect", exc_info=error)


def _gone(place: Place, error: Exception) -> dict[str, Any]:
    """Return why a session could not begin, as an error of JSON-RPC; it is read elsewhere."""
    where = f"on the machine of {place}"
    if not isinstance(error, LiteGripError):
        return error_object(UNREACHABLE, f"{where}: the daemon does not answer as one: {error!r}")
    return {
        "code": error.code or UNREACHABLE,
        "message": f"{where}: {error.message}",
        "data": {"reason": error.reason or "unreachable", **error.data},
    }


def _answer(query: zenoh.Query, reply: Reply) -> None:
    with query:
        query.reply(query.key_expr, b"", attachment=packed(reply))


async def _voided(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> frozenset[str]:
    """Return the methods that a stop makes void; the whole description is not kept."""
    document = await asked_of(reader, writer, "rpc.discover")
    return frozenset(row["name"] for row in document["methods"] if row.get("x-stop-voids"))


def in_the_name_of(user: str, line: bytes) -> bytes:
    """Return the stop that a line asks for, in any form, as one that says for whom.

    It is written new: a daemon reads 1024 bytes of a stop, and takes one that is longer for a hold
    by the gateway's own user; and only the gateway says for whom.
    """
    text = line.decode(errors="replace").strip()
    identity, level, why = _asked_stop(text)
    params = {"level": level, "on_behalf": user}
    if isinstance(why, str) and why.strip().isprintable():  # anything else is escaped, and long
        params["why"] = why.strip()[:WHY_CHARACTERS]
    request: dict[str, Any] = {"jsonrpc": "2.0", "method": "stop", "params": params}
    if is_id(identity) and len(str(identity)) <= _ID_CHARACTERS and str(identity).isprintable():
        request["id"] = identity
    return json.dumps(request, ensure_ascii=False).encode(errors="replace") + b"\n"


def _asked_stop(text: str) -> tuple[object, str, object]:
    """Return id, level and reason, as lenient as the daemon: what else it says is a hold."""
    if text.lower() in STOP_LEVELS:
        return None, text.lower(), None
    try:
        value = json.loads(text)
    except (ValueError, RecursionError):
        value = None
    identity = value.get("id") if isinstance(value, dict) else None
    for one in value if isinstance(value, list) else [value]:
        if isinstance(one, dict) and one.get("method") == "stop":
            params = one.get("params")
            named = params if isinstance(params, dict) else {}
            levels = params if isinstance(params, list) else [named.get("level")]
            level = next((level for level in levels if level in STOP_LEVELS), "hold")
            return identity, level, named.get("why")
    return identity, "hold", text
