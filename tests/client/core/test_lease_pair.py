"""A lease without a block, for objects that begin and end in different functions."""

import os
from typing import Any

import pytest

from litegrip_client import ConnectError, LeaseError, LiteGrip, ParameterError
from litegrip_client.core.session import LEASE_RANGES
from litegrip_client.core.sockets import STOP_LEVELS
from litegripd.app.build import METHODS
from tests.client.rig import Bench, Heard, Kind


def owner(daemon: Heard) -> str | None:
    holder = daemon.client().result("lease.get")["owner"]
    return None if holder is None else str(holder["purpose"])


def test_it_is_taken_and_given_back(daemon: Heard, gripper: LiteGrip) -> None:
    lease = gripper.lease("a driver")
    assert owner(daemon) is None
    lease.acquire()
    assert owner(daemon) == "a driver"
    tokens = [lease.token]
    lease.release()
    lease.release()
    tokens.append(lease.token)
    assert [token is None for token in tokens] == [False, True]
    assert owner(daemon) is None
    assert daemon.methods().count("lease.release") == 1


def test_one_that_is_acquired_twice_is_released_once(daemon: Heard, gripper: LiteGrip) -> None:
    lease = gripper.lease("a driver")
    lease.acquire()
    lease.acquire()
    lease.release()
    assert owner(daemon) is None


def test_it_is_kept_while_a_block_needs_it(daemon: Heard, gripper: LiteGrip) -> None:
    lease = gripper.lease("a driver")
    lease.acquire()
    with gripper.lease("a motion"):
        lease.release()
        assert owner(daemon) is not None
    assert owner(daemon) is None


