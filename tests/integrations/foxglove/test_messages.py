"""What Foxglove is shown of a live state: the same as a dump has of that tick."""

from typing import Any

import pytest

from litegrip_client import GripperState
from litegrip_client.values.foxglove import JOINTS_SCHEMA, TICK_SCHEMA
from litegrip_foxglove.messages import Scale, joints_message, tick_of
from litegripd.recorder.files import _joints, read, tick_fields
from litegripd.sim.plant import limits_of_mount
from tests.world import Client, World, ready

AT_NS = 1_700_000_000_250_000_000
MEASURED = {"position_rad", "velocity_rad_s", "torque_nm", "opening_mm", "age_s", "status"}


def scale_of(mount: str, *, calibrated: bool = True) -> Scale | None:
    """Return the scale as `info()` has it of a gripper."""
    closed_rad, open_rad = limits_of_mount(mount)
    limits = {"closed_rad": closed_rad, "open_rad": open_rad, "rad_to_mm": 52.69}
    return Scale.from_info({"gripper": {"calibrated": calibrated, **limits}})


def state_of(client: Client, **changed: Any) -> GripperState:
    return GripperState.from_wire({**client.result("state.get"), **changed})


def live(client: Client, mount: str = "normal", *, is_fresh: bool = True) -> dict[str, Any]:
    """Return the tick that is shown of the state by now."""
    return tick_of(state_of(client), scale_of(mount), is_fresh=is_fresh)


@pytest.mark.parametrize("mount", ["normal", "reverse"])
def test_a_live_tick_and_that_of_a_dump_say_the_same(mount: str) -> None:
    world = World(mount=mount)
    client = world.enabled()
    client.send("motion.move", opening_mm=40, speed_mm_s=100)
    world.run(0.3)
    shown = live(client, mount)
    assert shown.keys() <= TICK_SCHEMA["properties"].keys()
    assert shown.keys() >= MEASURED | {"command_mm", "command_rad", "requested_rad", "job_kind"}
    tick = read(bytes(world.disk.memory)).ticks[-1]
    dumped = tick_fields(tick, {})
    for name in ("command_rad", "command_mm", "command_torque_nm"):  # rounded as in the frame
        assert shown.pop(name) == pytest.approx(dumped[name], abs=0.02)
    assert shown.pop("opening_mm") == pytest.approx(dumped["opening_mm"], abs=1e-4)
    assert shown == {name: dumped[name] for name in shown}
    joints = joints_message(state_of(client), scale_of(mount), AT_NS)
    for joint, of_dump in zip(joints["joints"], _joints(tick, AT_NS)["joints"], strict=True):
        assert joint == pytest.approx(of_dump, abs=1e-5)
    assert joints.keys() == JOINTS_SCHEMA["properties"].keys()
    assert joints["timestamp"] == {"sec": 1_700_000_000, "nsec": 250_000_000}
    assert len(joints["joints"]) == 3


def test_figures_that_are_not_fresh_are_left_out() -> None:
    _, client = ready()
    shown = live(client, is_fresh=False)
    assert not shown.keys() & MEASURED
    assert (shown["motor"], shown["mode"], shown["stopped"]) == ("enabled", "holding", False)


def test_a_stop_is_shown_and_slack_jaws_have_no_command() -> None:
    world, client = ready()
    client.result("stop", level="relax")
    world.run(0.1)
    shown = live(client)
    assert (shown["mode"], shown["stopped"]) == ("relaxed", True)
    assert "command_mm" not in shown


def test_without_a_calibration_only_the_motor_is_shown() -> None:
    world = World(calibrated=False)
    client = world.client()
    world.run(0.1)
    assert scale_of("normal", calibrated=False) is None
    shown = tick_of(state_of(client), None, is_fresh=True)
    assert "position_rad" in shown
    assert not shown.keys() & {"opening_mm", "command_mm"}
    (motor,) = joints_message(state_of(client), None, AT_NS)["joints"]
    assert (motor["name"], motor["position"]) == ("motor", shown["position_rad"])


def test_what_nobody_knows_yet_is_left_out() -> None:
    _, client = ready()
    unknown: dict[str, Any] = dict.fromkeys(
        ("position_rad", "status", "coil_temperature_c", "command_rad")
    )
    shown = tick_of(state_of(client, **unknown), scale_of("normal"), is_fresh=True)
    assert not shown.keys() & {*unknown, "command_mm"}
