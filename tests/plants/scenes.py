"""Scenes with one random plant each: what was true, against what the daemon reported.

A scene returns a `Seen`; what is wrong in it is said in words, so that a list of them explains
itself. `play(scene, seed)` plays it again.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from litegripd.model.motor import MotorPhase
from tests.plants.parameters import LIMITS_RAD, MM_RAD
from tests.plants.trials import Trial, random_trial
from tests.plants.watch import ADRIFT_S, adrift_s, is_dropped, is_shaking
from tests.plants.world import Look, PlantWorld
from tests.world import Client

VERDICT_WITHIN_S = 0.2
TOLD_WITHIN_S = 0.2
SURE_N = 10.0
"""From this force on, and twice what it takes to move the jaws, a loss can be told in any case."""
SURE_STEP_MM = 1.0
STRONG_N, BRISK_MM_S = 9.0, 45.0
"""Below either, an object that gives way by more may be told as lost."""
AFTER_S = 1.2
"""So long after what has happened the jaws are back, or the object is lost."""
WINDOW_S = 0.45
KEPT_SHARE = 0.5
CRUSHED = 1.5
ZERO_MM = 3.0
EASY_NM = 0.75
"""The probe's 1 N·m moves jaws that stick with no more than this, a torque constant of 0.8 and a
reserve included."""


@dataclass(slots=True)
class Seen:
    """What a scene has shown; None where it shows nothing of the kind.

    `told_s` is when a loss was told, after it was one; `untold` one that neither was told nor said
    to be beyond what can be. `stuck` is an object whose clamp friction keeps the jaws from
    restoring. Speeds, torques and clamps are the true ones; `rotor_mm_s` is the motor's speed as
    one of the jaws, without what cable and backlash let them do alone. `errors_mm` are those of the
    saved closed and open limit, positive where the jaws were not as far as that. The clamps are
    that of the hold before anything happened, and the least, most and last one since.
    """

    scene: str
    trial: Trial
    outcome: str | None = None
    wrong: list[str] = field(default_factory=list)
    dropped: bool = False
    called_lost: bool = False
    stuck: bool = False
    shaking: bool = False
    untold: bool = False
    broken: str | None = None
    verdict_s: float | None = None
    told_s: float | None = None
    adrift_s: float | None = None
    peak_mm_s: float | None = None
    rotor_mm_s: float | None = None
    peak_nm: float | None = None
    before_n: float | None = None
    least_n: float | None = None
    most_n: float | None = None
    after_n: float | None = None
    errors_mm: tuple[float, float] | None = None

    @property
    def is_right(self) -> bool:
        """True when nothing is to be complained of."""
        return not self.complaints

    @property
    def complaints(self) -> list[str]:
        """All that is wrong, in words."""
        found = list(self.wrong)
        if self.broken is not None:
            found.append(f"broken: {self.broken}")
        if self.dropped:
            found.append(f"dropped, though it is there: adrift for {self.adrift_s or 0.0:.3f} s")
        if self.called_lost:
            found.append("called lost, though it is there")
        if self.shaking:
            found.append("shaking")
        if self.untold:
            found.append("its loss was not told")
        return found


class Scene:
    """A daemon on the trial's plant, and what has been seen so far."""

    def __init__(self, name: str, trial: Trial) -> None:
        self.trial = trial
        self.seen = Seen(name, trial)
        self.world = PlantWorld(
            trial.plant,
            trial.mount,
            trial.rate_hz,
            opening_mm=trial.opening_mm,
            config=trial.config,
        )
        self.client: Client = self.world.enabled()
        self.watcher: Client = self.world.client()
        self.watcher.result("events.subscribe")
        self.world.mechanics.put(trial.item)

    def grasp(self) -> dict[str, Any]:
        """Grasp to the verdict; return the whole answer."""
        trial = self.trial
        return self.client.call(
            "motion.grasp", force_n=trial.force_n, speed_mm_s=trial.speed_mm_s, until="verdict"
        )

    def held(self) -> bool:
        """Grasp and let the force be ramped; return whether the object is held, as is reported."""
        began_s = self.world.now_s
        answer = self.grasp()
        self.judge_verdict(answer, began_s)
        self.world.run(self.trial.ramp_s + WINDOW_S)
        looks = self.world.looks_since(self.world.now_s - WINDOW_S)
        self.seen.shaking |= is_shaking(looks)
        self.seen.before_n = looks[-1].clamp_n
        if self.trial.item is None or self.seen.outcome != "object_held":
            return False
        self.judge_hold(self.world.now_s - WINDOW_S)
        return not self.seen.called_lost

    def judge_verdict(self, answer: dict[str, Any], began_s: float) -> None:
        """Compare the verdict of a grasp with what the object has felt."""
        seen, looks = self.seen, self.world.looks_since(began_s)
        seen.outcome = outcome = answer["result"]["outcome"]
        seen.peak_nm = max(abs(look.torque_nm) for look in looks)
        seen.peak_mm_s = max(look.jaw_mm_s for look in looks)
        seen.rotor_mm_s = max(look.rotor_mm_s for look in looks)
        touched = [look.at_s for look in looks if look.clamp_n > 0.0]
        if touched:
            seen.verdict_s = self.world.now_s - touched[0]
        expected = "no_object" if self.trial.item is None else "object_held"
        if outcome != expected:
            seen.wrong.append(f"{outcome} where {expected} is true")
        elif seen.verdict_s is not None and seen.verdict_s > VERDICT_WITHIN_S:
            seen.wrong.append(f"the verdict came only {seen.verdict_s:.3f} s after the contact")
        if outcome == "object_held" and looks[-1].clamp_n <= 0.0:
            seen.wrong.append("object_held in front of the object")

    def judge_hold(self, since_s: float) -> list[Look]:
        """Look whether what is there was kept since then, and is said to be."""
        world, trial, seen = self.world, self.trial, self.seen
        looks = world.looks_since(since_s)
        asked_n, can_follow = trial.true_force_n, trial.can_follow
        seen.adrift_s = adrift_s(looks, asked_n)
        seen.dropped |= is_dropped(looks, asked_n, can_follow=can_follow)
        seen.stuck |= seen.adrift_s > ADRIFT_S and not seen.dropped
        seen.least_n = min(look.clamp_n for look in looks)
        seen.most_n = max(look.clamp_n for look in looks)
        seen.after_n = looks[-1].clamp_n
        seen.called_lost |= self.lost_s() is not None or not self.state()["is_grasped"]
        self.judge_motor()
        return looks

    def judge_motor(self) -> None:
        """Nothing here is a reason to switch off."""
        if not self.world.in_phase(MotorPhase.ENABLED):
            self.seen.wrong.append(f"the motor is {self.world.phase.name}")

    def note_peaks(self, since_s: float) -> None:
        """Keep the largest closing speeds and torque since then."""
        looks = self.world.looks_since(since_s)
        self.seen.peak_mm_s = max(look.jaw_mm_s for look in looks)
        self.seen.rotor_mm_s = max(look.rotor_mm_s for look in looks)
        self.seen.peak_nm = max(abs(look.torque_nm) for look in looks)

    def disturbed(self, gone_s: float) -> Seen:
        """Let time pass after a disturbance that ends at `gone_s`; judge what is held then."""
        began_s = self.world.now_s
        self.world.run(gone_s - began_s + AFTER_S)
        looks = self.judge_hold(gone_s)
        self.note_peaks(gone_s)
        self.seen.shaking |= is_shaking(looks[-round(WINDOW_S * 1000) :])
        return self.seen

    def state(self) -> dict[str, Any]:
        """Return the state that clients see."""
        state = self.client.result("state.get")
        inner: dict[str, Any] = state.get("state", state)
        return inner

    def lost_s(self) -> float | None:
        """Return when the object was called lost, None if it was not."""
        lost = self.watcher.events("object_lost")
        return lost[0]["monotonic_s"] if lost else None


