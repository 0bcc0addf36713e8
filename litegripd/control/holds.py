"""What idle jaws do: hold a position, hold by force, or be slack. There is always one of them.

`Grip` holds by force: how hard, how fast, and whether the object is still there. The force is a
torque, not a stiffness: around an old position reading, kp = 150 turned 20 N into 5 N when the
object yielded at 3 mm/s. The motor damps movement that is faster than the object yields. The
damping expects the measured speed, as far as that is slow, so it costs a yielding object no force.

Friction keeps the force of a contact: jaws that pressed with 10 N and get a command for 2 N keep
pressing with more. So a lowered force first goes below its new value, by the friction, and then up
to it.

A grip that closes on nothing searches: its torque lets the jaws travel only at a bounded speed.
`GripWatch` decides when, and whether the object is lost.
"""

import math
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

from litegripd.control.detectors import STILL_RAD_S, GripWatch, Lasting, WatchLimits
from litegripd.control.limiter import CALM_KD_NM_S_RAD, Gains, clamp_lead
from litegripd.model.gripper import DM4310, Geometry, MotorType
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand
from litegripd.model.plain import Carried

STEADY = (0.7, 1.3)
"""Jaws travel steadily between these shares of the commanded speed."""
CREEPING, EVEN_NM = 0.3, 0.05
"""With much friction, or a weight on them, they are slower, but their torque stays the same: the
softest object adds 0.08 N·m within `AVERAGE_S`, as it is pressed."""
AVERAGE_S = 0.03
LARGEST = 4.0
"""Times the motor's usual friction. With more, the jaws have pressed on something from the
beginning. Without a measurement, the bounds of speeds count on the usual friction only."""
LARGE = 3.0
"""Without a measurement, the detection of a loss counts on no less."""
ASSUMED = 2.0
"""Without a measurement, the judgements that must not drop an object count on no less."""


class FrictionGauge:
    """Takes torques of a free travel; the smallest mean over `AVERAGE_S` counts.

    A soft object that the jaws press while they still travel takes torque, too: that part of the
    way does not give the smallest mean.
    """

    def __init__(self, motor_type: MotorType = DM4310) -> None:
        self._largest_nm = LARGEST * motor_type.coulomb_nm
        self._began_s: float | None = None
        self._sum_nm = self._first_nm = 0.0
        self._count = 0
        self._creeps = False
        self._least_nm: float | None = None

    @property
    def friction_nm(self) -> float | None:
        """The friction, at least 0; None if the jaws have not travelled freely for long enough."""
        least_nm = self._least_nm
        return None if least_nm is None or least_nm > self._largest_nm else max(least_nm, 0.0)

    @property
    def load_nm(self) -> float | None:
        """What the travel has taken, whatever it is made of; None as long as that is not known."""
        return self._least_nm

    def add(self, now_s: float, speed_share: float, torque_nm: float) -> None:
        """Take the torque at a share of the commanded speed."""
        if not CREEPING <= speed_share <= STEADY[1]:
            self._began_s = None
            return
        if self._began_s is None:
            self._began_s, self._sum_nm, self._count = now_s, 0.0, 0
            self._first_nm, self._creeps = torque_nm, False
        self._creeps = self._creeps or speed_share < STEADY[0]
        self._sum_nm += torque_nm
        self._count += 1
        if now_s - self._began_s < AVERAGE_S * 0.999:
            return
        mean_nm, self._began_s = self._sum_nm / self._count, None
        if self._creeps and abs(torque_nm - self._first_nm) > EVEN_NM:
            return
        self._least_nm = mean_nm if self._least_nm is None else min(self._least_nm, mean_nm)


HoldBy: TypeAlias = Literal["torque", "gains"]

SOFTEST_DAMPING_NM_S_RAD = 0.35
SOFTEST_SEARCH_DAMPING_NM_S_RAD = 0.2

FREE_SPEED_SHARE = 0.5
"""Up to this share of the grasp speed the jaws follow a yielding object undamped."""
FAST_SHARE = 0.55
"""A little above `FREE_SPEED_SHARE`: jaws that are faster, and meet no resistance, are free."""

