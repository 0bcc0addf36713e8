import copy
import dataclasses
import pickle
import time
from typing import Any

import pytest

from litegrip_client import CommandError, LiteGrip, MotionConfig, ParameterError
from litegrip_client.values.checks import RANGES
from litegrip_client.values.motion_config import DAEMON_FIELDS
from litegripd.model.errors import unit_of
from litegripd.model.motion_config import WIDEST as DAEMONS_RANGES
from litegripd.model.motion_config import MotionConfig as DaemonsConfig

NUMBERS = DAEMON_FIELDS


def test_it_has_the_fields_and_defaults_of_the_daemon() -> None:
    ours = {name: getattr(MotionConfig(), name) for name in NUMBERS}
    assert ours.pop("frame_interval") == 0.005
    assert ours == dataclasses.asdict(DaemonsConfig())
    for name, value in dataclasses.asdict(DaemonsConfig()).items():
        assert isinstance(ours[name], type(value))


def test_the_vendors_fields_can_be_given_by_position() -> None:
    config = MotionConfig(25.0, 30.0, 0.1)
    assert (config.speed_mm_s, config.grasp_speed_mm_s, config.margin) == (25.0, 30.0, 0.1)
    assert (config.sleep_fn, config.monotonic_fn) == (time.sleep, time.monotonic)


def test_only_what_was_set_is_sent() -> None:
    assert MotionConfig().to_wire() == {}
    config = MotionConfig(speed_mm_s=25.0)
    assert config.to_wire() == {"speed_mm_s": 25.0}
    config.force_n = 5
    config.stall_cycles = 7
    assert config.to_wire() == {"speed_mm_s": 25.0, "stall_cycles": 7, "force_n": 5.0}


@pytest.mark.parametrize(
    ("name", "value"), [("force_n", 5.0), ("stall_cycles", 7), ("force_ramp_n_s", 9.0)]
)
def test_what_is_deleted_was_never_set(name: str, value: float) -> None:
    config = MotionConfig(speed_mm_s=25.0)
    setattr(config, name, value)
    with pytest.raises(CommandError, match="is None, it must be") as caught:
        setattr(config, name, None)
    assert str(caught.value).endswith(f"to unset it: del gripper.motion_config.{name}")
    delattr(config, name)
    delattr(config, name)
    assert config.to_wire() == {"speed_mm_s": 25.0}
    assert getattr(config, name) == getattr(MotionConfig(), name)
    with pytest.raises(AttributeError, match="did you mean"):
        delattr(config, name[:-2])


def test_what_was_set_to_the_default_is_sent_too() -> None:
    config = MotionConfig(speed_mm_s=50.0, frame_interval=0.005)
    config.stall_cycles = 5
    assert config.to_wire() == {"speed_mm_s": 50.0, "frame_interval": 0.005, "stall_cycles": 5}
    assert config == MotionConfig()
    assert repr(config) == repr(MotionConfig())


@pytest.mark.parametrize(
    "make",
    [
        copy.copy,
        copy.deepcopy,
        dataclasses.replace,
        lambda config: pickle.loads(pickle.dumps(config)),
        lambda config: MotionConfig(**{name: getattr(config, name) for name in NUMBERS}),
    ],
)
def test_a_copy_sends_the_same(make: Any) -> None:
    config = MotionConfig(force_n=20.0, stop_torque_cycles=3)
    assert make(config).to_wire() == {"force_n": 20.0, "stop_torque_cycles": 3}


def test_the_default_of_another_field_is_a_number_like_any_other() -> None:
    config = MotionConfig()
    config.force_n = config.speed_mm_s
    config.speed_mm_s = config.grasp_speed_mm_s * 2.0
    assert config.to_wire() == {"speed_mm_s": 100.0, "force_n": 50.0}


@pytest.mark.parametrize(
    ("name", "value", "what"),
    [
        ("speed_mm_s", "25", "is '25', it must be a number"),
        ("speed_mm_s", None, "is None, it must be a number"),
        ("speed_mm_s", True, "is True, it must be a number"),
        ("speed_mm_s", float("nan"), "is nan, it must be a finite number"),
        ("force_n", float("inf"), "is inf, it must be a finite number"),
        ("force_n", 10**400, "it must be a number"),
        ("stall_cycles", 5.0, r"is 5\.0, it must be a whole number"),
        ("calib_max_iter", False, "is False, it must be a whole number"),
    ],
)
def test_what_no_field_can_hold_is_refused_where_it_is_set(
    name: str, value: Any, what: str
) -> None:
    config = MotionConfig(force_n=7.0)
    with pytest.raises(CommandError, match=f"{name} .*{what}") as caught:
        setattr(config, name, value)
    assert (caught.value.reason, caught.value.data["parameter"]) == ("invalid_params", name)
    with pytest.raises(CommandError):
        MotionConfig(**{name: value})
    assert config.to_wire() == {"force_n": 7.0}


