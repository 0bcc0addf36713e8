"""The method by which the daemon is restarted without letting go of what the jaws hold."""

from collections.abc import Callable, Mapping
from dataclasses import asdict
from typing import TypeAlias

from litegripd.model.errors import Refusal
from litegripd.model.results import Restarted
from litegripd.rpc.calls import Answer, Call, Deferred, Function

OnRestarted: TypeAlias = Callable[[Restarted | Refusal], None]
"""Is told which successor has taken over, or why none has."""

OnRestart: TypeAlias = Callable[[OnRestarted], Refusal | None]
"""Begins a restart, or says at once why there is none."""

_PLAIN = Refusal(
    "invalid_params",
    "daemon.restart only holds through a restart (hold_through_restart true); a restart that"
    " disables the motor is done by the service manager: systemctl restart, or SIGTERM",
    {"parameter": "hold_through_restart"},
)


def no_restart(_on_restarted: OnRestarted) -> Refusal | None:
    """Refuse: there is no process to be followed by another."""
    return Refusal("restart_failed", "this daemon cannot start a successor")


class Restarting:
    """The function of `daemon.restart`."""

    def __init__(self, restart: OnRestart) -> None:
        self._restart = restart

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {"daemon.restart": self._begin}

    def _begin(self, call: Call) -> Answer:
        if not call.params["hold_through_restart"]:
            return _PLAIN
        deferred = Deferred()

        def restarted(outcome: Restarted | Refusal) -> None:
            deferred.resolve(outcome if isinstance(outcome, Refusal) else asdict(outcome))

        return self._restart(restarted) or deferred
