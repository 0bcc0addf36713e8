"""The motions: to the stops, to a position, onto an object; and the ways of holding.

They ask for a motion and wait for its end; what decides or moves is the daemon's.
"""

from __future__ import annotations

from litegrip_client.checks import given_numbers, number
from litegrip_client.core.base import ActionBase, ProgressCallback, state_of
from litegrip_client.results import GraspResult, GripperState, MoveResult

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any, Literal


class MotionActions(ActionBase):
    """What moves the jaws. `progress` gets a `MoveProgress` up to 20 times a second.

    An interrupt (KeyboardInterrupt, a cancelled task), or an error of the callback, cancels the
    motion before it is raised; the jaws then hold.
    """

    async def open(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Open the jaws to the mechanical stop, at `speed_mm_s` or `motion_config`'s."""
        return await self._move("motion.open", given_numbers(speed_mm_s=speed_mm_s), progress)

    async def close(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Close the jaws to the mechanical stop; everything as for `open`."""
        return await self._move("motion.close", given_numbers(speed_mm_s=speed_mm_s), progress)

    async def grasp(
        self,
        force_n: float | None = None,
        hold_s: float = 0.0,
        *,
        speed_mm_s: float | None = None,
        width_mm: float | None = None,
        tolerance_mm: float | None = None,
        until: Literal["held", "verdict"] = "held",
        hold_by: Literal["torque", "gains"] | None = None,
        progress: ProgressCallback | None = None,
    ) -> GraspResult:
        """Close until an object stops the jaws, then hold it with `force_n`, 0.5 to 30 N.

        It returns after `hold_s` seconds of holding (0: not by itself while the object is held),
        or at the verdict; in either case the jaws continue to hold.
        """
        params: dict[str, Any] = given_numbers(
            force_n=force_n,
            hold_s=hold_s,
            speed_mm_s=speed_mm_s,
            width_mm=width_mm,
            tolerance_mm=tolerance_mm,
        )
        if until != "held":
            params["until"] = until
            if hold_s == 0.0:  # the default, which the verdict does not go with
                del params["hold_s"]
        if hold_by is not None:
            params["hold_by"] = hold_by
        result = await self._run("motion.grasp", self._configured(params), progress)
        return GraspResult.from_wire(result)

    async def goto(
        self,
        opening_mm: float,
        duration: float | None = 1.0,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to an opening in mm within `duration` seconds, or at `motion_config.speed_mm_s`."""
        return await self._go(given_numbers(opening_mm=opening_mm, duration_s=duration), progress)

    async def goto_rad(
        self,
        position_rad: float,
        duration: float | None = 1.0,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a position of the motor, in rad; everything else as for `goto`."""
        values = given_numbers(position_rad=position_rad, duration_s=duration)
        return await self._go(values, progress)

    async def goto_openness(
        self,
        openness: float,
        duration: float | None = 1.0,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a share of the travel, 0 (closed) to 1 (open); all else as for `goto`."""
        return await self._go(given_numbers(openness=openness, duration_s=duration), progress)

    async def move_at_speed(
        self, opening_mm: float, speed_mm_s: float, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Move to an opening in mm at a speed; everything else as for `goto`."""
        values = given_numbers(opening_mm=opening_mm, speed_mm_s=speed_mm_s)
        return await self._go(values, progress)

    async def set_force(self, force_n: float) -> GripperState:
        """Squeeze with `force_n` from now on, 0.5 to 30 N, ramped; also during a grasp."""
        params = self._configured({"force_n": number("force_n", force_n)})
        return state_of(await self._command("motion.set_force", params))

    async def zero_gravity(self, on: bool = True) -> GripperState:
        """Let the jaws be moved freely by hand, until `zero_gravity(False)` or any motion."""
        return state_of(await self._command("motion.zero_gravity" if on else "motion.hold", {}))

    async def hold(self) -> GripperState:
        """Hold from now on: what is held already, with its force, else the measured position."""
        return state_of(await self._command("motion.hold", {}))

    async def _go(self, params: dict[str, Any], progress: ProgressCallback | None) -> MoveResult:
        return await self._move("motion.move", params, progress)

    async def _move(
        self, method: str, params: dict[str, Any], progress: ProgressCallback | None
    ) -> MoveResult:
        return MoveResult.from_wire(await self._run(method, self._configured(params), progress))