MOST_FOLLOWED_RAD_S = 1.2
"""A hold after a faster grasp is that of a grasp at this speed. With 3 N, free jaws would gather
speed for so long that their loss is known only after 50 ms."""
SEARCH_SHARE = 1.8
LEAST_SEARCH_RAD_S = 1.14
LEAST_DAMPED_RAD_S = 0.67
MOST_FREE_SHARE = 1.75
"""A search travels at `SEARCH_SHARE` of the grasp speed, but at least at `LEAST_SEARCH_RAD_S`, so
that a loss is known within 50 ms. It exceeds neither `MOST_FREE_SHARE`, nor what the damping of
the hold lets free jaws reach in any case, nor the bound of every motion."""
FAR_S = 0.028
FAR_MM = (1.15, 4.0)
"""Too far for an object that gave way: the distance that a search travels in this time, less the
time in which free jaws accelerate; within these bounds."""
MOVED_MM = 0.3
MEETS_SHARE = 1.1
"""Of the friction: standing jaws are held by a little more than travelling ones."""
HIDES_SHARE = 0.2
"""Friction that is a larger part of the set force than this hides too much of it."""
BELOW_WITHIN_S = 0.1
"""The longest time for the jaws to stand again when a force is lowered."""
RETURN_NM_S = 10.0
"""The torque returns this fast to an earlier value: there is no contact to come."""

STANDS_S = 0.15
"""So long jaws stand that do hold what a weak motor was not sure of."""
CLOSES_ON_S = 0.010
EASED_S = 0.05
"""How long jaws must stand before the object counts as having followed a lowered force."""
SOFTEST_NM_RAD = 20.0
"""The softest object that is considered. A softer one has followed only in part."""

HIDDEN_FRICTIONS = 2.0
"""Friction hides this much of the force, times what the jaws took while they travelled. Standing
jaws are held by up to twice as much (0.21 against 0.15 N·m by the manual)."""
HIDDEN_SHARE = 0.1
"""The share of the force by which the motor's torque constant may be off.

With both, the truth is in the interval in 99 % of random grips by motors whose constant is off by
up to 5 %, and in 97 % by up to 20 % (`python -m tests.plants.clamps`). At no moment of a grip it is
less than 92 %; 1.8 times the friction left 90 % of those that have settled."""
STIFFEST_NM_RAD = 1500.0
"""The stiffest object that is considered: a search that ends at one hits it the hardest."""
NOTICED_SHARE = 2.0
NOTICED_NM = 0.05
"""From this multiple of the friction, plus this amount, free jaws are certain to run."""
STICK_NM, STICK_RAD = 1.1, 0.134
"""Near the closed stop standing jaws are held by up to 0.95 N·m (field use of the gripper)."""


