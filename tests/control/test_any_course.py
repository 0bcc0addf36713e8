"""Whatever clients do and whatever the bus loses: what must hold in every period."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from litegripd.model.frame import CanFrame
from litegripd.model.motor import MitCommand, MotorPhase, Status
from litegripd.motor import codec
from tests.world import CAN_ID, PERIOD_S, Client, World, is_command

CODE_RAD = 25.0 / 65535
LEVELS = ("hold", "relax", "disable")
levels = st.sampled_from(LEVELS)
which = st.integers(0, 3)


class AnyCourse(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.world = World().start()
        self.clients: list[Client] = []
        self.lossy_ticks = 0
        self.held_rad: float | None = None
        self.jobs_seen = 0

    def tick(self) -> None:
        """Let one period pass, and check what must hold in every one."""
        world, engine = self.world, self.world.engine
        if self.lossy_ticks:
            self.lossy_ticks -= 1
        else:
            world.lose_to_motor = world.lose_from_motor = lambda _frame: False
        running = engine.jobs.running
        latched = engine.stop_latch.latched
        phase = world.phase
        world.tick()
        sent = [s.frame.data for s in world.sent if s.at_s == world.now_s]
        own = [s.frame for s in world.sent if s.at_s == world.now_s and s.frame.can_id == CAN_ID]
        world.sent.clear()
        assert sum(job.is_running for job in engine.jobs) <= 1
        if codec.ENABLE in sent:
            assert running is not None
            assert running.kind == "enable"
            assert latched is None
        if world.phase is MotorPhase.ENABLED:
            assert len(own) == 1
        commands = [codec.decode_command(f.data, world.ranges) for f in own if is_command(f)]
        if world.phase is not MotorPhase.ENABLED:
            assert all(c.kp_nm_rad == c.kd_nm_s_rad == 0.0 for c in commands)
        self.check_stopped(latched is not None and phase is MotorPhase.ENABLED, commands)
        if latched is not None and latched.level == "disable":
            assert world.phase is not MotorPhase.ENABLED

    def check_stopped(self, stopped: bool, commands: list[MitCommand]) -> None:
        """While a stop is latched the position that is commanded stands still, or none is."""
        if not stopped or not commands:
            self.held_rad = None
            return
        command = commands[-1]
        assert abs(command.velocity_rad_s) < 0.01
        assert abs(command.torque_nm) < 0.0025
        if command.kp_nm_rad == 0.0:
            self.held_rad = None
            return
        if self.held_rad is not None:
            assert abs(command.position_rad - self.held_rad) <= CODE_RAD
        self.held_rad = command.position_rad

    def client(self, number: int) -> Client:
        if not self.clients:
            self.clients.append(self.world.client())
        return self.clients[number % len(self.clients)]

    @rule()
    @precondition(lambda self: len(self.clients) < 4)
    def connect(self) -> None:
        self.clients.append(self.world.client())

    @rule(number=which)
    @precondition(lambda self: self.clients)
    def leave(self, number: int) -> None:
        self.clients.pop(number % len(self.clients)).leave()

    @rule(number=which, on_lost=levels, wait=st.booleans())
    def enable(self, number: int, on_lost: str, wait: bool) -> None:
        self.client(number).send("lease.acquire", on_lost=on_lost)
        self.client(number).send("motor.enable", wait=wait)

    @rule(number=which, settled=st.booleans())
    def enable_and_wait(self, number: int, settled: bool) -> None:
        self.client(number).send("motor.enable")
        self.let_pass(0.1 if settled else 0.02)

    @rule(number=which)
    def disable(self, number: int) -> None:
        self.client(number).send("motor.disable")

    @rule(
        number=which,
        method=st.sampled_from(["motion.open", "motion.close"]),
        speed=st.sampled_from([10.0, 50.0, 120.0]),
        wait=st.booleans(),
    )
    def move(self, number: int, method: str, speed: float, wait: bool) -> None:
        self.client(number).send(method, speed_mm_s=speed, wait=wait)

    @rule(number=which)
    def hold(self, number: int) -> None:
        self.client(number).send("motion.hold")

    @rule(number=which, level=levels)
    def stop(self, number: int, level: str) -> None:
        self.client(number).send("stop", level=level)

    @rule(number=which)
    def clear(self, number: int) -> None:
        self.client(number).send("stop.clear")

    @rule(number=which)
    def cancel(self, number: int) -> None:
        running = self.world.engine.jobs.running
        if running is not None:
            self.client(number).send("job.cancel", job=running.number)

    @rule(ticks=st.sampled_from([1, 3, 5, 12, 60]), to_motor=st.booleans())
    def lose_frames(self, ticks: int, to_motor: bool) -> None:
        def lost(_frame: CanFrame) -> bool:
            return True

        self.lossy_ticks = ticks
        if to_motor:
            self.world.lose_to_motor = lost
        else:
            self.world.lose_from_motor = lost

    @rule(volts=st.sampled_from([24.0, 24.0, 40.0, 5.0]))
    def set_supply(self, volts: float) -> None:
        self.world.gripper.set_supply(volts)

    @rule()
    def power_cycle(self) -> None:
        self.world.gripper.power_cycle()

    @rule(duration_s=st.sampled_from([PERIOD_S, 2 * PERIOD_S, 0.05, 0.3, 0.8]))
    def let_pass(self, duration_s: float) -> None:
        for _ in range(round(duration_s / PERIOD_S)):
            self.tick()

    @invariant()
    def ended_jobs_tell_how(self) -> None:
        for job in self.world.engine.jobs:
            assert job.is_running or (job.result is None) != (job.error is None)

    def teardown(self) -> None:
        """From every state the gripper gets back to work."""
        world = self.world
        self.lossy_ticks = 0
        world.gripper.set_supply(24.0)
        for client in self.clients:
            client.leave()
        world.run(0.05)  # what happened last is noticed with the next answers
        world.run_until(self.is_quiet, 30.0)
        client = world.client()
        client.result("stop.clear")
        assert client.result("motor.enable")["ok"]
        assert client.result("motion.open")["outcome"] == "pressed_home"
        assert client.result("motor.disable")["ok"]
        assert world.gripper.motor.status == Status.DISABLED

    def is_quiet(self) -> bool:
        """Whether no job runs and the motor is in a phase that lasts."""
        self.world.lose_to_motor = self.world.lose_from_motor = lambda _frame: False
        lasting = (MotorPhase.DISABLED, MotorPhase.ENABLED, MotorPhase.FAULT)
        return self.world.engine.jobs.running is None and self.world.phase in lasting


TestAnyCourse = AnyCourse.TestCase
TestAnyCourse.settings = settings(
    max_examples=40, stateful_step_count=30, deadline=None, derandomize=True
)
