"""How warm the motor's coil gets, and how much torque is allowed for long.

`HeatModel` estimates the coil between and ahead of the reported whole degrees. `HeatGuard` lowers
the allowed torque before the coil passes its limit. Neither changes a command: the guard returns
each change of the allowed torque, and its caller applies and reports it.
"""

import math
from collections import deque
from dataclasses import dataclass

from litegripd.model.gripper import DM4310, MotorType
from litegripd.model.motor import LATEST_DISARM_S, Feedback
from litegripd.model.plain import Carried

_WINDOW_S = 0.5  # the model advances by the mean loss of a window
_RECENT_WINDOWS = 6  # "the last seconds"
_SETTLED = 1.2  # the largest ratio of a window's loss to the one before
_STALE_S = 0.5  # an older measurement does not describe the present
_UNKNOWN_AFTER_S = LATEST_DISARM_S  # in a longer gap the motor has disarmed itself
_PLAUSIBLE_STEP_C = 2  # between two readings
_PERSISTS_S, _PERSISTS_TICKS = 1.0, 10  # how long any other reading must last to be believed

# The filter: the possible errors of its two figures and of a reading (variances).
_BASE_VARIANCE, _SHARE_VARIANCE, _READING_VARIANCE = 2.0**2, 0.3**2, 0.3**2
_FORGET_S = 1800.0  # it trusts old readings for about this long
_LEAST_SHARE, _MOST_SHARE = 0.5, 2.0
_STRAYS_K = 1.0  # the largest distance of the estimate from the reported degree
_HORIZON_S = 3600.0
_LOOK_AHEAD_S, _COOLS_WITHIN_S = 10.0, 60.0
_STEP, _STEP_EVERY_S, _STEP_SOONER_S = 0.9, 4.0, 2.0
_FAR_ABOVE_K = 2.0  # from the limit, as the next two
_RAISE_BELOW_K, _COOL_BELOW_K = 5.0, 20.0
_RAISE_EVERY_S, _RAISE_EVERY_AT_MOST_S = 20.0, 320.0
_RAISED_LASTS = 5.0  # times the winding's time constant
_IN_EFFECT = 0.98  # share of the allowance: a command that asks for more is limited


@dataclass(frozen=True, slots=True)
class HeatChange:
    """A change of the allowance; `from_nm` or `to_nm` is infinite for no limit."""

    from_nm: float
    to_nm: float
    coil_c: float
    why: str


@dataclass(frozen=True, slots=True)
class Course:
    """The coil from now on at a constant loss: two lags on their way to `end_c`."""

    end_c: float
    winding_k: float
    housing_k: float
    winding_s: float = DM4310.winding_s
    housing_s: float = DM4310.housing_s

    def at(self, ahead_s: float) -> float:
        """Return the coil's temperature in °C, `ahead_s` from now."""
        winding_k = self.winding_k * math.exp(-ahead_s / self.winding_s)
        return self.end_c + winding_k + self.housing_k * math.exp(-ahead_s / self.housing_s)

    def passes_s(self, limit_c: float, within_s: float) -> float | None:
        """Return when the coil first reaches `limit_c`, None if not in `within_s`."""
        if self.at(0.0) >= limit_c:
            return 0.0
        low_s, high_s = 0.0, self._rises_until_s(within_s)
        if self.at(high_s) < limit_c:
            return None
        for _ in range(20):  # halvings, from an hour to milliseconds
            middle_s = (low_s + high_s) / 2
            is_below = self.at(middle_s) < limit_c
            low_s, high_s = (middle_s, high_s) if is_below else (low_s, middle_s)
        return high_s

    def _rises_until_s(self, within_s: float) -> float:
        """Return when the rise of the winding is overtaken by the cooling of the housing."""
        if not self.winding_k < 0.0 < self.housing_k:
            return within_s
        ratio_log = math.log(-self.winding_k) - math.log(self.housing_k)  # a ratio may overflow
        slopes_log = ratio_log + math.log(self.housing_s / self.winding_s)
        turns_s = slopes_log / (1 / self.winding_s - 1 / self.housing_s)
        return min(max(turns_s, 0.0), within_s)


