"""The calibration by hand of litegripctl: its questions, its end, and its cancelling."""

import json
import subprocess
from typing import Any

import pytest

from litegripd.model.sentence import sentence
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import FakeDaemon, Request
from tests.client.helpers import Ctl
from tests.client.test_ctl_calibration import AGAIN, IN_USE, MEASURED, TAKEN, TRAVEL, WIDTH

CLOSED = "push the jaws closed, to the stop, then press Enter: "
OPEN = "pull the jaws open, to the stop, then press Enter: "
SAVE = "use it and store it (y), use it without storing it (n), or cancel (c)? "
AS_BEFORE = "the calibration is as it was"


@pytest.fixture
def steps(daemon: FakeDaemon) -> list[dict[str, Any]]:
    """Answer the steps as a daemon does, and give those that came, without their guards."""
    asked: list[dict[str, Any]] = []
    answers: dict[str, dict[str, Any]] = {
        "begin": {"job": 4},
        "closed": {"closed_rad": 0.104, "open_rad": None},
        "open": {"closed_rad": 0.104, "open_rad": -1.513},
        "finish": MEASURED,
        "cancel": {"job": 4},
    }

    def answer(request: Request) -> dict[str, Any]:
        guards = ("sent_s", "stop_generation")
        asked.append({key: val for key, val in request.params.items() if key not in guards})
        return answers[request.params["step"]]

    daemon.handlers["calibration.manual"] = answer
    return asked


def begun(daemon: FakeDaemon, *arguments: str, **streams: Any) -> Terminal:
    terminal = Terminal("--socket", daemon.path, "calibration", "manual", *arguments, **streams)
    terminal.expect("The jaws are slack now.")
    return terminal


def recorded(daemon: FakeDaemon, *arguments: str, **streams: Any) -> Terminal:
    terminal = begun(daemon, *arguments, **streams)
    terminal.expect(CLOSED)
    terminal.type("\n")
    terminal.expect("closed at +0.1040 rad")
    terminal.expect(OPEN)
    terminal.type("\n")
    terminal.expect("open at -1.5130 rad")
    terminal.expect("travel 1.6170 rad, mount normal")
    if "--stroke-mm" not in arguments:
        terminal.expect(WIDTH)
        terminal.type("\n")
    terminal.expect(SAVE)
    return terminal


@pytest.mark.parametrize("answer", ["y", "n"])
def test_both_stops_are_recorded_and_used(
    daemon: FakeDaemon, steps: list[dict[str, Any]], answer: str
) -> None:
    terminal = recorded(daemon)
    terminal.type("what?\n")
    terminal.expect(f"please answer y, n or c: {SAVE}")
    terminal.type(f"{answer}\n")
    code, shown = terminal.end()
    assert code == 0
    assert shown.endswith(
        f"manual: measured\n{TRAVEL}{TAKEN}stored in /var/lib/x.json\n".replace(
            "litegripctl", f"litegripctl --socket {daemon.path}"
        )
    )
    assert steps == [
        {"step": "begin"},
        {"step": "closed"},
        {"step": "open"},
        {"step": "finish", "save": answer == "y"},
    ]


def test_as_json_only_the_result_is_on_standard_output(
    daemon: FakeDaemon, steps: list[dict[str, Any]]
) -> None:
    reader = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    terminal = recorded(daemon, "--json", stdout=reader.stdin)
    terminal.type("y\n")
    assert terminal.end()[0] == 0
    out, _ = reader.communicate()
    assert json.loads(out) == MEASURED