@dataclass(frozen=True, slots=True)
class GripSettings:
    """The settings of a grip; speeds and positions count in the motor's radians."""

    geometry: Geometry
    grasp_speed_rad_s: float
    rate_nm_s: float
    lost_at_rad: float
    """Closed this far, counted from the open side, there is nothing between the jaws."""
    by: HoldBy
    interval_s: float
    kp_nm_rad: float
    kd_nm_s_rad: float
    friction_nm: float | None = None
    """The torque that the jaws took while they closed freely; None: not measured."""

    @classmethod
    def of(
        cls,
        geometry: Geometry,
        config: MotionConfig,
        speed_mm_s: float,
        by: HoldBy,
        friction_nm: float | None = None,
    ) -> "GripSettings":
        """Return the settings from a configuration."""
        return cls(
            geometry=geometry,
            grasp_speed_rad_s=min(geometry.to_rad(speed_mm_s), MOST_FOLLOWED_RAD_S),
            rate_nm_s=geometry.torque_nm(config.force_rate_n_s),
            lost_at_rad=geometry.close_sign * geometry.closed_rad - config.stop_tol,
            by=by,
            interval_s=config.hold_interval,
            kp_nm_rad=config.hold_kp,
            kd_nm_s_rad=config.hold_kd,
            friction_nm=friction_nm,
        )

    def likely_friction_nm(self, motor_type: MotorType) -> float:
        """Return the measured friction, or an unusually large one."""
        return ASSUMED * motor_type.coulomb_nm if self.friction_nm is None else self.friction_nm

    def least_friction_nm(self, motor_type: MotorType) -> float:
        """Return the measured friction, or the usual one."""
        return motor_type.coulomb_nm if self.friction_nm is None else self.friction_nm

    def damping(self, applied_nm: float) -> float:
        """Return the damping (N·m·s/rad) of a hold with this torque."""
        free_rad_s = max(self.grasp_speed_rad_s, LEAST_DAMPED_RAD_S)
        free_rad_s = min(free_rad_s, MOST_FREE_SHARE * self.grasp_speed_rad_s)
        damping = applied_nm / free_rad_s
        return min(max(damping, SOFTEST_DAMPING_NM_S_RAD), CALM_KD_NM_S_RAD)

    def search(self, force_n: float, motor_type: MotorType) -> tuple[float, float, float]:
        """Return torque (N·m), damping (N·m·s/rad) and speed (rad/s) of a search for `force_n`.

        Standing jaws press with that torque; free ones travel at that speed, if it suffices.
        """
        applied_nm = self.geometry.torque_nm(force_n)
        friction_nm = self.least_friction_nm(motor_type)
        most_rad_s = max(
            MOST_FREE_SHARE * self.grasp_speed_rad_s, applied_nm / self.damping(applied_nm)
        )
        least_rad_s = min(LEAST_SEARCH_RAD_S, most_rad_s)
        speed_rad_s = max(SEARCH_SHARE * self.grasp_speed_rad_s, least_rad_s)
        speed_rad_s = min(speed_rad_s, motor_type.fastest_rad_s)
        torque_nm = min(applied_nm, friction_nm + CALM_KD_NM_S_RAD * speed_rad_s)
        damping = max((torque_nm - friction_nm) / speed_rad_s, SOFTEST_SEARCH_DAMPING_NM_S_RAD)
        return torque_nm, damping, speed_rad_s

    def watch_limits(self, force_n: float, motor_type: MotorType) -> WatchLimits:
        """Return the limits for the watch of a grip by `force_n`."""
        torque_nm, damping, speed_rad_s = self.search(force_n, motor_type)
        friction_nm = self.least_friction_nm(motor_type)
        driving_nm = self.geometry.torque_nm(force_n) - friction_nm
        far_rad = 0.0
        if driving_nm > 0.0:
            reached_rad_s = min((torque_nm - friction_nm) / damping, speed_rad_s)
            gathering_s = motor_type.inertia_kg_m2 * reached_rad_s / driving_nm
            far_rad = reached_rad_s * max(FAR_S - gathering_s, 0.0)
        nearest_rad, farthest_rad = map(self.geometry.to_rad, FAR_MM)
        return WatchLimits(
            fast_rad_s=FAST_SHARE * self.grasp_speed_rad_s,
            search_rad_s=speed_rad_s,
            far_rad=min(max(far_rad, nearest_rad), farthest_rad),
            lost_at_rad=self.lost_at_rad,
            friction_nm=self.likely_friction_nm(motor_type),
            moved_rad=self.geometry.to_rad(MOVED_MM),
        )


