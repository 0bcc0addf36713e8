"""The daemon's defaults for motions: which ones are not taken."""

from tests.world import World


def test_defaults_that_no_motion_could_use_are_refused() -> None:
    world = World()
    client = world.enabled()
    before = world.controller.config
    answer = client.call("config.set", config={"speed_mm_s": 500})
    refused = client.call("motion.open", config={"speed_mm_s": 500})
    assert answer["error"]["message"] == refused["error"]["message"]
    assert "at most 140 goes with stop_lead_mm 0.7" in answer["error"]["message"]
    assert answer["error"]["data"]["reason"] == "out_of_limits"
    assert world.controller.config is before
    assert client.refusal("config.set", config={"stop_lead_mm": 0.1}) == "out_of_limits"
    together = {"speed_mm_s": 200, "stop_lead_mm": 1.0}
    assert client.result("config.set", config=together)["config"]["speed_mm_s"] == 200
