"""The line to a successor, what goes over it, and what the service manager is told."""

import os
import select
import socket
import time
from pathlib import Path

import pytest

from litegripd.handover.predecessor import Link, read_document, write_document
from litegripd.io.helper.child import Child, start_here
from litegripd.io.loop import PeriodicTimer
from litegripd.io.sockets import occupy, take_over

DEADLINE_S = 20.0


def test_packets_come_whole_in_their_order_and_with_their_descriptors() -> None:
    ours, inherited = Link.pair()
    theirs = Link(inherited)
    reader, writer = os.pipe()
    ours.send("one", (writer,), number=1)
    ours.send("two")
    os.close(writer)
    first = theirs.wait(DEADLINE_S)
    assert first is not None
    assert (first.kind, first.body) == ("one", {"number": 1})
    (copy,) = first.descriptors
    assert not os.get_inheritable(copy)
    os.write(copy, b"x")
    assert os.read(reader, 1) == b"x"
    second = theirs.receive()
    assert second is not None
    assert second.kind == "two"
    assert theirs.receive() is None
    assert not theirs.has_ended
    ours.close()
    assert theirs.wait(DEADLINE_S) is None
    assert bool(theirs.has_ended) is True
    with pytest.raises(OSError, match="Broken pipe"):
        theirs.send("three")
    theirs.close()
    for descriptor in (copy, reader):
        os.close(descriptor)


def test_a_document_may_be_larger_than_any_packet() -> None:
    content = {"text": "x" * 3_000_000, "number": float("inf")}
    assert read_document(write_document(content)) == content


def test_places_change_hands_while_clients_connect(tmp_path: Path) -> None:
    path = tmp_path / "rpc.sock"
    before = occupy("test", str(tmp_path), path, None)
    after = take_over("test", str(tmp_path), path, [os.dup(fd) for fd in before.descriptors])
    with socket.socket(socket.AF_UNIX) as early:
        early.connect(str(path))
        for place in (before.claim, before.stops, before.requests):
            place.close()
        with socket.socket(socket.AF_UNIX) as late:
            late.connect(str(path))
            after.name_owner()
            for _ in range(2):
                after.requests.accept()[0].close()
            assert early.recv(1) == b""
            assert late.recv(1) == b""
    assert after.stop_path.exists()
    after.remove()
    assert not path.exists()
    assert not after.stop_path.exists()
    for place in (after.claim, after.stops, after.requests):
        place.close()


def test_a_child_that_was_handed_over_is_ended_by_its_new_owner() -> None:
    child = start_here("tests.io.helper_for_tests")
    assert child.pidfd is not None
    taken = Child(child.socket.dup(), child.pid, os.dup(child.pidfd))
    pidfd = os.dup(child.pidfd)
    child.let_go()
    assert not taken.has_ended
    taken.close()
    assert select.select([pidfd], [], [], DEADLINE_S)[0]
    os.close(pidfd)


def test_a_timer_goes_on_in_a_rhythm_that_is_given() -> None:
    first_s = time.monotonic() + 0.02
    timer = PeriodicTimer(0.005, first_s)
    assert timer.next_due_s == pytest.approx(first_s, abs=1e-6)
    assert timer.wait() >= 1
    assert time.monotonic() >= first_s
    timer.close()


def test_last_words_are_heard_of_one_that_has_not_listened() -> None:
    ours, inherited = Link.pair()
    theirs = Link(inherited)
    ours.send("hello")
    theirs.send("refused", why="the configuration")
    assert not ours.is_left()
    theirs.close()
    assert ours.is_left()
    packet = ours.wait(DEADLINE_S)
    assert packet is not None
    assert packet.body == {"why": "the configuration"}
    assert ours.receive() is None
    assert ours.has_ended
    ours.close()
