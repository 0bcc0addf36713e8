"""The router's rules, each allowed and refused, by real certificates.

What the rules cannot see, hostile and repeated messages, is tried in test_hostile.py.
"""

import json
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest
import zenoh

from litegrip_fleet.far.room import MOST_OF_A_USER, MOST_SESSIONS
from litegrip_fleet.wire.messages import Ask, Reply, packed, unpacked
from litegrip_fleet.wire.network import the_newest
from tests.process.daemon_process import DEADLINE_S, DaemonProcess, wait_a_moment
from tests.process.fleet.fleet_process import Fleet, make_certificates
from tests.process.fleet.on_network import LEFT, answers, connected

FLEET = {"users": {"op1": "operator", "op2": "operator", "viewer": "observer"}}
HELLO = b'{"jsonrpc":"2.0","id":1,"method":"hello"}\n'
STOP = b'{"jsonrpc":"2.0","id":1,"method":"stop","params":{"level":"hold"}}\n'


def opening(session: zenoh.Session, user: str, role: str) -> Reply | None:
    """Open a session; None if nobody answers. What has just connected may not be heard at once."""
    for _ in range(3):
        found = answers(session, LEFT.rpc(user, "s-1", role), b"", packed(Ask("open", ttl_s=1.0)))
        if found:
            return unpacked(Reply, found[0].attached)
    return None


ALLOWED = [
    ("op1", "op1", "operator"),
    ("op1", "op1", "observer"),
    ("op2", "op2", "operator"),
    ("viewer", "viewer", "observer"),
]
REFUSED = [
    ("op1", "op2", "operator"),
    ("op2", "op1", "observer"),
    ("op1", "op1", "admin"),
    ("viewer", "viewer", "operator"),
    ("viewer", "op1", "operator"),
    ("robot1", "op1", "operator"),
    ("forger", "op1", "observer"),
]


@pytest.mark.parametrize(("certificate", "user", "role"), ALLOWED)
def test_a_user_asks_by_his_own_name_and_up_to_his_own_role(
    site: Fleet, certificate: str, user: str, role: str
) -> None:
    with connected(site, certificate) as session:
        reply = opening(session, user, role)
    assert reply is not None
    assert reply.about is not None
    assert (reply.about["user"], reply.about["role"]) == (f"{user}@lab", role)


@pytest.mark.parametrize(("certificate", "user", "role"), REFUSED)
def test_nobody_asks_by_anothers_name_or_above_his_own_role(
    site: Fleet, certificate: str, user: str, role: str
) -> None:
    with connected(site, certificate) as session:
        assert opening(session, user, role) is None


@pytest.mark.parametrize(
    "key",
    [
        f"{LEFT.key}/rpc/*/s-1/operate",
        f"{LEFT.key}/rpc/op1/*/*",
        f"{LEFT.key}/rpc/**",
        f"{LEFT.key}/stop/*",
        f"{LEFT.key}/stop/op2",
        "litegripd/1/*/*/stop/*",
        "litegripd/1/**",
        "**",
    ],
)
def test_no_wildcard_reaches_further_than_its_user(site: Fleet, key: str) -> None:
    with connected(site, "op1") as session:
        assert answers(session, key, STOP, packed(Ask("open"))) == []


@pytest.mark.parametrize(
    "key", [LEFT.stop("op1"), "litegripd/1/lab/*/stop/op1", "litegripd/1/*/*/stop/op1"]
)
def test_everybody_stops_by_his_own_name_one_gripper_or_all(site: Fleet, key: str) -> None:
    with connected(site, "op1") as session:
        (answer,) = answers(session, key, STOP)
    assert answer.key == LEFT.stop("op1")
    assert json.loads(answer.payload)["result"]["level"] == "hold"


def test_an_observer_stops_too(site: Fleet) -> None:
    with connected(site, "viewer") as session:
        assert answers(session, LEFT.stop("viewer"), STOP)


