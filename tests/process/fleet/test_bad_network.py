"""What the jaws do over a network that is cut, loses, delays and reorders.

How soon it happens is measured by `python -m bench.fleet.faults`; here, that it does, and within
the limits that the documentation names.
"""

import contextlib
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_fleet.far.together import LOOK_EVERY_S
from litegrip_fleet.wire.lateness import STOP_WITHIN_S
from tests.process.daemon_process import CTL, DEADLINE_S, Client, DaemonProcess
from tests.process.fleet.cable import Fault
from tests.process.fleet.fleet_process import reach
from tests.process.fleet.lab import ROUTER, Lab, lab
from tests.process.fleet.machines import missing

pytestmark = pytest.mark.skipif(missing() is not None, reason=str(missing()))

TTL_S = 2.0
SLACK_S = 2.0
"""For a machine that is busy: the daemon, the gateway and the cable have to run to be in time."""

BAD = {
    "loss": Fault(loss=0.3),
    "delay": Fault(delay_s=0.1),
    "disorder": Fault(jitter_s=0.05),
    "all": Fault(delay_s=0.1, jitter_s=0.05, loss=0.3),
}
CUT = Fault(cut=True)
STILL_MM = 0.2


@contextlib.contextmanager
def robot_and_operator(folder: Path, certificates: Path, ttl_s: float) -> Iterator[Lab]:
    with lab(folder, certificates, robots=["robot1"], operators=["op1"], ttl_s=ttl_s) as made:
        yield made
        sound(made)  # over a bad network, each part takes 10 s to end


def sound(lab: Lab) -> None:
    for machine in lab.machines.names:
        lab.machines.fault(machine)


@pytest.fixture(scope="module")
def shared(tmp_path_factory: pytest.TempPathFactory, certificates: Path) -> Iterator[Lab]:
    with robot_and_operator(tmp_path_factory.mktemp("bad"), certificates, TTL_S) as made:
        yield made


@pytest.fixture
def bad(shared: Lab) -> Iterator[Lab]:
    """A robot and an operator, whose session ends when it shows no life for as long as TTL_S.

    All tests that end no part use the same; each finds a sound network and jaws that are slack.
    """
    with again(shared) as client:
        client.result("lease.acquire", wait_s=DEADLINE_S)
        client.result("stop.clear")
        client.result("motor.disable")
        client.result("lease.release")
    yield shared
    sound(shared)


@pytest.fixture
def own(tmp_path: Path, certificates: Path) -> Iterator[Lab]:
    """The same for a test that ends its parts."""
    with robot_and_operator(tmp_path, certificates, TTL_S) as made:
        yield made


@pytest.fixture
def patient(tmp_path: Path, certificates: Path) -> Iterator[Lab]:
    """The same with the longest time to live: its sessions outlive short cuts."""
    with robot_and_operator(tmp_path, certificates, 5.0) as made:
        yield made


@pytest.fixture
def robot(request: pytest.FixtureRequest) -> DaemonProcess:
    name = "patient" if "patient" in request.fixturenames else "bad"
    running: DaemonProcess = request.getfixturevalue(name).grippers["left"]
    return running


class Watch:
    """All events of a daemon, and its jaws at 200 Hz, by a connection on the robot's machine.

    `started` are the motions that began; to go slack, as when a lease is lost, is none.
    """

    def __init__(self, robot: DaemonProcess) -> None:
        self.client = robot.connect()
        self.client.result("events.subscribe")
        self.client.result("state.subscribe", hz=200, fields=["mode", "opening_mm"])
        self.started: list[dict[str, Any]] = []

    def read(self) -> dict[str, Any]:
        message = self.client.read()
        assert message, "the daemon has closed the connection"
        params = message.get("params", {})
        began = message.get("method") == "event" and params["kind"] == "job_started"
        if began and params["data"]["kind"] in ("open", "close", "move"):
            self.started.append(params)
        return message

    def event(self, kind: str) -> dict[str, Any]:
        """Read until an event of a kind."""
        while True:
            message = self.read()
            if message.get("method") == "event" and message["params"]["kind"] == kind:
                params: dict[str, Any] = message["params"]
                return params

    def mode(self, mode: str) -> None:
        """Read until the jaws are in a mode."""
        while not _is_sample(message := self.read()) or _state(message)["mode"] != mode:
            pass

    def caught_up(self) -> None:
        """Read until what happened up to now is read."""
        now_s = time.monotonic()
        while not _is_sample(message := self.read()) or message["params"]["monotonic_s"] < now_s:
            pass

    def stays_still(self, mode: str, samples: int = 400) -> None:
        """Watch that for so many samples from now on nothing moves, and that no motion begins.

        What went slack before may have moved until now.
        """
        self.caught_up()
        started = len(self.started)
        openings_mm: list[float] = []
        while len(openings_mm) < samples:
            message = self.read()
            if _is_sample(message):
                state = _state(message)
                assert state["mode"] == mode
                openings_mm.append(state["opening_mm"])
        assert max(openings_mm) - min(openings_mm) < STILL_MM
        assert len(self.started) == started, self.started


