"""Whom a leader's datagrams go to."""

import pytest

from litegripd.model.teleop import LinkOptions, udp_targets


@pytest.mark.parametrize(
    ("host", "targets"),
    [
        ("a", [("a", 9)]),
        ("10.0.0.2,10.0.0.3:17449", [("10.0.0.2", 9), ("10.0.0.3", 17449)]),
        ("a:1, b", [("a", 1), ("b", 9)]),
        ("fe80::1", [("fe80::1", 9)]),
        ("[fe80::1]", [("fe80::1", 9)]),
        ("[fe80::1%eth0]:5,b", [("fe80::1%eth0", 5), ("b", 9)]),
    ],
)
def test_hosts_and_their_ports(host: str, targets: list[tuple[str, int]]) -> None:
    assert list(udp_targets(LinkOptions("master", "udp", host, 9))) == targets


@pytest.mark.parametrize(
    "host",
    ["", ",", "a,", "a:", "a:0", "a:65536", "a:x", ":5", "[a:5", "a]", ",".join("abcdefghi")],
)
def test_what_names_nobody_is_refused(host: str) -> None:
    with pytest.raises(ValueError, match=r"HOST|port|most"):
        udp_targets(LinkOptions("master", "udp", host, 9))
