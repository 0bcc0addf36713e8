"""Users of other machines: a gateway speaks for them, with at most its own role."""

import pytest

from litegripd.model.state import JobState, Owner
from litegripd.rpc.sessions import Role
from tests.world import Client, World

OP1, OP2 = "op1@lab", "op2@lab"
ENDED = (JobState.DONE, JobState.CANCELLED)


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
        ": op2@lab is an operator, who may read, stop and move; this needs an admin",
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


@pytest.mark.parametrize("ttl_s", [None, 60.0, 2.0])
def test_a_lease_of_this_machine_that_a_remote_user_resumes_has_a_time_to_live(
    world: World, ttl_s: float | None
) -> None:
    local = world.client()
    asked = {} if ttl_s is None else {"ttl_s": ttl_s}
    token = local.result("lease.acquire", **asked)["lease"]
    local.leave()
    client = of(world, OP1)
    client.result("lease.resume", lease=token)
    assert client.result("lease.get")["owner"]["ttl_s"] == min(ttl_s or 5.0, 5.0)
    world.run(5.1)
    assert client.result("lease.get")["owner"] is None


def test_a_lease_that_its_own_machine_resumes_is_as_it_was(world: World) -> None:
    local = world.client()
    token = local.result("lease.acquire")["lease"]
    local.leave()
    again = world.client()
    again.result("lease.resume", lease=token)
    assert again.result("lease.get")["owner"]["ttl_s"] is None


@pytest.mark.parametrize("is_remote", [True, False])
def test_what_a_remote_user_has_queued_never_begins_after_his_end(
    world: World, is_remote: bool
) -> None:
    """On one machine it does: its client has asked for that, and there is no network to fail."""
    world.client().result("motor.enable")
    first, second = of(world, OP2), of(world, OP1) if is_remote else world.client()
    first.send("motion.open", speed_mm_s=10, wait=False)
    second.send("motion.close", speed_mm_s=10, wait=False, if_busy="queue")
    world.run(0.2)
    second.leave()
    jobs = world.controller.jobs
    world.run_until(lambda: all(job.state in ENDED for job in jobs), within_s=60.0)
    states = [job.state for job in jobs if job.kind in ("open", "close")]
    assert states == [JobState.DONE, JobState.CANCELLED if is_remote else JobState.DONE]


@pytest.mark.parametrize("level", ["hold", "relax", "disable"])
@pytest.mark.parametrize("on_lost", ["hold", "relax", "disable"])
def test_a_loss_while_a_stop_is_latched_weakens_what_the_jaws_do_and_never_presses_again(
    world: World, level: str, on_lost: str
) -> None:
    """The weaker one counts, of stop and `on_lost`; nothing moves until the stop is cleared."""
    client = of(world, OP1)
    client.result("lease.acquire", on_lost=on_lost, ttl_s=1.0)
    client.result("motor.enable")
    world.run(0.2)
    world.client().result("stop", level=level)
    world.run(0.2)
    position_rad = world.gripper.position_rad
    client.leave()
    world.run(0.5)
    modes = {"hold": "holding", "relax": "relaxed", "disable": "disabled"}
    weaker = max(level, on_lost, key=list(modes).index)
    assert world.state.mode == modes[weaker]
    assert world.gripper.position_rad == pytest.approx(position_rad, abs=0.05)
    assert world.client().refusal("motion.open") == "stopped"


def test_what_is_held_without_a_lease_stays_held_by_the_force_that_was_set_last(
    world: World,
) -> None:
    client = of(world, OP1)
    client.result("motor.enable")
    world.gripper.put_object(width_mm=30.0)
    client.result("motion.grasp", force_n=8, until="verdict")
    client.result("motion.set_force", force_n=4)
    client.leave()
    world.run(1.0)
    assert (world.state.is_grasped, world.state.force_set_n) == (True, 4)
