"""Random faults and random clients on one daemon, in virtual time, checked in every tick.

A run is a row of episodes: clients do what they like while faults come and go, and things and hands
get between the jaws; then all faults are taken away, and a fresh client must get the gripper back
to work within a few seconds. The same seed does the same. `chaos_main` runs it.
"""

import random
from typing import Any

from litegripd.model.motion_config import MotionConfig
from litegripd.sim.plant import MOUNTS
from tests.faults.cell import WAITS, is_open
from tests.faults.chaos_clients import CLIENTS, ChaosClient
from tests.faults.chaos_watch import ChaosWatch, kept_by
from tests.faults.fault_world import FaultWorld
from tests.faults.rows import FAULTS, Fault
from tests.world import PERIOD_S, Client

EPISODE_S = (2.0, 12.0)
FAULT_EACH_S = 0.5
FAULT_LASTS_S = (0.005, 2.5)
NUISANCE_EACH_S = 0.5
KNOWN_WITHIN_S = 6.5
"""The adapter is looked for every 5 s at the latest; then the motor's registers are read."""
NOTICED_AFTER_S = 0.5
"""What the end of a fault does, the daemon may not know in the very same tick."""
WORKS_WITHIN_S = 12.0
GROWS_BY = 1.25
"""What is kept may differ from episode to episode: jobs, events, who waits."""


class DefeatError(AssertionError):
    """What must hold did not; says when and in which run."""


