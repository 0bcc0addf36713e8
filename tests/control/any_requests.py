"""Whatever clients may ask for: requests, configurations and calibrations of every kind."""

from typing import Any, TypeAlias

from hypothesis import strategies as st

from litegripd.model.calibration import GIVEN_KEYS, NOMINAL, SUPERSEDED
from litegripd.model.gripper import DM4310, FASTEST_MM_S, STROKE_MM
from litegripd.model.motion_config import MotionConfig, ranges_of
from tests.trajectories import lgt, pieces

Values: TypeAlias = dict[str, Any]

RANGES = ranges_of(DM4310)
_DEFAULTS = MotionConfig().as_fields(0.0)
_LEVELS = st.sampled_from(["hold", "relax", "disable"])
_STEPS = st.sampled_from(["begin", "closed", "open", "finish", "cancel"])

NORMAL, REVERSE = (
    {
        "zero_position_rad": geometry.closed_rad,
        "max_position_rad": geometry.open_rad,
        "rad_to_mm": geometry.rad_to_mm,
    }
    for geometry in NOMINAL
)


def _field(name: str) -> st.SearchStrategy[tuple[str, float]]:
    low, high = RANGES[name]
    ends = st.sampled_from([low, high])
    values: st.SearchStrategy[float] = ends | st.floats(low, high)
    if isinstance(_DEFAULTS[name], int):
        values = ends.map(int) | st.integers(int(low), int(high))
    return st.tuples(st.just(name), values)


def go_together(fields: Values) -> bool:
    """True if fields that are in their ranges make a configuration."""
    all_fields = {**_DEFAULTS, **fields}
    return bool(all_fields["stop_lead_mm"] <= all_fields["max_lead_mm"])


def repaired(fields: Values) -> Values:
    """Make the fields go together that must."""
    all_fields = {**_DEFAULTS, **fields}
    lead_mm = min(all_fields["stop_lead_mm"], all_fields["max_lead_mm"])
    return {**fields, "stop_lead_mm": lead_mm}


any_fields = st.lists(st.sampled_from(sorted(RANGES)).flatmap(_field), max_size=4).map(dict)
good_fields = any_fields.map(repaired)

odd_contents: st.SearchStrategy[Values] = st.fixed_dictionaries(
    {
        "zero_position_rad": st.floats(-3.0, 3.0) | st.floats(-101.0, 101.0),
        "max_position_rad": st.floats(-3.0, 3.0),
        "rad_to_mm": st.sampled_from([0.001, NOMINAL[0].rad_to_mm, SUPERSEDED[0].rad_to_mm, 1e6]),
    },
    optional={
        "kp": st.floats(0.0, 500.0),
        "kd": st.floats(0.0, 5.0),
        "nm_to_n": st.floats(5.0, 30.0),
        "work_stroke_mm": st.floats(0.0, 100.0),
        "calibrated": st.booleans(),
        "mst_id": st.sampled_from([0, 24, "x", None, [], 1e300]),
        "channel": st.sampled_from(["can1", 5, None]),
    },
)
contents = st.sampled_from([NORMAL, REVERSE]) | odd_contents


def _call(name: str, *parts: st.SearchStrategy[Values]) -> st.SearchStrategy[tuple[str, Values]]:
    def joined(values: tuple[Values, ...]) -> tuple[str, Values]:
        return name, {key: value for part in values for key, value in part.items()}

    return st.tuples(*parts).map(joined)


def _may(**values: st.SearchStrategy[Any]) -> st.SearchStrategy[Values]:
    return st.fixed_dictionaries({}, optional=values)


def _must(**values: st.SearchStrategy[Any]) -> st.SearchStrategy[Values]:
    return st.fixed_dictionaries(values)


_none: st.SearchStrategy[Values] = st.just({})
_speed = st.sampled_from([0.1, 20.0, 50.0, FASTEST_MM_S]) | st.floats(0.1, FASTEST_MM_S)
_force = st.floats(0.5, DM4310.most_force_n)
_config = _none | _none | _none | _must(config=any_fields) | _must(config=good_fields)
_given = contents.map(lambda content: {key: content[key] for key in GIVEN_KEYS if key in content})
_config = _config | _must(calibration=_given)
_flags = _none | _may(wait=st.booleans(), detach=st.booleans(), progress=st.booleans())
_target = (
    _must(openness=st.floats(0.0, 1.0))
    | _must(opening_mm=st.floats(-5.0, 95.0))
    | _must(position_rad=st.floats(-2.0, 1.0))
)
_stroke = st.sampled_from([STROKE_MM, 90.0]) | st.floats(1.0, 1000.0)
_hold_by = st.sampled_from(["torque", "gains"])

