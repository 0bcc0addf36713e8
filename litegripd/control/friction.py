"""The friction of closing jaws, as the motor's torque while they travel through free air."""

STEADY = (0.7, 1.3)
"""Shares of the commanded speed between which the jaws travel steadily."""
AVERAGE_S = 0.03
LARGEST_NM = 0.6
"""Four times what is usual; more is something that the jaws press on from the beginning."""
LARGE_NM = 0.45
"""Three times what is usual: where nothing was measured, no less is relied on."""

USUAL_NM = 0.15
"""An estimate; where nothing was measured, what bounds a speed counts on no more."""
ASSUMED_NM = 0.3
"""Twice as much; where nothing was measured, what lets go of no object counts on no less."""


class FrictionGauge:
    """Takes torques of a free travel; the smallest mean over `AVERAGE_S` counts.

    Something soft that the jaws press on while they still travel takes torque, too: its part of
    the way is not the smallest.
    """

    def __init__(self) -> None:
        self._began_s: float | None = None
        self._sum_nm = 0.0
        self._count = 0
        self._least_nm: float | None = None

    @property
    def friction_nm(self) -> float | None:
        """The friction, at least 0; None where the jaws have not travelled freely long enough."""
        least_nm = self._least_nm
        return None if least_nm is None or least_nm > LARGEST_NM else max(least_nm, 0.0)

    def add(self, now_s: float, speed_share: float, torque_nm: float) -> None:
        """Take the torque at a share of the commanded speed."""
        if not STEADY[0] <= speed_share <= STEADY[1]:
            self._began_s = None
            return
        if self._began_s is None:
            self._began_s, self._sum_nm, self._count = now_s, 0.0, 0
        self._sum_nm += torque_nm
        self._count += 1
        if now_s - self._began_s < AVERAGE_S * 0.999:
            return
        mean_nm = self._sum_nm / self._count
        self._least_nm = mean_nm if self._least_nm is None else min(self._least_nm, mean_nm)
        self._began_s = None
