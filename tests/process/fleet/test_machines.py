"""Two robots and two operators, each on a machine of its own, with a router between them."""

import json
import re
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.process.daemon_process import CTL, Client
from tests.process.fleet.lab import OPERATORS, ROBOTS, ROUTER, Lab, lab
from tests.process.fleet.machines import missing

pytestmark = pytest.mark.skipif(missing() is not None, reason=str(missing()))

MOVES = """
from litegrip_client import LiteGrip
with LiteGrip("lab.left") as gripper:
    gripper.enable()
    assert gripper.open().ok
    assert gripper.close().ok
    print(gripper.get_state().opening_mm)
"""


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory, certificates: Path) -> Iterator[Lab]:
    with lab(tmp_path_factory.mktemp("lab"), certificates, ttl_s=5.0) as running:
        yield running


@pytest.fixture
def two(shared: Lab) -> Lab:
    """The lab as it was at first: nothing is stopped, and the motors are off."""
    for running in shared.grippers.values():
        with running.connect() as client:
            client.result("lease.acquire", wait_s=10.0)  # a session's end travels, too
            client.result("stop.clear")
            client.result("motor.disable")
            client.result("lease.release")
    return shared


def fleet_command(two: Lab, operator: str, *arguments: str) -> list[str]:
    config = str(two.fleet.parts[operator].config_path)
    return [sys.executable, "-m", "litegrip_fleet", "--config", config, *arguments]


@pytest.mark.parametrize("operator", OPERATORS)
def test_every_operator_lists_both_robots(two: Lab, operator: str) -> None:
    done = two.run(operator, *fleet_command(two, operator, "list", "--json"))
    assert done.returncode == 0, done.stderr
    assert [row["gripper"] for row in json.loads(done.stdout)] == ["lab.left", "lab.right"]


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_program_finds_a_gripper_by_its_name_and_moves_it(two: Lab, operator: str) -> None:
    done = two.run(operator, sys.executable, "-c", MOVES)
    assert done.returncode == 0, done.stderr
    assert float(done.stdout) < 10.0


@pytest.mark.parametrize("operator", OPERATORS)
def test_the_command_line_finds_a_gripper_by_its_name(two: Lab, operator: str) -> None:
    done = two.run(operator, *CTL, "-c", "lab.left", "state", "--json")
    assert done.returncode == 0, done.stderr
    assert json.loads(done.stdout)["mode"] == "disabled"


def test_operators_move_different_grippers_at_the_same_time(two: Lab) -> None:
    with two.client("op1", "left") as one, two.client("op2", "right") as other:
        for client in (one, other):
            client.result("lease.acquire")
            client.result("motor.enable")
        for method in ("motion.open", "motion.close"):
            asked = [(client, client.send(method)) for client in (one, other)]
            for client, number in asked:
                answer = client.answer(number)
                assert answer.get("result", {}).get("ok"), answer


def test_one_operator_watches_what_the_other_one_moves(two: Lab) -> None:
    with two.client("op1") as mover, two.client("op2") as watcher:
        watcher.result("state.subscribe", hz=50, fields=["mode", "opening_mm"])
        mover.result("motor.enable")
        mover.result("motion.close")
        moving = mover.send("motion.open", speed_mm_s=60)
        while sample(watcher)["mode"] != "moving":
            pass
        assert mover.answer(moving)["result"]["ok"]
        while sample(watcher)["mode"] != "holding":
            pass


def sample(client: Client) -> dict[str, object]:
    """Return the next sample of the state."""
    while (message := client.read()).get("method") != "state.sample":
        assert message
    state: dict[str, object] = message["params"]["state"]
    return state


def test_nobody_takes_or_moves_what_another_operator_leases(two: Lab) -> None:
    with two.client("op1") as owner, two.client("op2") as other:
        owner.result("lease.acquire")
        owner.result("motor.enable")
        for method in ("lease.acquire", "motion.open", "motor.disable"):
            assert other.refusal(method) == "lease_held", method
        assert other.refusal("lease.take", why="a test") == "not_permitted"
        assert other.result("lease.get")["owner"]["program"].endswith("of op1@lab via gateway")
        assert owner.result("motion.open")["ok"]
    with two.client("op2") as other:
        other.result("lease.acquire")


@pytest.mark.parametrize("operator", OPERATORS)
def test_a_site_is_stopped_from_every_operators_machine(two: Lab, operator: str) -> None:
    done = two.run(operator, *fleet_command(two, operator, "stop", "lab", "--why", "a hand"))
    assert done.returncode == 0, done.stdout + done.stderr
    assert [line.split(" (")[0] for line in done.stdout.splitlines()] == [
        "lab.left: stopped",
        "lab.right: stopped",
    ]
    for running in two.grippers.values():
        with running.connect() as client:
            stop = client.result("state.get")["stop"]
            assert (stop["by"], stop["why"]) == (f"{operator}@lab via gateway", "a hand")


def listening(two: Lab, machine: str) -> set[str]:
    """Return the addresses at which somebody listens on a machine, TCP and UDP, old and new IP."""
    done = two.run(machine, "ss", "--no-header", "--listening", "--tcp", "--udp", "--numeric")
    assert done.returncode == 0, done.stderr
    return {row.split()[4] for row in done.stdout.splitlines()}


@pytest.mark.parametrize("machine", [*ROBOTS, *OPERATORS])
def test_robots_and_operators_listen_at_no_port(two: Lab, machine: str) -> None:
    assert listening(two, machine) == set()


def test_the_router_listens_at_one_port_and_there_speaks_tls(two: Lab) -> None:
    port = int(two.fleet.endpoint.rpartition(":")[2])
    assert listening(two, ROUTER) == {f"{two.machines.addresses[ROUTER]}:{port}"}
    done = two.run("op1", "openssl", "s_client", "-brief", "-connect", f"{ROUTER}:{port}")
    said = done.stdout + done.stderr
    assert re.search(r"TLSv1\.[23]", said), said
    assert f"CN = {ROUTER}" in said or f"CN={ROUTER}" in said


def test_the_daemons_have_no_connection_of_the_network(two: Lab) -> None:
    """Gateways have one each, to the router; the daemons that they are clients of have none."""
    for robot, gripper in ROBOTS.items():
        done = two.run(robot, "ss", "--no-header", "--tcp", "--udp", "--all", "-n", "--processes")
        pids = {int(pid) for pid in re.findall(r"pid=(\d+)", done.stdout)}
        assert pids == {two.fleet.parts[robot].process.pid}
        assert two.grippers[gripper].process.pid not in pids
