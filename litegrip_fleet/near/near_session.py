"""A session as its portal has it: a local client's lines out, the gripper's lines in.

It knows no clock. A line is sent at once, and again until the gateway says that it took it; what
has come late there was refused there.
"""

import json
from collections.abc import Callable
from dataclasses import replace
from typing import Any

from litegrip_client.values import strict_json
from litegrip_fleet.wire.answers import UNREACHABLE, error_line, error_object
from litegrip_fleet.wire.daemon_lines import MAX_ANSWER_BYTES, is_id
from litegrip_fleet.wire.lateness import RemoteClock
from litegrip_fleet.wire.messages import Ask, Push, Reply
from litegrip_fleet.wire.rows import Inbox, Outbox

LIVE_SHARE = 4
"""So many signs of life in a time to live."""

UNANSWERED_S = 0.1
"""A sign of life is due sooner, too, while the last one is not answered."""

AGAIN_AFTER_S = 0.3
"""A line that the gateway has not taken by then is sent again."""

BEHIND_S = 0.1
"""What the gateway has sent and has not arrived by then is asked for again."""

INTRODUCTIONS = ("hello", "info.get", "health")
"""Their answers say where the gripper is, and where it is stopped: that is at the portal.

That of `health` says how the way to it is protected."""

PROTECTION = ("insecure", "certificate_expires_s")
"""The members of `remote` that `health` has."""

CONFIRM_BYTES = 65_536
"""So much of what came is confirmed at once, not with the next sign of life."""


