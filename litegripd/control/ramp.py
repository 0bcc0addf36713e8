"""A straight ramp in time: its position follows from the clock alone, so no late tick slows it."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Ramp:
    """From `start_rad` at `began_s` to `target_rad` at `speed_rad_s` (above 0)."""

    began_s: float
    start_rad: float
    target_rad: float
    speed_rad_s: float

    @property
    def duration_s(self) -> float:
        """How long it takes."""
        return abs(self.target_rad - self.start_rad) / self.speed_rad_s

    def is_over(self, now_s: float) -> bool:
        """Whether the target is what it commands."""
        return now_s - self.began_s >= self.duration_s

    def at(self, now_s: float) -> tuple[float, float]:
        """Return the position (rad) and the velocity (rad/s) to be commanded."""
        if self.is_over(now_s):
            return self.target_rad, 0.0
        velocity_rad_s = self.speed_rad_s if self.target_rad > self.start_rad else -self.speed_rad_s
        return self.start_rad + velocity_rad_s * (now_s - self.began_s), velocity_rad_s
