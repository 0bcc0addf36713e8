"""What litegripctl asks a person at a real terminal; the transcripts have all the questions."""

import json
import subprocess

import pytest

from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import STATE, ZERO, FakeDaemon

MOVES = "the jaws will move to both stops; is nothing between them? [y/N] "
WIDTH = "how far do the jaws open, by a caliper, in mm? [85] "
MEASURED = {**ZERO, "state": STATE}


def test_a_question_that_nobody_can_read_is_not_asked(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero", stderr=subprocess.DEVNULL)
    assert terminal.end() == (2, "")
    assert daemon.methods() == ["hello"]


def test_zero_asks_before_it_moves_and_shows_only_the_result_elsewhere(daemon: FakeDaemon) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    reader = subprocess.Popen(["cat"], stdin=subprocess.PIPE, stdout=subprocess.PIPE)
    terminal = Terminal("--socket", daemon.path, "--json", "zero", stdout=reader.stdin)
    terminal.expect(MOVES)
    assert daemon.methods() == ["hello"]
    terminal.type("y\n")
    terminal.expect(WIDTH)
    assert "calibration.zero" not in daemon.methods()
    terminal.type("\n")
    assert terminal.end()[0] == 0
    out, _ = reader.communicate()
    assert json.loads(out) == MEASURED


@pytest.mark.parametrize(("how", "code", "told"), [("^D", 1, "nothing was done"), ("^C", 130, "")])
def test_the_end_of_input_and_ctrl_c_move_nothing(
    daemon: FakeDaemon, how: str, code: int, told: str
) -> None:
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    if how == "^C":
        terminal.interrupt()
    else:
        terminal.type("\x04")
    ended, shown = terminal.end()
    assert (ended, shown.startswith("\n"), told in shown) == (code, True, True)
    assert daemon.methods() == ["hello"]
