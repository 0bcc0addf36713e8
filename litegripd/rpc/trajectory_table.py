"""The rows of the methods on trajectories: recorded, replayed, kept, sent and fetched."""

from dataclasses import replace

from litegripd.model.grips import MAX_GRIP_BYTES
from litegripd.model.results import ReplayResult
from litegripd.model.trajectory import MAX_BYTES, MAX_NAME, MAX_SAMPLES
from litegripd.rpc.answers import (
    PUT,
    RECORDED,
    CaptureStatus,
    Deleted,
    NoTrajectory,
    Piece,
    ReplayStatus,
    TrajectoryList,
)
from litegripd.rpc.method import DETACH, JOB, LEASE, RUN_PARAMS, Method
from litegripd.rpc.schema import Param

MAX_PIECE_BYTES = 8192
_MAX_BASE64 = 10_924
SPEEDS = (0.1, 4.0)
DEFAULT_RATE_HZ = 100.0
DEFAULT_TORQUE_NM = 2.0

_NAME = Param(
    "name",
    "string",
    f"The name that the daemon keeps it under: 1 to {MAX_NAME} characters, no / or \\, no dot at"
    " the beginning.",
)
_UPLOAD = Param("upload", "integer", "The number of an upload of this connection.", minimum=1)
_RECORDING = Param("recording", "integer", "The number of the latest recording.", minimum=1)
_SPEED = Param(
    "speed",
    "number",
    "A multiple of the speed that was taught (default 1).",
    minimum=SPEEDS[0],
    maximum=SPEEDS[1],
)
_OFFSET = Param("offset", "integer", "Where the piece begins.", minimum=0, maximum=2**31)

_RECORD = Method(
    "trajectory.record_start",
    "Record the jaws' motion in the background: taught by hand, the jaws being slack, or watched"
    " while others drive.",
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
            "Make the jaws slack (true, the default), as a job that ends with its client; it needs"
            " the lease. With false it only watches.",
        ),
        Param(
            "max_samples",
            "integer",
            f"End when so many were due (default {MAX_SAMPLES}).",
            minimum=1,
            maximum=MAX_SAMPLES,
        ),
        DETACH,
        LEASE,
    ),
    role="operator",
    stop_voids=True,
)
_PLAY = Method(
    "trajectory.play",
    "Replay a trajectory: go to its start, then along its path, then hold. It commands positions;"
    " the torques that were recorded are not repeated, but with force replay the taught grips are.",
    "ok, outcome, loops, frames, largest_lag_mm, final_command_rad, grips (that held something),"
    " width_mm (of the latest, else null), width_difference_mm (the largest to the taught width),"
    " and the state.",
    ReplayResult,
    (
        _NAME,
        _UPLOAD,
        _RECORDING,
        _SPEED,
        Param("kp", "number", "Stiffness (default: the calibration's).", minimum=5, maximum=500),
        Param(
            "kd",
            "number",
            "Damping, at least kp · 0.002 s (default: the calibration's).",
            minimum=0.1,
            maximum=5,
        ),
        Param(
            "torque_nm",
            "number",
            f"How hard to press at most on whatever is in the way (default {DEFAULT_TORQUE_NM:g}).",
            minimum=0.3,
            maximum=3,
        ),
        Param("loop", "boolean", "Repeat it until it is cancelled (default false)."),
        Param("repeat", "integer", "So many passes (default 1).", minimum=1, maximum=1_000_000),
        Param(
            "align",
            "boolean",
            "Go to its start first, at speed_mm_s of the configuration (default true). With false"
            " the jaws must be there already, within max_lead_mm.",
        ),
        Param(
            "force",
            "string",
            "path (the default): positions only. replay: do each grip that is kept with it as a"
            " grasp, with its force, as long as it was held; grasp_speed_mm_s and force_rate_n_s"
            " are the configuration's.",
            choices=("path", "replay"),
        ),
        *RUN_PARAMS,
    ),
    role="operator",
    needs_lease=True,
    stop_voids=True,
    waits=True,
)

