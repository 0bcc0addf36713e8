"""Users of other machines: a gateway speaks for them, with at most its own role."""

import pytest

from litegripd.model.state import Owner
from litegripd.rpc.sessions import Role
from tests.world import Client, World

OP1, OP2 = "op1@lab", "op2@lab"


@pytest.fixture
def world() -> World:
    world = World(calibrated=True)
    world.start()
    return world


def gateway(world: World, role: Role = "operator") -> Client:
    client = world.client(uid=990, pid=77, role=role)
    client.session.is_gateway = True
    return client


def of(world: World, remote: str, role: Role = "operator") -> Client:
    """Return the connection by which a remote user asks."""
    client = gateway(world)
    client.result("hello", on_behalf=remote, role=role)
    return client


def test_a_remote_user_has_a_name_and_a_role_of_his_own(world: World) -> None:
    client = gateway(world, "admin")
    assert client.result("hello", on_behalf=OP1, role="operator")["role"] == "operator"
    client.result("lease.acquire")
    owner = client.result("lease.get")["owner"]
    assert owner["program"] == "op1@lab via gateway"
    client.result("hello", client="grasp.py")
    rows = client.result("clients.list")["clients"]
    mine = next(row for row in rows if row["is_me"])
    assert (mine["program"], mine["role"]) == ("grasp.py of op1@lab via gateway", "operator")


def test_a_remote_users_name_may_be_as_long_as_a_gateways_site_and_user(world: World) -> None:
    longest = f"{'u' * 32}@{'s' * 32}"  # a longer one is no part of a key
    assert of(world, longest).session.remote == longest


def test_an_observer_behind_a_gateway_moves_nothing(world: World) -> None:
    client = of(world, OP1, "observer")
    client.refused("motor.enable", "not_permitted", "op1@lab")


@pytest.mark.parametrize(
    ("is_gateway", "params", "reason"),
    [
        (False, {"on_behalf": OP1, "role": "operator"}, "not_permitted"),
        (True, {"on_behalf": OP1, "role": "admin"}, "not_permitted"),
        (True, {"on_behalf": OP1}, "invalid_params"),
        (True, {"role": "observer"}, "invalid_params"),
        (True, {"on_behalf": OP1, "role": "root"}, "invalid_params"),
        (True, {"on_behalf": "x" * 66, "role": "observer"}, "invalid_params"),
        (True, {"on_behalf": "a\nb", "role": "observer"}, "invalid_params"),
    ],
)
def test_what_a_connection_may_not_become(
    world: World, is_gateway: bool, params: dict[str, str], reason: str
) -> None:
    client = gateway(world)
    client.session.is_gateway = is_gateway
    assert client.refusal("hello", **params) == reason
    assert (client.session.remote, client.session.role) == (None, "operator")


def test_a_connection_stays_its_users_and_its_role_is_never_raised(world: World) -> None:
    client = of(world, OP1, "observer")
    assert client.refusal("hello", on_behalf=OP2, role="observer") == "not_permitted"
    assert client.refusal("hello", on_behalf=OP1, role="operator") == "not_permitted"
    assert (client.session.remote, client.session.role) == (OP1, "observer")


def test_users_of_one_gateway_are_not_one_user(world: World) -> None:
    first, second = of(world, OP1), of(world, OP2)
    first.result("lease.acquire")
    second.refused(
        "lease.take",
        "not_permitted",
        "op1@lab, uid 990",
        "op2@lab, uid 990 is no admin",
        why="mine now",
    )
    assert of(world, OP1).result("lease.take", why="my other program")["taken_from"] is not None


def test_who_has_stopped_is_the_remote_user(world: World) -> None:
    holder, first, second = world.client(uid=1), of(world, OP1), of(world, OP2)
    holder.result("lease.acquire")
    first.result("stop", level="hold")
    second.refused("stop.clear", "lease_held", "op1@lab, uid 990, who stopped it")
    first.result("stop.clear")


def test_a_stop_in_the_name_of_a_remote_user_is_cleared_by_that_user(world: World) -> None:
    holder, first, second = world.client(uid=1), of(world, OP1), of(world, OP2)
    holder.result("lease.acquire")
    by = Owner(0, 77, 990, "op1@lab via gateway", remote=OP1)  # as the stop socket gives it
    world.controller.stop("hold", by, None, world.now_s)
    assert second.refusal("stop.clear") == "lease_held"
    first.result("stop.clear")
