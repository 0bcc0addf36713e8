"""What damaged bytes do to each reader of foreign bytes, in figures.

python -m bench.hostile.foreign_bytes 1000000

So many bytes come to each reader: noise, and what it usually reads with some bytes replaced,
removed or added. Behind each piece comes a good one. A piece is refused by the reader's own error,
or counted, or taken where the damage has left something that may be; anything else ends the run.
`lost` are good pieces that were not read as they are, `closed` counts connections and adapters that
were given up.
"""

import asyncio
import contextlib
import json
import logging
import random
import socket
import sys
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import count
from pathlib import Path
from typing import Any

from websockets.asyncio.client import connect

from bench.tables import table
from litegrip_client.values.errors import TrajectoryFormatError
from litegrip_client.values.text import text_of
from litegrip_client.values.trajectory_format import parse_grips
from litegrip_fleet.wire.messages import Ask, BadMessageError, Push, Reply, packed, unpacked
from litegrip_web.gripper import Gripper
from litegrip_web.proof import proof
from litegrip_web.server import Settings, listening
from litegripd.app.build import page_bytes
from litegripd.app.config import ConfigError, load
from litegripd.io.can.slcan import AdapterLines
from litegripd.io.helper.files import DATA
from litegripd.model.calibration import parse_calibration
from litegripd.model.teleop import Arrival, TeleopFrame, encode_frame
from litegripd.recorder import files as recordings
from litegripd.recorder.recorder import Recorder, memory_bytes
from litegripd.teleop.intake import Intake
from litegripd.trajectories import values as trajectories
from tests.io.loop import Loop, line
from tests.trajectories import lgt
from tests.world import World

SEED = 35
WARM_SHARE = 0.1
"""Of the bytes: so much comes before memory is measured for the first time."""
TICKS = 50
"""Of the flight recorder; with its usual 12,000 each reading takes long."""
BATCH = 50
"""Requests that are sent at once to a real socket."""


@dataclass
class Figures:
    """What became of the pieces for one reader."""

    name: str
    damaged: int = 0
    bytes: int = 0
    refused: int = 0
    good: int = 0
    lost: int = 0
    closed: int = 0
    grown_kb: float = 0.0


Read = Callable[[bytes, bool], bool | None]
"""Reads a piece, which is good or damaged; returns False if it is refused or not what it was."""


def damaged(chance: random.Random, whole: bytes) -> bytes:
    """Return noise, or `whole` with one to four places of it replaced, removed or added to."""
    if chance.random() < 0.5:
        return chance.randbytes(chance.randint(1, 200))
    content = bytearray(whole)
    for _ in range(chance.randint(1, 4)):
        at = chance.randrange(len(content) + 1)
        content[at : at + chance.randrange(3)] = chance.randbytes(chance.randrange(1, 3))
    return bytes(content)


class Meter:
    """Counts for one reader, and measures the memory of this process once it is warm."""

    def __init__(self, name: str, total: int) -> None:
        self.figures = Figures(name)
        self.chance = random.Random(SEED)
        self._total = total
        self._before_bytes = 0

    def pieces(self, whole: bytes) -> Iterator[bytes]:
        """Yield damaged pieces until there were enough bytes."""
        figures = self.figures
        while figures.bytes < self._total:
            piece = damaged(self.chance, whole)
            figures.damaged += 1
            figures.bytes += len(piece)
            yield piece
            if not self._before_bytes and figures.bytes >= WARM_SHARE * self._total:
                self._before_bytes = page_bytes(1)
        figures.grown_kb = (page_bytes(1) - self._before_bytes) / 1000.0


def reading(name: str, whole: bytes, total: int, refuses: tuple[type[Exception], ...],
            read: Callable[[bytes], object]) -> Figures:  # fmt: skip
    """Give pieces to a function that returns the same value for the same bytes."""
    meter, expected = Meter(name, total), repr(read(whole))
    for piece in meter.pieces(whole):
        try:
            read(piece)
        except refuses:
            meter.figures.refused += 1
        meter.figures.good += 1
        meter.figures.lost += repr(read(whole)) != expected
    return meter.figures


def slcan(total: int) -> Figures:
    """Lines of a serial adapter; one that is given up would be opened again."""
    good, meter = b"t018811222233AABB1E20\r", Meter("SLCAN lines", total)
    lines, figures = AdapterLines(frozenset({b"C", b"S8", b"O", b"V"}), 0.0), meter.figures
    for number, piece in enumerate(meter.pieces(good)):
        now_s = 0.005 * number
        figures.refused += not list(lines.take(piece + b"\r", now_s))
        figures.good += 1
        figures.lost += len(list(lines.take(good, now_s))) != 1
        figures.closed += lines.verdict(now_s) is not None
    return figures


