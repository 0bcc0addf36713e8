"""One cell of the fault matrix: one fault in one situation, run in virtual time and looked at.

`run_cell` asserts what must hold whatever the fault; what may differ it returns as a `Cell`.
"""

from dataclasses import dataclass, field

from litegripd.control.snapshot import GripperState
from litegripd.model.motion_config import MOVING_KP_NM_RAD
from litegripd.model.motor import MotorPhase
from litegripd.motor import codec
from litegripd.sim.motor import ENABLED
from tests.faults.fault_world import FaultWorld
from tests.faults.rows import Fault
from tests.faults.situations import FORCE_N, Situation, gripping, idle, recording, squeeze_n
from tests.world import CAN_ID, Client

SETTLED_S = 0.6
SETTLES_WITHIN_S = 8.0
OLDEST_S = 0.1
"""The motor's own watchdog: what is older finds the motor disarmed, unless somebody armed it."""
WAITS = MotorPhase.DISABLED, MotorPhase.FAULT, MotorPhase.ENABLED


@dataclass(frozen=True, slots=True)
class Cell:
    """What one fault came to; texts as the page has them."""

    fault: str
    situation: str
    bus: str
    mode: str
    motion: str
    following: str
    jaws: str
    recovery: str

    def row(self) -> str:
        """Return the row of the page's table."""
        values = (self.situation, self.bus, self.mode, self.motion, self.following, self.jaws)
        return f"| {' | '.join(values)} | {self.recovery} |"


@dataclass(slots=True)
class Watch:
    """What a client and an onlooker see, tick by tick."""

    world: FaultWorld
    before: GripperState
    from_mm: float
    buses: list[str] = field(default_factory=list)
    modes: list[str] = field(default_factory=list)
    most_mm: float = 0.0
    least_n: float = FORCE_N
    changed_s: float = 0.0
    furthest_mm: float = 0.0
    """How far the jaws were beyond a calibrated stop."""

    def look(self) -> None:
        world, state = self.world, self.world.state
        if state.bus not in ("up", *self.buses[-1:]) and state.bus not in self.buses:
            self.buses.append(state.bus)
        if state.mode != self.before.mode and state.mode not in self.modes:
            self.modes.append(state.mode)
        opening_mm = world.gripper.opening_mm
        self.most_mm = max(self.most_mm, abs(opening_mm - self.from_mm))
        self.least_n = min(self.least_n, squeeze_n(world))
        geometry = world.geometry
        self.furthest_mm = max(self.furthest_mm, -opening_mm, opening_mm - geometry.travel_mm)

    def tick(self) -> None:
        """Let a tick pass; nothing arms the motor for which no client has asked."""
        world = self.world
        running, since = world.controller.jobs.running, len(world.sent)
        was = self._known()
        world.tick()
        arms = any(sent.frame.data == codec.ENABLE for sent in world.sent[since:])
        assert not arms or (running is not None and running.kind == "enable"), "armed unasked"
        if self._known() != was:
            self.changed_s = world.now_s
        self.look()

    def _known(self) -> tuple[MotorPhase, str, bool]:
        controller = self.world.controller
        return self.world.phase, controller.bus.state, controller.second_master.is_active


def run_cell(fault: Fault, situation: Situation) -> Cell:
    """Let a fault come, last and go, and the client get the gripper back to work."""
    with FaultWorld() as world:
        world.start()
        world.faults.seed(1)
        client = world.client()
        request = situation.begin(world, client)
        watch = Watch(world, world.state, world.gripper.opening_mm)
        return _run(world, client, request, watch, fault, situation)


def _run(
    world: FaultWorld,
    client: Client,
    request: int | None,
    watch: Watch,
    fault: Fault,
    situation: Situation,
) -> Cell:
    began_s = world.now_s
    fault.begin(world)
    if fault.switches_power:
        client.send("motor.disable" if situation.is_enabled else "motor.enable")
    while world.now_s < began_s + fault.lasts_s:
        fault.tick(world)
        watch.tick()
    if fault.enables:
        assert _asks(client, watch, "motor.enable")
    following = _following(client)
    fault.end(world)
    after_s = _settle(world, watch)
    motion = _motion(client, request)
    if situation.begin is recording:
        motion += _recording(client)
    astray_mm = fault.at_most_mm if fault.moves_jaws else 0.0
    _check_jaws(watch, situation, astray_mm)
    bus, mode = ", ".join(watch.buses), " → ".join(watch.modes)
    jaws = _jaws(watch, situation, world)
    is_enabled = situation.is_enabled is not fault.switches_power
    by_itself = world.phase is (MotorPhase.ENABLED if is_enabled else MotorPhase.DISABLED)
    steps = _back_to_work(world, watch)
    how = "by itself" if by_itself and len(steps) < 2 else ", ".join(steps)
    assert world.oldest_s <= OLDEST_S, f"a command was obeyed that was {world.oldest_s:.3f} s old"
    assert watch.furthest_mm <= lead_mm(world) + astray_mm
    return Cell(
        fault=fault.name,
        situation=situation.name,
        bus=bus or "up",
        mode=mode or watch.before.mode,
        motion=motion,
        following=following,
        jaws=jaws,
        recovery=f"{how}, {_worded(after_s)}",
    )


def _following(client: Client) -> str:
    """Tell what the next motion is answered; one that is accepted is cancelled before it runs."""
    number = client.send("motion.open", wait=False)
    answer = client.answers[number] if client.has_answer(number) else {}
    if "error" in answer:
        return f"`{answer['error']['data']['reason']}`"
    client.send("job.cancel", job=answer["result"]["job"])
    return "accepted"


