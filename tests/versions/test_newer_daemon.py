"""This client at a daemon of a later version: it goes on, whatever more it is told."""

from pathlib import Path
from typing import Any

import pytest

from litegrip_client import GripperState, LiteGripError
from litegrip_client.ctl.state_view import state_line, state_text
from litegrip_client.values.error_table import CODES, REASONS
from litegrip_client.values.errors import exit_code, from_error_object
from litegripd.model.errors import ERROR_TABLE, ErrorKind, Refusal
from litegripd.rpc.jsonrpc import error_object
from tests.versions.lines import sent_by_lines
from tests.versions.newer import WORD, with_more, with_unknown_error
from tests.versions.older import a_scene
from tests.versions.steps import STEPS, ready


@pytest.mark.parametrize("name", STEPS)
def test_every_call_works(tmp_path: Path, name: str) -> None:
    with a_scene(tmp_path / "home", with_more) as scene:
        ready(scene.gripper)
        STEPS[name](scene.gripper)


def test_what_it_does_not_know_can_be_seen(tmp_path: Path) -> None:
    with a_scene(tmp_path / "home", with_more) as scene:
        gripper = scene.gripper
        assert gripper.info()[f"{WORD}_member"]
        assert gripper.open().outcome.startswith(WORD)
        with gripper.events() as events:
            gripper.goto(40.0)
            kinds = [next(events).kind for _ in range(4)]
        assert kinds == ["job_started", WORD, "job_ended", WORD]
        assert [one.kind for one in events.recent][-2:] == ["job_ended", WORD]


def test_every_command_ends_with_the_same_code() -> None:
    codes = {line: code for line, (code, _) in sent_by_lines().items()}
    assert {line: code for line, (code, _) in sent_by_lines(with_more).items()} == codes
    assert set(codes.values()) < {0, 1, 2, 4, 6}


def test_an_error_that_it_has_never_heard_of_is_the_base_class_with_the_daemons_text(
    tmp_path: Path,
) -> None:
    with a_scene(tmp_path / "home", with_unknown_error) as scene:
        with pytest.raises(LiteGripError) as caught:
            scene.gripper.goto(1000.0)
        error = caught.value
        assert type(error) is LiteGripError
        assert (error.reason, error.code) == (WORD, -32999)
        assert error.message.startswith("position_mm is 1000 mm")
        assert scene.gripper.goto(40.0)


@pytest.mark.parametrize("kind", ERROR_TABLE, ids=lambda kind: kind.reason)
def test_a_client_from_before_a_kind_of_error_raises_the_base_class_with_all_that_came(
    monkeypatch: pytest.MonkeyPatch, kind: ErrorKind
) -> None:
    monkeypatch.delitem(REASONS, kind.reason)
    monkeypatch.delitem(CODES, kind.code)
    sent = error_object(Refusal(kind.reason, "so it is", {"hint": "do this", "limit": 3}))
    error = from_error_object(sent, "motion.fly")
    assert type(error) is LiteGripError
    assert (error.message, error.hint, error.reason) == ("so it is", "do this", kind.reason)
    assert (error.code, error.retryable, error.data["limit"]) == (kind.code, kind.retryable, 3)
    assert exit_code(error) == 70


def test_a_word_of_the_state_that_it_does_not_know_stands_there(tmp_path: Path) -> None:
    with a_scene(tmp_path / "home") as scene:
        state: dict[str, Any] = scene.connection.call("state.get")
    words = [name for name, value in state.items() if isinstance(value, str)]
    assert {"bus", "motor", "mode", "status"} <= set(words)
    for name in words:
        later = {**state, name: WORD, "limited": [WORD]}
        read = GripperState.from_wire(later)
        assert (getattr(read, name), read.limited) == (WORD, (WORD,))
        assert WORD in state_text(later, str) + state_line(later, str)
        assert isinstance(read.is_error, bool)
