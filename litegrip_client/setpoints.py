"""Set-points: targets that a program sends again and again, each valid for a short time only.

How the jaws follow is the daemon's.
"""

from __future__ import annotations

from types import TracebackType

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # importing dataclasses is slow
    from litegrip_client.core import setpoints as core


class SetpointStream:
    """A stream of targets for the jaws: `with gripper.stream() as stream:`.

    The latest target wins. When none comes for `valid_s`, and at the end of the block, the jaws
    hold where they are. Each object is for one thread.

    The first target, and one after a pause, waits for the daemon's answer; the others are sent
    without. What the daemon refuses of those is raised by one of the next calls, but for one that
    came too late: the jaws hold until the next one.
    """

    def __init__(self, stream: core.SetpointStream) -> None:
        self._stream = stream

    def set_target(
        self,
        opening_mm: float | None = None,
        *,
        position_rad: float | None = None,
        openness: float | None = None,
        torque_nm: float | None = None,
    ) -> None:
        """Send the jaws to exactly one of `opening_mm`, `position_rad` and `openness` (0 to 1).

        `torque_nm` is for this target what it is for the whole stream. Raises `CommandError` (a
        target outside the travel, another motion runs, ...) and all that motions raise.
        """
        wait(
            self._stream.set_target(
                opening_mm, position_rad=position_rad, openness=openness, torque_nm=torque_nm
            )
        )

    def close(self) -> None:
        """End the stream at once, so that the jaws hold; nothing to do when it ended by itself."""
        wait(self._stream.close())

    def __enter__(self) -> SetpointStream:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        wait(self._stream.__aexit__(kind, error, trace))


class SetpointActions(ActionBase):
    """What makes the jaws follow a program's targets."""

    def stream(
        self,
        valid_s: float = 0.2,
        *,
        speed_mm_s: float | None = None,
        torque_nm: float | None = None,
    ) -> SetpointStream:
        """Begin a stream of targets; the jaws do not move before the first `set_target`.

        `valid_s`: 0.02 to 2 s, after which the jaws hold unless a new target came. `speed_mm_s`
        is how fast they follow at most (`motion_config.speed_mm_s` by default), `torque_nm`, 0.1
        to 3 N·m, what they press with at most on what stands in their way (1 by default).
        """
        stream = self._core.stream(valid_s, speed_mm_s=speed_mm_s, torque_nm=torque_nm)
        return SetpointStream(stream)

    def send_mit_frame(
        self, position: float, velocity: float, kp: float, kd: float, torque: float
    ) -> bool:
        """Send a set-point for `position`, in rad, valid for 0.2 s; not a frame on the bus.

        The daemon's limits and gains stay in force: `velocity`, `kp` and `kd` are checked and
        then not used, |`torque`| above 1 N·m (at most 3) only lets the jaws press with up to so
        much, and they follow at `motion_config.speed_mm_s` at most.
        True when it is sent; a refusal is raised, perhaps by the next call. Raises
        `CommandError` with reason "unsupported" for `kp` 0, which asks for a torque, a speed or
        for nothing instead of a position: use `set_force`, `grasp`, `move_at_speed` or
        `zero_gravity`.
        """
        return wait(self._core.send_mit_frame(position, velocity, kp, kd, torque))
