"""The methods on what persists: the calibration, the daemon's defaults, the motor's registers."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias, TypedDict

from litegripd.control.admission import position_refusal
from litegripd.control.calibration import content_of
from litegripd.control.controller import Controller
from litegripd.control.requests import CalibrationRequests
from litegripd.model.calibration import (
    CalibrationError,
    Saved,
    from_plain,
    read_content,
    scale_warning,
)
from litegripd.model.errors import Refusal
from litegripd.model.gripper import STROKE_RANGE_MM, Mount
from litegripd.model.motion_config import ranges_of
from litegripd.model.motor import RegisterReply, Status
from litegripd.model.sentence import sentence
from litegripd.model.state import HelperTask, Owner, SetZeroResult, TaskResult, ZeroResult
from litegripd.motor.codec import IN_USE, MASTER_ID, REGISTERS, Register
from litegripd.motor.phases import SILENT
from litegripd.rpc.method import (
    AT_ONCE,
    CONFIG,
    DETACH,
    RUN_PARAMS,
    WAIT,
    Answer,
    Call,
    Deferred,
    Method,
    Param,
    Refused,
    Shape,
    accepted,
    later,
)
from litegripd.rpc.reports import JobNumber, MotionFields

Authority: TypeAlias = Callable[[], "Refusal | None"]
"""Returns why what was asked for may not take effect any more, or None."""


class CalibrationView(TypedDict):
    """The calibration in use; `content` is that of its file, empty where there is none.

    `warnings` say why it is probably wrong, and what corrects that: its scale, marks of another
    gripper, a work stroke beyond the travel, a position at which no jaw can be. `scale_warning` is
    the one on its millimetres, None without one. `problem` is why none is in use.
    """

    calibrated: bool
    mount: Mount | None
    closed_rad: float | None
    open_rad: float | None
    travel_rad: float | None
    travel_mm: float | None
    rad_to_mm: float | None
    work_stroke_mm: float | None
    kp: float
    kd: float
    file: str | None
    scale_warning: str | None
    warnings: list[str]
    problem: str | None
    content: Mapping[str, object]


class CalibrationLoaded(CalibrationView):
    """The calibration in use now, and what was found."""

    loaded: bool
    factory: bool
    skipped: list[str]


class Template(TypedDict):
    """One template, and what its file holds."""

    name: str
    content: Mapping[str, object]


class Templates(TypedDict):
    """The templates of the mounts."""

    templates: list[Template]


class Marks(TypedDict):
    """What has been marked so far of a calibration by hand."""

    closed_rad: float | None
    open_rad: float | None


class Nothing(TypedDict):
    """An answer without members: it is done."""


BY_HAND = (
    AT_ONCE,
    Shape("Marks", (Marks,), closed=True),
    Shape("Nothing", (Nothing,), closed=True),
    ZeroResult,
)
"""The answers to the steps of a calibration by hand."""


class RegisterValue(TypedDict):
    """What a register holds; null for what is no number."""

    number: int
    name: str
    value: float | None


class FrameInterval(TypedDict):
    """The daemon's period, which the SDK has among the fields of its configuration."""

    frame_interval: float


SOUGHT_IDS = range(0x01, 0x11)
"""The maker's tool offers more; a gripper whose id was changed has a small one."""


class FoundMotor(TypedDict):
    """A motor that has answered: the id of its commands, and the one on which it answers."""

    can_id: int
    master_id: int


class Scanned(TypedDict):
    """The ids that were asked, and the motors that have answered."""

    asked: list[int]
    found: list[FoundMotor]


class ConfigView(TypedDict):
    """The motion configuration; `kept` is true if it outlives the daemon."""

    config: MotionFields
    ranges: Mapping[str, list[float]]
    kept: bool


_MOUNT = Param(
    "mount",
    "string",
    "Which way closing runs: increasing radians (normal) or decreasing ones (reverse). Default: as"
    " the calibration in use has it.",
    choices=("normal", "reverse"),
)
_SAVE = Param("save", "boolean", "Write it to the daemon's own file (default true).")
_STROKE = Param(
    "stroke_mm",
    "number",
    "How far the jaws open, as a caliper measures it (default: stroke_mm of the configuration).",
    minimum=STROKE_RANGE_MM[0],
    maximum=STROKE_RANGE_MM[1],
)


