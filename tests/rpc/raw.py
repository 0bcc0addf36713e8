"""Sends any bytes to the service, as a client's socket would bring them."""

import json
from typing import Any

from tests.world import Client, World


class Raw:
    """One session that is sent raw lines."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.client: Client = world.client()

    def send(self, line: bytes) -> list[dict[str, Any]]:
        """Send one line; return what was answered at once."""
        self.world.service.handle(self.client.session, line, self.world.now_s)
        return self.take()

    def take(self) -> list[dict[str, Any]]:
        """Return what was written to this client, after checking that each is one line of JSON."""
        lines = list(self.client.session.outgoing)
        self.client.session.outgoing.clear()
        for line in lines:
            assert line.endswith(b"\n")
            assert line.count(b"\n") == 1
        return [json.loads(line, parse_constant=_refuse) for line in lines]

    def error(self, line: bytes) -> dict[str, Any]:
        """Send a line that is to be refused; return the whole answer."""
        (answer,) = self.send(line)
        assert "error" in answer, answer
        assert answer["jsonrpc"] == "2.0"
        return answer

    def is_alive(self) -> bool:
        """True if the session goes on."""
        (answer,) = self.send(b'{"jsonrpc":"2.0","id":"alive","method":"state.get"}')
        return answer["id"] == "alive" and "result" in answer


def answered(client: Client, number: int) -> bool:
    """True if a client has been sent the answer to its request."""
    client.read()
    return number in client.answers


def request(method: str, identity: object = 1, **params: object) -> bytes:
    """Make a request line."""
    value = {"jsonrpc": "2.0", "id": identity, "method": method, "params": params}
    return json.dumps(value).encode()


def _refuse(name: str) -> None:
    raise AssertionError(f"{name} is not JSON")
