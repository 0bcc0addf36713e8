"""The limits of every command, written down a second time, and watched tick by tick.

Nothing here uses the limiter: what it promises is computed independently from the calibration, the
configuration and the measurement. `slack` is what the codes of a frame may add by rounding.
"""

import math
from dataclasses import replace
from itertools import combinations

import pytest

from litegripd.control.controller import Controller
from litegripd.control.holds import Grip, Hold, Idle, Slack
from litegripd.control.motions.calibrate import Calibrate, CalibrateByHand
from litegripd.model.gripper import Geometry
from litegripd.model.motor import Feedback, MitCommand, MotorPhase, Ranges
from litegripd.model.state import JobState

PEAK_NM, RATED_NM, GRIP_NM, PEAK_NM_S = 7.0, 3.0, 4.0, 2.0
FASTEST_RAD_S = 2.9
TINY = 1e-9


def asked_nm(command: MitCommand, feedback: Feedback) -> float:
    """Return the most torque that a command can ask for, whichever of its terms end first."""
    lead_nm = command.kp_nm_rad * (command.position_rad - feedback.position_rad)
    damping_nm = command.kd_nm_s_rad * (command.velocity_rad_s - feedback.velocity_rad_s)
    terms_nm = (lead_nm, damping_nm, command.torque_nm)
    some = (sum(part) for count in (1, 2, 3) for part in combinations(terms_nm, count))
    return max(abs(sum_nm) for sum_nm in some)


def slack_nm(command: MitCommand, feedback: Feedback, ranges: Ranges) -> float:
    """Return by how much rounding to codes may raise that torque."""
    lead_rad = abs(command.position_rad - feedback.position_rad)
    slip_rad_s = abs(command.velocity_rad_s - feedback.velocity_rad_s)
    by_gains = 500.0 / 4095 * lead_rad + 5.0 / 4095 * slip_rad_s
    by_position = command.kp_nm_rad * ranges.position_rad / 65535
    by_velocity = command.kd_nm_s_rad * ranges.velocity_rad_s / 4095
    return by_gains + by_position + by_velocity + ranges.torque_nm / 4095


