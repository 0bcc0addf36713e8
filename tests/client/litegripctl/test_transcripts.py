import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.client.litegripctl.transcripts import Scene, Stage, scenes_of
from tests.client.rig import a_bench, run_ctl

SCENES = [
    scene for path in sorted(Path(__file__).parent.glob("*.txt")) for scene in scenes_of(path)
]


@pytest.fixture
def stage(
    home: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Iterator[Stage]:
    monkeypatch.setenv("TZ", "UTC")
    time.tzset()
    with a_bench(home) as site:
        monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path / "mine"))
        yield Stage(site, run_ctl(capsys), tmp_path, monkeypatch)


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: scene[0].replace(" ", "_"))
def test_it_goes_as_it_is_written(stage: Stage, scene: Scene) -> None:
    stage.play(scene[1])
