"""Hostile lines by the ten thousand: each answered once, none a defect, and the gripper as before.

LITEGRIPD_FUZZ_LINES sets another number of lines, for a long run; LITEGRIPD_FUZZ_SEED another seed.
"""

import json
import os
import random
from typing import Any

from litegripd.rpc.methods import METHODS
from litegripd.rpc.schema import Param
from tests.world import Client, World

LINES = int(os.environ.get("LITEGRIPD_FUZZ_LINES", "50000"))
SEED = int(os.environ.get("LITEGRIPD_FUZZ_SEED", "1"))
ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 1e308, 2**63, -(2**70), "", "x" * 300, "\u0000", "hold", "0:1", [], {},
    [[[]]], {"a": {"b": 1}}, 0.5, -0.0, 5e-324, "normal", ["mode"], {"force_n": 5}, {"margin": []},
)  # fmt: skip
SPELT_OUT = (b"NaN", b"Infinity", b"1e999", b"-1e999", b"0x10", b"01", b"'x'", b"\xff", b"{" * 600)


class Hostile:
    """Makes lines, from nearly right to nonsense."""

    def __init__(self, chance: random.Random) -> None:
        self._chance = chance
        self._last_id = 0

    def line(self) -> bytes:
        kind = self._chance.random()
        if kind < 0.05:
            return self._chance.randbytes(self._chance.randint(1, 200)).replace(b"\n", b" ")
        line = json.dumps(self._request()).encode()
        if kind < 0.2:
            return self._broken(line)
        return line

    def _request(self) -> Any:
        chance, method = self._chance, self._chance.choice(METHODS)
        self._last_id += 1
        params = {
            param.name: self._value(param)
            for param in method.declared.values()
            if chance.random() < (0.9 if param.required else 0.3)
        }
        if chance.random() < 0.05:
            params[chance.choice(("x", "lease", "config", "id"))] = chance.choice(ODD)
        request = {"jsonrpc": "2.0", "id": self._last_id, "method": method.name, "params": params}
        if chance.random() < 0.05:
            request[chance.choice(("jsonrpc", "id", "method", "params", "more"))] = chance.choice(
                ODD
            )
        if chance.random() < 0.02:
            return [request]
        return request

    def _value(self, param: Param) -> Any:
        chance = self._chance
        if chance.random() < 0.1:
            return chance.choice(ODD)
        if param.choices:
            one = chance.choice(param.choices)
            return [one] if param.kind == "strings" else one
        low = 0.0 if param.minimum is None else param.minimum
        high = low + 100.0 if param.maximum is None else param.maximum
        numbers = {"number": chance.uniform(low, high), "integer": chance.randint(int(low), 50)}
        plain: dict[str, Any] = {**numbers, "boolean": chance.random() < 0.5, "string": "a text"}
        return plain.get(param.kind, {"force_n": chance.uniform(-1, 40)})

    def _broken(self, line: bytes) -> bytes:
        chance, at = self._chance, self._chance.randrange(len(line))
        how = chance.randrange(4)
        if how == 0:
            return line[:at] or b"x"
        if how == 1:
            return line[:at] + bytes([chance.choice(range(32, 256))]) + line[at + 1 :]
        if how == 2:
            return line[:at] + chance.choice(SPELT_OUT) + line[at:]
        return line + line[at:]


def test_hostile_lines_are_each_answered_once_and_do_no_harm() -> None:
    chance = random.Random(SEED)
    world = World()
    good = world.enabled()
    hostile = Hostile(chance)
    clients = [world.client() for _ in range(4)]
    for number in range(LINES):
        client = clients[number % len(clients)]
        line = hostile.line()
        waiting = client.session.unanswered
        world.service.handle(client.session, line, world.now_s)
        check_answered(client, line, client.session.unanswered - waiting)
        if number % 50 == 0:
            world.tick()
            world.sent.clear()
        if number % 500 == 0:
            index = chance.randrange(len(clients))
            clients[index].leave()
            clients[index] = world.client()
        if number % 1000 == 0:
            assert good.result("state.get")["seq"] > 0
    good.result("lease.take", why="the end")
    good.result("stop.clear")
    world.run_until(lambda: world.engine.jobs.running is None or not cancelled(good))
    good.result("calibration.load", template="normal")
    good.result("config.set", config={"settle_s": 0.1, "press_overshoot": 0.05})
    assert good.result("motor.enable")["ok"]
    assert good.result("state.get")["enabled"]


def cancelled(client: Client) -> bool:
    """Cancel whatever runs or waits; tell whether anything did."""
    open_jobs = [
        job for job in client.result("job.list")["jobs"] if job["state"] in ("running", "queued")
    ]
    for job in open_jobs:
        client.result("job.cancel", job=job["job"])
    return bool(open_jobs)


def check_answered(client: Client, line: bytes, left_waiting: int) -> None:
    """Check that a line got one answer, or waits for it, or wanted none."""
    lines = [json.loads(one) for one in client.session.outgoing]
    client.session.outgoing.clear()
    answers = [one for one in lines if "method" not in one]
    for one in answers:
        assert one.get("error", {}).get("data", {}).get("reason") != "internal_error", (line, one)
    if b"stream.set" in line and not answers:
        return  # it may be sent without an id, and then has no answer
    assert len(answers) + left_waiting >= 1 or b'"id"' not in line, (line, lines)