def grasp(trial: Trial) -> Seen:
    """Grasp an object, or nothing, and hold it."""
    scene = Scene("grasp", trial)
    scene.held()
    scene.judge_motor()
    return scene.seen


def bump(trial: Trial) -> Seen:
    """Push the jaws while they hold something, or open them a little by hand."""
    scene = Scene("bump", trial)
    if not scene.held():
        return scene.seen
    if trial.push_nm:
        scene.world.push_open(trial.push_nm, trial.hand_s)
    else:
        scene.world.hold_open(trial.open_mm, trial.hand_s)
    return scene.disturbed(scene.world.now_s + trial.hand_s)


def step(trial: Trial) -> Seen:
    """Let the object give way at once; a weak or slow grip follows it by `SURE_STEP_MM`."""
    scene = Scene("step", trial)
    if not scene.held():
        return scene.seen
    scene.world.mechanics.give_way(trial.step_mm)
    seen = scene.disturbed(scene.world.now_s)
    is_weak = trial.force_n < STRONG_N or trial.speed_mm_s < BRISK_MM_S
    if trial.step_mm > SURE_STEP_MM and is_weak:
        seen.called_lost = seen.dropped = False  # a loss is told within 50 ms: no time to go on
    return seen


def loss(trial: Trial) -> Seen:
    """Take the object away; its loss is told soon, or the state says that it cannot be."""
    scene = Scene("loss", trial)
    if not scene.held():
        return scene.seen
    seen, began_s, plant = scene.seen, scene.world.now_s, trial.plant
    detects = scene.state().get("loss_detection", True) is not False
    if not detects and trial.force_n >= SURE_N and trial.true_force_n > 20.0 * plant.breakaway_nm:
        seen.wrong.append("its loss was said to be beyond what can be told")
    scene.world.mechanics.put(None)
    scene.world.run(AFTER_S)
    scene.note_peaks(began_s)
    told_s = scene.lost_s()
    if told_s is not None:
        seen.told_s = told_s - began_s
    seen.untold = detects and told_s is None
    if detects and seen.told_s is not None and seen.told_s > TOLD_WITHIN_S:
        seen.wrong.append(f"its loss was told only after {seen.told_s:.3f} s")
    seen.shaking |= is_shaking(scene.world.looks_since(scene.world.now_s - WINDOW_S))
    scene.judge_motor()
    return seen


