"""Each public name of the SDK is here, with its arguments; what cannot work raises and says why."""

import inspect
from typing import Any

import pytest

import litegrip_client
from docs.sdk_surface import EXPORTS, FIELDS, MEMBERS, export_refusal, member_refusal
from litegrip_client import (
    CommandError,
    HardwareError,
    LiteGrip,
    LiteGripError,
    MotionConfig,
    TeleopTransport,
    TrajectoryError,
)

CONNECTION = ("channel", "can_id")
SIGNATURES: dict[str, str] = {
    "goto": "position_mm kp=None kd=None duration=0.5",
    "goto_rad": "position_rad kp=None kd=None dq_target=0.0 tau_feedforward=0.0 duration=0.5",
    "move_to": "target_rad kp=None kd=None tau_feedforward=0.0 duration=1.0",
    "move_at_speed": "target_mm speed_mm_s=30.0 kp=None kd=None",
    "move_at_speed_rad": "target_rad speed_rad_s=0.5 kp=None kd=None",
    "send_mit_frame": "q kp kd dq=0.0 tau=0.0",
    "set_force": "force_n duration=0.3",
    "open": "speed_mm_s=None",
    "close": "speed_mm_s=None",
    "grasp": "force_n=None hold_s=0.0",
    "stop": "",
    "connect": "",
    "get_state": "wait=True",
    "poll": "timeout_s=0.0",
    "enter_zero_gravity": "duration=0.0",
    "exit_zero_gravity": "",
    "calibrate": (
        "kp=None kd=None step_rad=None stall_delta=None stall_cycles=None max_iter=None"
        " tau_limit=None"
    ),
    "calibrate_guided": (
        "kp=None kd=None step_rad=None stall_delta=None stall_cycles=None max_iter=None"
        " tau_limit=None"
    ),
    "calibrate_manual": "duration=30.0 settle_time=2.0 sample_interval=0.01",
    "wait_for_ready": "timeout=5.0",
    "clear_fault": "",
    "record": "duration_s rate_hz=100.0 zero_gravity=True",
    "record_start": "rate_hz=100.0 zero_gravity=True max_samples=None",
    "record_stop": "allow_empty=False",
    "play": "trajectory speed=1.0 kp=None kd=None align=True",
    "play_start": "trajectory speed=1.0 kp=None kd=None loop=False align=True",
    "play_stop": "timeout=2.0",
    "teleop_start": "mode host=None",
    "teleop_stop": "timeout=2.0",
}
"""What the SDK's methods take by position, in its order, with its defaults."""


def by_position(function: Any) -> str:
    parameters = list(inspect.signature(function).parameters.values())[1:]
    return " ".join(
        one.name if one.default is one.empty else f"{one.name}={one.default}"
        for one in parameters
        if one.kind is one.POSITIONAL_OR_KEYWORD
    )


@pytest.mark.parametrize("name", EXPORTS)
def test_an_export_is_here(name: str) -> None:
    assert getattr(litegrip_client, name) is not None
    assert name in litegrip_client.__all__


@pytest.mark.parametrize("name", MEMBERS)
def test_a_member_is_here_and_is_said_to_do_something(name: str) -> None:
    assert inspect.getdoc(inspect.getattr_static(LiteGrip, name))


@pytest.mark.parametrize("name", SIGNATURES)
def test_a_method_takes_the_sdks_arguments_in_its_order(name: str) -> None:
    assert by_position(getattr(LiteGrip, name)) == SIGNATURES[name]


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in FIELDS for name in FIELDS[kind]]
)
def test_a_field_is_here(kind: Any, name: str) -> None:
    assert hasattr(kind, name) or name in kind.__dataclass_fields__


@pytest.mark.parametrize("kind", [one for one in FIELDS if one.__name__ not in ("GripperState",)])
def test_what_the_sdk_makes_without_arguments_is_made(kind: Any) -> None:
    if kind.__name__ != "MoveProgress":
        kind()


@pytest.mark.parametrize("name", [name for name in EXPORTS if export_refusal(name)])
def test_an_export_that_cannot_work_raises_when_it_is_used(name: str) -> None:
    value: Any = getattr(litegrip_client, name)
    with pytest.raises(CommandError, match=rf"{name}.* cannot be used: \w") as caught:
        value.Bus() if name == "can" else value(1, two=2)
    assert caught.value.reason == "unsupported"
    assert caught.value.hint == export_refusal(name)


def test_a_link_of_the_scripts_own_can_be_written_but_not_made() -> None:
    class Mine(TeleopTransport):
        pass

    with pytest.raises(CommandError, match="Mine cannot be used"):
        Mine()


@pytest.mark.parametrize("name", [name for name in MEMBERS if member_refusal(name)])
def test_a_member_that_cannot_work_raises_when_it_is_used(name: str) -> None:
    gripper = LiteGrip()
    with pytest.raises(CommandError, match=f"{name} cannot be used") as caught:
        getattr(gripper, name)()
    assert caught.value.reason == "unsupported"
    assert caught.value.hint


def test_the_classes_of_errors_are_the_sdks() -> None:
    for name in ("CommError", "CANTimeoutError", "NotInitializedError"):
        assert issubclass(getattr(litegrip_client, name), HardwareError)
    for name in EXPORTS:
        if name.startswith("Trajectory") and name.endswith("Error"):
            assert issubclass(getattr(litegrip_client, name), TrajectoryError)
    assert issubclass(litegrip_client.TeleopNotReady, litegrip_client.TeleopError)
    assert issubclass(litegrip_client.ParameterError, ValueError)
    error = LiteGripError("too hot", 0xC)
    assert (error.error_code, str(error), LiteGripError().error_code) == (12, "too hot", None)
    assert litegrip_client.describe_error(0xC) == "coil hot"
    assert litegrip_client.describe_error(5) == "unknown status 5"


def test_a_force_ramp_has_two_names() -> None:
    for config in (MotionConfig(force_ramp_n_s=30.0), MotionConfig(force_rate_n_s=30.0)):
        assert (config.force_rate_n_s, config.force_ramp_n_s) == (30.0, 30.0)
        assert config.to_wire() == {"force_rate_n_s": 30.0}
        config.force_ramp_n_s = 10.0
        assert config.to_wire() == {"force_rate_n_s": 10.0}
    assert MotionConfig().to_wire() == {}
    assert MotionConfig().stop_speed_ratio == 0.5
    with pytest.raises(CommandError, match="stop_speed_ratio cannot be"):
        MotionConfig(stop_speed_ratio=0.4)