class Chaos:
    """One run of one seed."""

    def __init__(self, seed: int) -> None:
        self.chance = random.Random(seed)
        self.world = FaultWorld(self.chance.choice(MOUNTS))
        self.world.faults.seed(seed)
        self.template = self.world.controller.geometry
        self.watch = ChaosWatch(self.world)
        self.clients = [ChaosClient(self.world, self.chance) for _ in range(CLIENTS)]
        self.active: dict[float, Fault] = {}
        self.episodes = self.faults = 0
        self.kept: list[int] = []
        self.slowest_s = 0.0

    def run(self, minutes: float) -> None:
        """Let episodes pass for so long."""
        with self.world:
            ends_s = self.world.now_s + 60.0 * minutes
            while self.world.now_s < ends_s:
                self.episode()

    def episode(self) -> None:
        """Let everything happen for a while; then nothing more, and the gripper must work."""
        ends_s = self.world.now_s + self.chance.uniform(*EPISODE_S)
        while self.world.now_s < ends_s:
            self._change_faults()
            self._be_a_nuisance()
            for client in self.clients:
                client.act()
            self._tick()
        self._heal()
        self._get_back_to_work()
        self.episodes += 1
        if self.episodes % 10 == 0:
            self.kept.append(kept_by(self.world.machine, self.world.service))

    def check_memory(self) -> None:
        """What the daemon keeps does not grow."""
        if len(self.kept) >= 4:
            early, late = max(self.kept[: len(self.kept) // 2]), max(self.kept)
            assert late <= GROWS_BY * early, f"the daemon keeps more and more: {self.kept}"

    def _tick(self) -> None:
        self.watch.tick()
        for client in self.clients:
            client.read()
        self.world.service.take_events()  # for the log, as the daemon does
        self.world.gripper.received.clear()
        del self.world.sent[:-200], self.world.disk.dumps[:-1]

    def _change_faults(self) -> None:
        now_s, chance = self.world.now_s, self.chance
        if chance.random() < FAULT_EACH_S * PERIOD_S:
            fault = chance.choice(FAULTS)
            if fault not in self.active.values():
                self.faults += 1
                self.active[now_s + chance.uniform(*FAULT_LASTS_S)] = fault
                fault.begin(self.world)
        for until_s in [until_s for until_s in self.active if until_s <= now_s]:
            self.active.pop(until_s).end(self.world)
        for fault in self.active.values():
            fault.tick(self.world)
        self.watch.is_lied_to = any(fault.moves_jaws for fault in self.active.values())

    def _be_a_nuisance(self) -> None:
        """Put things between the jaws, take them away, push."""
        gripper, chance = self.world.gripper, self.chance
        if chance.random() >= NUISANCE_EACH_S * PERIOD_S:
            return
        what = chance.randrange(4)
        if what == 0 and gripper.opening_mm > 2.0:
            gripper.put_object(
                width_mm=gripper.opening_mm * chance.uniform(0.3, 1.0),
                stiffness_nm_rad=chance.choice((20.0, 250.0, 2000.0)),
                yield_mm_s=chance.choice((0.0, 0.0, 3.0)),
            )
        elif what == 1:
            gripper.remove_object()
        else:
            gripper.push(chance.choice((0.0, 0.0, 0.5, -0.5, 3.0, -3.0)))
        is_held = gripper.gripped_object is not None
        self.watch.is_pushed = is_held or gripper.hand_nm != 0.0

    def _heal(self) -> None:
        """Take away every fault, thing and hand."""
        for fault in self.active.values():
            fault.end(self.world)
        self.active.clear()
        gripper = self.world.gripper
        gripper.remove_object()
        gripper.push(0.0)
        self.watch.is_lied_to = self.watch.is_pushed = False
        healed_s = self.world.now_s
        self._until(
            lambda: self.world.now_s >= healed_s + NOTICED_AFTER_S and self._is_known(),
            KNOWN_WITHIN_S,
            "is known again",
        )

    def _is_known(self) -> bool:
        controller = self.world.controller
        is_alone = not controller.second_master.is_active
        return self.world.in_phase(*WAITS) and controller.bus.state == "up" and is_alone

    def _get_back_to_work(self) -> None:
        """Let all clients leave, and a fresh one open the jaws with what a client can do.

        Where the motor's zero was set anew, an operator sets it as it was, the motor disabled.
        """
        for client in self.clients:
            client.leave()
        fresh, begins_s = self.world.client(), self.world.now_s
        self._ask(fresh, "lease.take", why="the end of an episode")
        self._ask(fresh, "stop.clear")
        for job in self._ask(fresh, "job.list")["result"]["jobs"]:
            if job["state"] in ("running", "queued"):
                self._ask(fresh, "job.cancel", job=job["job"])
        if abs(self.world.gripper.motor._offset_rad) > 1e-6:
            self._do(fresh, "motor.disable")
            self.world.gripper.motor._offset_rad = 0.0
        assert self.template is not None
        self._ask(fresh, "calibration.load", template=self.template.mount)
        defaults = MotionConfig().as_fields(PERIOD_S)
        self._ask(fresh, "config.set", config=defaults)
        if not _is_done(self._ask(fresh, "motor.enable")):
            self._do(fresh, "motor.clear_fault")
            self._do(fresh, "motor.enable")
        self._do(fresh, "motion.open", speed_mm_s=100)
        assert is_open(self.world)
        self.slowest_s = max(self.slowest_s, self.world.now_s - begins_s)
        fresh.leave()
        self.clients = [ChaosClient(self.world, self.chance) for _ in range(CLIENTS)]

    def _ask(self, client: Client, method: str, **params: Any) -> dict[str, Any]:
        number = client.send(method, **params)
        self._until(lambda: client.has_answer(number), WORKS_WITHIN_S, f"{method} is answered")
        return client.answers[number]

    def _do(self, client: Client, method: str, **params: Any) -> None:
        answer = self._ask(client, method, **params)
        assert _is_done(answer), f"{method} fails: {answer}"

    def _until(self, condition: Any, within_s: float, what: str) -> None:
        ends_s = self.world.now_s + within_s
        while not condition():
            assert self.world.now_s < ends_s, f"not within {within_s} s: {what}"
            self._tick()


def _is_done(answer: dict[str, Any]) -> bool:
    return "result" in answer and bool(answer["result"]["ok"])


def run(seed: int, minutes: float) -> Chaos:
    """Run one seed; raises `DefeatError`, naming seed and time, when something does not hold."""
    chaos = Chaos(seed)
    began_s = chaos.world.now_s
    try:
        chaos.run(minutes)
        chaos.check_memory()
    except Exception as error:
        at_s, faults = chaos.world.now_s - began_s, [f.name for f in chaos.active.values()]
        text = f"seed {seed}, after {at_s:.3f} s, with the faults {faults}: {error!r}"
        raise DefeatError(text) from error
    return chaos