_rate = st.sampled_from([1.0, 50.0, 200.0, 1000.0])
_samples = st.integers(1, 30)
_play = _may(
    speed=st.floats(0.1, 4.0),
    torque_nm=st.floats(0.3, 3.0),
    kp=st.floats(5.0, 500.0),
    kd=st.floats(0.1, 5.0),
    align=st.booleans(),
)
_passes = _none | _must(loop=st.booleans()) | _must(repeat=st.integers(1, 3))
_whole = lgt([(0.0, 0.3), (0.3, 0.5), (0.4, 0.5), (0.6, 0.2)])

trajectories = st.one_of(
    _call(
        "trajectory.record_start",
        _may(rate_hz=_rate, zero_gravity=st.booleans(), max_samples=_samples),
    ),
    _call(
        "trajectory.record_stop",
        _may(name=st.just("a"), allow_empty=st.booleans(), allow_partial=st.booleans()),
    ),
    _call("trajectory.put", st.just(pieces(_whole)[0]), _may(name=st.just("a"))),
    _call("trajectory.put", st.just(pieces(_whole)[0]), _must(name=st.just("a"))),
    _call("trajectory.play", _must(name=st.just("a")), _play, _passes, _config, _flags),
    _call("trajectory.play", _must(name=st.just("a")), _play, _passes),
    _call(
        "trajectory.play",
        _must(name=st.sampled_from(["tmp/upload-1", "tmp/upload-2"])),
        _play,
        _passes,
    ),
    _call("trajectory.control", _must(action=st.sampled_from(["pause", "resume"]))),
    _call("trajectory.control", _must(action=st.just("speed"), speed=st.floats(0.1, 4.0))),
    _call("trajectory.status"),
    _call("trajectory.delete", _must(name=st.just("a"))),
)

motions = st.one_of(
    _call("motion.open", _may(speed_mm_s=_speed), _config, _flags),
    _call("motion.close", _may(speed_mm_s=_speed), _config, _flags),
    _call(
        "motion.grasp",
        _may(force_n=_force, speed_mm_s=_speed, hold_by=_hold_by),
        _may(hold_s=st.sampled_from([0.0, 0.01, 1.0])),
        _config,
        _flags,
    ),
    _call(
        "motion.grasp",
        _must(until=st.just("verdict")),
        _may(force_n=_force, hold_by=_hold_by),
        _config,
    ),
    _call("motion.move", _target, _may(speed_mm_s=_speed), _config, _flags),
    _call("motion.move", _target, _must(duration_s=st.floats(0.01, 100.0)), _config, _flags),
    _call("motion.hold"),
    _call("motion.zero_gravity"),
    _call("motion.set_force", _must(force_n=_force), _config),
    _call(
        "stream.set",
        _target,
        _may(valid_s=st.floats(0.02, 2.0), speed_mm_s=_speed, torque_nm=st.floats(0.1, 3.0)),
    ),
    _call(
        "stream.set",
        _must(push_nm=st.sampled_from([0.0, 4.0, -4.0]) | st.floats(-4.5, 4.5)),
        _may(valid_s=st.floats(0.02, 2.0), calibration=_given),
    ),
    _call(
        "calibration.zero",
        _may(save=st.booleans(), mount=st.sampled_from(["normal", "reverse"]), stroke_mm=_stroke),
        _config,
        _flags,
    ),
    _call("calibration.manual", _must(step=_STEPS), _may(save=st.booleans(), stroke_mm=_stroke)),
)
power = st.one_of(
    _call("motor.enable", _may(on_lost=_LEVELS), _config),
    _call("motor.enable"),
    _call("motor.disable"),
    _call("motor.set_zero", _flags),
    _call("stop", _may(level=_LEVELS)),
    _call("stop.clear"),
    _call("stop.clear"),
    _call("job.cancel", _must(job=st.integers(1, 6))),
)
changes = st.one_of(
    _call("calibration.load", _may(template=st.sampled_from(["normal", "reverse"]))),
    _call("calibration.load", _must(content=contents)),
    _call("calibration.rescale", _may(stroke_mm=_stroke)),
    _call("calibration.save"),
    _call("calibration.get"),
    _call("config.set", _must(config=good_fields), _may(keep=st.booleans())),
    _call("config.set", _must(config=any_fields)),
    _call("motor.scan"),
    _call("motor.read_register", _must(register=st.sampled_from(["PMAX", "3", "99", "x"]))),
    _call("state.get"),
    _call("job.list"),
)
calls = st.one_of(motions, motions, power, changes)
"""Pairs of a method and its parameters."""
