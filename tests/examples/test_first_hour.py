"""The notebook of the first hour, cell by cell, beside what `make run` runs, in virtual time."""

import json
from pathlib import Path
from typing import Any

import pytest

from tests.drop_in import Daemon, a_site

NOTEBOOK = Path(__file__).parents[2] / "examples" / "first_hour.ipynb"


def cells() -> list[str]:
    """Return the code of the notebook's cells, in their order."""
    whole = json.loads(NOTEBOOK.read_text("utf-8"))
    assert whole["nbformat"] == 4
    assert all(cell["source"] for cell in whole["cells"])
    code = [cell for cell in whole["cells"] if cell["cell_type"] == "code"]
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
    return ["".join(cell["source"]) for cell in code]


@pytest.mark.parametrize(
    ("width_mm", "verdict", "held"),
    [(40.0, "object_held 39.", "held with "), (None, "no_object", "nothing is held")],
    ids=["object", "empty"],
)
def test_each_cell_runs_and_the_first_one_again(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    width_mm: float | None,
    verdict: str,
    held: str,
) -> None:
    with a_site(tmp_path) as site:
        daemon = site.add(Daemon("sim0"))
        if width_mm is not None:
            daemon.gripper.put_object(width_mm=width_mm)
        connect, *others = cells()
        namespace: dict[str, Any] = {}
        said = []
        older = []  # as a notebook may keep them
        for cell in (connect, connect, *others):
            older.append(namespace.get("gripper"))
            exec(compile(cell, str(NOTEBOOK), "exec"), namespace)
            said.append(capsys.readouterr().out.strip())
        assert not daemon.is_energised
    assert said[:2] == ["", ""]
    assert any(text.startswith(verdict) for text in said)
    assert any(text.startswith(held) for text in said)
    assert any(text.startswith("job  kind") for text in said)
    assert any(" steps, " in text for text in said)
    assert "True" in said
