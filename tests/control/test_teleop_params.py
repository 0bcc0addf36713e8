"""What teleoperation is asked for: each wrong parameter is refused by its name, and why."""

from typing import Any

import pytest

from tests.control.teleop_scene import FAKE, MASTER, SLAVE, TeleopWorld

UDP: dict[str, Any] = {"mode": "master", "link": "udp"}
LED: dict[str, Any] = {"mode": "slave", "link": "client"}


def refused(asked: dict[str, Any], name: str) -> str:
    """Ask for what is refused before anything begins; return what is said."""
    world = TeleopWorld()
    error = world.enabled().call("teleop.start", **asked)["error"]
    assert (error["data"]["reason"], error["data"]["parameter"]) == ("invalid_params", name)
    assert world.wires.made == []
    assert world.controller.jobs.running is None
    message: str = error["message"]
    return message


@pytest.mark.parametrize(
    ("asked", "name"),
    [
        ({"mode": "slave"}, "host"),
        ({"mode": "both"}, "mode"),
        ({"mode": "slave", "link": "none"}, "link"),
        ({**MASTER, "host": "x"}, "host"),
        ({**MASTER, "fake_leader": True}, "fake_leader"),
        ({**MASTER, "reflect": True}, "reflect"),
        ({**MASTER, "reflect_gain": 0.5}, "reflect_gain"),
        ({**MASTER, "reflect_gain": 0.5, "reflect_n": 0}, "reflect_gain"),
        ({**MASTER, "reflect_n": 10.1}, "reflect_n"),
        ({**MASTER, "reflect_n": -1.0}, "reflect_n"),
        ({**MASTER, "bind": "127.0.0.1"}, "bind"),
        (UDP, "host"),
        ({**UDP, "host": "a:0"}, "host"),
        ({**UDP, "host": "a/b,c"}, "host"),
        ({**UDP, "host": "256.1.1.1"}, "host"),
        ({**UDP, "host": "10.0.0.2,a..b:17449"}, "host"),
        ({"mode": "slave", "link": "udp", "bind": "127.0.0.1/8"}, "bind"),
        ({**SLAVE, "host": "a/b"}, "host"),
        ({**SLAVE, "host": "a#iface=x"}, "host"),
        ({**SLAVE, "link": "udp", "host": "a,b"}, "host"),
        ({**SLAVE, "grip_id": "a/*"}, "grip_id"),
        ({**SLAVE, "grip_id": ""}, "grip_id"),
        ({**SLAVE, "port": 0}, "port"),
        ({**SLAVE, "bind": "127.0.0.1"}, "bind"),
        ({**SLAVE, "reflect_n": 3.0}, "reflect_n"),
        ({**SLAVE, "reflect_gain": 0.5}, "reflect_gain"),
        ({**FAKE, "reflect": True}, "reflect"),
        ({**LED, "host": "10.0.0.2"}, "host"),
        ({**LED, "reflect": True}, "reflect"),
        ({**LED, "bind": "10.0.0.2"}, "bind"),
        ({**LED, "mode": "master", "reflect_n": 4.0}, "reflect_n"),
        ({**LED, "mode": "master", "detach": True}, "detach"),
    ],
)
def test_what_does_not_go_together_is_refused_by_name(asked: dict[str, Any], name: str) -> None:
    assert name in refused(asked, name)


@pytest.mark.parametrize(
    ("name", "value", "limit"),
    [
        ("require_ready", 1, "must be true or false"),
        ("align", "no", "must be true or false"),
        ("ready_timeout_s", -1, "0 to 3600"),
        ("ready_tolerance_mm", -0.1, "0 to 100"),
        ("ready_period_s", 0, "0.001 to 10"),
        ("align_speed_mm_s", 0, "0.1 to 150"),
        ("align_speed_mm_s", 151, "0.1 to 150"),
        ("lead_cap_mm", -1, "0 to 100"),
        ("lead_cap_mm", 0.05, "0 (as far as the most torque leads), or 0.1 to 100"),
    ],
)
@pytest.mark.parametrize("mode", [MASTER, SLAVE])
def test_what_is_out_of_range_is_refused_with_the_limit(
    mode: dict[str, Any], name: str, value: object, limit: str
) -> None:
    assert limit in refused({**mode, name: value}, name)


def test_a_rate_above_the_control_rate_is_refused() -> None:
    assert TeleopWorld().enabled().refusal("teleop.start", **MASTER, rate_hz=201) == "out_of_limits"


@pytest.mark.parametrize(
    ("host", "why"),
    [
        ("[::1]", "in brackets: give '::1' as host"),
        ("10.0.0.2:17448", "with a port in it: give that as port, and '10.0.0.2' as host"),
        ("leader.local:17448", "with a port in it: give that as port, and 'leader.local' as host"),
        ("256.1.1.1", "which is no address of IPv4 or IPv6"),
        ("10.0.0", "which is no address of IPv4 or IPv6"),
        ("fe80:::1", "which is no address of IPv4 or IPv6"),
        ("0.0.0.0", "the address of no single machine"),
        ("::", "the address of no single machine"),
        ("224.0.0.1", "the address of no single machine"),
        ("255.255.255.255", "the address of no single machine"),
        ("leader..local", "which can be no machine's name: a part is empty or too long"),
        (f"{'a' * 64}.local", "which can be no machine's name: a part is empty or too long"),
    ],
)
@pytest.mark.parametrize("link", ["zenoh", "udp"])
def test_what_can_be_no_leaders_address_is_refused_and_not_waited_for(
    host: str, why: str, link: str
) -> None:
    assert why in refused({**SLAVE, "host": host, "link": link}, "host")


@pytest.mark.parametrize("host", ["leader", "leader.local.", "10.0.0.2", "fe80::1", "fe80::1%eth0"])
def test_what_can_be_a_leaders_address_is_taken(host: str) -> None:
    client = TeleopWorld().enabled()
    assert client.result("teleop.start", mode="slave", host=host)["active"]
