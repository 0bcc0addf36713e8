"""A simulated gripper and what drives it, for many grasps; and the vendor's way to grasp.

Without daemon, sockets and clients, so that a control period costs only what control and physics
cost. It judges nothing: that is for whoever grasps with it.
"""

from collections.abc import Callable
from dataclasses import replace

from litegripd.app.machine import Machine
from litegripd.control.detectors import StallDetector
from litegripd.control.holds import Grip, GripSettings, Idle
from litegripd.control.limiter import DEFAULT_GAINS
from litegripd.control.motions.base import Action, Enable, PlainAction, Step
from litegripd.control.motions.grasp import Grasp, GraspRequest
from litegripd.control.motions.move import Ramp
from litegripd.model.calibration import NOMINAL, Calibration
from litegripd.model.gripper import DM4310, Geometry, GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import CanFrame, EnableMotor, MotorPhase, MotorView
from litegripd.model.state import GraspOutcome, GraspResult, Job, Owner
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters, limits_of_mount

TRAVEL_MM = NOMINAL[0].travel_mm
"""Of the gripper that ships; a `Rig` without parameters of its own is one."""
PERIOD_S = 0.005
FRAME_TIME_S = 130e-6
OWNER = Owner(client=1, pid=1, uid=1, program="grasps")
DEFAULTS = MotionConfig()
TRAVEL_MM = NOMINAL[0].travel_mm


class Rig:
    """One simulated gripper and the machine that drives it, in virtual time.

    `parameters` are the simulator's, but for mount and opening.

    `peak_nm` and `peak_mm_s` are the largest true torque of the motor and the largest true speed
    of the jaws, of `looks` looks in every period.
    """

    def __init__(
        self,
        mount: str,
        opening_mm: float,
        *,
        noise_seed: int | None = None,
        period_s: float = PERIOD_S,
        parameters: SimulatorParameters | None = None,
    ) -> None:
        closed_rad, open_rad = limits_of_mount(mount)
        parameters = replace(
            parameters or SimulatorParameters(),
            closed_rad=closed_rad,
            open_rad=open_rad,
            initial_opening_mm=opening_mm,
        )
        self.geometry = Geometry(closed_rad, open_rad, parameters.rad_to_mm)
        self.gripper = SimulatedGripper(parameters, seed=noise_seed)
        self.controller = (machine := Machine(GripperId(), None, DEFAULTS, period_s)).controller
        self.controller.use_calibration(Calibration(self.geometry))
        self.period_s = period_s
        self.now_s = 1000.0
        self.looks = 1
        self.peak_nm = self.peak_mm_s = 0.0
        self._machine = machine
        self._in_flight: list[CanFrame] = []

    def tick(self) -> None:
        """Let one period pass."""
        began_s, self.now_s = self.now_s, self.now_s + self.period_s
        for look in range(1, self.looks + 1):
            self.look(began_s + self.period_s * look / self.looks)
        received, self._in_flight = self._in_flight, []
        for frame in self._machine.tick(self.now_s, received):
            self._in_flight += self.gripper.receive(self.now_s + FRAME_TIME_S, frame)

    def look(self, at_s: float) -> None:
        """Let time pass until `at_s`, and note what is true then."""
        gripper = self.gripper
        gripper.advance(at_s)
        self.peak_nm = max(self.peak_nm, abs(gripper.motor_torque_nm))
        speed_mm_s = abs(gripper.velocity_rad_s) * self.geometry.rad_to_mm
        self.peak_mm_s = max(self.peak_mm_s, speed_mm_s)

    def run(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / self.period_s)):
            self.tick()

    def run_until(self, condition: Callable[[], bool], within_s: float = 20.0) -> None:
        """Let time pass until a condition holds. Raises `TimeoutError` if it does not."""
        ends_s = self.now_s + within_s
        while not condition():
            if self.now_s >= ends_s:
                raise TimeoutError(f"did not happen within {within_s:g} s")
            self.tick()

    def begin(self, action: Action) -> Job:
        """Enable the motor and begin an action; peaks count from here."""
        self.run_until(lambda: self.controller.motor.phase is MotorPhase.DISABLED, 2.0)
        enabling = self.controller.begin("enable", Enable(EnableMotor(3, 0.2)), OWNER, True)
        self.run_until(lambda: not enabling.is_running, 2.0)
        self.peak_nm = self.peak_mm_s = 0.0
        return self.controller.begin("grasp", action, OWNER, True)

    @property
    def squeeze_nm(self) -> float:
        """The motor's true torque in the closing direction."""
        return self.geometry.close_sign * self.gripper.motor_torque_nm

    @property
    def is_grasped(self) -> bool:
        """True if something is held by force, as the daemon believes."""
        return self.controller.grip is not None and self.controller.grip.is_holding


def ours(
    geometry: Geometry,
    request: GraspRequest,
    config: MotionConfig = DEFAULTS,
    period_s: float = PERIOD_S,
) -> Action:
    """Return a grasp as the daemon does it."""
    return Grasp(
        request,
        geometry=geometry,
        config=config,
        period_s=period_s,
        motor_type=DM4310,
    )


class VendorGrasp(PlainAction):
    """A grasp as the vendor's SDK does it: a stiff ramp until the stall window, a stiff hold.

    The command leads the jaws by at most `max_lead_mm` and carries the ramp's velocity; the hold
    is that of `hold_by` "gains". As there, nothing bounds the torque of a contact.
    """

    def __init__(self, geometry: Geometry, request: GraspRequest) -> None:
        self._geometry = geometry
        self._request = request
        self._speed_rad_s = geometry.to_rad(request.speed_mm_s)
        margin_rad = DEFAULTS.margin * geometry.travel_rad
        self._target_rad = geometry.closed_rad - geometry.close_sign * margin_rad
        self._stall = StallDetector(DEFAULTS, self._speed_rad_s)
        self._ramp: Ramp | None = None
        self._grip: Grip | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        feedback = motor.feedback
        if feedback is None:
            return Step()
        position_rad = feedback.position_rad
        if self._ramp is None:
            self._ramp = Ramp(now_s, position_rad, self._target_rad, self._speed_rad_s)
        ramp_rad, velocity_rad_s = self._ramp.at(now_s)
        lead_rad = self._geometry.to_rad(DEFAULTS.max_lead_mm)
        command_rad = min(max(ramp_rad, position_rad - lead_rad), position_rad + lead_rad)
        command = DEFAULT_GAINS.at(command_rad, velocity_rad_s)
        if not self._ramp.is_over(now_s) and self._stall.add(now_s, position_rad):
            self._grip = self._take()
            return Step(command, outcome=self._result("object_held"))
        if now_s - self._ramp.began_s >= self._ramp.duration_s + DEFAULTS.settle_s:
            return Step(command, outcome=self._result("no_object"))
        return Step(command)

    def idle_after(self) -> Idle | None:
        return self._grip

    def _take(self) -> Grip:
        """Hold with the whole force at once."""
        request = self._request
        settings = GripSettings.of(self._geometry, DEFAULTS, request.speed_mm_s, "gains")
        torque_nm = self._geometry.torque_nm(request.force_n)
        return Grip(settings, request.force_n, torque_nm, DM4310, watched=True)

    def _result(self, outcome: GraspOutcome) -> GraspResult:
        held = outcome == "object_held"
        force_n = self._request.force_n
        return GraspResult(held, outcome, not held, held, self._target_rad, force_n, 0, None, 0.0)
