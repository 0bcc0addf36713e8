"""A world that keeps every frame that the daemon sends and every line that it writes."""

import hashlib
import itertools
from pathlib import Path
from typing import Any

from litegripd.app.build import build_service
from litegripd.rpc.sessions import Peer, Role
from tests.control.teleop_scene import TeleopWorld
from tests.world import Client, FixedFacts

ROOT = str(Path(__file__).parents[2])


class GoldenWorld(TeleopWorld):
    """A daemon in virtual time whose every output is kept, in `kept`, in the order it came.

    A line of it: the time, to whom (`can`, or a client's number), and what.
    """

    def __init__(self, mount: str = "normal", opening_mm: float = 60.0, **more: Any) -> None:
        super().__init__(mount, opening_mm, **more)
        tokens = itertools.count(1)
        self.service = build_service(
            self.controller,
            FixedFacts(),
            self.period_s,
            dumps=self.dumps,
            restart=self._restart,
            links=self.wires,
            new_token=lambda: f"token-{next(tokens)}",
        )
        self.recorder = self.make_recorder()
        self.kept: list[str] = []
        self.clients: list[GoldenClient] = []
        self._seen = 0

    def client(
        self, *, pid: int | None = None, uid: int = 1000, role: Role = "admin"
    ) -> "GoldenClient":
        self._last_pid += 1
        number = pid or self._last_pid
        peer = Peer(number, uid, 1000, f"program{number}")
        client = GoldenClient(self, self.service.opened(peer, self.now_s))
        client.session.role = role
        self.clients.append(client)
        return client

    def tick(self) -> None:
        super().tick()
        for sent in self.sent[self._seen :]:
            frame = sent.frame
            self.keep("can", f"{frame.can_id:03X}#{frame.data.hex()}")
        self._seen = len(self.sent)
        for client in self.clients:
            client.read()

    def keep(self, receiver: str, what: str) -> None:
        """Keep one output; where the code lies says nothing: answers name the templates' files."""
        what = what.replace(ROOT, "")
        self.kept.append(f"{self.now_s:.6f} {receiver} {what}")

    def digest(self) -> dict[str, Any]:
        """Return how many frames and lines there were, and the hash of all."""
        frames = sum(" can " in line[:24] for line in self.kept)
        text = "\n".join(self.kept)
        return {
            "frames": frames,
            "lines": len(self.kept) - frames,
            "sha256": hashlib.sha256(text.encode()).hexdigest(),
        }


class GoldenClient(Client):
    """A client of a `GoldenWorld`; sends what it likes, not requests alone."""

    world: GoldenWorld

    def send_line(self, line: bytes) -> None:
        """Send a line as it is."""
        self.world.service.handle(self.session, line, self.world.now_s)

    def read(self) -> None:
        """Keep what has been written, and take it."""
        number = self.world.clients.index(self) + 1
        for line in self.session.outgoing:
            self.world.keep(f"client{number}", line.decode().rstrip("\n"))
        super().read()
