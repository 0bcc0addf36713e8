"""A daemon that is frozen, or hangs, while somebody waits for it."""

import re
from collections.abc import Callable
from types import SimpleNamespace

import pytest

from litegrip_client import CANTimeoutError, ConnectError, LiteGrip
from tests.client.rig import SILENT, Bench, Ctl, Heard, Kind, run_ctl

UNKNOWN = "what the jaws do is not known; to be sure, cut the motor's power"
NOT_OFF = "the motor is not known to be off, cut its power"
NOT_DISABLED = "can0: the motor could not be disabled, cut its power: the daemon does not answer"
NOT_OFF_GONE = "can0: the motor could not be disabled"
GONE = (
    f"{NOT_OFF_GONE}: the daemon ended the connection: if it is gone, the motor should soon let go"
    " by itself, and what was held falls; if it does not, cut its power"
)
NOT_OFF_ENDING = "can0: nothing has confirmed that the motor is off"
ENDED = (
    "the daemon ended the connection: the daemon has ended; the motor is off, and what was held"
    " falls"
)
ENDING = "the daemon is about to end: it disables the motor, and what was held falls"


@pytest.fixture
def ctl(daemon: Heard, capsys: pytest.CaptureFixture[str]) -> Ctl:
    return run_ctl(capsys)


