"""What the daemon tells about its calibration: the file, its date, and whether it was measured."""

from typing import Any

from litegripd.app.config import Config
from litegripd.app.facts import DaemonFacts
from litegripd.io.bus import BusSettings
from litegripd.io.calibration_files import DATA
from litegripd.model.calibration import to_plain
from tests.world import World

MEASURED = {"zero_position_rad": 0.104334, "max_position_rad": -1.513123}


def info(world: World) -> Any:
    config = Config("can0", BusSettings("socketcan", "can0", 1_000_000))
    return DaemonFacts(config, world.machine).info()


def test_a_template_is_nominal_and_has_no_date() -> None:
    world = World()
    client = world.start().client()
    client.result("calibration.load", template="reverse")
    told = info(world)["calibration"]
    file = str(DATA / "reverse.json")
    assert told == {"file": file, "nominal": True, "channel": None, "saved_s": None}


def test_a_saved_template_was_still_measured_on_no_gripper() -> None:
    world = World()
    client = world.start().client()
    client.result("calibration.load", template="reverse")
    client.result("calibration.save")
    told = info(world)["calibration"]
    assert (told["file"], told["nominal"]) == ("/state/calibration.save", True)


def test_a_content_of_a_client_is_in_no_file_until_it_is_saved() -> None:
    world = World()
    client = world.start().client()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content={**content, **MEASURED, "channel": "can7"})
    told = info(world)["calibration"]
    assert told == {"file": None, "nominal": False, "channel": "can7", "saved_s": None}
    client.result("calibration.save")
    told = info(world)["calibration"]
    file = "/state/calibration.save"
    assert told == {"file": file, "nominal": False, "channel": "can0", "saved_s": 1.6e9}
    assert client.result("calibration.get")["file"] == file


def test_another_calibration_than_the_saved_one_does_not_take_its_file() -> None:
    world = World()
    client = world.start().client()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content=content)
    saving = client.send("calibration.save")
    client.result("calibration.load", content=content)
    world.run_until(lambda: client.has_answer(saving))
    assert client.answers[saving]["result"]["path"] == "/state/calibration.save"
    assert info(world)["calibration"]["file"] is None


def test_a_measured_calibration_has_the_date_of_its_file() -> None:
    world = World()
    client = world.enabled()
    assert client.result("calibration.zero")["ok"]
    told = info(world)["calibration"]
    assert (told["nominal"], told["channel"], told["saved_s"]) == (False, "can0", 1.6e9)
    assert client.result("calibration.zero", save=False)["ok"]
    told = info(world)["calibration"]
    assert (told["file"], told["saved_s"]) == (None, None)


def test_a_found_file_keeps_its_date() -> None:
    world = World()
    client = world.start().client()
    calibration = world.machine.engine.calibrated.calibration
    assert calibration is not None
    plain = {**to_plain(calibration), "saved_s": 1.5e9}
    found = {"path": "/x.json", "skipped": [], "factory": False, "calibration": plain}
    world.disk.found = found
    client.result("calibration.load")
    assert info(world)["calibration"]["saved_s"] == 1.5e9
    assert info(world)["configuration"]["rpc"] == {"group": "litegrip"}
