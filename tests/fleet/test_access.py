"""The router's rules, judged by a reader of their own; and zenohd's files that allow more."""

import copy
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
import zenoh
from hypothesis import given
from hypothesis import strategies as st

from litegrip_fleet.admin.access import ROLES, rules
from litegrip_fleet.admin.acl_check import wider
from litegrip_fleet.admin.main import main
from litegrip_fleet.wire.keys import CLASSES, PREFIX, Place
from tests.properties import examples

NAMES = st.from_regex(r"[A-Za-z0-9_-]{1,8}", fullmatch=True)
USERS = st.dictionaries(NAMES, st.sampled_from(ROLES), max_size=4)
PLACES = st.builds(Place, NAMES, NAMES)
GATEWAYS = st.dictionaries(NAMES, st.lists(PLACES, min_size=1, max_size=2), max_size=3)
TABLES = st.tuples(USERS, GATEWAYS).filter(lambda table: not set(table[0]) & set(table[1]))

LEFT = Place("lab", "left")
OWN = rules({"op1": "operator", "viewer": "observer"}, {"robot1": [LEFT]})


def may(control: Mapping[str, Any], who: str, flow: str, message: str, key: str) -> bool:
    """Return whether the rules let a certificate's owner do something, as zenoh reads them."""
    subjects = [one["id"] for one in control["subjects"] if who in one["cert_common_names"]]
    own = {
        rule
        for policy in control["policies"]
        if set(policy["subjects"]) & set(subjects)
        for rule in policy["rules"]
    }
    return any(
        zenoh.KeyExpr(pattern).includes(zenoh.KeyExpr(key))
        for rule in control["rules"]
        if rule["id"] in own and flow in rule["flows"] and message in rule["messages"]
        for pattern in rule["key_exprs"]
    )


@examples(60)
@given(TABLES, PLACES, NAMES)
def test_a_user_is_nobody_else_and_no_more_than_he_is(
    table: tuple[Mapping[str, str], Mapping[str, list[Place]]], place: Place, stranger: str
) -> None:
    users, gateways = table
    made = rules(users, gateways)
    for user, role in users.items():
        for asked in ROLES:
            is_allowed = ROLES.index(asked) <= ROLES.index(role)
            assert may(made, user, "ingress", "query", place.rpc(user, "s", asked)) is is_allowed
        assert may(made, user, "ingress", "query", place.stop(user))
        assert may(made, user, "ingress", "declare_subscriber", place.to(user, "s"))
        others = {*users, *gateways, stranger} - {user}
        for other in others:
            for asked in ROLES:
                assert not may(made, user, "ingress", "query", place.rpc(other, "s", asked))
            assert not may(made, user, "ingress", "query", place.stop(other))
            assert not may(made, user, "ingress", "declare_subscriber", place.to(other, "s"))
            assert not may(made, user, "egress", "put", place.to(other, "s"))
        for key in (f"{place.key}/rpc/**", f"{place.key}/stop/*", f"{PREFIX}/**", "**"):
            assert not may(made, user, "ingress", "query", key)
        for message in ("put", "delete", "declare_queryable", "reply", "liveliness_token"):
            assert not may(made, user, "ingress", message, place.to(user, "s"))
            assert not may(made, user, "ingress", message, place.rpc(user, "s", role))
            assert not may(made, user, "ingress", message, place.alive)


@examples(60)
@given(TABLES, PLACES, NAMES)
def test_a_gateway_is_its_own_grippers_and_asks_nothing(
    table: tuple[Mapping[str, str], Mapping[str, list[Place]]], place: Place, user: str
) -> None:
    users, gateways = table
    made = rules(users, gateways)
    for gateway, own in gateways.items():
        for asked in [*own, place]:
            is_own = asked in own
            for key in (f"{asked.key}/rpc/**", asked.stop(user), asked.about):
                assert may(made, gateway, "ingress", "declare_queryable", key) is is_own
                assert may(made, gateway, "ingress", "reply", key) is is_own
            assert may(made, gateway, "ingress", "put", asked.to(user, "s")) is is_own
            assert may(made, gateway, "ingress", "liveliness_token", asked.alive) is is_own
            assert not may(made, gateway, "ingress", "query", asked.stop(user))
            for role in CLASSES:
                key = asked.rpc(user, "s", role)
                assert not may(made, gateway, "ingress", "query", key)
                assert may(made, gateway, "egress", "query", key) is is_own
            assert not may(made, gateway, "ingress", "declare_subscriber", asked.to(user, "s"))


