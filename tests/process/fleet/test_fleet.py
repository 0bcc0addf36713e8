"""Every client through a portal as through a daemon: real processes, real TLS, loopback."""

from typing import Any

from litegrip_client import LiteGrip
from tests.process.daemon_process import Client, DaemonProcess
from tests.process.fleet.fleet_process import Fleet


def of(lab: Fleet) -> dict[str, Any]:
    return {"channel": "lab.left", "socket_path": str(lab.socket_path())}


def test_a_gripper_of_another_machine_is_used_as_one_of_this(lab: Fleet) -> None:
    with LiteGrip(**of(lab)) as gripper:
        gripper.enable()
        assert gripper.open().ok
        assert gripper.close().ok
        for sample in gripper.states(hz=50):
            assert sample.opening_mm is not None
            break


def test_hello_says_through_what(lab: Fleet) -> None:
    with Client(lab.socket_path()) as client:
        hello = client.result("hello", client="probe")
    assert hello["channel"] == "lab.left"
    assert hello["role"] == "operator"
    assert hello["stop_socket"] == str(lab.socket_path().with_suffix(".stop.sock"))
    remote = hello["remote"]
    assert remote["channel"].startswith("left-")
    assert (remote["site"], remote["gripper"]) == ("lab", "left")
    assert (remote["user"], remote["role"]) == ("op1@lab", "operator")


def test_owner_and_journal_name_the_remote_user(lab: Fleet, gripper: DaemonProcess) -> None:
    with Client(lab.socket_path()) as client, gripper.connect() as local:
        client.result("hello", client="sorter")
        client.result("lease.acquire")
        owner = local.result("lease.get")["owner"]
        assert owner["program"] == "sorter of op1@lab via gateway"
        assert owner["ttl_s"] == 5.0
