"""--json and the exit codes, which are alike for all commands."""

import json
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.ctl.parser import EXIT_CODES
from litegrip_client.values.trajectory import write_file
from litegripd.app.build import METHODS
from litegripd.model.errors import ERROR_TABLE
from litegripd.rpc.method import methods_of
from litegripd.sim.methods import SimMethods
from tests.client.ctl_commands import LINES, WITHOUT_DAEMON, every_command
from tests.client.helpers import Ctl
from tests.client.rig import Heard, Refuse
from tests.trajectories import lgt

REFUSALS = {row.reason: row for row in ERROR_TABLE}
ASKING = [line for line in LINES if line.partition(" ")[0] not in WITHOUT_DAEMON]
NEEDS_TERMINAL = "calibration manual"


@pytest.fixture(autouse=True)
def _own_trajectory(home: Path) -> None:
    write_file("taught", lgt([(0.0, 0.2), (1.0, 0.3)]))


def error_of(out: str) -> dict[str, Any]:
    (line,) = out.splitlines()
    error: dict[str, Any] = json.loads(line)["error"]
    assert error.keys() == {"code", "message", "data"}
    return error


def test_there_is_a_line_for_every_command() -> None:
    names = {" ".join(line.split()[:2]) for line in LINES} | {line.split()[0] for line in LINES}
    assert every_command() <= names


@pytest.mark.parametrize("line", ASKING)
def test_a_refusal_is_one_line_of_json_and_has_the_code_of_its_reason(
    heard: Heard, litegripctl: Ctl, line: str
) -> None:
    methods = {method.name for method in (*METHODS, *methods_of(SimMethods))} - {"hello"}
    heard.instead["hello"] = {**heard.client().result("hello"), "simulated": True}
    for reason in ("busy", "stopped", "not_permitted", "motor_silent"):
        refusal = Refuse(reason, REFUSALS[reason].code, "what\nelse")
        heard.instead |= dict.fromkeys(methods, refusal)
        code, out, _ = litegripctl(*line.split(), "--json")
        error = error_of(out)
        if line == NEEDS_TERMINAL:
            assert (code, error["data"]["reason"]) == (2, "wrong_usage")
        else:
            assert (code, error["data"]["reason"]) == (REFUSALS[reason].exit_code, reason)
            assert error["code"] == REFUSALS[reason].code


@pytest.mark.parametrize("line", LINES)
def test_without_a_daemon(tmp_path: Path, litegripctl: Ctl, line: str) -> None:
    where = ("--socket", str(tmp_path / "none.sock"))
    code, out, _ = litegripctl(*where, *line.split(), "--json")
    if line in ASKING:
        assert (code, error_of(out)["data"]["reason"]) == (3, "no_daemon")
    elif line.startswith("fleet"):  # by another program, which complains of its configuration
        assert (code, error_of(out)["data"]["reason"]) == (2, "wrong_usage")
    else:
        assert (code, isinstance(json.loads(out), dict)) == (1 if line == "doctor" else 0, True)


@pytest.mark.parametrize("line", LINES)
def test_a_wrong_command_line(tmp_path: Path, litegripctl: Ctl, line: str) -> None:
    where = ("--socket", str(tmp_path / "none.sock"))
    code, out, _ = litegripctl(*where, *line.split(), "--no-such-option", "--json")
    # A stop is tried all the same, and there is no daemon.
    wrong = (3, "no_daemon") if line.startswith("stop") else (2, "wrong_usage")
    assert (code, error_of(out)["data"]["reason"]) == wrong


def test_every_exit_code_of_an_error_has_a_meaning() -> None:
    codes = [code for code, _ in EXIT_CODES]
    assert codes == sorted(set(codes))
    assert {row.exit_code for row in ERROR_TABLE} <= set(codes)
