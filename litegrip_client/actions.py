"""The low-level actions, for whoever builds another driver layer on top.

`LiteGrip` forwards to these. They report by results, progress callbacks and exceptions and
print nothing.
"""

from __future__ import annotations

from collections.abc import Callable

from litegrip_client.errors import LiteGripError
from litegrip_client.link import ACTION_TIMEOUT_S, Link
from litegrip_client.motions import Motion

TYPE_CHECKING = False
if TYPE_CHECKING:  # dataclasses takes longer to import than all the rest of the client
    from typing import Any, TypeAlias

    from litegrip_client.results import EnableResult, MoveProgress, MoveResult

ProgressCallback: TypeAlias = "Callable[[MoveProgress], None]"


class GripperActions:
    """Enable, disable, open and close the gripper at the other end of a link."""

    def __init__(self, link: Link) -> None:
        self._link = link

    def enable(self, retries: int | None = None) -> EnableResult:
        """Enable the motor; true if its status says so.

        `retries`: enable commands at most, 1 to 20; None leaves it to the daemon. The daemon
        disables the motor when this process ends without having done so, or goes on holding,
        as `disable_on_disconnect` says now. Raises `StoppedError` while a stop is latched and
        `HardwareError` when motor or bus do not work.
        """
        from litegrip_client.results import EnableResult  # noqa: PLC0415 - see above

        link = self._link
        connection = link.connection
        on_lost = "disable" if link.disable_on_disconnect else "hold"
        params: dict[str, Any] = {"on_lost": on_lost}
        if retries is not None:
            params["retries"] = retries
        before = link.enabled_here, link.on_lost
        # From now on it may be enabled by us, also if the answer never comes.
        link.enabled_here, link.on_lost = True, on_lost
        call = connection.prepare_guarded("motor.enable", params)
        try:
            result = EnableResult.from_wire(connection.run(call, ACTION_TIMEOUT_S))
        except LiteGripError:
            if call.answered:
                link.enabled_here, link.on_lost = before
            raise
        if not result.ok:
            link.enabled_here, link.on_lost = before
        return result

    def disable(self) -> bool:
        """Disable the motor: no torque, the jaws can be moved by hand. True if confirmed."""
        done = self._link.connection.call("motor.disable", None, ACTION_TIMEOUT_S)["ok"] is True
        if done:
            self._link.enabled_here = False
        return done

    def open(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Open the jaws to the mechanical stop, at `speed_mm_s` or the daemon's default.

        `progress` is called in this thread, at most 20 times a second. An interrupt cancels the
        motion before it is raised; the jaws then hold. Raises `CommandError` (not calibrated,
        a speed out of range), `BusyError`, `StoppedError`, `CancelledError`, `HardwareError`.
        """
        return self._move("motion.open", speed_mm_s, progress)

    def close(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Close the jaws to the mechanical stop; everything as for `open`."""
        return self._move("motion.close", speed_mm_s, progress)

    def _move(
        self, method: str, speed_mm_s: float | None, progress: ProgressCallback | None
    ) -> MoveResult:
        from litegrip_client.results import MoveProgress, MoveResult  # noqa: PLC0415 - see above

        connection = self._link.connection
        params = {} if speed_mm_s is None else {"speed_mm_s": float(speed_mm_s)}

        def report(data: dict[str, Any]) -> None:
            if progress is not None:
                progress(MoveProgress.from_wire(data))

        return MoveResult.from_wire(Motion(connection, method, params, report).run())