def test_what_was_found_may_be_implausible(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = recorded(daemon)
    answer = daemon.handlers["calibration.manual"]
    failed = {**MEASURED, "ok": False, "outcome": "implausible_travel", "path": None}

    def finish(request: Request) -> Any:
        answer(request)
        return {**failed, "message": "too short"}

    daemon.handlers["calibration.manual"] = finish
    terminal.type("y\n")
    code, shown = terminal.end()
    assert code == 1
    assert shown.endswith(f"manual: NOT ok: implausible travel: too short\n{TRAVEL}")
    assert IN_USE not in shown


def test_marks_that_are_refused_are_made_anew(
    daemon: FakeDaemon, steps: list[dict[str, Any]]
) -> None:
    terminal = recorded(daemon)
    answer = daemon.handlers["calibration.manual"]

    def refuse(request: Request) -> Any:
        answer(request)
        daemon.handlers["calibration.manual"] = answer
        return request.fail("out_of_limits", -32011, "the limits are equal; mark them again")

    daemon.handlers["calibration.manual"] = refuse
    terminal.type("n\n")
    terminal.expect("the limits are equal; mark them again")
    for question, text in ((CLOSED, "\n"), (OPEN, "\n"), (SAVE, "n\n")):
        terminal.expect(question)
        terminal.type(text)
    assert terminal.end()[0] == 0
    marking = ["closed", "open", "finish"]
    assert [step["step"] for step in steps] == ["begin", *marking, *marking]


def test_it_asks_how_far_the_jaws_open(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = begun(daemon)
    for question, text in ((CLOSED, "\n"), (OPEN, "\n"), (WIDTH, "wide\n"), (AGAIN, "84.5\n")):
        terminal.expect(question)
        terminal.type(text)
    terminal.expect(SAVE)
    terminal.type("y\n")
    assert terminal.end()[0] == 0
    assert steps[-1] == {"step": "finish", "save": True, "stroke_mm": 84.5}


def test_who_has_said_how_far_they_open_is_not_asked(
    daemon: FakeDaemon, steps: list[dict[str, Any]]
) -> None:
    terminal = recorded(daemon, "--stroke-mm", "84.5")
    terminal.type("y\n")
    assert terminal.end()[0] == 0
    assert steps[-1] == {"step": "finish", "save": True, "stroke_mm": 84.5}


def test_no_answer_to_how_far_they_open_cancels(
    daemon: FakeDaemon, steps: list[dict[str, Any]]
) -> None:
    terminal = begun(daemon)
    for question, text in ((CLOSED, "\n"), (OPEN, "\n"), (WIDTH, "\x04")):
        terminal.expect(question)
        terminal.type(text)
    assert terminal.end() == (1, f"\nlitegripctl: cancelled: {AS_BEFORE}, the jaws hold\n")
    assert steps[-1] == {"step": "cancel"}


def test_a_stroke_that_is_refused_is_asked_for_again(
    daemon: FakeDaemon, steps: list[dict[str, Any]]
) -> None:
    terminal = recorded(daemon, "--stroke-mm", "120")
    answer = daemon.handlers["calibration.manual"]

    def refuse(request: Request) -> Any:
        answer(request)
        daemon.handlers["calibration.manual"] = answer
        text = sentence("{.stroke_mm} is 120")
        return request.fail("out_of_limits", -32011, text, field="stroke_mm")

    daemon.handlers["calibration.manual"] = refuse
    terminal.type("y\n")
    terminal.expect("--stroke-mm is 120")
    for question, text in ((WIDTH, "85\n"), (SAVE, "y\n")):
        terminal.expect(question)
        terminal.type(text)
    assert terminal.end()[0] == 0
    assert [step["step"] for step in steps] == ["begin", "closed", "open", "finish", "finish"]
    assert [step.get("stroke_mm") for step in steps[-2:]] == [120.0, 85.0]


def test_no_is_an_answer(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = recorded(daemon)
    terminal.type("c\n")
    code, shown = terminal.end()
    assert (code, shown) == (1, f"c\nlitegripctl: cancelled: {AS_BEFORE}, the jaws hold\n")
    assert [step["step"] for step in steps] == ["begin", "closed", "open", "cancel"]


def test_ctrl_c_cancels(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = begun(daemon)
    terminal.expect(CLOSED)
    terminal.interrupt()
    assert terminal.end() == (130, f"\nlitegripctl: interrupted: {AS_BEFORE}, the jaws hold\n")
    assert steps == [{"step": "begin"}, {"step": "cancel"}]


def test_the_end_of_input_cancels(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = begun(daemon)
    terminal.expect(CLOSED)
    terminal.type("\x04")
    assert terminal.end() == (1, f"\nlitegripctl: cancelled: {AS_BEFORE}, the jaws hold\n")
    assert steps == [{"step": "begin"}, {"step": "cancel"}]


def test_a_cancelling_that_fails_is_told(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = begun(daemon)
    terminal.expect(CLOSED)
    daemon.handlers["calibration.manual"] = lambda request: request.fail(
        "unknown_job", -32012, "none runs"
    )
    terminal.interrupt()
    code, shown = terminal.end()
    assert code == 130
    assert f"the daemon did not confirm that {AS_BEFORE}: none runs\n" in shown
    assert shown.endswith(f"  see: litegripctl --socket {daemon.path} calibration\n")


def test_a_step_that_is_refused_ends_it(daemon: FakeDaemon, steps: list[dict[str, Any]]) -> None:
    terminal = begun(daemon)
    terminal.expect(CLOSED)
    answer = daemon.handlers["calibration.manual"]

    def stopped(request: Request) -> Any:
        answered = answer(request)
        if request.params["step"] != "closed":
            return answered
        return request.fail("stopped", -32021, "a stop is latched")

    daemon.handlers["calibration.manual"] = stopped
    terminal.type("\n")
    code, shown = terminal.end()
    assert code == 7
    assert shown.endswith(
        "litegripctl: a stop is latched\n"
        f"  when it is safe again: litegripctl --socket {daemon.path} clear\n"
    )
    assert [step["step"] for step in steps] == ["begin", "closed", "cancel"]


def test_a_beginning_that_is_refused_cancels_nothing(daemon: FakeDaemon) -> None:
    daemon.handlers["calibration.manual"] = lambda request: request.fail("busy", -32020)
    terminal = Terminal("--socket", daemon.path, "calibration", "manual")
    assert terminal.end()[0] == 6
    assert daemon.methods() == ["hello", "calibration.manual"]


def test_without_a_terminal_it_is_refused(daemon: FakeDaemon, ctl: Ctl) -> None:
    code, _, err = ctl("calibration", "manual")
    assert (code, daemon.methods()) == (2, ["hello"])
    assert "needs a terminal to ask at" in err
