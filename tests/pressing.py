"""Every way in which the jaws come to press on something, on the simulator and on other plants.

A `Press` is a scene: it drives the jaws onto an object until nothing changes any more, with the
torque that somebody has set, or None where nobody has. `PRESSES` has at least one for each method
that moves the jaws.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from bench.teleop.follow import SETTLE_S, ScriptedLeader
from litegripd.app.build import build_service
from litegripd.model.teleop import LinkOptions
from litegripd.teleop.link import Link
from tests.plants.parameters import MM_RAD, TRAVEL_RAD, PlantParameters
from tests.plants.rigs import PlantRig, Rig, SimulatedRig
from tests.plants.world import Look
from tests.trajectories import uploaded
from tests.world import Client, FixedFacts

TRAVEL_MM = TRAVEL_RAD * MM_RAD
FROM_MM, OBJECT_MM, TO_MM = 70.0, 60.0, 25.0
CORD_MM = 30.0
"""From this opening on, a cord resists that the jaws open."""
LASTS_S = 4.0


class Leader:
    """Makes the link of a follower; `openness` is its leader's by the time since `begin`."""

    def __init__(self, openness: Callable[[float], float]) -> None:
        self.openness = openness
        self.began_s = 0.0
        self.silent_s = float("inf")

    def openness_from(self, openness: Callable[[float], float]) -> None:
        """Lead otherwise from now on."""
        self.openness = openness

    def open(self, _options: LinkOptions) -> Link:
        return _Heard(self)

    def warning(self, _options: LinkOptions) -> str | None:
        return None


class _Heard(ScriptedLeader):
    """A leader that may fall silent."""

    def __init__(self, leader: Leader) -> None:
        super().__init__(self._openness, leader.began_s, 0.005)
        self._leader = leader

    def _openness(self, at_s: float) -> float:
        return self._leader.openness(at_s)

    def receive(self, now_s: float) -> Any:
        return super().receive(now_s) if now_s < self._leader.silent_s else []


class Pressing(Rig):
    """A gripper with a client, a watcher and a leader that follows nothing yet."""

    cord_nm_rad: float = 0.0

    def begin(self, openness: Callable[[float], float]) -> None:
        """Be ready."""
        self.leader = Leader(openness)
        self.service = build_service(
            self.controller, FixedFacts(), self.period_s, dumps=self.dumps, links=self.leader
        )
        self.owner: Client = self.enabled()
        self.watcher: Client = self.client()
        self.watcher.result("events.subscribe")

    def pull_by_a_cord(self, stiffness_nm_rad: float) -> None:
        """Let a cord resist that the jaws open."""
        self.cord_nm_rad, self.pull_nm = stiffness_nm_rad, self.cord_nm

    def cord_nm(self, opening_mm: float) -> float:
        """Return with which torque a cord pulls the jaws together."""
        return self.cord_nm_rad * max(opening_mm - CORD_MM, 0.0) / MM_RAD

    def felt_nm(self, look: Look) -> float:
        """Return what the object, or the cord, feels."""
        return max(look.clamp_n / 10.0, self.cord_nm(look.opening_mm))


class PressingSimulator(SimulatedRig, Pressing):
    """The simulator of this project, pressing."""


class PressingPlant(PlantRig, Pressing):
    """A gripper that is not the simulator's, pressing."""


def rig_of(
    plant: PlantParameters | None,
    mount: str = "normal",
    rate_hz: int = 200,
    opening_mm: float = FROM_MM,
    openness: Callable[[float], float] | None = None,
) -> Pressing:
    """Return a gripper of these figures, None for the simulator, enabled."""
    rig: Pressing
    if plant is None:
        rig = PressingSimulator(mount, rate_hz, opening_mm)
    else:
        rig = PressingPlant(plant, mount, rate_hz, opening_mm)
    rig.begin(openness or closing(50.0))
    return rig