class SettingsMethods:
    """Methods on calibration, motion configuration and registers."""

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._calibrations = CalibrationRequests(controller)
        self._is_saving_config = False

    @Method(
        "calibration.get", "Return the calibration in use.", "The calibration.", CalibrationView
    )
    def _get_calibration(self, _call: Call) -> CalibrationView:
        return self._calibration()

    def _calibration(self) -> CalibrationView:
        controller, in_use = self._controller, self._controller.calibrated
        calibration = in_use.calibration
        geometry = None if calibration is None else calibration.geometry
        return {
            "calibrated": in_use.geometry is not None,
            "mount": None if geometry is None else geometry.mount,
            "closed_rad": None if geometry is None else geometry.closed_rad,
            "open_rad": None if geometry is None else geometry.open_rad,
            "travel_rad": None if geometry is None else geometry.travel_rad,
            "travel_mm": None if geometry is None else geometry.travel_mm,
            "rad_to_mm": None if geometry is None else geometry.rad_to_mm,
            "work_stroke_mm": in_use.work_opening_mm,
            "kp": in_use.gains.kp_nm_rad,
            "kd": in_use.gains.kd_nm_s_rad,
            "file": in_use.file,
            "scale_warning": None
            if calibration is None
            else scale_warning(calibration, controller.gripper_id.stroke_mm),
            "warnings": self._warnings(),
            "problem": in_use.problem.message if in_use.geometry is None else None,
            "content": {}
            if calibration is None
            else content_of(calibration, controller.gripper_id, in_use.gains, controller.motor),
        }

    def _warnings(self) -> list[str]:
        """Return what is doubtful about the calibration in use, for who loads it."""
        controller = self._controller
        in_use, geometry, motor = controller.calibrated, controller.geometry, controller.motor
        found = in_use.doubts(controller.gripper_id, motor.identity) + in_use.work_stroke_doubts()
        if geometry is not None and motor.feedback is not None:
            misplaced = position_refusal(motor, geometry)
            found += [] if misplaced is None else [misplaced.message]
        return found

    @Method(
        "calibration.templates", "Return the templates of the mounts.", "The templates.", Templates
    )
    def _templates(self, call: Call) -> Answer:
        return self._task(call, "calibration.templates", {}, lambda value: {"templates": value})

    @Method(
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
    )
    def _load(self, call: Call) -> Answer:
        params = call.params
        if "template" in params and "content" in params:
            text = sentence("{calibration.load} takes a {.template} or a {.content}, not both")
            return Refusal("invalid_params", text, {"parameter": "content"})
        refusal = self._calibrations.refusal_to_load()
        if refusal is not None:
            return refusal
        if "content" not in params:
            gripper_id, template = self._controller.gripper_id, params.get("template")
            wanted = {
                "channel": gripper_id.channel,
                "mount": template or gripper_id.mount,
                "configured": template is None,
            }
            authority = self._authority(call)
            return self._task(
                call,
                "calibration.load",
                wanted,
                lambda value: self._adopt_found(
                    value, authority, call.owner, is_template=template is not None
                ),
            )
        try:
            calibration = read_content(params["content"])
        except CalibrationError as error:
            return Refusal("calibration_unreadable", f"the content cannot be used: {error}")
        refusal = self._calibrations.load(calibration, None, call.owner)
        return refusal or self._loaded(loaded=True, factory=False, skipped=[])

    def _loaded(self, *, loaded: bool, factory: bool, skipped: list[str]) -> CalibrationLoaded:
        found = self._calibration()
        return {**found, "loaded": loaded, "factory": factory, "skipped": skipped}

    def _authority(self, call: Call) -> Authority:
        """Return what to ask when a request takes effect that had to wait for the helper.

        A stop that has come since voids it, and so do the end of who asked and any change of the
        lease: who held it must hold the same one, who needed none may need one now.
        """
        controller = self._controller
        latch, holder = controller.stop_latch, controller.lease.holder
        generation = latch.generation
        owner = call.owner if holder is None else replace(call.owner, grant=holder.number)

        def refusal() -> Refusal | None:
            if controller.ending is not None:
                return controller.ending
            if call.session.is_orphaned:
                return Refusal("client_lost", "who asked for it has gone")
            stopped = latch.refusal_of_sent(generation, None, call.received_s, owner.client)
            return stopped or controller.lease.refusal(owner)

        return refusal

    def _adopt_found(
        self, value: Any, authority: Authority, owner: Owner, *, is_template: bool
    ) -> CalibrationLoaded | Refusal:
        """Use what the helper found, unless a motion has begun or the authority has changed.

        A template says nothing of the fingers: a measured force per torque stays.
        """
        refusal = authority()
        if refusal is not None:
            return refusal
        skipped = list(value["skipped"])
        if value["calibration"] is None:
            return self._loaded(loaded=False, factory=False, skipped=skipped)
        calibration, before = from_plain(value["calibration"]), self._controller.calibrated
        if is_template and before.calibration is not None:
            calibration = calibration.with_force_of(before.calibration)
        refusal = self._calibrations.load(calibration, value["path"], owner)
        return refusal or self._loaded(loaded=True, factory=value["factory"], skipped=skipped)

    @Method(
        "calibration.rescale",
        "Correct the millimetres of the calibration in use: rad_to_mm becomes that of jaws that"
        " open stroke_mm. The limits stay, nothing moves, and calibration.save writes it.",
        "The calibration.",
        CalibrationView,
        (_STROKE,),
        role="operator",
        needs_lease=True,
        stop_voids=True,
    )
    def _rescale(self, call: Call) -> Answer:
        refusal = self._calibrations.rescale(call.params.get("stroke_mm"), call.owner)
        return refusal or self._calibration()

    @Method(
        "calibration.save",
        "Write the calibration in use to the daemon's own file.",
        "The path, and that of the file before, which is kept.",
        Saved,
        role="operator",
        needs_lease=True,
        waits=True,
    )
    def _save(self, call: Call) -> Answer:
        deferred = Deferred()

        def saved(result: TaskResult) -> None:
            deferred.resolve(_outcome("calibration.save", result))

        return self._calibrations.save(saved, call.owner.uid) or deferred

    @Method(
        "calibration.zero",
        "Measure the travel by probing both stops, and take it. The jaws move to both stops.",
        "ok, outcome, the calibration, and the state.",
        ZeroResult,
        (_MOUNT, _STROKE, _SAVE, *RUN_PARAMS),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _zero(self, call: Call) -> Answer:
        controller = self._controller
        config = call.config(controller)
        return later(
            self._calibrations.zero(
                call.owner,
                config,
                mount=call.params.get("mount"),
                stroke_mm=call.params.get("stroke_mm"),
                keep=call.params.get("save", True),
                detached=call.detached,
                turn=call.turn,
            )
        )

    @Method(
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
            _STROKE,
            _SAVE,
        ),
        role="operator",
        needs_lease=True,
        stop_voids=True,
        waits=True,
    )
    def _by_hand(self, call: Call) -> Answer:
        step, calibrating, controller = call.params["step"], self._calibrations, self._controller
        if step == "begin":
            return JobNumber(
                job=accepted(calibrating.by_hand(call.owner, controller.config)).number
            )
        if step == "finish":
            params = call.params
            return later(
                calibrating.finish(
                    call.owner,
                    stroke_mm=params.get("stroke_mm"),
                    keep=params.get("save", True),
                )
            )
        if step == "cancel":
            return calibrating.give_up(call.owner) or Nothing()
        marks = accepted(calibrating.mark(step, call.owner))
        return Marks(closed_rad=marks.get("closed"), open_rad=marks.get("open"))

    @Method(
        "motor.read_register",
        "Read a register of the motor.",
        "Its number, name and value.",
        RegisterValue,
        (Param("register", "string", 'Its name or number: "PMAX", "21", "0x15".', required=True),),
        waits=True,
    )
    def _read_register(self, call: Call) -> Answer:
        register = _register(call.params["register"])
        deferred = Deferred()

        def replied(reply: RegisterReply) -> None:
            number, name = register.number, register.name
            named = RegisterValue(number=number, name=name, value=reply.value)
            deferred.resolve(reply.failure or named)

        return self._controller.register_reads.add(register.number, replied) or deferred

    @Method(
        "motor.scan",
        f"Ask the ids {SOUGHT_IDS[0]} to {SOUGHT_IDS[-1]} for their MST_ID, and report which"
        " answer: for a motor that is not found at its configured id. Refused while the motor is"
        " enabled.",
        "The ids that were asked, and the motors that have answered.",
        Scanned,
        role="operator",
        waits=True,
    )
    def _scan(self, _call: Call) -> Answer:
        controller, deferred, found = self._controller, Deferred(), list[FoundMotor]()
        refusal = controller.bus.refusal(controller.gripper_id.bus_channel)
        if refusal is not None:
            return refusal
        last = controller.motor.feedback
        if last is not None and last.status == Status.ENABLED:
            return IN_USE
        left = iter(SOUGHT_IDS)

        def ask() -> Refusal | None:
            sought_id = next(left, None)
            if sought_id is None:
                deferred.resolve(Scanned(asked=list(SOUGHT_IDS), found=found))
                return None

            def replied(reply: RegisterReply) -> None:
                if reply.value is not None:
                    found.append(FoundMotor(can_id=sought_id, master_id=int(reply.value)))
                elif reply.failure is not None and reply.failure.reason != SILENT.reason:
                    deferred.resolve(reply.failure)
                    return
                refusal = ask()
                if refusal is not None:
                    deferred.resolve(refusal)

            return controller.register_reads.add(MASTER_ID.number, replied, sought_id)

        return ask() or deferred

    @Method(
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
    )
    def _set_zero(self, call: Call) -> Answer:
        return later(self._calibrations.set_zero(call.owner, call.detached))

    @Method(
        "config.get", "Return the daemon's motion configuration.", "Fields and ranges.", ConfigView
    )
    def _get_config(self, _call: Call) -> ConfigView:
        return self._config()

    def _config(self) -> ConfigView:
        controller = self._controller
        ranges = ranges_of(controller.gripper_id.motor_type)
        return {
            "config": MotionFields(controller.config.as_fields(controller.period_s)),
            "ranges": {name: list(limits) for name, limits in ranges.items()},
            "kept": controller.config_is_kept,
        }

    @Method(
        "config.set",
        "Change the daemon's motion configuration, for everybody who does not say otherwise.",
        "As config.get.",
        ConfigView,
        (
            replace(CONFIG, required=True, description="The fields that change."),
            Param("keep", "boolean", "Also over a restart of the daemon (default false)."),
        ),
        role="admin",
        waits=True,
    )
    def _set_config(self, call: Call) -> Answer:
        controller = self._controller
        config = call.config(controller)
        if self._is_saving_config:
            text = "a change of the defaults is being saved: try again when that is done"
            return Refusal("too_many_requests", text, {"limit": 1})
        if not call.params.get("keep", False):
            controller.config, controller.config_is_kept = config, False
            return self._config()
        fields = config.as_fields(controller.period_s)
        del fields["frame_interval"]
        parameters = {"channel": controller.gripper_id.channel, "config": fields}

        deferred = Deferred()

        def saved(result: TaskResult) -> None:
            self._is_saving_config = False
            if result.error is None:  # else all stays as it was, in the file and here
                controller.config, controller.config_is_kept = config, True
            outcome = _outcome("motion.save", result)
            deferred.resolve(outcome if isinstance(outcome, Refusal) else self._config())

        self._is_saving_config = True
        controller.tasks.append(HelperTask("motion.save", parameters, saved, call.owner.uid))
        return deferred

    def _task(
        self, call: Call, operation: str, parameters: Mapping[str, Any], then: Any
    ) -> Deferred:
        """Let the helper process do a task; answer with what `then` makes of its value."""
        deferred = Deferred()

        def done(result: TaskResult) -> None:
            outcome = _outcome(operation, result)
            deferred.resolve(outcome if isinstance(outcome, Refusal) else then(outcome))

        self._controller.tasks.append(HelperTask(operation, parameters, done, call.owner.uid))
        return deferred


def _register(text: str) -> Register:
    """Return a register by its name, in any case, or its number, decimal or after 0x."""
    named = {register.name.lower(): register for register in REGISTERS.values()}
    register = named.get(text.strip().lower())
    if register is None:
        try:
            register = REGISTERS.get(int(text, 0))
        except ValueError:
            register = None
    if register is not None:
        return register
    known = ", ".join(f"{number} {register.name}" for number, register in REGISTERS.items())
    message = f"there is no register {text!r}; there are: {known}"
    raise Refused(Refusal("invalid_params", message, {"parameter": "register"}))


_FAILURES = {
    "calibration.load": "calibration_unreadable",
    "calibration.templates": "calibration_unreadable",
}


def _outcome(operation: str, result: TaskResult) -> Any:
    """Return the value of a task, or a refusal that says why there is none."""
    if result.error is None:
        return result.value
    return Refusal(result.reason or _FAILURES.get(operation, "not_saved"), result.error)
