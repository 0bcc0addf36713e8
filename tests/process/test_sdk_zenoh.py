"""The package's own ends of a zenoh link: a leader that listens, a follower that connects to it."""

import sys
import threading
import time
from collections.abc import Callable

import pytest

from litegrip_client import as_sdk
from tests.process.daemon_process import DEADLINE_S
from tests.process.teleop_pair import free_port

if as_sdk.FOLDER not in sys.path:
    sys.path.insert(0, as_sdk.FOLDER)

import litegrip
from litegrip.zenoh_link import Connector, LatestSlot, Listener, ZenohTeleopTransport

KEY, READY = litegrip.teleop_topic("x"), litegrip.ready_topic("x")
_SOON = threading.Event()


def until(condition: Callable[[], object], meanwhile: Callable[[], object]) -> None:
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s, "it did not happen in time"
        meanwhile()
        _SOON.wait(0.02)


def test_frames_and_ready_bytes_cross_whoever_comes_first() -> None:
    port = free_port()
    taken: list[bytes] = []
    frame = litegrip.encode_frame(0.5, 40.0, 0.0, 1.0)
    connector = Connector("127.0.0.1", port, KEY, taken.append, READY)
    with Listener(port, KEY, READY) as listener:
        said = listener.ready_subscription()
        until(lambda: connector.received, lambda: listener.put(frame))
        assert listener.matching
        assert (connector.latest(), taken[0]) == (frame, frame)
        heard: list[bytes] = []

        def say() -> None:
            connector.put_ready(litegrip.encode_ready_frame(True))
            payload = said.try_recv()
            heard.extend([] if payload is None else [payload])

        until(lambda: heard, say)
        assert heard[0] == b"\x01"
        with pytest.raises(ValueError, match="ready frame"):
            connector.put_ready(b"")
        connector.close()


def test_a_transport_has_one_key() -> None:
    port = free_port()
    leads = ZenohTeleopTransport("master", KEY, port, ready_key=READY)
    follows = ZenohTeleopTransport("slave", KEY, port, "127.0.0.1", READY)
    came, ready = follows.sub(KEY), leads.sub(READY)
    got: list[bytes] = []

    def send() -> None:
        leads.pub(KEY, b"frame")
        follows.pub(READY, b"\x01")
        payload = came.drain_latest()
        got.extend([] if payload is None else [payload])

    until(lambda: got and ready.try_recv() == b"\x01", send)
    assert (got[0], leads.matching, follows.matching) == (b"frame", True, None)
    assert follows.received > 0
    for end, topic in ((leads, "another"), (follows, "another")):
        with pytest.raises(litegrip.TeleopError):
            end.pub(topic, b"")
        with pytest.raises(litegrip.TeleopError):
            end.sub(topic)
    leads.close()
    follows.close()
    with pytest.raises(ValueError, match="role"):
        ZenohTeleopTransport("both", KEY)
    with pytest.raises(ValueError, match="host"):
        ZenohTeleopTransport("slave", KEY)


def test_a_slot_keeps_the_newest_and_counts_what_nobody_took() -> None:
    slot = LatestSlot()
    assert (slot.take(), slot.ever_received, slot.peek_age(1.0)) == ((None, None), False, None)
    slot.put(b"a", 1.0)
    slot.put(b"b", 2.0)
    assert (slot.dropped, slot.peek_age(5.0), slot.peek_age(0.0)) == (1, 3.0, 0.0)
    assert slot.take() == (b"b", 2.0)
    assert slot.take() == (None, 2.0)
    assert slot.ever_received
