"""Holding something by force, and watching that it is still there.

The force is a torque, not a stiffness: around an old position reading, kp = 150 turned 20 N into
5 N when the object yielded at 3 mm/s. But a torque alone lets the jaws shoot shut when the object
vanishes, so the motor damps what is faster than half the grasp speed: the damping is told to
expect the measured velocity, as far as that is slow, and so costs a yielding object no force.
"""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegripd.model.geometry import FORCE_PER_TORQUE_N_NM, Geometry
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import Feedback, MitCommand

HoldBy: TypeAlias = Literal["torque", "gains"]

HARDEST_DAMPING_NM_S_RAD = 5.0  # what a command frame can carry
SOFTEST_DAMPING_NM_S_RAD = 0.5
FREE_SPEED_SHARE = 0.5
"""Up to this share of the grasp speed the jaws follow a yielding object undamped; vanishing
objects let them go at most this much and the grasp speed together."""

LOST_SPEED_SHARE = 0.55
"""A little above `FREE_SPEED_SHARE`: with 3 N, of which friction takes half, jaws that have lost
their object get no faster than about 0.7 of the grasp speed."""
LOST_TORQUE_SHARE = 0.4
LOST_TORQUE_NM = 0.4
"""Closing freely takes 0.15 to 0.3 N·m of friction, whatever the force. With a larger share a soft
object would seem lost when jaws that stuck in the close-side dead band break away into it."""
LOST_TICKS = 3
"""So many measurements must agree that there is nothing: one alone may be disturbed."""
STANDING_RAD_S = 0.05
"""Jaws that press on something are slower than this, 4 mm/s."""


@dataclass(frozen=True, slots=True)
class GripSettings:
    """What a grip is made of; speeds and positions count in the motor's radians."""

    geometry: Geometry
    grasp_speed_rad_s: float
    rate_nm_s: float
    lost_at_rad: float
    """Closed this far, counted from the open side, there is nothing between the jaws."""
    by: HoldBy
    interval_s: float
    kp_nm_rad: float
    kd_nm_s_rad: float

    @classmethod
    def of(
        cls, geometry: Geometry, config: MotionConfig, speed_mm_s: float, by: HoldBy
    ) -> "GripSettings":
        """Take the settings from a configuration."""
        return cls(
            geometry=geometry,
            grasp_speed_rad_s=geometry.to_rad(speed_mm_s),
            rate_nm_s=config.force_rate_n_s / FORCE_PER_TORQUE_N_NM,
            lost_at_rad=geometry.close_sign * geometry.closed_rad - config.stop_tol,
            by=by,
            interval_s=config.hold_interval,
            kp_nm_rad=config.hold_kp,
            kd_nm_s_rad=config.hold_kd,
        )