def _is_sample(message: dict[str, Any]) -> bool:
    return message.get("method") == "state.sample"


def _state(message: dict[str, Any]) -> dict[str, Any]:
    state: dict[str, Any] = message["params"]["state"]
    return state


@pytest.fixture
def watch(robot: DaemonProcess) -> Iterator[Watch]:
    made = Watch(robot)
    with made.client:
        yield made


def ready(lab: Lab, *, on_lost: str = "relax") -> Client:
    """Connect over the network as the owner of a lease, with the jaws closed."""
    client = again(lab)  # a session may still end that was begun over the network of before
    client.result("lease.acquire", on_lost=on_lost)
    client.result("motor.enable")
    client.result("motion.close")
    return client


def moving(client: Client, watch: Watch) -> None:
    """Begin a motion that takes long, and see that the jaws have left their stop.

    The stop would push them away when they go slack.
    """
    watch.caught_up()
    client.send("motion.open", speed_mm_s=10)
    while not _is_sample(message := watch.read()) or _state(message)["opening_mm"] < 5.0:
        kind = message["params"]["kind"] if message.get("method") == "event" else None
        assert kind not in ("job_ended", "lease_lost"), message  # they would never get there


def errors(client: Client) -> list[dict[str, Any]]:
    """Read what is answered until the connection ends; return the errors."""
    found = []
    while message := client.read():
        if "error" in message:
            found.append(message)
    return found


def reason(message: dict[str, Any]) -> str:
    text: str = message["error"]["data"]["reason"]
    return text


# Cuts ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("machine", ["op1", "robot1", ROUTER])
def test_after_a_cut_on_lost_is_in_force_in_time_and_nothing_that_was_sent_moves(
    bad: Lab, watch: Watch, machine: str
) -> None:
    with ready(bad) as client:
        moving(client, watch)
        cut_s = bad.machines.fault(machine, CUT)
        client.send("motion.close", if_busy="replace")
        client.send("motion.move", opening_mm=80, if_busy="queue", wait=False)
        lost = watch.event("lease_lost")
        assert lost["monotonic_s"] - cut_s < TTL_S + LOOK_EVERY_S + SLACK_S
        watch.mode("relaxed")
        with contextlib.suppress(ConnectionError):  # the portal may have ended the session, too
            client.send("motion.open", wait=False)
        told = errors(client)
        assert [reason(one) for one in told] == ["unreachable"]
        assert "what was asked last may have been done" in told[0]["error"]["message"]
        bad.machines.fault(machine)
        watch.stays_still("relaxed")
    with again(bad) as client:
        watch.stays_still("relaxed")
        assert client.result("lease.get")["owner"] is None


def test_what_is_asked_within_a_cut_that_the_session_outlives_is_too_late(
    patient: Lab, watch: Watch
) -> None:
    with ready(patient) as client:
        watch.caught_up()
        patient.machines.fault("op1", CUT)
        asked = [client.send("motion.open", wait=False, key=f"in the cut {n}") for n in range(3)]
        lasts(watch, 1.0)
        patient.machines.fault("op1")
        for number in asked:
            assert reason(client.answer(number)) == "too_late"
        watch.stays_still("holding")
        assert client.result("motion.move", opening_mm=20)["ok"]


def lasts(watch: Watch, duration_s: float) -> None:
    """Let so much time pass, by the daemon's clock, while it is watched."""
    ends_s = time.monotonic() + duration_s
    while not _is_sample(message := watch.read()) or message["params"]["monotonic_s"] < ends_s:
        pass


def again(lab: Lab) -> Client:
    """Connect as soon as the gripper can be reached."""
    return reach(lab.fleet, portal="op1")


@pytest.mark.parametrize("machine", ["op1", "robot1"])
def test_a_stop_into_a_cut_is_said_not_to_be_confirmed(
    bad: Lab, robot: DaemonProcess, machine: str
) -> None:
    ready(bad).close()
    with Client(bad.stop_path()) as stopper:
        bad.machines.fault(machine, CUT)
        sent_s = time.monotonic()
        number = stopper.send("stop", level="hold")
        error = stopper.answer(number)["error"]
        assert time.monotonic() - sent_s < STOP_WITHIN_S + SLACK_S
        assert error["data"]["reason"] == "unreachable"
        assert "not confirmed" in error["message"]
        with robot.connect() as local:
            assert local.result("state.get")["stop"] is None
        bad.machines.fault(machine)
    with again(bad):
        pass


