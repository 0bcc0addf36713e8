"""Observers who list trajectories without end hold up nobody else's files."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import SIMULATED, Client, DaemonProcess, daemon_for_all, spawned

pytestmark = pytest.mark.alone

FLOOD = """
import os, select, socket, sys
if sys.argv[2] != "0":
    os.setgroups([]); os.setgid(int(sys.argv[2])); os.setuid(int(sys.argv[2]))
line = b'{"jsonrpc":"2.0","id":1,"method":"trajectory.list","params":{}}\\n' * 16
sockets = []
for _ in range(4):
    one = socket.socket(socket.AF_UNIX)
    one.connect(sys.argv[1])
    one.setblocking(False)
    sockets.append(one)
print("on", flush=True)
while True:
    ready, takes, _ = select.select(sockets, sockets, [])
    for one in ready:
        if not one.recv(65536):
            sys.exit()
    for one in takes:
        try:
            one.send(line)
        except BlockingIOError:
            pass
"""
OTHER = 30001
CONFIG = f'{SIMULATED}default = "observer"\noperators = ["root"]\n'


@pytest.fixture
def crowded() -> Iterator[DaemonProcess]:
    if os.getuid() != 0:
        pytest.skip("only root can let another user's process flood")
    with daemon_for_all(f"flood-{os.getpid()}", CONFIG) as running:
        yield running


def keep_many(client: Client, folder: Path) -> None:
    """Keep so many trajectories that each list of them takes a while."""
    client.result("trajectory.record_start", zero_gravity=False)
    client.result("trajectory.record_stop", name="a", allow_empty=True)
    content = (folder / "trajectories" / "a.lgt").read_bytes()
    for number in range(60):
        (folder / "trajectories" / f"b{number}.lgt").write_bytes(content)


def test_saving_and_playing_succeed_beside_observers_who_flood(crowded: DaemonProcess) -> None:
    with crowded.connect() as client:
        client.enabled()
        before = client.until_health(lambda h: bool(h["helper"]["pid"]))
        keep_many(client, crowded.socket_path.parent)
        with spawned(FLOOD, str(crowded.socket_path), str(OTHER), says="on"):
            client.until_health(lambda h: bool(h["helper"]["refused"] > 100))
            for number in range(2):
                client.result("trajectory.record_start", zero_gravity=False)
                name = f"pick {number}"
                client.result("trajectory.record_stop", name=name, allow_empty=True)
                client.result("trajectory.get", name=name)
                client.result("calibration.templates")
                client.result("calibration.save")
                client.result("config.set", config={"force_n": 7.5 + number}, keep=True)
            health = client.result("health")
            told = f"requests of uid {OTHER} were refused"
            assert any(told in reason for reason in health["reasons"]), health["reasons"]
            assert health["log"]["dropped"] == before["log"]["dropped"]
