"""What the check finds: each kind of finding, well and wrong, from facts alone."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.ctl.findings import Finding
from litegrip_fleet.admin import findings
from litegrip_fleet.admin.certificates import DAY_S, Certificate
from litegrip_fleet.admin.config import FleetConfig, load
from litegrip_fleet.admin.findings import (
    DaemonFacts,
    EndpointFacts,
    FileFacts,
    Kind,
    Measured,
    Unmeasured,
)
from litegrip_fleet.wire.keys import Place

NOW_S = 1_800_000_000.0
LEFT = Place("lab", "left")
GOOD = Certificate("op1", ("op1",), NOW_S - 1.0, NOW_S + 100 * DAY_S, "1")
TLS = '[network]\nca = "a"\ncertificate = "b"\nkey = "c"\n'
PORTAL = '[portal]\nuser = "op1"\ngrippers = ["lab.left"]\n'
GATEWAY = '[gateway]\nsite = "lab"\ngrippers = { left = "can0" }\n'
ROUTER = '[router]\nlisten = ["tls/0.0.0.0:7447"]\n'


def lasting(days: float) -> Certificate:
    return Certificate("op1", (), NOW_S - DAY_S, NOW_S + days * DAY_S, "1")


def configured(tmp_path: Path, text: str) -> FleetConfig:
    file = tmp_path / "fleet.toml"
    file.write_text(TLS + text, encoding="utf-8")
    return load(str(file))


def says(finding: Finding | None, level: str, *words: str) -> None:
    """Check a finding's level and words, and that whatever is not well says what to do."""
    assert finding is not None
    assert finding.level == level, finding
    text = f"{finding.text} | {finding.command} | {finding.advice}"
    for word in words:
        assert word in text
    if level != "ok":
        assert finding.command or finding.advice
    assert "\n" not in text


@pytest.mark.parametrize(
    ("file", "are_others", "level", "words"),
    [
        (FileFacts("ca", "/t/ca.pem"), True, "ok", ["/t/ca.pem"]),
        (FileFacts("key", "/t/own.key", mode=0o640), True, "ok", []),
        (FileFacts("ca", "/t/ca.pem", mode=0o644), True, "ok", []),
        (FileFacts("key", "/t/own.key", mode=0o644), True, "error", ["chmod o= /t/own.key"]),
        (FileFacts("key", "/t/own.key", is_missing=True), True, "error", ["not there"]),
        (
            FileFacts("key", "/t/own.key", closed_to=("litegrip-portal",)),
            True,
            "error",
            ["litegrip-portal may not read /t/own.key", "chgrp -R litegrip-fleet /t "],
        ),
        (FileFacts("key", "/t/k", "Permission denied"), True, "warning", ["sudo litegripd-fleet"]),
        (FileFacts("key", "/t/k", "Permission denied"), False, "error", ["chgrp"]),
    ],
)
def test_files(file: FileFacts, are_others: bool, level: str, words: list[str]) -> None:
    says(findings.of_file(file, parts_are_others=are_others), level, *words)


@pytest.mark.parametrize(
    ("certificate", "level", "words"),
    [
        (lasting(31), "ok", ["for 31 days"]),
        (lasting(29.5), "warning", ["for 29 days", "etc/zenoh-certificates", "restart the parts"]),
        (lasting(-0.1), "error", ["has been over since"]),
        (
            Certificate("op1", (), NOW_S + DAY_S, NOW_S + 9 * DAY_S, "1"),
            "error",
            ["valid only from", "timedatectl"],
        ),
        ("belongs to another key than k", "error", ["own.pem belongs to another key"]),
    ],
)
def test_certificates(certificate: Certificate | str, level: str, words: list[str]) -> None:
    says(findings.of_certificate(certificate, NOW_S, "own.pem"), level, *words)


def test_the_authority_of_a_fleet_is_not_teleoperations() -> None:
    for name, level in (("litegrip fleet", "ok"), ("litegrip teleoperation", "warning")):
        authority = Certificate(name, (), NOW_S - DAY_S, NOW_S + 99 * DAY_S, "1")
        says(findings.of_certificate(authority, NOW_S, "ca.pem"), level, "ca.pem")


