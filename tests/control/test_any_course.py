"""Whatever clients do and whatever the bus loses: what must hold in every period."""

from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, precondition, rule

from litegripd.control.holds import Grip
from litegripd.model.calibration import NOMINAL
from litegripd.model.motor import CanFrame, MitCommand, MotorPhase, Status
from litegripd.motor import codec
from tests.properties import examples
from tests.world import CAN_ID, PERIOD_S, Client, World, is_command

CODE_RAD = 25.0 / 65535
CODE_NM = 20.0 / 4095
FREE_RAD_S = 0.5 * NOMINAL[0].to_rad(50.0) + 60.0 / 4095
"""Half the grasp speed, and a code: so fast a hold by force expects the jaws to yield."""
LEVELS = ("hold", "relax", "disable")
levels = st.sampled_from(LEVELS)
which = st.integers(0, 3)


class AnyCourse(RuleBasedStateMachine):
    def __init__(self) -> None:
        super().__init__()
        self.world = World().start()
        self.clients: list[Client] = []
        self.geometry = self.world.controller.geometry
        self.lossy_ticks = 0
        self.held_rad: float | None = None
        self.squeezed_nm = 0.0

    def tick(self) -> None:
        """Let one period pass, and check what must hold in every one."""
        world, controller = self.world, self.world.controller
        if self.lossy_ticks:
            self.lossy_ticks -= 1
        else:
            world.lose_to_motor = world.lose_from_motor = lambda _frame: False
        running = controller.jobs.running
        latched = controller.stop_latch.latched
        phase = world.phase
        world.tick()
        sent = [s.frame.data for s in world.sent if s.at_s == world.now_s]
        own = [s.frame for s in world.sent if s.at_s == world.now_s and s.frame.can_id == CAN_ID]
        world.sent.clear()
        assert sum(job.is_running for job in controller.jobs) <= 1
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
        """While a stop is latched the position that is commanded stands still, or none is.

        Where something is held by force there is none, and the force may not rise.
        """
        before_nm = self.squeezed_nm
        self.squeezed_nm = abs(commands[-1].torque_nm) if commands else 0.0
        if not stopped or not commands:
            self.held_rad = None
            return
        command = commands[-1]
        if isinstance(self.world.controller.idle, Grip):
            self.held_rad = None
            assert self.squeezed_nm <= before_nm + CODE_NM
            assert abs(command.velocity_rad_s) <= FREE_RAD_S
            return
        assert abs(command.velocity_rad_s) < 0.01
        assert abs(command.torque_nm) < 0.0025
        if command.kp_nm_rad == 0.0:
            assert command.kd_nm_s_rad == 0.0
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
        speed=st.sampled_from([10.0, 50.0, 150.0]),
        wait=st.booleans(),
    )
    def move(self, number: int, method: str, speed: float, wait: bool) -> None:
        self.client(number).send(method, speed_mm_s=speed, wait=wait)

    @rule(
        number=which,
        force_n=st.sampled_from([3.0, 20.0]),
        hold_by=st.sampled_from(["torque", "gains"]),
        until=st.sampled_from(["held", "verdict"]),
    )
    def grasp(self, number: int, force_n: float, hold_by: str, until: str) -> None:
        self.client(number).send("motion.grasp", force_n=force_n, hold_by=hold_by, until=until)

    @rule(number=which, force_n=st.sampled_from([1.0, 40.0]))
    def set_force(self, number: int, force_n: float) -> None:
        self.client(number).send("motion.set_force", force_n=force_n)

    @rule(number=which, openness=st.floats(0.0, 1.0), duration_s=st.none() | st.floats(0.1, 5.0))
    def move_to(self, number: int, openness: float, duration_s: float | None) -> None:
        timed = {} if duration_s is None else {"duration_s": duration_s}
        self.client(number).send("motion.move", openness=openness, **timed)

    @rule(number=which, openness=st.floats(0.0, 1.0), ticks=st.sampled_from([1, 20, 60]))
    def stream(self, number: int, openness: float, ticks: int) -> None:
        client = self.client(number)
        for _ in range(ticks):
            client.send("stream.set", openness=openness)
            self.tick()

    @rule(number=which, method=st.sampled_from(["motion.hold", "motion.zero_gravity"]))
    def rest(self, number: int, method: str) -> None:
        self.client(number).send(method)

    @rule(number=which, save=st.booleans())
    def zero(self, number: int, save: bool) -> None:
        self.client(number).send("calibration.zero", save=save)

    @rule(number=which, step=st.sampled_from(["begin", "closed", "open", "finish", "cancel"]))
    def calibrate_by_hand(self, number: int, step: str) -> None:
        self.client(number).send("calibration.manual", step=step)

    @rule(number=which)
    def set_zero(self, number: int) -> None:
        self.client(number).send("motor.set_zero")

    @rule(number=which, level=levels)
    def stop(self, number: int, level: str) -> None:
        self.client(number).send("stop", level=level)

    @rule(number=which)
    def clear(self, number: int) -> None:
        self.client(number).send("stop.clear")

    @rule(number=which)
    def cancel(self, number: int) -> None:
        running = self.world.controller.jobs.running
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

    @rule(share=st.floats(0.3, 1.0), yield_mm_s=st.sampled_from([0.0, 0.0, 3.0]))
    def put_object(self, share: float, yield_mm_s: float) -> None:
        opening_mm = self.world.gripper.opening_mm
        if opening_mm > 1.0:
            self.world.gripper.put_object(width_mm=share * opening_mm, yield_mm_s=yield_mm_s)

    @rule()
    def remove_object(self) -> None:
        self.world.gripper.remove_object()

    @rule(torque_nm=st.sampled_from([0.0, 0.5, -0.5, 3.0, -3.0]))
    def push(self, torque_nm: float) -> None:
        self.world.gripper.push(torque_nm)

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
        for job in self.world.controller.jobs:
            assert job.is_running or (job.result is None) != (job.error is None)

    def teardown(self) -> None:
        """From every state the gripper gets back to work."""
        world = self.world
        self.lossy_ticks = 0
        world.gripper.set_supply(24.0)
        world.gripper.push(0.0)
        for client in self.clients:
            client.leave()
        world.run(0.05)  # what happened last is noticed with the next answers
        world.run_until(self.is_quiet, 30.0)
        client = world.client()
        client.result("stop.clear")
        assert client.result("motor.enable")["ok"]
        if world.controller.geometry != self.geometry:
            self.calibrate_anew(client)
        work_mm = world.state.work_stroke_mm  # of a template that was loaded meanwhile
        opens_to = "pressed_home" if work_mm is None else "reached"
        assert client.result("motion.open")["outcome"] == opens_to
        assert client.result("motor.disable")["ok"]
        assert world.gripper.motor.status == Status.DISABLED

    def calibrate_anew(self, client: Client) -> None:
        """Find the stops again, wherever the motor's zero is now."""
        self.world.gripper.remove_object()
        assert client.result("calibration.load", template="normal")["loaded"]
        assert client.result("calibration.zero", config={"calib_kd": 0.6})["ok"]

    def is_quiet(self) -> bool:
        """True if no job runs and the motor is in a phase that lasts, with its zero settled."""
        self.world.lose_to_motor = self.world.lose_from_motor = lambda _frame: False
        lasting = (MotorPhase.DISABLED, MotorPhase.ENABLED, MotorPhase.FAULT)
        settled = self.world.machine.motor.view().zero.state != "pending"
        return (
            settled and self.world.controller.jobs.running is None and self.world.phase in lasting
        )


TestAnyCourse = AnyCourse.TestCase
TestAnyCourse.settings = examples(40, stateful_step_count=30)
