"""Calibrating by probing both mechanical stops, the open one first, and confirming each.

The direction is the one declared before: a stall cannot tell one stop from the other. What the
probes have found is confirmed by whole strokes, as an `open` and a `close` make them; a stop is
saved only where two finds in a row agree.
"""

from dataclasses import replace
from typing import Literal, TypeAlias

from litegripd.control.actions.base import PlainAction, Step, progress_of
from litegripd.control.confirming import MOST_STROKES, Confirmed, Confirming, StrokePlan
from litegripd.control.filter import Bounds, probe_bounds
from litegripd.control.gains import Gains
from litegripd.control.probe import Probe
from litegripd.control.saving import Saving, failed
from litegripd.control.stroke import RUN_SHARE
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MotorView
from litegripd.model.results import Progress, ZeroResult

Phase: TypeAlias = Literal[
    "probe_open", "probe_closed", "confirm_open", "confirm_closed", "back_off", "saving"
]

BACK_OFF_WITHIN_S = 1.0


class Calibrate(PlainAction):
    """Probes open, probes closed, confirms both, backs off by one probe step, saves."""

    def __init__(self, close_sign: int, config: MotionConfig, saving: Saving) -> None:
        self.bounds: Bounds | None = probe_bounds(config)
        self._close_sign = close_sign
        self._config = config
        self._saving = saving
        self._gains = Gains(config.calib_kp, config.calib_kd)
        self._phase: Phase = "probe_open"
        self._active: Probe | Confirming = Probe(-close_sign, config)
        self._plan = StrokePlan(config, saving.rad_to_mm)
        self._open_rad = 0.0
        self._closed_rad = 0.0
        self._friction_nm = 0.0
        self._backed_off_s = 0.0
        self._held_rad = 0.0
        self._command_rad = 0.0
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Probe, confirm, back off, or wait for the file."""
        feedback = motor.feedback
        if feedback is None:
            return Step()
        self._feedback = feedback
        step = self._advance(now_s, motor, feedback)
        if step.command is not None:
            self._command_rad = step.command.position_rad
        if step.outcome is None:
            return step
        return replace(step, command=None)  # the hold that follows begins; its bounds are others

    def progress(self) -> Progress | None:
        """Tell the phase, the probe's samples or the strokes, and where command and jaws are."""
        if self._feedback is None:
            return None
        iterations = self._active.iterations
        return progress_of(self._phase, iterations, 0, self._command_rad, self._feedback)

    def _advance(self, now_s: float, motor: MotorView, feedback: Feedback) -> Step:
        if self._phase == "saving":
            command = self._gains.at(self._held_rad)
            return replace(self._saving.step(now_s, motor), command=command)
        if self._phase == "back_off":
            return self._back_off(now_s, feedback)
        if isinstance(self._active, Probe):
            return self._feel(self._active, now_s, feedback)
        return self._confirm(self._active, now_s, feedback)

    def _feel(self, probe: Probe, now_s: float, feedback: Feedback) -> Step:
        command, verdict = probe.step(now_s, feedback)
        if verdict == "not_found":
            text = (
                f"the {self._side} stop was not met within {probe.iterations} samples: check that"
                " the jaws move freely, or raise calib_max_iter"
            )
            return Step(command, outcome=failed("not_found", text))
        if verdict == "found" and self._phase == "probe_open":
            self._open_rad = feedback.position_rad
            self._phase = "probe_closed"
            self._active = Probe(self._close_sign, self._config)
        elif verdict == "found":
            self._closed_rad = feedback.position_rad
            self._phase = "confirm_open"
            self._active = Confirming(-self._close_sign, self._open_rad, self._plan)
            return Step(command, outcome=self._unmoved() or self._judged())
        return Step(command)

    def _confirm(self, confirming: Confirming, now_s: float, feedback: Feedback) -> Step:
        command, verdict = confirming.step(now_s, feedback)
        if verdict is None:
            return Step(command)
        if verdict != "confirmed":
            return Step(command, outcome=failed("not_confirmed", self._unconfirmed(verdict)))
        self._friction_nm = max(self._friction_nm, confirming.friction_nm)
        if self._phase == "confirm_open":
            self._open_rad = confirming.stop_rad
            self._phase = "confirm_closed"
            self._active = Confirming(self._close_sign, self._closed_rad, self._plan)
            return Step(command)
        self._closed_rad = confirming.stop_rad
        self._phase, self._backed_off_s = "back_off", now_s
        return Step(command, outcome=self._too_stiff())

    def _unmoved(self) -> ZeroResult | None:
        """Return a failure where the probe did not move the jaws at all."""
        config = self._config
        if abs(self._closed_rad - self._open_rad) >= config.calib_step_rad:
            return None
        push_nm = min(config.calib_kp * config.calib_step_rad, config.calib_tau_limit)
        text = (
            f"the probe pushes with {push_nm:.2g} N·m, which did not move the jaws: clear their way"
            " and clean their guides, or raise calib_kp"
        )
        return failed("not_found", text)

    def _judged(self) -> ZeroResult | None:
        """Return how it ended already, where the stops cannot be right."""
        return self._saving.begin(self._closed_rad, self._open_rad, plausible=True)

    @property
    def _side(self) -> str:
        return "open" if self._phase.endswith("open") else "closed"

    def _unconfirmed(self, verdict: Confirmed) -> str:
        """Say why there is no stop that could be saved, and what to do."""
        if verdict == "apart":
            what = f"{MOST_STROKES} strokes to the {self._side} stop ended at different places"
        elif verdict == "stuck":
            limit_nm = RUN_SHARE * self._config.calib_tau_limit
            what = f"{limit_nm:.2g} N·m do not move the jaws to the {self._side} stop"
        else:
            what = f"a stroke did not come to rest at the {self._side} stop"
        return f"{what}: clear the jaws' way and clean their guides, then try again"

    def _too_stiff(self) -> ZeroResult | None:
        """Return a failure where friction takes all that an `open` or a `close` presses with."""
        press_nm = self._saving.kp_nm_rad * self._config.stop_lead_mm / self._saving.rad_to_mm
        if self._friction_nm < press_nm:
            return None
        text = (
            f"moving the jaws takes {self._friction_nm:.2f} N·m, and a close presses with"
            f" {press_nm:.2f}, which would not reach the stop: clean the guides, or raise"
            " stop_lead_mm"
        )
        return failed("not_confirmed", text)

    def _back_off(self, now_s: float, feedback: Feedback) -> Step:
        """Open by one probe step: the jaws shall not rest pressed against each other."""
        step_rad = self._config.calib_step_rad
        backed_rad = (self._closed_rad - feedback.position_rad) * self._close_sign
        position_rad = feedback.position_rad - self._close_sign * step_rad
        if backed_rad < step_rad and now_s - self._backed_off_s < BACK_OFF_WITHIN_S:
            return Step(self._gains.at(position_rad))
        self._held_rad = feedback.position_rad
        self._phase = "saving"
        return Step(self._gains.at(self._held_rad), outcome=self._judged())
