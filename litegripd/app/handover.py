"""The state of a whole daemon for its successor, in two parts.

`export` returns what the next command depends on; it is small. `export_history` returns what
clients may ask for later. It is made before, and read after, the moment in which nobody commands
the motor.
"""

from collections.abc import Mapping
from typing import Any

from litegripd.app.machine import Machine
from litegripd.handover import controller as control
from litegripd.handover import motor
from litegripd.model.errors import Refusal
from litegripd.model.plain import PlainError, plain_of, value_of
from litegripd.rpc.service import Numbers, RpcService

FORMAT = 4
"""The number of the format of what is handed over. A successor rejects any other."""

_ENDS = Mapping[str, tuple[str, str | None]]


def why_not_restartable(machine: Machine) -> Refusal | None:
    """Return why no successor can take over now, or None."""
    return machine.controller.why_not_restartable() or motor.refusal(machine.motor)


def export(machine: Machine, service: RpcService) -> dict[str, Any]:
    """Return what a successor needs for its first tick. Raises `PlainError` for a defect."""
    return {
        "format": FORMAT,
        "motor": motor.export(machine.motor),
        "control": control.export(machine.controller),
        "numbers": plain_of(service.memory()),
    }


def adopt(machine: Machine, service: RpcService, plain: Any) -> None:
    """Adopt the predecessor's state. Raises `PlainError` for a state of another version."""
    found = plain.get("format") if isinstance(plain, dict) else None
    if found != FORMAT:
        raise PlainError(f"the state has format {found}, this version takes over format {FORMAT}")
    if plain.keys() != {"format", "motor", "control", "numbers"}:
        raise PlainError("the state is not of this version")
    motor.adopt(machine.motor, machine.controller.gripper_id.can_id, plain["motor"])
    control.adopt(machine.controller, machine.motor.view(), plain["control"])
    service.restore(value_of(plain["numbers"], Numbers, "numbers"))


def export_history(machine: Machine, service: RpcService) -> dict[str, Any]:
    """Return the ended jobs; clients may still ask for them."""
    service.reporter.keep_ends()
    return {
        "jobs": control.export_jobs(machine.controller),
        "ends": service.reporter.memory(),
    }


def adopt_history(machine: Machine, service: RpcService, plain: Any) -> None:
    """Keep the predecessor's jobs. Raises `PlainError` for a history that cannot be used."""
    if not isinstance(plain, dict) or plain.keys() != {"jobs", "ends"}:
        raise PlainError("the history is not of this version")
    ends = value_of(plain["ends"], _ENDS, "ends")
    control.adopt_jobs(machine.controller, plain["jobs"])
    service.reporter.restore(ends)
