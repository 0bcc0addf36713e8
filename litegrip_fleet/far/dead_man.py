"""The dead man's switch: the gateway's grippers are stopped while a user is silent who must not be.

It runs on a thread and an event loop of its own, with connections of its own, and needs no network:
it stops the grippers even before a router answers, and while the sessions' loop is held up. In
that loop it would be as silent as whatever holds it up.
"""

import asyncio
import contextlib
import json
import logging
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent import futures

from litegrip_client.values.errors import LiteGripError
from litegrip_client.values.repeats import EACH
from litegrip_fleet.far import daemon
from litegrip_fleet.far.presence import DeadMan, Presence
from litegrip_fleet.wire.keys import Place

_log = logging.getLogger(__name__)

LOOK_EVERY_S = 0.05
RECONNECT_EVERY_S = 0.5


class DeadMansSwitch:
    """Watches over the presence of `users`; `silent` are those who were at the latest look."""

    def __init__(self, channels: Mapping[Place, str], users: Sequence[str], level: str) -> None:
        self.silent: tuple[str, ...] = tuple(users)
        self._presence = Presence(users)
        self._users = frozenset(users)
        self._loop = asyncio.new_event_loop()
        self._stoppers = [
            _Stopper(place, channel, level, self._presence) for place, channel in channels.items()
        ]

    def shown(self, user: str, at_s: float | None, ttl_s: float) -> None:
        """Take a session's sign of life, from any thread."""
        if user in self._users:
            now_s = time.monotonic()
            self._loop.call_soon_threadsafe(self._presence.shown, user, at_s, ttl_s, now_s)

    @contextlib.contextmanager
    def running(self) -> Iterator["futures.Future[None]"]:
        """Run it; the future has the error if it fails, and the grippers are not watched then."""
        _log.warning("the grippers are stopped while one of these is silent: %s", self._named())
        task = self._loop.create_task(self._run())
        future: futures.Future[None] = futures.Future()
        future.set_running_or_notify_cancel()  # whoever waits for it does not end it

        def run() -> None:
            try:
                self._loop.run_until_complete(task)
            except asyncio.CancelledError:
                future.set_result(None)
            except BaseException as error:  # noqa: BLE001 - raised where the future is awaited
                future.set_exception(error)

        thread = threading.Thread(target=run, name="dead man's switch", daemon=True)
        thread.start()
        try:
            yield future
        finally:
            self._loop.call_soon_threadsafe(task.cancel)
            thread.join(daemon.STOP_WITHIN_S)

    async def _run(self) -> None:
        await asyncio.gather(self._look(), *(stopper.run() for stopper in self._stoppers))

    async def _look(self) -> None:
        """Report who is silent, and who is back."""
        while True:
            silent = self._presence.silent(time.monotonic())
            if silent != self.silent:
                self.silent = silent
                text = f"silent: {', '.join(silent)}" if silent else f"present: {self._named()}"
                _log.warning("%s", text)
            await asyncio.sleep(LOOK_EVERY_S)

    def _named(self) -> str:
        return ", ".join(sorted(self._users))


class _Stopper:
    """Stops one gripper; no other waits for its daemon."""

    def __init__(self, place: Place, channel: str, level: str, presence: Presence) -> None:
        self._place = place
        self._channel = channel
        self._level = level
        self._presence = presence
        self._dead_man = DeadMan(presence)
        self._lifted = asyncio.Event()
        self._told = ""

    async def run(self) -> None:
        """Stop whenever it is due, until cancelled."""
        await asyncio.gather(self._stop_when_due(), self._watch())

    async def _stop_when_due(self) -> None:
        while True:
            if self._dead_man.is_due(time.monotonic()):
                await self._stop()
            self._lifted.clear()
            with contextlib.suppress(asyncio.TimeoutError):
                await asyncio.wait_for(self._lifted.wait(), LOOK_EVERY_S)

    async def _stop(self) -> None:
        now_s = time.monotonic()
        why = self._presence.why(now_s)
        self._dead_man.begin(now_s)
        try:
            await daemon.stop(self._channel, self._level, why)
        except LiteGripError as error:
            self._dead_man.done(confirmed=False)
            if self._told != error.message:
                self._told = error.message
                text = "%s is NOT stopped, although %s: %s"
                _log.error(text, self._place, why, error.message, extra=EACH)
            return
        self._dead_man.done(confirmed=True)
        self._told = ""
        _log.warning("%s: stopped (%s): %s", self._place, self._level, why, extra=EACH)

    async def _watch(self) -> None:
        """Notice that a stop is cleared, and that the daemon is another one."""
        while True:
            try:
                _path, reader, writer = await daemon.connected(self._channel)
            except LiteGripError as error:
                _log.debug("%s: %s", self._place, error)
            else:
                try:
                    await self._read(reader, writer)
                finally:
                    writer.close()
            await asyncio.sleep(RECONNECT_EVERY_S)

    async def _read(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        try:
            await daemon.asked_of(reader, writer, "hello", {"client": "dead man's switch"})
            await daemon.asked_of(reader, writer, "events.subscribe", {"kinds": ["stop_cleared"]})
            self._lift()  # whatever has been cleared until now
            while line := await reader.readline():
                message = json.loads(line)
                if message["method"] == "event":
                    self._lift()
        except (LiteGripError, OSError, ValueError, KeyError, TypeError) as error:
            _log.warning("%s: %s: %s", self._place, self._channel, error)

    def _lift(self) -> None:
        self._dead_man.lifted()
        self._lifted.set()