def test_the_clock() -> None:
    assert findings.of_clock([], NOW_S) is None
    says(findings.of_clock([GOOD], NOW_S), "ok", "2027-01-15")
    early = Certificate("router.lab", (), NOW_S + 99.0, NOW_S + DAY_S, "1")
    says(findings.of_clock([GOOD, early], NOW_S), "error", "router.lab", "timedatectl")


@pytest.mark.parametrize(
    ("text", "name", "level", "words"),
    [
        (PORTAL, "op1", "ok", []),
        (PORTAL, "op2", "error", ["user is 'op1'", "that of 'op2'", "set user = 'op2'"]),
        (PORTAL + ROUTER, "op1", "error", ["not in [router.users]", 'op1 = "operator"']),
        (PORTAL + ROUTER + 'users = { op1 = "admin" }\n', "op1", "ok", ["admin"]),
        (
            PORTAL + ROUTER + 'users = { op1 = "observer" }\n',
            "op1",
            "error",
            ["role is operator", "observer"],
        ),
        (GATEWAY, "robot1", "ok", ['robot1 = ["lab.left"] in [router.gateways]']),
        (GATEWAY + ROUTER, "robot1", "error", ["does not let robot1 offer lab.left"]),
        (
            GATEWAY + ROUTER + 'gateways = { robot1 = ["lab.left", "lab.x"] }\n',
            "robot1",
            "ok",
            ["may offer lab.left"],
        ),
        (
            GATEWAY + ROUTER + 'gateways = { robot1 = ["lab.x"], robot2 = ["lab.left"] }\n',
            "robot1",
            "error",
            ["lab.left"],
        ),
    ],
)
def test_the_name_of_the_certificate(
    tmp_path: Path, text: str, name: str, level: str, words: list[str]
) -> None:
    (found,) = findings.of_identity(configured(tmp_path, text), name)
    says(found, level, *words)


def test_parts(tmp_path: Path) -> None:
    says(findings.of_parts(configured(tmp_path, PORTAL + GATEWAY)), "ok", "gateway, portal")
    says(findings.of_parts(configured(tmp_path, "")), "warning", "nothing runs here")


def test_encryption() -> None:
    assert findings.of_encryption(insecure=False) is None
    found = findings.of_encryption(insecure=True)
    says(found, "warning", "insecure = true", "etc/zenoh-certificates")


PROBLEMS: Mapping[Kind, str] = {
    "refused": "is the port right",
    "timeout": "firewall",
    "no_route": "network up",
    "unknown_host": "/etc/hosts",
    "certificate": "in the router's certificate",
    "endpoint": "tls/HOST:PORT",
    "other": "is it a router",
}


@pytest.mark.parametrize("kind", PROBLEMS)
def test_a_router_that_is_not_reached_says_why(kind: Kind) -> None:
    facts = EndpointFacts("tls/r:1", None, kind, "alas")
    says(findings.of_endpoint(facts, NOW_S), "error", "tls/r:1: alas", PROBLEMS[kind])


def test_a_router_that_is_reached() -> None:
    says(findings.of_endpoint(EndpointFacts("tcp/r:1"), NOW_S), "ok", "tcp/r:1 answers")
    for days, level in ((100, "ok"), (3, "warning"), (-3, "error")):
        facts = EndpointFacts("tls/r:1", lasting(days))
        says(findings.of_endpoint(facts, NOW_S), level, "tls/r:1")
    says(findings.of_no_session("tls/r:1", 3.0), "error", "no session", "3 s")


def test_the_own_router() -> None:
    well = EndpointFacts("tls/127.0.0.1:1", GOOD)
    says(findings.of_listening(well, GOOD), "ok", "listens")
    says(findings.of_listening(EndpointFacts("tcp/127.0.0.1:1"), None), "ok")
    old = EndpointFacts("tls/127.0.0.1:1", Certificate("r", (), 0.0, 1.0, "2"))
    says(findings.of_listening(old, GOOD), "warning", "from before", "restart")
    silent = EndpointFacts("tls/127.0.0.1:1", None, "refused", "connection refused")
    says(findings.of_listening(silent, GOOD), "error", "refused", "enable --now", "journalctl")
    wrong = EndpointFacts("udp", None, "endpoint", "is no endpoint")
    says(findings.of_listening(wrong, GOOD), "error", "tls/HOST:PORT")


def test_the_names_of_the_own_router() -> None:
    says(findings.of_names(GOOD, None, None), "ok", "as op1")
    says(findings.of_names(GOOD, "r", "is not made for this name"), "error", "(r)")
    says(findings.of_names(lasting(9), None, None), "error", "no host name")


