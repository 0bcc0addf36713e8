"""The motor by itself: enable and disable it, read it, move its zero. No motions here."""

from __future__ import annotations

from litegrip_client.checks import integer
from litegrip_client.core.base import ActionBase
from litegrip_client.core.link import ACTION_TIMEOUT_S
from litegrip_client.errors import LiteGripError
from litegrip_client.results import EnableResult, SetZeroResult

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


class MotorActions(ActionBase):
    """What concerns the motor and not the jaws."""

    async def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor, and take the lease until the end of the block of the gripper."""
        link = self._link
        wire = link.wire
        params: dict[str, Any] = {}
        if retries is not None:
            params["retries"] = integer("retries", retries)
        call = wire.prepare_guarded("motor.enable", self._configured(params))
        await link.acquire(on_lost="disable" if link.disable_on_disconnect else "hold")
        before = link.enabled_here, link.keeps_lease
        link.enabled_here = link.keeps_lease = True  # or may be, also if the answer never comes
        try:
            result = EnableResult.from_wire(await wire.run(call, ACTION_TIMEOUT_S))
        except LiteGripError:
            if call.answered:
                await self._undo_enable(*before)
            raise
        if not result.ok:
            await self._undo_enable(*before)
        return result

    async def _undo_enable(self, was_enabled_here: bool, kept_lease: bool) -> None:
        self._link.enabled_here, self._link.keeps_lease = was_enabled_here, kept_lease
        await self._link.let_go()

    async def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed."""
        done = (await self._link.wire.call("motor.disable", None, ACTION_TIMEOUT_S))["ok"] is True
        if done:
            self._link.enabled_here = False
        return done

    async def clear_fault(self) -> str | None:
        """Clear the fault that the motor has latched; it stays disabled. Returns its name."""
        answer = await self._link.wire.call("motor.clear_fault", None, ACTION_TIMEOUT_S)
        self._link.enabled_here = False
        cleared: str | None = answer["cleared"]
        return cleared

    async def read_param(self, register: str | int) -> float:
        """Read a register of the motor, by name ("PMAX") or number (21); nothing is written."""
        name = register if isinstance(register, str) else str(integer("register", register))
        answer = await self._link.wire.call(
            "motor.read_register", {"register": name}, ACTION_TIMEOUT_S
        )
        value: float = answer["value"]
        return value

    async def set_zero(self) -> SetZeroResult:
        """Make the motor count from its present position, for good; disables it first."""
        answer = await self._command("motor.set_zero", {}, ACTION_TIMEOUT_S)
        result = SetZeroResult.from_wire(answer)
        if result.ok:
            self._link.enabled_here = False
        return result
