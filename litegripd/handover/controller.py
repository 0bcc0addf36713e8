"""What a successor must know of the controller, so that the jaws notice nothing of a restart.

Carried are pose and force, stop and calibration, heat and limits, and the numbers that clients
know. Left is what belongs to connections, which end: waiting requests, queues. The lease lapses,
and who shows its token gets it again.
"""

from collections import OrderedDict, deque
from dataclasses import replace
from typing import Any

from litegripd.control.calibration import CalibrationInUse
from litegripd.control.controller import Controller
from litegripd.control.detectors import Lasting, SpeedWindow
from litegripd.control.gains import Gains
from litegripd.control.grip_watch import GripWatch, WatchLimits, WatchState
from litegripd.control.heat import HeatGuard, HeatModel, Readings
from litegripd.control.holds import Grip, GripSettings, Hold, Idle, Slack
from litegripd.control.jobs import JobBook
from litegripd.control.lease import Grant, Lease
from litegripd.control.limiter import CommandLimiter, Output
from litegripd.control.second_master import SecondMaster
from litegripd.control.stop import StopLatch
from litegripd.model.bus import BusCondition
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.jobs import Job, Stop
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import MitCommand, MotorPhase, MotorView, ZeroView
from litegripd.model.motor_types import MotorType
from litegripd.model.plain import TYPE_KEY, Carried, PlainError, plain_of, value_of

_OUTPUT = Carried(
    Output,
    requested=MitCommand | None,
    command=MitCommand | None,
    limited=tuple[str, ...],
    heat=Carried(
        HeatGuard,
        left=("limit_c", "least_nm", "_raised_lasts_s"),
        model=Carried(
            HeatModel,
            left=("motor_type",),
            coil_c=float | None,
            windows=int,
            _readings=Carried(
                Readings,
                believed_c=int | None,
                doubtful_c=int | None,
                _since_s=float,
                _ticks=int,
            ),
            _last_s=float | None,
            _square_nm2_s=float,
            _elapsed_s=float,
            _recent_w=deque[float],
            _winding_w=float,
            _housing_w=float,
            _base_c=float,
            _share=float,
            _variances=tuple[float, float, float],
        ),
        allowance_nm=float,
        _windows=int,
        _asked_nm=float,
        _changed_s=float,
        _was_raised=bool,
        _raise_every_s=float,
        _top_nm=float,
    ),
    _limiter=Carried(
        CommandLimiter,
        left=("_motor_type",),
        _impulse_nm_s=float,
        _rated_only=bool,
        _damping=float,
        _last_s=float | None,
        _last_nm=float,
    ),
)
_LEASE = Carried(
    Lease, left=("holder", "_waiting", "_expires_s", "_losses"), _last=int, _lapsed=Grant | None
)
_CONTROLLER = Carried(
    Controller,
    left=(
        "action",
        "capture",  # what could only be lost refuses: `why_not_restartable`
        "tasks",
        "events",
        "has_stepped",
        "register_reads",
        "motor",  # handed over by its own room; here only its phase goes along
        "must_disable",
        "period_s",
        "idle",
        "gripper_id",
        "_is_ending",
        "_owed",
        "_replaced",
        "_starting",
    ),
    jobs=Carried(
        JobBook, left=("running", "queue", "_ended", "_jobs"), _last=int
    ),  # the others: `export_jobs`
    lease=_LEASE,
    stop_latch=Carried(
        StopLatch,
        left=("on_stop", "_latest_client", "_latest_of_others_s"),  # connections do not go along
        latched=Stop | None,
        generation=int,
        repeats=int,
        stopped_by=tuple[int | None, ...],
        _latest_s=float,
    ),
    calibrated=Carried(
        CalibrationInUse,
        calibration=Calibration | None,
        file=str | None,
        gains=Gains,
        problem=Refusal,
        _zero=ZeroView,
    ),
    now_s=float,
    config=MotionConfig,
    config_is_kept=bool,
    ticks=int,
    output=_OUTPUT,
    bus=BusCondition,
    recordings=int,
    second_master=Carried(
        SecondMaster,
        # The configuration's; and the motor counts from zero.
        left=("is_tolerated", "count", "_write", "_known_write"),
        is_active=bool,
        _seen_s=float,
        _told_s=float,
    ),
)
_LASTING = Carried(Lasting, left=("_duration_s",), _since_s=float | None)
_GRIP = Carried(
    Grip,
    left=("_motor_type",),
    force_n=float,
    watched=bool,
    _settings=GripSettings,
    _sign=int,
    _applied_nm=float,
    _return_nm=float,
    _below_nm=float | None,
    _below_s=float,
    _lowered_nm=float,
    _eased=_LASTING,
    _sent_nm=float | None,
    _ramped_at_s=float | None,
    _watch=Carried(
        GripWatch,
        limits=WatchLimits,
        state=WatchState,
        is_lost=bool,
        takes_nothing=bool,
        moved_rad=float | None,
        contact_rad=float | None,
        _pressed_rad=float | None,
        speed_rad_s=float | None,
        _seen_s=float,
        _speed=Carried(SpeedWindow, left=("_window_s",), _samples=deque[tuple[float, float]]),
        _free=_LASTING,
        _far=_LASTING,
        _closed=_LASTING,
        _touching=_LASTING,
        _settled=_LASTING,
    ),
    _stays=bool,
    _decides_next=bool,
    _closes_on=_LASTING,
    _has_moved_on=bool,
    _slice_began_s=float,
    _slice_rad=float | None,
)
_JOBS = Carried(JobBook, left=("running", "queue", "_ended", "_last"), _jobs=OrderedDict[int, Job])


