import os
import time
from collections.abc import Callable
from typing import Any

import pytest

from litegrip_client import (
    CommandError,
    ConnectError,
    EnableResult,
    HardwareError,
    LeaseError,
    LiteGrip,
    ProtocolError,
    StoppedError,
)
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import interrupt_main_thread


def test_the_constructor_connects_to_nothing(daemon: FakeDaemon) -> None:
    gripper = LiteGrip("can0", 0x08, socket_path=daemon.path)
    assert not gripper.is_connected
    with pytest.raises(ConnectError, match="not connected") as caught:
        gripper.open()
    assert "connect()" in str(caught.value)
    gripper.connect()
    connected = gripper.is_connected
    gripper.connect()
    gripper.disconnect()
    assert (connected, gripper.is_connected) == (True, False)
    gripper.disconnect()
    assert daemon.methods() == ["hello"]


def test_the_daemon_is_told_which_program_asks(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("sys.argv", ["/opt/pick.py"])
    with LiteGrip(socket_path=daemon.path):
        assert daemon.requests[0].params == {"client": "pick.py"}


def test_another_can_id_or_channel_is_refused(daemon: FakeDaemon) -> None:
    with pytest.raises(CommandError, match="has can_id 0x08, not 0x09"):
        LiteGrip("can0", 0x09, socket_path=daemon.path).connect()
    with pytest.raises(CommandError, match="has channel can0, not can1"):
        LiteGrip("can1", socket_path=daemon.path).connect()
    with pytest.raises(CommandError, match="cannot be a channel"):
        LiteGrip("../can0")


def test_what_is_no_daemon_is_a_protocol_error(daemon: FakeDaemon) -> None:
    daemon.handlers["hello"] = lambda request: {"protocol": 1}
    gripper = LiteGrip(socket_path=daemon.path)
    with pytest.raises(ProtocolError, match="no litegripd"):
        gripper.connect()
    assert not gripper.is_connected


def test_a_daemon_that_went_is_noticed_and_connecting_again_works(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    gripper.get_state()
    daemon.requests[0].hang_up()
    assert not gripper.is_connected
    with pytest.raises(ConnectError):
        gripper.get_state()
    gripper.connect()
    assert gripper.get_state().openness == 0.5


# Enabling, and what the end does

ENABLED = ["hello", "lease.acquire", "motor.enable"]


def test_enable_says_what_shall_happen_when_the_client_is_lost(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    result = gripper.enable(retries=5)
    assert isinstance(result, EnableResult)
    assert (bool(result), result.tries) == (True, 1)
    params = dict(daemon.requests[-1].params)
    assert 0.0 <= time.monotonic() - params.pop("sent_s") < 60.0
    assert params == {"retries": 5, "stop_generation": 3}
    assert daemon.requests[-2].method == "lease.acquire"
    assert daemon.requests[-2].params["on_lost"] == "disable"
    gripper.disable_on_disconnect = False
    gripper.enable()
    assert daemon.requests[-2].params["on_lost"] == "hold"


def test_leaving_disables_what_was_enabled_here(daemon: FakeDaemon) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.enable()
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]


def fail(gripper: LiteGrip, before: Callable[[], None] = lambda: None) -> None:
    gripper.enable()
    before()
    raise ZeroDivisionError


def test_leaving_by_an_exception_disables_too(daemon: FakeDaemon) -> None:
    with pytest.raises(ZeroDivisionError), LiteGrip(socket_path=daemon.path) as gripper:
        fail(gripper)
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]


def test_who_never_enabled_disables_nothing(daemon: FakeDaemon) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.get_state()
    assert daemon.methods() == ["hello", "state.get"]


def test_without_disable_on_disconnect_nothing_is_disabled(daemon: FakeDaemon) -> None:
    with LiteGrip(socket_path=daemon.path, disable_on_disconnect=False) as gripper:
        gripper.enable()
    assert daemon.methods() == [*ENABLED, "lease.release"]


def test_a_change_after_enabling_counts_for_a_clean_exit(daemon: FakeDaemon) -> None:
    with LiteGrip(socket_path=daemon.path, disable_on_disconnect=False) as gripper:
        gripper.enable()
        gripper.disable_on_disconnect = True
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]


def test_a_change_to_holding_takes_back_what_enable_said(daemon: FakeDaemon) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.enable()
        gripper.disable_on_disconnect = False
    assert daemon.methods() == [*ENABLED, "lease.release"]


