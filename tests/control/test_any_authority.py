"""Whatever clients do to each other: one holder, one motion, and always a way back to work."""

from typing import Any

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, precondition, rule

from litegripd.model.motor import MotorPhase
from litegripd.model.state import Job
from litegripd.sim.plant import SimulatorParameters
from tests.properties import examples
from tests.world import CAN_ID, Client, World

which = st.integers(0, 4)
levels = st.sampled_from(("hold", "relax", "disable"))
MOTIONS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("motor.enable", {}),
    ("motor.disable", {}),
    ("motion.open", {"speed_mm_s": 139}),
    ("motion.close", {"speed_mm_s": 139}),
    ("motion.grasp", {"until": "verdict"}),
    ("motion.move", {"opening_mm": 60}),
    ("motion.set_force", {"force_n": 5}),
    ("motion.zero_gravity", {}),
    ("motion.hold", {}),
    ("stream.set", {"opening_mm": 50, "valid_s": 0.05}),
)


class AnyAuthority(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        parameters = SimulatorParameters(initial_opening_mm=80.0)
        self.world = World(parameters=parameters).start()
        self.world.gripper.put_object(width_mm=40.0)
        self.clients: list[Client] = []
        self.tokens: list[str] = []
        self.jobs_before_stop: set[int] = set()

    def tick(self) -> None:
        """Let one period pass, and check what must hold in every one."""
        world, controller = self.world, self.world.controller
        was_enabled = world.phase is MotorPhase.ENABLED
        world.tick()
        own = [s for s in world.sent if s.at_s == world.now_s and s.frame.can_id == CAN_ID]
        world.sent.clear()
        if was_enabled and world.phase is MotorPhase.ENABLED:
            assert len(own) == 1, "the motor is told something in every period"
        running, holder = controller.jobs.running, controller.lease.holder
        assert sum(job is running for job in controller.jobs) <= 1
        if running is not None and not running.detached and running.grant is not None:
            assert holder is not None
            assert running.grant == holder.number
        if controller.stop_latch.latched is not None:
            assert running is None or running.kind == "disable"
            assert not [job for job in controller.jobs if job.state.value == "queued"]

    def ticks(self, count: int) -> None:
        for _ in range(count):
            self.tick()

    def client(self, number: int) -> Client:
        while len(self.clients) < 2:
            self.clients.append(self.world.client())
        return self.clients[number % len(self.clients)]

    def ask(self, client: Client, method: str, **params: Any) -> None:
        """Send a request; a client without the right to a motion must not have begun one."""
        controller = self.world.controller
        holder, before = controller.lease.holder, self.newest()
        client.send(method, **params)
        newest = self.newest()
        if newest is not None and newest is not before and holder is not None:
            by_holder = newest.owner.client == holder.owner.client
            assert by_holder or "lease" in params, "only the holder's motions begin"

    def newest(self) -> Job | None:
        jobs = list(self.world.controller.jobs)
        return jobs[-1] if jobs else None

    @rule()
    @precondition(lambda self: len(self.clients) < 5)
    def connect(self) -> None:
        self.clients.append(self.world.client())

    @rule(number=which)
    @precondition(lambda self: len(self.clients) > 2)
    def leave(self, number: int) -> None:
        gone = self.clients.pop(number % len(self.clients))
        gone.leave()
        running = self.world.controller.jobs.running
        if running is not None and running.kind != "disable":
            assert running.detached or running.owner.client != gone.session.identity
        holder = self.world.controller.lease.holder
        assert holder is None or holder.owner.client != gone.session.identity

    @rule(
        number=which,
        on_lost=levels,
        wait_s=st.sampled_from([0, 0.1, 5]),
        ttl_s=st.sampled_from([None, 0.2, 60]),
    )
    def acquire(self, number: int, on_lost: str, wait_s: float, ttl_s: float | None) -> None:
        params: dict[str, Any] = {"on_lost": on_lost, "wait_s": wait_s}
        if ttl_s is not None:
            params["ttl_s"] = ttl_s
        client = self.client(number)
        request = client.send("lease.acquire", **params)
        if client.has_answer(request) and "result" in client.answers[request]:
            self.tokens.append(client.answers[request]["result"]["lease"])
            assert client.result("lease.get")["mine"]

    @rule(number=which)
    def release(self, number: int) -> None:
        self.client(number).send("lease.release")

    @rule(number=which)
    def take(self, number: int) -> None:
        client = self.client(number)
        self.tokens.append(client.result("lease.take", why="a test")["lease"])
        assert client.result("lease.get")["mine"]

    @rule(number=which, token=st.integers(0, 30))
    @precondition(lambda self: bool(self.tokens))
    def resume(self, number: int, token: int) -> None:
        self.client(number).send("lease.resume", lease=self.tokens[token % len(self.tokens)])

    @rule(
        number=which,
        motion=st.sampled_from(MOTIONS),
        wait=st.booleans(),
        if_busy=st.sampled_from(["reject", "replace", "queue"]),
        token=st.none() | st.integers(0, 30),
    )
    def move(
        self,
        number: int,
        motion: tuple[str, dict[str, Any]],
        wait: bool,
        if_busy: str,
        token: int | None,
    ) -> None:
        method, params = motion[0], dict(motion[1])
        if method in ("motion.open", "motion.close", "motion.grasp", "motion.move"):
            params |= {"wait": wait, "if_busy": if_busy}
        if token is not None and self.tokens:
            params["lease"] = self.tokens[token % len(self.tokens)]
        self.ask(self.client(number), method, **params)

    @rule(number=which, level=levels)
    def stop(self, number: int, level: str) -> None:
        newest = self.newest()
        self.client(number).send("stop", level=level)
        self.ticks(3)
        assert self.newest() is newest, "what was admitted before a stop never runs after it"

    @rule(number=which)
    def clear(self, number: int) -> None:
        self.client(number).send("stop.clear")

    @rule(number=which, job=st.integers(1, 40))
    def cancel(self, number: int, job: int) -> None:
        self.client(number).send("job.cancel", job=job)

    @rule(count=st.integers(1, 120))
    def run(self, count: int) -> None:
        self.ticks(count)

    def teardown(self) -> None:
        """From every state the gripper gets back to work."""
        back = self.world.client()
        back.result("lease.take", why="the end")
        back.result("stop.clear")
        for job in back.result("job.list")["jobs"]:
            if job["state"] in ("running", "queued"):
                back.send("job.cancel", job=job["job"])
        self.ticks(120)
        assert back.result("motor.enable")["ok"]
        assert back.result("motion.open")["outcome"] == "pressed_home"


AnyAuthority.TestCase.settings = examples(60, stateful_step_count=30)
TestAnyAuthority = AnyAuthority.TestCase