class Grip:
    """A hold by `force_n`, ramped from the torque in flight; `is_lost` once it holds nothing.

    A grip that is not `watched` squeezes from wherever the jaws are, and may drive them there: it
    holds nothing until they have met something. Once it is to `stay`, it ends as they close on.
    """

    def __init__(
        self, settings: GripSettings, force_n: float, in_flight_nm: float, *, watched: bool
    ) -> None:
        self.force_n = force_n
        self.watched = watched
        self.is_lost = False
        self._settings = settings
        self._sign = settings.geometry.close_sign
        self._applied_nm = max(in_flight_nm, 0.0)
        self._ramped_at_s: float | None = None
        self._lost_ticks = 0
        self._watched_s = 0.0
        self._stays = False
        self._slice_began_s = 0.0
        self._slice_rad: float | None = None

    @property
    def applied_n(self) -> float:
        """The force that is commanded now, on its way to `force_n`."""
        return self._applied_nm * FORCE_PER_TORQUE_N_NM

    @property
    def is_holding(self) -> bool:
        """Whether there is something between the jaws."""
        return self.watched and not self.is_lost

    def squeeze(self, force_n: float) -> None:
        """Go over to another force, closing on for it where nothing is watched."""
        self.force_n = force_n
        self._stays = False

    def stay(self) -> None:
        """Hold what is held; jaws that are still closing, or begin to, have met nothing."""
        if not self.watched and not self._stays:
            self._stays, self._lost_ticks = True, LOST_TICKS - 1  # the next measurement decides

    def freeze(self) -> None:
        """Let the force rise no further: what is in flight is what is held."""
        self.force_n = min(self.force_n, self.applied_n)

    def resume(self) -> None:
        """Go on after a silence, in which the motor kept its last command: from what is now."""
        self._ramped_at_s = None
        self._slice_rad = None
        self._lost_ticks = 0

    def command(self, now_s: float, feedback: Feedback) -> MitCommand:
        """Return the command of this tick."""
        self._ramp(now_s)
        if self.is_holding:
            self._watch(feedback)
        elif self._stays:
            self._note(self._is_free(feedback, STANDING_RAD_S), feedback)
        if self._settings.by == "gains":
            return self._around_reading(now_s, feedback)
        limit_rad_s = FREE_SPEED_SHARE * self._settings.grasp_speed_rad_s
        expected_rad_s = min(max(feedback.velocity_rad_s, -limit_rad_s), limit_rad_s)
        damping = self._applied_nm / self._settings.grasp_speed_rad_s
        damping = min(max(damping, SOFTEST_DAMPING_NM_S_RAD), HARDEST_DAMPING_NM_S_RAD)
        torque_nm = self._sign * self._applied_nm
        return MitCommand(feedback.position_rad, expected_rad_s, 0.0, damping, torque_nm)

    def _around_reading(self, now_s: float, feedback: Feedback) -> MitCommand:
        """Hold as the vendor's SDK does: stiff around a position that is read now and then."""
        settings = self._settings
        if self._slice_rad is None or now_s - self._slice_began_s >= settings.interval_s:
            self._slice_began_s, self._slice_rad = now_s, feedback.position_rad
        torque_nm = self._sign * self._applied_nm
        return MitCommand(self._slice_rad, 0.0, settings.kp_nm_rad, settings.kd_nm_s_rad, torque_nm)

    def _ramp(self, now_s: float) -> None:
        elapsed_s = 0.0 if self._ramped_at_s is None else max(now_s - self._ramped_at_s, 0.0)
        self._ramped_at_s = now_s
        step_nm = self._settings.rate_nm_s * elapsed_s
        wanted_nm = self.force_n / FORCE_PER_TORQUE_N_NM
        self._applied_nm += min(max(wanted_nm - self._applied_nm, -step_nm), step_nm)

    def _watch(self, feedback: Feedback) -> None:
        """Notice that the jaws close on nothing: fast without resistance, or all the way.

        An object that gives way while the force rises may be as fast, but it resists.
        """
        settings = self._settings
        free = self._is_free(feedback, LOST_SPEED_SHARE * settings.grasp_speed_rad_s)
        closed = self._sign * feedback.position_rad >= settings.lost_at_rad
        self._note(free or closed, feedback)

    def _is_free(self, feedback: Feedback, fast_rad_s: float) -> bool:
        """Tell whether the jaws close faster than that, and nothing takes the torque."""
        least_nm = max(LOST_TORQUE_SHARE * self._applied_nm, LOST_TORQUE_NM)
        fast = self._sign * feedback.velocity_rad_s > fast_rad_s
        return fast and self._sign * feedback.torque_nm < least_nm

    def _note(self, is_closing_on: bool, feedback: Feedback) -> None:
        """Count the measurements in a row, each once, that show jaws which hold nothing."""
        if feedback.at_s == self._watched_s:
            return
        self._watched_s = feedback.at_s
        self._lost_ticks = self._lost_ticks + 1 if is_closing_on else 0
        self.is_lost = self._lost_ticks >= LOST_TICKS
