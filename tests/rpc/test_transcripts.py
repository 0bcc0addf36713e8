"""Today's daemon still says what the kept transcripts say, or more."""

import json
from typing import Any

import pytest

from litegripd.app.build import METHODS
from tests.rpc.transcripts import FOLDER, talk

STABLE = {"reason", "kind", "outcome", "name", "mode", "jsonrpc"}
"""Values that programs compare with; all others may differ with the simulated gripper."""


def shrunk(kept: Any, now: Any, where: str) -> list[str]:
    """Say what of a kept answer is gone, or of another type."""
    if isinstance(kept, dict):
        if not isinstance(now, dict):
            return [f"{where}: an object became {type(now).__name__}"]
        lost = [f"{where}.{key} is gone" for key in kept.keys() - now.keys()]
        for key in kept.keys() & now.keys():
            lost += shrunk(kept[key], now[key], f"{where}.{key}")
            if key in STABLE and kept[key] != now[key]:
                lost.append(f"{where}.{key} was {kept[key]!r}, is {now[key]!r}")
        return lost
    if isinstance(kept, list):
        if not isinstance(now, list):
            return [f"{where}: an array became {type(now).__name__}"]
        pairs = zip(kept[:1], now[:1], strict=False)
        return [text for one, other in pairs for text in shrunk(one, other, f"{where}[]")]
    if kept is None or now is None:
        return []
    numbers = (int, float)
    both_numbers = isinstance(kept, numbers) and isinstance(now, numbers)
    if both_numbers and isinstance(kept, bool) == isinstance(now, bool):
        return []
    return [] if type(kept) is type(now) else [f"{where}: {kept!r} became {now!r}"]


@pytest.fixture(scope="module")
def today() -> dict[str, list[dict[str, Any]]]:
    return talk()


def test_every_method_has_a_transcript() -> None:
    kept = {path.stem for path in FOLDER.glob("*.json")}
    assert {method.name for method in METHODS} <= kept


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda path: str(path.stem))
def test_answers_grow_but_do_not_shrink(path: Any, today: dict[str, list[dict[str, Any]]]) -> None:
    kept = json.loads(path.read_text(encoding="utf-8"))
    now = today[path.stem]
    assert len(now) >= len(kept)
    for number, (before, after) in enumerate(zip(kept, now, strict=False)):
        assert before["params"] == after["params"]
        assert shrunk(before, after, f"{path.stem}[{number}]") == []


@pytest.mark.parametrize(
    ("kept", "now"),
    [
        ({"a": 1}, {}),
        ({"a": {"b": 1}}, {"a": {}}),
        ({"a": 1}, {"a": "1"}),
        ({"a": True}, {"a": 1}),
        ({"reason": "busy"}, {"reason": "stopped"}),
        ({"a": [{"b": 1}]}, {"a": [{"c": 1}]}),
        ({"a": [1]}, {"a": {}}),
    ],
)
def test_what_is_lost_is_found(kept: Any, now: Any) -> None:
    assert shrunk(kept, now, "x")


def test_what_is_added_is_no_loss() -> None:
    before = {"a": 1, "b": None, "c": [{"d": 1.0}]}
    assert shrunk(before, {"a": 2.5, "b": {"e": 1}, "c": [], "f": "new"}, "x") == []
