"""`MotionConfig`: how one `LiteGrip` object wants its motions, with the vendor SDK's names.

Each call sends only the fields that the program set. The daemon has defaults for the others and
checks the ranges.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import TYPE_CHECKING, Any

from litegrip_client.values.checks import RANGES, UnsetFloat, integer, number, range_of, wrong
from litegrip_client.values.errors import CommandError, ParameterError
from litegrip_client.values.fields import Hinting
from litegrip_client.values.tracebacks import shortened


class _Int(int):
    """As `UnsetFloat`, for the whole numbers."""

    __slots__ = ()


@shortened
@dataclass(slots=True)
class MotionConfig(Hinting):
    """The tunables of the motions; they count for the calls of the object that has them.

    A field that was set, by the constructor or by assignment, is sent with every call, also when
    it is set to the value that it has already. A field that was not set is the daemon's
    (`config.set` of the protocol changes it), and reading it shows the vendor's default: the
    daemon may have another one. `del` unsets a field.

    Units are in the names, or: `margin` and `press_overshoot` are shares of the travel,
    `stall_ratio` one of the expected distance; `reach_tol`, `stall_delta`, `stop_tol` and
    `calib_stall_delta` radians; `settle_s` and what ends in `_interval` seconds; gains
    N·m/rad (`kp`) and N·m·s/rad (`kd`); `calib_tau_limit` N·m. `force_rate_n_s` is how fast a
    force is ramped, `force_ramp_n_s` the vendor's name of it; what begins with `stop_` and is not
    a lead or a tolerance belongs to the torque guard of open and close.

    `frame_interval` is the daemon's control period and `stop_speed_ratio` its guard's: they cannot
    be changed from here. `sleep_fn` and `monotonic_fn` have no effect across a process. So only
    their defaults are accepted.
    Raises `CommandError` for those, and for what is no finite number, or negative, or 0 where that
    can never be. The daemon refuses any other value out of its range when it is used: how much may
    be depends on the gripper.
    """

    speed_mm_s: float = UnsetFloat(50.0)
    grasp_speed_mm_s: float = UnsetFloat(50.0)
    margin: float = UnsetFloat(0.05)
    frame_interval: float = UnsetFloat(0.005)
    sample_interval: float = UnsetFloat(0.05)
    settle_s: float = UnsetFloat(0.3)
    reach_tol: float = UnsetFloat(0.02)
    stall_cycles: int = _Int(5)
    stall_ratio: float = UnsetFloat(0.2)
    stall_delta: float = UnsetFloat(0.0015)
    max_lead_mm: float = UnsetFloat(4.0)
    press_overshoot: float = UnsetFloat(0.05)
    press_zone_mm: float = UnsetFloat(2.0)
    stop_lead_mm: float = UnsetFloat(0.7)
    stop_tol: float = UnsetFloat(0.02)
    force_n: float = UnsetFloat(20.0)
    hold_interval: float = UnsetFloat(0.2)
    hold_kp: float = UnsetFloat(150.0)
    hold_kd: float = UnsetFloat(2.0)
    enable_retries: int = _Int(3)
    enable_retry_interval: float = UnsetFloat(0.2)
    calib_kp: float = UnsetFloat(20.0)
    calib_kd: float = UnsetFloat(2.0)
    calib_step_rad: float = UnsetFloat(0.05)
    calib_tau_limit: float = UnsetFloat(2.0)
    calib_stall_delta: float = UnsetFloat(0.0015)
    calib_stall_cycles: int = _Int(5)
    calib_max_iter: int = _Int(200)
    sleep_fn: Callable[[float], None] | None = field(default=time.sleep, repr=False)
    monotonic_fn: Callable[[], float] | None = field(default=time.monotonic, repr=False)
    force_rate_n_s: float = field(default=UnsetFloat(20.0), kw_only=True)
    stop_torque_nm: float = field(default=UnsetFloat(0.7), kw_only=True)
    stop_torque_cycles: int = field(default=_Int(3), kw_only=True)
    stop_release_s: float = field(default=UnsetFloat(0.2), kw_only=True)
    stop_speed_ratio: float = field(default=UnsetFloat(0.5), kw_only=True)
    force_ramp_n_s: float = field(default=UnsetFloat(20.0), kw_only=True)

    if not TYPE_CHECKING:  # with it, a type checker would allow any name

        def __setattr__(self, name, value):
            """Check what is set; `CommandError` says what is wrong with it."""
            if not self._is_settable(name):
                raise self._no_attribute(name)
            if name in _DEFAULTS:
                value = _checked(name, value)
            if name not in _ONE:
                object.__setattr__(self, name, value)
            elif not (_is_unset(value) and hasattr(self, name)):  # the other name has set it
                for each in _ONE:
                    object.__setattr__(self, each, value)

        def __delattr__(self, name):
            """Unset a field."""
            if name not in _DEFAULTS:
                raise self._no_attribute(name)
            for each in _ONE if name in _ONE else (name,):
                object.__setattr__(self, each, _DEFAULTS[each])

    def __str__(self) -> str:
        """Tell what is set, which is sent, from what is not."""
        given = self.to_wire()
        told = [f"{name}={getattr(self, name):g}" for name in DAEMON_FIELDS if name in given]
        rest = [f"{name}={getattr(self, name):g}" for name in DAEMON_FIELDS if name not in given]
        return (
            f"set here, and sent: {', '.join(told) or 'nothing'}\n"
            f"not set, so as the daemon has it (by default: {', '.join(rest)})"
        )

    def to_wire(self) -> dict[str, float]:
        """Return the fields that were set: what is sent as `config`."""
        values = {name: getattr(self, name) for name in DAEMON_FIELDS}
        return {name: value for name, value in values.items() if not _is_unset(value)}


_DEFAULTS = {one.name: one.default for one in fields(MotionConfig)}
_NUMBERS = tuple(name for name in _DEFAULTS if not name.endswith("_fn"))
_ONE = ("force_rate_n_s", "force_ramp_n_s")
"""Two names of one tunable; the first is the daemon's."""
DAEMON_FIELDS = tuple(
    name for name in _NUMBERS if name not in ("force_ramp_n_s", "stop_speed_ratio")
)
"""The fields that the daemon has, too."""
_MAY_BE_ZERO = frozenset(
    ("margin", "settle_s", "press_overshoot", "press_zone_mm", "hold_kp", "stop_release_s")
)
_READ_ONLY = {
    "frame_interval": (
        "it is the daemon's control period and read-only",
        "the daemon's configuration sets it, for all clients: rate_hz in [control]",
    ),
    "stop_speed_ratio": (
        "it is the daemon's and read-only",
        "stop_torque_nm and stop_torque_cycles tune the torque guard",
    ),
}


