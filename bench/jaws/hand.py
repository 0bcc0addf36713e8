"""A hand at the simulated jaws: it opens them by so much, keeps them there, and lets go."""

from litegripd.sim.gripper import SimulatedGripper

STEP_S = 0.25e-3
"""The simulation's own step: the hand feels the jaws that often."""
STIFFNESS_NM_RAD = 1500.0
DAMPING_NM_S_RAD = 3.0
LIFT_SHARE = 1 / 3
"""The part of its time in which the hand opens the jaws."""


class Hand:
    """A stiff hand that takes the jaws at `began_s`, and lets go of them after `lasts_s`."""

    def __init__(
        self, gripper: SimulatedGripper, open_mm: float, began_s: float, lasts_s: float
    ) -> None:
        self._gripper = gripper
        self._open_mm = open_mm
        self._from_mm = gripper.opening_mm
        self._began_s = began_s
        self._lasts_s = lasts_s

    @property
    def let_go_s(self) -> float:
        """When the hand lets go."""
        return self._began_s + self._lasts_s

    def advance(self, now_s: float, until_s: float) -> None:
        """Let the gripper move from `now_s` until then, led by the hand."""
        steps = round((until_s - now_s) / STEP_S)
        for step in range(1, steps + 1):
            at_s = now_s + step * STEP_S
            self._gripper.push(self._torque_nm(at_s))
            self._gripper.advance(at_s)
        self._gripper.advance(until_s)

    def _torque_nm(self, at_s: float) -> float:
        if at_s > self.let_go_s:
            return 0.0
        gripper, lift_s = self._gripper, LIFT_SHARE * self._lasts_s
        share = min((at_s - self._began_s) / lift_s, 1.0)
        rad_to_mm, sign = gripper.parameters.rad_to_mm, gripper.parameters.close_sign
        short_rad = (self._from_mm + share * self._open_mm - gripper.opening_mm) / rad_to_mm
        speed_rad_s = self._open_mm / lift_s / rad_to_mm if share < 1.0 else 0.0
        opening_rad_s = -sign * gripper.velocity_rad_s
        torque_nm = STIFFNESS_NM_RAD * short_rad + DAMPING_NM_S_RAD * (speed_rad_s - opening_rad_s)
        return -sign * max(torque_nm, 0.0)