def teleop(total: int) -> Iterator[Figures]:
    """Frames of a leader over UDP or zenoh at 100 Hz, and damage from others, or from itself."""
    for name, source in (("of strangers", "b:2"), ("of the leader itself", "a:1")):
        meter, intake = Meter(f"teleoperation frames, {name}", total), Intake(0.2)
        whole = encode_frame(TeleopFrame(0.5, 42.0, 0.0, 2.0))
        for number, piece in enumerate(meter.pieces(whole)):
            at_s = 0.01 * number
            before = intake.rejected + intake.other_leaders + intake.out_of_order + intake.late
            good = encode_frame(TeleopFrame(0.5, 42.0, 0.0, 1000.0 + at_s))
            taken = intake.frames
            intake.take(Arrival(good, at_s, "a:1"))
            meter.figures.good += 1
            meter.figures.lost += intake.frames == taken
            intake.take(Arrival(piece, at_s + 0.005, source))
            after = intake.rejected + intake.other_leaders + intake.out_of_order + intake.late
            meter.figures.refused += after > before
        yield meter.figures


def requests(total: int) -> Figures:
    """Lines to the real server at a real Unix socket, through one connection."""
    meter, numbers = Meter("control socket, lines", total), count(1)
    whole = line("echo", 7, opening_mm=45.0, lease="e:1")[:-1]
    with tempfile.TemporaryDirectory() as folder:
        loop = Loop(Path(folder) / "socket")
        client, pieces = loop.connect(), meter.pieces(whole)
        while batch := [piece.replace(b"\n", b" ") for _, piece in zip(range(BATCH), pieces,
                        strict=False)]:  # fmt: skip
            wanted = {next(numbers) + 1_000_000: piece for piece in batch}
            for number, piece in wanted.items():
                client.sendall(piece + b"\n" + line("echo", number))
            answers = _answers(loop, client, f'"id":{max(wanted)},'.encode())
            told = {answer.get("id") for answer in answers if "result" in answer}
            for kept in (loop.service.lines, loop.service.served, loop.service.received_s):
                kept.clear()
            meter.figures.good += len(wanted)
            meter.figures.lost += len(wanted.keys() - told)
            meter.figures.refused += sum("error" in answer for answer in answers)
        meter.figures.closed += len(loop.service.ended)
        loop.close()
    return meter.figures


def _answers(loop: Loop, client: socket.socket, last: bytes) -> list[dict[str, Any]]:
    """Return what a client is told, up to the line that has `last` in it."""
    received = bytearray()

    def has_all() -> bool:
        with contextlib.suppress(BlockingIOError):
            received.extend(client.recv(1 << 20))
        return last in received and received.endswith(b"\n")

    loop.until(has_all)
    return [json.loads(told) for told in received.splitlines()]


def daemon(total: int) -> Figures:
    """Requests to the service of a whole daemon, in virtual time."""
    world, meter = World().start(), Meter("requests to a whole daemon", total)
    client = world.client()
    whole = json.dumps({"jsonrpc": "2.0", "id": 7, "method": "motion.move",
                        "params": {"opening_mm": 45.0}}).encode()  # fmt: skip
    for piece in meter.pieces(whole):
        world.service.handle(client.session, piece, world.now_s)
        told = [json.loads(told) for told in client.session.outgoing]
        client.session.outgoing.clear()
        meter.figures.refused += any("error" in answer for answer in told)
        meter.figures.good += 1
        meter.figures.lost += "result" not in client.call("state.get")
        client.notifications.clear()
        client.answers.clear()
        client.asked.clear()
    return meter.figures


