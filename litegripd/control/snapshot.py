"""The state that every client sees: its fields, and how they follow from controller and motor."""

from dataclasses import dataclass
from typing import Literal, TypeAlias

from litegrip_client.values.fields import STALE_AFTER_S
from litegripd.control.controller import Controller
from litegripd.control.holds import Slack
from litegripd.model.calibration import ScaleDoubt
from litegripd.model.gripper import Mount
from litegripd.model.motor import BusState, MotorPhase, MotorView, Status, status_name
from litegripd.model.state import Job

Mode: TypeAlias = Literal[
    "offline", "disabled", "enabling", "holding", "moving", "relaxed", "disabling", "fault"
]


@dataclass(frozen=True, slots=True)
class JobSummary:
    """The running job, in brief; the client of its owner as `program` and `pid`."""

    job: int
    kind: str
    phase: str | None
    program: str
    pid: int


@dataclass(frozen=True, slots=True)
class StopSummary:
    """The latched stop, in brief; `by` names the program, None for the daemon itself.

    `repeats` counts the stops since then that did not raise the level; they make no events.
    """

    level: str
    by: str | None
    since_s: float
    why: str | None
    repeats: int


@dataclass(frozen=True, slots=True)
class GripperState:
    """All that is known in the tick `seq`; None for what is unknown.

    Times are of CLOCK_MONOTONIC, which all processes of a machine share. `feedback_s` is when the
    motor was asked for the measurement, `age_s` its age at `monotonic_s`; `stale` marks a
    measurement that is older than it should be, or of a motor that does not answer. `enabled` is
    None while nothing is known, and while the last report of a motor that is silent, or is being
    enabled or disabled, was that it is enabled. `requested_rad` and `requested_torque_nm` are what
    the running motion or hold wanted in this tick, `command_rad` and `command_torque_nm` what the
    motor got, and `limited` names the limits that make the difference; it has "speed", too, while a
    stream's speed holds a set-point back. `force_set_n` is the set
    force of a hold by force, None without one and when the motor is off; `is_grasped` is true if
    such a hold has something between the jaws, and None where that is not known: it had when the
    motor fell silent, which may have let go, or the motor has been too weak to tell. While it is
    true, `clamp_n` is the interval of the force on the
    object: friction hides the exact value, and the motor's constant may be off by a tenth. Its
    lower end is 0 while the jaws follow an object that gave way, and lower with a motor that makes
    less than is commanded. What pushes the jaws besides the motor is not in it. `loss_detection` is
    true if the loss of the object would be noticed, and `loss_detection_from_n` is the smallest set
    force with which it would. `pressing_n` is the force by the motor's torque while the jaws press,
    in whatever mode: they stand, and the motor makes more torque than friction explains, or they
    hold by force; None while they do not. Friction may take a part of it, or in jaws that stick
    all. `work_stroke_mm` is the opening to which `motion.open` goes, None for the open stop.
    `scale_doubt` says why the calibration's millimetres are probably wrong: "superseded" for the
    scale of an earlier version, "unusual" for one that no gripper was seen to have.
    """

    seq: int
    monotonic_s: float
    feedback_s: float | None
    age_s: float | None
    stale: bool
    bus: BusState
    motor: str
    error_code: int | None
    status: str | None
    enabled: bool | None
    mode: Mode
    position_rad: float | None
    velocity_rad_s: float | None
    torque_nm: float | None
    force_n: float | None
    opening_mm: float | None
    openness: float | None
    driver_temperature_c: int | None
    coil_temperature_c: int | None
    command_rad: float | None
    command_torque_nm: float | None
    requested_rad: float | None
    requested_torque_nm: float | None
    limited: tuple[str, ...]
    force_set_n: float | None
    is_grasped: bool | None
    clamp_n: tuple[float, float] | None
    loss_detection: bool | None
    loss_detection_from_n: float | None
    pressing_n: float | None
    calibrated: bool
    mount: Mount | None
    work_stroke_mm: float | None
    scale_doubt: ScaleDoubt | None
    job: JobSummary | None
    stop: StopSummary | None
    stop_generation: int


STALE_AFTER_PERIODS = 4.0

_MODES: dict[MotorPhase, Mode] = {
    MotorPhase.UNKNOWN: "offline",
    MotorPhase.SILENT: "offline",
    MotorPhase.DISABLED: "disabled",
    MotorPhase.ENABLING: "enabling",
    MotorPhase.DISABLING: "disabling",
    MotorPhase.FAULT: "fault",
}


