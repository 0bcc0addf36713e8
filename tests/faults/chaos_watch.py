"""What must hold in every tick of chaos, and how much the daemon keeps in memory."""

import gc
import types
from collections import deque

from litegripd.model.calibration import NOMINAL
from litegripd.model.gripper import DM4310
from litegripd.model.motor import MitCommand, MotorPhase, Ranges
from litegripd.motor import codec
from litegripd.sim.motor import ENABLED
from tests.control.limits import LimitWatch
from tests.faults.cell import OLDEST_S, lead_mm
from tests.faults.fault_world import FaultWorld
from tests.world import CAN_ID, World, is_command

EXCUSED_S = 1.0
"""For so long after a hand, a grip or somebody else's command the jaws may still move by it."""
WATCHDOG_AT_MOST_S = 0.4
STANDS_MM_S = 2.0
GIVES_MM = 0.1
"""So far what the jaws press on springs back when they are held anew, at what is measured."""
TRAVEL_MM = NOMINAL[0].travel_mm
UNWANTED_S = 2.0
"""So long at most the daemon leaves a motor enabled that it does not want so, once it hears it."""
_SKIPPED = (type, types.ModuleType, types.FunctionType, types.CodeType, types.FrameType, World)


class ChaosWatch:
    """Watches one world; `tick` lets a tick pass in it.

    `is_lied_to` says that somebody else commands the jaws or a measurement lies, `is_pushed` that a
    hand or an object pushes them.
    """

    def __init__(self, world: FaultWorld) -> None:
        self._world = world
        self._limits = LimitWatch(world.controller)
        self.is_lied_to = False
        self.is_pushed = False
        self._excused_until_s = 0.0
        self._forced_until_s = 0.0
        self._fed_until_s = 0.0
        self._is_excused = False
        self._stands_since_s = world.now_s
        self._stands_mm = world.gripper.opening_mm
        self._unwanted_since_s: float | None = None
        self._state = self._present_state()

    def tick(self) -> None:
        """Let a tick pass and check it."""
        world, controller = self._world, self._world.controller
        running, latched, action = (
            controller.jobs.running,
            controller.stop_latch.latched,
            controller.action,
        )
        since = len(world.sent)
        self._limits.begin()
        self._check_owner()
        world.tick()
        own = [sent.frame for sent in world.sent[since:] if sent.frame.can_id == CAN_ID]
        if codec.ENABLE in [frame.data for frame in own]:
            assert running is not None, "armed unasked"
            assert (running.kind, latched) == ("enable", None), "armed unasked"
        identity = controller.motor.identity
        ranges = DM4310.ranges if identity is None else identity.ranges
        commands = [codec.decode_command(f.data, ranges) for f in own if is_command(f)]
        is_motion = action is not None and controller.action is action
        self._check_commands(commands, ranges, is_motion=is_motion)
        self._check_jaws()
        self._check_unwanted()
        if self.is_lied_to:  # another's frames feed the motor's watchdog; a changed one may be any
            self._fed_until_s = world.now_s + WATCHDOG_AT_MOST_S
        if world.now_s < self._fed_until_s:
            world.oldest_s = 0.0
        assert world.oldest_s <= OLDEST_S, f"a command was obeyed {world.oldest_s:.3f} s late"

    def _check_owner(self) -> None:
        """One owner: what runs for a client runs under the lease, where somebody has it.

        Disabling always goes on.
        """
        controller = self._world.controller
        running, holder = controller.jobs.running, controller.lease.holder
        if running is None or holder is None or running.grant is None or running.detached:
            return
        if running.kind == "disable":
            return
        assert running.grant == holder.number, (running, holder)

    def _check_commands(
        self, commands: list[MitCommand], ranges: Ranges, *, is_motion: bool
    ) -> None:
        world = self._world
        motor, controller = world.machine.motor, world.controller.motor
        assert len(commands) <= 1, "more than one command in a tick"
        if controller.phase is MotorPhase.ENABLED and commands:
            if motor._plausibility.in_a_row:
                assert commands[-1].kp_nm_rad == 0.0, "leads while the position is in doubt"
                self._limits.note()
                return
            self._limits.check(
                world.now_s,
                commands[-1],
                controller.feedback,
                ranges,
                is_motion=is_motion,
                in_codes=True,
                is_unanswered=motor._silence.unanswered > 1,
            )
            return
        for command in commands:
            assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0, "commanded while not enabled"
            assert abs(command.torque_nm) <= 1.01 * ranges.torque_nm / 4095
        self._limits.check(world.now_s, None, None, ranges, is_motion=False)

    def _check_jaws(self) -> None:
        """Jaws that are disabled or stopped stand; and none leave their travel, but by force."""
        world, controller = self._world, self._world.controller
        before, self._state = self._state, self._present_state()
        lets_go = before != self._state  # what the jaws have pressed on pushes them back then
        is_moved = lets_go or self.is_lied_to or self.is_pushed
        if is_moved or controller.grip is not None:
            self._forced_until_s = world.now_s + EXCUSED_S
        if is_moved or (
            controller.grip is not None and controller.grip.watched
        ):  # an object may yield
            self._excused_until_s = world.now_s + EXCUSED_S
        may_move = world.gripper.motor.status == ENABLED and controller.stop_latch.latched is None
        if may_move or world.now_s < self._excused_until_s:
            self._stands_since_s = world.now_s
        speed_mm_s = abs(world.gripper.velocity_rad_s) * world.gripper.parameters.rad_to_mm
        if world.now_s - self._stands_since_s <= EXCUSED_S:
            self._stands_mm = world.gripper.opening_mm
        moved_mm = abs(world.gripper.opening_mm - self._stands_mm)
        is_standing = speed_mm_s < STANDS_MM_S or moved_mm < GIVES_MM
        assert is_standing, f"{speed_mm_s:.1f} mm/s though disabled or stopped"
        most_mm, opening_mm = lead_mm(world), world.gripper.opening_mm
        is_inside = -most_mm <= opening_mm <= TRAVEL_MM + most_mm
        # Where a hand has pushed them they may be held.
        self._is_excused = not is_inside and (
            self._is_excused or world.now_s < self._forced_until_s
        )
        assert is_inside or self._is_excused, f"at {opening_mm:.1f} mm"

    def _present_state(self) -> tuple[int, type, bool]:
        """Return what keeps the jaws where they are: the motor, by what it is told, or a jam."""
        gripper, idle = self._world.gripper, self._world.controller.idle
        return gripper.motor.status, type(idle), gripper.is_held

    def _check_unwanted(self) -> None:
        """A motor that is enabled though the daemon says disabled is disabled soon."""
        world = self._world
        wanted = world.controller.motor.phase not in (MotorPhase.DISABLED, MotorPhase.FAULT)
        if wanted or world.gripper.motor.status != ENABLED or world.controller.bus.state != "up":
            self._unwanted_since_s = None
        elif self._unwanted_since_s is None:
            self._unwanted_since_s = world.now_s
        else:
            assert world.now_s - self._unwanted_since_s < UNWANTED_S, "stays enabled, unwanted"


def kept_by(*roots: object) -> int:
    """Count the objects that are reachable from the daemon's: what it keeps."""
    seen = {id(root) for root in roots}
    waiting: deque[object] = deque(roots)
    while waiting:
        for found in gc.get_referents(waiting.popleft()):
            if id(found) not in seen and not isinstance(found, _SKIPPED):
                seen.add(id(found))
                waiting.append(found)
    return len(seen)
