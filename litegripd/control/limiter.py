"""The way of every command to the motor: through a limiter, with regard to the coil's heat.

`Gains` are stiffness, damping and lead of position commands, which a torque bounds.
`CommandLimiter` bounds each command before it is packed, whatever the action asked for. It names
the limits that changed a command: they appear as `limited` in the state. `SwingGuard` bounds the
gains of holds, and calms what swings.

`Easing` lowers what presses without an end to a gentle press. A finite motion may press hard on its
way, since it ends by itself. What has no end and no set force may not: a hold that a blocked motion
leaves behind, one that something has pushed away, a follower whose leader stays closed. A short
push is to be resisted, so it gets some time. Then its torque is lowered gradually, and an elastic
object pushes the jaws back. They are not let go: what they hold must not drop.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

from litegripd.control.detectors import Lasting, SwingDetector
from litegripd.control.heat import HeatChange, HeatGuard
from litegripd.control.made_torque import MadeTorque
from litegripd.model.calibration import Calibration
from litegripd.model.gripper import DM4310, Geometry, MotorType
from litegripd.model.motion_config import (
    LEAST_DAMPING_S,
    MOVING_KD_NM_S_RAD,
    MOVING_KP_NM_RAD,
    REACHING_KP_NM_RAD,
    MotionConfig,
)
from litegripd.model.motor import (
    KD_MAX_NM_S_RAD,
    KP_MAX_NM_RAD,
    Feedback,
    MitCommand,
    Ranges,
)
from litegripd.model.plain import Carried

CALM_KD_NM_S_RAD = 1.0
"""Stable with a reserve of 1.4 on a motor that filters its speed by 2 ms, with a current loop of
1 ms and half the inertia: J·(1/T_filter + 1/T_current) is 1.4 there, and 2.8 with the whole
inertia. With more damping such motors shake as soon as something moves the jaws."""


@dataclass(frozen=True, slots=True)
class Gains:
    """Stiffness and damping of position commands."""

    kp_nm_rad: float
    kd_nm_s_rad: float

    def at(self, position_rad: float, velocity_rad_s: float = 0.0) -> MitCommand:
        """Return the command for a position, without a torque of its own."""
        return MitCommand(position_rad, velocity_rad_s, self.kp_nm_rad, self.kd_nm_s_rad, 0.0)

    def usual(self) -> "Gains":
        """Return these gains within the usual ones: a caller's stiffer ones swing some grippers.

        With 500 N·m/rad free jaws swung at 890 mm/s with 9.7 N·m at the end of a fast `move`, on a
        usual motor; with 200, on one of half the inertia. The motor closes that loop between two
        commands: no bound of a command holds it.
        """
        return self._within(DEFAULT_GAINS)

    def reaching(self) -> "Gains":
        """Return these gains, stiff enough to reach a target against friction, and damped for it.

        What they press with is bounded by a torque, so they press no harder for that.
        """
        kp = max(self.kp_nm_rad, REACHING_KP_NM_RAD)
        return Gains(kp, max(self.kd_nm_s_rad, LEAST_DAMPING_S * kp))

    def following(self) -> "Gains":
        """Return these gains within what reaches a target and is calm on every motor.

        For a file's, where a caller names none.
        """
        return self.usual().reaching()

    def catching(self) -> "Gains":
        """Return these gains within what stops running jaws, and does not throw them back."""
        return self._within(CATCHING_GAINS)

    def _within(self, most: "Gains") -> "Gains":
        kp = min(self.kp_nm_rad, most.kp_nm_rad)
        return Gains(kp, min(self.kd_nm_s_rad, most.kd_nm_s_rad))


DEFAULT_GAINS = Gains(MOVING_KP_NM_RAD, MOVING_KD_NM_S_RAD)
"""Those of motions whose caller names none, and of holds without a calibration's."""
CATCHING_GAINS = Gains(MOVING_KP_NM_RAD, CALM_KD_NM_S_RAD)
"""They stop running jaws; free jaws allow no more damping on every motor."""


def gains_of(calibration: Calibration, before: Gains) -> Gains:
    """Return a calibration's gains; one that it leaves out keeps its value from `before`."""
    kp, kd = calibration.kp_nm_rad, calibration.kd_nm_s_rad
    return Gains(
        before.kp_nm_rad if kp is None else kp,
        before.kd_nm_s_rad if kd is None else kd,
    )


