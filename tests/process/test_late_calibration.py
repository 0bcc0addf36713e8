"""A calibration that was asked for in time and found too late, between processes of two users."""

import os
import signal
from collections.abc import Callable

import pytest

from tests.process.daemon_process import Client, DaemonProcess
from tests.process.test_whose import ALICE, BOB, one, said, script, shared, wake

__all__ = ["one", "shared"]

pytestmark = pytest.mark.skipif(os.getuid() != 0, reason="only root can become another user")

ASKS = """
s = socket.socket(socket.AF_UNIX); s.connect(path); f = s.makefile("rb")
def send(number, method, **params):
    line = {"jsonrpc": "2.0", "id": number, "method": method, "params": params}
    s.sendall(json.dumps(line).encode() + b"\\n")
def answer():
    line = json.loads(f.readline())
    while "id" not in line:  # that the lease is lost comes unasked
        line = json.loads(f.readline())
    return line["id"], line["error"]["data"]["reason"] if "error" in line else "done"
send(1, "lease.acquire", purpose="calibrating")
assert answer() == (1, "done")
say("has the lease")
sys.stdin.readline()
send(2, "calibration.load", template="reverse")
send(3, "hello")
say(*answer())
say(*answer())
"""
"""The second line says that the daemon has read the request, the third what became of it."""

STOPS = """
s = socket.socket(socket.AF_UNIX); s.connect(path); f = s.makefile("rb")
s.sendall(b'{"jsonrpc":"2.0","id":1,"method":"stop"}\\n')
assert "result" in json.loads(f.readline())
say("stopped")
"""

Meanwhile = Callable[[DaemonProcess, Client], None]


def root_takes_the_lease(_running: DaemonProcess, root: Client) -> None:
    root.result("lease.take", why="it hangs")


def root_took_the_lease_and_gave_it_back(_running: DaemonProcess, root: Client) -> None:
    root.result("lease.take", why="it hangs")
    root.result("lease.release")


def another_user_stops(running: DaemonProcess, _root: Client) -> None:
    with script(BOB, STOPS, running.socket_path) as bob:
        assert said(bob) == "stopped"


def nobody_does_anything(_running: DaemonProcess, _root: Client) -> None:
    pass


@pytest.mark.parametrize(
    ("meanwhile", "outcome", "mount"),
    [
        (root_takes_the_lease, "lease_lost", "normal"),
        (root_took_the_lease_and_gave_it_back, "lease_lost", "normal"),
        (another_user_stops, "sent_before_stop", "normal"),
        (nobody_does_anything, "done", "reverse"),
    ],
)
def test_a_calibration_found_after_its_user_lost_the_say_is_not_taken(
    shared: DaemonProcess,
    meanwhile: Meanwhile,
    outcome: str,
    mount: str,
) -> None:
    with shared.connect() as root, script(ALICE, ASKS, shared.socket_path) as alice:
        assert said(alice) == "has the lease"
        before = root.result("calibration.get")
        helper = root.result("health")["helper"]["pid"]
        os.kill(helper, signal.SIGSTOP)  # as long as its disk hangs
        try:
            wake(alice)
            assert said(alice) == "3 done"
            meanwhile(shared, root)
        finally:
            os.kill(helper, signal.SIGCONT)
        assert said(alice) == f"2 {outcome}"
        after = root.result("calibration.get")
        assert after["mount"] == mount
        assert (after == before) is (mount == "normal")