TRAJECTORIES: tuple[Method, ...] = (
    _RECORD,
    Method(
        "trajectory.record_stop",
        "End the recording and keep it: under a name, or as the latest recording. One that cannot"
        " be kept stays until the next one begins, and may be ended again.",
        "recording (its number; null with a name), name, path, samples, duration_s, max_rate_s,"
        " total (bytes), sha256, missed (samples that were due but not measured), grips (how many"
        " are kept with it), grips_left_out (those beyond 200), and what the file's header says.",
        RECORDED,
        (
            _NAME,
            Param("allow_empty", "boolean", "One without samples is fine, too (default false)."),
            Param(
                "allow_partial",
                "boolean",
                "One that was broken off is fine, too, as far as it goes (default false).",
            ),
        ),
        role="operator",
        waits=True,
    ),
    _PLAY,
    Method(
        "trajectory.control",
        "Pause the replay that runs, let it go on, or change its speed; in force with the next"
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
    ),
    Method(
        "trajectory.status",
        "Tell of the recording or replay that runs, else of the latest one.",
        "active, kind (record, play or null), samples, error; of a recording also rate_hz,"
        " zero_gravity, loop_hz, missed, duration_s; of a replay frames, speed, openness,"
        " completed, loops, phase, grips. And job.",
        NoTrajectory | CaptureStatus | ReplayStatus,
    ),
    Method(
        "trajectory.list",
        "List the trajectories that the daemon keeps, by name, and how much of the room is used.",
        "trajectories: of each name, bytes, samples, sample_hz, created_s (unix time), mount,"
        " duration_s (from the first to the last sample; null for times that cannot be), grips"
        " (how many are kept with it), grip_problem (why its grips cannot be used, else null), and"
        " error, which says why it cannot be used, if so, and uid, the user who saved it last (null"
        " where that is not known, and it counts for nobody); more: whether others follow; usage:"
        " the asking user's uid, named (how many), bytes (with their grips), most_named and"
        " most_bytes, which the daemon's configuration allows each user.",
        TrajectoryList,
        (replace(_NAME, name="after", description="Only those after this name."),),
        waits=True,
    ),
    Method(
        "trajectory.get",
        "Fetch a piece of a trajectory.",
        "data (base64), offset, total (bytes) and sha256 of the whole.",
        Piece,
        (
            _NAME,
            _UPLOAD,
            _RECORDING,
            replace(_OFFSET, description="Where the piece begins (default 0)."),
            Param(
                "length",
                "integer",
                f"Bytes at most (default {MAX_PIECE_BYTES}).",
                minimum=1,
                maximum=MAX_PIECE_BYTES,
            ),
            Param(
                "format",
                "string",
                "The file itself (lgt, the default), its samples as CSV, or the file of its grips"
                " (grip), which is empty where there are none.",
                choices=("lgt", "csv", "grip"),
            ),
        ),
        waits=True,
    ),
    Method(
        "trajectory.put",
        "Send a piece of a trajectory, in order. With the last one it is checked as a whole, and"
        " kept: under a name, in place of any before, or until this connection ends, to be played"
        " from there. What is wrong leaves nothing behind. A name for which the user has no room is"
        " refused with the first piece.",
        "received (bytes) and complete; with the last piece also upload (its number; null with a"
        " name), name, path, samples, duration_s, max_rate_s, grips, and what its header says.",
        PUT,
        (
            _NAME,
            replace(_OFFSET, required=True),
            Param(
                "total",
                "integer",
                "The size of the whole.",
                required=True,
                minimum=1,
                maximum=MAX_BYTES + MAX_GRIP_BYTES,
            ),
            Param(
                "grip_bytes",
                "integer",
                "So many bytes at the end of the whole are the file of its grips (default 0).",
                minimum=0,
                maximum=MAX_GRIP_BYTES,
            ),
            Param("sha256", "string", "Of the whole, as hexadecimal digits.", required=True),
            Param(
                "data",
                "string",
                f"The piece, base64, at most {MAX_PIECE_BYTES} bytes.",
                required=True,
                longest=_MAX_BASE64,
            ),
        ),
        role="operator",
        waits=True,
    ),
    Method(
        "trajectory.delete",
        "Remove a trajectory that the daemon keeps, or an upload of this connection.",
        "deleted.",
        Deleted,
        (_NAME, _UPLOAD),
        role="operator",
        waits=True,
    ),
)
