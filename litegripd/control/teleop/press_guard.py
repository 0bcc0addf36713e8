"""The follower's torque guard: what presses too hard for too long is let go of.

Times and thresholds are the vendor's SDK's, counted in seconds and not in cycles, so that they are
the same at every rate.
"""

TRIP_AFTER_S = 0.06
REARM_OPENNESS = 0.05
RELEASE_AT_LEAST_S = 0.2
"""So long it lets go in any case: a leader that stands at the open stop would else re-arm the guard
in the tick of its trip."""


class PressGuard:
    """Off with a limit of 0. While `is_tripped` the jaws must be free of stiffness and damping."""

    def __init__(self, limit_nm: float) -> None:
        self.is_tripped = False
        self.trips = 0
        self._limit_nm = limit_nm
        self._over_since_s: float | None = None
        self._tripped_s = 0.0
        self._rearm_openness = 0.0

    def step(self, now_s: float, torque_nm: float, openness: float) -> bool:
        """Take this tick's torque and the leader's openness; tell whether anything has changed.

        It re-arms once the leader has reopened by `REARM_OPENNESS` since the trip, or, near full
        open, where there is no such way left, once it is at the open stop.
        """
        if self._limit_nm <= 0.0:
            return False
        if self.is_tripped:
            rested = now_s - self._tripped_s >= RELEASE_AT_LEAST_S * 0.999
            if not rested or openness < self._rearm_openness:
                return False
            self.is_tripped, self._over_since_s = False, None
            return True
        if abs(torque_nm) < self._limit_nm:
            self._over_since_s = None
            return False
        if self._over_since_s is None:
            self._over_since_s = now_s
        if now_s - self._over_since_s < TRIP_AFTER_S * 0.999:
            return False
        self.is_tripped, self._tripped_s = True, now_s
        self.trips += 1
        self._rearm_openness = min(openness + REARM_OPENNESS, 1.0)
        return True
