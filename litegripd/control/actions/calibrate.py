"""Calibrating by probing both mechanical stops, the open one first.

The direction is the one declared before: a stall cannot tell one stop from the other.
"""

from dataclasses import replace
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.filter import Bounds, probe_bounds
from litegripd.control.gains import Gains
from litegripd.control.probe import Probe
from litegripd.control.saving import Saving, failed
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.results import Progress

Phase: TypeAlias = Literal["probe_open", "probe_closed", "back_off", "saving"]

BACK_OFF_WITHIN_S = 1.0


class Calibrate(PlainAction):
    """Probes open, probes closed, backs off the closed stop by one probe step, saves."""

    def __init__(self, close_sign: int, config: MotionConfig, saving: Saving) -> None:
        self.bounds: Bounds | None = probe_bounds(config)
        self._close_sign = close_sign
        self._config = config
        self._saving = saving
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._phase: Phase = "probe_open"
        self._probe = Probe(-close_sign, config)
        self._open_rad = 0.0
        self._closed_rad = 0.0
        self._backed_off_s = 0.0
        self._held_rad = 0.0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Probe, back off, or wait for the file."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        step = self._advance(now_s, motor, feedback)
        if step.outcome is None:
            return step
        return replace(step, command=None)  # the hold that follows begins; its bounds are others

    def _advance(self, now_s: float, motor: MotorView, feedback: Feedback) -> Step:
        if self._phase == "saving":
            command = self._gains.at(self._held_rad)
            return replace(self._saving.step(now_s, motor), command=command)
        if self._phase == "back_off":
            return self._back_off(now_s, feedback)
        return self._feel(now_s, feedback)

    def progress(self) -> Progress | None:
        """Tell the phase, the probe's iterations, and where command and jaws are."""
        if self._feedback is None:
            return None
        iterations = self._probe.iterations
        return progress_of(self._phase, iterations, 0, self._command_rad, self._feedback)

    def _feel(self, now_s: float, feedback: Feedback) -> Step:
        command, verdict = self._probe.step(now_s, feedback)
        self._command_rad = command.position_rad
        if verdict == "not_found":
            side = "open" if self._phase == "probe_open" else "closed"
            text = (
                f"the {side} stop was not met within {self._probe.iterations} samples: check that"
                " the jaws move freely, or raise calib_max_iter"
            )
            return Step(command, outcome=failed("not_found", text))
        if verdict == "found" and self._phase == "probe_open":
            self._open_rad = feedback.position_rad
            self._phase = "probe_closed"
            self._probe = Probe(self._close_sign, self._config)
        elif verdict == "found":
            self._closed_rad = feedback.position_rad
            self._phase, self._backed_off_s = "back_off", now_s
        return Step(command)

    def _back_off(self, now_s: float, feedback: Feedback) -> Step:
        """Open by one probe step: the jaws shall not rest pressed against each other."""
        step_rad = self._config.calib_step_rad
        backed_rad = (self._closed_rad - feedback.position_rad) * self._close_sign
        position_rad = feedback.position_rad - self._close_sign * step_rad
        if backed_rad < step_rad and now_s - self._backed_off_s < BACK_OFF_WITHIN_S:
            self._command_rad = position_rad
            return Step(self._gains.at(position_rad))
        self._held_rad = self._command_rad = feedback.position_rad
        self._phase = "saving"
        outcome = self._saving.begin(self._closed_rad, self._open_rad, plausible=True)
        return Step(self._gains.at(self._held_rad), outcome=outcome)
