"""The motor by itself: enable and disable it, read it, move its zero. No motions here."""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.checks import integer
from litegrip_client.errors import LiteGripError
from litegrip_client.link import ACTION_TIMEOUT_S

TYPE_CHECKING = False
if TYPE_CHECKING:  # dataclasses takes longer to import than all the rest of the client
    from typing import Any

    from litegrip_client.results import EnableResult, SetZeroResult


class MotorActions(ActionBase):
    """What concerns the motor and not the jaws."""

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor; true if its status says so.

        `retries`: enable commands at most, 1 to 20; None means `motion_config.enable_retries`.
        It takes the lease: until the end of the `with` block nobody else moves the gripper.
        The daemon disables the motor when this process ends without having done so, or goes on
        holding, as `disable_on_disconnect` says now. Raises `LeaseError` when another client has
        the lease (it names it), `StoppedError` while a stop is latched and `HardwareError` when
        motor or bus do not work.
        """
        from litegrip_client.results import EnableResult  # noqa: PLC0415 - see above

        link = self._link
        connection = link.connection
        params: dict[str, Any] = {}
        if retries is not None:
            params["retries"] = integer("retries", retries)
        call = connection.prepare_guarded("motor.enable", self._configured(params))
        before = link.enabled_here, link.leased
        link.acquire(on_lost="disable" if link.disable_on_disconnect else "hold")
        link.enabled_here = True  # or may be, also if the answer never comes
        try:
            result = EnableResult.from_wire(connection.run(call, ACTION_TIMEOUT_S))
        except LiteGripError:
            if call.answered:
                self._undo_enable(*before)
            raise
        if not result.ok:
            self._undo_enable(*before)
        return result

    def _undo_enable(self, was_enabled_here: bool, was_leased: bool) -> None:
        self._link.enabled_here = was_enabled_here
        if not was_leased:
            self._link.release()

    def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed."""
        done = self._link.connection.call("motor.disable", None, ACTION_TIMEOUT_S)["ok"] is True
        if done:
            self._link.enabled_here = False
        return done

    def read_param(self, register: str | int) -> float:
        """Read a register of the motor, by name ("PMAX") or number (21); nothing is written.

        Raises `CommandError` for one that is not known.
        """
        name = register if isinstance(register, str) else str(integer("register", register))
        answer = self._link.connection.call(
            "motor.read_register", {"register": name}, ACTION_TIMEOUT_S
        )
        value: float = answer["value"]
        return value

    def set_zero(self) -> SetZeroResult:
        """Make the motor count from its present position, for good; disables it first.

        The calibration no longer fits then: motions are refused until the gripper is calibrated
        anew, by `zero` or `manual_calibration`.
        """
        from litegrip_client.results import SetZeroResult  # noqa: PLC0415 - see above

        result = SetZeroResult.from_wire(self._command("motor.set_zero", {}, ACTION_TIMEOUT_S))
        if result.ok:
            self._link.enabled_here = False
        return result