@pytest.mark.parametrize(
    ("state", "level", "words"),
    [
        ("active", "ok", []),
        ("inactive", "error", ["enable --now litegripd-fleet@portal"]),
        ("failed", "error", ["journalctl -u litegripd-fleet@portal"]),
        ("activating", "error", ["again and again"]),
        ("", "error", ["unknown"]),
    ],
)
def test_units(state: str, level: str, words: list[str]) -> None:
    says(findings.of_unit("portal", state), level, *words)


@pytest.mark.parametrize(
    ("facts", "level", "words"),
    [
        (DaemonFacts("left", "can0", "1.2", asked_as="g"), "ok", ["left (can0)", "trusts g"]),
        (DaemonFacts("left", "can0", "1.2"), "warning", ["not known", "sudo litegripd-fleet"]),
        (DaemonFacts("left", "can0"), "warning", ["was not asked", "sudo litegripd-fleet check"]),
        (
            DaemonFacts("left", "can0", "1.2", distrust="no", asked_as="g"),
            "error",
            ['gateways = ["g"]', "reload litegripd@can0"],
        ),
        (DaemonFacts("left", "can0", problem="gone", hint="start it"), "error", ["start it"]),
    ],
)
def test_daemons(facts: DaemonFacts, level: str, words: list[str]) -> None:
    says(findings.of_daemon(facts), level, *words)


def test_what_is_offered() -> None:
    says(findings.of_offered(LEFT, is_seen=True), "ok", "lab.left")
    says(findings.of_offered(LEFT, is_seen=False), "error", "[router.gateways]")


def test_remote_grippers() -> None:
    says(findings.of_remote(LEFT, {"verdict": "ok"}), "ok", "verdict is ok")
    says(findings.of_remote(LEFT, None), "error", "not on the network", "[router.users]")
    kept_out = findings.of_remote(LEFT, {"verdict": "ok", "kept_out": 2})
    says(kept_out, "warning", "2 times", "with its id", "litegripd-fleet@router")
    says(findings.of_remote(LEFT, {"error": "it is silent"}), "error", "it is silent")


@pytest.mark.parametrize(
    ("facts", "level", "words"),
    [
        (Unmeasured("closed", is_silent=True, is_closed=True), "warning", ["usermod"]),
        (Unmeasured("none", is_silent=True, is_closed=False), "error", ["enable --now"]),
        (Unmeasured("lost", is_silent=False, is_closed=False), "error", ["the portal runs"]),
    ],
)
def test_sockets_that_do_not_answer(facts: Unmeasured, level: str, words: list[str]) -> None:
    ((name, found),) = findings.of_socket(LEFT, facts, "1.0")
    assert name == "portal"
    says(found, level, *words)


def measured(round_trip_s: float = 0.002, **hello: Any) -> dict[str, Finding]:
    own = {"version": "1.0", "protocol": 1, "remote": {"gateway": "1.0", "portal": "1.0"}, **hello}
    times_s = [round_trip_s, round_trip_s / 2, round_trip_s]
    return dict(findings.of_socket(LEFT, Measured(own, times_s, [0.01, None, 0.03]), "1.0"))


def test_versions() -> None:
    says(measured()["versions"], "ok", "1.0 everywhere")
    says(measured(version="1.1")["versions"], "ok", "daemon 1.1, gateway 1.0, portal 1.0, here 1.0")
    says(measured(protocol=2)["versions"], "warning", "protocol 2", "same major version")


@pytest.mark.parametrize(
    ("round_trip_s", "level", "words"),
    [
        (0.002, "ok", ["round trip 2.0 ms", "age of the state 20 ms", "at most 0.5 ms"]),
        (0.19, "ok", []),
        (0.21, "warning", ["some will come too late"]),
        (0.39, "warning", []),
        (0.41, "error", ["no set-point can arrive"]),
    ],
)
def test_times(round_trip_s: float, level: str, words: list[str]) -> None:
    says(measured(round_trip_s)["time"], level, *words)


def test_an_age_that_is_not_known_is_said_to_be_so() -> None:
    facts = Measured({}, [0.001], [None])
    says(dict(findings.of_socket(LEFT, facts, "1"))["time"], "ok", "state unknown")
