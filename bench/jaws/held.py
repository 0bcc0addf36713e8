"""An object that the daemon holds in simulation, and what can happen to it.

Every scene begins in the same way: an object of `WIDTH_MM` is grasped, and the force is ramped to
what was asked for. The time is simulated; a scene costs a fraction of a second.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

from bench.jaws.hand import Hand
from bench.jaws.rig import DEFAULTS, Rig, ours
from litegripd.control.holds import HoldBy
from litegripd.control.motions.grasp import GraspRequest
from litegripd.sim.plant import MOUNTS, SimulatorParameters

WIDTH_MM = 50.0
NEAR_MM = 5.0
"""The grasp begins so far away from the object."""
RATES_HZ = (100, 200, 1000)
LOOK_S = 0.25e-3
SETTLE_S = 0.5
"""A rest after the force has been ramped from the approach's 10 N."""
WATCHED_S = 0.8
BACK_SHARE = 0.8
CONTACT_N = 10.0


@dataclass(frozen=True, slots=True)
class Setting:
    """How a gripper is mounted, and how often it is controlled."""

    mount: str
    rate_hz: int


SETTINGS = tuple(Setting(mount, rate_hz) for rate_hz in RATES_HZ for mount in MOUNTS)


@dataclass(frozen=True, slots=True)
class After:
    """What was true after something happened to the object; None for what did not happen.

    `is_short` is an object that is held in the end by less than `BACK_SHARE` of what it was.
    `back_s` is how long the true clamp took to be and stay above `BACK_SHARE` of what it was;
    `far_mm` how much further closed the jaws are in the end.
    """

    is_held: bool
    is_short: bool
    told_s: float | None
    times_told: int
    moved_mm: float | None
    back_s: float | None
    peak_mm_s: float
    far_mm: float


class HeldRig(Rig):
    """Holds an object by `force_n`; a `hand` may have the jaws."""

    def __init__(
        self,
        setting: Setting,
        force_n: float,
        *,
        speed_mm_s: float = DEFAULTS.grasp_speed_mm_s,
        by: HoldBy = "torque",
        parameters: SimulatorParameters | None = None,
    ) -> None:
        period_s = 1.0 / setting.rate_hz
        opening_mm = WIDTH_MM + NEAR_MM
        super().__init__(setting.mount, opening_mm, period_s=period_s, parameters=parameters)
        self.hand: Hand | None = None
        self._looked_s = self.now_s
        self.gripper.put_object(width_mm=WIDTH_MM)
        request = GraspRequest(force_n, speed_mm_s, until="verdict", hold_by=by)
        job = self.begin(ours(self.geometry, request, period_s=period_s))
        self.run_until(lambda: not job.is_running)
        self.run(abs(force_n - CONTACT_N) / DEFAULTS.force_rate_n_s + SETTLE_S)
        self.controller.take_events()

    @property
    def clamp_bounds_n(self) -> tuple[float, float] | None:
        """Between which forces the daemon says that the clamp lies."""
        return None if self.controller.grip is None else self.controller.grip.clamp_n

    @property
    def loss_detected_from_n(self) -> float | None:
        """From which force on the daemon says that it would notice the loss."""
        grip, feedback = self.controller.grip, self.controller.motor.feedback
        if grip is None or feedback is None:
            return 0.0
        return grip.loss_detected_from_n(self.geometry.opening_mm(feedback.position_rad))

    @property
    def clamp_n(self) -> float:
        """What the object truly feels."""
        return self.geometry.nm_to_n * self.gripper.clamp_nm

    def look(self, at_s: float) -> None:
        if self.hand is not None:
            self.hand.advance(self._looked_s, at_s)
        super().look(at_s)
        self._looked_s = at_s

    def torques_of_tick(self) -> list[float]:
        """Let one period pass; return the true torques (N·m) in it."""
        began_s, looks = self.now_s, max(round(self.period_s / LOOK_S), 1)
        torques_nm = []
        for look in range(1, looks):
            self.look(began_s + self.period_s * look / looks)
            torques_nm.append(self.squeeze_nm)
        self.tick()
        return [*torques_nm, self.squeeze_nm]

    def push_open(self, torque_nm: float, lasts_s: float) -> None:
        """Let a hand push the jaws open, and let go."""
        self.gripper.push(-self.geometry.close_sign * torque_nm)
        self.run(lasts_s)
        self.gripper.push(0.0)

    def hold_open(self, open_mm: float, lasts_s: float) -> None:
        """Let a hand open the jaws so far, and let go."""
        self.hand = Hand(self.gripper, open_mm, self.now_s, lasts_s)
        self.run(lasts_s)

    def watch(self, happen: Callable[["HeldRig"], None]) -> After:
        """Let something happen to the object, and look at what comes of it."""
        before_n, before_mm = self.clamp_n, self.gripper.opening_mm
        self.looks = max(round(self.period_s / LOOK_S), 1)
        began_s = self.now_s
        self.peak_mm_s = 0.0
        happen(self)
        happened_s = self.now_s
        told = list(self._events(began_s))
        low_s: float | None = None
        for _ in range(round(WATCHED_S / self.period_s)):
            self.tick()
            told += self._events(began_s)
            if self.clamp_n < BACK_SHARE * before_n:
                low_s = self.now_s
        lost = [at_s for kind, at_s, _ in told if kind == "object_lost"]
        moved = [mm for kind, _, mm in told if kind == "object_moved" and mm is not None]
        is_back = low_s is None or low_s < self.now_s
        return After(
            is_held=self.is_grasped,
            is_short=self.is_grasped and self.clamp_n < BACK_SHARE * before_n,
            told_s=lost[0] if lost else None,
            times_told=len(lost),
            moved_mm=moved[0] if moved else None,
            back_s=((low_s or happened_s) - happened_s) if is_back else None,
            peak_mm_s=self.peak_mm_s,
            far_mm=before_mm - self.gripper.opening_mm,
        )

    def _events(self, began_s: float) -> Iterator[tuple[str, float, float | None]]:
        for event in self.controller.take_events():
            moved_mm = event.data.get("moved_mm")
            way_mm = moved_mm if isinstance(moved_mm, float) else None
            yield event.kind, self.now_s - began_s, way_mm