def test_the_command_line_reports_a_stop_that_is_not_confirmed_in_the_portals_words(
    bad: Lab,
) -> None:
    bad.machines.fault("op1", CUT)
    done = bad.run("op1", *CTL, "-c", "lab.left", "stop")
    assert done.returncode != 0
    assert "lab.left is not confirmed within 2 s" in done.stderr
    assert "use the switch that cuts the power" in done.stderr
    bad.machines.fault("op1")
    again(bad).close()


def test_parts_end_as_they_should_while_nobody_takes_their_goodbye(own: Lab) -> None:
    for name in ("op1", "robot1"):
        own.machines.fault(name, CUT)
        own.fleet.parts[name].end()


# Bad networks -------------------------------------------------------------------------------------


MOTIONS = 12


@pytest.mark.parametrize("name", BAD)
def test_every_motion_runs_once_at_most_and_is_answered_as_it_went(
    bad: Lab, watch: Watch, name: str
) -> None:
    """One after the other, to the one place or the other; a session that ends is begun again."""
    client = ready(bad, on_lost="hold")
    bad.machines.fault("op1", BAD[name])
    for number in range(MOTIONS):
        watch.caught_up()
        before = len(watch.started)
        opening_mm = 20.0 + 5.0 * (number % 2)
        with contextlib.suppress(BrokenPipeError):  # the session has ended: its last line says why
            client.send(
                "motion.move", opening_mm=opening_mm, speed_mm_s=100, key=f"{name} {number}"
            )
        answer = until_answered(client)
        if "result" in answer:
            watch.caught_up()
            assert len(watch.started) == before + 1
            assert answer["result"]["job"] == watch.started[-1]["data"]["job"]
            assert abs(answer["result"]["state"]["opening_mm"] - opening_mm) < 2.0
        elif reason(answer) == "too_late":
            watch.caught_up()
            assert len(watch.started) == before
        else:
            # The session is gone, or its lease was not renewed in time.
            assert reason(answer) in ("unreachable", "lease_lost")
            client.close()
            bad.machines.fault("op1")  # over such a network it may take minutes
            client = over_again(bad)
            watch.caught_up()
            assert len(watch.started) <= before + 1
            bad.machines.fault("op1", BAD[name])
    client.close()
    assert len({one["data"]["job"] for one in watch.started}) == len(watch.started)


def until_answered(client: Client) -> dict[str, Any]:
    """Read until a motion's answer, or the line that ends the connection."""
    while True:
        message = client.read()
        assert message, "the connection has ended without a word"
        if "result" in message or "error" in message:
            return message


def over_again(lab: Lab) -> Client:
    """Have a session with a lease again, as soon as the one before has lost it."""
    client = again(lab)
    client.result("lease.acquire", on_lost="hold", wait_s=DEADLINE_S)
    return client


@pytest.mark.parametrize("name", BAD)
def test_when_a_program_ends_behind_a_bad_network_on_lost_follows(
    bad: Lab, watch: Watch, name: str
) -> None:
    with ready(bad) as client:
        moving(client, watch)
        bad.machines.fault("op1", BAD[name])
    watch.mode("relaxed")
    watch.stays_still("relaxed")


@pytest.mark.parametrize("name", BAD)
def test_a_cut_of_a_bad_network_is_as_any_cut(bad: Lab, watch: Watch, name: str) -> None:
    with ready(bad) as client:
        moving(client, watch)
        bad.machines.fault("op1", BAD[name])
        # If it still passes, it continues; its end, too, is away from a stop that pushes.
        client.send("motion.move", opening_mm=30, if_busy="replace", speed_mm_s=20, wait=False)
        cut_s = bad.machines.fault("op1", CUT)
        lost = watch.event("lease_lost")
        assert lost["monotonic_s"] - cut_s < TTL_S + LOOK_EVERY_S + SLACK_S
        watch.mode("relaxed")
        bad.machines.fault("op1", BAD[name])
        watch.stays_still("relaxed")


@pytest.mark.parametrize("name", BAD)
def test_a_stop_over_a_bad_network_is_in_force_or_said_not_to_be(
    bad: Lab, robot: DaemonProcess, name: str
) -> None:
    with Client(bad.stop_path()) as stopper, robot.connect() as local:
        bad.machines.fault("op1", BAD[name])
        for _ in range(5):
            sent_s = time.monotonic()
            answer = stopper.answer(stopper.send("stop", level="hold"))
            assert time.monotonic() - sent_s < STOP_WITHIN_S + SLACK_S
            if "result" in answer:
                stop = local.result("state.get")["stop"]
                assert stop["level"] == answer["result"]["level"] == "hold"
            else:
                assert "not confirmed" in answer["error"]["message"]
