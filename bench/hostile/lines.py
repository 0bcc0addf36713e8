"""Lines that a client may send by mistake or by malice: structured ones, broken ones, noise.

For the fuzzer in virtual time (tests/rpc/test_fuzz.py) and for the one that uses a real socket
(bench.hostile.clients).
"""

import json
import random
from collections.abc import Sequence
from typing import Any

from litegripd.app.build import METHODS
from litegripd.rpc.method import Method, Param

ODD: tuple[Any, ...] = (
    None, True, -1, 0, 1, 1e308, 2**63, -(2**70), "", "x" * 300, "\u0000", "hold", "0:1", [], {},
    [[[]]], {"a": {"b": 1}}, 0.5, -0.0, 5e-324, "normal", ["mode"], {"force_n": 5}, {"margin": []},
)  # fmt: skip
SPELT_OUT = (b"NaN", b"Infinity", b"1e999", b"-1e999", b"0x10", b"01", b"'x'", b"\xff", b"{" * 600)


class HostileLines:
    """Makes lines, from nearly right to nonsense, that name these methods."""

    def __init__(self, chance: random.Random, methods: Sequence[Method] = METHODS) -> None:
        self._chance = chance
        self._methods = methods
        self._last_id = 0

    def line(self) -> bytes:
        """Return the next one, without a newline."""
        kind = self._chance.random()
        if kind < 0.05:
            return self._chance.randbytes(self._chance.randint(1, 200)).replace(b"\n", b" ")
        line = json.dumps(self._request()).encode()
        if kind < 0.2:
            return self._broken(line)
        return line

    def _request(self) -> Any:
        chance, method = self._chance, self._chance.choice(self._methods)
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
