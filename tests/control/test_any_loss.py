"""However clients are lost, taken over and stopped, the jaws end up as docs/safety.md says."""

import random
from typing import Any

import pytest

from litegripd.control.holds import Slack
from litegripd.model.motor import MotorPhase
from litegripd.model.state import Event, Job
from tests.control.states import LEVELS
from tests.trajectories import lgt, pieces
from tests.world import Client, World

POWER = ("enable", "disable")
STIFF = ("open", "close", "grasp", "move", "play")
"""Motions after which the jaws hold, wherever they end."""
SETTLED_S = 0.15
MOTIONS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("motion.open", {"speed_mm_s": 60}),
    ("motion.close", {"speed_mm_s": 60}),
    ("motion.grasp", {}),
    ("motion.move", {"opening_mm": 60}),
    ("trajectory.play", {"name": "a"}),
    ("motion.zero_gravity", {}),
    ("motion.hold", {}),
    ("motion.set_force", {"force_n": 8}),
    ("stream.set", {"opening_mm": 50, "valid_s": 0.1}),
    ("teleop.start", {"mode": "slave", "fake_leader": True}),
    ("teleop.start", {"mode": "master", "link": "none"}),
    ("trajectory.record_start", {}),
    ("motor.disable", {}),
    *[("motor.enable", {})] * 4,
)
ACTS = [*("take", "stop", "cancel", "lease.release", "resume") * 2, *("acquire", "lose") * 4]
ACTS += [*["stop.clear"] * 3, *["move"] * 12]