def regrasp(trial: Trial) -> Seen:
    """Grasp once more what is held: its clamp never halves."""
    scene = Scene("regrasp", trial)
    if not scene.held():
        return scene.seen
    seen, began_s, before_n = scene.seen, scene.world.now_s, scene.seen.before_n or 0.0
    answer = scene.grasp()
    if "result" in answer and answer["result"]["outcome"] != "object_held":
        seen.wrong.append(f"{answer['result']['outcome']} where object_held is true")
    scene.world.run(trial.ramp_s + WINDOW_S)
    looks = scene.judge_hold(began_s)
    seen.shaking |= is_shaking(looks[-round(WINDOW_S * 1000) :])
    least_n = min(look.clamp_n for look in looks)
    if least_n < KEPT_SHARE * before_n:
        seen.wrong.append(f"the clamp fell from {before_n:.1f} to {least_n:.1f} N")
    return seen


def close(trial: Trial) -> Seen:
    """Close on what is held: refused or held on, neither crushed nor dropped."""
    scene = Scene("close", trial)
    if not scene.held():
        return scene.seen
    seen, began_s, before_n = scene.seen, scene.world.now_s, scene.seen.before_n or 0.0
    scene.client.call("motion.close")
    scene.world.run(AFTER_S)
    looks = scene.judge_hold(began_s)
    most_n, least_n = max(k.clamp_n for k in looks), min(k.clamp_n for k in looks)
    if most_n > CRUSHED * max(before_n, trial.true_force_n):
        seen.wrong.append(f"crushed with {most_n:.1f} N, {before_n:.1f} N before")
    if least_n < KEPT_SHARE * before_n:
        seen.wrong.append(f"the clamp fell from {before_n:.1f} to {least_n:.1f} N")
    return seen


def zero(trial: Trial) -> Seen:
    """Calibrate: what is saved as a success is where the jaws are when they are pressed."""
    scene = Scene("zero", trial)
    seen, began_s = scene.seen, scene.world.now_s
    result = scene.client.call("calibration.zero", within_s=60.0)["result"]
    seen.outcome = result["outcome"]
    scene.note_peaks(began_s)
    if result["ok"]:
        true_rad, sign = LIMITS_RAD[trial.mount], scene.world.plant.sign
        closed_mm = sign * (true_rad[0] - result["closed_rad"]) * MM_RAD
        open_mm = sign * (result["open_rad"] - true_rad[1]) * MM_RAD
        seen.errors_mm = (closed_mm, open_mm)
        if max(abs(closed_mm), abs(open_mm)) > ZERO_MM:
            seen.wrong.append(f"saved {closed_mm:+.1f} mm closed, {open_mm:+.1f} mm open")
    elif max(trial.plant.stick_nm, trial.plant.breakaway_nm) < EASY_NM:
        seen.wrong.append(f"{seen.outcome} where it could be measured")
    scene.judge_motor()
    return seen


SCENES: Mapping[str, Callable[[Trial], Seen]] = {
    "grasp": grasp,
    "bump": bump,
    "step": step,
    "loss": loss,
    "regrasp": regrasp,
    "close": close,
    "zero": zero,
}


def play(scene: str, seed: int) -> Seen:
    """Play a scene with the plant, the object and the request of a seed."""
    trial = random_trial(seed, scene)
    try:
        return SCENES[scene](trial)
    except (AssertionError, KeyError) as error:  # the daemon refused, or never answered
        return Seen(scene, trial, broken=f"{type(error).__name__} {error}"[:200])