class Grip:
    """A hold by `force_n`, ramped from the torque in flight; `is_lost` once it holds nothing.

    A grip that is not `watched` squeezes from wherever the jaws are, and may drive them: it holds
    nothing until they have met something. After `stay`, it ends as soon as they close further.
    One that `is_doubtful` began where a motor that makes too little torque let the jaws stand:
    that may be an object, or nothing at all.
    """

    force_n: Carried[float]
    watched: Carried[bool]
    is_doubtful: Carried[bool] = False
    _settings: Carried[GripSettings]
    _sign: Carried[int]
    _applied_nm: Carried[float]
    _return_nm: Carried[float]
    """Up to this value the torque returns fast, because it was there before a search."""
    _below_nm: Carried[float | None] = None
    """The value to which a lowered force goes first, so that friction releases it."""
    _below_s: Carried[float] = 0.0
    _above_nm: Carried[float | None] = None
    """The value to which a new grip goes first, so that the object feels its force."""
    _lowered_nm: Carried[float] = 0.0
    """By how much the force was lowered; 0 once the object has followed."""
    _eased: Carried[Lasting]
    _sent_nm: Carried[float | None] = None
    _made_nm: Carried[float | None] = None
    _ramped_at_s: Carried[float | None] = None
    _watch: Carried[GripWatch]
    _stands: Carried[Lasting]
    _stays: Carried[bool] = False
    _decides_next: Carried[bool] = False
    _closes_on: Carried[Lasting]
    _has_moved_on: Carried[bool] = False
    _slice_began_s: Carried[float] = 0.0
    _slice_rad: Carried[float | None] = None
    NOT_CARRIED = ("_motor_type",)

    def __init__(
        self,
        settings: GripSettings,
        force_n: float,
        in_flight_nm: float,
        motor_type: MotorType,
        *,
        watched: bool,
    ) -> None:
        self.force_n = force_n
        self.watched = watched
        self._settings = settings
        self._motor_type = motor_type
        self._sign = settings.geometry.close_sign
        self._applied_nm = max(in_flight_nm, 0.0)
        self._return_nm = self._applied_nm
        self._eased = Lasting(EASED_S)
        self._watch = GripWatch(settings.watch_limits(force_n, motor_type))
        self._closes_on = Lasting(CLOSES_ON_S)
        self._stands = Lasting(STANDS_S)
        self._aim(force_n)

    @property
    def geometry(self) -> Geometry:
        """The travel and the force per torque with which it began; they stay until it ends."""
        return self._settings.geometry

    @property
    def applied_n(self) -> float:
        """The commanded force, on its way to `force_n`."""
        return self._applied_nm * self.geometry.nm_to_n

    @property
    def is_lost(self) -> bool:
        """True once there is nothing between the jaws, or they moved on after `stay`."""
        return (self.watched and self._watch.is_lost) or self._has_moved_on

    @property
    def is_holding(self) -> bool:
        """True while there is something between the jaws, as far as is known."""
        return self.watched and not self.is_lost

    @property
    def is_searching(self) -> bool:
        """True while the jaws close, and have met nothing again yet."""
        return self._watch.is_searching

    def caught_rad(self, position_rad: float, period_s: float) -> float:
        """Return where to hold the jaws after a loss: where they run to in a control period.

        A hold where they were measured would throw them back.
        """
        closing_rad_s = self._watch.speed_rad_s or 0.0
        return position_rad + self.geometry.close_sign * closing_rad_s * period_s

    @property
    def _effective_nm(self) -> float:
        """The torque that the motor gets; limits, for example by heat, may have reduced it."""
        applied_nm = self._applied_nm
        return applied_nm if self._sent_nm is None else min(applied_nm, self._sent_nm)

    def note_sent(self, torque_nm: float) -> None:
        """Take the torque that was sent in place of the last command's."""
        self._sent_nm = abs(torque_nm) if abs(torque_nm) < 0.99 * self._applied_nm else None

    def note_made(self, at_s: float, made_nm: float | None, *, is_short: bool | None) -> None:
        """Take the torque that the motor reports, None while the jaws move: it may be less.

        Jaws that stand against all of the set force, which the motor makes, do hold something.
        """
        self._made_nm = made_nm
        wanted_nm = self.geometry.torque_nm(self.force_n)
        is_strong = made_nm is not None and is_short is False
        if self._stands.step(is_strong and self._effective_nm >= 0.999 * wanted_nm, at_s):
            self.is_doubtful = False

    @property
    def clamp_n(self) -> tuple[float, float]:
        """The smallest and the largest force on the object: friction hides the exact value.

        While the jaws search for the object, the smallest is 0. So it is for a stiff hold (`by`
        "gains") around a position at which the object may no longer be. A motor that makes
        less than is commanded lowers it.
        """
        motor, nm_to_n = self._motor_type, self.geometry.nm_to_n
        commanded_nm = self._effective_nm
        # A push during the approach may have feigned jaws without friction.
        friction_nm = max(self._settings.likely_friction_nm(motor), motor.coulomb_nm)
        hidden_nm = HIDDEN_FRICTIONS * friction_nm + HIDDEN_SHARE * commanded_nm
        low_nm, high_nm = commanded_nm - hidden_nm, commanded_nm + hidden_nm
        if self._made_nm is not None:
            low_nm = min(low_nm, self._made_nm - hidden_nm)
        if self._watch.is_searching:  # the rotor's energy goes into the object
            stiffness = math.sqrt(motor.inertia_kg_m2 * STIFFEST_NM_RAD)
            high_nm += self._watch.limits.search_rad_s * stiffness
        if self._watch.is_searching or self._settings.by == "gains":
            low_nm = 0.0
        return max(low_nm, 0.0) * nm_to_n, high_nm * nm_to_n

    def loss_detected_from_n(self, opening_mm: float) -> float | None:
        """Return the smallest set force with which the loss of an object this wide is noticed.

        With less, friction may keep the jaws where they are when the object vanishes. None for a
        stiff hold (`by` "gains"): it hardly moves then, whatever the force.
        """
        if self._settings.by == "gains":
            return None
        friction_nm = self._settings.friction_nm
        if friction_nm is None:
            friction_nm = round(LARGE * self._motor_type.coulomb_nm, 3)
        needed_nm = NOTICED_SHARE * friction_nm + NOTICED_NM
        if opening_mm < STICK_RAD * self.geometry.rad_to_mm:
            needed_nm = max(needed_nm, STICK_NM)
        return needed_nm * self.geometry.nm_to_n

    def take_moved_mm(self) -> float | None:
        """Return how far the object has given way, once for each time that it did."""
        moved_rad, self._watch.moved_rad = self._watch.moved_rad, None
        return None if moved_rad is None else moved_rad * self.geometry.rad_to_mm

    def squeeze(self, force_n: float) -> None:
        """Change to another force; an unwatched grip closes further for it."""
        if force_n != self.force_n:
            self._aim(force_n)
        self._stays = False

    def again(self, settings: GripSettings, force_n: float) -> "Grip":
        """Return the grip that continues this one with other settings, without a gap."""
        if settings.friction_nm is None:
            settings = replace(settings, friction_nm=self._settings.friction_nm)
        grip = Grip(settings, force_n, self._applied_nm, self._motor_type, watched=True)
        grip.is_doubtful = self.is_doubtful
        grip._watch.continue_from(self._watch)
        grip._return_nm = max(self._return_nm, self._applied_nm)
        return grip

    def meets(self) -> None:
        """Take note that the jaws have closed onto the object: they press with less than they make.

        Once the torque is past the set force by the friction, in the direction in which the force
        on the object must change, it is the set force that the object feels.
        """
        wanted_nm = self.geometry.torque_nm(self.force_n)
        if self._settings.by != "torque" or wanted_nm >= self._applied_nm:
            return
        friction_nm = self._settings.likely_friction_nm(self._motor_type)
        beyond_nm = MEETS_SHARE * friction_nm
        if friction_nm < HIDES_SHARE * wanted_nm:
            return
        if self._applied_nm - friction_nm > wanted_nm:
            self._below_nm = max(wanted_nm - beyond_nm, 0.0)
        else:
            self._above_nm, self._below_nm = wanted_nm + beyond_nm, None
            self._lowered_nm = 0.0

    def stay(self) -> None:
        """Hold the present object; jaws that are closing, or begin to, have met nothing."""
        if not self.watched and not self._stays:
            self._stays = self._decides_next = True

    def freeze(self) -> None:
        """Keep the force from rising: the torque in flight is held.

        The torque from before a search counts as in flight, and comes back.
        """
        had_nm = max(self._return_nm, self._applied_nm)
        self.force_n = min(self.force_n, had_nm * self.geometry.nm_to_n)

    def resume(self) -> None:
        """Continue from the present state after a silence; the motor kept its last command."""
        self._ramped_at_s = None
        self._slice_rad = None
        self._watch.resume()
        self._closes_on.reset()

    def command(self, now_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        elapsed_s = 0.0 if self._ramped_at_s is None else max(now_s - self._ramped_at_s, 0.0)
        self._ramped_at_s = now_s
        self._judge(feedback)
        self._ramp(elapsed_s)
        settings, position_rad = self._settings, feedback.position_rad
        torque_nm = self._sign * self._applied_nm
        if settings.by == "gains":  # as the vendor's SDK: stiff around a position read at intervals
            if self._slice_rad is None or now_s - self._slice_began_s >= settings.interval_s:
                self._slice_began_s, self._slice_rad = now_s, position_rad
            kp, kd = settings.kp_nm_rad, settings.kd_nm_s_rad
            return MitCommand(self._slice_rad, 0.0, kp, kd, torque_nm)
        if self._watch.is_searching:
            _, damping, _ = settings.search(self.force_n, self._motor_type)
            return MitCommand(position_rad, 0.0, 0.0, damping, torque_nm)
        # The damping lets the speed of a yielding object pass. It comes from positions over two
        # periods or more: a noisy speed, or a vibration at half the control rate, would grow if it
        # were sent back to the motor.
        limit_rad_s = FREE_SPEED_SHARE * settings.grasp_speed_rad_s
        closing_rad_s = self._watch.speed_rad_s or 0.0
        expected_rad_s = self._sign * min(max(closing_rad_s, -limit_rad_s), limit_rad_s)
        damping = settings.damping(self._applied_nm)
        return MitCommand(position_rad, expected_rad_s, 0.0, damping, torque_nm)

    def _judge(self, feedback: Feedback) -> None:
        was_searching = self._watch.is_searching
        wanted_nm = self.geometry.torque_nm(self.force_n)
        is_full = math.isclose(self._applied_nm, wanted_nm)
        effective_nm = self._effective_nm
        is_new = self._watch.see(feedback, self._sign, effective_nm, is_full=is_full)
        has_followed = self._lowered_nm > 0.0 and is_full and self._watch.stands
        if self._eased.step(has_followed, feedback.at_s):
            self._watch.ease_contact(self._lowered_nm / SOFTEST_NM_RAD)
            self._lowered_nm = 0.0
        if self._watch.is_searching and not was_searching:
            self._return_nm = self._applied_nm
        closing_rad_s = self._watch.speed_rad_s
        if is_new and self._stays and closing_rad_s is not None:
            closes_on = closing_rad_s > STILL_RAD_S and self._watch.takes_nothing
            has_lasted = self._closes_on.step(closes_on, feedback.at_s)
            if has_lasted or (closes_on and self._decides_next):
                self._has_moved_on = True
            self._decides_next = False

    def _aim(self, force_n: float) -> None:
        """Take another force; a lowered one goes below its value once, by the friction."""
        self.force_n = force_n
        if self._watch.state == "held":
            self._return_nm = self._applied_nm
        wanted_nm = self.geometry.torque_nm(force_n)
        lowers = self._settings.by == "torque" and wanted_nm < self._applied_nm
        friction_nm = self._settings.likely_friction_nm(self._motor_type)
        below_nm = max(wanted_nm - friction_nm, 0.0)
        self._lowered_nm = max(self._applied_nm - wanted_nm, 0.0) if lowers else 0.0
        self._below_s = 0.0
        self._below_nm = below_nm if lowers else None
        self._above_nm = None
        self._watch.limits = self._settings.watch_limits(force_n, self._motor_type)

    def _ramp(self, elapsed_s: float) -> None:
        """Move the torque towards the one that is wanted now."""
        wanted_nm = self.geometry.torque_nm(self.force_n)
        rate_nm_s = self._settings.rate_nm_s
        if self._watch.is_searching and self._settings.by == "torque":
            search_nm, _, _ = self._settings.search(self.force_n, self._motor_type)
            self._applied_nm = min(self._applied_nm, search_nm)  # at once: the jaws run
            wanted_nm, self._above_nm = search_nm, None
        elif self._below_nm is not None:
            wanted_nm = self._below_nm
        elif self._above_nm is not None:
            wanted_nm = self._above_nm
        elif self._applied_nm < min(self._return_nm, wanted_nm):
            wanted_nm, rate_nm_s = min(self._return_nm, wanted_nm), max(rate_nm_s, RETURN_NM_S)
        step_nm = rate_nm_s * elapsed_s
        self._applied_nm += min(max(wanted_nm - self._applied_nm, -step_nm), step_nm)
        if self._above_nm is not None and self._applied_nm >= self._above_nm:
            self._above_nm = None
        if self._below_nm is not None and self._applied_nm <= self._below_nm:
            self._below_s += elapsed_s
            if self._watch.stands or self._below_s >= BELOW_WITHIN_S:
                self._below_nm, self._return_nm = None, self._applied_nm


STANDING_RAD_S = 0.05
"""Jaws that press on something are slower than this, 4 mm/s."""
PRESSING_SHARE = 0.5
FAINT_NM = 0.1
"""The part of a way to a target that friction leaves does not count."""


RUNNING_RAD_S = 0.33
"""Slower jaws, and the noise of a standing motor's speed, need no catching."""
CATCH_LAG_S = 0.0025
"""How long the motor's current and its filter of the speed take together (estimates). Jaws that
are stopped at 150 mm/s go on by 2.0, 1.3 and 0.8 mm then, at 100, 200 and 1000 Hz."""


@dataclass(frozen=True, slots=True)
class Hold:
    """Holds a position, with its whole stiffness against a push that does not last.

    What displaces the jaws for longer than a push is an object: an elastic one that a motion has
    pressed, or a finger that somebody has put between the jaws. Nobody has asked for a force on it,
    and a position alone cannot tell the two apart. So whatever left this hold, and whoever pushes,
    the torque is lowered to `press_nm` after a while (`Easing`). The position stays,
    so that the jaws neither let go of what they hold nor stay where a hand has left them.
    """

    position_rad: float
    gains: Gains
    press_nm: float | None = None
    """The torque that may last: the caller's, or None for that of a press (`stop_nm`)."""

    @classmethod
    def here(
        cls, feedback: Feedback, gains: Gains, period_s: float, motor_type: MotorType
    ) -> "Hold":
        """Return the hold of jaws where they are, or where running ones come to a stop.

        Running jaws are beyond their last measurement already. A stiff hold where they were would
        throw them back: at 150 mm/s, and faster than they came.
        """
        position_rad, velocity_rad_s = feedback.position_rad, feedback.velocity_rad_s
        if abs(velocity_rad_s) < RUNNING_RAD_S:
            return cls(position_rad, gains)
        calm = gains.catching()
        stops_s = 2.0 * period_s + CATCH_LAG_S  # a stop comes a period after its measurement
        stops_s += motor_type.inertia_kg_m2 / CALM_KD_NM_S_RAD
        return cls(position_rad + velocity_rad_s * stops_s, calm)

    def command(self, _now_s: float, _feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return self.gains.at(self.position_rad)

    def asked_nm(self, position_rad: float) -> float:
        """Return the torque that it asks for where the jaws are, without damping."""
        return self.gains.kp_nm_rad * (self.position_rad - position_rad)

    def within(self, most_nm: float, position_rad: float) -> "Hold":
        """Return the hold that asks for at most `most_nm` where the jaws are."""
        if abs(self.asked_nm(position_rad)) <= most_nm:
            return self
        lead_rad = most_nm / self.gains.kp_nm_rad
        return replace(self, position_rad=clamp_lead(self.position_rad, position_rad, lead_rad))

    def presses(self, feedback: Feedback) -> bool:
        """Return True if standing jaws are where this hold leaves them: its torque acts already.

        A command that leads jaws which have not arrived would move them further.
        """
        asked_nm = self.asked_nm(feedback.position_rad)
        sign = 1.0 if asked_nm > 0.0 else -1.0
        stands = abs(feedback.velocity_rad_s) <= STANDING_RAD_S
        return stands and sign * feedback.torque_nm >= PRESSING_SHARE * abs(asked_nm) - FAINT_NM

    def eased(self, position_rad: float, geometry: Geometry) -> "Hold":
        """Return the hold for jaws that are at `position_rad` now.

        After a hand has pressed the jaws beyond a calibrated stop, the hold comes back as far as
        the stop springs back: the motor must not keep pressing there for ever. The hold never leads
        the jaws.
        """
        low_rad, high_rad = sorted((geometry.closed_rad, geometry.open_rad))
        low_rad, high_rad = min(low_rad, position_rad), max(high_rad, position_rad)
        if low_rad <= self.position_rad <= high_rad:
            return self
        return replace(self, position_rad=min(max(self.position_rad, low_rad), high_rad))


@dataclass(frozen=True, slots=True)
class Slack:
    """Lets the jaws be moved by hand: no stiffness, no damping, no torque."""

    def command(self, _now_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        return MitCommand(feedback.position_rad, 0.0, 0.0, 0.0, 0.0)


Idle: TypeAlias = Hold | Slack | Grip