def is_in_press_zone(short_rad: float, geometry: Geometry, config: MotionConfig) -> bool:
    """Return True if jaws `short_rad` short of the stop must press gently from now on."""
    return short_rad <= geometry.to_rad(config.press_zone_mm)


def lead_within(
    push_nm: float, gains: Gains, speed_rad_s: float, period_s: float
) -> tuple[Gains, float]:
    """Return gains and the largest lead (rad), with which stopped jaws are pushed by `push_nm`.

    The lead covers what the jaws travel while a measurement is on its way: a fast command is as
    much softer as its lead is longer.
    """
    lead_rad = max(push_nm / gains.kp_nm_rad, LEAD_PERIODS * speed_rad_s * period_s)
    return Gains(push_nm / lead_rad, gains.kd_nm_s_rad), lead_rad


def clamp_lead(wanted_rad: float, position_rad: float, lead_rad: float) -> float:
    """Return the position nearest to the wanted one that leads the jaws by at most `lead_rad`."""
    return min(max(wanted_rad, position_rad - lead_rad), position_rad + lead_rad)


DAMPING_SHARE = 0.4
LEAD_PERIODS = 3.0
"""The lead must cover what the jaws travel while a measurement is on its way."""
SOFTEST_KP_NM_RAD = 5.0


def budgeted(
    budget_nm: float, speed_rad_s: float, gains: Gains, period_s: float
) -> tuple[Gains, float]:
    """Return gains and the largest lead (rad) for a command that moves at `speed_rad_s`.

    Jaws that are stopped at once are pushed by kp·lead + kd·speed, which is the budget. Both gains
    are at most the given ones, so that the motion is no stiffer than without a budget.
    """
    kd = min(gains.kd_nm_s_rad, DAMPING_SHARE * budget_nm / speed_rad_s)
    left_nm = budget_nm - kd * speed_rad_s
    kp = max(gains.kp_nm_rad, SOFTEST_KP_NM_RAD)
    lead_rad = max(left_nm / kp, LEAD_PERIODS * speed_rad_s * period_s)
    return Gains(left_nm / lead_rad, kd), lead_rad


LASTING_S = 0.5
"""A push of this length is resisted; what presses on for longer is an object, or a finger."""
EASE_NM_S = 8.0
"""How fast the torque is lowered: 3 N·m in 0.4 s. An object of 20 N·m/rad opens the jaws by 21 mm/s
then. At once, from 5.35 N·m, it threw them open by up to 470 mm/s."""
BACK_S = 0.5
"""How long a press must be gentle by itself until a push is resisted again."""
ANOTHER_S = 0.1
"""After so long without a step it is another hold, or another press."""


class Easing:
    """Bounds the torque of one hold or follower; `most_nm` is infinite while nothing is bounded."""

    most_nm: Carried[float] = math.inf
    _sign: Carried[float] = 0.0
    _over: Carried[Lasting]
    _gentle: Carried[Lasting]
    _stepped_s: Carried[float | None] = None

    def __init__(self) -> None:
        self._over = Lasting(LASTING_S)
        self._gentle = Lasting(BACK_S)

    @property
    def is_active(self) -> bool:
        """True while the torque is bounded."""
        return self.most_nm < math.inf

    def reset(self) -> None:
        """Bound nothing, and begin to count again."""
        self.most_nm, self._stepped_s = math.inf, None
        self._over.reset()
        self._gentle.reset()

    def begin(self, torque_nm: float, press_nm: float) -> None:
        """Lower the present torque to `press_nm` from now on: it has lasted already."""
        self.reset()
        self.most_nm, self._sign = max(abs(torque_nm), press_nm), math.copysign(1.0, torque_nm)

    def step(
        self, now_s: float, asked_nm: float, press_nm: float, torque_nm: float, *, stands: bool
    ) -> float:
        """Return the bound for a lead that asks for `asked_nm`; `torque_nm` is the present torque.

        Only a lead that asks for more than `press_nm` for `LASTING_S` is bounded, while the jaws
        stand. One that turns round is another one.
        """
        before_s = self._stepped_s
        is_over = abs(asked_nm) > press_nm
        has_turned = is_over and asked_nm * self._sign < 0.0
        if has_turned or (before_s is not None and now_s - before_s > ANOTHER_S):
            self.reset()
        self._stepped_s = now_s
        if not self.is_active:
            self._sign = math.copysign(1.0, asked_nm)
            if not self._over.step(is_over and stands, now_s):
                return math.inf
            self.most_nm = max(min(abs(asked_nm), abs(torque_nm)), press_nm)
        elif self._gentle.step(not is_over, now_s):
            self.reset()
            return math.inf
        elapsed_s = 0.0 if before_s is None else max(now_s - before_s, 0.0)
        self.most_nm = max(self.most_nm - EASE_NM_S * elapsed_s, press_nm)
        return self.most_nm


