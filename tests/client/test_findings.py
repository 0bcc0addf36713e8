"""The runner of checks: what becomes of what they find, and of those that fail or hang."""

import threading
from collections.abc import Iterator

import pytest

from litegrip_client.ctl.findings import Check, Finding, as_data, findings_of, is_well, ok, warning


def test_checks_are_run_in_their_order_each_with_the_facts() -> None:
    checks: list[Check[tuple[int, ...]]] = [
        Check("sum", lambda facts: ok(f"{sum(facts)}")),
        Check("nothing", lambda _facts: None),
        Check("each", lambda facts: [(f"{one}", ok("it")) for one in facts]),
        Check("none", lambda _facts: []),
    ]
    found = findings_of(checks, (1, 2))
    assert found == [("sum", ok("3")), ("1", ok("it")), ("2", ok("it"))]
    assert is_well(found)


def test_a_check_that_fails_is_a_finding_and_the_others_are_run() -> None:
    def broken(facts: dict[str, str]) -> Finding:
        return ok(facts["absent"])

    found = dict(findings_of([Check("a", broken), Check("b", lambda _: warning("w"))], {}))
    assert found["a"].level == "error"
    assert found["a"].text == "this check failed: KeyError: 'absent'"
    assert found["a"].advice
    assert found["b"] == warning("w")
    assert not is_well(list(found.items()))


def test_what_a_check_has_found_before_it_fails_is_kept() -> None:
    def half(_facts: None) -> Iterator[tuple[str, Finding]]:
        yield "first", ok("f")
        raise OSError("gone")

    found = findings_of([Check("a", half)], None)
    assert [(name, finding.text) for name, finding in found] == [
        ("first", "f"),
        ("a", "this check failed: OSError: gone"),
    ]


def test_a_check_that_hangs_is_left_alone() -> None:
    ends = threading.Event()

    def hanging(_facts: None) -> Iterator[tuple[str, Finding]]:
        yield "first", ok("f")
        ends.wait()

    checks = [Check("a", hanging), Check("b", lambda _: ok("b"))]
    found = findings_of(checks, None, within_s=0.2)
    ends.set()
    assert [(name, finding.text) for name, finding in found] == [
        ("first", "f"),
        ("a", "this check failed: it has not ended within 0.2 s"),
        ("b", "b"),
    ]


def test_what_ends_a_program_is_no_finding(monkeypatch: pytest.MonkeyPatch) -> None:
    def joined(_thread: threading.Thread, _within_s: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(threading.Thread, "join", joined)
    with pytest.raises(KeyboardInterrupt):
        findings_of([Check("a", lambda _: ok("a"))], None)


def test_as_json_it_says_what_it_is_about() -> None:
    data = as_data([("a", warning("w", "c"))], file="f")
    assert list(data) == ["ok", "file", "findings"]
    assert data["ok"] is True
    assert data["findings"] == [
        {"check": "a", "level": "warning", "text": "w", "command": "c", "advice": None}
    ]
