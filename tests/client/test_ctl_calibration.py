"""What `litegripctl zero` asks a person at a terminal."""

import subprocess
from typing import Any

import pytest

from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import STATE, FakeDaemon
from tests.geometry import (
    CLOSED_RAD,
    OPEN_RAD,
    SPAN_MM,
)

CONTENT = {
    "calibrated": True,
    "zero_position_rad": CLOSED_RAD,
    "max_position_rad": OPEN_RAD,
    "own": "é",
}
MEASURED: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "measured",
    "closed_rad": 0.104,
    "open_rad": -1.513,
    "travel_rad": 1.617,
    "rad_to_mm": SPAN_MM / 1.617,
    "content": CONTENT,
    "path": "/var/lib/x.json",
    "message": None,
    "state": STATE,
}
TRAVEL = "closed +0.1040 rad, open -1.5130 rad, travel 1.6170 rad or 86.00 mm, mount normal\n"
TAKEN = (
    "taken: the jaws open 85 mm; if a caliper says otherwise:"
    " litegripctl calibration rescale --stroke-mm MM\n"
)


def test_a_question_that_nobody_can_read_is_not_asked(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero", stderr=subprocess.DEVNULL)
    assert terminal.end() == (2, "")
    assert daemon.methods() == ["hello"]


MOVES = "the jaws will move to both stops; continue? [y/N] "
WIDTH = "how far do the jaws open, by a caliper, in mm? [85] "
AGAIN = f"please answer a number above 0, or press Enter: {WIDTH}"


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("Yes \n", 0), ("\n", 1), ("\x04", 1)])
def test_zero_on_a_terminal_asks_before_it_moves(
    daemon: FakeDaemon, answer: str, code: int
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    assert daemon.methods() == ["hello"]
    terminal.type(answer)
    if code == 0:
        terminal.expect(WIDTH)
        assert "calibration.zero" not in daemon.methods()
        terminal.type("\n")
    ended, shown = terminal.end()
    assert ended == code
    assert ("calibration.zero" in daemon.methods()) == (code == 0)
    assert ("litegripctl: nothing was done\n" in shown) == (code == 1)


def test_ctrl_c_at_the_question_moves_nothing(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect("[y/N] ")
    terminal.interrupt()
    assert terminal.end() == (130, "\n")
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(
    ("answers", "stroke"),
    [
        (["\n"], {}),
        (["84.5\n"], {"stroke_mm": 84.5}),
        ([" 84 mm\n"], {"stroke_mm": 84.0}),
        (["wide\n", "-3\n", "0\n", "nan\n", "inf\n", "86\n"], {"stroke_mm": 86.0}),
    ],
)
def test_zero_on_a_terminal_asks_how_far_the_jaws_open(
    daemon: FakeDaemon, answers: list[str], stroke: dict[str, float]
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    terminal.type("y\n")
    terminal.expect(WIDTH)
    terminal.type(answers[0])
    for answer in answers[1:]:
        terminal.expect(AGAIN)
        terminal.type(answer)
    assert terminal.end()[0] == 0
    params = daemon.requests[-1].params
    assert {name: params[name] for name in ("stroke_mm",) if name in params} == stroke


def test_no_answer_to_how_far_they_open_moves_nothing(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    terminal.type("y\n")
    terminal.expect(WIDTH)
    terminal.type("\x04")
    assert terminal.end() == (1, "\nlitegripctl: nothing was done\n")
    assert "calibration.zero" not in daemon.methods()


@pytest.mark.parametrize(
    ("arguments", "question"), [(["--stroke-mm", "84"], MOVES), (["--yes"], None)]
)
def test_who_has_said_it_is_not_asked(
    daemon: FakeDaemon, arguments: list[str], question: str | None
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero", *arguments)
    if question is not None:
        terminal.expect(question)
        terminal.type("y\n")
    code, shown = terminal.end()
    assert (code, "how far do the jaws open" in shown) == (0, False)