VENDOR_KD_NM_S_RAD = 2.0
"""The damping of the vendor's SDK, for every command."""
UNSEEN_RAD_S = 1.0
"""The largest difference of the true speed from the measured one: free jaws gain it from 20 N in
1 ms, and the motor's own filter hides 1 to 2 ms."""

_MOST_AHEAD_S = 0.02
"""The longest time that is foretold: an age and a period at 100 Hz. No speed lasts for longer."""
_BRAKE_KD_NM_S_RAD = 1.0
_DAMPING_BACK_S = 0.1
"""Damping that follows a late measurement of the speed, up and down, throws the jaws to and fro."""


class Bounds(NamedTuple):
    """The bounds of commands: the widened travel; a lead and a torque where no travel is known.

    The torque never exceeds the motor's.
    """

    low_rad: float
    high_rad: float
    lead_rad: float
    torque_nm: float


def bounds_of(geometry: Geometry | None, config: MotionConfig) -> Bounds:
    """Return the bounds for a calibrated gripper, or those of an uncalibrated one."""
    if geometry is None:
        return probe_bounds(config)
    beyond_rad = config.press_overshoot * geometry.travel_rad
    low_rad = min(geometry.closed_rad, geometry.open_rad) - beyond_rad
    high_rad = max(geometry.closed_rad, geometry.open_rad) + beyond_rad
    return Bounds(low_rad, high_rad, math.inf, math.inf)


def probe_bounds(config: MotionConfig) -> Bounds:
    """Return the bounds without a known travel: little lead and little torque."""
    return Bounds(-math.inf, math.inf, config.calib_step_rad, config.calib_tau_limit)


class CommandLimiter:
    """Keeps commands finite, inside the travel, and within speed and torque of the motor.

    The torque of a command is bounded by the sum of those of kp·lead, kd·dv and torque that pull
    one way. If the sum is too large, these terms are lowered by the same share.
    """

    _impulse_nm_s: Carried[float] = 0.0
    _rated_only: Carried[bool] = False
    _last_s: Carried[float | None] = None
    _last_nm: Carried[float] = 0.0
    _damping: Carried[float] = 1.0
    NOT_CARRIED = ("_motor_type", "_lasting_nm")

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        self._motor_type = motor_type
        self._lasting_nm = motor_type.rated_nm

    def apply(
        self,
        now_s: float,
        command: MitCommand,
        feedback: Feedback,
        bounds: Bounds,
        ranges: Ranges,
        *,
        allowance_nm: float = math.inf,
        grips: bool = False,
    ) -> tuple[MitCommand, tuple[str, ...]]:
        """Return the command that may be sent, and the names of the limits that changed it.

        `allowance_nm` is the largest torque that the coil's heat allows. A hold by force, `grips`,
        may ask for more than the rating as long as the heat allows it.
        """
        limited: list[str] = []
        if not all(map(math.isfinite, _fields(command))):
            command = MitCommand(feedback.position_rad, 0.0, 0.0, _BRAKE_KD_NM_S_RAD, 0.0)
            limited.append("not_finite")
        packable = _within_ranges(command, ranges)
        if packable is not command:
            limited.append("range")
        most_rad_s = self._motor_type.fastest_rad_s
        if abs(packable.velocity_rad_s) > most_rad_s:
            velocity_rad_s = _clamp(packable.velocity_rad_s, most_rad_s)
            packable = replace(packable, velocity_rad_s=velocity_rad_s)
            limited.append("speed")
        inside = _inside(packable, feedback, bounds)
        if inside is not packable:
            limited.append("travel")
        motor = self._motor_type
        elapsed_s = self._charge(now_s)
        self._lasting_nm = motor.holding_nm if grips else motor.rated_nm
        budget_nm = min(self._lasting_nm if self._rated_only else motor.peak_nm, bounds.torque_nm)
        within, self._damping = _within_torque(
            inside, feedback, min(budget_nm, allowance_nm), self._most_damping(elapsed_s)
        )
        ahead_s = min(max(now_s - feedback.at_s, 0.0) + elapsed_s, _MOST_AHEAD_S)
        within = _within_peak(within, feedback, motor.peak_nm, ahead_s)
        if within is not inside and within != inside:
            limited.append("heat" if allowance_nm < budget_nm else "torque")
        within = _within_ranges(within, ranges)  # scaling may round to just outside a range
        self._last_nm = torque_bound_nm(within, feedback)
        return within, tuple(limited)

    @property
    def last_nm(self) -> float:
        """The largest torque that the latest command can ask for; 0 while there is none."""
        return self._last_nm

    def unpowered(self, now_s: float) -> None:
        """Take note that the motor gets no command from now on."""
        self._damping = self._most_damping(self._charge(now_s))
        self._last_nm = 0.0

    def _most_damping(self, elapsed_s: float) -> float:
        """Return the allowed share of the damping: once lowered, it comes back slowly."""
        return min(self._damping + elapsed_s / _DAMPING_BACK_S, 1.0)

    def _charge(self, now_s: float) -> float:
        """Sum up the impulse above the rating; once used up, it must drain before the next peak.

        Returns the seconds since the last command.
        """
        elapsed_s = 0.0 if self._last_s is None else max(now_s - self._last_s, 0.0)
        self._last_s = now_s
        self._impulse_nm_s += (self._last_nm - self._lasting_nm) * elapsed_s
        self._impulse_nm_s = max(self._impulse_nm_s, 0.0)
        if self._impulse_nm_s >= self._motor_type.peak_impulse_nm_s:
            self._rated_only = True
        elif self._impulse_nm_s == 0.0:
            self._rated_only = False
        return elapsed_s