def export(controller: Controller) -> dict[str, Any]:
    """Return the controller's state; the caller has asked whether it is `why_not_restartable`."""
    plain = _CONTROLLER.memory(controller)
    if controller.lease.holder is not None:
        plain["lease"]["_lapsed"] = plain_of(controller.lease.holder)
    idle = controller.idle
    plain_idle = _GRIP.memory(idle) if isinstance(idle, Grip) else plain_of(idle)
    return {"controller": plain, "rest": plain_idle, "phase": plain_of(controller.motor.phase)}


def adopt(controller: Controller, motor: MotorView, plain: Any) -> None:
    """Go on where the predecessor was, with a motor that is handed over already.

    Raises `PlainError` for a state that cannot be used.
    """
    if not isinstance(plain, dict) or plain.keys() != {"controller", "rest", "phase"}:
        raise PlainError("the controller's state is not of this version")
    _CONTROLLER.restore(controller, plain["controller"])
    controller.idle = _idle_of(plain["rest"], controller.gripper_id.motor_type)
    # The phase of the predecessor's last tick: a change since then is still to be noticed.
    controller.motor = replace(motor, phase=value_of(plain["phase"], MotorPhase, "phase"))


def export_jobs(controller: Controller) -> dict[str, Any]:
    """Return the jobs that are kept. There may be many, so they are not part of `export`."""
    return _JOBS.memory(controller.jobs)


def adopt_jobs(controller: Controller, plain: Any) -> None:
    """Keep the predecessor's jobs. Raises `PlainError` for what cannot be used."""
    _JOBS.restore(controller.jobs, plain)


def _idle_of(plain: Any, motor_type: MotorType) -> Idle:
    if not isinstance(plain, dict) or plain.get(TYPE_KEY) != Grip.__name__:
        hold: Idle = value_of(plain, Hold | Slack, "rest")
        return hold
    settings = value_of(plain.get("_settings"), GripSettings, "Grip._settings")
    grip = Grip(settings, 0.0, 0.0, motor_type, watched=False)
    _GRIP.restore(grip, plain)
    return grip