def _is_unset(value: object) -> bool:
    return isinstance(value, UnsetFloat | _Int)


def _checked(name: str, value: Any) -> Any:
    default: Any = _DEFAULTS[name]
    if name not in _NUMBERS:
        if value is None or value is default:
            return default
        raise _unsupported(
            name,
            f"{name} has no effect here: the motions run in the daemon, by its own clock",
            "to try a program without hardware, let the daemon simulate: litegripd --simulate",
        )
    if _is_unset(value) and value == default:
        return value  # of another MotionConfig, so that a copy of it sends no more than it does
    try:
        result = (integer if isinstance(default, _Int) else number)(name, value)
    except ParameterError as error:
        if value is None:
            error.data["hint"] = f"to unset it: del gripper.motion_config.{name}"
        raise
    if result < 0.0 or (result == 0.0 and name not in _MAY_BE_ZERO):
        least = "0 or more" if name in _MAY_BE_ZERO else "more than 0"
        allowed = f"{range_of(name)} {RANGES[name][-1]}" if name in RANGES else least
        raise wrong(name, f"is {result:g}, it must be {allowed}")
    if name in _READ_ONLY and result != default:
        why, hint = _READ_ONLY[name]
        raise _unsupported(name, f"{name} cannot be {result:g}: {why}", hint)
    return result


def _unsupported(name: str, message: str, hint: str) -> CommandError:
    return CommandError(message, reason="unsupported", data={"parameter": name, "hint": hint})