def _worded(after_s: float) -> str:
    return f"{1000 * after_s:.0f} ms" if after_s else "at once"


def _settle(world: FaultWorld, watch: Watch) -> float:
    """Let the daemon find out how things are; return for how long that took in seconds."""
    ended_s = watch.changed_s = world.now_s
    while world.now_s < watch.changed_s + SETTLED_S or not _is_known(world):
        assert world.now_s < ended_s + SETTLES_WITHIN_S, (world.state, world.controller.bus)
        watch.tick()
    return watch.changed_s - ended_s


def _is_known(world: FaultWorld) -> bool:
    """True if the bus works, nobody else commands, and the daemon knows what the motor does."""
    controller = world.controller
    is_alone = not controller.second_master.is_active
    is_up = controller.bus.state == "up" and not world.state.stale
    return world.in_phase(*WAITS) and is_up and is_alone


def _motion(client: Client, request: int | None) -> str:
    if request is None:
        return "-"
    if not client.has_answer(request):
        return "goes on"
    answer = client.answers[request]
    if "error" in answer:
        return f"`{answer['error']['data']['reason']}`"
    result = answer["result"]
    if "owner" in result:  # of a job that was waited for
        error = result["error"]
        return str(result["state"]) if error is None else f"`{error['data']['reason']}`"
    return str(result.get("outcome") or ("done" if result["ok"] else "not done"))


def _recording(client: Client) -> str:
    """Tell what a recording is good for, besides how its job fares."""
    status = client.result("trajectory.status")
    if status["active"]:
        return f", {status['missed']} missed" if status["missed"] else ""
    return ", broken off" if status["error"] else ", complete"


def _check_jaws(watch: Watch, situation: Situation, astray_mm: float) -> None:
    """Jaws that nobody has asked to move stand still, but for what an object pushes back.

    `astray_mm` is how far the fault may move them while the motor is enabled.
    """
    if situation.begin is idle:
        assert watch.most_mm < 0.05, f"{watch.most_mm:.2f} mm though disabled"
    elif not situation.moves:
        assert watch.most_mm < 1.0 + astray_mm, f"{watch.most_mm:.1f} mm though not asked to"


def _jaws(watch: Watch, situation: Situation, world: FaultWorld) -> str:
    """Word where the jaws went until somebody did something about the fault, and the force."""
    goes_on = world.controller.jobs.running is not None and situation.moves
    moved = "go on" if goes_on else f"{watch.most_mm:.1f} mm"
    if situation.begin is not gripping:
        return moved
    left_n = squeeze_n(world)
    if left_n < 0.5:
        return f"{moved}, force lost"
    dips = watch.least_n < 0.95 * FORCE_N
    return f"{moved}, {left_n:.0f} N" + (
        f", dips to {max(watch.least_n, 0.0):.0f} N" if dips else ""
    )


def _back_to_work(world: FaultWorld, watch: Watch) -> list[str]:
    """Let another client open the jaws; return what it had to do before that.

    What still runs is cancelled first, as its own client would.
    """
    client = world.client()
    running = world.controller.jobs.running
    if running is not None:
        client.result("job.cancel", job=running.number)
    steps = []
    if not _enables(client, watch):
        assert _asks(client, watch, "motor.clear_fault"), "clear_fault does not help"
        assert _enables(client, watch), "neither enable nor clear_fault helps"
        steps.append("clear_fault")
    steps.append("enable")
    world.gripper.remove_object()
    assert _asks(client, watch, "motion.open", speed_mm_s=100), client.answers
    assert is_open(world)
    assert world.gripper.motor.status == ENABLED
    return steps


def lead_mm(world: FaultWorld) -> float:
    """Return by how much a command may lead the jaws on the way, with the usual stiffness."""
    lead_rad = world.controller.config.travel_nm / MOVING_KP_NM_RAD
    return lead_rad * world.gripper.parameters.rad_to_mm


def is_open(world: FaultWorld) -> bool:
    """True if the jaws are where `open` brings them, to 4 % of the travel."""
    geometry = world.geometry
    wanted_mm = world.controller.calibrated.work_opening_mm or geometry.travel_mm
    return abs(world.gripper.opening_mm - wanted_mm) < 0.04 * geometry.travel_mm


def _enables(client: Client, watch: Watch) -> bool:
    """Enable; the jaws stay where they are, and nothing that was said before is obeyed."""
    world = watch.world
    from_mm, since = world.gripper.opening_mm, len(world.sent)
    if not _asks(client, watch, "motor.enable"):
        return False
    assert abs(world.gripper.opening_mm - from_mm) < 0.5, "the jaws jumped"
    frames = [sent.frame for sent in world.sent[since:] if sent.frame.can_id == CAN_ID]
    assert codec.ENABLE not in [frame.data for frame in frames[:1]], "no zero gains before it"
    return True


def _asks(client: Client, watch: Watch, method: str, **params: object) -> bool:
    """Ask; tell whether it was done and confirmed."""
    number = client.send(method, **params)
    ends_s = watch.world.now_s + 20.0
    while not client.has_answer(number):
        assert watch.world.now_s < ends_s, f"{method} is not answered"
        watch.tick()
    answer = client.answers[number]
    return "result" in answer and bool(answer["result"]["ok"])
