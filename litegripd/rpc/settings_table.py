"""The rows of the methods on what persists: calibration, configuration, registers."""

from dataclasses import replace

from litegripd.model.calibration import Saved
from litegripd.model.results import Restarted, SetZeroResult, ZeroResult
from litegripd.rpc.answers import (
    BY_HAND,
    CalibrationLoaded,
    CalibrationView,
    ConfigView,
    RegisterValue,
    Templates,
)
from litegripd.rpc.method import CONFIG, DETACH, RUN_PARAMS, WAIT, Method
from litegripd.rpc.schema import Param

_MOUNT = Param(
    "mount",
    "string",
    "Which way closing runs: increasing radians (normal) or decreasing ones (reverse). Default: as"
    " the calibration in use has it.",
    choices=("normal", "reverse"),
)
_SAVE = Param("save", "boolean", "Write it to the daemon's own file (default true).")

SETTINGS: tuple[Method, ...] = (
    Method("calibration.get", "Tell the calibration in use.", "The calibration.", CalibrationView),
    Method(
        "calibration.templates", "Tell the templates of the mounts.", "The templates.", Templates
    ),
    Method(
        "calibration.load",
        "Take another calibration: a template, a file's content, or what the daemon's own files"
        " have.",
        "loaded, factory, skipped (files that were passed over), and the calibration.",
        CalibrationLoaded,
        (
            replace(_MOUNT, name="template", description="The mount to declare."),
            Param("content", "object", "What a calibration file holds."),
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    Method(
        "calibration.save",
        "Write the calibration in use to the daemon's own file.",
        "The path, and that of the file before, which is kept.",
        Saved,
        role="operator",
        needs_lease=True,
        waits=True,
    ),
    Method(
        "calibration.zero",
        "Measure the travel by probing both stops, and take it. The jaws move to both stops.",
        "ok, outcome, the calibration, and the state.",
        ZeroResult,
        (_MOUNT, _SAVE, *RUN_PARAMS),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    Method(
        "calibration.manual",
        "Measure the travel by hand: begin (the jaws go slack), mark closed and open, finish.",
        "The job, the marks, or as calibration.zero.",
        BY_HAND,
        (
            Param(
                "step",
                "string",
                "What to do.",
                required=True,
                choices=("begin", "closed", "open", "finish", "cancel"),
            ),
            _SAVE,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    Method(
        "motor.read_register",
        "Read a register of the motor.",
        "Its number, name and value.",
        RegisterValue,
        (Param("register", "string", 'Its name or number: "PMAX", "21", "0x15".', required=True),),
        waits=True,
    ),
    Method(
        "motor.set_zero",
        "Take the present position as the motor's zero; disables the motor first. The calibration"
        " fits no longer then.",
        "ok, shift_rad, position_rad, and the state.",
        SetZeroResult,
        (WAIT, DETACH),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    ),
    Method(
        "config.get", "Tell the daemon's motion configuration.", "Fields and ranges.", ConfigView
    ),
    Method(
        "config.set",
        "Change the daemon's motion configuration, for everybody who does not say otherwise."
        " A speed_mm_s that does not go with stop_lead_mm is refused, as the motions would.",
        "As config.get.",
        ConfigView,
        (
            replace(CONFIG, required=True, description="The fields that change."),
            Param("keep", "boolean", "Also over a restart of the daemon (default false)."),
        ),
        role="admin",
        waits=True,
    ),
    Method(
        "daemon.restart",
        "Start a successor of the daemon, which reads the configuration anew and takes over; pose"
        " and force of the jaws are held all the while. Refused while a motion runs. Connections"
        " end after the answer; a lease may be resumed by its token.",
        "The pid of the successor, which has taken over, and gap_s, the time between the last"
        " command of the one and the first of the other.",
        Restarted,
        (
            Param(
                "hold_through_restart",
                "boolean",
                "Must be true: a restart that lets go is the service manager's to do.",
                required=True,
            ),
        ),
        role="admin",
        waits=True,
    ),
)
