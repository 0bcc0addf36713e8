"""The methods on what persists: the calibration, the daemon's defaults, the motor's registers."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, TypeAlias

from litegripd.control.admission import ENDING, conflict_refusal
from litegripd.control.calibrating import Calibrating
from litegripd.control.calibration import content_of
from litegripd.control.engine import Engine
from litegripd.model.calibration import CalibrationError, from_plain, read_content
from litegripd.model.errands import Errand, ErrandResult
from litegripd.model.errors import Refusal
from litegripd.model.motion_config import RANGES, fast_conflict
from litegripd.model.motor import RegisterReply
from litegripd.motor.registers import REGISTERS, Register
from litegripd.rpc.answers import (
    CalibrationLoaded,
    CalibrationView,
    ConfigView,
    Marks,
    Nothing,
    RegisterValue,
    Templates,
)
from litegripd.rpc.calls import Answer, Call, Deferred, Function, Later, later
from litegripd.rpc.facts import MotionFields
from litegripd.rpc.view import JobNumber

Authority: TypeAlias = Callable[[], "Refusal | None"]
"""Returns why what was asked for may not take effect any more, or None."""


class Settings:
    """Functions on calibration, motion configuration and registers."""

    def __init__(self, engine: Engine) -> None:
        self._engine = engine
        self._calibrating = Calibrating(engine)
        self._is_saving_config = False

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {
            "calibration.get": lambda _call: self._calibration(),
            "calibration.templates": self._templates,
            "calibration.load": self._load,
            "calibration.save": self._save,
            "calibration.zero": self._zero,
            "calibration.manual": self._by_hand,
            "motor.set_zero": lambda call: later(
                self._calibrating.set_zero(call.owner, call.detached)
            ),
            "motor.read_register": self._read_register,
            "config.get": lambda _call: self._config(),
            "config.set": self._set_config,
        }

    def _calibration(self) -> CalibrationView:
        engine, in_use = self._engine, self._engine.calibrated
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
            "kp": in_use.gains.kp_nm_rad,
            "kd": in_use.gains.kd_nm_s_rad,
            "file": in_use.file,
            "content": {}
            if calibration is None
            else content_of(calibration, engine.unit, in_use.gains, engine.motor),
        }

    def _templates(self, call: Call) -> Answer:
        def told(value: Any) -> Templates:
            return {"templates": value}

        return self._errand(call, "calibration.templates", {}, told)

    def _load(self, call: Call) -> Answer:
        params = call.params
        if "template" in params and "content" in params:
            text = "calibration.load takes a template or a content, not both"
            return Refusal("invalid_params", text, {"parameter": "content"})
        refusal = self._calibrating.refusal_to_load()
        if refusal is not None:
            return refusal
        if "content" not in params:
            unit, template = self._engine.unit, params.get("template")
            wanted = {
                "channel": unit.channel,
                "mount": template or unit.mount,
                "configured": template is None,
            }
            authority = self._authority(call)
            return self._errand(
                call, "calibration.load", wanted, lambda value: self._adopt_found(value, authority)
            )
        try:
            calibration = read_content(params["content"])
        except CalibrationError as error:
            return Refusal("calibration_unreadable", f"the content cannot be used: {error}")
        refusal = self._calibrating.load(calibration, None)
        return refusal or self._loaded(loaded=True, factory=False, skipped=[])

    def _loaded(self, *, loaded: bool, factory: bool, skipped: list[str]) -> CalibrationLoaded:
        found = self._calibration()
        return {**found, "loaded": loaded, "factory": factory, "skipped": skipped}

    def _authority(self, call: Call) -> Authority:
        """Return what to ask when a request takes effect that had to wait for the helper.

        A stop that has come since voids it, and so do the end of who asked and any change of the
        lease: who held it must hold the same one, who needed none may need one now.
        """
        engine = self._engine
        latch, holder = engine.stop_latch, engine.lease.holder
        generation = latch.generation
        owner = call.owner if holder is None else replace(call.owner, grant=holder.number)

        def refusal() -> Refusal | None:
            if engine.is_ending:
                return ENDING
            if call.session.is_orphaned:
                return Refusal("client_lost", "who asked for it has gone")
            stopped = latch.refusal_of_sent(generation, None, call.received_s, owner.client)
            return stopped or engine.lease.refusal(owner)

        return refusal

    def _adopt_found(self, value: Any, authority: Authority) -> CalibrationLoaded | Refusal:
        """Take what the helper found, unless a motion has begun or somebody else decides now."""
        refusal = authority()
        if refusal is not None:
            return refusal
        skipped = list(value["skipped"])
        if value["calibration"] is None:
            return self._loaded(loaded=False, factory=False, skipped=skipped)
        calibration = from_plain(value["calibration"])
        refusal = self._calibrating.load(calibration, value["path"])
        return refusal or self._loaded(loaded=True, factory=value["factory"], skipped=skipped)

    def _save(self, call: Call) -> Answer:
        deferred = Deferred()

        def saved(result: ErrandResult) -> None:
            deferred.resolve(_outcome("calibration.save", result))

        return self._calibrating.save(saved, call.owner.uid) or deferred

    def _zero(self, call: Call) -> Answer:
        config = call.config(self._engine.config, self._engine.period_s)
        if isinstance(config, Refusal):
            return config
        return later(
            self._calibrating.zero(
                call.owner,
                config,
                mount=call.params.get("mount"),
                keep=call.params.get("save", True),
                detached=call.detached,
            )
        )

    def _by_hand(self, call: Call) -> Answer:
        step, calibrating, engine = call.params["step"], self._calibrating, self._engine
        if step == "begin":
            job = calibrating.by_hand(call.owner, engine.config)
            return job if isinstance(job, Refusal) else JobNumber(job=job.number)
        if step == "finish":
            job = calibrating.finish(call.owner, keep=call.params.get("save", True))
            return job if isinstance(job, Refusal) else Later(job)
        if step == "cancel":
            return calibrating.give_up(call.owner) or Nothing()
        marks = calibrating.mark(step, call.owner)
        if isinstance(marks, Refusal):
            return marks
        return Marks(closed_rad=marks.get("closed"), open_rad=marks.get("open"))

    def _read_register(self, call: Call) -> Answer:
        register = find_register(call.params["register"])
        if isinstance(register, Refusal):
            return register
        deferred = Deferred()

        def replied(reply: RegisterReply) -> None:
            number, name = register.number, register.name
            named = RegisterValue(number=number, name=name, value=reply.value)
            deferred.resolve(reply.failure or named)

        return self._engine.inquiries.add(register.number, replied) or deferred

    def _config(self) -> ConfigView:
        engine = self._engine
        return {
            "config": MotionFields(engine.config.as_fields(engine.period_s)),
            "ranges": {name: list(limits) for name, limits in RANGES.items()},
            "kept": engine.config_is_kept,
        }

    def _set_config(self, call: Call) -> Answer:
        engine = self._engine
        config = call.config(engine.config, engine.period_s)
        if isinstance(config, Refusal):
            return config
        # No motion could use such defaults; what depends on the calibration is the motions' to say.
        refusal = conflict_refusal(fast_conflict(config, config.speed_mm_s, engine.period_s))
        if refusal is not None:
            return refusal
        if self._is_saving_config:
            text = "a change of the defaults is being saved: try again when that is done"
            return Refusal("too_many_requests", text, {"limit": 1})
        if not call.params.get("keep", False):
            engine.config, engine.config_is_kept = config, False
            return self._config()
        fields = config.as_fields(engine.period_s)
        del fields["frame_interval"]
        parameters = {"channel": engine.unit.channel, "config": fields}

        deferred = Deferred()

        def saved(result: ErrandResult) -> None:
            self._is_saving_config = False
            if result.error is None:  # else all stays as it was, in the file and here
                engine.config, engine.config_is_kept = config, True
            outcome = _outcome("motion.save", result)
            deferred.resolve(outcome if isinstance(outcome, Refusal) else self._config())

        self._is_saving_config = True
        engine.errands.append(Errand("motion.save", parameters, saved, call.owner.uid))
        return deferred

    def _errand(
        self, call: Call, operation: str, parameters: Mapping[str, Any], then: Any
    ) -> Deferred:
        """Have something done by the helper process, and answer with what `then` makes of it."""
        deferred = Deferred()

        def done(result: ErrandResult) -> None:
            outcome = _outcome(operation, result)
            deferred.resolve(outcome if isinstance(outcome, Refusal) else then(outcome))

        self._engine.errands.append(Errand(operation, parameters, done, call.owner.uid))
        return deferred


def find_register(text: str) -> Register | Refusal:
    """Find a register by its name, in any case, or its number, decimal or after 0x."""
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
    return Refusal("invalid_params", message, {"parameter": "register"})


_FAILURES = {
    "calibration.load": "calibration_unreadable",
    "calibration.templates": "calibration_unreadable",
}


def _outcome(operation: str, result: ErrandResult) -> Any:
    """Return what an errand brought, or a refusal that says why it brought nothing."""
    if result.error is None:
        return result.value
    return Refusal(result.reason or _FAILURES.get(operation, "not_saved"), result.error)