class Readings:
    """Decides which readings of the coil to believe: those near the last, or those that persist."""

    believed_c: Carried[int | None] = None
    doubtful_c: Carried[int | None] = None  # unlike the believed one, and too recent to count
    _since_s: Carried[float] = 0.0
    _ticks: Carried[int] = 0

    def add(self, now_s: float, reading_c: int) -> bool:
        """Take a reading; return True if one far from the former ones is believed from now on."""
        doubtful_c = self.doubtful_c
        if self.believed_c is not None and abs(reading_c - self.believed_c) <= _PLAUSIBLE_STEP_C:
            self.believed_c, self.doubtful_c = reading_c, None
            return False
        if doubtful_c is None or abs(reading_c - doubtful_c) > _PLAUSIBLE_STEP_C:
            self._since_s, self._ticks = now_s, 0
        self.doubtful_c = reading_c
        self._ticks += 1
        if now_s - self._since_s < _PERSISTS_S or self._ticks < _PERSISTS_TICKS:
            return False
        self.believed_c, self.doubtful_c = reading_c, None
        return True


class HeatModel:
    """Estimates the coil from the torque and the reported whole degrees, which are truncated.

    The coil is `base` + `share` · (the rise that the losses cause at the nominal resistances). The
    base stands for the room and for earlier heat; the share for resistances that differ from the
    nominal ones. A Kalman filter of these two, which forgets slowly, follows the readings.
    """

    coil_c: Carried[float | None] = None
    windows: Carried[int] = 0
    _readings: Carried[Readings]
    _last_s: Carried[float | None] = None
    _square_nm2_s: Carried[float] = 0.0
    _elapsed_s: Carried[float] = 0.0
    _recent_w: Carried[deque[float]]
    _winding_w: Carried[float] = 0.0  # the losses, smoothed by the lag of each
    _housing_w: Carried[float] = 0.0
    _base_c: Carried[float] = 0.0
    _share: Carried[float] = 1.0
    _variances: Carried[tuple[float, float, float]] = (_BASE_VARIANCE, 0.0, _SHARE_VARIANCE)
    NOT_CARRIED = ("motor_type",)

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        self.motor_type = motor_type
        self._readings = Readings()
        self._recent_w = deque(maxlen=_RECENT_WINDOWS)

    def update(self, now_s: float, feedback: Feedback) -> None:
        """Take the measurement of this tick; an old one is ignored."""
        if now_s - feedback.at_s > _STALE_S:
            return
        elapsed_s = 0.0 if self._last_s is None else max(now_s - self._last_s, 0.0)
        self._last_s = now_s
        torque_nm = min(self.motor_type.most_nm, abs(feedback.torque_nm))
        self._square_nm2_s += torque_nm * torque_nm * min(elapsed_s, _UNKNOWN_AFTER_S)
        self._elapsed_s += elapsed_s
        if self._readings.add(now_s, feedback.coil_temperature_c):
            self.coil_c = feedback.coil_temperature_c + 0.5
            self._base_c = self.coil_c - self._share * self._rise_k()
            self._variances = (_BASE_VARIANCE, 0.0, _SHARE_VARIANCE)
        if self._elapsed_s >= _WINDOW_S:
            self._advance()

    def time_to_limit_s(self) -> float | None:
        """Return when the coil reaches its limit if the loss of the last seconds continues.

        0.0 at or above it; None if not within an hour, or while no reading is known.
        """
        limit_c = self.motor_type.coil_limit_c
        return None if self.coil_c is None else self.course().passes_s(limit_c, _HORIZON_S)

    def settled_nm(self) -> float | None:
        """Return the largest torque of the last seconds; None while it has only just begun.

        It is the root mean square of a window, so that a single frame does not count.
        """
        recent_w = self._recent_w
        if len(recent_w) < 2 or recent_w[-1] > _SETTLED * recent_w[-2]:
            return None
        return math.sqrt(max(recent_w) / self.motor_type.watts_per_nm2)

    def lasting_nm(self, limit_c: float) -> float:
        """Return the torque at which the coil ends at `limit_c`, 0 where it is warmer at rest."""
        motor = self.motor_type
        k_per_nm2 = self._share * (motor.winding_k_w + motor.housing_k_w) * motor.watts_per_nm2
        return math.sqrt(max(limit_c - self._base_c, 0.0) / k_per_nm2)

    def course(self, torque_nm: float | None = None) -> Course:
        """Return the future of the coil at a torque, or with the loss of the last seconds."""
        motor = self.motor_type
        watts = sum(self._recent_w) / max(len(self._recent_w), 1)
        if torque_nm is not None:
            watts = motor.watts_per_nm2 * torque_nm**2
        winding_k_w, housing_k_w = self._share * motor.winding_k_w, self._share * motor.housing_k_w
        return Course(
            self._base_c + (winding_k_w + housing_k_w) * watts,
            winding_k_w * (self._winding_w - watts),
            housing_k_w * (self._housing_w - watts),
            motor.winding_s,
            motor.housing_s,
        )

    def _rise_k(self) -> float:
        motor = self.motor_type
        return motor.winding_k_w * self._winding_w + motor.housing_k_w * self._housing_w

    def _advance(self) -> None:
        motor = self.motor_type
        watts = motor.watts_per_nm2 * self._square_nm2_s / self._elapsed_s
        self._recent_w.append(watts)
        winding = -math.expm1(-self._elapsed_s / motor.winding_s)
        housing = -math.expm1(-self._elapsed_s / motor.housing_s)
        self._winding_w += (watts - self._winding_w) * winding
        self._housing_w += (watts - self._housing_w) * housing
        if self._readings.believed_c is not None:
            coil_c = self.coil_c = self._base_c + self._share * self._rise_k()
            if self._readings.doubtful_c is None:
                self._correct(coil_c, self._readings.believed_c)
        self._square_nm2_s = self._elapsed_s = 0.0
        self.windows += 1

    def _correct(self, coil_c: float, reading_c: int) -> None:
        """Follow the reading, which only says between which degrees the coil is."""
        rise_k = self._rise_k()
        keep = math.exp(-self._elapsed_s / _FORGET_S)
        base, both, share = (keep * variance for variance in self._variances)
        base, share = base + (1 - keep) * _BASE_VARIANCE, share + (1 - keep) * _SHARE_VARIANCE
        error_k = min(max(coil_c, reading_c), reading_c + 1.0) - coil_c
        if error_k != 0.0:
            base_part, share_part = base + both * rise_k, both + share * rise_k
            total = base_part + share_part * rise_k + _READING_VARIANCE
            corrected = self._share + share_part / total * error_k
            self._share = min(max(corrected, _LEAST_SHARE), _MOST_SHARE)
            coil_c += (1.0 - _READING_VARIANCE / total) * error_k
            base -= base_part**2 / total
            both -= base_part * share_part / total
            share -= share_part**2 / total
        self._variances = (base, both, share)
        self.coil_c = min(max(coil_c, reading_c - _STRAYS_K), reading_c + 1.0 + _STRAYS_K)
        self._base_c = self.coil_c - self._share * rise_k  # takes what the share's bounds leave


