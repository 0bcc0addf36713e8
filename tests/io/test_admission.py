"""Who is let in at the Unix socket, and who is told why not."""

import os
import socket

import pytest

from litegripd.io import server as server_module
from tests.io.loop import Loop, line


@pytest.mark.parametrize("name", ["MAX_CONNECTIONS", "MAX_CONNECTIONS_PER_UID"])
def test_one_connection_too_many_is_refused_with_the_limit(
    loop: Loop, monkeypatch: pytest.MonkeyPatch, name: str
) -> None:
    monkeypatch.setattr(server_module, name, 3)
    clients = [loop.connect() for _ in range(3)]
    loop.until(lambda: loop.server.clients == 3)
    (refusal,) = loop.read_to_end(loop.connect())
    assert refusal["error"]["data"]["reason"] == "too_many_connections"
    assert refusal["error"]["data"]["limit"] == 3
    assert loop.server.refused_connections == 1
    clients[0].close()
    loop.until(lambda: loop.server.clients == 2)
    another = loop.connect()
    another.send(line("echo", 1))
    assert loop.read(another, 1)[0]["id"] == 1


def test_the_limits_are_those_that_are_promised() -> None:
    assert (server_module.MAX_CONNECTIONS, server_module.MAX_CONNECTIONS_PER_UID) == (256, 64)


class Refusing:
    """A listening socket on which the kernel cannot accept for a while."""

    def __init__(self, listener: socket.socket) -> None:
        self.listener = listener
        self.errors = [OSError(number, os.strerror(number)) for number in (12, 23, 24, 103, 105)]

    def accept(self) -> tuple[socket.socket, object]:
        if self.errors:
            raise self.errors.pop()
        return self.listener.accept()

    def fileno(self) -> int:
        return self.listener.fileno()

    def close(self) -> None:
        self.listener.close()


def test_an_accept_that_fails_lets_later_clients_in(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(loop.server, "_listener", Refusing(loop.server._listener))
    client = loop.connect()
    client.send(line("echo", 1))
    assert loop.read(client, 1)[0]["id"] == 1
    assert loop.server.refused_connections == 5


def test_a_client_that_cannot_be_watched_is_closed(
    loop: Loop, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_arguments: object) -> None:
        raise OSError(28, "No space left on device")

    with monkeypatch.context() as patch:
        patch.setattr(loop.reactor, "add", full)
        loop.read_to_end(loop.connect())
    assert loop.server.clients == 0
    assert loop.service.ended == loop.service.sessions
    client = loop.connect()
    client.send(line("echo", 1))
    assert loop.read(client, 1)[0]["id"] == 1