class NearSession:
    """One local client's session, in virtual or real time.

    `channel` and `stop_socket` are how the gripper is called here. `ask` sends a message and its
    payload to the gateway, `to_client` takes a line for the client. `ended` becomes true when
    nothing more comes; the last line to the client then says why.
    """

    def __init__(
        self,
        ttl_s: float,
        clock: RemoteClock,
        now_s: float,
        *,
        channel: str,
        stop_socket: str,
        ask: Callable[[Ask, bytes], None],
        to_client: Callable[[bytes], None],
    ) -> None:
        self.ended = False
        self.generation: int | None = None
        self._lives = True
        self._ttl_s = ttl_s
        self._clock = clock
        self._heard_s = now_s
        self._asked_s = now_s
        self._again_s = now_s
        self._channel = channel
        self._stop_socket = stop_socket
        self._ask = ask
        self._to_client = to_client
        self._about: dict[str, Any] = {}
        self._inbox = Inbox()
        self._outbox: Outbox[tuple[Ask, bytes, float]] = Outbox()
        self._unconfirmed_bytes = 0
        self._line = bytearray()
        self._behind_since_s: float | None = None
        self._introductions: dict[str | int, list[str]] = {}
        """By the id, in the order in which they were asked for: one may have been used twice."""

    def opened(self, about: dict[str, Any] | None) -> None:
        """Store by which way the gripper is reached, as `hello` describes it."""
        self._about = about or {}

    def asked(self, line: bytes, sent_s: float, now_s: float) -> None:
        """Send a line of the client's, which sent it at `sent_s` at the earliest."""
        self._note_introduction(line)
        at_s = self._clock.at(sent_s)
        self._send_once(
            Ask("line", self._outbox.last + 1, at_s=at_s, generation=self.generation), line, now_s
        )

    def stops_left(self) -> list[bytes]:
        """Return the stops of the client's that the gateway is not known to have taken."""
        return [line for _number, (_ask, line, _s) in self._outbox.unconfirmed() if _is_stop(line)]

    def half_closed(self, now_s: float) -> None:
        """Send that the client sends nothing more, and waits for answers."""
        self._send_once(Ask("eof", self._outbox.last + 1), b"", now_s)

    def _send_once(self, ask: Ask, line: bytes, now_s: float) -> None:
        self._outbox.add((ask, line, now_s), len(line))
        self._send(ask, line, now_s)

    def tick(self, now_s: float, *, lives: bool) -> None:
        """Show life, ask again, or give up; `lives`: the client's process can still act."""
        if self.ended:
            return
        self._lives = lives
        if not lives:  # the gateway lets it go when its time is up
            self._heard_s = now_s
            return
        if now_s - self._heard_s > self._ttl_s:
            text = f"the gripper's machine has not answered for {self._ttl_s:g} s"
            self._end(error_object(UNREACHABLE, f"{text}: what was asked last may have been done"))
            return
        self._send_again(now_s)
        since_s = self._behind_since_s
        if since_s is not None and now_s - since_s > BEHIND_S:
            self._behind_since_s = now_s
            self._show_life(now_s, again=True)
        elif now_s - self._asked_s >= self._life_due_s:
            self._show_life(now_s)

    @property
    def _life_due_s(self) -> float:
        """How long after the last message the next sign of life is due."""
        usual_s = self._ttl_s / LIVE_SHARE
        is_answered = self._heard_s >= self._asked_s
        return usual_s if is_answered else min(usual_s, UNANSWERED_S)

    def _send_again(self, now_s: float) -> None:
        """Send the lines again that the gateway should have taken by now."""
        waiting = self._outbox.unconfirmed()
        since_s = max(self._again_s, waiting[0][1][2]) if waiting else now_s
        if now_s - since_s > AGAIN_AFTER_S:
            self._again_s = now_s
            for _number, (ask, line, _first_s) in waiting:
                self._send(ask, line, now_s)

    def replied(self, reply: Reply, sent_s: float, now_s: float) -> None:
        """Take the gateway's answer to a query that was sent at `sent_s`."""
        if reply.gone is not None:
            self._end(reply.gone)
            return
        self._heard_s = max(self._heard_s, sent_s)
        self._clock.note(sent_s, now_s, reply.now_s)
        self.note_stops(reply.generation)
        self._outbox.confirm(reply.took)
        if reply.sent > self._inbox.taken and self._behind_since_s is None:
            self._behind_since_s = now_s

    def pushed(self, push: Push, piece: bytes, now_s: float) -> None:
        """Take what the gateway has sent."""
        if self.ended:
            return
        self.note_stops(push.generation)
        if push.number is None:
            self._to_client(piece)
            return
        if not self._inbox.take(push.number):
            if push.number > self._inbox.taken and self._behind_since_s is None:
                self._behind_since_s = now_s
            return
        self._behind_since_s = None
        if push.end:
            self.ended = True
            return
        self._unconfirmed_bytes += len(piece)
        if self._unconfirmed_bytes > CONFIRM_BYTES and self._lives:  # a message is a sign of life
            self._show_life(now_s)
        self._line += piece
        if len(self._line) > MAX_ANSWER_BYTES:
            text = f"the gripper's machine sends a line of more than {MAX_ANSWER_BYTES} bytes"
            self._end(error_object(UNREACHABLE, text, limit=MAX_ANSWER_BYTES))
        elif not push.more:
            line, self._line = bytes(self._line), bytearray()
            self._to_client(self._amended(line) if self._introductions else line)

    def _show_life(self, now_s: float, *, again: bool = False) -> None:
        self._unconfirmed_bytes = 0
        self._send(Ask("live", again=again, at_s=self._clock.at(now_s)), b"", now_s)

    def _send(self, ask: Ask, line: bytes, now_s: float) -> None:
        self._asked_s = now_s
        self._ask(replace(ask, got=self._inbox.taken), line)

    def note_stops(self, generation: int | None) -> None:
        """Store how many stops the portal knows of by now."""
        if generation is not None:
            self.generation = max(generation, self.generation or 0)

    def _end(self, error: dict[str, Any]) -> None:
        if not self.ended:
            self.ended = True
            self._to_client(error_line(None, error))

    # hello ----------------------------------------------------------------------------------------

    def _note_introduction(self, line: bytes) -> None:
        """Remember a request whose answer says where the gripper is."""
        if b"\\" not in line and not any(method.encode() in line for method in INTRODUCTIONS):
            return
        try:
            request = strict_json.decode(line.lstrip().decode())
        except (ValueError, RecursionError):
            return
        if isinstance(request, dict) and request.get("method") in INTRODUCTIONS:
            identity = request.get("id")
            if is_id(identity):
                self._introductions.setdefault(identity, []).append(request["method"])

    def _amended(self, line: bytes) -> bytes:
        """Return an answer; one that says where the gripper is, says where it is met here.

        What is no answer goes to the client as it came, which knows what to say of that.
        """
        try:
            answer = json.loads(line)
        except (ValueError, RecursionError):
            return line
        identity = answer.get("id") if isinstance(answer, dict) else None
        if not is_id(identity) or identity not in self._introductions:
            return line
        method, *others = self._introductions.pop(identity)
        if others:
            self._introductions[identity] = others
        result = answer.get("result")
        if not isinstance(result, dict):
            return line
        if method == "health":
            result["remote"] = {name: self._about.get(name) for name in PROTECTION}
        else:
            remote = {**self._about, "channel": result.get("channel")}
            result |= {
                "channel": self._channel,
                "stop_socket": self._stop_socket,
                "remote": remote,
            }
        return json.dumps(answer, separators=(",", ":")).encode() + b"\n"


def _is_stop(line: bytes) -> bool:
    if b'"stop"' not in line and b"\\" not in line:
        return False
    try:
        request = json.loads(line)
    except (ValueError, RecursionError):
        return False
    return isinstance(request, dict) and request.get("method") == "stop"
