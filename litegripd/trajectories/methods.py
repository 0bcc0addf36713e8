"""The methods that record and replay trajectories."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, TypedDict

from litegrip_client.values.trajectory_format import MAX_SAMPLES, Header
from litegripd.control.controller import Controller
from litegripd.control.limiter import DEFAULT_GAINS
from litegripd.model.errors import Refusal
from litegripd.model.sentence import TermViews, sentence, terms_of
from litegripd.model.state import ReplayResult
from litegripd.rpc.method import (
    CALIBRATION,
    DETACH,
    JOB,
    LEASE,
    MOTION_PARAMS,
    Answer,
    Call,
    Deferred,
    Method,
    Param,
    Shape,
    accepted,
    later,
    usual_gain_params,
)
from litegripd.rpc.sessions import Session
from litegripd.trajectories.capture import Capture
from litegripd.trajectories.file_methods import (
    NAME,
    WHICH,
    TrajectoryFileMethods,
    Whole,
    check_name,
    of_older,
)
from litegripd.trajectories.replay import AT_START_MM, ReplayRequest
from litegripd.trajectories.requests import Trajectories
from litegripd.trajectories.values import Summary


class _Unkept(TypedDict):
    """A recording that has ended, and is lost when the next one begins."""

    samples: int
    duration_s: float
    error: str | None


class Unkept(_Unkept, total=False):
    """Such a recording; `terms` are those of `error`."""

    terms: TermViews


class NoTrajectory(TypedDict):
    """Nothing was recorded or played so far."""

    active: Literal[False]
    kind: None
    job: None
    samples: int
    error: None
    unkept: None


class CaptureStatus(TypedDict):
    """The state of a recording, or how the last one ended."""

    active: bool
    kind: Literal["record"]
    job: int | None
    samples: int
    error: str | None
    rate_hz: float
    zero_gravity: bool
    loop_hz: float | None
    missed: int
    duration_s: float
    max_samples: int
    unkept: Unkept | None


class ReplayStatus(TypedDict):
    """The state of a replay, or how the last one ended."""

    active: bool
    kind: Literal["play"]
    job: int
    samples: int
    error: str | None
    frames: int
    speed: float
    openness: float | None
    completed: bool
    loops: int
    grips: int
    phase: str
    unkept: Unkept | None


class _Recorded(TypedDict):
    """The members that only a recording has."""

    recording: int | None
    missed: int
    error: str | None
    grips_left_out: int


RECORDED = Shape("TrajectoryRecorded", (_Recorded, Whole, Header, Summary))


SPEEDS = (0.1, 4.0)
DEFAULT_RATE_HZ = 100.0
DEFAULT_TORQUE_NM = 2.0
_SPEED = Param(
    "speed",
    "number",
    "A multiple of the speed that was taught (default 1).",
    minimum=SPEEDS[0],
    maximum=SPEEDS[1],
)


class TrajectoryMethods:
    """Methods on recordings and replays."""

    NOT_CARRIED = ("_controller", "_files", "_trajectories")

    def __init__(self, controller: Controller, files: TrajectoryFileMethods) -> None:
        self._controller = controller
        self._trajectories = Trajectories(controller, files.temporaries)
        self._files = files

    def session_ended(self, session: Session) -> None:
        """End a connection's temporary trajectories, and a recording that it only watched."""
        self._trajectories.client_lost(session.identity)
        self._files.temporaries.session_ended(session)

    @Method(
        "trajectory.record_start",
        "Record the jaws' motion in the background: taught by hand, the jaws being slack, or"
        " watched while others drive.",
        "As trajectory.status, and the job that makes the jaws slack (null where others drive).",
        CaptureStatus,
        (
            Param(
                "rate_hz",
                "number",
                f"Samples a second (default {DEFAULT_RATE_HZ:g}), at most the control rate.",
                minimum=1,
                maximum=1000,
            ),
            Param(
                "zero_gravity",
                "boolean",
                "Make the jaws slack (true, the default), as a job that ends with its client; it"
                " needs the lease. With false it only watches.",
            ),
            Param(
                "max_samples",
                "integer",
                f"End when so many were due (default {MAX_SAMPLES}).",
                minimum=1,
                maximum=MAX_SAMPLES,
            ),
            CALIBRATION,
            DETACH,
            LEASE,
        ),
        role="operator",
        stop_voids=True,
    )
    def _record(self, call: Call) -> Answer:
        params, slack = call.params, call.params.get("zero_gravity", True)
        refusal = self._controller.lease.refusal(call.owner) if slack else None
        answer = refusal or self._trajectories.record(
            call.owner,
            call.terms(self._controller),
            rate_hz=params.get("rate_hz", DEFAULT_RATE_HZ),
            slack=slack,
            max_samples=params.get("max_samples", MAX_SAMPLES),
            detached=call.detached,
        )
        accepted(answer)
        return self._status()

    @Method(
        "trajectory.record_stop",
        "End the recording and keep it: under a name; without one until this connection or the next"
        " recording ends, with a temporary name, which the answer says. One that cannot be kept"
        " stays until the next one begins, and may be ended again.",
        "name, recording (the number in a temporary one, else null), path, samples, duration_s,"
        " max_rate_s, total (bytes), sha256, missed (samples that were due but not measured), grips"
        " (how many are kept with it), grips_left_out (those beyond 200), and what the file's"
        " header says.",
        RECORDED,
        (
            NAME,
            Param("allow_empty", "boolean", "One without samples is fine, too (default false)."),
            Param(
                "allow_partial",
                "boolean",
                "One that was broken off is fine, too, as far as it goes (default false).",
            ),
        ),
        role="operator",
        waits=True,
    )
    def _stop_recording(self, call: Call) -> Answer:
        name, capture = call.params.get("name"), self._trajectories.capture
        deferred = Deferred()

        def kept(answer: Mapping[str, Any] | Refusal) -> None:
            missed = 0 if capture is None else capture.missed
            partial = None if capture is None else capture.error
            left_out = 0 if capture is None else capture.notes.left_out
            own = {"missed": missed, "error": partial, "grips_left_out": left_out}
            deferred.resolve(answer if isinstance(answer, Refusal) else {**answer, **own})

        check_name(name)
        refusal = self._trajectories.stop_recording(
            name,
            call.owner,
            kept,
            allow_empty=call.params.get("allow_empty", False),
            allow_partial=call.params.get("allow_partial", False),
        )
        return refusal or deferred

    @Method(
        "trajectory.play",
        "Replay a trajectory: go to its start, then along its path, then hold. It commands"
        " positions; the torques that were recorded are not repeated, but with force replay the"
        " taught grips are.",
        "ok, outcome, loops, frames, largest_lag_mm, final_command_rad, grips (that held"
        " something), width_mm (of the latest, else null), width_difference_mm (the largest to the"
        " taught width), and the state.",
        ReplayResult,
        (
            WHICH,
            _SPEED,
            *usual_gain_params(),
            Param(
                "torque_nm",
                "number",
                "How hard to press at most on whatever is in the way (default"
                f" {DEFAULT_TORQUE_NM:g}).",
                minimum=0.3,
                maximum=3,
                maximum_of=lambda motor: motor.rated_nm,
            ),
            Param("loop", "boolean", "Repeat it until it is cancelled (default false)."),
            Param("repeat", "integer", "So many passes (default 1).", minimum=1, maximum=1_000_000),
            Param(
                "align",
                "boolean",
                "Go to its start first, at speed_mm_s of the configuration (default true). With"
                f" false the jaws must be there already, within {AT_START_MM:g} mm.",
            ),
            Param(
                "force",
                "string",
                "path (the default): positions only. replay: do each grip that is kept with it as"
                " a grasp, with its force, as long as it was held; grasp_speed_mm_s and"
                " force_rate_n_s are the configuration's.",
                choices=("path", "replay"),
            ),
            *MOTION_PARAMS,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
        of_older=of_older,
    )
    def _play(self, call: Call) -> Answer:
        params, terms = call.params, call.terms(self._controller)
        name = self._files.named(call)
        if "repeat" in params and params.get("loop"):
            text = sentence("{trajectory.play} takes {.loop} or {.repeat}, not both")
            return Refusal("invalid_params", text, {"parameter": "repeat"})
        request = ReplayRequest(
            name=name,
            speed=params.get("speed", 1.0),
            torque_nm=params.get("torque_nm", DEFAULT_TORQUE_NM),
            repeat=0 if params.get("loop") else params.get("repeat", 1),
            align=params.get("align", True),
            force=params.get("force", "path"),
        )
        return later(
            self._trajectories.play(
                request,
                call.owner,
                terms,
                call.gains(DEFAULT_GAINS),
                detached=call.detached,
                turn=call.turn,
            )
        )

    @Method(
        "trajectory.control",
        "Pause the replay that runs, let it continue, or change its speed; in force with the next"
        " tick. Cancel it with job.cancel.",
        "As trajectory.status.",
        ReplayStatus,
        (
            Param(
                "action",
                "string",
                "What to do.",
                required=True,
                choices=("pause", "resume", "speed"),
            ),
            replace(_SPEED, description="The new speed, for the action speed."),
            replace(JOB, required=False, description="Only if it is this job."),
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
    )
    def _control(self, call: Call) -> Answer:
        params, action = call.params, call.params["action"]
        replay = accepted(self._trajectories.playing(params.get("job"), call.owner))
        if ("speed" in params) != (action == "speed"):
            text = sentence(
                "{trajectory.control}: {.speed} goes with the action speed, and only with it"
            )
            return Refusal("invalid_params", text, {"parameter": "speed"})
        if action == "speed":
            refusal = replay.change_speed(params["speed"])
            if refusal is not None:
                return refusal
        else:
            replay.is_paused = action == "pause"
        return self._status()

    @Method(
        "trajectory.status",
        "Report the recording or replay that runs, else of the latest one.",
        "active, kind (record, play or null), samples, error; of a recording also rate_hz,"
        " zero_gravity, loop_hz, missed, duration_s; of a replay frames, speed, openness,"
        " completed, loops, phase, grips. And job. unkept: of a recording that has ended, broken"
        " off or not, and is not kept yet, so that the next one takes its place: samples,"
        " duration_s and error, which says why it was broken off, else null; null where there is"
        " none.",
        NoTrajectory | CaptureStatus | ReplayStatus,
    )
    def _get_status(self, _call: Call) -> NoTrajectory | CaptureStatus | ReplayStatus:
        return self._status()

    def _status(self) -> NoTrajectory | CaptureStatus | ReplayStatus:
        """Return the state of what runs, else of what ran last."""
        trajectories = self._trajectories
        capture, job = trajectories.capture, trajectories.replay_job
        if capture is not None and (job is None or capture.began_s >= job.started_s):
            return _capture_status(capture, self._unkept())
        return self._replay_status()

    def _unkept(self) -> Unkept | None:
        capture = self._trajectories.unkept
        if capture is None:
            return None
        unkept: Unkept = {
            "samples": capture.samples,
            "duration_s": capture.duration_s,
            "error": capture.error,
        }
        terms = terms_of(unkept)
        return {**unkept, "terms": terms} if terms else unkept

    def _replay_status(self) -> NoTrajectory | ReplayStatus:
        replay, job = self._trajectories.replay, self._trajectories.replay_job
        if replay is None or job is None:
            return {
                "active": False,
                "kind": None,
                "job": None,
                "samples": 0,
                "error": None,
                "unkept": None,
            }
        result = job.result
        completed = isinstance(result, ReplayResult) and result.ok
        return {
            "active": job.is_running,
            "kind": "play",
            "job": job.number,
            "samples": replay.samples,
            "error": None if job.error is None else job.error.message,
            "frames": replay.frames,
            "speed": replay.speed,
            "openness": replay.openness,
            "completed": completed,
            "loops": replay.loops,
            "grips": replay.grips.done,
            "phase": "paused" if replay.is_paused else replay.phase,
            "unkept": self._unkept(),
        }


def _capture_status(capture: Capture, unkept: Unkept | None) -> CaptureStatus:
    return {
        "active": not capture.is_over,
        "kind": "record",
        "job": None if capture.job is None else capture.job.number,
        "samples": capture.samples,
        "error": capture.error,
        "rate_hz": capture.rate_hz,
        "zero_gravity": capture.job is not None,
        "loop_hz": capture.loop_hz,
        "missed": capture.missed,
        "duration_s": capture.duration_s,
        "max_samples": capture.max_samples,
        "unkept": unkept,
    }
