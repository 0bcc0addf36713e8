"""A kept motion configuration at the start: what of it counts, and what is told of the rest."""

import json
import logging
from pathlib import Path
from typing import Any

import pytest

from litegripd.app.build import load_at_start
from litegripd.io.helper.files import load_motion
from litegripd.model.motion_config import MotionConfig
from litegripd.model.state import TaskResult
from tests.world import PERIOD_S, World

DEFAULTS = MotionConfig()


@pytest.fixture(autouse=True)
def state(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    return tmp_path


class KeptWorld(World):
    """A world whose helper reads the kept configuration of a file."""

    def __init__(self, path: Path, kept: dict[str, Any]) -> None:
        super().__init__()
        path.write_text(json.dumps({"channel": "can0", "config": kept}), encoding="utf-8")
        load_at_start(self.controller, lambda: None)
        tasks, self.controller.tasks = self.controller.tasks, []
        for task in tasks:
            if task.operation == "motion.load":
                task.on_result(TaskResult(load_motion(task.parameters)))


def errors(caplog: pytest.LogCaptureFixture) -> list[str]:
    return [one.getMessage() for one in caplog.records if one.levelno == logging.ERROR]


def test_a_speed_of_an_earlier_version_is_told_and_alone_left_out(
    state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = state / "can0_motion.json"
    kept = {**DEFAULTS.as_fields(PERIOD_S), "speed_mm_s": 300.0, "force_n": 7.5, "settle_s": 0.5}
    world = KeptWorld(path, kept)
    config = world.controller.config
    assert (config.speed_mm_s, config.force_n, config.settle_s) == (50.0, 7.5, 0.5)
    (told,) = errors(caplog)
    assert told == (
        f"in the kept motion configuration {path}, speed_mm_s is 300, it must be 0.1 to 150 mm/s;"
        " 50 counts"
    )
    view = world.client().result("config.get")
    assert (view["kept"], view["config"]["speed_mm_s"]) == (True, 50.0)


def test_each_field_that_may_not_be_so_is_told(
    state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kept: dict[str, Any] = {"speed_mm_s": 200, "grasp_speed_mm_s": 180, "force_n": "much"}
    kept |= {"hold_kp": 120.0, "x" * 60: 1, "frame_interval": 0.1}
    config = KeptWorld(state / "can0_motion.json", kept).controller.config
    assert config == DEFAULTS.changed({"hold_kp": 120.0}, PERIOD_S)
    told = errors(caplog)
    assert len(told) == 5
    for words in (
        "speed_mm_s is 200, it must be 0.1 to 150 mm/s; 50 counts",
        "grasp_speed_mm_s is 180, it must be 0.1 to 150 mm/s; 50 counts",
        "force_n is 'much', it must be a number; 20 counts",
        "there is no field 'xxx",
        "frame_interval is 0.005",
    ):
        assert sum(words in one for one in told) == 1


def test_what_does_not_go_together_is_not_used_in_part(
    state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """The lead near the stop is the default's: which of the two was meant is not known."""
    world = KeptWorld(state / "can0_motion.json", {"max_lead_mm": 0.3, "force_n": 5.0})
    assert world.controller.config == DEFAULTS
    assert not world.controller.config_is_kept
    (told,) = errors(caplog)
    assert "is not used: stop_lead_mm" in told


def test_a_file_of_nothing_but_unknown_fields_is_given_up_soon(
    state: Path, caplog: pytest.LogCaptureFixture
) -> None:
    kept = {f"a{number}": 1 for number in range(1000)}
    world = KeptWorld(state / "can0_motion.json", kept)
    assert world.controller.config == DEFAULTS
    assert not world.controller.config_is_kept
    told = errors(caplog)
    assert len(told) < 50
    assert "is not used: there is no field" in told[-1]
