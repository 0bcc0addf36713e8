"""Who is at the other end of a socket: asked of the kernel, groups included, however many."""

import os
import select
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from litegripd.io.sockets import peer_of
from litegripd.rpc.sessions import Peer
from tests.io.loop import Loop

DEADLINE_S = 20.0
CONNECT = """
import os, socket, sys
address, *identity = sys.argv[1:]
if identity:
    uid, gid, *groups = map(int, identity)
    os.setgroups(groups)
    os.setgid(gid)
    os.setuid(uid)
s = socket.socket(socket.AF_UNIX)
s.connect("\\0" + address)
print(os.getpid(), flush=True)
sys.stdin.read()
"""
MANY = tuple(range(20_000, 20_400))


def peer_of_process(*identity: int) -> tuple[Peer, int]:
    """Let a process connect, as another user where one is given; return the peer and its pid."""
    address = f"litegripd-test-{os.getpid()}"  # abstract: no directory keeps other users out
    command = [sys.executable, "-c", CONNECT, address, *map(str, identity)]
    with socket.socket(socket.AF_UNIX) as listener:
        listener.bind("\0" + address)
        listener.listen()
        with subprocess.Popen(
            command,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
        ) as process:
            assert process.stdout is not None
            assert select.select([process.stdout], [], [], DEADLINE_S)[0]
            pid = process.stdout.readline()
            if not pid:
                pytest.skip(f"cannot become another user: {process.communicate()[1]}")
            accepted, _address = listener.accept()
            with accepted:
                return peer_of(accepted), int(pid)


def test_a_process_is_known_with_its_groups() -> None:
    peer, pid = peer_of_process()
    assert (peer.pid, peer.uid, peer.gid) == (pid, os.getuid(), os.getgid())
    assert sorted(peer.groups) == sorted(os.getgroups())
    assert peer.program.startswith("python")


@pytest.mark.parametrize("groups", [(), (20_001, 20_002), MANY], ids=["none", "two", "many"])
@pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")
def test_another_users_groups_are_told_however_many(groups: tuple[int, ...]) -> None:
    peer, _pid = peer_of_process(12_345, 12_346, *groups)
    assert (peer.uid, peer.gid) == (12_345, 12_346)
    assert peer.groups == groups


def test_the_services_sessions_have_the_groups(loop: Loop) -> None:
    loop.connect()
    loop.until(lambda: loop.server.clients == 1)
    peer = loop.service.sessions[0].peer
    assert (peer.pid, peer.gid) == (os.getpid(), os.getgid())
    assert sorted(peer.groups) == sorted(os.getgroups())


def test_a_socket_without_a_peer_has_no_groups() -> None:
    with socket.socket(socket.AF_UNIX) as alone:
        peer = peer_of(alone)
    assert (peer.pid, peer.program, peer.groups) == (0, "?", ())


def test_a_program_that_has_ended_is_told_as_one(tmp_path: Path) -> None:
    path = str(tmp_path / "listening")
    with socket.socket(socket.AF_UNIX) as server:
        server.bind(path)
        server.listen()
        connects = f"import socket\nsocket.socket(socket.AF_UNIX).connect({path!r})"
        process = subprocess.Popen([sys.executable, "-c", connects])
        process.wait()
        with server.accept()[0] as connected:
            peer = peer_of(connected)
    assert (peer.pid, peer.program) == (process.pid, "a program that has ended")