class AnyLoss:
    def __init__(self, seed: int) -> None:
        self.random = random.Random(seed)
        self.world = World(initial_opening_mm=80.0).start()
        self.world.gripper.put_object(width_mm=40.0)
        self.clients = [self.world.client() for _ in range(3)]
        self.token = "none"
        self.holder: int | None = None
        self.losers: set[int] = set()
        self.left: str | None = None
        """How the jaws must be once nothing runs; None where a client has asked since."""
        self.left_s = 0.0
        self.replaces = self.was_stiff = self.must_hold = False
        self.said: list[str] = []
        path = pieces(lgt([(0, 0.6), (0.5, 0.8), (1, 0.6)]))[0]
        self.clients[0].result("trajectory.put", **path, name="a")
        assert self.clients[0].result("motor.enable")["ok"]
        self.world.service.on_event = self.note

    def active(self) -> list[Job]:
        return [job for job in self.world.controller.jobs if job.is_running]

    def note(self, event: Event, now_s: float) -> None:
        """Take an event: what it reports must be possible, and must come true."""
        data: dict[str, Any] = dict(event.data)
        self.said.append(f"{now_s:.3f} {event.kind}: {event.message}")
        if event.kind == "job_started":
            jobs = {job.number: job for job in self.world.controller.jobs}
            self.note_begun(jobs[data["job"]])
        elif event.kind == "job_ended":
            (job,) = (one for one in self.world.controller.jobs if one.number == data["job"])
            if job.error is not None and job.error.data.get("cause") == "taken":
                self.losers.add(job.owner.client)  # with a lease or without
        elif event.kind == "lease" and "held" in data:
            self.holder = data["client"] if data["held"] else None
            self.losers.discard(self.holder or 0)
            self.left = None if data["held"] else self.left
        elif event.kind == "lease_lost":
            assert data["client"] == self.holder, "who is said to lose it had it"
            self.losers.add(data["client"])
            self.holder = None
        elif event.kind == "client_lost":
            self.leave_as(data["on_lost"])

    def note_begun(self, job: Job) -> None:
        client, by_token = job.owner.client, job.owner.grant is not None
        assert by_token or client not in self.losers, "who has lost the lease moves nothing"
        assert by_token or self.holder in (None, client), "only the holder's motions begin"
        queued = [entry.job.number for entry in self.world.controller.jobs.queue]
        earlier = [number for number in queued if number < job.number]
        assert not earlier or self.replaces or job.kind in POWER, "first come, first served"
        assert self.world.controller.stop_latch.latched is None or job.kind in POWER
        self.left = None

    def leave_as(self, level: str) -> None:
        """Expect the jaws to be left so; what a latched stop has let go stays so."""
        latched = self.world.controller.stop_latch.latched
        self.left = level if latched is None else max(level, latched.level, key=LEVELS.index)
        self.left_s = self.world.now_s
        self.must_hold = self.left == "hold" and self.was_stiff

    def note_stiffness(self) -> None:
        """Note whether jaws that are left as they are would hold."""
        controller, running = self.world.controller, self.world.controller.jobs.running
        self.was_stiff = not isinstance(controller.idle, Slack)
        if running is not None and (controller.has_stepped or running.kind in POWER):
            self.was_stiff = running.kind in STIFF and running.kind != "play"  # it may still load
        if self.world.phase is not MotorPhase.ENABLED or controller.must_disable:
            self.was_stiff = False

    def ask(self, client: Client, method: str, **params: Any) -> dict[str, Any]:
        """Send a request; a refusal must name who is in the way."""
        self.said.append(f"client {client.session.identity} asks for {method} {params}")
        holder, active = self.holder, self.active()
        own = client.session.identity
        self.replaces = params.get("if_busy") == "replace"
        number = client.send(method, **params)
        self.replaces = False
        answer = client.answers[number] if client.has_answer(number) else {}
        data = answer.get("error", {}).get("data", {})
        if data.get("reason") == "lease_held" and "owner" in data:
            assert holder not in (None, own), "the lease is another's"
        if data.get("reason") == "lease_lost" and "lease" not in str(params) + method:
            assert own in self.losers, "only who has lost it is told so"
        if "busy" in data.get("reason", "") and "job" in data:
            assert data["job"] in [job.number for job in active], "that motion is in the way"
        result: dict[str, Any] = answer.get("result", {})
        self.token = result.get("lease", self.token)
        return result

    def acquire(self, client: Client) -> None:
        ttl = {"ttl_s": 0.3} if self.random.random() < 0.3 else {}
        on_lost, wait_s = self.random.choice(LEVELS), self.random.choice([0, 0, 0.5])
        self.ask(client, "lease.acquire", on_lost=on_lost, wait_s=wait_s, **ttl)

    def resume(self, client: Client) -> None:
        self.ask(client, "lease.resume", lease=self.token)

    def take(self, client: Client) -> None:
        jaws = self.ask(client, "lease.take", why="a test", jaws=self.random.choice(LEVELS))["jaws"]
        if jaws is not None:
            self.leave_as(jaws)

    def stop(self, client: Client) -> None:
        level = self.random.choice(LEVELS)
        self.ask(client, "stop", level=level)
        self.leave_as(level)

    def cancel(self, client: Client) -> None:
        for job in self.active()[:1]:
            self.ask(client, "job.cancel", job=job.number)

    def move(self, client: Client) -> None:
        method, params = self.random.choice(MOTIONS)
        if method.rpartition(".")[2] in STIFF:
            params = {**params, "wait": self.random.choice([True, False])}
            params["if_busy"] = self.random.choice(["reject", "replace", "queue", "queue"])
        token = {"lease": self.token} if self.random.random() < 0.2 else {}
        if self.ask(client, method, **params, **token) and method == "motion.set_force":
            self.left = None

    def lose(self, client: Client) -> None:
        self.said.append(f"client {client.session.identity} is lost")
        self.clients[self.clients.index(client)] = self.world.client()
        client.leave()

    def play(self, steps: int) -> None:
        for _ in range(steps):
            holders = [one for one in self.clients if one.session.identity == self.holder]
            is_holders = bool(holders) and self.random.random() < 0.7
            self.note_stiffness()
            client = self.random.choice(holders if is_holders else self.clients)
            act = self.random.choice(ACTS)
            self.ask(client, act) if "." in act else getattr(self, act)(client)
            self.world.service.take_events()
            to_an_end = self.random.random() < 0.15
            for _ in range(200 if to_an_end else self.random.choice([0, 0, 0, 1, 4, 40])):
                if to_an_end and self.world.controller.jobs.running is None:
                    break  # a client that has its answer may ask in this very tick
                self.note_stiffness()
                self.world.tick()
                self.check()

    def check(self) -> None:
        world, left = self.world, self.left
        if self.active():
            self.left_s = world.now_s
        if left is None or world.now_s - self.left_s < SETTLED_S:
            return
        is_enabled = world.phase is MotorPhase.ENABLED
        is_slack = isinstance(world.controller.idle, Slack)
        assert not (left == "disable" and is_enabled), "the motor is disabled"
        assert not (left == "relax" and is_enabled and not is_slack), "the jaws are slack"
        assert not (self.must_hold and (is_slack or not is_enabled)), "the jaws hold on"


@pytest.mark.parametrize("seed", range(70, 120))
def test_the_jaws_are_left_as_they_should_be(seed: int) -> None:
    scene = AnyLoss(seed)
    try:
        scene.play(steps=60)
    except AssertionError as error:
        raise AssertionError("\n".join([str(error), *scene.said[-25:]])) from error
