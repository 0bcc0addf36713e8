"""The motor by itself: enable and disable it, read it, move its zero. No motions here."""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
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
        return wait(self._core.enable(retries))

    def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed."""
        return wait(self._core.disable())

    def clear_fault(self) -> str | None:
        """Clear the fault that the motor has latched; it stays disabled. Returns its name.

        None means that there was no fault. Accepts a position that has jumped, too: look where
        the jaws are first. Raises `HardwareError` with the fault that does not go.
        """
        return wait(self._core.clear_fault())

    def read_param(self, register: str | int) -> float:
        """Read a register of the motor, by name ("PMAX") or number (21); nothing is written.

        Raises `CommandError` for one that is not known.
        """
        return wait(self._core.read_param(register))

    def set_zero(self) -> SetZeroResult:
        """Make the motor count from its present position, for good; disables it first.

        The calibration no longer fits then: motions are refused until the gripper is calibrated
        anew, by `zero` or `manual_calibration`.
        """
        return wait(self._core.set_zero())
