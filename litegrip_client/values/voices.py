"""What the daemon's messages name, in the words of their reader: one table, three voices.

On the wire a message names methods and their parameters. A script's author can type Python calls,
and a person at a shell commands and options; a second table has the members of `LiteGrip` that
scripts look for by other names. What calls with wrong arguments are told stands here, too. Nothing
is decided by this module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence

from litegrip_client.values.terms import Called

TYPE_CHECKING = False
if TYPE_CHECKING:
    from inspect import Parameter
    from typing import Any

    from litegrip_client.values.terms import Voice

CALLS: Mapping[str, tuple[str, str]] = {
    "health": ("gripper.health()", "litegripctl health"),
    "state.get": ("gripper.get_state()", "litegripctl state"),
    "state.subscribe": ("gripper.states()", "litegripctl watch"),
    "events.subscribe": ("gripper.events()", "litegripctl events"),
    "rpc.discover": ("", "litegripctl discover"),
    "clients.list": ("", "litegripctl clients"),
    "info.get": ("gripper.info()", "litegripctl info"),
    "job.list": ("gripper.jobs()", "litegripctl jobs"),
    "job.wait": ("see: gripper.jobs()", "see: litegripctl jobs"),
    "job.cancel": (
        "in a shell: litegripctl cancel; this object's own: gripper.cancel()",
        "litegripctl cancel",
    ),
    "lease.get": ("", "litegripctl lease"),
    "lease.acquire": ("gripper.lease().acquire()", "see: litegripctl lease"),
    "lease.take": ("gripper.take_lease()", "litegripctl lease take REASON"),
    "motor.enable": ("gripper.enable()", "litegripctl enable"),
    "motor.disable": ("gripper.disable()", "litegripctl disable"),
    "motor.clear_fault": ("gripper.clear_fault()", "litegripctl clear-fault"),
    "motor.read_register": ("gripper.read_param()", "litegripctl register"),
    "motor.scan": ("in a shell: litegripctl doctor --scan", "litegripctl doctor --scan"),
    "motor.set_zero": ("gripper.set_zero()", ""),
    "motion.open": ("gripper.open()", "litegripctl open"),
    "motion.close": ("gripper.close()", "litegripctl close"),
    "motion.grasp": ("gripper.grasp()", "litegripctl grasp"),
    "motion.move": ("gripper.goto()", "litegripctl move"),
    "motion.hold": ("gripper.hold()", "litegripctl hold"),
    "motion.zero_gravity": ("gripper.zero_gravity()", "litegripctl slack"),
    "motion.set_force": ("gripper.set_force()", "litegripctl force"),
    "stream.set": ("gripper.stream()", ""),
    "stop": ("gripper.software_stop()", "litegripctl stop"),
    "stop.clear": ("gripper.clear_stop()", "litegripctl clear"),
    "calibration.get": ("gripper.config", "litegripctl calibration"),
    "calibration.templates": ("list_templates()", "litegripctl calibration templates"),
    "calibration.load": ("gripper.load_calibration()", "litegripctl calibration load"),
    "calibration.rescale": (
        "gripper.rescale_calibration()",
        "litegripctl calibration rescale",
    ),
    "calibration.save": ("gripper.save_calibration()", "litegripctl calibration save"),
    "calibration.zero": ("gripper.zero()", "litegripctl zero"),
    "calibration.manual": ("gripper.manual_calibration()", "litegripctl calibration manual"),
    "config.get": ("gripper.motion_config", "litegripctl config"),
    "config.set": ("in a shell: litegripctl config set", "litegripctl config set"),
    "daemon.restart": ("in a shell: litegripctl restart --hold", "litegripctl restart --hold"),
    "recorder.dump": ("gripper.dump()", "litegripctl dump"),
    "trajectory.record_start": ("gripper.record_start()", "litegripctl record NAME"),
    "trajectory.record_stop": ("gripper.record_stop()", "by the program that records"),
    "trajectory.play": ("gripper.play()", "litegripctl play"),
    "trajectory.status": ("gripper.trajectory_status()", ""),
    "trajectory.list": ("gripper.kept_trajectories()", "litegripctl trajectories"),
    "trajectory.delete": ("gripper.delete_trajectory()", "litegripctl trajectories delete"),
    "teleop.start": ("gripper.teleop_start()", "litegripctl teleop"),
    "teleop.stop": ("gripper.teleop_stop()", "litegripctl teleop stop"),
    "teleop.status": ("gripper.teleop_status()", "litegripctl teleop status"),
    "sim.object": ("", "litegripctl sim object"),
    "sim.push": ("", "litegripctl sim push"),
    "sim.fault": ("", "litegripctl sim fault"),
    "sim.heat": ("", "litegripctl sim heat"),
    "sim.reset": ("", "litegripctl sim reset"),
}
"""By method: the call of `LiteGrip` and the command that do the same; empty where there is none."""


def setting_right(field: str) -> str:
    """Return how a tunable that a call cannot be made with is set right: it was set before."""
    name = f"gripper.motion_config.{field}"
    return f"{name} = ..., or for the daemon's own: del {name}"


_STROKE = {"stroke_mm": ("stroke_mm", "--stroke-mm")}
_SPEED = {"speed_mm_s": ("speed_mm_s", "--speed")}
_TARGETS = {
    "opening_mm": ("position_mm", "TARGET"),
    "position_rad": ("position_rad", "TARGET"),
    "openness": ("openness", "TARGET"),
}

ARGUMENTS: Mapping[str, Mapping[str, tuple[str, str]]] = {
    "state.subscribe": {"hz": ("hz", "--hz")},
    "events.subscribe": {"kinds": ("kinds", "--kind")},
    "motor.enable": {"retries": ("retries", "--retries")},
    "motor.read_register": {"register": ("register", "NAME|NUMBER")},
    "motion.open": _SPEED,
    "motion.close": _SPEED,
    "motion.grasp": {
        **_SPEED,
        "force_n": ("force_n", "--force"),
        "hold_s": ("hold_s", "--hold"),
        "hold_by": ("hold_by", "--gains"),
        "width_mm": ("width_mm", "--width"),
        "tolerance_mm": ("tolerance_mm", "--tolerance"),
    },
    "motion.move": {
        **_SPEED,
        **_TARGETS,
        "duration_s": ("duration", "--duration"),
        "at_least_s": ("duration", "--duration"),
    },
    "motion.set_force": {"force_n": ("force_n", "N")},
    "job.cancel": {"job": ("job", "JOB")},
    "stop": {"level": ("level", "--level"), "why": ("why", "--why")},
    "lease.take": {"why": ("why", "REASON")},
    "calibration.load": {"template": ("template", "normal|reverse")},
    "calibration.zero": {"mount": ("mount", "--mount"), **_STROKE},
    "calibration.manual": _STROKE,
    "calibration.rescale": _STROKE,
    "config.set": {"keep": ("keep", "--keep")},
    "recorder.dump": {"note": ("note", "--note")},
    "trajectory.record_start": {"rate_hz": ("rate_hz", "--rate")},
    "trajectory.record_stop": {
        "allow_partial": ("allow_partial", "litegripctl trajectories keep --partial NAME"),
    },
    "trajectory.play": {
        "name": ("trajectory", "NAME"),
        "speed": ("speed", "--speed"),
        "repeat": ("repeat", "--repeat"),
        "align": ("align", "--no-align"),
        "force": ("force", "--force"),
    },
    "sim.object": {
        "width_mm": ("width_mm", "WIDTH"),
        "stiffness_nm_rad": ("stiffness_nm_rad", "--stiffness"),
        "slip_mm_s": ("slip_mm_s", "--slip"),
    },
    "sim.push": {"torque_nm": ("torque_nm", "NM")},
    "sim.fault": {"name": ("name", "NAME")},
    "sim.heat": {"coil_c": ("coil_c", "C")},
    "trajectory.get": {"name": ("name", "NAME")},
    "trajectory.put": {"name": ("name", "--as")},
    "trajectory.delete": {"name": ("name", "NAME")},
    "teleop.start": {
        "host": ("host", "--host"),
        "port": ("port", "--port"),
        "grip_id": ("grip_id", "--grip-id"),
        "link": ("link", "--link"),
        "fake_leader": ("fake_leader", "--fake-leader"),
        "rate_hz": ("rate_hz", "--rate"),
        "watchdog_s": ("watchdog_s", "--watchdog"),
        "torque_limit_nm": ("torque_limit_nm", "--torque-limit"),
        "force_limit_n": ("force_limit_n", "--force-limit"),
        "align_speed_mm_s": ("align_speed_mm_s", "--align-speed"),
        "lead_cap_mm": ("lead_cap_mm", "--lead-cap"),
        "require_ready": ("require_ready", "--no-require-ready"),
        "ready_timeout_s": ("ready_timeout_s", "--ready-timeout"),
        "reflect": ("reflect", "--reflect"),
        "reflect_n": ("reflect_n", "--reflect-force"),
        "reflect_gain": ("reflect_gain", "--reflect-gain"),
    },
}
"""By method and parameter: the argument in Python, and the option or place on the command line.

