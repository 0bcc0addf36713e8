"""A gripper and its daemon: connecting, enabling, what the end does, the lease, and reading."""

import asyncio
import inspect
import os
import re
import traceback
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Literal, get_args

import pytest

from litegrip_client import (
    BusyError,
    CANTimeoutError,
    CommandError,
    ConnectError,
    EnableResult,
    GripperConfig,
    GripperState,
    HardwareError,
    LeaseError,
    LiteGrip,
    MotionConfig,
    ParameterError,
    ProtocolError,
    StoppedError,
    aio,
)
from litegrip_client.core.sockets import STOP_LEVELS
from litegrip_client.values.terms import Voice
from litegrip_client.values.voices import MEANT, in_shell
from litegripd.model.sentence import method_name, with_terms
from tests.client.rig import (
    GUARDS,
    SILENT,
    Asyncio,
    Bench,
    Heard,
    Kind,
    Refuse,
    Threads,
    cancelling,
)

PATH = "/run/litegripd/can0.sock"

# Connecting


def test_the_constructor_connects_to_nothing(daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper("can0", 0x08)
    assert not gripper.is_connected
    with pytest.raises(ConnectError, match="not connected") as caught:
        gripper.open()
    assert "connect()" in str(caught.value)
    assert gripper.connect() is True
    connected = gripper.is_connected
    assert gripper.connect() is True
    gripper.disconnect()
    assert (connected, gripper.is_connected) == (True, False)
    gripper.disconnect()
    assert daemon.methods() == ["hello"]


def test_the_daemon_is_told_which_program_asks(
    daemon: Heard, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["/opt/pick.py"])
    with kind.gripper():
        assert daemon.requests[0].params == {"client": "pick.py"}


def test_the_socket_of_the_environment_is_used(
    daemon: Heard, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", PATH)
    monkeypatch.setenv("XDG_RUNTIME_DIR", "/nowhere")
    with kind.gripper(None) as gripper:
        assert (gripper.is_connected, gripper.channel) == (True, "can0")


@pytest.mark.parametrize("by", ["argument", "variable"])
def test_a_socket_without_a_channel_is_taken_as_it_is(
    site: Bench, kind: Kind, monkeypatch: pytest.MonkeyPatch, by: str
) -> None:
    left, path = Heard("left"), "/run/litegripd/left.sock"
    site.add(left)
    if by == "variable":
        monkeypatch.setenv("LITEGRIPD_SOCKET", path)
    gripper = kind.gripper(None, socket_path=path if by == "argument" else None)
    assert gripper.channel == path
    with pytest.raises(ConnectError, match=f"not connected to the daemon of {path}") as early:
        gripper.get_state()
    assert early.value.channel == path
    left.client().result("stop")
    with gripper:
        assert gripper.channel == "left"
        with pytest.raises(StoppedError) as caught:
            gripper.enable()
    assert caught.value.channel == "left"
    assert not str(caught.value).startswith("left: ")


def test_a_channel_of_the_environment_is_that_of_the_socket(
    site: Bench, kind: Kind, monkeypatch: pytest.MonkeyPatch
) -> None:
    site.add(Heard("left"))
    monkeypatch.setenv("LITEGRIP_CHANNEL", "can0")
    with pytest.raises(CommandError, match="has channel left, not can0") as caught:
        kind.gripper(None, socket_path="/run/litegripd/left.sock").connect()
    assert caught.value.data["hint"].endswith(", or unset LITEGRIP_CHANNEL, which names can0")
    with pytest.raises(CommandError, match="has channel left, not can1") as caught:
        kind.gripper("can1", socket_path="/run/litegripd/left.sock").connect()
    assert "LITEGRIP_CHANNEL" not in caught.value.data["hint"]
    monkeypatch.setenv("LITEGRIPD_SOCKET", "/run/litegripd/left.sock")
    gripper = kind.gripper("can0")  # by its argument: the variable of the same name is not to blame
    for connects in (gripper.connect, gripper.software_stop):
        with pytest.raises(CommandError, match="has channel left, not can0") as caught:
            connects()
        told = "unset LITEGRIPD_SOCKET, which names that socket, or ask for channel left, or for "
        assert caught.value.data["hint"].startswith(told)
        assert "LITEGRIP_CHANNEL" not in caught.value.data["hint"]
    assert caught.value.message.startswith("the stop is not confirmed, cut the motor's power: ")


def test_a_second_object_at_a_socket_is_no_second_gripper(site: Bench, kind: Kind) -> None:
    left, path = Heard("left"), "/run/litegripd/left.sock"
    site.add(left)
    left.client().result("stop")
    with (
        kind.gripper(None, socket_path=path) as one,
        kind.gripper(None, socket_path=path),
        pytest.raises(StoppedError) as caught,
    ):
        one.enable()
    assert not str(caught.value).startswith("left: ")


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"socket_path": 5}, "socket_path is 5, it must be a path"),
        ({"socket_path": b"/tmp/a.sock"}, "socket_path is b'/tmp/a.sock', it must be a path"),
        (
            {"disable_on_disconnect": "no"},
            "disable_on_disconnect is 'no', it must be True or False",
        ),
        ({"disable_on_disconnect": None}, "disable_on_disconnect is None, it must be .*"),
        ({"canfd_mode": "no"}, "canfd_mode is 'no', it must be True or False"),
    ],
)
def test_an_argument_that_cannot_be_is_refused_by_the_constructor(
    kind: Kind, given: dict[str, Any], told: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{told}$"):
        kind.gripper(**given)


def test_a_path_may_be_one_of_pathlib(kind: Kind) -> None:
    given = kind.gripper(socket_path=Path("/tmp/mine.sock"))
    assert given.socket_path == "/tmp/mine.sock"


def test_what_is_not_the_gripper_is_refused_and_leaves_no_connection(
    daemon: Heard, kind: Kind
) -> None:
    with pytest.raises(CommandError, match="has can_id 0x08, not 0x09"):
        kind.gripper("can0", 0x09).connect()
    with pytest.raises(CommandError, match="has channel can0, not can1"):
        kind.gripper("can1", socket_path=PATH).connect()
    with pytest.raises(CommandError, match="cannot be a channel"):
        kind.gripper("../can0")
    with pytest.raises(CommandError, match="3 cannot be a channel: a string of"):
        kind.gripper(3)  # type: ignore[arg-type]
    for hello, says in (({"protocol": 1}, "no litegripd"), ({"protocol": 2}, "speaks protocol 2")):
        daemon.instead["hello"] = hello
        gripper = kind.gripper()
        with pytest.raises(ProtocolError, match=says):
            gripper.connect()
        assert not gripper.is_connected
    assert all(stream.hung_up for stream in daemon.streams)


@pytest.mark.parametrize(
    ("ahead_s", "remote", "has_clock"),
    [
        (0.0, None, True),
        (0.0, {"site": "lab"}, False),
        (-3600.0, None, False),
        (+3600.0, None, False),
        (None, None, True),
    ],
)
def test_the_time_of_sending_is_told_where_the_clock_is_the_daemons(
    site: Bench, daemon: Heard, kind: Kind, ahead_s: float | None, remote: object, has_clock: bool
) -> None:
    """A daemon of another machine has another clock, by which nothing of this one was sent."""
    hello = daemon.client().result("hello")
    clock_s = None if ahead_s is None else site.now_s + ahead_s
    daemon.instead["hello"] = {**hello, "remote": remote, "monotonic_s": clock_s}
    with kind.gripper() as gripper, pytest.raises(HardwareError):
        gripper.hold()
    guards = set(GUARDS) if has_clock else {"stop_generation"}
    assert daemon.requests[-1].params.keys() == guards


def test_a_daemon_that_went_is_noticed_and_connecting_again_works(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    daemon.hang_up()
    kind.pause(0.01)
    assert not gripper.is_connected
    with pytest.raises(ConnectError):
        gripper.get_state()
    with pytest.raises(ConnectError) as again:
        gripper.get_state()
    assert not again.value.retryable
    call = f"{kind.awaits}gripper."
    assert again.value.hint == f"{call}connect() connects again, then: {call}enable()"
    gripper.connect()
    assert gripper.get_state().calibrated


@pytest.mark.parametrize("voice", [in_shell, lambda *_: None], ids=["shell", "none"])
def test_a_reader_who_calls_nothing_is_told_no_call_when_the_daemon_went(
    daemon: Heard, kind: Kind, voice: Voice
) -> None:
    gripper = kind.gripper(voice=voice)
    gripper.connect()
    daemon.hang_up()
    kind.pause(0.01)
    for _ in range(2):
        with pytest.raises(ConnectError) as caught:
            gripper.get_state()
        assert caught.value.hint is None


def test_an_interrupted_connecting_leaves_nothing(daemon: Heard, kind: Kind) -> None:
    daemon.instead["hello"] = SILENT
    gripper = kind.gripper()
    kind.interrupt(0.1)
    with pytest.raises(kind.interrupted):
        gripper.connect()
    assert not gripper.is_connected
    assert daemon.streams[0].hung_up


def test_tasks_that_connect_at_once_share_the_first_connection(
    daemon: Heard, tasks: Asyncio
) -> None:
    async def main() -> None:
        gripper = aio.LiteGrip()
        daemon.late["hello"] = 0.1
        slow = asyncio.create_task(gripper.connect())
        await asyncio.sleep(0.01)
        daemon.late["hello"] = 0.01
        await gripper.connect()
        wire = gripper._session.wire
        await slow
        assert gripper._session.wire is wire
        assert [stream.hung_up for stream in daemon.streams] == [True, False]
        await gripper.get_state()
        await gripper.disconnect()

    tasks.run(main())


def test_nobody_sees_the_connection_before_the_mount_is_loaded(
    daemon: Heard, tasks: Asyncio
) -> None:
    async def main() -> None:
        gripper = aio.LiteGrip(mount="reverse")
        daemon.late["calibration.load"] = 0.1
        connecting = asyncio.create_task(gripper.connect())
        while "calibration.load" not in daemon.methods():
            await asyncio.sleep(0.01)
        assert daemon.asked("calibration.load") == [{"template": "reverse"}]
        assert not gripper.is_connected
        with pytest.raises(CommandError):
            await connecting
        assert not gripper.is_connected

    daemon.instead["calibration.load"] = Refuse("calibration_unreadable", -32013)
    tasks.run(main())


# Enabling, and what the end does

ENABLED = ["hello", "lease.acquire", "motor.enable"]
DISABLED = ["motor.disable", "lease.release"]


def test_enable_says_what_shall_happen_when_the_client_is_lost(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    began_s = site.now_s
    result = gripper.enable(retries=5)
    assert isinstance(result, EnableResult)
    assert (bool(result), result.tries, result.state.enabled) == (True, 1, True)
    lease, enable = daemon.requests[-2:]
    assert (lease.method, lease.params["on_lost"]) == ("lease.acquire", "disable")
    assert (enable.plain, enable.params["sent_s"]) == ({"retries": 5}, began_s)
    assert enable.params["stop_generation"] == daemon.state.stop_generation
    gripper.disable_on_disconnect = False
    gripper.enable()
    assert daemon.requests[-2].params["on_lost"] == "hold"


@pytest.mark.parametrize(
    ("at_first", "at_last", "ends"),
    [
        (True, None, DISABLED),
        (False, None, DISABLED[1:]),
        (False, True, DISABLED),
        (True, False, DISABLED[1:]),
    ],
)
def test_leaving_disables_what_was_enabled_here_if_that_is_wished_by_then(
    daemon: Heard, kind: Kind, at_first: bool, at_last: bool | None, ends: list[str]
) -> None:
    with kind.gripper(disable_on_disconnect=at_first) as gripper:
        gripper.enable()
        if at_last is not None:
            gripper.disable_on_disconnect = at_last
    assert daemon.methods() == [*ENABLED, *ends]
    assert daemon.is_energised is (ends != DISABLED)


def fail(gripper: LiteGrip, before: Callable[[], object] = lambda: None) -> None:
    gripper.enable()
    before()
    raise ZeroDivisionError


def test_leaving_by_an_exception_disables_too(daemon: Heard, kind: Kind) -> None:
    with pytest.raises(ZeroDivisionError), kind.gripper() as gripper:
        fail(gripper)
    assert daemon.methods() == [*ENABLED, *DISABLED]


def test_leaving_by_a_cancelling_disables_too(daemon: Heard, tasks: Asyncio) -> None:
    async def stay() -> None:
        async with aio.LiteGrip() as gripper:
            await gripper.enable()
            await asyncio.Event().wait()

    async def main() -> None:
        staying = asyncio.create_task(stay())
        await asyncio.sleep(1.0)
        staying.cancel()
        await asyncio.wait([staying])

    tasks.run(main())
    assert daemon.methods() == [*ENABLED, *DISABLED]


def test_who_never_enabled_disables_nothing(daemon: Heard, kind: Kind) -> None:
    with kind.gripper() as gripper:
        gripper.get_state()
    assert daemon.methods() == ["hello", "state.get"]


def test_after_disable_there_is_nothing_left_to_disable(daemon: Heard, enabled: LiteGrip) -> None:
    assert enabled.disable() is True
    enabled.disconnect()
    assert daemon.methods().count("motor.disable") == 1


def test_a_disable_that_is_not_confirmed_is_false_and_done_again(
    daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.instead["motor.disable"] = {"ok": False, "state": daemon.wire_state}
    assert enabled.disable() is False
    with pytest.raises(HardwareError, match="did not confirm"):
        enabled.disconnect()
    assert not enabled.is_connected
    assert daemon.methods().count("motor.disable") == 2


def test_enable_sends_only_the_tunables_that_are_its_own(daemon: Heard, gripper: LiteGrip) -> None:
    gripper.motion_config.force_n = 99.0
    gripper.motion_config.enable_retries = 5
    daemon.client().result("stop")
    with pytest.raises(StoppedError):
        gripper.enable()
    gripper.clear_stop()
    assert gripper.enable()
    assert daemon.asked("motor.enable")[-1] == {"config": {"enable_retries": 5}}
    with pytest.raises(CommandError, match="force_n is 99"):
        gripper.open()


@pytest.mark.parametrize("how", ["refused", "not ok"])
def test_an_enable_that_failed_makes_nothing_to_disable(
    daemon: Heard, kind: Kind, how: str
) -> None:
    with kind.gripper() as gripper:
        if how == "refused":
            daemon.client().result("stop")
            with pytest.raises(StoppedError):
                gripper.enable()
        else:
            daemon.lose_to_motor = lambda frame: frame.data[7:] == b"\xfc"  # to be enabled
            result = gripper.enable()
            assert (bool(result), result.tries > 1, result.reason) == (False, True, "not_confirmed")
            assert result.message
    assert daemon.methods() == [*ENABLED, "lease.release"]


def test_a_lease_that_was_had_before_is_kept_when_enabling_fails(
    daemon: Heard, gripper: LiteGrip
) -> None:
    daemon.client().result("stop")
    with gripper.lease("sorting"):
        with pytest.raises(StoppedError):
            gripper.enable()
        assert "lease.release" not in daemon.methods()
    assert daemon.methods().count("lease.release") == 1


def test_an_interrupted_enable_may_have_enabled(daemon: Heard, kind: Kind) -> None:
    daemon.instead["motor.enable"] = SILENT
    kind.interrupt(0.1)
    with pytest.raises(kind.interrupted), kind.gripper() as gripper:
        gripper.enable()
    assert daemon.methods() == [*ENABLED, *DISABLED]


def test_an_error_on_leaving_does_not_hide_the_first(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    daemon.instead["lease.release"] = Refuse("not_permitted", -32028, "no")
    with pytest.raises(ZeroDivisionError), kind.gripper() as gripper:
        fail(gripper)
    assert caplog.messages == ["on leaving after ZeroDivisionError: no"]


def test_a_motor_that_cannot_be_disabled_is_told_once(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    why = "the motor does not answer: is it powered?"
    lost = Refuse("motor_silent", -32032, why)
    told = "can0: the motor could not be disabled, cut its power"
    daemon.instead["motor.disable"] = daemon.instead["motion.open"] = lost
    with pytest.raises(CANTimeoutError, match=r"^the motor does not"), kind.gripper() as gripper:
        fail(gripper, gripper.open)
    assert [record.message for record in caplog.records] == [told]
    caplog.clear()
    with pytest.raises(CANTimeoutError) as caught, kind.gripper() as gripper:
        gripper.enable()
    assert str(caught.value) == f"{told}: {why}"
    assert not caplog.records


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_disables_nothing(daemon: Heard, site: Bench) -> None:
    with Threads(site).gripper() as gripper:
        gripper.enable()
        child = os.fork()
        if child == 0:
            try:
                gripper.disconnect()
            finally:
                os._exit(1 if gripper.is_connected or daemon.streams[0].hung_up else 0)
        _, status = os.waitpid(child, 0)
        assert status == 0
        assert gripper.get_state().enabled


# The lease


def test_a_lease_says_what_is_wished(daemon: Heard, gripper: LiteGrip) -> None:
    options = {"purpose": "sorting", "ttl_s": 2.0, "wait_s": 5.0, "on_lost": "relax"}
    wished: Any = {name: value for name, value in options.items() if name != "purpose"}
    with gripper.lease("sorting", **wished) as lease:
        assert daemon.requests[-1].params == options
        owned = daemon.client().result("lease.get")
        assert owned["owner"]["purpose"] == "sorting"
        tokens = [lease.token]
        lease.renew()
    tokens.append(lease.token)
    assert [token is None for token in tokens] == [False, True]
    assert daemon.methods()[-3:] == ["lease.acquire", "lease.renew", "lease.release"]


def test_whom_a_lease_refuses_is_told_a_call_that_waits(daemon: Heard, kind: Kind) -> None:
    daemon.client(uid=os.getuid()).result("lease.acquire", purpose="picking")
    with kind.gripper() as gripper, pytest.raises(LeaseError) as caught:
        gripper.enable()
    assert f" ({kind.awaits}gripper.lease(wait_s=...).acquire())" in str(caught.value)


def test_a_lease_leaves_what_enable_has_said_of_its_loss(daemon: Heard, gripper: LiteGrip) -> None:
    with gripper.lease("packing"):
        assert on_lost(daemon) == "hold"
        gripper.enable()
        assert on_lost(daemon) == "disable"
    with gripper.lease("packing"):
        assert on_lost(daemon) == "disable", "a script that is killed disables the motor"
    assert on_lost(daemon) == "disable"
    with gripper.lease("packing", on_lost="relax"):
        assert on_lost(daemon) == "relax"
    with gripper.lease("packing"):
        assert on_lost(daemon) == "relax", "what is not given stays as it was"


def test_a_lease_that_another_has_names_it_and_can_be_taken(
    daemon: Heard, gripper: LiteGrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    other = daemon.client(uid=os.getuid())
    other.result("lease.acquire", purpose="picking")
    with pytest.raises(LeaseError) as caught:
        gripper.enable()
    assert (caught.value.owner or {})["purpose"] == "picking"
    assert daemon.methods()[-1] == "lease.acquire"
    monkeypatch.setattr("sys.argv", ["/opt/pick.py"])
    gripper.take_lease("it hangs")
    assert daemon.asked("lease.take")[-1] == {"why": "it hangs", "purpose": "pick.py"}
    other.result("lease.take", why="no", purpose="picking")
    gripper.take_lease("it hangs", jaws="relax")
    assert daemon.asked("lease.take")[-1]["jaws"] == "relax"
    gripper.disconnect()
    assert daemon.methods()[-1] == "lease.release"
    assert "motor.disable" not in daemon.methods()  # nobody had enabled it


def test_leaving_after_the_lease_was_taken_disables_nothing_and_says_so(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    with kind.gripper() as gripper:
        gripper.enable()
        daemon.client(uid=os.getuid()).result("lease.take", why="mine", purpose="picking")
    assert daemon.methods() == [*ENABLED, *DISABLED]
    assert "leaves the motor as it is" in caplog.text
    assert daemon.is_energised


def test_a_loss_has_the_same_cure_in_the_warning_at_the_end_as_in_the_error(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    cure = f"({kind.awaits}gripper.enable())"

    def script() -> None:
        with kind.gripper() as gripper:
            gripper.enable()
            daemon.client(uid=os.getuid()).result("lease.take", why="mine", purpose="picking")
            gripper.open()

    with pytest.raises(LeaseError) as caught:
        script()
    assert caught.value.message.endswith(cure)
    assert "leaves the motor as it is" in caplog.text
    assert caplog.messages[-1].endswith(cure)


def test_a_type_checker_knows_the_levels_of_a_stop() -> None:
    """A wrong one shows only when it counts; what else is wrong, when a program begins."""
    for kind in (LiteGrip, aio.LiteGrip):
        level = inspect.signature(kind.software_stop).parameters["level"]
        assert get_args(eval(level.annotation, {"Literal": Literal})) == tuple(STOP_LEVELS)


def test_a_stop_of_a_gripper_that_is_anothers_is_told_before_the_reason(
    daemon: Heard, gripper: LiteGrip, kind: Kind, caplog: pytest.LogCaptureFixture
) -> None:
    for_all = (
        f"stop(): the gripper is stopped for every client, until {kind.awaits}gripper.clear_stop()"
    )
    other = daemon.client(pid=4711, uid=os.getuid())
    other.result("motor.enable")
    other.result("lease.acquire")
    gripper.stop()
    assert caplog.messages[-1] == f"{for_all}: program4711 (pid 4711) has it"
    other.result("lease.release")
    gripper.stop()
    assert caplog.messages[-1] == f"{for_all}: a stop was latched already"
    gripper.clear_stop()
    gripper.lease().acquire()
    other.result("lease.take", why="my turn")
    gripper.stop()
    assert caplog.messages[-1] == f"{for_all}: program4711 (pid 4711) has taken it"


def on_lost(daemon: Heard) -> str | None:
    """Return what the jaws do when the present lease is lost; None without one."""
    holder = daemon.client().result("lease.get")["owner"]
    return None if holder is None else str(holder["on_lost"])


def in_a_block(gripper: LiteGrip) -> None:
    with gripper.lease("again"):
        gripper.hold()


GETS_AGAIN: list[Callable[[LiteGrip], object]] = [
    in_a_block,
    lambda gripper: gripper.lease().acquire(),
    lambda gripper: gripper.take_lease("back"),
]


@pytest.mark.parametrize("get_again", GETS_AGAIN)
@pytest.mark.parametrize("disables", [True, False])
def test_who_has_enabled_and_has_the_lease_again_answers_for_the_motor_again(
    daemon: Heard, kind: Kind, disables: bool, get_again: Callable[[LiteGrip], object]
) -> None:
    with kind.gripper(disable_on_disconnect=disables) as gripper:
        gripper.enable()
        other = daemon.client(uid=os.getuid())
        other.result("lease.take", why="mine", purpose="picking")
        other.result("motor.enable")  # whoever has enabled meanwhile
        other.leave()
        get_again(gripper)
        assert on_lost(daemon) == ("disable" if disables else "hold")  # when it is killed
    assert (daemon.is_energised, on_lost(daemon)) == (not disables, None)


def test_who_has_disabled_before_the_loss_disables_nothing_again(daemon: Heard, kind: Kind) -> None:
    with kind.gripper() as gripper:
        gripper.enable()
        gripper.disable()
        other = daemon.client(uid=os.getuid())
        other.result("lease.take", why="mine", purpose="picking")
        other.result("motor.enable")
        other.leave()
        in_a_block(gripper)
    assert daemon.methods().count("motor.disable") == 1
    assert daemon.is_energised


@pytest.mark.parametrize("disables", [True, False])
def test_who_takes_the_lease_answers_for_a_motor_that_is_enabled(
    daemon: Heard, kind: Kind, disables: bool
) -> None:
    """The one from whom it is taken disables it no more: it would be left to itself."""
    with kind.gripper() as first:
        first.enable()
        taker = kind.gripper(disable_on_disconnect=disables)
        taker.connect()
        taker.take_lease("mine")
        taker.goto(30.0)
        assert on_lost(daemon) == ("disable" if disables else "hold")  # also if it is killed
        taker.disconnect()
        assert daemon.is_energised is not disables


def test_a_lease_without_enable_is_taken_with_nothing_of_an_earlier_one(
    daemon: Heard, gripper: LiteGrip
) -> None:
    with gripper.lease(on_lost="relax"):
        pass
    gripper.take_lease("mine")
    assert on_lost(daemon) == "hold"
    with gripper.lease("sorting"):
        assert on_lost(daemon) == "hold"


def test_a_lease_of_several_is_given_back_by_the_last(daemon: Heard, kind: Kind) -> None:
    with kind.gripper() as gripper:
        first, second = gripper.lease("first"), gripper.lease("second")
        first.__enter__()
        second.__enter__()
        first.__exit__(None, None, None)
        assert "lease.release" not in daemon.methods()
        second.__exit__(None, None, None)
        assert daemon.methods()[-1] == "lease.release"
        with gripper.lease():
            gripper.enable()
        assert daemon.methods()[-1] == "motor.enable"
    assert daemon.methods()[-2:] == DISABLED


@pytest.mark.parametrize("is_late", [False, True])
def test_a_lease_that_nobody_waits_for_any_more_is_given_back(
    daemon: Heard, tasks: Asyncio, is_late: bool
) -> None:
    async def wait(gripper: aio.LiteGrip) -> None:
        async with gripper.lease(wait_s=60):
            raise ZeroDivisionError

    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            waiting = asyncio.create_task(wait(gripper))
            await asyncio.sleep(0)
            if is_late:
                waiting.cancel()
                await asyncio.wait([waiting])
                other.leave()
            else:
                (call,) = gripper._session.connection._router.calls.values()
                call.on_result = cancelling(waiting)
                other.leave()
                await asyncio.wait([waiting])
            assert waiting.cancelled()
            await asyncio.sleep(0.1)
            assert daemon.client().result("lease.get")["owner"] is None

    other = daemon.client()
    other.result("lease.acquire", purpose="picking")
    tasks.run(main())
    assert daemon.methods().count("lease.release") == 1


def test_a_lease_that_comes_late_is_kept_for_who_wants_it_by_then(
    daemon: Heard, tasks: Asyncio
) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            daemon.late["lease.acquire"] = 0.2
            waiting = asyncio.create_task(gripper.lease(wait_s=60).__aenter__())
            await asyncio.sleep(0.1)
            waiting.cancel()
            await asyncio.wait([waiting])
            del daemon.late["lease.acquire"]
            async with gripper.lease():
                await asyncio.sleep(0.2)
                assert "lease.release" not in daemon.methods()
                assert daemon.client().result("lease.get")["owner"] is not None

    tasks.run(main())
    assert daemon.methods()[-1] == "lease.release"


def test_a_lease_of_an_earlier_connection_gives_nothing_back(
    daemon: Heard, gripper: LiteGrip
) -> None:
    with gripper.lease():
        gripper.disconnect()
        gripper.connect()
    assert daemon.methods()[-1] == "hello"


# Stop, and reading


def test_hold_stop_and_clear(daemon: Heard, enabled: LiteGrip) -> None:
    assert enabled.hold().mode == "holding"
    before = daemon.requests[-1].params["stop_generation"]
    assert enabled.software_stop().stop is not None
    assert daemon.requests[-1].params == {"level": "hold"}
    enabled.software_stop("relax", why="smoke")
    assert daemon.requests[-1].params == {"level": "relax", "why": "smoke"}
    assert enabled.clear_stop().stop is None
    assert daemon.requests[-1].params.keys() == set(GUARDS)
    cleared = daemon.requests[-1].params["stop_generation"]
    enabled.hold()
    assert before < cleared <= daemon.requests[-1].params["stop_generation"]
    assert daemon.requests[-1].params["stop_generation"] == daemon.state.stop_generation


def test_a_stop_that_does_not_reach_the_motor_is_latched_and_an_error(
    site: Bench, daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.gripper.motor.power_off()
    site.run_until(lambda: daemon.wire_state["motor"] == "silent")
    told = r"a stop \(relax\) is latched, but the motor does not answer.* cut its power"
    with pytest.raises(CANTimeoutError, match=told):
        enabled.software_stop("relax")
    assert daemon.wire_state["stop"]["level"] == "relax"
    daemon.gripper.motor.power_on()
    site.run_until(lambda: daemon.wire_state["motor"] == "disabled")


def test_enabling_waits_for_a_motor_whose_power_is_just_back(
    site: Bench, daemon: Heard, gripper: LiteGrip
) -> None:
    daemon.gripper.power_off()
    site.run_until(lambda: daemon.wire_state["motor"] == "silent")
    daemon.gripper.power_on()
    site.run_until(lambda: daemon.wire_state["motor"] == "unknown")
    assert gripper.enable()


def test_a_stop_overtakes_a_motion(daemon: Heard, tasks: Asyncio) -> None:
    async def scene(gripper: aio.LiteGrip) -> None:
        moving = asyncio.create_task(gripper.close())
        await asyncio.sleep(0.2)
        await gripper.software_stop("relax", why="smoke")
        with pytest.raises(StoppedError):
            await moving
        await gripper.clear_stop()
        assert (await gripper.hold()).mode == "holding"

    tasks.use(scene)


def test_reading(daemon: Heard, enabled: LiteGrip, kind: Kind) -> None:
    state = enabled.get_state()
    assert (state.status, state.mode, state.stale) == ("enabled", "holding", False)
    assert state.opening_mm == pytest.approx(daemon.gripper.opening_mm, abs=0.1)
    assert (enabled.mount, enabled.channel) == ("normal", "can0")
    assert enabled.info()["channel"] == "can0"
    assert [one["kind"] for one in enabled.jobs()] == ["enable"]
    reasons = [method_name("motor.enable")]
    daemon.instead["health"] = with_terms({"verdict": "ok", "reasons": reasons})
    assert enabled.health() == {"verdict": "ok", "reasons": [f"{kind.awaits}gripper.enable()"]}
    del daemon.instead["health"]
    assert enabled.health()["verdict"] == daemon.client().result("health")["verdict"]


@pytest.mark.parametrize(
    ("name", "meant"), [("move", "goto("), ("state", "get_state()"), ("width", "opening_mm")]
)
@pytest.mark.parametrize("kind", [LiteGrip, aio.LiteGrip])
def test_a_name_that_hands_type_is_hinted_at(
    kind: type[LiteGrip] | type[aio.LiteGrip], name: str, meant: str
) -> None:
    gripper = kind("can0")
    with pytest.raises(AttributeError, match=f"no attribute {name!r}; use .*{re.escape(meant)}"):
        getattr(gripper, name)
    assert not hasattr(gripper, name)
    with pytest.raises(AttributeError, match=r"no attribute 'mvoe'\Z"):
        gripper.mvoe  # type: ignore[union-attr]  # noqa: B018 - a type checker knows it, too


@pytest.mark.parametrize(
    ("act", "told"),
    [
        (lambda g: g.opne, "'opne': did you mean 'open'?"),
        (lambda g: g.opening_mm, "'opening_mm': did you mean 'get_state().opening_mm'?"),
        (lambda g: g.get_state().opening, "'opening': did you mean 'opening_mm'?"),
        (lambda g: g.get_state().width, "'width': did you mean 'opening_mm'?"),
        (lambda g: g.get_state().widht, "'widht': did you mean 'opening_mm'?"),
        (lambda g: g.goto(30).width, "'width': did you mean 'state.opening_mm'?"),
        (lambda g: g.grasp(5).widht, "'widht': did you mean 'width_mm'?"),
        (lambda g: g.goto(30).opening_mm, "'opening_mm': did you mean 'state.opening_mm'?"),
        (lambda g: setattr(g, "speed", 5), "'speed': did you mean 'motion_config.speed_mm_s'?"),
        (
            lambda g: setattr(g, "force", 5),
            "'force'; use get_state().force_n, or set_force(newtons)",
        ),
        (
            lambda g: setattr(g, "label", "left"),
            "'label': only a subclass may have attributes of its own",
        ),
        (lambda g: setattr(g.motion_config, "force", 5), "'force': did you mean 'force_n'?"),
        (lambda g: g.motion_config.forc_n, "'forc_n': did you mean 'force_n'?"),
        (
            lambda g: setattr(g.config, "max_stroke", 3),
            "'max_stroke': did you mean 'max_stroke_mm'?",
        ),
        (lambda g: g.nothing_like_it, "'nothing_like_it'"),
        (lambda g: g.connected, "'connected'; use is_connected"),
        (lambda g: g.estop, "'estop'; use software_stop()"),
        (
            lambda g: g.get_state().position,
            "'position': did you mean 'opening_mm' or 'position_rad'?",
        ),
        (
            lambda g: g.goto(30).temperature,
            (
                "'temperature': did you mean 'state.coil_temperature_c' or"
                " 'state.driver_temperature_c'?"
            ),
        ),
        (lambda g: g.goto(30).success, "'success': did you mean 'ok'?"),
        (lambda g: g.latest().opening_mm, "'opening_mm': did you mean 'state.opening_mm'?"),
    ],
)
def test_what_was_meant_by_a_wrong_name_is_said_once(
    site: Bench, daemon: Heard, act: Callable[[LiteGrip], object], told: str
) -> None:
    with Threads(site).gripper() as gripper:
        gripper.enable()
        with pytest.raises(AttributeError) as caught:
            act(gripper)
    assert str(caught.value).endswith(f"has no attribute {told}")
    printed = "".join(traceback.format_exception_only(caught.value))
    assert printed.lower().count("did you mean") == told.count("did you mean")


@pytest.mark.parametrize(
    ("act", "told"),
    [
        (
            lambda: LiteGrip("can0", "normal"),  # type: ignore[arg-type]
            "can_id is 'normal', it must be a number; a mount: mount='normal'",
        ),
        (lambda: LiteGrip("can0", "8"), "can_id is '8', it must be a whole number"),  # type: ignore[arg-type]
        (lambda: MotionConfig(speed=20), "'speed': did you mean 'speed_mm_s'?"),  # type: ignore[call-arg]
    ],
)
def test_a_wrong_argument_of_a_constructor_is_told(act: Callable[[], object], told: str) -> None:
    with pytest.raises((CommandError, TypeError)) as caught:
        act()
    assert told in str(caught.value)


def test_a_wrong_duration_is_called_as_it_was_written(gripper: LiteGrip) -> None:
    with pytest.raises(CommandError, match=r"^duration is '1s', it must be a number"):
        gripper.goto(40, duration="1s")  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("make", "shown"),
    [
        (
            lambda g: g.stream(speed_mm_s=30),
            "<SetpointStream to can0, valid_s=0.2, speed_mm_s=30.0>",
        ),
        (lambda g: g.lease("sorting"), "<Lease 'sorting' of can0, not taken>"),
        (lambda g: g.lease(), "<Lease of can0, not taken>"),
        (lambda g: g.states(50), "<Subscription of state samples, hz=50.0>"),
        (lambda g: g.events(["stop"]), "<EventSubscription of events, kinds=['stop']>"),
        (lambda g: g.latest(), "<Latest of state samples, hz=50.0>"),
    ],
)
def test_what_comes_with_a_block_shows_what_it_is(
    gripper: LiteGrip, kind: Kind, make: Callable[[LiteGrip], Any], shown: str
) -> None:
    made = make(gripper)
    real = made._real if kind.awaits else made
    assert repr(real) == shown
    with made:
        inside = repr(real)
    assert inside == shown.removesuffix(", not taken>").removesuffix(">") + ">"
    assert repr(real) == (shown if "Lease" in shown else f"{shown[:-1]}, closed>")


def test_an_asyncio_gripper_has_the_same_hints() -> None:
    gripper = aio.LiteGrip("can0")
    with pytest.raises(AttributeError, match=r"did you mean 'open'\?\Z"):
        gripper.opne  # type: ignore[attr-defined]  # noqa: B018 - a type checker knows it, too
    with pytest.raises(AttributeError, match=r"did you mean 'motion_config\.speed_mm_s'\?\Z"):
        gripper.speed = 5  # type: ignore[attr-defined]


@pytest.mark.parametrize("base", [LiteGrip, aio.LiteGrip, MotionConfig, GripperConfig])
def test_a_subclass_has_attributes_of_its_own(base: Any) -> None:
    class Own(base):  # type: ignore[misc]
        pass

    own = Own()
    own.label = "left"
    assert own.label == "left"


def test_a_test_of_a_program_may_replace_a_method(monkeypatch: pytest.MonkeyPatch) -> None:
    gripper = LiteGrip("can0")
    monkeypatch.setattr(gripper, "open", lambda: "opened")
    assert gripper.open() == "opened"  # type: ignore[comparison-overlap]


def test_every_member_that_a_hint_names_is_there_and_takes_what_it_says() -> None:
    for hint in MEANT.values():
        for call, argument, field in re.findall(r"(\w+)\((?:(\w+)=\.\.\.)?\)?(?:\.(\w+))?", hint):
            member = getattr(LiteGrip, call)
            assert not argument or argument in inspect.signature(member).parameters, hint
            assert not field or hasattr(GripperState, field), hint


@pytest.mark.parametrize(
    ("method", "argument"),
    [
        ("goto", "position_mm"),
        ("goto_rad", "position_rad"),
        ("goto_openness", "openness"),
        ("move_at_speed", "target_mm"),
    ],
)
@pytest.mark.parametrize("target", [None, "40"])
def test_a_target_that_is_no_number_is_named_as_the_method_does(
    enabled: LiteGrip, method: str, argument: str, target: object
) -> None:
    with pytest.raises(CommandError, match=f"^{argument} is {target!r}, it must be a number"):
        getattr(enabled, method)(target)


def test_a_name_that_the_configuration_does_not_have_is_not_the_daemons(enabled: LiteGrip) -> None:
    with pytest.raises(AttributeError, match=r"'max_strok_mm': did you mean 'max_stroke_mm'\?\Z"):
        enabled.config.max_strok_mm = 85.0  # type: ignore[attr-defined]
    with pytest.raises(CommandError, match=r"config\.kp cannot be set: it is the daemon's"):
        enabled.config.kp = 50.0


def test_what_only_the_other_client_has_is_hinted_at_as_it_is_awaited_here() -> None:
    gripper = aio.LiteGrip("can0")
    for name in sorted({*dir(LiteGrip)} - {*dir(aio.LiteGrip)} - {"can_id", "mst_id"}):
        if name.startswith("_"):
            continue
        with pytest.raises(AttributeError, match=r"use |did you mean"):
            getattr(gripper, name)
    with pytest.raises(AttributeError) as caught:
        gripper.get_position  # type: ignore[attr-defined]  # noqa: B018 - it is not there
    assert str(caught.value).endswith(
        "; use (await gripper.get_state()).opening_mm, or (await gripper.get_state()).position_rad"
    )


def test_a_refusal_by_who_moves_it_or_has_it_says_what_to_do_in_its_hint(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    with kind.gripper() as other:
        with pytest.raises(LeaseError) as held:
            other.open()
        enabled.disconnect()
        client = daemon.client(pid=77)
        client.result("motor.enable")
        client.send("motion.open", speed_mm_s=5)
        with pytest.raises(BusyError) as busy:
            other.open()
    for error in (held.value, busy.value):
        assert error.hint is not None
        assert error.hint.startswith("wait for it (")
        assert str(error).count(error.hint) == 1


def test_an_array_of_one_element_is_told_how_it_becomes_a_number(enabled: LiteGrip) -> None:
    class Array:
        """As numpy's of shape (1,)."""

        size = 1

        def __float__(self) -> float:
            raise TypeError

        def item(self) -> float:
            return 60.0

    with pytest.raises(CommandError, match=r"it must be a number; pass its element, x\.item\(\)"):
        enabled.goto(Array())  # type: ignore[arg-type]
    assert enabled.goto(Array().item())


def test_kept_trajectories_print_as_a_table(enabled: LiteGrip) -> None:
    enabled.keep_trajectory("wave", enabled.record(0.3))
    lines = str(enabled.kept_trajectories()).splitlines()
    assert lines[0].split()[:3] == ["NAME", "SAMPLES", "LENGTH"]
    assert lines[1].split()[0] == "wave"
    assert repr(enabled.kept_trajectories()) == "\n".join(lines)


def test_jobs_print_as_a_table(enabled: LiteGrip) -> None:
    enabled.open()
    lines = str(enabled.jobs()).splitlines()
    assert lines[0].split() == ["job", "kind", "state", "by", "took", "result"]
    assert re.fullmatch(r"2 +open +done +\S+ \(pid \d+\) +\d\.\d s +pressed home", lines[2])


def test_the_prompt_shows_jobs_and_health_as_they_print(enabled: LiteGrip) -> None:
    for shown in (enabled.jobs(), enabled.health()):
        assert repr(shown) == str(shown)
        assert not repr(shown).startswith(("[", "{"))


def test_a_notebook_shows_jobs_as_a_table(enabled: LiteGrip) -> None:
    shown: list[str] = []
    jobs: Any = enabled.jobs()
    jobs._repr_pretty_(SimpleNamespace(text=shown.append), False)
    assert shown == [str(jobs)]


def test_a_forgotten_await_is_hinted_at(daemon: Heard, tasks: Asyncio) -> None:
    async def main() -> None:
        async with aio.LiteGrip() as gripper:
            gripper.enable().close()  # as if nobody had awaited it
            with pytest.raises(HardwareError, match=r"\(await gripper\.enable\(\)\)"):
                await gripper.open()

    tasks.run(main())


def test_who_takes_the_lease_may_give_a_reason(daemon: Heard, gripper: LiteGrip) -> None:
    gripper.take_lease()
    assert daemon.asked("lease.take")[0]["why"] == "no reason given"


def test_an_older_object_of_the_program_hands_the_gripper_over(daemon: Heard, kind: Kind) -> None:
    """As when the cell of a notebook that connects and enables is run again."""
    older, newer = kind.gripper(), kind.gripper()
    older.connect()
    older.enable()
    newer.connect()
    assert newer.enable()
    with pytest.raises(LeaseError, match="a newer object of the same program"):
        older.open()
    older.disconnect()  # it disables nothing: the motor is the newer one's
    assert newer.get_state().enabled
    assert newer.open()
    newer.disconnect()
    assert not daemon.is_energised


def test_an_older_object_that_gets_it_back_answers_for_the_motor_again(
    daemon: Heard, kind: Kind
) -> None:
    older, newer = kind.gripper(), kind.gripper(disable_on_disconnect=False)
    older.connect()
    older.enable()
    newer.connect()
    newer.enable()
    newer.disconnect()  # it leaves the motor enabled
    older.lease().acquire()
    assert on_lost(daemon) == "disable"
    older.disconnect()
    assert not daemon.is_energised


def test_an_older_object_hands_nothing_over_that_it_has_by_a_block(
    daemon: Heard, kind: Kind
) -> None:
    older, newer = kind.gripper(), kind.gripper()
    older.connect()
    newer.connect()
    with older.lease("sorting"):
        with pytest.raises(LeaseError, match="sorting"):
            newer.enable()
        assert older.enable()


def test_an_object_that_moves_hands_nothing_over(daemon: Heard, kind: Kind, site: Bench) -> None:
    older, newer = kind.gripper(), kind.gripper()
    older.connect()
    older.enable()
    newer.connect()
    kind.ask(older, "motion.close", wait=False)
    site.run(0.1)
    with pytest.raises(LeaseError):
        newer.enable()
    assert older.get_state().enabled


def test_an_answer_is_waited_for_as_long_as_is_said(site: Bench, daemon: Heard, kind: Kind) -> None:
    with kind.gripper() as gripper:
        daemon.instead["state.get"] = SILENT
        began_s = site.now_s
        with pytest.raises(ConnectError, match="within 5 s"):
            gripper.get_state()
        assert site.now_s - began_s == pytest.approx(5.0, abs=0.011)


def test_tasks_wait_each_as_long_as_it_may(daemon: Heard, tasks: Asyncio) -> None:
    async def scene(gripper: aio.LiteGrip) -> None:
        loop, connection = asyncio.get_running_loop(), gripper._session.connection
        daemon.instead["state.get"] = SILENT
        began_s = loop.time()

        async def ask(within_s: float) -> float:
            with pytest.raises(ConnectError, match=f"within {within_s:g} s"):
                await connection.call("state.get", None, within_s)
            return loop.time() - began_s

        limits_s = [2.0, 0.5, 1.0, 3.0, 0.5]
        took_s = await asyncio.gather(*map(ask, limits_s))
        assert took_s == pytest.approx(limits_s, abs=0.011)

    tasks.use(scene)
