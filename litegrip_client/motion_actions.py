"""The motions: to the stops, to a position, onto an object; and the ways of holding.

They request a motion and wait for its end; the daemon decides and moves.
"""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from typing import Literal

    from litegrip_client.base import ProgressCallback
    from litegrip_client.results import GraspResult, GripperState, MoveResult


class MotionActions(ActionBase):
    """What moves the jaws. `progress` gets a `MoveProgress` up to 20 times a second.

    An interrupt, or an error of the callback, cancels the motion before it is raised; the jaws
    then hold.
    """

    def open(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Open the jaws to the mechanical stop, at `speed_mm_s` or `motion_config`'s.

        A success is `ok` and `stalled`: pressed onto the stop. Raises as `GripperActions` does.
        """
        return wait(self._core.open(speed_mm_s, progress=progress))

    def close(
        self, speed_mm_s: float | None = None, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Close the jaws to the mechanical stop; everything as for `open`."""
        return wait(self._core.close(speed_mm_s, progress=progress))

    def grasp(
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
        """Close until an object stops the jaws, then hold it with `force_n`.

        `force_n`: 0.5 to 30 N, `motion_config.force_n` by default; approximate. `hold_s`: seconds
        until this returns; with 0 it does not return by itself while the object is held, and
        Ctrl-C ends the waiting. The jaws then continue to hold with the same force, until the
        next command or until the motor is disabled (the end of the `with` block disables it).
        With `until` "verdict" it returns as soon as it has detected an object or none, and
        `hold_s` must be left out.

        `speed_mm_s` is the closing speed, `motion_config.grasp_speed_mm_s` by default. With
        `width_mm`, `tolerance_mm` is required, too: an object whose width differs by more is
        still held, but `ok` is False.
        `hold_by` "gains" holds with `hold_kp` and `hold_kd` around a position, which loses force
        when the object yields.

        Without an object it returns at once, with `ok` False. Raises as `GripperActions` does.
        """
        return wait(
            self._core.grasp(
                force_n,
                hold_s,
                speed_mm_s=speed_mm_s,
                width_mm=width_mm,
                tolerance_mm=tolerance_mm,
                until=until,
                hold_by=hold_by,
                progress=progress,
            )
        )

    def goto(
        self,
        opening_mm: float,
        duration: float | None = 1.0,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to an opening between the fingers, in mm: 0 at the closed stop.

        `duration`: seconds; None moves at `motion_config.speed_mm_s`. A success is `reached` and
        not `stalled`. Raises as `GripperActions` does. A target outside the calibrated travel is
        a `CommandError`; its `data["limit"]` is the travel.
        """
        return wait(self._core.goto(opening_mm, duration, progress=progress))

    def goto_rad(
        self,
        position_rad: float,
        duration: float | None = 1.0,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a position of the motor, in rad; everything else as for `goto`."""
        return wait(self._core.goto_rad(position_rad, duration, progress=progress))

    def goto_openness(
        self,
        openness: float,
        duration: float | None = 1.0,
        *,
        progress: ProgressCallback | None = None,
    ) -> MoveResult:
        """Move to a share of the travel, 0 (closed) to 1 (open); all else as for `goto`."""
        return wait(self._core.goto_openness(openness, duration, progress=progress))

    def move_at_speed(
        self, opening_mm: float, speed_mm_s: float, *, progress: ProgressCallback | None = None
    ) -> MoveResult:
        """Move to an opening in mm at a speed; everything else as for `goto`."""
        return wait(self._core.move_at_speed(opening_mm, speed_mm_s, progress=progress))

    def set_force(self, force_n: float) -> GripperState:
        """Squeeze with `force_n` from now on, 0.5 to 30 N, ramped.

        It changes the force of a grasp, also while another thread of this program waits for
        that grasp. Without a grasp the jaws begin to squeeze at their present position.
        """
        return wait(self._core.set_force(force_n))

    def zero_gravity(self, on: bool = True) -> GripperState:
        """Let the jaws be moved freely by hand, the motor enabled but without any torque.

        They are loose until `zero_gravity(False)`, `hold` or any motion.
        """
        return wait(self._core.zero_gravity(on))

    def hold(self) -> GripperState:
        """Hold from now on: a held object with its present force, else the measured position."""
        return wait(self._core.hold())
