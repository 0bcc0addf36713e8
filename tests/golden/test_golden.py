"""The scenes give what they gave: every frame sent and every line written, byte for byte."""

import json

import pytest

from tests.golden.__main__ import KEPT
from tests.golden.scenes import SCENES

_KEPT = json.loads(KEPT.read_text(encoding="utf-8"))


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_gives_what_it_gave(name: str) -> None:
    """Where this fails: write both versions' output (python -m tests.golden FOLDER) and compare."""
    assert SCENES[name]().digest() == _KEPT[name]


def test_what_is_kept_is_of_the_scenes() -> None:
    assert sorted(_KEPT) == sorted(SCENES)
