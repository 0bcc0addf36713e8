"""A restart that holds: its method, and the state of a daemon for its successor, in two parts.

`export` returns what the next command depends on; it is small. `export_history` returns what
clients may ask for later. It is made before, and adopted after, the moment in which nobody
commands the motor.

Each class declares its own attributes (`model/plain.py`). Only what is a choice of the moment is
here: which motor can be handed over, the phase, the idle jaws, and a lease that lapses.
"""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import Any, Protocol, TypeAlias

from litegripd.control.controller import Controller
from litegripd.control.holds import Grip, GripSettings, Hold, Idle, Slack
from litegripd.model.errors import Refusal
from litegripd.model.gripper import MotorType
from litegripd.model.motor import MotorPhase
from litegripd.model.plain import TYPE_KEY, PlainError, memory, plain_of, restore, value_of
from litegripd.model.sentence import sentence
from litegripd.model.state import Job, Restarted
from litegripd.motor.motor import Motor
from litegripd.rpc.method import Answer, Call, Deferred, Method, Param
from litegripd.rpc.service import RpcService

FORMAT = 10
"""The number of the format of what is handed over. A successor rejects any other."""

SETTLED = (MotorPhase.ENABLED, MotorPhase.DISABLED, MotorPhase.FAULT)

_ENDS = Mapping[str, tuple[str, str | None]]


class Machine(Protocol):
    """One motor and the controller that drives it."""

    motor: Motor
    controller: Controller


def why_not_restartable(machine: Machine) -> Refusal | None:
    """Return why no successor can take over now, or None."""
    refusal = machine.controller.why_not_restartable()
    if refusal is not None:
        return refusal
    view, is_verifying = machine.motor.view(), machine.motor.is_verifying
    is_settled = view.phase in SETTLED and not is_verifying
    if is_settled and view.feedback is not None and view.zero.state != "pending":
        return None
    reading = "; its registers are being read" if is_verifying else ""
    text = (
        f"the motor is {view.phase.value}{reading}: it can be handed over once it answers and is"
        " settled"
    )
    problem = view.problem or Refusal("busy" if is_verifying else "restart_failed", text)
    hint = (
        "try again once it answers and is settled, or restart without the hold, which disables"
        " the motor"
    )
    return Refusal(problem.reason, problem.message, {**problem.data, "hint": hint})


def export(machine: Machine, service: RpcService) -> dict[str, Any]:
    """Return what a successor needs for its first tick. Raises `PlainError` for a defect.

    The caller has asked `why_not_restartable`.
    """
    controller, idle = machine.controller, machine.controller.idle
    plain = memory(controller)
    if controller.lease.holder is not None:
        plain["lease"]["_lapsed"] = plain_of(controller.lease.holder)
    return {
        "format": FORMAT,
        "motor": memory(machine.motor),
        "controller": plain,
        "rest": memory(idle) if isinstance(idle, Grip) else plain_of(idle),
        "phase": plain_of(controller.motor.phase),
        "service": memory(service),
    }


def adopt(machine: Machine, service: RpcService, plain: Any, known: Any = None) -> None:
    """Adopt the predecessor's state. Raises `PlainError` for a state that cannot be used.

    `known` is a state that was adopted before, and has not changed since: most of what a daemon
    knows is the same a moment later, and takes no time then.
    """
    found = plain.get("format") if isinstance(plain, dict) else None
    if found != FORMAT:
        raise PlainError(f"the state has format {found}, this version takes over format {FORMAT}")
    if plain.keys() != {"format", "motor", "controller", "rest", "phase", "service"}:
        raise PlainError("the state is not of this version")
    motor, controller = machine.motor, machine.controller
    before: Any = {} if known is None else known
    restore(motor, plain["motor"], known=before.get("motor"))
    # A motor that is not settled is rejected; a phase counts as the predecessor has confirmed it.
    view = motor.view()
    if view.phase not in SETTLED or view.zero.state == "pending":
        raise PlainError(f"Motor: {view.phase.value} is no phase in which it is handed over")
    if view.identity is None or view.identity.can_id != controller.gripper_id.can_id:
        raise PlainError("Motor: the motor that is handed over has another id")
    if view.feedback is None:
        raise PlainError("Motor: there is no measurement of the motor that is handed over")
    restore(controller, plain["controller"], known=before.get("controller"))
    if known is None or known["rest"] != plain["rest"]:
        controller.idle = _idle_of(plain["rest"], controller.gripper_id.motor_type)
    # The phase of the predecessor's last tick: the controller must still notice a later change.
    phase = value_of(plain["phase"], MotorPhase, "phase")
    controller.motor = motor.view()._replace(phase=phase)
    restore(service, plain["service"], known=before.get("service"))


def export_history(machine: Machine, service: RpcService) -> dict[str, Any]:
    """Return the ended jobs; clients may still ask for them."""
    service.reporter.keep_ends()
    return {"jobs": plain_of(list(machine.controller.jobs)), "ends": service.reporter.memory()}


def adopt_history(machine: Machine, service: RpcService, plain: Any) -> None:
    """Keep the predecessor's jobs. Raises `PlainError` for a history that cannot be used."""
    if not isinstance(plain, dict) or plain.keys() != {"jobs", "ends"}:
        raise PlainError("the history is not of this version")
    ends = value_of(plain["ends"], _ENDS, "ends")
    machine.controller.jobs.keep(value_of(plain["jobs"], tuple[Job, ...], "jobs"))
    service.reporter.restore(ends)


def _idle_of(plain: Any, motor_type: MotorType) -> Idle:
    if not isinstance(plain, dict) or plain.get(TYPE_KEY) != Grip.__name__:
        hold: Idle = value_of(plain, Hold | Slack, "rest")
        return hold
    settings = value_of(plain.get("_settings"), GripSettings, "Grip._settings")
    grip = Grip(settings, 0.0, 0.0, motor_type, watched=False)
    restore(grip, plain)
    return grip


OnRestarted: TypeAlias = Callable[[Restarted | Refusal], None]
"""Gets the successor that has taken over, or the reason why none has."""

OnRestart: TypeAlias = Callable[[OnRestarted], Refusal | None]
"""Begins a restart, or returns a refusal."""

_PLAIN = Refusal(
    "invalid_params",
    sentence(
        "{daemon.restart} only holds through a restart ({.hold_through_restart} true); a restart"
        " that disables the motor is done by the service manager: systemctl restart, or SIGTERM"
    ),
    {"parameter": "hold_through_restart"},
)


def no_restart(_on_restarted: OnRestarted) -> Refusal | None:
    """Return the refusal of a daemon that cannot start a successor."""
    return Refusal("restart_failed", "this daemon cannot start a successor")


class RestartMethods:
    """The method `daemon.restart`."""

    NOT_CARRIED = ("_restart",)

    def __init__(self, restart: OnRestart) -> None:
        self._restart = restart

    @Method(
        "daemon.restart",
        "Start a successor of the daemon, which reads the configuration again and takes over; pose"
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
    )
    def _begin(self, call: Call) -> Answer:
        if not call.params["hold_through_restart"]:
            return _PLAIN
        deferred = Deferred()

        def restarted(outcome: Restarted | Refusal) -> None:
            deferred.resolve(outcome if isinstance(outcome, Refusal) else asdict(outcome))

        return self._restart(restarted) or deferred