def test_a_motion_does_not_wait_for_a_frozen_daemon(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    began_s = site.now_s
    site.after(0.3, daemon.freeze)
    with pytest.raises(ConnectError, match=f"not answered for 5 s: {UNKNOWN}") as caught:
        enabled.close(speed_mm_s=10.0)
    assert caught.value.reason == "no_answer"
    assert site.now_s - began_s == pytest.approx(5.8, abs=0.6)
    assert daemon.methods()[-2:] == ["state.get", "job.cancel"]
    daemon.thaw()
    assert enabled.get_state().mode == "holding"


def test_a_stop_that_a_frozen_daemon_does_not_confirm_says_to_cut_the_power(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    began_s = site.now_s
    daemon.freeze()
    with pytest.raises(ConnectError) as caught:
        enabled.software_stop()
    assert site.now_s - began_s < 2.2
    told = "the stop is not confirmed and may still act, cut the motor's power: the daemon did not"
    assert caught.value.message.startswith(told)
    daemon.thaw()
    assert enabled.get_state().mode == "holding"


def test_the_end_of_a_subscription_does_not_wait_for_a_frozen_daemon(
    site: Bench, daemon: Heard, enabled: LiteGrip, caplog: pytest.LogCaptureFixture
) -> None:
    began_s = site.now_s
    site.after(0.3, daemon.freeze)
    with (
        pytest.raises(ConnectError, match="did not answer with a state sample") as caught,
        enabled.states(hz=50) as states,
    ):
        for _ in states:
            pass
    assert caught.value.__context__ is None
    assert caplog.messages == []
    assert site.now_s - began_s == pytest.approx(5.4, abs=0.6)
    daemon.thaw()
    assert enabled.get_state().mode == "holding"
    assert daemon.methods()[-2:] == ["state.unsubscribe", "state.get"]


def test_a_motion_that_a_frozen_daemon_never_read_is_cancelled_when_it_goes_on(
    daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.freeze()
    with pytest.raises(ConnectError, match=UNKNOWN):
        enabled.close(speed_mm_s=10.0)
    daemon.thaw()
    assert enabled.get_state().mode in ("moving", "holding")
    assert enabled.get_state().mode == "holding"


def test_a_daemon_that_answers_meanwhile_is_waited_for(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.late["motion.open"] = 20.0
    began_s = site.now_s
    assert enabled.open().ok
    assert site.now_s - began_s > 20.0
    assert daemon.methods().count("state.get") == pytest.approx(9, abs=2)


def test_questions_do_not_prolong_a_time_limit(
    site: Bench, daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    daemon.instead["motor.disable"] = SILENT
    began_s = site.now_s
    call = re.escape(f"{kind.awaits}gripper.disable()")
    with pytest.raises(ConnectError, match=f"did not answer {call} within 30 s"):
        enabled.disable()
    assert site.now_s - began_s == pytest.approx(30.0, abs=0.1)
    daemon.instead.clear()


@pytest.mark.parametrize(
    ("ask", "named"),
    [
        (lambda gripper: gripper.get_state(), "{}gripper.get_state() within 5 s"),
        (lambda gripper: gripper.software_stop(), "{}gripper.software_stop() within 1 s"),
        (lambda gripper: gripper.events().__enter__(), "gripper.events() within 5 s"),
        (lambda gripper: gripper.cancel(), "{}gripper.jobs() within 5 s"),
    ],
)
def test_who_gets_no_answer_is_told_of_which_call(
    daemon: Heard, enabled: LiteGrip, kind: Kind, ask: Callable[[LiteGrip], object], named: str
) -> None:
    daemon.freeze()
    with pytest.raises(ConnectError) as caught:
        ask(enabled)
    daemon.thaw()
    told = f"the daemon did not answer {named.format(kind.awaits)}"
    assert caught.value.message.endswith(told)


def test_a_time_in_which_this_process_stood_is_no_silence(
    site: Bench, daemon: Heard, enabled: LiteGrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    stood_s = 0.0

    def wake() -> None:
        nonlocal stood_s
        stood_s = 600.0

    clock = SimpleNamespace(monotonic=lambda: site.now_s + stood_s)
    enabled.goto(10.0)
    monkeypatch.setattr("litegrip_client.line.exchange.time", clock)
    site.after(0.3, daemon.freeze)
    site.after(4.5, wake)
    site.after(8.0, daemon.thaw)
    assert enabled.open(speed_mm_s=10.0).ok


def test_an_interrupt_names_the_danger_once_and_soon(
    site: Bench, daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(kind.interrupted), kind.gripper() as gripper:  # noqa: PT012 - the block's end
        gripper.enable()
        began_s = site.now_s
        site.after(0.3, daemon.freeze)
        kind.interrupt(1.0)
        gripper.close(speed_mm_s=10.0)
    assert site.now_s - began_s < 7.0
    (told,) = caplog.messages
    assert told == (
        f"the interrupted {kind.awaits}gripper.close() could not be cancelled: the daemon has not"
        f" answered for 2 s: {UNKNOWN}"
    )


@pytest.mark.parametrize(
    ("move", "called"),
    [
        (lambda g: g.move_at_speed(45, 5), "move_at_speed"),
        (lambda g: g.goto_rad(-0.5), "goto_rad"),
        (lambda g: g.goto_openness(0.2), "goto_openness"),
        (lambda g: g.calibrate(), "calibrate"),
    ],
)
def test_an_interrupt_names_the_call_that_was_made(
    site: Bench,
    daemon: Heard,
    kind: Kind,
    caplog: pytest.LogCaptureFixture,
    move: Callable[[LiteGrip], object],
    called: str,
) -> None:
    with pytest.raises(kind.interrupted), kind.gripper() as gripper:  # noqa: PT012 - the block's end
        gripper.enable()
        site.after(0.1, daemon.freeze)
        kind.interrupt(0.2)
        move(gripper)
    (told,) = caplog.messages
    assert told.startswith(f"the interrupted {kind.awaits}gripper.{called}() could not")


def test_the_end_of_a_block_names_the_danger(site: Bench, daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper()
    gripper.connect()
    gripper.enable()
    daemon.freeze()
    began_s = site.now_s
    with pytest.raises(ConnectError, match=NOT_DISABLED):
        gripper.disconnect()
    assert site.now_s - began_s < 6.0


def test_a_warning_at_the_end_of_a_block_names_the_danger(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ZeroDivisionError), kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        daemon.freeze()
        raise ZeroDivisionError
    assert caplog.messages == [NOT_DISABLED]


@pytest.mark.parametrize(
    ("end", "told"),
    [
        (Heard.hang_up, GONE),
        (lambda daemon: daemon.controller.shut_down(), f"{NOT_OFF_ENDING}: {ENDING}"),
        (Heard.end, f"can0: {ENDED}"),
    ],
    ids=["killed", "ending", "ended"],
)
def test_the_end_of_a_block_names_the_danger_when_the_daemon_is_gone(
    daemon: Heard, kind: Kind, end: Callable[[Heard], None], told: str
) -> None:
    gripper = kind.gripper()
    gripper.connect()
    gripper.enable()
    end(daemon)
    with pytest.raises(ConnectError) as caught:
        gripper.disconnect()
    assert caught.value.message == told


def test_a_block_that_sleeps_while_the_daemon_is_ended_is_told_how_to_go_on(
    site: Bench, daemon: Heard, kind: Kind
) -> None:
    with pytest.raises(ConnectError) as caught, kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        site.after(0.3, daemon.end)
        kind.pause(3.0)
    assert (caught.value.reason, caught.value.message) == ("shutting_down", f"can0: {ENDED}")
    call = f"{kind.awaits}gripper."
    assert caught.value.hint == (
        f"start the daemon again; {call}connect() connects again, then: {call}enable()"
    )


@pytest.mark.parametrize(
    "read",
    [
        lambda gripper: [None for _ in gripper.states(50)],
        lambda gripper: [None for _ in gripper.events(("bus",))],
    ],
    ids=["states", "events"],
)
def test_an_orderly_end_that_the_block_has_raised_is_not_told_again(
    daemon: Heard,
    site: Bench,
    kind: Kind,
    caplog: pytest.LogCaptureFixture,
    read: Callable[[LiteGrip], object],
) -> None:
    with pytest.raises(ConnectError) as caught, kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        site.after(0.3, daemon.end)
        read(gripper)
    assert (caught.value.message, caplog.messages) == (ENDED, [])


def test_an_orderly_end_behind_another_error_is_told_whole(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ZeroDivisionError), kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        daemon.end()
        raise ZeroDivisionError
    assert caplog.messages == [f"can0: {ENDED}"]


def test_a_daemon_that_ended_while_its_motor_was_silent_says_to_cut_the_power(
    daemon: Heard, kind: Kind
) -> None:
    gripper = kind.gripper()
    gripper.connect()
    gripper.enable()
    daemon.gripper.power_off()
    daemon.end()
    with pytest.raises(ConnectError, match=f"{NOT_OFF_ENDING}: .*: cut its power"):
        gripper.disconnect()


def test_a_warning_behind_a_motion_names_the_danger_when_the_daemon_is_gone(
    site: Bench, daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ConnectError) as caught, kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        site.after(0.3, daemon.hang_up)
        gripper.close(speed_mm_s=10.0)
    assert f"{NOT_OFF_GONE}: {caught.value.message}" == GONE
    assert caplog.messages == [NOT_OFF_GONE]


def test_who_waits_when_the_daemon_is_ended_is_told_once_what_it_does_and_how_to_go_on(
    site: Bench, daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ConnectError) as caught, kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        site.after(0.3, daemon.controller.shut_down)
        gripper.goto(5.0, duration=5.0)
    assert caught.value.message == ENDING
    call = f"{kind.awaits}gripper."
    assert caught.value.hint == (
        f"start the daemon again; {call}connect() connects again, then: {call}enable()"
    )
    assert caplog.messages == [NOT_OFF_ENDING]


@pytest.mark.parametrize("is_moving", [True, False])
def test_an_orderly_end_is_no_alarm_at_the_end_of_a_block(
    site: Bench, daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture, is_moving: bool
) -> None:
    """The motor is off a moment after the daemon has begun to end, and its last line says so."""

    def end() -> None:
        daemon.controller.shut_down()
        site.after(0.2, daemon.end)

    with pytest.raises(ConnectError) as caught, kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        if is_moving:
            site.after(0.3, end)
            gripper.goto(5.0, duration=5.0)
        end()
    assert caplog.messages == []
    told = ENDING if is_moving else f"can0: {ENDED}"
    assert caught.value.message == told


def test_what_is_told_once_is_told_again_of_another_silence(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ZeroDivisionError), kind.gripper() as gripper:  # noqa: PT012 - as above
        gripper.enable()
        daemon.freeze()
        with pytest.raises(ConnectError, match=UNKNOWN):
            gripper.close()
        daemon.thaw()
        gripper.get_state()
        daemon.freeze()
        raise ZeroDivisionError
    assert caplog.messages == [NOT_DISABLED]


def test_disabling_a_silent_motor_says_that_it_may_be_enabled(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    daemon.gripper.power_off()
    kind.pause(1.0)
    with pytest.raises(CANTimeoutError, match=NOT_OFF):
        enabled.disable()
    daemon.gripper.power_on()
    kind.pause(1.0)


# The shell


def test_the_shell_does_not_wait_for_a_frozen_daemon(site: Bench, daemon: Heard, ctl: Ctl) -> None:
    assert ctl("enable")[0] == 0
    site.after(0.3, daemon.freeze)
    code, _, told = ctl("close", "--speed", "10")
    assert code == 3
    assert told.startswith(f"litegripctl: the daemon has not answered for 5 s: {UNKNOWN}\n")


def test_the_shell_tells_a_failed_cancelling_once(
    site: Bench, daemon: Heard, ctl: Ctl, caplog: pytest.LogCaptureFixture
) -> None:
    assert ctl("enable")[0] == 0
    site.after(0.3, daemon.freeze)

    def interrupt() -> None:
        raise KeyboardInterrupt

    site.after(1.0, interrupt)
    code, _, told = ctl("close", "--speed", "10")
    assert code == 130
    assert told == (
        "litegripctl: interrupted, but the motion could NOT be cancelled:"
        f" the daemon has not answered for 2 s: {UNKNOWN}\n"
    )
    assert not caplog.messages
