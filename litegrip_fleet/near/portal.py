"""The portal: remote grippers as sockets of this machine, so that every client works unchanged.

`lab.left` is found where the daemon of a channel of that name would be: it has a socket for
requests and one for stops. Those who may open them act as the portal's user.
"""

import asyncio
import contextlib
import json
import logging
import os
import secrets
import select
import socket
import stat
import time
from collections.abc import Callable, Coroutine, Sequence
from functools import partial
from hashlib import sha256
from pathlib import Path
from typing import Any

import zenoh

from litegrip_client.core.sockets import stop_path
from litegrip_client.line.connection import peer_pid
from litegrip_client.values.version import client_version
from litegrip_fleet.near.near_session import AGAIN_AFTER_S, NearSession
from litegrip_fleet.near.together import TICK_S, Together
from litegrip_fleet.wire.answers import (
    BACKLOG_FULL,
    TOO_MANY_CONNECTIONS,
    UNREACHABLE,
    error_line,
    error_object,
)
from litegrip_fleet.wire.daemon_lines import MAX_LINE_BYTES, TOO_LONG, generation_in, is_sample
from litegrip_fleet.wire.foreign import stop_problem
from litegrip_fleet.wire.keys import BadNameError, Place
from litegrip_fleet.wire.lateness import STOP_WITHIN_S, RemoteClock
from litegrip_fleet.wire.messages import Ask, BadMessageError, Push, Reply, packed, unpacked
from litegrip_fleet.wire.network import Answered, ask
from litegrip_fleet.wire.site import TWO_GATEWAYS
from litegrip_fleet.wire.together import TOGETHER, Sample

_log = logging.getLogger(__name__)

STALLED_S = 0.2
"""When the portal itself did not run for so long, a line may be as old as its last look."""

OPEN_WITHIN_S = 2.0
_ASK_AGAIN_S = 0.4
_CONGESTED_BYTES = 65_536
MOST_UNREAD_BYTES = 4 * 1024 * 1024
_BACKLOG = 100
MOST_CLIENTS = MOST_STOP_CLIENTS = 64
"""At the sockets of each gripper: nobody uses up the portal's descriptors."""

_READ_BYTES = 65_536
_MODE = 0o660
_STAT_BYTES = 1024
_BEGUN = 19
"""Behind the program's name in /proc/PID/stat: when the process began."""

_STOPPED_STATES, _ENDED_STATES = "Tt", "ZX"


