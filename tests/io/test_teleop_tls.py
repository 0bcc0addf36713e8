"""A zenoh link behind TLS: who has no certificate neither leads nor listens."""

import json
import shutil
import socket
import struct
import subprocess
from collections.abc import Iterator

import pytest

from litegripd.io.teleop_links import TeleopLinks
from litegripd.model.teleop import LinkWish
from tests.io.test_teleop_links import free_port, until

FRAME = struct.pack(">4d", 0.25, 30.0, 0.0, 1.0)

pytestmark = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="needs openssl for its certificates"
)


def openssl(*arguments: str) -> None:
    subprocess.run(["openssl", *arguments], check=True, capture_output=True)


@pytest.fixture(scope="module")
def configuration(tmp_path_factory: pytest.TempPathFactory) -> str:
    """Write a zenoh configuration in which both ends show a certificate of our own."""
    folder = tmp_path_factory.mktemp("tls")
    key, certificate = str(folder / "key.pem"), str(folder / "cert.pem")
    openssl(
        *("req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2"),
        *("-keyout", key, "-out", certificate, "-subj", "/CN=localhost"),
        *("-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1"),
        *("-addext", "basicConstraints=critical,CA:FALSE"),
    )
    tls = {
        "root_ca_certificate": certificate,
        "listen_private_key": key,
        "listen_certificate": certificate,
        "connect_private_key": key,
        "connect_certificate": certificate,
        "enable_mtls": True,
    }
    path = folder / "zenoh.json5"
    path.write_text(json.dumps({"transport": {"link": {"tls": tls}}}), encoding="utf-8")
    return str(path)


@pytest.fixture
def ends(configuration: str) -> Iterator[tuple[TeleopLinks, TeleopLinks, TeleopLinks]]:
    ends = TeleopLinks(configuration), TeleopLinks(configuration), TeleopLinks()
    yield ends
    for links in ends:
        links.close()


def test_frames_travel_encrypted_and_strangers_hear_nothing(
    ends: tuple[TeleopLinks, TeleopLinks, TeleopLinks],
) -> None:
    leading, following, strange = ends
    port = free_port(socket.SOCK_STREAM)
    leader = leading.open(LinkWish("master", port=port))
    until(leader, lambda: leader.status.state == "open")
    stranger = strange.open(LinkWish("slave", host="localhost", port=port))
    until(stranger, lambda: stranger.status.state == "open")
    follower = following.open(LinkWish("slave", host="localhost", port=port))
    until(follower, lambda: follower.status.state == "open")
    heard: list[bytes] = []

    def is_heard() -> bool:
        leader.publish(FRAME, 0.0)
        heard.extend(arrival.payload for arrival in follower.receive(0.0))
        return len(heard) > 20

    until(leader, is_heard)
    assert set(heard) == {FRAME}
    assert stranger.receive(0.0) == []
