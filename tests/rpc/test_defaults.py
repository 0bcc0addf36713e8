"""The daemon's defaults for motions: which ones are not taken."""

from litegripd.model.gripper import FASTEST_MM_S
from tests.world import World, enabled_world


def test_defaults_that_no_motion_could_use_are_refused() -> None:
    world, client = enabled_world()
    before = world.controller.config
    answer = client.call("config.set", config={"speed_mm_s": 500})
    refused = client.call("motion.open", config={"speed_mm_s": 500})
    assert answer["error"]["message"] == refused["error"]["message"]
    assert "speed_mm_s is 500, it must be 0.1 to 150 mm/s" in answer["error"]["message"]
    assert answer["error"]["data"]["reason"] == "invalid_params"
    for bad in (
        {"speed_mm_s": FASTEST_MM_S + 0.1},
        {"grasp_speed_mm_s": FASTEST_MM_S + 0.1},
        {"stop_lead_mm": 3.0, "max_lead_mm": 2.0},
    ):
        assert client.refusal("config.set", config=bad) == "invalid_params"
    assert world.controller.config is before
    together = {"speed_mm_s": FASTEST_MM_S, "grasp_speed_mm_s": FASTEST_MM_S}
    assert client.result("config.set", config=together)["config"]["speed_mm_s"] == FASTEST_MM_S
    assert client.result("motion.open")["ok"]


def test_a_gentle_press_bounds_no_speed() -> None:
    """`stop_lead_mm` means a torque: the command may lead by what the jaws travel in a period."""
    client = World().enabled()
    gentle = {"stop_lead_mm": 0.4, "speed_mm_s": 140}
    assert client.result("config.set", config=gentle)["config"]["stop_lead_mm"] == 0.4
    assert client.result("motion.open")["ok"]
