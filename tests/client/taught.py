"""A trajectory with grips, for the tests of what goes with it."""

from litegrip_client import TaughtGrip, Trajectory
from tests.trajectories import lgt

CONTENT = lgt([(number / 100, (number % 100) / 100) for number in range(300)])
"""Two pieces long."""
GRIPS = (
    TaughtGrip(0.25, 0.5, 1.25, 0.5, 60.0, 8.0, "motion.grasp by demo"),
    TaughtGrip(1.25, 1.25, 2.99, 0.4, 48.0, 12.5, "motion.set_force by demo"),
)
PICK = Trajectory.from_bytes(CONTENT).with_grips(CONTENT, b"")


def with_grips(*grips: TaughtGrip) -> Trajectory:
    """Return the trajectory with these grips."""
    return Trajectory(
        PICK.samples, 100.0, PICK.created, PICK.pos_closed_rad, PICK.pos_open_rad, PICK.rad_to_mm,
        PICK.can_id, PICK.mount, grips,
    )  # fmt: skip


TAUGHT = with_grips(*GRIPS)
BESIDE = TAUGHT.grip_bytes()