def torque_bound_nm(command: MitCommand, feedback: Feedback) -> float:
    """Return the largest torque that a command can ask for, given what the motor does now.

    Opposed lead, damping and torque do not add up, but one may end before another.
    """
    return max(_sums_nm(_terms_nm(command, feedback)))


def _terms_nm(command: MitCommand, feedback: Feedback) -> tuple[float, float, float]:
    """Return the torques of lead, damping and torque, each by itself (MIT protocol)."""
    return (
        command.kp_nm_rad * (command.position_rad - feedback.position_rad),
        command.kd_nm_s_rad * (command.velocity_rad_s - feedback.velocity_rad_s),
        command.torque_nm,
    )


def _sums_nm(terms_nm: tuple[float, float, float]) -> tuple[float, float]:
    """Return the sums of the terms in the motor's positive direction, and in the other."""
    lead_nm, damping_nm, torque_nm = terms_nm
    up_nm = (
        (lead_nm if lead_nm > 0.0 else 0.0)
        + (damping_nm if damping_nm > 0.0 else 0.0)
        + (torque_nm if torque_nm > 0.0 else 0.0)
    )
    return up_nm, up_nm - (lead_nm + damping_nm + torque_nm)


def _fields(command: MitCommand) -> tuple[float, ...]:
    return (
        command.position_rad,
        command.velocity_rad_s,
        command.kp_nm_rad,
        command.kd_nm_s_rad,
        command.torque_nm,
    )


def _inside(command: MitCommand, feedback: Feedback, bounds: Bounds) -> MitCommand:
    """Keep the target in the bounds; a jaw that is outside may stay, but is not led further out.

    A velocity that leads beyond the same bound becomes 0, because damping turns it into torque.
    """
    measured_rad = feedback.position_rad
    low_rad = max(min(bounds.low_rad, measured_rad), measured_rad - bounds.lead_rad)
    high_rad = min(max(bounds.high_rad, measured_rad), measured_rad + bounds.lead_rad)
    position_rad = min(max(command.position_rad, low_rad), high_rad)
    velocity_rad_s = command.velocity_rad_s
    if command.position_rad > high_rad or measured_rad >= bounds.high_rad:
        velocity_rad_s = min(velocity_rad_s, 0.0)
    if command.position_rad < low_rad or measured_rad <= bounds.low_rad:
        velocity_rad_s = max(velocity_rad_s, 0.0)
    if (position_rad, velocity_rad_s) == (command.position_rad, command.velocity_rad_s):
        return command
    return replace(command, position_rad=position_rad, velocity_rad_s=velocity_rad_s)