def closing(speed_mm_s: float) -> Callable[[float], float]:
    """Return a leader that closes from `FROM_MM` to `TO_MM`, and stays there."""
    return lambda at_s: max(FROM_MM - speed_mm_s * max(at_s - SETTLE_S, 0.0), TO_MM) / TRAVEL_MM


Act = Callable[[Pressing], float | None]
"""Presses on the object; returns the torque that somebody has set, None where nobody has."""


def calls(method: str, **params: Any) -> Act:
    """Return a motion that is called and ends."""

    def act(rig: Pressing) -> None:
        rig.owner.call(method, within_s=60.0, **params)

    return act


def ended_by(
    method: str, then: Callable[[Pressing, int], object], felt_nm: float = 1.1, **params: Any
) -> Act:
    """Return a motion that something else ends while it presses, with 0 N·m while it moves."""

    def act(rig: Pressing) -> None:
        number = rig.owner.send(method, **params)
        if felt_nm:
            rig.run_until(lambda: rig.felt_nm(rig.looks[-1]) > felt_nm, 10.0)
        else:
            rig.run(0.15)
        assert not rig.owner.has_answer(number)
        then(rig, rig.running.number)

    return act


def cancelled(rig: Pressing, job: int) -> None:
    rig.owner.result("job.cancel", job=job)


def stopped(rig: Pressing, _job: int) -> None:
    rig.watcher.result("stop", level="hold")


def forced(rig: Pressing) -> float:
    """Squeeze without a grasp."""
    rig.owner.result("motion.set_force", force_n=8.0)
    return 0.8


def grasped(rig: Pressing) -> float:
    """Grasp."""
    rig.owner.result("motion.grasp", force_n=15.0, until="verdict")
    return 1.5


def streamed(torque_nm: float, **more: Any) -> Act:
    """Return a stream of set-points beyond the object, which ends."""

    def act(rig: Pressing) -> float:
        for _ in range(round(2.5 / rig.period_s)):
            rig.owner.send("stream.set", opening_mm=TO_MM, torque_nm=torque_nm, **more)
            rig.tick()
        return torque_nm

    return act


def path(rig: Pressing) -> str:
    """Upload a path through the object."""
    count = round((FROM_MM - TO_MM) / 50.0 / 0.01)
    way_mm = (FROM_MM - TO_MM) / count
    points = [(0.01 * n, (FROM_MM - way_mm * n) / TRAVEL_MM) for n in range(count + 1)]
    return uploaded(rig.owner, points)


def played(rig: Pressing) -> None:
    """Play to the end, which is not reached."""
    rig.owner.result("trajectory.play", name=path(rig), torque_nm=3.0)


def paused(rig: Pressing) -> float:
    """Play, and pause where the jaws press."""
    rig.owner.send("trajectory.play", name=path(rig), torque_nm=2.0)
    rig.run_until(lambda: rig.felt_nm(rig.looks[-1]) > 0.8, 10.0)
    rig.owner.result("trajectory.control", action="pause")
    return 2.0


def follows(then: Callable[[Pressing], object] | None = None, **params: Any) -> Act:
    """Return a follower whose leader closes and stays closed."""

    def act(rig: Pressing) -> float | None:
        rig.leader.began_s = rig.now_s
        rig.owner.result("teleop.start", mode="slave", host="leader", **params)
        rig.run(SETTLE_S + 1.5)
        if then is not None:
            then(rig)
        limit_n: float | None = params.get("force_limit_n")
        return None if limit_n is None else limit_n / 10.0

    return act


def unheard(rig: Pressing) -> None:
    rig.leader.silent_s = rig.now_s


def recorded(rig: Pressing) -> None:
    """Record a move that is blocked, with the jaws driven."""
    rig.owner.result("trajectory.record_start", zero_gravity=False)
    rig.owner.call("motion.move", opening_mm=TO_MM)
    rig.owner.result("trajectory.record_stop")


