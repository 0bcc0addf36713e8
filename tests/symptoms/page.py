"""The table of docs/troubleshooting.md: each scene is run, and its remedy carried out."""

import contextlib
from pathlib import Path

from litegrip_client.ctl.findings import Finding
from tests.symptoms.bench import Bench, bench
from tests.symptoms.scenes import Scene

PAGE = Path(__file__).resolve().parents[2] / "docs" / "troubleshooting.md"
HEAD = (
    "| symptom on the bench | what the doctor says | the command, else what to do | tried |\n"
    "| --- | --- | --- | --- |\n"
)
ENDS = "\nThe links of a motor"
"""What follows the table on the page."""


def row(scene: Scene) -> str:
    """Run a scene; return its row. Fails where its remedy does not mend what it shows."""
    with bench() as made, contextlib.ExitStack() as stack:
        scene.act(made)
        if scene.runs:
            stack.enter_context(made.daemon())
        found = _look(scene, made)
        assert found is not None
        assert found.level != "ok"
        told = _row(scene, made, found)  # before the remedy changes what is there
        if isinstance(scene.mend, str):
            return told
        if scene.mend is not None:
            scene.mend(made)
        else:
            made.carry_out(found.command or "false")
        if not scene.runs:
            stack.enter_context(made.daemon())
        after = _look(scene, made)
        assert ("none" if after is None else after.level) == scene.remains, after
        return told


def _look(scene: Scene, made: Bench) -> Finding | None:
    return made.doctor(scans=scene.scans, channel=scene.channel).get(scene.check)


def _row(scene: Scene, made: Bench, found: Finding) -> str:
    does = f"`{found.command}`" if found.command else str(found.advice)
    tried = "yes" if scene.mend is None else "the cause"
    cells = (
        scene.symptom,
        f"{found.level.upper()} {scene.check}: {found.text}",
        does,
        scene.mend if isinstance(scene.mend, str) else tried,
    )
    return f"| {' | '.join(made.shown(cell).replace('|', chr(92) + '|') for cell in cells)} |"


def split(page: str) -> tuple[str, list[str], str]:
    """Return a page before the table, the table's rows, and what follows."""
    before, _, rest = page.partition(HEAD)
    rows, _, after = rest.partition(ENDS)
    return before, rows.splitlines(), after
