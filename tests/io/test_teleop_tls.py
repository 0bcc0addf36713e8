"""A zenoh link behind the TLS of etc/: strangers neither lead, nor follow, nor hear anything."""

import base64
import json
import shutil
import socket
import struct
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from litegripd.model.teleop import LinkOptions
from litegripd.teleop.link import Link
from litegripd.teleop.links import TeleopLinks
from tests.control.reflection_pair import force_frame
from tests.io.test_teleop_links import free_port, until

ETC = Path(__file__).resolve().parents[2] / "etc"
FRAME = struct.pack(">4d", 0.25, 30.0, 0.0, 1.0)
FORCE = force_frame(3.0, 1.0, 1.0)
INSTALLED = "/etc/litegripd/tls"

pytestmark = pytest.mark.skipif(
    shutil.which("openssl") is None, reason="needs openssl for its certificates"
)


def certificates(folder: Path) -> None:
    command = [str(ETC / "zenoh-certificates"), str(folder), "localhost", "127.0.0.1"]
    subprocess.run(command, check=True, capture_output=True)


def configuration(folder: Path, machine: str) -> str:
    """Return the sample's file for one machine, with its certificates where they are here."""
    sample = (ETC / "zenoh-tls.json5").read_text(encoding="utf-8")
    assert sample.count(INSTALLED) == 5
    path = folder / f"{machine}.json5"
    path.write_text(sample.replace(INSTALLED, str(folder / machine)), encoding="utf-8")
    return str(path)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("tls")
    certificates(folder / "own")
    certificates(folder / "strange")
    return folder


@pytest.fixture
def links(folder: Path) -> Iterator[Callable[[str | None], TeleopLinks]]:
    made: list[TeleopLinks] = []

    def make(machine: str | None) -> TeleopLinks:
        whose, _, name = (machine or "").partition("/")
        file = configuration(folder / whose, name) if machine else None
        made.append(TeleopLinks(file))
        return made[-1]

    yield make
    for one in made:
        one.close()


def opened(links: TeleopLinks, options: LinkOptions) -> Link:
    link = links.open(options)
    until(link, lambda: link.status.state == "open")
    return link


Make = Callable[[str | None], TeleopLinks]


def test_frames_travel_encrypted_both_ways_and_strangers_hear_nothing(links: Make) -> None:
    port = free_port(socket.SOCK_STREAM)
    leader = opened(links("own/localhost"), LinkOptions("master", port=port, reflects=True))
    options = LinkOptions("slave", host="localhost", port=port, reflects=True)
    strangers = [opened(links(who), options) for who in (None, "strange/localhost")]
    follower = opened(links("own/127.0.0.1"), options)
    heard: list[bytes] = []
    felt: list[bytes] = []

    def is_heard() -> bool:
        leader.publish(FRAME, 0.0)
        follower.reply(FORCE, "", 0.0)
        for stranger in strangers:
            stranger.reply(bytes(40), "", 0.0)
        heard.extend(arrival.payload for arrival in follower.receive(0.0))
        felt.extend(arrival.payload for arrival in leader.receive(0.0))
        return len(heard) > 20 and len(felt) > 20

    until(follower, is_heard)
    assert set(heard) == {FRAME}
    assert set(felt) == {FORCE}
    assert [stranger.receive(0.0) for stranger in strangers] == [[], []]
    assert leader.status.is_protected is follower.status.is_protected is True


def test_a_follower_does_not_believe_a_leader_of_another_authority(links: Make) -> None:
    port = free_port(socket.SOCK_STREAM)
    leader = opened(links("strange/localhost"), LinkOptions("master", port=port))
    options = LinkOptions("slave", host="localhost", port=port)
    follower = opened(links("own/localhost"), options)
    own = opened(links("strange/127.0.0.1"), options)
    heard: list[bytes] = []

    def is_heard() -> bool:
        leader.publish(FRAME, 0.0)
        heard.extend(arrival.payload for arrival in own.receive(0.0))
        return len(heard) > 20

    until(leader, is_heard)
    assert follower.receive(0.0) == []


def test_certificates_within_the_configuration_are_used_as_those_in_files(
    folder: Path, tmp_path: Path, links: Make
) -> None:
    def inside(name: str) -> str:
        return base64.b64encode((folder / "own" / "localhost" / name).read_bytes()).decode()

    tls: dict[str, object] = {"enable_mtls": True, "root_ca_certificate_base64": inside("ca.pem")}
    for end in ("listen", "connect"):
        tls[f"{end}_certificate_base64"] = inside("own.pem")
        tls[f"{end}_private_key_base64"] = inside("own.key")
    file = tmp_path / "zenoh.json5"
    file.write_text(json.dumps({"transport": {"link": {"tls": tls}}}), encoding="utf-8")
    port = free_port(socket.SOCK_STREAM)
    within = TeleopLinks(str(file))
    try:
        leader = opened(within, LinkOptions("master", port=port))
        follower = opened(links("own/127.0.0.1"), LinkOptions("slave", host="localhost", port=port))
        heard: list[bytes] = []

        def is_heard() -> bool:
            leader.publish(FRAME, 0.0)
            heard.extend(arrival.payload for arrival in follower.receive(0.0))
            return len(heard) > 20

        until(leader, is_heard)
        assert leader.status.is_protected is follower.status.is_protected is True
    finally:
        within.close()


def access_list(*, enabled: bool, otherwise: str) -> dict[str, object]:
    rule = {
        "id": "teleop",
        "permission": "allow",
        "flows": ["ingress", "egress"],
        "messages": ["put", "declare_subscriber"],
        "key_exprs": ["litearm/v4/**"],
    }
    return {
        "access_control": {
            "enabled": enabled,
            "default_permission": otherwise,
            "rules": [rule],
            "subjects": [{"id": "here", "interfaces": ["lo"]}],
            "policies": [{"rules": ["teleop"], "subjects": ["here"]}],
        }
    }


@pytest.mark.parametrize(
    ("content", "leads", "follows"),
    [
        ({}, False, False),
        ({"transport": {"link": {"tls": {"enable_mtls": True}}}}, False, False),
        (access_list(enabled=True, otherwise="deny"), True, False),
        (access_list(enabled=True, otherwise="allow"), False, False),
        (access_list(enabled=False, otherwise="deny"), False, False),
    ],
)
def test_a_configuration_that_protects_nothing_is_told(
    tmp_path: Path, content: dict[str, object], leads: bool, follows: bool
) -> None:
    file = tmp_path / "zenoh.json5"
    file.write_text(json.dumps(content), encoding="utf-8")
    port = free_port(socket.SOCK_STREAM)
    for options, expected in (
        (LinkOptions("master", port=port), leads),
        (LinkOptions("slave", host="127.0.0.1", port=port), follows),
    ):
        links = TeleopLinks(str(file))
        try:
            assert links.is_open_to_network is None
            assert opened(links, options).status.is_protected is expected
            assert links.is_open_to_network is not expected
        finally:
            links.close()
