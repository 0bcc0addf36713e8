"""The cable between machines: it does what is wrong with it, and nothing else."""

import contextlib
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import DEADLINE_S
from tests.process.fleet.cable import Fault
from tests.process.fleet.machines import Machines, machines, missing

pytestmark = pytest.mark.skipif(missing() is not None, reason=str(missing()))

PORT = 4000
AT_ONCE = 50
"""So many datagrams find room in a socket that is not read."""


@pytest.fixture
def two() -> Iterator[Machines]:
    with machines("a", "b") as made:
        yield made


def datagrams(made: Machines) -> tuple[socket.socket, socket.socket]:
    """Return a socket on a, connected to one on b."""
    sender, receiver = (made.socket(name, socket.SOCK_DGRAM) for name in "ab")
    receiver.bind((made.addresses["b"], PORT))
    sender.connect((made.addresses["b"], PORT))
    return sender, receiver


def arrived(made: Machines, numbers: range) -> list[int]:
    """Send numbers from a to b; return those that arrive, in the order in which they do."""
    sender, receiver = datagrams(made)
    found: list[int] = []
    with sender, receiver:
        for begin in range(numbers.start, numbers.stop, AT_ONCE):
            before = made.packets()
            some = numbers[begin : begin + AT_ONCE]
            for number in some:
                sender.send(number.to_bytes(4, "big"))
            while sum(after := made.packets()) - sum(before) < len(some):
                pass
            count = after[0] - before[0]
            found += [int.from_bytes(receiver.recv(64), "big") for _ in range(count)]
    return found


def test_a_sound_cable_passes_everything_in_order(two: Machines) -> None:
    assert arrived(two, range(500)) == list(range(500))


def test_machines_know_each_other_by_name_and_see_no_network_but_the_cable(two: Machines) -> None:
    program = "import socket; print(socket.gethostbyname('b'), socket.if_nameindex())"
    command = [*two.on("a"), sys.executable, "-c", program]
    said = subprocess.run(command, stdout=subprocess.PIPE, text=True, check=True).stdout
    assert said == f"{two.addresses['b']} [(1, 'lo'), (2, 'eth0')]\n"


@pytest.mark.parametrize("name", [None, "a", "b"])
def test_what_is_delayed_arrives_late_and_in_order(two: Machines, name: str | None) -> None:
    two.fault(name, Fault(delay_s=0.1))
    began_s = time.monotonic()
    assert arrived(two, range(AT_ONCE)) == list(range(AT_ONCE))
    assert 0.1 <= time.monotonic() - began_s < 1.0
    two.fault(name)
    assert arrived(two, range(AT_ONCE)) == list(range(AT_ONCE))


def test_delays_of_both_ends_add_up(two: Machines) -> None:
    for name in "ab":
        two.fault(name, Fault(delay_s=0.1))
    began_s = time.monotonic()
    assert arrived(two, range(1)) == [0]
    assert time.monotonic() - began_s >= 0.2


def test_what_is_late_by_chance_arrives_out_of_order(two: Machines) -> None:
    two.fault(None, Fault(jitter_s=0.05))
    found = arrived(two, range(AT_ONCE))
    assert sorted(found) == list(range(AT_ONCE))
    assert found != sorted(found)


def test_a_share_is_lost_and_a_seed_says_which() -> None:
    runs = []
    for seed in (1, 1, 2):
        with machines("a", "b", seed=seed) as made:
            made.fault("a", Fault(loss=0.3))
            runs.append(arrived(made, range(1000)))
    assert runs[0] == runs[1] != runs[2]
    for found in runs:
        assert found == sorted(found)
        assert 600 < len(found) < 800  # seven times the standard deviation


@pytest.mark.parametrize("name", [None, "a", "b"])
def test_what_meets_a_cut_never_arrives(two: Machines, name: str | None) -> None:
    sender, receiver = datagrams(two)
    with sender, receiver:
        two.fault(None, Fault(delay_s=0.3))
        sender.send(b"on its way")
        while two.packets() != (1, 0):
            pass
        two.fault(name, Fault(delay_s=0.3, cut=True))
        sender.send(b"into the cut")
        while two.packets() != (0, 2):
            pass
        two.fault(None)
        two.fault(name)
        sender.send(b"after it")
        assert receiver.recv(64) == b"after it"


def test_a_connection_lives_through_loss_and_disorder(two: Machines) -> None:
    two.fault("a", Fault(delay_s=0.005, jitter_s=0.01, loss=0.1))
    content = os.urandom(100_000)
    with two.socket("b", socket.SOCK_STREAM) as listener:
        listener.bind((two.addresses["b"], PORT))
        listener.listen()
        with two.socket("a", socket.SOCK_STREAM) as sender:
            sender.connect((two.addresses["b"], PORT))
            receiver, _ = listener.accept()
            receiver.settimeout(DEADLINE_S)
            sender.sendall(content)
            sender.shutdown(socket.SHUT_WR)
            with receiver, receiver.makefile("rb") as stream:
                assert stream.read() == content
    assert two.packets()[1] > 0


def left_of(prefix: str) -> list[Path]:
    left: list[Path] = []
    for place in (Path("/run/netns"), Path("/etc/netns")):
        with contextlib.suppress(FileNotFoundError):  # another test has ended with it
            left += list(place.glob(f"{prefix}-*"))
    return left


def test_nothing_is_left_even_of_a_program_that_is_killed() -> None:
    program = (
        "import os, sys; from tests.process.fleet.machines import Machines\n"
        "made = Machines('a', 'b'); print(made.namespace('')[:-1], made._process.pid, flush=True)\n"
        "sys.stdin.readline(); os.kill(os.getpid(), 9)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as user:
        assert user.stdout is not None
        prefix, _pid = user.stdout.readline().split()
        assert len(left_of(prefix)) == 4
        user.communicate("\n", timeout=DEADLINE_S)
        ends_s = time.monotonic() + DEADLINE_S
        while left_of(prefix):
            assert time.monotonic() < ends_s
    with machines("a") as made:
        prefix = made.namespace("")
        assert left_of(prefix[:-1])
    assert not left_of(prefix[:-1])