def test_the_rules_themselves_are_not_too_wide() -> None:
    assert wider(OWN, OWN) == []


def narrower(control: dict[str, Any]) -> None:
    control["rules"][0]["key_exprs"] = [LEFT.rpc("op1", "s", "observer")]


def allows_by_default(control: dict[str, Any]) -> None:
    control["default_permission"] = "allow"


def is_off(control: dict[str, Any]) -> None:
    control["enabled"] = False


def has_a_higher_role(control: dict[str, Any]) -> None:
    rule_of(control, "user viewer asks")["key_exprs"].append(LEFT.rpc("viewer", "*", "operator"))


def has_a_wildcard(control: dict[str, Any]) -> None:
    rule_of(control, "user op1 asks")["key_exprs"] = [f"{PREFIX}/*/*/rpc/*/*/operate"]


def has_another_message(control: dict[str, Any]) -> None:
    rule_of(control, "user op1 hears")["messages"].append("declare_queryable")


def goes_both_ways(control: dict[str, Any]) -> None:
    rule_of(control, "user op1 hears")["flows"] = None


def is_for_everybody(control: dict[str, Any]) -> None:
    control["subjects"][0]["cert_common_names"] = None


def is_anothers_too(control: dict[str, Any]) -> None:
    control["policies"][1]["rules"].append("user op1 asks")


def rule_of(control: Mapping[str, Any], identity: str) -> dict[str, Any]:
    (found,) = [rule for rule in control["rules"] if rule["id"] == identity]
    return found  # type: ignore[no-any-return]


@pytest.mark.parametrize(
    ("change", "told"),
    [
        (allows_by_default, "default_permission is not deny"),
        (is_off, "access control is off"),
        (has_a_higher_role, "allows viewer: query (ingress) of litegripd/1/lab/left/rpc/viewer/*/"),
        (has_a_wildcard, "allows op1: query (ingress) of litegripd/1/*/*/rpc/*/*/operate"),
        (has_another_message, "allows op1: declare_queryable (egress)"),
        (goes_both_ways, "allows op1: put (ingress)"),
        (is_for_everybody, "allows everybody: query (ingress)"),
        (is_anothers_too, "'user op1 asks' allows viewer: query (ingress)"),
    ],
)
def test_each_way_to_be_wider_is_found(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    change: Callable[[dict[str, Any]], None],
    told: str,
) -> None:
    given_rules = copy.deepcopy(OWN)
    change(given_rules)
    assert checked(tmp_path, given_rules) == 1
    assert told in capsys.readouterr().out


def test_rules_that_are_narrower_are_none_too_wide(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given_rules = copy.deepcopy(OWN)
    narrower(given_rules)
    assert checked(tmp_path, given_rules) == 0
    assert "allows nothing beyond" in capsys.readouterr().out


def test_what_is_printed_is_what_a_zenohd_reads(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--config", str(table(tmp_path)), "acl"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert checked(tmp_path, printed["access_control"]) == 0


def test_a_file_that_zenoh_does_not_read_is_named(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "zenohd.json5"
    config = str(table(tmp_path))
    for content in (None, "{ access_control: { enabled: 7 } }"):
        if content is not None:
            file.write_text(content, encoding="utf-8")
        assert main(["--config", config, "acl", "--check", str(file)]) == 2
        told = capsys.readouterr().err
        assert str(file) in told
        assert "cargo" not in told


def table(folder: Path) -> Path:
    """Return a configuration with the table that `OWN` is made from."""
    file = folder / "fleet.toml"
    file.write_text(
        '[network]\nca = "a"\ncertificate = "b"\nkey = "c"\n'
        '[router]\nlisten = ["tls/0.0.0.0:7447"]\n'
        'users = { op1 = "operator", viewer = "observer" }\n'
        'gateways = { robot1 = ["lab.left"] }\n',
        encoding="utf-8",
    )
    return file


def checked(folder: Path, control: Mapping[str, Any]) -> int:
    """Return the exit code for a zenohd's configuration with this access control."""
    file = folder / "zenohd.json5"
    file.write_text(json.dumps({"mode": "router", "access_control": control}), encoding="utf-8")
    return main(["--config", str(table(folder)), "acl", "--check", str(file)])