def test_a_user_who_is_in_the_table_no_more_does_nothing(site: Fleet) -> None:
    with connected(site, "former") as session:
        assert opening(session, "former", "observer") is None
        assert answers(session, LEFT.stop("former"), STOP) == []
        assert answers(session, LEFT.about) == []


@pytest.mark.parametrize("certificate", ["op2", "forger"])
def test_a_forged_gateway_is_asked_nothing_and_says_nothing(site: Fleet, certificate: str) -> None:
    with connected(site, certificate) as forger, connected(site, "op1") as session:
        asked = forger.declare_queryable(f"{LEFT.key}/rpc/**", the_newest())
        assert opening(session, "op1", "operator") is not None
        assert asked.try_recv() is None
        heard = session.declare_subscriber(LEFT.to("op1", "s-1"), the_newest())
        forger.put(LEFT.to("op1", "s-1"), b"x")
        assert opening(session, "op1", "observer") is not None  # later than the forgery
        assert heard.try_recv() is None


def test_nobody_hears_what_is_said_to_another(site: Fleet) -> None:
    with connected(site, "op2") as spy, connected(site, "op1") as session:
        heard = spy.declare_subscriber("litegripd/1/*/*/to/**", the_newest())
        key = LEFT.rpc("op1", "s-7", "operator")
        assert answers(session, key, b"", packed(Ask("open", ttl_s=1.0)))
        at_s = 0.0  # `hello` moves nothing: its age does not count
        assert answers(session, key, HELLO, packed(Ask("line", 1, at_s=at_s)))
        assert answers(session, key, b"", packed(Ask("live")))
        assert heard.try_recv() is None


def test_whoever_shows_no_certificate_is_not_let_in(site: Fleet) -> None:
    with pytest.raises(zenoh.ZError), connected(site, None):
        pass


def test_a_certificate_of_another_authority_is_not_let_in(site: Fleet, tmp_path: Path) -> None:
    others = make_certificates(tmp_path / "others", "user:op1")
    (others / "op1/ca.pem").write_bytes((site.certificates / "op1/ca.pem").read_bytes())
    with pytest.raises(zenoh.ZError), connected(site, "op1", others):
        pass


def test_a_certificate_that_is_made_here_is_let_in_while_it_is_valid(
    site: Fleet, tmp_path: Path
) -> None:
    """So that the next tests refuse what they say."""
    make_certificate(site.certificates, tmp_path / "op1", -3600, 3600)
    with connected(site, "op1", tmp_path) as session:
        assert list(session.info.routers_zid())


@pytest.mark.parametrize(
    ("begins_s", "ends_s"),
    [(-48 * 3600, -24 * 3600), (3 * 3600, 24 * 3600)],
    ids=["expired", "of a machine whose clock is hours ahead"],
)
def test_a_certificate_is_not_let_in_before_or_after_its_time(
    site: Fleet, tmp_path: Path, begins_s: float, ends_s: float
) -> None:
    make_certificate(site.certificates, tmp_path / "op1", begins_s, ends_s)
    with pytest.raises(zenoh.ZError), connected(site, "op1", tmp_path):
        pass


def test_a_certificate_that_is_over_in_mid_session_ends_it_and_lets_nobody_in_again(
    site: Fleet, tmp_path: Path
) -> None:
    """The gateway's session for it then shows no life, and ends with its time to live."""
    folder = tmp_path / "short"
    until_s = make_certificate(site.certificates, folder / "op1", -3600, 8)
    with connected(site, "op1", folder) as session:
        key = LEFT.rpc("op1", "short", "operator")
        while not answers(session, key, b"", packed(Ask("open", ttl_s=5.0))):
            assert time.time() < until_s, "this machine is too busy: it is over"
        while session.info.routers_zid():
            assert time.time() < until_s + DEADLINE_S
            wait_a_moment(site.router.process)
        assert time.time() > until_s - 1.0
        assert answers(session, key, b"", packed(Ask("live"))) == []
    with pytest.raises(zenoh.ZError), connected(site, "op1", folder):
        pass
    with connected(site, "op1") as session:  # with another certificate, he is the same user
        assert opening(session, "op1", "operator") is not None