@pytest.mark.parametrize("name", NUMBERS)
def test_what_no_gripper_can_do_is_refused_where_it_is_set(name: str) -> None:
    config = MotionConfig()
    kind = int if isinstance(getattr(config, name), int) else float
    least = DAEMONS_RANGES.get(name, (0.005, 0.005))[0]
    for value in (-1, 0) if least > 0 else (-1,):
        with pytest.raises(CommandError, match=f"{name} is {value}, it must be ") as caught:
            setattr(config, name, kind(value))
        assert caught.value.data["parameter"] == name
    assert config.to_wire() == {}
    setattr(config, name, kind(least))
    assert config.to_wire() == {name: least}


def test_it_prints_what_is_set_and_what_is_not() -> None:
    set_here, others = str(MotionConfig(force_n=5.0, stall_cycles=5)).splitlines()
    assert set_here == "set here, and sent: stall_cycles=5, force_n=5"
    assert others.startswith("not set, so as the daemon has it (by default: speed_mm_s=50, ")
    assert "force_n" not in others
    assert str(MotionConfig()).startswith("set here, and sent: nothing\n")


def test_numbers_of_other_libraries_become_plain_ones() -> None:
    class Single:
        """As numpy's float32: a number, but no float."""

        def __float__(self) -> float:
            return 0.5

    class Short:
        def __index__(self) -> int:
            return 9

    config = MotionConfig(margin=Single(), stall_cycles=Short())  # type: ignore[arg-type]
    assert [type(value) for value in config.to_wire().values()] == [float, int]


def test_the_period_is_the_daemons() -> None:
    config = MotionConfig()
    for change in (
        lambda: setattr(config, "frame_interval", 0.01),
        lambda: MotionConfig(frame_interval=0.001),
    ):
        with pytest.raises(CommandError, match="the daemon's control period and read-only") as e:
            change()
        assert (e.value.reason, "rate_hz" in str(e.value)) == ("unsupported", True)
    assert config.frame_interval == 0.005


def test_clocks_have_no_place_across_a_process() -> None:
    config = MotionConfig(sleep_fn=None, monotonic_fn=time.monotonic)
    config.sleep_fn = time.sleep
    assert config.to_wire() == {}
    assert config == MotionConfig()
    for name in ("sleep_fn", "monotonic_fn"):
        with pytest.raises(CommandError, match=f"{name} has no effect here") as caught:
            setattr(config, name, lambda *_: 0.0)
        assert (caught.value.reason, "--simulate" in str(caught.value)) == ("unsupported", True)
    with pytest.raises(CommandError, match="sleep_fn"):
        MotionConfig(sleep_fn=lambda _: None)


def test_what_can_never_be_is_refused_with_the_range_where_that_is_known() -> None:
    for name in RANGES.keys() & NUMBERS:
        least, most = DAEMONS_RANGES[name]
        assert RANGES[name] == (least, most, unit_of(name).strip())
        told = f"{least:g} to {most:g}{unit_of(name)}"
        for value in (-5, 0):
            with pytest.raises(ParameterError) as caught:
                setattr(MotionConfig(), name, value)
            assert caught.value.message == f"{name} is {value}, it must be {told}"
    with pytest.raises(ParameterError, match=r"^reach_tol is 0, it must be more than 0$"):
        MotionConfig(reach_tol=0.0)


def test_a_field_that_does_not_exist_cannot_be_set() -> None:
    with pytest.raises(AttributeError, match="speed"):
        MotionConfig().speed = 25.0  # type: ignore[attr-defined]
    with pytest.raises(TypeError, match="speed"):
        MotionConfig(speed=25.0)  # type: ignore[call-arg]


def test_something_else_is_refused() -> None:
    with pytest.raises(CommandError, match="motion_config is 25, it must be a MotionConfig"):
        LiteGrip(motion_config=25)  # type: ignore[arg-type]
    gripper = LiteGrip()
    with pytest.raises(CommandError, match="must be a MotionConfig"):
        gripper.motion_config = {"speed_mm_s": 25.0}  # type: ignore[assignment]
    assert gripper.motion_config.to_wire() == {}
