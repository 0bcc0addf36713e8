"""What litegripctl lists of trajectories; the transcripts have all that a daemon does with them."""

import base64
import hashlib
from pathlib import Path

import pytest

from litegrip_client.values.printed import listed_text
from tests.client.helpers import Ctl
from tests.client.rig import Heard
from tests.trajectories import lgt

NOWHERE = ("--socket", "/nowhere")


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    path = tmp_path / "mine"
    path.mkdir()
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(path))
    return path


def test_a_date_that_is_none_is_not_shown() -> None:
    row = {"name": "x", "samples": 2, "sample_hz": 100.0, "created_s": 1e300, "mount": None}
    shown = " ".join(listed_text([row]).splitlines()[1].split()[2:])
    assert shown == "-- s 100 Hz - - --"


def test_the_length_in_the_list_is_that_of_the_samples_also_where_some_are_missing(
    folder: Path, litegripctl: Ctl
) -> None:
    row = {"name": "x", "samples": 193, "sample_hz": 100.0, "duration_s": 1.99, "mount": None}
    assert listed_text([row]).splitlines()[1].split()[1:4] == ["193", "1.99", "s"]
    (folder / "gap.lgt").write_bytes(lgt([(1.0, 0.5), (1.01, 0.5), (2.99, 0.5)]))
    (folder / "odd.lgt").write_bytes(lgt([(1.0, 0.5), (0.5, 0.5)]))
    out = litegripctl(*NOWHERE, "trajectories", "--local")[1]
    lines = [line.split()[:4] for line in out.splitlines()[1:]]
    assert lines == [["gap", "3", "1.99", "s"], ["odd", "2", "--", "s"]]


def test_get_writes_nothing_that_could_not_be_loaded(
    heard: Heard, litegripctl: Ctl, folder: Path
) -> None:
    content = lgt([(0.0, 2.0)])
    heard.instead["trajectory.get"] = {
        "data": base64.b64encode(content).decode(),
        "offset": 0,
        "total": len(content),
        "sha256": hashlib.sha256(content).hexdigest(),
    }
    code, _, error = litegripctl("trajectories", "get", "pick")
    assert (code, "openness is 2.0" in error) == (4, True)
    assert not list(folder.iterdir())