def make_certificate(authority: Path, own: Path, from_s: float, until_s: float) -> float:
    """Make a certificate for op1, valid from and until so many seconds after now.

    Return the Unix time when it is over.
    """
    now_s = time.time()
    starts, ends = (
        time.strftime("%Y%m%d%H%M%SZ", time.gmtime(now_s + after_s))
        for after_s in (from_s, until_s)
    )
    own.mkdir(parents=True)
    (own / "ca.pem").write_bytes((authority / "ca.pem").read_bytes())
    (own / "index").touch()
    (own / "ca.cnf").write_text(
        f"[ca]\ndefault_ca=own\n[own]\ndatabase={own}/index\nnew_certs_dir={own}\nrand_serial=yes\n"
        "default_md=sha256\npolicy=any\nx509_extensions=client\n[any]\ncommonName=supplied\n"
        "[client]\nbasicConstraints=critical,CA:FALSE\nextendedKeyUsage=clientAuth\n",
        encoding="utf-8",
    )
    dates = f"-startdate {starts} -enddate {ends}"
    for command in (
        f"req -newkey rsa:2048 -nodes -subj /CN=op1 -keyout {own}/own.key -out {own}/own.csr",
        f"ca -batch -config {own}/ca.cnf -cert {authority}/ca.pem -keyfile {authority}/ca.key",
    ):
        files = f"-in {own}/own.csr -out {own}/own.pem {dates}" if command[:2] == "ca" else ""
        arguments = ["openssl", *command.split(), *files.split()]
        subprocess.run(arguments, check=True, capture_output=True, timeout=DEADLINE_S)
    return now_s + until_s


def test_a_gateway_sees_its_own_grippers_and_no_others(site: Fleet) -> None:
    def seen(session: zenoh.Session, key: str) -> list[str]:
        replies = session.liveliness().get(key, timeout=1.5)
        return [str(reply.ok.key_expr) for reply in replies if reply.ok is not None]

    with connected(site, "robot1") as gateway, connected(site, "forger") as forger:
        while not seen(gateway, LEFT.alive):  # what has just connected may not see it at once
            wait_a_moment(site.router.process)
        assert seen(gateway, LEFT.alive) == [LEFT.alive]
        assert seen(gateway, f"{LEFT.key}/**") == []
        assert seen(gateway, "litegripd/1/*/*/alive") == []
        assert seen(forger, LEFT.alive) == []


def test_two_users_who_fill_a_grippers_sessions_leave_one_for_a_third(
    site: Fleet, gripper: DaemonProcess
) -> None:
    """And who is refused is told why, and who has them."""

    def filled(session: zenoh.Session, user: str, role: str) -> dict[str, Any]:
        for number in range(2 * MOST_SESSIONS):
            key, begins = LEFT.rpc(user, f"many-{number}", role), packed(Ask("open", ttl_s=5.0))
            while not (found := answers(session, key, b"", begins)):
                continue
            if (gone := unpacked(Reply, found[0].attached).gone) is not None:
                return gone
        raise AssertionError("there is no end")

    with connected(site, "op1") as op1, connected(site, "viewer") as viewer:
        assert filled(op1, "op1", "operator")["data"]["reason"] == "too_many_connections"
        told = filled(viewer, "viewer", "observer")
        assert f"op1 has {MOST_OF_A_USER}, viewer has " in told["message"]
        with connected(site, "op2") as op2:
            begun = opening(op2, "op2", "operator")
        assert begun is not None
        assert begun.about is not None
    with gripper.connect() as local:  # they end with their time, for the tests that follow
        local.until(lambda _state: len(local.result("clients.list")["clients"]) < MOST_OF_A_USER)