def snapshot(controller: Controller, now_s: float, period_s: float) -> GripperState:
    """Return the state at `now_s`; unknown values are None, and old ones are marked stale."""
    motor, bus = controller.motor, controller.bus
    geometry = controller.geometry
    enabled = motor.phase is MotorPhase.ENABLED
    out_of_reach = motor.phase in (MotorPhase.SILENT, MotorPhase.UNKNOWN)
    feedback = motor.feedback or (motor.last_known if out_of_reach else None)
    age_s = None if feedback is None else now_s - feedback.at_s
    stale_after_s = STALE_AFTER_PERIODS * period_s if enabled else STALE_AFTER_S
    command, requested = controller.output.command, controller.output.requested
    grip = controller.grip
    held = grip if grip is not None and grip.is_holding and enabled else None
    may_hold = grip is not None and grip.is_holding and motor.phase is MotorPhase.SILENT
    detected_from_n: float | None = None
    if held is not None and feedback is not None:
        detected_from_n = held.loss_detected_from_n(held.geometry.opening_mm(feedback.position_rad))
    keeps_force = motor.phase in (MotorPhase.ENABLED, MotorPhase.SILENT)
    force_n: float | None = None
    opening_mm: float | None = None
    openness: float | None = None
    if geometry is not None and feedback is not None:
        force_n = geometry.force_n(feedback.torque_nm)
        opening_mm = geometry.opening_mm(feedback.position_rad)
        openness = geometry.openness(feedback.position_rad)
    moved_in, pressing_nm = geometry or controller.in_force.geometry, controller.pressing.torque_nm
    return GripperState(
        seq=controller.ticks,
        monotonic_s=now_s,
        feedback_s=None if feedback is None else feedback.at_s,
        age_s=age_s,
        stale=age_s is None or age_s > stale_after_s or not bus.is_usable or out_of_reach,
        bus=bus.state,
        motor=motor.phase.value,
        error_code=None if feedback is None else feedback.status,
        status=None if feedback is None else status_name(feedback.status),
        enabled=_enabled(motor),
        mode=mode_of(
            motor.phase, controller.jobs.running is not None, isinstance(controller.idle, Slack)
        ),
        position_rad=None if feedback is None else feedback.position_rad,
        velocity_rad_s=None if feedback is None else feedback.velocity_rad_s,
        torque_nm=None if feedback is None else feedback.torque_nm,
        force_n=force_n,
        opening_mm=opening_mm,
        openness=openness,
        driver_temperature_c=None if feedback is None else feedback.driver_temperature_c,
        coil_temperature_c=None if feedback is None else feedback.coil_temperature_c,
        command_rad=None if command is None else command.position_rad,
        command_torque_nm=None if command is None else command.torque_nm,
        requested_rad=None if requested is None else requested.position_rad,
        requested_torque_nm=None if requested is None else requested.torque_nm,
        limited=controller.output.limited,
        force_set_n=None if grip is None or not keeps_force else grip.force_n,
        is_grasped=(
            None if may_hold or (held is not None and held.is_doubtful) else held is not None
        ),
        clamp_n=None if held is None else held.clamp_n,
        loss_detection=(
            None
            if held is None
            else detected_from_n is not None and held.force_n >= detected_from_n
        ),
        loss_detection_from_n=detected_from_n,
        pressing_n=(
            None if moved_in is None or pressing_nm is None else abs(moved_in.force_n(pressing_nm))
        ),
        calibrated=geometry is not None,
        mount=None if geometry is None else geometry.mount,
        work_stroke_mm=controller.calibrated.work_opening_mm,
        scale_doubt=controller.calibrated.scale_doubt(controller.gripper_id.stroke_mm),
        job=_job(controller, controller.jobs.running),
        stop=_stop(controller),
        stop_generation=controller.stop_latch.generation,
    )


def _enabled(motor: MotorView) -> bool | None:
    """Return True if the motor is enabled, False if it is not, None while that is unknown."""
    if motor.phase is MotorPhase.ENABLED:
        return True
    if motor.phase in (MotorPhase.DISABLED, MotorPhase.FAULT):
        return False
    feedback = motor.feedback
    return None if feedback is None or feedback.status == Status.ENABLED else False


def mode_of(phase: MotorPhase, has_job: bool, is_slack: bool) -> Mode:
    """Return the gripper's mode, from the motor's phase, the job, and the idle jaws."""
    if phase is not MotorPhase.ENABLED:
        return _MODES[phase]
    if has_job:
        return "moving"
    return "relaxed" if is_slack else "holding"


def _job(controller: Controller, job: Job | None) -> JobSummary | None:
    if job is None:
        return None
    progress = controller.progress()
    phase = None if progress is None else progress.phase
    return JobSummary(job.number, job.kind, phase, job.owner.program, job.owner.pid)


def _stop(controller: Controller) -> StopSummary | None:
    stop = controller.stop_latch.latched
    if stop is None:
        return None
    by = None if stop.by is None else stop.by.program
    return StopSummary(stop.level, by, stop.since_s, stop.why, controller.stop_latch.repeats)
