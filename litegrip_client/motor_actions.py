"""The motor by itself: enable and disable it, read it, move its zero. No motions here."""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from litegrip_client.results import EnableResult, SetZeroResult


class MotorActions(ActionBase):
    """The actions of the motor itself, not of the jaws."""

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor; true if its status says so.

        `retries`: enable commands at most, 1 to 20; None means `motion_config.enable_retries`.
        It takes the lease: until the end of the `with` block no other client moves the gripper.
        If this process ends without disabling the motor, the daemon disables it, or continues to
        hold, according to the present `disable_on_disconnect`. Raises `LeaseError`, which names
        the owner, when another client has the lease, `StoppedError` while a stop is latched and
        `HardwareError` when the motor or the bus does not work.
        """
        return wait(self._core.enable(retries))

    def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed."""
        return wait(self._core.disable())

    def clear_fault(self) -> str | None:
        """Clear the motor's latched fault; return its name. The motor stays disabled.

        None means that there was no fault. This also accepts a position that has jumped: check
        first where the jaws are. Raises `HardwareError` with a fault that cannot be cleared.
        """
        return wait(self._core.clear_fault())

    def read_param(self, register: str | int) -> float:
        """Read a register of the motor, by name ("PMAX") or number (21); nothing is written.

        Raises `CommandError` for one that is not known.
        """
        return wait(self._core.read_param(register))

    def set_zero(self) -> SetZeroResult:
        """Store the present position as the motor's zero, permanently; disables the motor first.

        The calibration is then invalid: motions are refused until the gripper is calibrated
        again, by `zero` or `manual_calibration`.
        """
        return wait(self._core.set_zero())