def _within_torque(
    command: MitCommand, feedback: Feedback, budget_nm: float, most_damping: float
) -> tuple[MitCommand, float]:
    """Lower the terms that exceed the budget on one side; return the share of the damping, too.

    The velocity of the damping stays. The measured one is filtered by the motor and two ticks old:
    damping towards it would drive what it should brake, to and fro, for ever.
    """
    terms_nm = _terms_nm(command, feedback)
    up_nm, down_nm = _sums_nm(terms_nm)
    if up_nm <= budget_nm and down_nm <= budget_nm and most_damping == 1.0:
        return command, 1.0
    up, down = _share(budget_nm, up_nm), _share(budget_nm, down_nm)
    lead, damping, torque = (up if term_nm > 0.0 else down for term_nm in terms_nm)
    damping = min(damping, most_damping)
    if lead == damping == torque == 1.0:
        return command, 1.0
    lead_rad = command.position_rad - feedback.position_rad
    lowered = replace(
        command,
        position_rad=feedback.position_rad + lead * lead_rad,
        kd_nm_s_rad=damping * command.kd_nm_s_rad,
        torque_nm=torque * command.torque_nm,
    )
    return lowered, damping


def _share(budget_nm: float, asked_nm: float) -> float:
    return 1.0 if asked_nm <= budget_nm else budget_nm / asked_nm


def _within_peak(
    command: MitCommand, feedback: Feedback, peak_nm: float, ahead_s: float
) -> MitCommand:
    """Keep what the motor makes by itself until the next command within the peak torque.

    The motor closes its loop thousands of times in that time, at a speed and a position that are
    not known yet: the jaws may go on at their speed for `ahead_s`, or something may stop them at
    once. Then damping no longer opposes the commanded velocity. So the velocity is lowered, not the
    damping: stiff commands with less of it would swing.
    """
    lead_rad = command.position_rad - feedback.position_rad
    moved_rad = feedback.velocity_rad_s * ahead_s
    leads_nm = [command.kp_nm_rad * lead_rad, command.kp_nm_rad * (lead_rad - moved_rad)]
    most_nm, least_nm = max(leads_nm) + command.torque_nm, min(leads_nm) + command.torque_nm
    velocity_rad_s, kd = command.velocity_rad_s, command.kd_nm_s_rad
    fed_nm = kd * velocity_rad_s
    if fed_nm > 0.0 and most_nm + fed_nm > peak_nm:
        velocity_rad_s = max(peak_nm - most_nm, 0.0) / kd
    elif fed_nm < 0.0 and least_nm + fed_nm < -peak_nm:
        velocity_rad_s = min(-peak_nm - least_nm, 0.0) / kd
    slip_rad_s = abs(velocity_rad_s - feedback.velocity_rad_s) + UNSEEN_RAD_S
    left_nm = peak_nm - abs(leads_nm[0]) - abs(command.torque_nm)
    kd = min(kd, max(left_nm / slip_rad_s, VENDOR_KD_NM_S_RAD))
    if (velocity_rad_s, kd) == (command.velocity_rad_s, command.kd_nm_s_rad):
        return command
    return replace(command, velocity_rad_s=velocity_rad_s, kd_nm_s_rad=kd)


def _within_ranges(command: MitCommand, ranges: Ranges) -> MitCommand:
    """Keep every field within what a frame can carry; the encoder rejects other values.

    A command that is within them is returned as it is, the same object.
    """
    if (
        abs(command.position_rad) <= ranges.position_rad
        and abs(command.velocity_rad_s) <= ranges.velocity_rad_s
        and 0.0 <= command.kp_nm_rad <= KP_MAX_NM_RAD
        and 0.0 <= command.kd_nm_s_rad <= KD_MAX_NM_S_RAD
        and abs(command.torque_nm) <= ranges.torque_nm
    ):
        return command
    return MitCommand(
        _clamp(command.position_rad, ranges.position_rad),
        _clamp(command.velocity_rad_s, ranges.velocity_rad_s),
        min(max(command.kp_nm_rad, 0.0), KP_MAX_NM_RAD),
        min(max(command.kd_nm_s_rad, 0.0), KD_MAX_NM_S_RAD),
        _clamp(command.torque_nm, ranges.torque_nm),
    )


def _clamp(value: float, limit: float) -> float:
    return min(max(value, -limit), limit)