class HeatGuard:
    """Decides how much torque commands may ask for, so that the coil stays below its limit.

    `allowance_nm` is infinite while nothing is limited, and changes only when `update` returns a
    change.
    """

    model: Carried[HeatModel]
    allowance_nm: Carried[float] = math.inf
    _windows: Carried[int] = 0
    _asked_nm: Carried[float] = 0.0
    _changed_s: Carried[float] = -math.inf
    _was_raised: Carried[bool] = False
    _raise_every_s: Carried[float] = _RAISE_EVERY_S
    _top_nm: Carried[float] = 0.0  # the applied torque when the limiting began
    NOT_CARRIED = ("lasting_nm", "limit_c", "least_nm", "_raised_lasts_s")

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        self.limit_c = motor_type.coil_limit_c
        self.least_nm = motor_type.least_useful_nm
        self.model = HeatModel(motor_type)
        self.lasting_nm = math.inf
        """The torque that the coil bears without an end; infinite while no reading is known."""
        self._raised_lasts_s = _RAISED_LASTS * motor_type.winding_s

    def update(self, now_s: float, feedback: Feedback, torque_bound_nm: float) -> HeatChange | None:
        """Take this tick's measurement and the largest torque that its command asks for.

        `torque_bound_nm` may be the torque before or after it was limited to the allowance. Returns
        the change of `allowance_nm`, which the caller must report, or None.
        """
        self.model.update(now_s, feedback)
        self._asked_nm = max(self._asked_nm, torque_bound_nm)
        coil_c = self.model.coil_c
        if coil_c is None or self.model.windows == self._windows:
            return None
        self._windows = self.model.windows
        self.lasting_nm = self.model.lasting_nm(self.limit_c)
        asked_nm, self._asked_nm = self._asked_nm, 0.0
        waited_s = now_s - self._changed_s
        change = self._lowered(coil_c, waited_s) or self._raised(coil_c, waited_s, asked_nm)
        if change is None:
            return None
        was_raised, self._was_raised = self._was_raised, change.to_nm > change.from_nm
        if was_raised and waited_s >= self._raised_lasts_s:
            self._raise_every_s = _RAISE_EVERY_S
        elif was_raised and not self._was_raised:  # it did not last: the next one waits longer
            self._raise_every_s = min(2.0 * self._raise_every_s, _RAISE_EVERY_AT_MOST_S)
        if change.from_nm == math.inf:
            self._top_nm = change.to_nm / _STEP
        self._changed_s, self.allowance_nm = now_s, change.to_nm
        return change

    def bears_s(self, torque_nm: float) -> float | None:
        """Return for how long a torque from now on leaves the coil below its limit, in s.

        None if it does for an hour, and while no temperature is known.
        """
        if self.model.coil_c is None:
            return None
        return self.model.course(torque_nm).passes_s(self.limit_c, _HORIZON_S)

    def lasts_s(self, now_s: float) -> float | None:
        """Return how much longer a coil that has cooled is limited if it is not used.

        None while it is warm: then that depends on how it is used.
        """
        coil_c, nm, steps = self.model.coil_c, self.allowance_nm, 0
        if coil_c is None or coil_c >= self.limit_c - _COOL_BELOW_K or nm == math.inf:
            return None
        while nm < self._top_nm:
            nm, steps = nm / _STEP, steps + 1
        return max(steps * _RAISE_EVERY_S - (now_s - self._changed_s), 0.0)

    def _lowered(self, coil_c: float, waited_s: float) -> HeatChange | None:
        course = self.model.course()
        ahead_c = course.at(_LOOK_AHEAD_S)
        rises = ahead_c > coil_c
        limit_c = self.limit_c
        if ahead_c <= limit_c or not (rises or course.at(_COOLS_WITHIN_S) > limit_c):
            return None
        is_urgent = rises and (coil_c > limit_c or ahead_c > limit_c + _FAR_ABOVE_K)
        settled_nm = self.model.settled_nm()
        if settled_nm is None or waited_s < (_STEP_SOONER_S if is_urgent else _STEP_EVERY_S):
            return None
        applied_nm = min(settled_nm, self.allowance_nm)
        if applied_nm <= self.least_nm:
            return None  # this torque does not heat the coil
        to_nm = max(_STEP * applied_nm, self.least_nm)
        why = (
            f"the coil is at {coil_c:.1f} °C, in {_LOOK_AHEAD_S:.0f} s at {ahead_c:.1f} °C with "
            f"{applied_nm:.2f} N·m; the limit is {limit_c:.0f} °C: {to_nm:.2f} N·m allowed"
        )
        return HeatChange(self.allowance_nm, to_nm, coil_c, why)

    def _raised(self, coil_c: float, waited_s: float, asked_nm: float) -> HeatChange | None:
        limit_c = self.limit_c
        every_s = _RAISE_EVERY_S if coil_c < limit_c - _COOL_BELOW_K else self._raise_every_s
        is_warm = coil_c >= limit_c - _RAISE_BELOW_K
        if self.allowance_nm == math.inf or is_warm or waited_s < every_s:
            return None
        next_nm = self.allowance_nm / _STEP
        is_in_effect = asked_nm >= _IN_EFFECT * self.allowance_nm
        course = self.model.course(min(next_nm, self._top_nm) if is_in_effect else None)
        if course.passes_s(limit_c, self._raised_lasts_s) is not None:
            return None
        to_nm = math.inf if next_nm >= self._top_nm else next_nm
        allowed = "any torque" if to_nm == math.inf else f"{to_nm:.2f} N·m"
        why = f"the coil has cooled to {coil_c:.1f} °C: {allowed} allowed"
        return HeatChange(self.allowance_nm, to_nm, coil_c, why)
