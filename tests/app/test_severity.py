"""Which events are warnings: declared once, the same in journal, dumps and page."""

import ast
import logging
from pathlib import Path
from typing import Any, get_args

import pytest

import litegripd
from docs.generate import GENERATED
from litegrip_client.values.foxglove import EVENT_SCHEMA
from litegrip_client.values.severity import SEVERITIES, is_warning
from litegripd.app.status import log_event
from litegripd.model.state import Event, EventKind
from litegripd.recorder.files import RecordedEvent, _event_fields

WARNING_LEVEL = 3  # of foxglove.Log, the form of a dump's events


def emitted() -> set[object]:
    """Return the kinds of all events that the daemon's code makes."""
    kinds: set[object] = set()
    for path in Path(litegripd.__file__).parent.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Call) and ast.unparse(node.func) == "Event":
                assert isinstance(node.args[0], ast.Constant), f"{path}:{node.lineno}"
                kinds.add(node.args[0].value)
    return kinds


def test_every_event_that_the_daemon_can_emit_has_a_severity() -> None:
    assert emitted() == set(SEVERITIES) == set(get_args(EventKind))


@pytest.mark.parametrize("kind", SEVERITIES)
@pytest.mark.parametrize("data", [{}, {"error": "e"}, {"warning": True}, {"at_rest": True}])
def test_journal_and_dump_agree(
    kind: EventKind, data: dict[str, Any], caplog: pytest.LogCaptureFixture
) -> None:
    with caplog.at_level(logging.INFO):
        log_event(Event(kind, "it happened", data), "can0")
    (record,) = caplog.records
    content = {"kind": kind, "message": "it happened", "data": data}
    fields = _event_fields(RecordedEvent(1, 2.0, content), 2_000_000_000)
    assert set(fields) <= set(EVENT_SCHEMA["properties"])
    is_warned = is_warning(kind, data)
    assert (record.levelno == logging.WARNING) == is_warned
    assert (fields["level"] == WARNING_LEVEL) == is_warned


@pytest.mark.parametrize("kind", ["second_master", "implausible", "lease_lost", "stop", "swing"])
def test_what_nobody_asked_for_is_a_warning(kind: EventKind) -> None:
    assert is_warning(kind, {})
    assert not is_warning(kind, {"at_rest": True})


def test_the_data_of_an_event_may_make_it_a_warning() -> None:
    assert not is_warning("weak", {"warning": False})  # its end
    assert is_warning("weak", {"warning": True})
    assert is_warning("recorder", {"error": "the disk is full"})
    assert not is_warning("an event of another version", {})


def test_the_page_has_the_same_rule() -> None:
    (page,) = (file for file in GENERATED if file.path.endswith("page/severity.js"))
    assert not page.is_stale()