def test_after_disable_there_is_nothing_left_to_disable(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    gripper.enable()
    assert gripper.disable() is True
    gripper.disconnect()
    assert daemon.methods().count("motor.disable") == 1


def test_a_disable_that_is_not_confirmed_is_false_and_done_again(daemon: FakeDaemon) -> None:
    gripper = LiteGrip(socket_path=daemon.path)
    gripper.connect()
    gripper.enable()
    daemon.handlers["motor.disable"] = lambda request: {"ok": False, "state": STATE}
    assert gripper.disable() is False
    with pytest.raises(HardwareError, match="did not confirm"):
        gripper.disconnect()
    assert not gripper.is_connected
    assert daemon.methods().count("motor.disable") == 2


@pytest.mark.parametrize("how", ["refused", "not ok"])
def test_an_enable_that_failed_makes_nothing_to_disable(daemon: FakeDaemon, how: str) -> None:
    def enable(request: Request) -> Any:
        if how == "not ok":
            return {"ok": False, "tries": 3, "state": STATE, "reason": "motor_silent"}
        return request.fail("stopped", -32021)

    daemon.handlers["motor.enable"] = enable
    with LiteGrip(socket_path=daemon.path) as gripper:
        if how == "refused":
            with pytest.raises(StoppedError):
                gripper.enable()
        else:
            assert not gripper.enable()
    assert daemon.methods() == [*ENABLED, "lease.release"]


def test_a_lease_that_was_had_before_is_kept_when_enabling_fails(daemon: FakeDaemon) -> None:
    daemon.handlers["motor.enable"] = lambda request: request.fail("stopped", -32021)
    with LiteGrip(socket_path=daemon.path) as gripper, gripper.lease("sorting"):
        with pytest.raises(StoppedError):
            gripper.enable()
        assert "lease.release" not in daemon.methods()
    assert daemon.methods().count("lease.release") == 1


def test_a_lease_says_what_is_wished(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    with gripper.lease("sorting", ttl_s=2.0, wait_s=5.0, on_lost="relax") as lease:
        assert daemon.requests[-1].params == {
            "purpose": "sorting",
            "ttl_s": 2.0,
            "wait_s": 5.0,
            "on_lost": "relax",
        }
        assert [lease.token] == ["e:1"]
        lease.renew()
    assert lease.token is None
    assert daemon.methods()[-3:] == ["lease.acquire", "lease.renew", "lease.release"]


def test_a_lease_that_another_has_names_it(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["lease.acquire"] = lambda request: request.fail("lease_held", -32026)
    with pytest.raises(LeaseError):
        gripper.enable()
    assert daemon.methods()[-1] == "lease.acquire"
    gripper.take_lease("it hangs")
    assert daemon.requests[-1].params["why"] == "it hangs"


def test_leaving_after_the_lease_was_taken_disables_nothing_and_says_so(
    daemon: FakeDaemon, caplog: pytest.LogCaptureFixture
) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.enable()
        for method in ("motor.disable", "lease.release"):
            daemon.handlers[method] = lambda request: request.fail("lease_lost", -32027)
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]
    assert "leaves the motor as it is" in caplog.text


def test_what_was_enabled_under_a_lost_lease_is_not_disabled_at_the_end_of_another(
    daemon: FakeDaemon,
) -> None:
    with LiteGrip(socket_path=daemon.path) as gripper:
        gripper.enable()
        granted = {"lease": "e:7", "number": 7, "state": STATE}
        daemon.handlers["lease.acquire"] = lambda request: granted
        with gripper.lease("again"):
            gripper.get_state()
        assert daemon.methods()[-1] == "lease.release"
    assert "motor.disable" not in daemon.methods()


def test_a_take_over_says_what_the_jaws_do_only_where_that_is_wished(
    daemon: FakeDaemon, gripper: LiteGrip
) -> None:
    gripper.take_lease("it hangs")
    assert "jaws" not in daemon.requests[-1].params
    gripper.take_lease("it hangs", jaws="relax")
    assert daemon.requests[-1].params["jaws"] == "relax"


def test_an_interrupted_enable_may_have_enabled(daemon: FakeDaemon) -> None:
    daemon.handlers["motor.enable"] = lambda request: interrupt_main_thread()
    with pytest.raises(KeyboardInterrupt), LiteGrip(socket_path=daemon.path) as gripper:
        gripper.enable()
    assert daemon.methods() == [*ENABLED, "motor.disable", "lease.release"]


def test_an_error_on_leaving_does_not_hide_the_first(
    daemon: FakeDaemon, caplog: pytest.LogCaptureFixture
) -> None:
    with pytest.raises(ZeroDivisionError), LiteGrip(socket_path=daemon.path) as gripper:
        fail(gripper, daemon.hang_up)
    assert "ZeroDivisionError" in caplog.text


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_disables_nothing(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    gripper.enable()
    child = os.fork()
    if child == 0:
        try:
            gripper.disconnect()
        finally:
            os._exit(0 if not gripper.is_connected else 1)
    _, status = os.waitpid(child, 0)
    assert status == 0
    assert gripper.get_state().enabled
    assert "motor.disable" not in daemon.methods()