What is not here has the same name in Python and none in the shell.
"""

_OF_ALL: Mapping[str, tuple[str, str]] = {"config": ("motion_config", "config")}
"""Parameters of nearly all methods."""


def in_python(method: str | None, parameter: str | None, asked: str | None) -> str | None:
    """Name a call of `LiteGrip` or an argument."""
    if method is None:
        own = asked.arguments.get(parameter or "") if isinstance(asked, Called) else None
        return own or _argument(asked, parameter)[0]
    if isinstance(method, Called):
        return f"gripper.{method.call}()"
    call = CALLS.get(method, _NONE)[0]
    if parameter is None:
        return call
    name = _argument(method, parameter)[0] or parameter
    value = "True" if name.startswith("allow_") else "..."
    return call.replace("()", f"({name}={value})", 1) if call and call.endswith("()") else None


def connecting(voice: Voice | None) -> str | None:
    """Name the call that connects; None where the reader has none."""
    return (voice or in_python)(Called("hello", "connect"), None, None)


def enabling_again(voice: Voice | None) -> Voice:
    """Return a voice that names enabling where the lease is to be acquired: that does both."""
    said = voice or in_python

    def speak(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        if method == "lease.acquire":
            return said("motor.enable", None, asked)
        return said(method, parameter, asked)

    return speak


_ENDS_OF_OWN = {"stream": "stream.close()", "play": "gripper.play_stop()"}
"""By kind of job: what ends it in the program that has begun it; the first raises nothing."""


def ending_its_own(voice: Voice | None, kind: object) -> Voice:
    """Return a voice that names the end of the program's own job in place of `cancel`.

    It may be another object's than who asks.
    """
    said, end = voice or in_python, _ENDS_OF_OWN.get(str(kind))

    def speak(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        name = said(method, parameter, asked)
        is_python = name is not None and name.endswith("gripper.cancel()")
        if method != "job.cancel" or end is None or name is None or not is_python:
            return name
        return f"await {end}" if "await " in name else end

    return speak


def in_shell(method: str | None, parameter: str | None, asked: str | None) -> str | None:
    """Name a command of `litegripctl` or an option."""
    if method is None:
        return _argument(asked, parameter)[1]
    call, option = CALLS.get(method, _NONE)[1], _argument(method, parameter)[1] or ""
    if parameter is None:
        option = _ALONE.get(method, "")
    if option.startswith("litegripctl "):  # another command does that than the method alone
        return option
    first, _, other = option.partition("|")
    if other:  # what is pasted must be no pipe
        option = f"{first} (or {other})"
    return f"{call} {option}".rstrip() if call else None


def in_shell_of(here: Callable[[str], str]) -> Voice:
    """Return `in_shell` for one gripper: `here` puts into a command how that is called."""

    def voice(method: str | None, parameter: str | None, asked: str | None) -> str | None:
        name = in_shell(method, parameter, asked)
        return None if name is None else here(name)

    return voice


_ALONE: Mapping[str, str] = {"calibration.load": "--chain"}
"""By method: what its command needs to do what the method does without parameters."""

_NONE = (None, None)


def _argument(method: str | None, parameter: str | None) -> tuple[str, str] | tuple[None, None]:
    names = {**_OF_ALL, **ARGUMENTS.get(method or "", {})}
    return names.get(parameter or "", _NONE)


MEANT: Mapping[str, str] = {
    "move": "goto(position_mm=...)",
    "set_position": "goto(position_mm=...)",
    "state": "get_state()",
    "status": "get_state()",
    "position": "get_state().position_rad, or get_state().opening_mm",
    "get_position": "get_state().opening_mm, or get_state().position_rad",
    "get_position_rad": "get_state().position_rad",
    "get_force": "get_state().force_n",
    "get_torque": "get_state().torque_nm",
    "get_temperature": "get_state().coil_temperature_c",
    "get_error": "get_state().error_code",
    "get_info": "info()",
    "poll": "get_state()",
    "refresh_status": "get_state()",
    "wait_for_ready": "enable(), which waits for the motor",
    "enter_zero_gravity": "zero_gravity()",
    "exit_zero_gravity": "hold()",
    "calibrate_guided": "calibrate()",
    "calibrate_manual": "manual_calibration()",
    "move_at_speed_rad": "goto_rad(position_rad, duration=...)",
    "home": "goto(0)",
    "width": "get_state().opening_mm, or width_mm of what grasp() returns",
    "opening": "get_state().opening_mm",
    "force": "get_state().force_n, or set_force(newtons)",
    "torque": "get_state().torque_nm",
    "temperature": "get_state().coil_temperature_c",
    "grip": "grasp(force_n=...)",
    "release": "open(), or zero_gravity() for slack jaws",
    "relax": "zero_gravity()",
    "slack": "zero_gravity()",
    "relaxed": "get_state().is_zero_gravity",
    "grasped": "get_state().is_grasped",
    "enabled": "get_state().enabled",
    "connected": "is_connected",
    "open_gripper": "open()",
    "close_gripper": "close()",
    "abort": "cancel() for this object's own motion, or software_stop()",
    "halt": "software_stop()",
    "estop": "software_stop()",
    "emergency_stop": "software_stop()",
}
"""By a name that users look for in `LiteGrip`: what does that there."""

_MEANT_OF_A_STREAM = ("send", "move", "goto", "set", "update", "write")
"""Names that users look for in a stream: `set_target` does that."""

_SEVERAL: Mapping[str, tuple[str, ...]] = {
    "position": ("opening_mm", "position_rad"),
    "temperature": ("coil_temperature_c", "driver_temperature_c"),
    "success": ("ok",),
}
"""By a name that users look for in a state or a result: the fields, where it has all of these."""

_FIELDS: Mapping[str, str] = {"width": "opening_mm"}
"""By a name that users look for in a state or a result: the field, unless one begins with it."""


_UNITS = frozenset(("mm", "mm_s", "rad", "rad_s", "nm", "nm_rad", "n", "n_s", "s", "ms", "hz", "c"))
_CLOSE = 0.7
"""As alike as `opne` and `open`."""


def no_attribute(
    owner: object, name: str, beyond: Mapping[str, type] | None = None
) -> AttributeError:
    """Return the error for a member that is not there; it names the one that was meant.

    `beyond` has the classes of what is reached through the owner, by how that is written.
    """
    kind = type(owner)
    text = f"{kind.__name__!r} object has no attribute {name!r}"
    if name.startswith("_") or hasattr(kind, name):  # a field that is not set yet is there
        return AttributeError(text, name=name, obj=owner)
    hint = _hint(kind, name, beyond or {})
    # Without the object: Python itself would add the same name once more.
    return AttributeError(text + hint, name=name, obj=None if hint else owner)


def _hint(kind: type, name: str, beyond: Mapping[str, type]) -> str:
    """Return what was meant, as an addition; empty if nothing is found."""
    if beyond and name in MEANT and kind.__name__ == "LiteGrip":
        return f"; use {MEANT[name]}"
    if name in _MEANT_OF_A_STREAM and hasattr(kind, "set_target"):
        return "; use set_target(opening_mm)"
    for path, place in {"": kind, **beyond}.items():
        several = _SEVERAL.get(name, ())
        if several and set(several) <= set(_public(place)):
            return f": did you mean {' or '.join(repr(path + one) for one in several)}?"
        like = _with_unit(name, _public(place))
        if like is not None:
            return f": did you mean {path + like!r}?"
    import difflib  # noqa: PLC0415 - an error

    close = difflib.get_close_matches(name.lower(), _public(kind), 1, _CLOSE)
    longer = [one for one in _public(kind) if one.startswith(f"{name.lower()}_")]
    if close or len(longer) == 1:
        close = close or longer
        return f": did you mean {close[0]!r}?"
    for sought in difflib.get_close_matches(name.lower(), _FIELDS, 1, _CLOSE):
        for path, place in {"": kind, **beyond}.items():
            names = _public(place)
            like = _with_unit(sought, names) or _FIELDS[sought]
            if like in names:
                return f": did you mean {path + like!r}?"
    return ""


def _public(kind: type) -> list[str]:
    return [name for name in dir(kind) if not name.startswith("_")]


def _with_unit(name: str, names: Sequence[str]) -> str | None:
    """Return the name itself, or that with a unit behind it."""
    if name in names:
        return name
    behind = (one for one in names if one.startswith(f"{name}_"))
    return next((one for one in behind if one.removeprefix(f"{name}_") in _UNITS), None)


def misuse(
    method: Callable[..., Any], arguments: Sequence[Any], named: Mapping[str, Any]
) -> str | None:
    """Return what is wrong with a call of a method and what it takes; None if nothing is found.

    The first of the `arguments` is the object, or the class.
    """
    owner = arguments[0]
    kind = (owner if isinstance(owner, type) else type(owner)).__name__
    call = kind if method.__name__ == "__init__" else f"{kind}.{method.__name__}"
    return _misuse(call, method, 1, arguments, named)


def misuse_of_function(
    function: Callable[..., Any], arguments: Sequence[Any], named: Mapping[str, Any]
) -> str | None:
    """Return the same of a call of a function."""
    return _misuse(function.__name__, function, 0, arguments, named)


def _misuse(
    call: str,
    method: Callable[..., Any],
    bound: int,
    arguments: Sequence[Any],
    named: Mapping[str, Any],
) -> str | None:
    """Return the same; the first `bound` parameters are not the caller's."""
    import inspect  # noqa: PLC0415 - an error

    signature = inspect.signature(method)
    parameters = list(signature.parameters.values())[bound:]
    names = [one.name for one in parameters if one.kind is not one.POSITIONAL_ONLY]
    takes = f"it takes: {', '.join(names)}" if names else "it takes no arguments"
    for wrong in named:
        if wrong not in names:
            like = _like(wrong, names)
            meant = f"did you mean {like!r}? " if like else ""
            if not like and method.__name__ == "goto" and wrong.startswith("speed"):
                meant = "use move_at_speed(target_mm, speed_mm_s); "
            return f"{call}() has no argument {wrong!r}: {meant}{takes}"
    try:
        signature.bind(*arguments, **named)
    except TypeError as error:
        return f"{call}(): {error}; {takes}{_how(parameters)}"
    return None


def _like(wrong: str, names: Sequence[str]) -> str | None:
    """Return the name that was meant: one with another unit, or spelt nearly so."""
    import difflib  # noqa: PLC0415 - an error

    stem, _, unit = wrong.lower().partition("_")
    same = [name for name in names if unit and name.partition("_")[2] == unit]
    if len(same) == 1:
        return same[0]
    for name in names:
        if name.partition("_")[0] == stem:
            return name
    return next(iter(difflib.get_close_matches(wrong.lower(), names, 1, _CLOSE)), None)


def did_you_mean(wrong: str, names: Iterable[str]) -> str:
    """Return the question, as an addition, if a name comes close to what was given."""
    import difflib  # noqa: PLC0415 - an error

    close = difflib.get_close_matches(wrong, list(names), 1)
    return f"; did you mean {close[0]!r}?" if close else ""


def _how(parameters: Sequence[Parameter]) -> str:
    """Return which arguments must be named, as an addition; empty if none must."""
    only = [one.name for one in parameters if one.kind is one.KEYWORD_ONLY]
    return f"; only by name: {', '.join(only)}" if only and len(only) < len(parameters) else ""