def enabled_upon(rig: Pressing) -> None:
    """Enable jaws that somebody has pressed onto the object, and holds there until then."""
    rig.hand(3.0)
    rig.owner.result("motor.disable")
    rig.run(0.3)
    rig.owner.result("motor.enable")
    rig.hand(0.0)


def held_upon(rig: Pressing) -> None:
    """Hold jaws that somebody has pressed onto the object while they were slack."""
    rig.owner.result("motion.zero_gravity")
    rig.hand(3.0)
    rig.run(0.5)
    rig.owner.result("motion.hold")
    rig.hand(0.0)


@dataclass(frozen=True, slots=True)
class Press:
    """A way to press; `methods` are those of the interface that it tries."""

    act: Act
    methods: tuple[str, ...]
    opens: bool = False


def _move(then: Callable[[Pressing, int], object]) -> Act:
    return ended_by("motion.move", then, opening_mm=TO_MM)


PRESSES: dict[str, Press] = {
    "move": Press(calls("motion.move", opening_mm=TO_MM), ("motion.move",)),
    "fast move": Press(calls("motion.move", opening_mm=TO_MM, speed_mm_s=150.0), ("motion.move",)),
    "slow move": Press(calls("motion.move", opening_mm=TO_MM, speed_mm_s=10.0), ("motion.move",)),
    "stiff move": Press(calls("motion.move", opening_mm=TO_MM, kp=500.0, kd=3.0), ("motion.move",)),
    "short move": Press(calls("motion.move", opening_mm=OBJECT_MM - 1.5), ("motion.move",)),
    "opening move": Press(calls("motion.move", opening_mm=80.0), ("motion.move",), opens=True),
    "open": Press(calls("motion.open"), ("motion.open",), opens=True),
    "close": Press(calls("motion.close"), ("motion.close",)),
    "grasp": Press(grasped, ("motion.grasp",)),
    "set_force": Press(forced, ("motion.set_force",)),
    "stream": Press(streamed(1.0), ("stream.set",)),
    "strong stream": Press(streamed(3.0), ("stream.set",)),
    "weak stream": Press(streamed(0.4), ("stream.set",)),
    "play": Press(played, ("trajectory.play",)),
    "pause": Press(paused, ("trajectory.control",)),
    "record": Press(recorded, ("trajectory.record_start",)),
    "zero": Press(calls("calibration.zero"), ("calibration.zero",)),
    "enable": Press(enabled_upon, ("motor.enable",)),
    "hold": Press(held_upon, ("motion.hold", "motion.zero_gravity")),
    "cancel": Press(_move(cancelled), ("motion.move",)),
    "stop": Press(_move(stopped), ("motion.move",)),
    "lost client": Press(_move(lambda rig, _: rig.owner.leave()), ("motion.move",)),
    "take": Press(
        _move(lambda rig, _: rig.watcher.result("lease.take", why="test")), ("lease.take",)
    ),
    "cancelled close": Press(ended_by("motion.close", cancelled, 0.8), ("motion.close",)),
    "follow": Press(follows(), ("teleop.start",)),
    "follow with a limit": Press(follows(force_limit_n=20.0), ("teleop.start",)),
    "silent leader": Press(follows(unheard), ("teleop.start",)),
    "end of following": Press(
        follows(lambda rig: rig.owner.result("teleop.stop")), ("teleop.start",)
    ),
    "follower of a lost client": Press(follows(lambda rig: rig.owner.leave()), ("teleop.start",)),
}

NOT_PRESSING = {
    "stop.clear": "allows motions, moves nothing",
    "calibration.load": "moves nothing",
    "calibration.rescale": "moves nothing",
    "calibration.manual": "lets the jaws go",
    "teleop.receive": "brings a payload to what teleop.start has begun",
    "motor.set_zero": "disables the motor",
}
"""The other methods that a stop voids."""
