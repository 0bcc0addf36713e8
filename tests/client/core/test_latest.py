"""The newest state at hand: read without waiting, waited for, and honest about its age."""

import asyncio
import gc
import time
from collections.abc import Iterator
from types import SimpleNamespace

import pytest

from litegrip_client import CommandError, ConnectError, GripperState, LiteGrip, aio
from litegrip_client.line.feeds import Event
from litegrip_client.values import fields
from tests.client.fake_daemon import STATE
from tests.client.rig import Asyncio, Bench, Heard, Kind


def test_the_newest_state_is_read_again_and_again_by_one_subscription(
    site: Bench, daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    with gripper.latest(50) as latest:
        first, began_s = latest.state, site.now_s
        assert isinstance(first, GripperState)
        assert latest.state is first
        assert site.now_s == began_s, "reading waits"
        for _ in range(5):
            kind.pause(0.1)
            assert latest.state.monotonic_s == pytest.approx(site.now_s, abs=0.026)
            assert latest.age_s == pytest.approx(site.now_s - latest.state.monotonic_s)
    assert daemon.methods()[1:] == ["state.subscribe", "state.unsubscribe"]
    assert daemon.asked("state.subscribe") == [{"hz": 50.0}]


def test_a_program_that_looks_seldom_sees_a_new_state(
    site: Bench, gripper: LiteGrip, kind: Kind
) -> None:
    with gripper.latest(200) as latest:
        kind.pause(60.0)
        assert latest.state.monotonic_s == pytest.approx(site.now_s, abs=0.011)


def test_newer_states_are_waited_for_and_none_comes_twice(site: Bench, gripper: LiteGrip) -> None:
    with gripper.latest(50) as latest:
        seen = [latest.wait_newer() for _ in range(5)]
        assert latest.state is seen[-1]
        stamps = [one.monotonic_s for one in seen]
        assert stamps == sorted(set(stamps))
        assert stamps[-1] - stamps[0] == pytest.approx(0.08, abs=0.011)


def test_the_age_of_the_motors_feedback_grows_while_the_bus_is_cut(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    with gripper.latest() as latest:
        kind.pause(0.2)
        age_s = latest.feedback_age_s
        assert age_s is not None
        assert age_s < 0.1
        daemon.gripper.power_off()
        kind.pause(1.0)
        assert latest.age_s < 0.03
        aged_s = latest.feedback_age_s
        assert aged_s is not None
        assert aged_s == pytest.approx(1.0, abs=0.1)


def test_a_silent_daemon_shows_in_the_age_and_ends_the_waiting(
    site: Bench, daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    daemon.instead["state.subscribe"] = {"subscription": 5, "state": daemon.wire_state}
    daemon.instead["state.unsubscribe"] = {"subscription": 5}
    with gripper.latest(50) as latest:
        kind.pause(2.0)
        assert latest.age_s == pytest.approx(2.0, abs=0.03)
        began_s = site.now_s
        with pytest.raises(ConnectError, match=r"a state sample within 0\.1 s") as caught:
            latest.wait_newer(0.1)
        assert caught.value.reason == "no_answer"
        assert site.now_s - began_s == pytest.approx(0.1, abs=0.011)
        with pytest.raises(ConnectError, match=r"within 5\.02 s"):
            latest.wait_newer()
        with pytest.raises(CommandError, match="timeout is 'soon'"):
            latest.wait_newer("soon")  # type: ignore[arg-type]
        with pytest.raises(CommandError, match=r"^timeout is -1, it must be 0 or more$"):
            latest.wait_newer(timeout=-1)


def test_the_age_counts_from_the_arrival_where_the_daemons_clock_is_another(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    state = daemon.wire_state
    state["monotonic_s"] += 5e6
    daemon.instead["state.subscribe"] = {"subscription": 5, "state": state}
    daemon.instead["state.unsubscribe"] = {"subscription": 5}
    gripper._session.connection.has_clock = False
    with gripper.latest(50) as latest:
        kind.pause(0.5)
        assert latest.age_s == pytest.approx(0.5, abs=0.02)


def test_the_end_of_the_connection_is_raised_by_all(site: Bench, daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper()
    gripper.connect()
    with gripper.latest() as latest:
        site.after(0.1, daemon.hang_up)
        with pytest.raises(ConnectError, match="ended the connection"):
            [latest.wait_newer() for _ in range(20)]
        for read in (lambda: latest.state, lambda: latest.age_s, lambda: latest.feedback_age_s):
            with pytest.raises(ConnectError, match="ended the connection") as caught:
                read()
            assert str(caught.value.hint).endswith("; after that, begin again: gripper.latest()")
    gripper.disconnect()


def test_a_closed_one_has_no_state(daemon: Heard, gripper: LiteGrip) -> None:
    with gripper.latest(0.1) as latest:
        pass
    latest.close()
    with pytest.raises(ConnectError, match="was closed"):
        _ = latest.state
    with pytest.raises(ConnectError, match="was closed"):
        latest.wait_newer()
    assert daemon.methods().count("state.unsubscribe") == 1


def test_closing_wakes_a_thread_that_waits(site: Bench, daemon: Heard) -> None:
    with LiteGrip() as gripper, gripper.latest(0.1) as latest:

        def close() -> None:
            site.run(0.1)
            latest.close()

        site.turns.threading.Thread(target=close).start()
        began_s = site.now_s
        with pytest.raises(ConnectError, match="was closed"):
            latest.wait_newer()
        assert site.now_s - began_s == pytest.approx(0.1, abs=0.02)


def test_closing_wakes_a_task_that_waits(daemon: Heard, tasks: Asyncio) -> None:
    async def scene(gripper: aio.LiteGrip) -> None:
        async with gripper.latest(0.1) as latest:
            waiting = asyncio.create_task(latest.wait_newer())
            await asyncio.sleep(0.1)
            await latest.close()
            with pytest.raises(ConnectError, match="was closed"):
                await waiting

    tasks.use(scene)


def test_one_that_nobody_has_any_more_ends_with_its_next_state(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    gripper.latest(50).wait_newer()
    gc.collect()
    kind.pause(0.1)
    assert daemon.methods()[-1] == "state.unsubscribe"


def test_a_rate_that_cannot_be_is_refused(gripper: LiteGrip) -> None:
    with pytest.raises(CommandError, match="hz"):
        gripper.latest(0.0).__enter__()
    with pytest.raises(CommandError, match="hz is"):
        gripper.latest(True)


@pytest.fixture
def clocks(monkeypatch: pytest.MonkeyPatch) -> Iterator[SimpleNamespace]:
    """Return two clocks that stand still until they are set."""
    clocks = SimpleNamespace(wall_s=1.8e9, monotonic_s=500.0)
    fake = SimpleNamespace(time=lambda: clocks.wall_s, monotonic=lambda: clocks.monotonic_s)
    monkeypatch.setattr(fields, "time", fake)
    yield clocks
    monkeypatch.undo()
    fields.unix_time(time.monotonic())


def test_the_time_of_day_of_the_feedback_follows_a_clock_that_is_set(
    clocks: SimpleNamespace,
) -> None:
    state = GripperState.from_wire({**STATE, "feedback_s": 499.5})
    assert state.timestamp == pytest.approx(1.8e9 - 0.5, abs=1e-3)
    clocks.wall_s -= 3600.0
    assert state.timestamp == pytest.approx(1.8e9 - 3600.5, abs=1e-3)
    assert Event(1, 499.5, "motor", "", {}).timestamp == state.timestamp


def test_the_same_feedback_has_the_same_time_of_day(clocks: SimpleNamespace) -> None:
    state = GripperState.from_wire({**STATE, "feedback_s": 499.5})
    first = state.timestamp
    clocks.wall_s += 0.0004  # as long as it takes to look at one clock and then at the other
    assert state.timestamp == first
