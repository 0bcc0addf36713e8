"""The method that restarts the daemon while the jaws hold."""

from collections.abc import Callable
from dataclasses import asdict
from typing import TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.results import Restarted
from litegripd.rpc.method import Answer, Call, Deferred, Method
from litegripd.rpc.schema import Param

OnRestarted: TypeAlias = Callable[[Restarted | Refusal], None]
"""Gets the successor that has taken over, or the reason why none has."""

OnRestart: TypeAlias = Callable[[OnRestarted], Refusal | None]
"""Begins a restart, or returns a refusal."""

_PLAIN = Refusal(
    "invalid_params",
    "daemon.restart only holds through a restart (hold_through_restart true); a restart that"
    " disables the motor is done by the service manager: systemctl restart, or SIGTERM",
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
