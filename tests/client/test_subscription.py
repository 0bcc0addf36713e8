import threading
from typing import Any

import pytest

from litegrip_client.line.connection import Connection
from litegrip_client.line.feeds import StateSample
from litegrip_client.values.errors import CommandError, ConnectError
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import (
    in_thread,
    interrupt_main_thread,
    interrupt_when_main_thread_reads,
)


def sample(request: Request, seq: int, **more: Any) -> None:
    state = {"seq": seq}
    request.notify(
        "state.sample",
        {"subscription": 5, "seq": seq, "dropped": 0, "monotonic_s": seq / 10, "state": state}
        | more,
    )


@pytest.fixture(autouse=True)
def _subscriptions(daemon: FakeDaemon) -> None:
    def subscribe(request: Request) -> None:
        request.reply({"subscription": 5, "state": STATE})
        for seq in (1, 2, 2, 1, 3):
            sample(request, seq)

    daemon.handlers["state.subscribe"] = subscribe
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 5}


def test_the_present_state_comes_first_and_no_sample_twice(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with connection.subscribe_state(50, ["seq"]) as samples:
        got = [next(samples) for _ in range(4)]
    assert got[0] == StateSample(None, 0, 100.0, {"seq": 7})
    assert [one.seq for one in got[1:]] == [1, 2, 3]
    assert got[3] == StateSample(3, 0, 0.3, {"seq": 3})
    assert daemon.requests[0].params == {"hz": 50.0, "fields": ["seq"]}
    assert daemon.requests[-1].method == "state.unsubscribe"
    assert daemon.requests[-1].params == {"subscription": 5}


def test_closing_ends_the_iteration_and_happens_once(
    daemon: FakeDaemon, connection: Connection
) -> None:
    samples = connection.subscribe_state()
    assert next(samples).state == STATE
    samples.close()
    assert list(samples) == []
    samples.close()
    assert daemon.methods().count("state.unsubscribe") == 1
    assert connection.call("state.get") == STATE


def test_closing_by_another_thread_wakes_who_waits(
    daemon: FakeDaemon, connection: Connection
) -> None:
    samples = connection.subscribe_state()
    read = [next(samples) for _ in range(4)]
    assert len(read) == 4
    waiting = in_thread(lambda: list(samples))
    samples.close()
    assert waiting() == []


def test_calls_between_samples_lose_none(daemon: FakeDaemon, connection: Connection) -> None:
    with connection.subscribe_state() as samples:
        seen = []
        for one in samples:
            assert connection.call("state.get") == STATE
            seen.append(one.seq)
            if one.seq == 3:
                break
    assert seen == [None, 1, 2, 3]


def test_a_daemon_that_ends_ends_the_iteration_by_an_error(
    daemon: FakeDaemon, connection: Connection
) -> None:
    with connection.subscribe_state() as samples:
        for _ in range(4):
            next(samples)
        daemon.hang_up()
        with pytest.raises(ConnectError):
            next(samples)


def test_silence_is_an_error(daemon: FakeDaemon) -> None:
    with Connection(daemon.path) as connection, connection.subscribe_state(200) as samples:
        for _ in range(4):
            next(samples)
        connection.timeout_s = 0.01
        with pytest.raises(ConnectError, match="did not answer with a state sample"):
            next(samples)
        connection.timeout_s = 5.0


def test_a_refused_subscription_raises(daemon: FakeDaemon, connection: Connection) -> None:
    daemon.handlers["state.subscribe"] = lambda request: request.fail("invalid_params", -32602)
    with pytest.raises(CommandError):
        connection.subscribe_state(1000)
    assert connection.call("state.get") == STATE


def test_an_interrupted_subscription_is_ended_when_its_number_comes(
    daemon: FakeDaemon, connection: Connection
) -> None:
    daemon.handlers["state.subscribe"] = lambda request: interrupt_main_thread()
    with pytest.raises(KeyboardInterrupt):
        connection.subscribe_state()
    daemon.requests[0].reply({"subscription": 5, "state": STATE})
    assert connection.call("state.get") == STATE
    assert daemon.wait_for("state.unsubscribe")[0].params == {"subscription": 5}


def test_an_iteration_can_be_interrupted_and_go_on(
    daemon: FakeDaemon, connection: Connection
) -> None:
    samples = connection.subscribe_state()
    for _ in range(4):
        next(samples)
    interrupt_when_main_thread_reads(connection)
    with pytest.raises(KeyboardInterrupt):
        next(samples)
    sample(daemon.requests[0], 4)
    assert next(samples).seq == 4
    samples.close()


def test_a_subscription_and_a_call_by_two_threads(
    daemon: FakeDaemon, connection: Connection
) -> None:
    got_three = threading.Event()
    with connection.subscribe_state() as samples:

        def read() -> list[int | None]:
            seen = []
            for one in samples:
                seen.append(one.seq)
                if one.seq == 3:
                    got_three.set()
                if one.seq == 50:
                    return seen
            return seen

        reader = in_thread(read)
        assert got_three.wait(20.0)
        for seq in range(4, 51):
            assert connection.call("state.get") == STATE
            sample(daemon.requests[0], seq)
        assert reader() == [None, *range(1, 51)]