# Holds that swing. The motor filters the speed that it damps with, and its current follows its
# command late. With much damping a light motor swings for ever after a push, at 30 to 130 Hz, from
# one end of its torque to the other; with little damping so does a stiff hold. Friction hides it
# until something moves the jaws. The motor itself closes this loop, thousands of times a second.

HOLDING_KP_NM_RAD = MOVING_KP_NM_RAD
HOLDING_KD_NM_S_RAD = 0.6
"""The most of a hold, on a DM4310: with 0.8 a plant of 1000 swung after a pull, with 2 more of
them (`python -m tests.plants.holds`, docs/gains.md)."""
HOLDING_LEAST_KD_NM_S_RAD = 0.4
CALMER = 0.5
LEAST_SHARE = CALMER**3
"""Each time half of both gains, three times at most: less stiffness and less damping, in the same
ratio, calm any motor."""


class SwingGuard:
    """Bounds the gains of holds, and calms what swings: a hold, or a follower at rest.

    `share` is what is left of the gains, 1 unless something has swung since the motor was enabled.
    """

    share: Carried[float] = 1.0
    _detector: Carried[SwingDetector]
    NOT_CARRIED = ("_most_kd",)

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        # A rotor that is heavier by a factor bears as much more damping.
        self._most_kd = HOLDING_KD_NM_S_RAD * motor_type.inertia_kg_m2 / DM4310.inertia_kg_m2
        self._detector = SwingDetector()

    def bound(self, gains: Gains) -> Gains:
        """Return the gains of a hold within those that are calm on every motor that was tried."""
        kp = min(gains.kp_nm_rad, HOLDING_KP_NM_RAD)
        return Gains(kp, min(max(gains.kd_nm_s_rad, HOLDING_LEAST_KD_NM_S_RAD), self._most_kd))

    def calm(self, command: MitCommand, feedback: Feedback) -> tuple[MitCommand, bool]:
        """Return a command with the gains that are left, and True if they have just been lowered.

        Only what stands still in its command can be judged; another command starts anew (`rest`).
        """
        swings = self._detector.see(feedback)
        if swings:
            self._detector.reset()
        is_lowered = swings and self.share > LEAST_SHARE
        if is_lowered:
            self.share *= CALMER
        if self.share == 1.0:
            return command, is_lowered
        kp, kd = self.share * command.kp_nm_rad, self.share * command.kd_nm_s_rad
        return replace(command, kp_nm_rad=kp, kd_nm_s_rad=kd), is_lowered

    def rest(self) -> None:
        """Take note that nothing is held by stiffness now."""
        self._detector.reset()

    def renew(self) -> None:
        """Begin with the whole gains again: the motor has been enabled anew."""
        self.share = 1.0
        self._detector.reset()


class Output:
    """Keeps the wanted command, the sent one, why they differ, and what the motor made of it."""

    requested: Carried[MitCommand | None] = None
    command: Carried[MitCommand | None] = None
    limited: Carried[tuple[str, ...]] = ()
    heat: Carried[HeatGuard]
    made: Carried[MadeTorque]
    _limiter: Carried[CommandLimiter]

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        self.heat = HeatGuard(motor_type)
        self.made = MadeTorque()
        self._limiter = CommandLimiter(motor_type)

    def send(
        self,
        now_s: float,
        command: MitCommand,
        feedback: Feedback,
        bounds: Bounds,
        ranges: Ranges,
        *,
        grips: bool,
        is_held_back: bool = False,
    ) -> HeatChange | None:
        """Limit `command` to what may be sent; return a change of what the heat allows.

        `grips` is true for a hold by force, `is_held_back` if the motion's own speed limits it.
        """
        self.requested = command
        self.command, self.limited = self._limiter.apply(
            now_s,
            command,
            feedback,
            bounds,
            ranges,
            allowance_nm=self.heat.allowance_nm,
            grips=grips,
        )
        if is_held_back and "speed" not in self.limited:
            self.limited = ("speed", *self.limited)
        return self.heat.update(now_s, feedback, self._limiter.last_nm)

    def unpowered(self, now_s: float, feedback: Feedback | None) -> HeatChange | None:
        """Take note that the motor gets no command from now on."""
        self.requested, self.command, self.limited = None, None, ()
        self._limiter.unpowered(now_s)
        self.made.reset()
        return None if feedback is None else self.heat.update(now_s, feedback, 0.0)
