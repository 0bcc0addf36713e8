"""Log lines that leave without waiting, and the counting of those that cannot."""

import logging
import os
import select
import socket
from collections.abc import Iterator
from pathlib import Path

import pytest

from litegrip_client.values.repeats import RepeatsHandler
from litegripd.app.status import log_event
from litegripd.io import log
from litegripd.io.log import FIELDS, JournalSink, goes_to_journal
from litegripd.model.sentence import sentence
from litegripd.model.state import Event, EventKind


def record(level: int, text: str, *arguments: object) -> logging.LogRecord:
    return logging.LogRecord("litegripd", level, "file.py", 1, text, arguments, None)


def test_what_the_sink_does_not_take_is_counted() -> None:
    taken: list[str] = []

    def sink(_record: logging.LogRecord, text: str) -> bool:
        taken.append(text)
        return len(taken) != 2

    handler = RepeatsHandler(sink)
    for number in range(3):
        handler.handle(record(logging.INFO, "line %d", number))
    assert taken == ["line 0", "line 1", "line 2"]
    assert handler.dropped == 1


def test_a_line_that_cannot_be_made_is_counted_not_raised() -> None:
    handler = RepeatsHandler(lambda _record, _text: True)
    handler.handle(record(logging.INFO, "%d", "not a number"))
    assert handler.dropped == 1


@pytest.fixture
def journal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[socket.socket]:
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as fake:
        fake.bind(str(tmp_path / "journal"))
        fake.setblocking(False)
        monkeypatch.setattr(log, "JOURNAL_SOCKET", str(tmp_path / "journal"))
        yield fake


@pytest.fixture
def sink() -> Iterator[JournalSink]:
    made = JournalSink("can0")
    yield made
    made.close()


def fields(journal: socket.socket) -> dict[str, str]:
    """Return the fields of the datagram that has come, in the journal's own form."""
    assert select.select([journal], [], [], 20.0)[0]
    rest, found = journal.recv(4096), {}
    while rest:
        name, _, rest = rest.partition(b"\n")
        length = int.from_bytes(rest[:8], "little")
        found[name.decode()] = rest[8 : 8 + length].decode()
        assert rest[8 + length : 9 + length] == b"\n"
        rest = rest[9 + length :]
    return found


@pytest.mark.parametrize(
    ("level", "priority"),
    [(logging.CRITICAL, 3), (logging.ERROR, 3), (logging.WARNING, 4), (logging.INFO, 6), (10, 7)],
)
def test_a_line_is_one_datagram_in_the_journals_form(
    journal: socket.socket, sink: JournalSink, level: int, priority: int
) -> None:
    text = "two\nlines, ü"
    assert sink(record(level, text), text)
    assert fields(journal) == {
        "PRIORITY": str(priority),
        "SYSLOG_IDENTIFIER": "litegripd",
        "LITEGRIP_CHANNEL": "can0",
        "MESSAGE": text,
    }


def test_a_line_brings_fields_of_its_own_and_no_value_makes_another(
    journal: socket.socket, sink: JournalSink
) -> None:
    line = record(logging.INFO, "x")
    setattr(line, FIELDS, {"LITEGRIP_JOB": 3, "LITEGRIP_REASON": "a\nPRIORITY=0"})
    assert sink(line, "x")
    found = fields(journal)
    assert (found["LITEGRIP_JOB"], found["LITEGRIP_REASON"]) == ("3", "a\nPRIORITY=0")
    assert found["PRIORITY"] == "6"


@pytest.fixture
def journalled(
    sink: JournalSink, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    """Let the log go to the journal."""
    monkeypatch.setattr(logging.getLogger(), "handlers", [RepeatsHandler(sink)])
    caplog.set_level(logging.INFO, "litegripd")


def test_an_event_can_be_found_by_job_and_client(journal: socket.socket, journalled: None) -> None:
    data = {"job": 3, "kind": "open", "client": 7, "pid": 42, "detached": False}
    log_event(Event("job_started", "job 3: open by demo", data), "can0")
    found = fields(journal)
    assert found["MESSAGE"] == "job 3: open by demo"
    assert {name: value for name, value in found.items() if name.startswith("LITEGRIP")} == {
        "LITEGRIP_CHANNEL": "can0",
        "LITEGRIP_EVENT": "job_started",
        "LITEGRIP_JOB": "3",
        "LITEGRIP_CLIENT": "7",
        "LITEGRIP_CLIENT_PID": "42",
    }


def test_what_an_event_names_is_a_command_in_the_journal(
    journal: socket.socket, journalled: None
) -> None:
    log_event(Event("pressing", sentence("let them go ({motion.zero_gravity})"), {}), "can1")
    assert fields(journal)["MESSAGE"] == "let them go (litegripctl -c can1 slack)"


@pytest.mark.parametrize(
    ("kind", "priority"), [("object_moved", "6"), ("object_lost", "4"), ("pressing", "4")]
)
def test_what_is_lost_or_pressed_is_a_warning_and_what_moved_is_none(
    journal: socket.socket,
    journalled: None,
    kind: EventKind,
    priority: str,
) -> None:
    log_event(Event(kind, "the object", {}), "can0")
    assert fields(journal)["PRIORITY"] == priority


def test_a_journal_that_is_full_or_gone_refuses_without_waiting(
    journal: socket.socket, sink: JournalSink
) -> None:
    handler = RepeatsHandler(sink)
    sent = 0
    while not handler.dropped:
        handler.handle(record(logging.INFO, "x" * 1000))
        sent += 1
        assert sent < 100_000
    assert sent > 1
    journal.close()
    handler.handle(record(logging.INFO, "x"))
    assert handler.dropped == 2


def test_only_a_unit_whose_error_output_is_the_journal_writes_to_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    status = os.fstat(2)
    for value, expected in (
        (f"{status.st_dev}:{status.st_ino}", True),
        (f"{status.st_dev}:{status.st_ino + 1}", False),
        ("nonsense", False),
        ("", False),
    ):
        monkeypatch.setenv("JOURNAL_STREAM", value)
        assert goes_to_journal() is expected