def test_one_that_was_lost_is_taken_again_by_acquire(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    lease = gripper.lease("a driver")
    lease.acquire()
    with kind.gripper() as other:
        other.take_lease("maintenance")
        with pytest.raises(LeaseError) as caught:
            gripper.open()
        assert caught.value.reason == "lease_lost"
        with pytest.raises(LeaseError):
            lease.acquire()
    lease.acquire()
    assert owner(daemon) == "a driver"
    lease.release()
    assert owner(daemon) is None


def test_what_enable_keeps_is_kept_also_after_a_loss(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    lease = gripper.lease("a driver")
    lease.acquire()
    assert gripper.enable()
    with kind.gripper() as other:
        other.take_lease("maintenance")
    lease.acquire()
    lease.release()
    assert owner(daemon) == "a driver"
    gripper.disconnect()
    assert owner(daemon) is None


def test_who_has_taken_it_is_told_also_after_giving_it_back(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    assert gripper.enable()
    with kind.gripper() as other:
        other.take_lease("maintenance")
    with pytest.raises(LeaseError) as caught:
        gripper.open()
    taker = caught.value.owner
    assert taker is not None
    assert f"{taker['program']} (pid {taker['pid']}, uid {taker['uid']})" in caught.value.message


def test_who_has_waited_is_not_told_to_do_what_it_did(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    daemon.client(pid=4711).result("lease.acquire", purpose="another")
    with pytest.raises(LeaseError, match="still has the gripper for another after 2 s") as caught:
        gripper.lease("mine", wait_s=2).acquire()
    assert "wait longer (" + kind.awaits + "gripper.lease(wait_s=...)" in caught.value.message


def test_an_object_of_the_same_program_is_told_so(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    with kind.gripper() as other, other.lease():
        with pytest.raises(LeaseError) as caught:
            gripper.lease().acquire()
        said = caught.value.message
        how = "takes it over between motions, unless a block of lease() has it"
        assert said.endswith(f"; {kind.awaits}gripper.enable() {how}")
        who = f"(pid {os.getpid()}, this very program)"
        assert f"{who} has the gripper: wait for it" in said  # its purpose is its name
    daemon.client(pid=4711).result("lease.acquire", purpose="another")
    with pytest.raises(LeaseError, match="has the gripper for another") as caught:
        gripper.lease().acquire()
    assert "this very program" not in caught.value.message


def test_who_had_enabled_is_told_to_enable_again(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    """Also by itself: to acquire the lease is refused while the newer object has it."""
    call = f"{kind.awaits}gripper.enable()"
    gripper.enable()
    with kind.gripper() as newer:
        newer.enable()
        for ask in (gripper.hold, gripper.open, gripper.disable):
            with pytest.raises(LeaseError) as caught:
                ask()
            assert caught.value.reason == "lease_lost"
            assert caught.value.message.endswith(f"asks for the gripper again ({call})")
            assert f"(pid {os.getpid()}, this very program, uid " in caught.value.message
            assert caught.value.hint == call
        assert gripper.enable()
        assert gripper.open()


def test_who_had_not_enabled_is_told_to_acquire_the_lease(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    call = f"{kind.awaits}gripper.lease().acquire()"
    gripper.enable()
    gripper.disable()
    with kind.gripper() as newer:
        newer.take_lease("mine")
        with pytest.raises(LeaseError) as caught:
            gripper.disable()
    assert (caught.value.reason, caught.value.hint) == ("lease_lost", call)


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"ttl_s": -1}, "ttl_s is -1, it must be 0.1 to 86400 s"),
        ({"wait_s": -1.0}, "wait_s is -1, it must be 0 to 86400 s"),
        ({"wait_s": "5"}, "wait_s is '5', it must be a number"),
        ({"on_lost": "drop"}, "on_lost is 'drop', it must be 'hold' or 'relax' or 'disable'"),
        ({"purpose": 5}, "purpose is 5, it must be text"),
    ],
)
def test_what_no_lease_can_have_is_refused_where_it_is_said(
    kind: Kind, given: dict[str, Any], told: str
) -> None:
    with pytest.raises(ParameterError, match=f"^{told}$") as caught:
        kind.gripper().lease(**given)
    assert caught.value.data["parameter"] in given


def test_what_a_lease_refuses_itself_is_what_the_daemon_refuses() -> None:
    (method,) = (one for one in METHODS if one.name == "lease.acquire")
    params = {one.name: one for one in method.params}
    assert {name: (params[name].minimum, params[name].maximum) for name in LEASE_RANGES} == (
        LEASE_RANGES
    )
    assert params["on_lost"].choices == STOP_LEVELS


def test_it_is_waited_for(site: Bench, daemon: Heard, gripper: LiteGrip, kind: Kind) -> None:
    other = daemon.client()
    other.result("lease.acquire", purpose="another")
    site.after(1.0, lambda: other.send("lease.release"))
    began_s = site.now_s
    lease = gripper.lease("a driver", wait_s=5.0)
    lease.acquire()
    assert site.now_s - began_s == pytest.approx(1.0, abs=0.05)
    lease.release()


def test_after_a_reconnect_it_is_another_one(daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper()
    gripper.connect()
    lease = gripper.lease("a driver")
    lease.acquire()
    gripper.disconnect()
    with pytest.raises(ConnectError):
        lease.acquire()
    gripper.connect()
    lease.acquire()
    assert owner(daemon) == "a driver"
    lease.release()
    assert owner(daemon) is None
    gripper.disconnect()


def test_the_sockets_path_has_one_name(daemon: Heard, kind: Kind) -> None:
    path = "/run/litegripd/can0.sock"
    gripper = kind.gripper()
    paths = [gripper.socket_path]
    with kind.gripper(socket_path=path) as given:
        assert given.socket_path == path
    with gripper:
        paths.append(gripper.socket_path)
        assert gripper._session.connection.socket_path == path
    paths.append(gripper.socket_path)
    assert paths == [None, path, None]
    assert kind.gripper(socket_path="/tmp/mine.sock").socket_path == "/tmp/mine.sock"


def test_the_state_names_what_zero_gravity_does(enabled: LiteGrip) -> None:
    assert not enabled.get_state().is_zero_gravity
    state = enabled.zero_gravity()
    assert (state.is_zero_gravity, state.mode) == (True, "relaxed")
    assert not enabled.zero_gravity(False).is_zero_gravity
    enabled.stop()
    assert enabled.get_state().is_zero_gravity
    assert not enabled.hold().is_zero_gravity
    assert enabled.software_stop("relax").is_zero_gravity