class LimitWatch:
    """Watches one controller; `begin` just before a tick, `check` just after it."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._impulse_nm_s = 0.0
        self._lasting_nm = RATED_NM
        self._last: tuple[float, float] | None = None
        self._probe: Calibrate | CalibrateByHand | None = None
        self._geometry: Geometry | None = None
        self._stopped = False
        self._was_stopped = False
        self._before: tuple[MotorPhase, Idle, MitCommand | None] = (
            MotorPhase.UNKNOWN,
            controller.idle,
            None,
        )

    def begin(self) -> None:
        controller = self._controller
        action, running = controller.action, controller.jobs.running
        self._geometry = controller.geometry
        self._probe = action if isinstance(action, Calibrate | CalibrateByHand) else None
        self._was_stopped = self._stopped
        self._stopped = controller.stop_latch.latched is not None
        if self._stopped:
            assert running is None or running.kind in ("disable", "clear_fault")

    def check(
        self,
        now_s: float,
        command: MitCommand | None,
        feedback: Feedback | None,
        ranges: Ranges,
        *,
        is_motion: bool,
        in_codes: bool = False,
        is_unanswered: bool = False,
    ) -> None:
        """Check what is sent in this tick, None where it is no command.

        While answers fail a motor is sent a motion's last command again, and each without its
        velocity: what damping that leaves can only brake, and is not counted.
        """
        assert sum(job.state is JobState.RUNNING for job in self._controller.jobs) <= 1
        self._check_stopped(feedback)
        if command is None:
            self._charge(now_s, 0.0)
            return
        assert self._controller.motor.phase is MotorPhase.ENABLED
        assert feedback is not None
        self._check_fields(command, ranges)
        slack = slack_nm(command, feedback, ranges) if in_codes else TINY
        code_rad = ranges.position_rad / 65535 if in_codes else TINY
        if is_unanswered:
            command = replace(command, velocity_rad_s=feedback.velocity_rad_s)
        torque_nm = asked_nm(command, feedback) - slack
        assert torque_nm <= PEAK_NM
        self._charge(now_s, max(torque_nm, 0.0))
        if not (is_motion and is_unanswered):
            self._check_bounds(command, feedback, code_rad, torque_nm, is_motion=is_motion)

    def note(self) -> None:
        """Remember what is wanted, for the next tick to be compared with."""
        controller = self._controller
        self._before = (controller.motor.phase, controller.idle, controller.output.requested)

    def _check_bounds(
        self,
        command: MitCommand,
        feedback: Feedback,
        code_rad: float,
        torque_nm: float,
        *,
        is_motion: bool,
    ) -> None:
        """Check where a command leads: into the travel, or where none is known, not far.

        A calibration that has waited for its turn may have begun in this very tick.
        """
        controller, probe = self._controller, self._probe if is_motion else None
        if isinstance(controller.action, Calibrate) and controller.jobs.running is not None:
            probe = probe or (controller.action if controller.has_stepped else None)
        lead_rad = abs(command.position_rad - feedback.position_rad) - code_rad
        # A hold keeps the configuration with which it began, too.
        configs = [controller.config, controller.in_force.config] if probe is None else []
        configs = (
            [probe._config] if isinstance(probe, Calibrate) else configs or [controller.config]
        )
        fits = any(
            lead_rad <= config.calib_step_rad and torque_nm <= config.calib_tau_limit
            for config in configs
        )
        if probe is None:  # a calibration may have been taken in this very tick
            in_force = controller.in_force.geometry  # a hold keeps that with which it began
            maybe = (self._geometry, controller.geometry, in_force)
            known = [geometry for geometry in maybe if geometry is not None]
            fits = fits and len(known) < len(maybe)
            fits = fits or any(self._is_inside(g, command, feedback, code_rad) for g in known)
        assert fits, (command, feedback, configs, self._geometry, controller.geometry)
        if isinstance(probe, CalibrateByHand):
            assert command.kp_nm_rad == command.kd_nm_s_rad == 0.0

    def _check_fields(self, command: MitCommand, ranges: Ranges) -> None:
        for value, limit in (
            (command.position_rad, ranges.position_rad),
            (command.velocity_rad_s, ranges.velocity_rad_s),
            (command.torque_nm, ranges.torque_nm),
        ):
            assert math.isfinite(value)
            assert abs(value) <= limit
        code_rad_s = ranges.velocity_rad_s / 4095
        assert abs(command.velocity_rad_s) <= FASTEST_RAD_S + code_rad_s
        assert 0.0 <= command.kp_nm_rad <= 500.0
        assert 0.0 <= command.kd_nm_s_rad <= 5.0

    def _is_inside(
        self, geometry: Geometry, command: MitCommand, feedback: Feedback, code_rad: float
    ) -> bool:
        """True if a command lies in the widened travel, or between there and the jaws."""
        beyond_rad = self._controller.config.press_overshoot * geometry.travel_rad + code_rad
        low_rad, high_rad = sorted((geometry.closed_rad, geometry.open_rad))
        low_rad = min(low_rad - beyond_rad, feedback.position_rad - code_rad)
        high_rad = max(high_rad + beyond_rad, feedback.position_rad + code_rad)
        return low_rad - TINY <= command.position_rad <= high_rad + TINY

    def _charge(self, now_s: float, torque_nm: float) -> None:
        """Sum what exceeds the rating, for a grip what it may have; once used up, that counts."""
        before_nm = self._lasting_nm
        action = self._controller.action
        by_force = self._controller.grip is not None or (action is not None and action.by_force)
        self._lasting_nm = GRIP_NM if by_force else RATED_NM
        if self._last is not None:
            last_s, last_nm = self._last
            elapsed_s = max(now_s - last_s, 0.0)
            self._impulse_nm_s += (last_nm - before_nm) * elapsed_s
            self._impulse_nm_s = max(self._impulse_nm_s, 0.0)
            if self._impulse_nm_s > PEAK_NM_S + TINY:
                assert torque_nm <= self._lasting_nm + TINY
        self._last = (now_s, torque_nm)

    def _check_hold(self, hold: Hold, requested: MitCommand, feedback: Feedback) -> None:
        """A hold has its gains, within those that are calm, and leads to its place or less far."""
        swing = self._controller.swing
        calm = swing.bound(hold.gains)
        assert requested.kp_nm_rad == pytest.approx(swing.share * calm.kp_nm_rad)
        assert requested.kd_nm_s_rad == pytest.approx(swing.share * calm.kd_nm_s_rad)
        assert requested.velocity_rad_s == requested.torque_nm == 0.0
        low_rad, high_rad = sorted((hold.position_rad, feedback.position_rad))
        assert low_rad - TINY <= requested.position_rad <= high_rad + TINY

    def _check_stopped(self, feedback: Feedback | None) -> None:
        """While a stop is latched what is wanted stands still, lets go, or squeezes less."""
        controller, before = self._controller, self._before
        self.note()
        requested = controller.output.requested
        if not self._stopped or requested is None or feedback is None:
            return
        phase, idle, was = before
        if isinstance(controller.idle, Slack):
            assert requested.kp_nm_rad == requested.kd_nm_s_rad == requested.torque_nm == 0.0
            return
        if isinstance(controller.idle, Hold):
            self._check_hold(controller.idle, requested, feedback)
        if phase is not MotorPhase.ENABLED or was is None or not self._was_stopped:
            return
        if isinstance(controller.idle, Grip):
            assert controller.idle is idle
            assert abs(requested.torque_nm) <= abs(was.torque_nm) + TINY
            assert requested.torque_nm * was.torque_nm >= 0.0
        elif isinstance(idle, Grip):
            # What it held is lost: they are caught where they run to in a period.
            ahead_rad = abs(requested.position_rad - feedback.position_rad)
            assert ahead_rad <= FASTEST_RAD_S * controller.period_s
        elif (
            controller.idle is not idle
        ):  # a hold beyond a stop comes back with the jaws, no further
            assert isinstance(controller.idle, Hold)
            assert isinstance(idle, Hold)
            assert controller.geometry is not None
            assert controller.idle == idle.eased(feedback.position_rad, controller.geometry)
