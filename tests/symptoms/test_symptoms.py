"""The page has what the doctor says on each bench, and its remedies were carried out there."""

import pytest

from litegrip_client.ctl.commands.machine import CHECKS
from litegrip_client.socketcan.link import HARMFUL, HINDERING
from tests.symptoms.page import PAGE, row, split
from tests.symptoms.scenes import SCENES, Scene

ROWS = split(PAGE.read_text(encoding="utf-8"))[1]


@pytest.mark.parametrize("scene", SCENES, ids=lambda scene: f"{scene.check}: {scene.symptom[:30]}")
def test_the_page_has_the_row_and_its_remedy_mends_what_it_shows(scene: Scene) -> None:
    assert row(scene) == ROWS[SCENES.index(scene)]


def test_whatever_a_check_finds_has_a_row() -> None:
    assert len(ROWS) == len(SCENES)
    assert {scene.check for scene in SCENES} == {check.name for check in CHECKS}


def test_each_mode_of_a_link_has_a_row() -> None:
    told = [line for line in ROWS if " modes: " in line]
    assert len(told) == len(HINDERING | HARMFUL)
    for mode in HINDERING | HARMFUL:
        assert any(f" modes: {mode.lower()} is on" in line for line in told)
