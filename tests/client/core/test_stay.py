"""What ends the wait of `set_force` and `enter_zero_gravity`, which is no motion of the daemon."""

from collections.abc import Callable, Iterator
from typing import Any

import pytest

from litegrip_client import (
    CancelledError,
    ConnectError,
    HardwareError,
    LeaseError,
    LiteGrip,
    LiteGripError,
    StoppedError,
)
from tests.client.core.test_cancel import beside
from tests.client.rig import Asyncio, Bench, Heard, Kind, Threads

Wait = Callable[[LiteGrip], Any]

AT_S, NOTICED_S, LONG_S = 0.45, 0.15, 30.0


def with_force(gripper: LiteGrip) -> bool:
    return gripper.set_force(5.0, duration=LONG_S)


def slack(gripper: LiteGrip) -> bool:
    return gripper.enter_zero_gravity(LONG_S)


@pytest.fixture(
    params=[(Threads, with_force), (Asyncio, with_force), (Threads, slack)],
    ids=["threads-force", "asyncio-force", "threads-slack"],
)
def used(request: pytest.FixtureRequest) -> Any:
    """Return each kind with each call of it that waits: the vendor's is for threads only."""
    return request.param


@pytest.fixture
def kind(used: tuple[type[Kind], Wait], site: Bench) -> Iterator[Kind]:
    kind = used[0](site)
    yield kind
    kind.close()


@pytest.fixture
def wait(used: tuple[type[Kind], Wait]) -> Wait:
    return used[1]


def a_stop(daemon: Heard) -> None:
    daemon.client(uid=0).result("stop", level="hold", why="a visitor")


def a_cleared_stop(daemon: Heard) -> None:
    a_stop(daemon)
    daemon.client(uid=0).result("stop.clear")


def a_taking(daemon: Heard) -> None:
    daemon.client().result("lease.take", why="maintenance")


def a_fault(daemon: Heard) -> None:
    daemon.gripper.latch_fault(0xE)


@pytest.mark.parametrize(
    ("happens", "kind_of_error", "told"),
    [
        (a_stop, StoppedError, "a visitor"),
        (a_cleared_stop, StoppedError, "a visitor"),
        (a_taking, LeaseError, "maintenance"),
        (a_fault, HardwareError, "overload"),
    ],
)
def test_what_ends_a_motion_ends_it_at_once(
    site: Bench,
    daemon: Heard,
    enabled: LiteGrip,
    wait: Wait,
    happens: Callable[[Heard], None],
    kind_of_error: type[LiteGripError],
    told: str,
) -> None:
    began_s = site.now_s
    site.after(AT_S, lambda: happens(daemon))
    with pytest.raises(kind_of_error, match=told):
        wait(enabled)
    assert AT_S <= site.now_s - began_s < AT_S + NOTICED_S


@pytest.mark.parametrize(
    ("happens", "told"),
    [(Heard.end, "the daemon has ended"), (Heard.hang_up, "and what was held falls; if it does")],
)
def test_the_daemons_end_ends_it_at_once(
    site: Bench,
    daemon: Heard,
    kind: Kind,
    wait: Wait,
    happens: Callable[[Heard], None],
    told: str,
) -> None:
    began_s = site.now_s
    site.after(AT_S, lambda: happens(daemon))

    def use() -> None:
        with kind.gripper() as gripper:
            assert gripper.enable()
            wait(gripper)

    with pytest.raises(ConnectError, match=told):
        use()
    assert site.now_s - began_s < AT_S + NOTICED_S


def test_cancel_ends_it_and_the_jaws_hold(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind, wait: Wait
) -> None:
    got: list[bool] = []
    began_s = site.now_s
    with beside(site, kind, AT_S, enabled, got):
        with pytest.raises(CancelledError) as caught:
            wait(enabled)
        assert caught.value.reason == "cancelled"
    assert site.now_s - began_s < AT_S + NOTICED_S
    assert got == [True]
    assert daemon.state.mode == "holding"
    assert len(daemon.asked("motion.hold")) == 1
    assert enabled.cancel() is False
    assert enabled.open()


def test_a_wait_that_was_cancelled_leaves_the_next_motion_alone(site: Bench, daemon: Heard) -> None:
    results: list[Any] = []
    with LiteGrip() as gripper:
        assert gripper.enable()

        def go_on() -> None:
            site.run(AT_S)
            gripper.cancel()
            results.append(gripper.open(20.0))

        thread = site.turns.threading.Thread(target=go_on)
        thread.start()
        with pytest.raises(CancelledError):
            with_force(gripper)
        thread.join()
    assert [bool(result) for result in results] == [True]


def test_a_gripper_without_a_lease_is_waited_for_to_the_end(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    daemon.client().result("motor.enable")
    began_s = site.now_s
    assert gripper.set_force(5.0, duration=1.0)
    assert site.now_s - began_s == pytest.approx(1.0, abs=0.03)
    assert daemon.asked("motion.hold") == []


def test_an_interrupt_ends_slack_jaws(site: Bench, daemon: Heard) -> None:
    with LiteGrip() as gripper:
        assert gripper.enable()
        Threads(site).interrupt(AT_S)
        with pytest.raises(KeyboardInterrupt):
            slack(gripper)
        assert daemon.state.mode == "holding"
