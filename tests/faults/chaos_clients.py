"""Clients that ask for anything at any time: methods from the table, good and bad parameters.

They come and go, take leases, stream, stop, and keep nothing of what they are told but tokens and
job numbers. What they get is searched for defects.
"""

import json
import random
import re
from typing import Any

from litegripd.app.build import BY_NAME, METHODS
from litegripd.rpc.method import Param
from tests.world import World

CLIENTS = 5
ACTS_EACH_S = 2.0
STREAM_S = 1.0
STREAM_EVERY_S = 0.02
LEAVES, GARBAGE, BAD, STREAMS = 0.04, 0.02, 0.05, 0.04

USUAL = (
    "motor.enable", "motor.enable", "motor.enable", "motion.open", "motion.close", "motion.grasp",
    "motion.grasp", "motion.move", "motion.move", "motion.hold", "motion.set_force", "stop.clear",
    "stop.clear", "stop.clear", "motor.clear_fault", "lease.release", "job.cancel",
)  # fmt: skip
"""What is asked for as often as all methods of the table together."""
ODD: tuple[Any, ...] = (
    None, True, -1, 1e308, 2**63, "", "x" * 300, "\u0000", [], {}, [[]], {"a": 1}, -0.0, "0:1",
)  # fmt: skip
DEFECT = b'"error":{"code":-32603,'
TOKEN, JOB = re.compile(rb'"lease":"([^"]+)"'), re.compile(rb'"job":(\d+)')
GARBAGE_LINES = (b"", b"{", b"[]", b"\xff\xfe", b"null", b"{" * 500, b'{"jsonrpc":"2.0","id":1}')
TAME = {"speed_mm_s": 150.0, "wait_s": 2.0, "ttl_s": 5.0, "hold_s": 3.0, "duration_s": 10.0}
"""Upper ends of what would else last too long, or hit a stop harder than a lead bounds."""
CONFIG = {
    "settle_s": (0.0, 0.5), "force_n": (0.5, 30.0), "stall_cycles": (1, 10),
    "speed_mm_s": (1.0, 200.0), "grasp_speed_mm_s": (1.0, 100.0), "reach_tol": (0.005, 0.05),
}  # fmt: skip
"""Fields that change how the jaws move, but not how hard they press on a stop."""


class ChaosClient:
    """One client; `act` perhaps does something, `read` takes what it was sent."""

    def __init__(self, world: World, chance: random.Random) -> None:
        self._world = world
        self._chance = chance
        self._client = world.client()
        self._token: str | None = None
        self._job = 1
        self._streams_until_s = 0.0
        self._stream_due_s = 0.0

    def act(self) -> None:
        """Do what comes to mind, a few times a second."""
        now_s, chance = self._world.now_s, self._chance
        if now_s < self._streams_until_s and now_s >= self._stream_due_s:
            self._stream_due_s = now_s + STREAM_EVERY_S
            self._send("stream.set", {"openness": chance.random()})
        if chance.random() >= ACTS_EACH_S * 0.005:
            return
        what = chance.random()
        if what < LEAVES:
            self.leave()
            self.__init__(self._world, chance)  # type: ignore[misc]
        elif what < LEAVES + GARBAGE:
            self._line(chance.choice(GARBAGE_LINES))
        elif what < LEAVES + GARBAGE + STREAMS:
            self._streams_until_s = now_s + STREAM_S
        else:
            usual = chance.random() < 0.5
            method = BY_NAME[chance.choice(USUAL)] if usual else chance.choice(METHODS)
            self._send(method.name, self._params(method.name))

    def leave(self) -> None:
        """End the connection."""
        self.read()
        self._client.leave()

    def read(self) -> None:
        """Take what was sent; none of it may tell of a defect."""
        outgoing = self._client.session.outgoing
        for line in outgoing:
            assert DEFECT not in line, line[:500]
            token, job = TOKEN.search(line), JOB.search(line)
            self._token = self._token if token is None else token.group(1).decode()
            self._job = self._job if job is None else int(job.group(1))
        outgoing.clear()

    def _send(self, method: str, params: dict[str, Any]) -> None:
        request = {"jsonrpc": "2.0", "id": 1, "method": method, "params": params}
        self._line(json.dumps(request).encode())

    def _line(self, line: bytes) -> None:
        self._world.service.handle(self._client.session, line, self._world.now_s)

    def _params(self, method: str) -> dict[str, Any]:
        """Make parameters as they should be, each of the optional ones now and then."""
        chance = self._chance
        params = {
            param.name: self._value(param)
            for param in BY_NAME[method].declared.values()
            if chance.random() < (0.97 if param.required else 0.2)
        }
        for name in ("sent_s", "stop_generation"):
            params.pop(name, None) if chance.random() < 0.9 else None
        if len(params.keys() & {"opening_mm", "position_rad", "openness"}) != 1:
            for name in ("opening_mm", "position_rad", "openness"):
                params.pop(name, None)
            if "openness" in BY_NAME[method].declared:
                params["openness"] = chance.random()
        if chance.random() < BAD:
            params[chance.choice(("x", *params))] = chance.choice(ODD)
        return params

    def _value(self, param: Param) -> Any:
        chance = self._chance
        if param.name == "lease":
            return self._token or "0:1"
        if param.name == "job":
            return chance.choice((self._job, chance.randint(1, 2000)))
        if param.name == "config":
            return self._config()
        if param.choices:
            one = chance.choice(param.choices)
            return [one] if param.kind == "strings" else one
        low = 0.0 if param.minimum is None else param.minimum
        high = low + 50.0 if param.maximum is None else param.maximum
        high = min(high, TAME.get(param.name, high))
        values: dict[str, Any] = {
            "number": chance.uniform(low, high),
            "integer": chance.randint(int(low), max(int(low), min(int(high), 100))),
            "boolean": chance.random() < 0.5,
            "string": chance.choice(("PMAX", "TIMEOUT", "a", "b", "c")),
            "object": {},
            "strings": ["mode"],
        }
        return values[param.kind]

    def _config(self) -> dict[str, float]:
        chance = self._chance
        name = chance.choice(tuple(CONFIG))
        low, high = CONFIG[name]
        if isinstance(low, int) and isinstance(high, int):
            return {name: chance.randint(low, high)}
        return {name: chance.uniform(low, high)}