async def _page(total: int) -> list[Figures]:
    http, messages = Meter("page, HTTP requests", total), Meter("page, WebSocket messages", total)
    logging.getLogger("websockets").setLevel(logging.CRITICAL)
    settings = Settings([Gripper("can0", "/no/such.sock")], "secret", port=0)
    async with listening(settings) as address:
        port = int(address.rstrip("/").rpartition(":")[2])
        whole = f"GET / HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\n\r\n".encode()

        async def ask(request: bytes, *, whole: bool) -> bytes:
            reader, writer = await asyncio.open_connection("127.0.0.1", port)
            writer.write(request)
            if not whole:
                writer.write_eof()  # else the server waits for the rest
            answer = b""
            with contextlib.suppress(ConnectionError):
                answer = await reader.read(100)
            writer.close()
            with contextlib.suppress(ConnectionError):
                await writer.wait_closed()
            return answer

        for piece in http.pieces(whole):
            http.figures.refused += not (await ask(piece, whole=False)).startswith(b"HTTP/1.1 200")
            http.figures.good += 1
            http.figures.lost += not (await ask(whole, whole=True)).startswith(b"HTTP/1.1 200")
        origin: Any = f"http://127.0.0.1:{port}"
        async with connect(f"ws://127.0.0.1:{port}/ws/can0", origin=origin) as browser:
            nonce = "n" * 43
            await browser.send(json.dumps({"nonce": nonce}))
            own = json.loads(await browser.recv())["nonce"]
            known = proof("secret", "page", f"127.0.0.1:{port}", nonce, own)
            await browser.send(json.dumps({"proof": known}))
            await browser.recv()
            request = '{"jsonrpc":"2.0","id":7,"method":"state.get","params":{}}'
            for number, piece in enumerate(messages.pieces(request.encode())):
                text = piece.decode(errors="replace")
                await browser.send(piece if number % 2 else text)
                messages.figures.refused += "error" in json.loads(await browser.recv())
                messages.figures.good += 1
                await browser.send(request.replace("7", str(10_000 + number)))
                told = json.loads(await browser.recv())
                messages.figures.lost += told.get("id") != 10_000 + number
    return [http.figures, messages.figures]


def fleet(total: int) -> Iterator[Figures]:
    """What is attached to the messages of portals and gateways."""
    samples: tuple[Ask | Reply | Push, ...] = (
        Ask("line", 7, 3, at_s=12.5, generation=2),
        Reply(7, 9, 1234.5, 2),
        Push(3, more=True),
    )
    for sample in samples:
        kind = type(sample)
        yield reading(f"fleet, {kind.__name__}", packed(sample), total, (BadMessageError,),
                      lambda data, kind=kind: unpacked(kind, data))  # type: ignore[misc]  # fmt: skip


def stored(total: int) -> Iterator[Figures]:
    """Files, and what a person types at the simulator."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "can0.toml"

        def configuration(content: bytes) -> object:
            path.write_bytes(content)
            return load("can0", path)

        world, memory = World(), bytearray(memory_bytes(TICKS))
        world.recorder = Recorder(memoryview(memory), TICKS, {"channel": "can0"})
        world.enabled().result("motion.close")
        dump = bytes(memory)
        errors = (ValueError,)
        own = b'[bus]\nchannel = "can0"\n[control]\nrate_hz = 200\n[gripper]\nmount = "normal"\n'
        factory = (DATA / "normal.json").read_bytes()
        path_of = lgt(((0.0, 0.5), (1.0, 0.6)))
        badly = (TrajectoryFormatError,)

        def calibration(content: bytes) -> object:
            return parse_calibration(text_of(content))

        def trajectory(content: bytes) -> object:
            return trajectories.read(memoryview(content))

        yield reading("file, configuration", own, total, (ConfigError,), configuration)
        yield reading("file, calibration", factory, total, errors, calibration)
        yield reading("file, trajectory", path_of, total, badly, trajectory)
        yield reading("file, taught grips", b'[{"at_s": 1.0}]', total, badly, parse_grips)
        yield flight_dumps(dump, total)


def flight_dumps(whole: bytes, total: int) -> Figures:
    """A recorder's memory is large: a hundredth of each piece's bytes is damaged."""
    meter = Meter("file, flight recorder's memory", total)
    expected = repr(recordings.read(whole).about)
    for piece in meter.pieces(b"x" * 100):
        content = bytearray(whole)
        at = meter.chance.choice((0, meter.chance.randrange(len(whole))))
        content[at : at + len(piece)] = piece
        try:
            recordings.read(bytes(content[: len(whole)]))
        except ValueError:
            meter.figures.refused += 1
        if meter.figures.damaged % 100 == 1:
            meter.figures.good += 1
            meter.figures.lost += repr(recordings.read(whole).about) != expected
    return meter.figures


def all_figures(total: int) -> Iterator[Figures]:
    """Run all readers, one after the other."""
    yield slcan(total)
    yield from teleop(total)
    yield requests(total)
    yield daemon(total)
    yield from asyncio.run(_page(total))
    yield from fleet(total)
    yield from stored(total)


def main(total: int) -> None:
    """Print the table."""
    head = ("reader", "damaged pieces", "their bytes", "refused", "good pieces", "lost", "closed",
            "memory grew by")  # fmt: skip
    rows = (
        [one.name, str(one.damaged), str(one.bytes), str(one.refused), str(one.good),
         str(one.lost), str(one.closed), f"{one.grown_kb:.0f} kB"]
        for one in all_figures(total)
    )  # fmt: skip
    table(f"{total} damaged bytes into each reader", head, rows)


if __name__ == "__main__":
    main(int(sys.argv[1]) if len(sys.argv) > 1 else 20_000)
