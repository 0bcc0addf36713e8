"""Fields of the SDK's values, by its names: what they show is in the values' own fields."""

from __future__ import annotations

import time

TYPE_CHECKING = False

STROKE_MM = 85.0
"""How far the jaws of the gripper that ships open, by a caliper."""
STALE_AFTER_S = 0.15
"""A disabled motor is asked 20 times a second. Three unanswered requests make its state stale."""
SPAN_INSET_MM = 1.0
"""A probe presses this far into the open stop: the two limits span the stroke and this."""
RAD_TO_MM = (STROKE_MM + SPAN_INSET_MM) / 1.14
"""The vendor's figure for a gripper that nobody calibrated; calibrated ones have 45 to 80."""
NM_TO_N = 10.0
"""N per N·m, unless a calibration has another figure: the vendor's, never measured."""

STILL_RAD_S = 0.05
"""Slower jaws count as still: three steps of the motor's reported velocity (30/2047 rad/s)."""


_STEPPED_S = 0.001
_LEADS_S = [0.0]
"""By how much the wall clock is ahead of CLOCK_MONOTONIC, as it was last found."""


def unix_time(monotonic_s: float) -> float:
    """Return the Unix time of a CLOCK_MONOTONIC time of this machine, by the clocks as they are.

    They are compared each time. A difference of less than a millisecond is the comparison's own.
    """
    before_s, wall_s, after_s = time.monotonic(), time.time(), time.monotonic()
    leads_s = wall_s - (before_s + after_s) / 2.0
    if abs(leads_s - _LEADS_S[0]) > _STEPPED_S + (after_s - before_s):
        _LEADS_S[0] = leads_s
    return _LEADS_S[0] + monotonic_s


class Hinting:
    """Names what was meant instead of a field that is not there."""

    __slots__ = ()

    if not TYPE_CHECKING:  # else a type checker would find every name here

        def __getattr__(self, name):
            """Raise the error; the fields of a `state` are looked through as well."""
            raise self._no_attribute(name)

        def _no_attribute(self, name):
            from litegrip_client.values.voices import no_attribute  # noqa: PLC0415 - an error

            return no_attribute(self, name, self._beyond())

        def _is_settable(self, name):
            """Return whether a name can be assigned; a subclass may have more."""
            return hasattr(type(self), name) or hasattr(self, "__dict__")

        def _beyond(self):
            return {}


class StateNames(Hinting):
    """Further names of a `GripperState`'s fields."""

    __slots__ = ()

    if TYPE_CHECKING:
        opening_mm: float | None
        driver_temperature_c: float | None
        coil_temperature_c: float | None
        feedback_s: float | None
        enabled: bool | None
        error_code: int | None
        mode: str
        motor: str
        velocity_rad_s: float | None

    @property
    def position_mm(self) -> float | None:
        """`opening_mm`: 0 closed."""
        return self.opening_mm

    @property
    def aperture_mm(self) -> float | None:
        """`opening_mm`: 0 closed."""
        return self.opening_mm

    @property
    def temperature_mos(self) -> float | None:
        """`driver_temperature_c`, in °C."""
        return self.driver_temperature_c

    @property
    def temperature_coil(self) -> float | None:
        """`coil_temperature_c`, in °C."""
        return self.coil_temperature_c

    @property
    def timestamp(self) -> float | None:
        """The Unix time of the motor's last feedback, in seconds; None if there never was any.

        By the clocks of this machine, which must be the daemon's, too. It follows a wall clock that
        is set; until then the same feedback has the same time, and a later one a later.
        """
        return None if self.feedback_s is None else unix_time(self.feedback_s)

    @property
    def is_enabled(self) -> bool:
        """True if the motor is known to be enabled."""
        return self.enabled is True

    @property
    def is_error(self) -> bool:
        """True if the motor reports a fault: a status other than disabled and enabled.

        What a disabled motor takes by itself while nobody uses it, `communication_lost` above all,
        is none: enabling clears it.
        """
        return self.motor != "disabled" and self.error_code not in (None, 0, 1)

    @property
    def is_zero_gravity(self) -> bool:
        """True if the jaws were let go, by `zero_gravity` or `stop`: the mode is "relaxed"."""
        return self.mode == "relaxed"

    @property
    def is_moving(self) -> bool:
        """True if the jaws move by 0.05 rad/s (2.6 mm/s at 52.69 mm/rad) or more."""
        return self.velocity_rad_s is not None and abs(self.velocity_rad_s) >= STILL_RAD_S


_WAYS = ("ramp", "press", "settle", "release", "approach")
"""Phases of the daemon's motions that the SDK calls "move"."""


class MoveNames(Hinting):
    """The SDK's name of a motion's phase."""

    __slots__ = ()

    if TYPE_CHECKING:
        stage: str

    @property
    def phase(self) -> str:
        """The phase, as the SDK names it."""
        return "move" if self.stage in _WAYS else self.stage


class CalibrationNames(Hinting):
    """Further names of a `CalibrationData`'s fields."""

    __slots__ = ()

    if TYPE_CHECKING:
        zero_position_rad: float
        max_position_rad: float
        travel_range_rad: float
        rad_to_mm: float

    @property
    def zero_position(self) -> float:
        """`zero_position_rad`: the closed limit."""
        return self.zero_position_rad

    @property
    def max_position(self) -> float:
        """`max_position_rad`: the open limit."""
        return self.max_position_rad

    @property
    def travel_range(self) -> float:
        """`travel_range_rad`."""
        return self.travel_range_rad

    @property
    def travel_mm(self) -> float:
        """The travel in mm."""
        return self.travel_range_rad * self.rad_to_mm

    @property
    def stroke_mm(self) -> float:
        """How far the jaws open with this scale, as a caliper measures it."""
        return self.travel_mm - SPAN_INSET_MM


class ConfigNames(Hinting):
    """What follows from a `GripperConfig`'s fields, and the SDK's names of some."""

    __slots__ = ()

    if TYPE_CHECKING:
        channel: str
        pos_closed_rad: float | None
        pos_open_rad: float | None
        rad_to_mm: float | None

    @property
    def can_channel(self) -> str:
        """`channel`."""
        return self.channel

    @property
    def close_sign(self) -> int | None:
        """+1 when closing increases radians, -1 otherwise; None until calibrated."""
        if self.pos_closed_rad is None or self.pos_open_rad is None:
            return None
        return 1 if self.pos_closed_rad > self.pos_open_rad else -1

    @property
    def mount(self) -> str | None:
        """Return "normal" when closing increases radians, "reverse" otherwise; None until then."""
        sign = self.close_sign
        return None if sign is None else "normal" if sign > 0 else "reverse"

    @property
    def travel_mm(self) -> float | None:
        """The calibrated travel in mm; None until calibrated."""
        if self.pos_closed_rad is None or self.pos_open_rad is None or self.rad_to_mm is None:
            return None
        return abs(self.pos_closed_rad - self.pos_open_rad) * self.rad_to_mm
