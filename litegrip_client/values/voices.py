"""What the daemon's messages name, in the words of their reader: one table, three voices.

On the wire a message names methods and their parameters. A script's author can type Python calls,
and a person at a shell commands and options. Nothing is decided by this module.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator, Mapping

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeAlias

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
    "job.cancel": ("in a shell: litegripctl cancel JOB", "litegripctl cancel JOB"),
    "lease.get": ("", "litegripctl lease"),
    "lease.acquire": ("gripper.lease()", "see: litegripctl lease"),
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
    "daemon.restart": ("in a shell: litegripctl restart", "litegripctl restart"),
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

_STROKE = {"stroke_mm": ("stroke_mm", "--stroke-mm")}
_SPEED = {"speed_mm_s": ("speed_mm_s", "--speed")}
_TARGETS = {name: (name, f"TARGET ({name})") for name in ("opening_mm", "position_rad", "openness")}

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
    "trajectory.play": {
        "name": ("trajectory", "NAME"),
        "speed": ("speed", "--speed"),
        "repeat": ("repeat", "--repeat"),
        "align": ("align", "--no-align"),
        "force": ("force", "--force"),
    },
    "sim.object": {
        "width_mm": ("width_mm", "MM|none"),
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

_OF_ALL = {"config": ("motion_config", "config")}
"""Parameters of nearly all methods."""

_PYTHON, _SHELL = 0, 1

_METHOD = re.compile(
    rf"(?<![\w./])({'|'.join(re.escape(name) for name in CALLS if '.' in name)})(?!\w|\.\w)"
    r"( with (?:a )?(\w+))?"
)
"""A method, and a parameter that it is to be called with."""

Voice: TypeAlias = "Callable[[str, str | None, str | None], str]"
"""Makes a reader's text of the daemon's: of the text, the method asked, and the parameter meant."""


def in_python(text: str, method: str | None = None, parameter: str | None = None) -> str:
    """Name calls of `LiteGrip` and their arguments in a text that answers `method`."""
    return _said(text, method, parameter, _PYTHON)


def in_shell(text: str, method: str | None = None, parameter: str | None = None) -> str:
    """Name commands of `litegripctl` and their options in a text that answers `method`."""
    return _said(text, method, parameter, _SHELL)


def is_said(message: str, hint: str) -> bool:
    """Return True if `message` names the remedy of `hint` already: its words, or all its calls."""
    if hint in message:
        return True
    named = [call for call in _calls() if _has(hint, call)]
    return bool(named) and all(_has(message, call) for call in named)


def _calls() -> Iterator[str]:
    """Give all calls and commands, without what is to be filled in."""
    for row in CALLS.values():
        for call in filter(None, row):
            yield call.rpartition(": ")[2].removesuffix(" NAME").removesuffix(" REASON")


def _has(text: str, call: str) -> bool:
    return re.search(rf"{re.escape(call)}(?![\w-])", text) is not None


def _said(text: str, method: str | None, parameter: str | None, voice: int) -> str:
    own = method is not None and text.startswith(f"{method}: ")
    if own:  # who has typed the call or the command knows which one it was
        text = text[len(f"{method}: ") :]
    text = _METHOD.sub(lambda found: _call(found, voice), text)
    return _arguments(text, method, parameter, voice)


def _call(found: re.Match[str], voice: int) -> str:
    """Return what stands for a method, called with an argument where the text names one."""
    method, rest, parameter = found.groups(default="")
    call = CALLS[method][voice] or method
    names = ARGUMENTS.get(method, {}).get(parameter, (parameter, ""))
    if parameter not in ARGUMENTS.get(method, {}) and "_" not in parameter:
        return f"{call}{rest}"  # a word of the sentence
    if voice == _PYTHON:
        return f"{call.removesuffix(')')}{names[voice]}=...)" if call.endswith("()") else found[0]
    return f"{call} {names[voice]}".rstrip()


def _arguments(text: str, method: str | None, parameter: str | None, voice: int) -> str:
    """Name arguments in the place of parameters.

    One that is a word of English, too, counts only at the beginning, where it is the subject. A key
    of the configuration keeps its name.
    """
    names = {**_OF_ALL, **ARGUMENTS.get(method or "", {})}
    plain = [name for name in names if "_" not in name and name == parameter]
    always = [re.escape(name) for name in names if "_" in name]
    if plain:
        text = re.sub(rf"^{plain[0]}\b", names[plain[0]][voice], text)
    if not always:
        return text
    pattern = rf"(?<![\w-])({'|'.join(always)})(?![\w=-]| = | in \[)"
    return re.sub(pattern, lambda found: names[found[1]][voice], text)
