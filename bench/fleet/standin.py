"""Many grippers in one process, for what measures the fleet: daemons are more than two cores carry.

python -m bench.fleet.standin RECORDED DIRECTORY COUNT

At DIRECTORY/0000.sock and so on it speaks the daemon's protocol as far as a gateway and its
sessions need it. The answers and the sample of the state are those of a daemon (RECORDED, from
`bench.fleet.recorded`); a sample's number and its first `monotonic_s` are those of when it is sent.
"""

import asyncio
import json
import sys
import time
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from bench.fleet.recorded import SAMPLE

CONGESTED_BYTES = 65_536
"""While more is unread, a sample is dropped, as by the daemon."""


class Answers:
    """What is answered, as text that is ready to be sent."""

    def __init__(self, recorded: Mapping[str, Any]) -> None:
        self.of = {name: _compact(result).encode() for name, result in recorded.items()}
        sample = {"jsonrpc": "2.0", "method": "state.sample", "params": recorded[SAMPLE]}
        number, at_s = f'"seq":{sample["params"]["seq"]},', sample["params"]["monotonic_s"]
        before, found, rest = _compact(sample).partition(number)
        between, also_found, after = rest.partition(f'"monotonic_s":{json.dumps(at_s)}')
        if not found or not also_found:
            raise ValueError(f"the sample has another shape: {_compact(sample)[:200]}")
        self._sample = [part.replace("%", "%%") for part in (before, between, after)]
        self._form = '{}"seq":%d,{}"monotonic_s":%.9f{}\n'.format(*self._sample)

    def sample(self, number: int) -> bytes:
        """Return a sample of now."""
        return (self._form % (number, time.monotonic())).encode()


def _compact(value: object) -> str:
    return json.dumps(value, separators=(",", ":"))


class Connection(asyncio.Protocol):
    """A client's connection; it has one subscription to the state at most."""

    _transport: asyncio.Transport

    def __init__(self, answers: Answers, phase: float) -> None:
        self._answers = answers
        self._phase = phase
        self._rest = b""
        self._number = 0
        self._timer: asyncio.TimerHandle | None = None

    def connection_made(self, transport: asyncio.BaseTransport) -> None:
        assert isinstance(transport, asyncio.Transport)
        self._transport = transport

    def connection_lost(self, _error: Exception | None) -> None:
        if self._timer is not None:
            self._timer.cancel()

    def data_received(self, data: bytes) -> None:
        *lines, self._rest = (self._rest + data).split(b"\n")
        for line in lines:
            self._answer(json.loads(line))

    def _answer(self, request: Mapping[str, Any]) -> None:
        identity = json.dumps(request.get("id")).encode()
        result = self._answers.of.get(request["method"])
        if result is None:
            error = b'{"code":-32601,"message":"a stand-in","data":{"reason":"unknown_method"}}'
            self._write(b'{"jsonrpc":"2.0","id":%b,"error":%b}\n' % (identity, error))
            return
        self._write(b'{"jsonrpc":"2.0","id":%b,"result":%b}\n' % (identity, result))
        if request["method"] == "state.subscribe":
            period_s = 1.0 / request["params"]["hz"]
            now_s = asyncio.get_running_loop().time()
            self._at(now_s + self._phase * period_s, period_s)

    def _at(self, due_s: float, period_s: float) -> None:
        loop = asyncio.get_running_loop()
        self._timer = loop.call_at(due_s, self._send_sample, due_s, period_s)

    def _send_sample(self, due_s: float, period_s: float) -> None:
        self._number += 1
        if self._transport.get_write_buffer_size() <= CONGESTED_BYTES:
            self._write(self._answers.sample(self._number))
        self._at(due_s + period_s, period_s)

    def _write(self, line: bytes) -> None:
        if not self._transport.is_closing():
            self._transport.write(line)


async def serve(recorded: Path, directory: Path, count: int) -> None:
    """Serve until the process is ended."""
    answers = Answers(json.loads(recorded.read_text(encoding="utf-8")))
    loop = asyncio.get_running_loop()
    for index in range(count):
        for ending in (".sock", ".stop.sock"):
            path = directory / f"{name_of(index)}{ending}"
            # The grippers do not all measure at the same moment.
            phase = index / count
            await loop.create_unix_server(lambda phase=phase: Connection(answers, phase), str(path))  # type: ignore[misc]
    print("listening", flush=True)
    await asyncio.Event().wait()


def name_of(index: int) -> str:
    """Return a gripper's name."""
    return f"{index:04}"


if __name__ == "__main__":
    asyncio.run(serve(Path(sys.argv[1]), Path(sys.argv[2]), int(sys.argv[3])))