class Portal:
    """One remote gripper's sockets here; `run` serves them until it is cancelled."""

    def __init__(
        self,
        session: Callable[[], zenoh.Session | None],
        place: Place,
        path: Path,
        together: Together,
        *,
        user: str,
        role: str,
        ttl_s: float,
        router: Sequence[str] = (),
        insecure: bool = False,
        certificate_expires_s: float | None = None,
    ) -> None:
        self.place = place
        self.way = {
            "portal": client_version(),
            "router": list(router),
            "insecure": insecure,
            "certificate_expires_s": certificate_expires_s,
        }
        self.path = path
        self.user = user
        self.role = role
        self.ttl_s = ttl_s
        self._session = session
        self.together = together
        together.ticks.append(self._tick)
        together.takers[place] = self._sampled
        together.pushed[place] = self._pushed
        self._count = 0
        self._clock = RemoteClock()
        self._clients: dict[str, _Client] = {}
        self._beat_s = time.monotonic()
        self._serving: set[asyncio.Task[None]] = set()
        self._idle: dict[socket.socket, None] = {}  # at the socket for stops; the longest first

    @property
    def stop_path(self) -> str:
        """The socket for stops."""
        return stop_path(str(self.path))

    async def run(self) -> None:
        """Serve until cancelled."""
        listener = _listener(str(self.path))
        requests = await asyncio.start_unix_server(
            lambda reader, writer: self._begin(self._served(reader, writer)),
            sock=listener,
            limit=_READ_BYTES,
        )
        stops = _listener(self.stop_path)
        self._begin(self._accept_stops(stops))
        try:
            await asyncio.Event().wait()
        finally:
            requests.close()
            for task in list(self._serving):
                task.cancel()
            await asyncio.gather(*self._serving, return_exceptions=True)
            stops.close()
            for path in (str(self.path), self.stop_path):
                Path(path).unlink(missing_ok=True)

    def _begin(self, serving: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(serving)
        self._serving.add(task)
        task.add_done_callback(self._serving.discard)

    async def _served(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await self._serve(reader, writer)
        except (ConnectionError, asyncio.CancelledError) as error:
            _log.debug("%s: a client has gone: %s", self.place, error)
        finally:
            writer.close()

    def _tick(self, now_s: float, states: dict[int, str | None]) -> None:
        self._beat_s = now_s
        for client in list(self._clients.values()):
            client.tick(now_s, states)

    def sent_s(self, now_s: float) -> float:
        """Return when what is read now was sent at the earliest, if this process was held up."""
        return now_s if now_s - self._beat_s < STALLED_S else self._beat_s

    # Requests -------------------------------------------------------------------------------------

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        if len(self._clients) >= MOST_CLIENTS:
            text = f"{MOST_CLIENTS} programs use {self.place} here, no more are let in: end one"
            full = error_object(TOO_MANY_CONNECTIONS, text, limit=MOST_CLIENTS)
            writer.write(error_line(None, full))
            await writer.drain()
            return
        self._count += 1
        session = f"{self.together.identity}-{self._count}"
        key = self.place.rpc(self.user, session, self.role)
        client = _Client(self, session, key, writer)
        self._clients[session] = client
        try:
            error = await self._open(client)
            if error is not None:
                writer.write(error_line(None, error))
                await writer.drain()
                return
            await client.read(reader)
            left = await self._left_by(client)
        finally:
            del self._clients[session]
            self.send(client, Ask("close"), b"")
        for line in left:
            await self._stopped(line)

    async def _left_by(self, client: "_Client") -> list[bytes]:
        """Return the stops of a client that has gone which the network has lost, it seems."""
        ends_s = time.monotonic() + AGAIN_AFTER_S
        while client.stops_left() and time.monotonic() < ends_s:
            await asyncio.sleep(TICK_S)
        return client.stops_left()

    async def _open(self, client: "_Client") -> dict[str, Any] | None:
        """Begin a session at the gateway; return why that is not possible, or None."""
        loop, ends_s = asyncio.get_running_loop(), time.monotonic() + OPEN_WITHIN_S
        opening = packed(
            Ask(
                "open",
                ttl_s=self.ttl_s,
                program=client.program,
                process=client.process,
                together=self.together.name,
            )
        )
        while (sent_s := time.monotonic()) < ends_s:
            session = self._session()
            if session is None or session is not self.together.heard_by:
                await asyncio.sleep(TICK_S)
                continue
            within_s = min(ends_s - sent_s, 1.0)
            answers = await ask(session, client.key, b"", opening, loop, within_s=within_s)
            reply = self._reply_in(answers)
            now_s = time.monotonic()
            if reply is None:
                await asyncio.sleep(TICK_S)
                continue
            if reply.gone is not None:
                return reply.gone
            client.begin(reply, sent_s, now_s)
            return None
        return error_object(UNREACHABLE, await self._why())

    async def _why(self) -> str:
        """Return why the gripper does not answer."""
        session = self._session()
        if session is None:
            return f"{self.place} cannot be reached: no router answers"
        if not list(session.info.routers_zid()):
            return f"{self.place} cannot be reached: the connection to the router is lost"
        alive = await asyncio.to_thread(
            lambda: list(session.liveliness().get(self.place.alive, timeout=1.0))
        )
        if alive:
            return (
                f"{self.place} is there and does not answer {self.user}: its gateway or its daemon"
                f" is held up, or the router does not let {self.user} be {self.role}"
            )
        return (
            f"{self.place} cannot be reached: its gateway is not connected, or the router lets"
            f" {self.user} see nothing"
        )

    async def _pushed(self, sample: zenoh.Sample) -> None:
        client = self._clients.get(str(sample.key_expr).rpartition("/")[2])
        attached = sample.attachment
        if client is None or client.near is None:
            return
        try:
            push = unpacked(Push, None if attached is None else attached.to_bytes())
        except BadMessageError as error:
            _log.debug("%s: %s", self.place, error)
            return
        client.near.pushed(push, sample.payload.to_bytes(), time.monotonic())
        client.close_if_ended()

    def _sampled(self, sample: Sample, carrier: Place) -> None:
        """Take a sample that came by a gripper's key: it must be that which the gateway named."""
        client = self._clients.get(sample.session)
        if client is not None and client.near is not None and client.carrier == carrier:
            push = Push(None, generation=sample.generation)
            client.near.pushed(push, sample.line, time.monotonic())

    def send(self, client: "_Client", message: Ask, line: bytes) -> None:
        """Send a message of a client's session, and give the answer to it."""
        carrier, is_life = client.carrier, message.op == "live" and not message.again
        if is_life and carrier is not None and self.together.is_ticking:
            self.together.shows(client, carrier, message)
        else:
            self.send_alone(client, message, line)

    def send_alone(self, client: "_Client", message: Ask, line: bytes) -> None:
        """Send it by the session's own key."""
        session = self._session()
        if session is None:
            return
        sent_s = time.monotonic()
        loop = asyncio.get_running_loop()
        future = ask(session, client.key, line, packed(message), loop, within_s=1.0)
        future.add_done_callback(lambda done: client.replied(self._reply_in(done.result()), sent_s))

    def _reply_in(self, answers: list[Answered]) -> Reply | None:
        """Return the gateway's reply to a query, None without one.

        Two would each carry out what is asked: the session ends.
        """
        if len(answers) > 1:
            gone = error_object(UNREACHABLE, f"{self.place}: {TWO_GATEWAYS}")
            return Reply(0, 0, 0.0, gone=gone)
        for answer in answers:
            with contextlib.suppress(BadMessageError):
                return unpacked(Reply, answer.attached)
        return None

    # Stops ----------------------------------------------------------------------------------------

    async def _accept_stops(self, listener: socket.socket) -> None:
        while True:
            try:
                connected, _address = await asyncio.get_running_loop().sock_accept(listener)
            except OSError as error:  # noqa: PERF203 - gone already, or no descriptors left
                _log.error("%s: a client that stops could not be let in: %s", self.place, error)
                await asyncio.sleep(TICK_S)
            else:
                if len(self._idle) >= MOST_STOP_CLIENTS:  # the new one may have come to stop
                    self._make_room()
                self._begin(self._serve_stops(connected))

    def _make_room(self) -> None:
        """Let the client that has been idle the longest give its last line, and end."""
        longest_idle = next(iter(self._idle))
        del self._idle[longest_idle]
        with contextlib.suppress(OSError):  # it has gone by itself
            longest_idle.shutdown(socket.SHUT_RD)

    async def _serve_stops(self, connected: socket.socket) -> None:
        """Give each stop that a client has sent, also once it is gone; no answer is waited for."""
        with connected:
            lines, is_gone, left = _StopLines(connected), False, set[bytes]()
            while line := await self._next(lines, connected):
                if line in left:  # nobody reads answers: each kind of stop once is enough
                    continue
                answer = await self._stopped(line)
                if is_gone:
                    left.add(line)
                    continue
                try:
                    connected.send(answer)
                except OSError as error:
                    _log.debug("%s: a client takes no answer to its stop: %s", self.place, error)
                    is_gone = not isinstance(error, BlockingIOError)

    async def _next(self, lines: "_StopLines", connected: socket.socket) -> bytes:
        """Return a client's next stop; until it comes, the client may have to give way."""
        self._idle[connected] = None
        try:
            return await lines.next()
        finally:
            self._idle.pop(connected, None)

    async def _stopped(self, line: bytes) -> bytes:
        """Stop; return the daemon's answer, or that the stop is not confirmed."""
        sent = packed(Ask("line", at_s=self._clock.at(time.monotonic())))
        answer = await stop_one(self._session, self.place, self.user, line, sent)
        if answer is not None:
            # A client that reads that it is in force, and then clears it, knows of it.
            for client in self._clients.values():
                if client.near is not None:
                    client.near.note_stops(generation_in(answer))
            return answer
        text = (
            f"the stop of {self.place} is not confirmed within {STOP_WITHIN_S:g} s: it may come"
            " into force later; use the switch that cuts the power"
        )
        return error_line(_identity_in(line), error_object(UNREACHABLE, text))


async def stop_one(
    session_of: Callable[[], zenoh.Session | None],
    place: Place,
    user: str,
    line: bytes,
    sent: bytes,
) -> bytes | None:
    """Stop a gripper, asking again until it answers; None when it has not in time.

    `sent` is a message that says when that was, attached to each query.
    """
    loop = asyncio.get_running_loop()
    ends_s = loop.time() + STOP_WITHIN_S
    while (left_s := ends_s - loop.time()) > 0.0:
        session = session_of()
        if session is not None:
            within_s = min(left_s, _ASK_AGAIN_S * 2)
            key = place.stop(user)
            answers = await ask(session, key, line, sent, loop, within_s=within_s, is_stop=True)
            said = [answer.payload for answer in answers if answer.payload]
            if said:  # of two gateways, both have to confirm it
                return next((payload for payload in said if stop_problem(payload)), said[0])
        await asyncio.sleep(min(0.05, max(0.0, ends_s - loop.time())))
    return None


class _Client:
    """A local client's connection; `near` once its session has begun."""

    def __init__(
        self, portal: Portal, session: str, key: str, writer: asyncio.StreamWriter
    ) -> None:
        self.session = session
        self.key = key
        self.carrier: Place | None = None
        """The gripper by whose keys the gateway sends samples, and is told who lives."""
        self.alone_s = 0.0
        self.near: NearSession | None = None
        self._portal = portal
        self._writer = writer
        self._socket: socket.socket = writer.get_extra_info("socket")
        self._pid = peer_pid(self._socket)
        self.program = _program(self._pid)
        self.process = _process(self._pid)
        self._half_closed = False
        self._gone = asyncio.Event()

    @property
    def place(self) -> Place:
        """Its gripper."""
        return self._portal.place

    def show_alone(self, message: Ask) -> None:
        """Show its life by a message of its own."""
        self.alone_s = time.monotonic()
        self._portal.send_alone(self, message, b"")

    def begin(self, reply: Reply, sent_s: float, now_s: float) -> None:
        """Begin the session that the gateway has opened."""
        portal = self._portal
        self.near = NearSession(
            portal.ttl_s,
            portal._clock,  # noqa: SLF001 - of one gateway
            now_s,
            channel=str(portal.place),
            stop_socket=portal.stop_path,
            ask=partial(portal.send, self),
            to_client=self._to_client,
        )
        about = dict(reply.about or {})
        self.carrier = _carrier_in(about.pop(TOGETHER, None), portal.place)
        self.near.opened({**about, **portal.way})
        self.near.replied(reply, sent_s, now_s)

    def replied(self, reply: Reply | None, sent_s: float) -> None:
        """Take the answer to a message; None if there was none."""
        if reply is not None and self.near is not None:
            self.near.replied(reply, sent_s, time.monotonic())
            self.close_if_ended()

    def stops_left(self) -> list[bytes]:
        """Return the stops that the gateway is not known to have taken."""
        return [] if self.near is None else self.near.stops_left()

    async def read(self, reader: asyncio.StreamReader) -> None:
        """Send what the client says until it, or the session, goes."""
        if (near := self.near) is None:
            return
        reading = asyncio.create_task(self._read(reader, near))
        gone = asyncio.create_task(self._gone.wait())
        try:
            await asyncio.wait((reading, gone), return_when=asyncio.FIRST_COMPLETED)
        finally:
            for task in (reading, gone):
                task.cancel()
            await asyncio.gather(reading, gone, return_exceptions=True)
        with contextlib.suppress(ConnectionError, asyncio.TimeoutError):
            await asyncio.wait_for(self._writer.drain(), 1.0)

    async def _read(self, reader: asyncio.StreamReader, near: NearSession) -> None:
        """Send each line at once, however many: what waits here would look newer than it is."""
        rest = b""
        while received := await reader.read(_READ_BYTES):
            now_s = time.monotonic()
            *lines, rest = (rest + received).split(b"\n")
            for line in lines:
                self._take(near, line, now_s)
            if len(rest) > MAX_LINE_BYTES:
                self._refuse_length()
                return
        if rest.strip():
            self._take(near, rest, time.monotonic())
        if self._has_hung_up():
            return
        self._half_closed = True
        near.half_closed(time.monotonic())
        await self._gone.wait()

    def _take(self, near: NearSession, line: bytes, now_s: float) -> None:
        if len(line) > MAX_LINE_BYTES:
            self._refuse_length()
        elif line.strip() and not self._gone.is_set():
            near.asked(line + b"\n", self._portal.sent_s(now_s), now_s)

    def _refuse_length(self) -> None:
        self._writer.write(error_line(None, TOO_LONG))
        self._gone.set()

    def tick(self, now_s: float, states: dict[int, str | None]) -> None:
        """Do what is due; what is found out of a process's state is for others, too."""
        if self.near is None:
            return
        if self._half_closed and self._has_hung_up():
            self._gone.set()
            return
        if self._pid not in states:
            states[self._pid] = _state_of(self._pid)
        state = states[self._pid]
        if state is None:  # a child of it may still have the connection: it was not let in
            self._gone.set()
            return
        self.near.tick(now_s, lives=state not in _STOPPED_STATES)
        self.close_if_ended()

    def close_if_ended(self) -> None:
        """Close the connection once the session has ended."""
        if self.near is not None and self.near.ended:
            self._gone.set()

    def _to_client(self, line: bytes) -> None:
        """Write a line to the client; samples are dropped while it does not read."""
        if self._gone.is_set():
            return
        unread_bytes = self._writer.transport.get_write_buffer_size()
        if unread_bytes > _CONGESTED_BYTES and is_sample(line):
            return
        self._writer.write(line)
        if unread_bytes > MOST_UNREAD_BYTES:
            text = f"more than {MOST_UNREAD_BYTES} bytes wait to be read by this client"
            error = error_object(BACKLOG_FULL, text, limit=MOST_UNREAD_BYTES)
            self._writer.write(error_line(None, error))
            self._gone.set()

    def _has_hung_up(self) -> bool:
        """Return True if the client has closed both directions, and not only its own."""
        poll = select.poll()
        poll.register(self._socket.fileno(), 0)
        return any(mask & (select.POLLHUP | select.POLLERR) for _fd, mask in poll.poll(0))


class _StopLines:
    """What a client sends to the socket for stops, line by line.

    Not by asyncio's streams: they give nothing more of a client that is gone.
    """

    def __init__(self, connected: socket.socket) -> None:
        self._socket = connected
        self._received = b""
        self._is_over = False

    async def next(self) -> bytes:
        """Return a line, whole or not, or as much of one as may be sent on; empty at the end."""
        while not self._is_over and len(self._received) < MAX_LINE_BYTES:
            if b"\n" in self._received:
                break
            try:
                received = await asyncio.get_running_loop().sock_recv(self._socket, _READ_BYTES)
            except OSError:  # reset: gone, and all that it has sent is here
                received = b""
            self._is_over = not received
            self._received += received
        end = self._received.find(b"\n", 0, MAX_LINE_BYTES) + 1 or MAX_LINE_BYTES
        line, self._received = self._received[:end], self._received[end:]
        return line


def _listener(path: str) -> socket.socket:
    """Return a socket at a path that no living process has; raises `OSError`."""
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        _make_way(path)
        listener.bind(path)
        Path(path).chmod(_MODE)
        listener.listen(_BACKLOG)
    except OSError as error:
        listener.close()
        raise OSError(f"the socket {path} cannot be made: {error.strerror or error}") from error
    listener.setblocking(False)
    return listener


def _identity_in(line: bytes) -> object:
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        return None
    return request.get("id") if isinstance(request, dict) else None


def _make_way(path: str) -> None:
    """Remove a socket that nobody listens at any more; raises `OSError` where somebody does."""
    file = Path(path)
    if not file.exists() or not stat.S_ISSOCK(file.stat().st_mode):
        return
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        try:
            probe.connect(path)
        except ConnectionRefusedError:
            file.unlink(missing_ok=True)
            return
    raise OSError("it belongs to another process")


def _program(pid: int) -> str | None:
    """Return the name of a process as the daemon would show it; None if that cannot be read."""
    try:
        name = Path(f"/proc/{pid}/comm").read_text("utf-8", "replace").strip()
    except OSError:
        return None
    return name[:64] if name.isprintable() and name else None


def _process(pid: int) -> str:
    """Return a word for a process that is the same for each of its connections, and no other's."""
    try:
        begun = Path(f"/proc/{pid}/stat").read_text("utf-8", "replace").rpartition(")")[2].split()
        text = f"{socket.gethostname()} {_machine()} {pid} {begun[_BEGUN]}"
        return sha256(text.encode()).hexdigest()[:16]
    except OSError:  # of another namespace, or gone: it is known by its connection alone
        return secrets.token_hex(8)


def _machine() -> str:
    """Return the machine's own number; empty where it has none."""
    try:
        return Path("/etc/machine-id").read_text("ascii")
    except OSError:
        return ""


def _carrier_in(name: object, place: Place) -> Place | None:
    """Return the gripper that a gateway names as the carrier; None for an older one's silence."""
    try:
        carrier = Place.of(name)
    except BadNameError:
        return None
    return carrier if carrier.site == place.site else None


def _state_of(pid: int) -> str | None:
    """Return a process's state, as /proc has it (T: stopped, by SIGSTOP); None once it has ended.

    One of another namespace, which has no number here (0), is said to run; of one that cannot be
    looked at, nothing shows that it does.
    """
    if pid == 0:
        return "R"
    try:
        # Without a file object: this is done often, and takes 8 in place of 20 µs.
        stat_file = os.open(f"/proc/{pid}/stat", os.O_RDONLY)
    except (FileNotFoundError, ProcessLookupError):
        return None
    except OSError as error:  # no descriptors left
        _log.debug("whether process %d lives cannot be seen: %s", pid, error)
        return "T"
    try:
        content = os.read(stat_file, _STAT_BYTES)
    except ProcessLookupError:
        return None
    finally:
        os.close(stat_file)
    state = content.rpartition(b")")[2].split(maxsplit=1)[0].decode("ascii", "replace")
    return None if state in _ENDED_STATES else state
