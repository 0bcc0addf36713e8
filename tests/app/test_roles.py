"""Roles: which one a peer has by the lists, and that each session carries its own."""

import grp
import os
import pwd

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.app.build import build_service
from litegripd.app.config import Access, UnknownEntryError, access_of
from litegripd.rpc.sessions import ROLES, Peer, Role
from tests.world import PERIOD_S, Client, FixedFacts, World

ALICE, BOB, LAB, VISITORS = 30_001, 30_002, 40_001, 40_002
ACCESS = Access("observer", {ALICE: "operator"}, {LAB: "admin", VISITORS: "observer"})


def peer(uid: int, *groups: int, gid: int = 50_000) -> Peer:
    return Peer(4711, uid, gid, "program", groups)


def test_who_is_in_no_list_has_the_default() -> None:
    assert ACCESS.role_of(peer(BOB)) == "observer"
    assert Access().role_of(peer(BOB)) == "operator"
    assert Access("admin").role_of(peer(BOB)) == "admin"


def test_an_entry_may_give_less_than_the_default() -> None:
    access = Access("operator", {BOB: "observer"})
    assert access.role_of(peer(BOB)) == "observer"
    assert access.role_of(peer(ALICE)) == "operator"


def test_the_highest_role_counts() -> None:
    assert ACCESS.role_of(peer(ALICE)) == "operator"
    assert ACCESS.role_of(peer(ALICE, VISITORS)) == "operator"
    assert ACCESS.role_of(peer(ALICE, VISITORS, LAB)) == "admin"
    assert ACCESS.role_of(peer(BOB, 1, 2, VISITORS)) == "observer"


def test_the_own_group_counts_though_it_is_not_among_the_supplementary_ones() -> None:
    assert ACCESS.role_of(peer(BOB, gid=LAB)) == "admin"


def test_root_and_the_daemons_own_user_are_always_admins(monkeypatch: pytest.MonkeyPatch) -> None:
    access = Access("observer", {0: "observer", BOB: "observer"}, {VISITORS: "observer"})
    assert access.role_of(peer(0, VISITORS)) == "admin"
    assert access.role_of(peer(os.geteuid())) == "admin"
    monkeypatch.setattr(os, "geteuid", lambda: BOB)
    assert access.role_of(peer(BOB, VISITORS)) == "admin"
    assert access.role_of(peer(ALICE, VISITORS)) == "observer"


@given(
    st.sampled_from(ROLES),
    st.dictionaries(st.integers(1, 5), st.sampled_from(ROLES)),
    st.dictionaries(st.integers(1, 5), st.sampled_from(ROLES)),
    st.integers(1, 5),
    st.lists(st.integers(1, 5), min_size=1),
)
def test_no_entry_takes_away_what_another_gives(
    default: Role, users: dict[int, Role], groups: dict[int, Role], uid: int, gids: list[int]
) -> None:
    access = Access(default, users, groups)
    given_roles = [users[uid]] if uid in users else []
    given_roles += [groups[gid] for gid in gids if gid in groups]
    role = access.role_of(peer(uid, *gids[1:], gid=gids[0]))
    if uid == os.geteuid():
        assert role == "admin"
    elif given_roles:
        assert role in given_roles
        assert all(ROLES.index(role) >= ROLES.index(other) for other in given_roles)
    else:
        assert role == default


def test_names_are_looked_up_and_the_highest_list_counts() -> None:
    user, group = pwd.getpwuid(os.getuid()), grp.getgrgid(os.getgid())
    access = access_of(
        "observer",
        {
            "observers": [user.pw_name, f"@{group.gr_name}", ALICE],
            "operators": [ALICE, f"@{group.gr_name}"],
            "admins": [BOB, 0, 4_294_967_294],
        },
    )
    users: dict[int, Role] = {user.pw_uid: "observer", ALICE: "operator"}
    users |= {0: "admin", BOB: "admin", 4_294_967_294: "admin"}
    assert access == Access("observer", users, {group.gr_gid: "operator"})


@pytest.mark.parametrize(
    ("entry", "told"),
    [
        ("no-such-user", "admins: there is no user 'no-such-user'"),
        ("", "admins: there is no user ''"),
        ("1000", "admins: there is no user '1000'"),
        ("a\0b", "admins: there is no user"),
        ("\ud800", "admins: there is no user"),
        ("@no-such-group", "admins: there is no group 'no-such-group'"),
        ("@", "admins: there is no group ''"),
        (-1, "admins: -1 cannot be a uid"),
        (4_294_967_295, "admins: 4294967295 cannot be a uid"),
    ],
)
def test_an_entry_that_names_nobody_is_refused(entry: str | int, told: str) -> None:
    with pytest.raises(UnknownEntryError) as caught:
        access_of("operator", {"admins": [0, entry]})
    assert told in str(caught.value)


def test_a_session_has_its_peers_role_and_hello_tells_it() -> None:
    world = World()
    service = build_service(world.controller, FixedFacts(), PERIOD_S, role_of=ACCESS.role_of)
    world.service = service
    for identity, role in ((peer(ALICE), "operator"), (peer(BOB, LAB), "admin")):
        session = service.opened(identity, world.now_s)
        assert session.role == role
        assert Client(world, session).result("hello")["role"] == role


def test_without_roles_everybody_is_an_admin() -> None:
    world = World()
    assert world.client().result("hello")["role"] == "admin"


def test_gateways_are_those_of_the_list_and_nobody_else_not_even_root() -> None:
    group = grp.getgrgid(os.getgid())
    access = access_of("observer", {"gateways": [ALICE, f"@{group.gr_name}"]})
    assert access.is_gateway(peer(ALICE))
    assert access.is_gateway(peer(BOB, gid=group.gr_gid))
    assert access.is_gateway(peer(BOB, group.gr_gid, gid=50_000))
    assert not access.is_gateway(peer(BOB, gid=50_000))
    assert not access.is_gateway(peer(0, gid=50_000))
    assert access.role_of(peer(ALICE)) == "observer"
