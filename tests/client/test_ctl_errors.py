"""How litegripctl tells errors: what it says, the hint below it, and its exit code."""

import json
from collections.abc import Callable
from typing import Any, TypeAlias

import pytest

from litegrip_client.ctl.commands.motions import FORCES, SPEEDS
from litegripd.model.errors import ERROR_TABLE, ErrorKind
from litegripd.model.motion_config import WIDEST
from litegripd.model.sentence import sentence
from litegripd.motor.phases import implausible_refusal
from tests.client.helpers import Ctl
from tests.client.rig import Heard, Refuse

Told: TypeAlias = Callable[..., tuple[int, list[str]]]
IN_ITS_OWN_WORDS = {
    "stopped",
    "sent_before_stop",
    "not_enabled",
    "busy",
    "unknown_job",
    "lease_held",
    "unknown_trajectory",
    "trajectory_busy",
    "teleop_busy",
    "teleop_not_ready",
}


@pytest.fixture
def told(heard: Heard, litegripctl: Ctl) -> Told:
    """Return what refuses `state`, and gives its exit code and the lines of standard error."""

    def told(*refusal: Any, **data: Any) -> tuple[int, list[str]]:
        heard.instead["state.get"] = Refuse(*refusal, **data)
        code, out, err = litegripctl("state")
        assert out == ""
        return code, err.splitlines()

    return told


RAISED = [kind for kind in ERROR_TABLE if kind.reason != "unknown_method"]
"""All but what no command asks for: a method that its own version does not have."""


@pytest.mark.parametrize("kind", RAISED, ids=lambda kind: kind.reason)
def test_every_error_ends_with_its_exit_code(told: Told, litegripctl: Ctl, kind: ErrorKind) -> None:
    own = {"retryable": kind.retryable, "hint": "do this"}
    code, (what, hint) = told(kind.reason, kind.code, "what", **own)
    assert (code, what) == (kind.exit_code, "litegripctl: what")
    assert hint.startswith("  ")
    assert ("litegripctl" if kind.reason in IN_ITS_OWN_WORDS else "do this") in hint
    code, out, err = litegripctl("--json", "state")
    assert (code, err) == (kind.exit_code, "")
    data = {"reason": kind.reason, **own}
    assert json.loads(out) == {"error": {"code": kind.code, "message": "what", "data": data}}


@pytest.mark.parametrize(
    ("reason", "code", "hint"),
    [
        ("stopped", -32021, "litegripctl clear"),
        ("busy", -32020, "litegripctl jobs"),
        ("motor_silent", -32032, "litegripctl doctor"),
        ("unreachable", -32060, "litegripctl doctor"),
        ("internal_error", -32603, "journalctl -u litegripd@can0"),
    ],
)
def test_there_is_always_a_hint(told: Told, reason: str, code: int, hint: str) -> None:
    retryable = reason == "motor_silent"
    _, (what, then) = told(reason, code, "first\nsecond\x1b", retryable=retryable)
    assert what == "litegripctl: first second "
    assert hint in then


@pytest.mark.parametrize(
    ("refusal", "data", "line"),
    [
        (("bus_down", -32033, "no bus; mend it"), {"hint": "mend it"}, "no bus; mend it"),
        (
            ("motor_silent", -32032, "the motor's registers are still being read: try again"),
            {"retryable": True},
            "the motor's registers are still being read: try again",
        ),
    ],
)
def test_a_remedy_that_the_message_ends_with_is_not_told_twice(
    told: Told, refusal: tuple[Any, ...], data: dict[str, Any], line: str
) -> None:
    assert told(*refusal, **data) == (5, [f"litegripctl: {line}"])


def test_a_remedy_in_the_protocols_words_is_not_told_twice_either(told: Told) -> None:
    refusal = implausible_refusal(6.283)
    _, (line,) = told(refusal.reason, -32037, refusal.message, **refusal.data)
    assert "if what is shown is wrong; then litegripctl clear-fault, and calibrate again" in line


@pytest.mark.parametrize(
    ("template", "shown"),
    [
        ("clear it with {stop.clear} first", "clear it with litegripctl clear first"),
        (
            "wait for it ({job.wait}), cancel it ({job.cancel}) or stop",
            "wait for it (see: litegripctl jobs), cancel it (litegripctl cancel) or stop",
        ),
        (
            "wait for it ({lease.acquire with wait_s}), or take it over ({lease.take})",
            "wait for it (see: litegripctl lease), or take it over (litegripctl lease take REASON)",
        ),
        ("no 'x'; {trajectory.list} tells which", "no 'x'; litegripctl trajectories tells which"),
        ("motion.move and /a/stop.clear.json", "motion.move and /a/stop.clear.json"),
    ],
)
def test_remedies_are_commands_and_not_the_protocols_methods(
    told: Told, litegripctl: Ctl, template: str, shown: str
) -> None:
    assert told("x", -1, "no", hint=sentence(template))[1] == ["litegripctl: no", f"  {shown}"]
    marked = told("x", -1, sentence(template), hint="do so")[1]
    assert marked == [f"litegripctl: {shown}", "  do so"]
    assert json.loads(litegripctl("--json", "state")[1])["error"]["message"] == shown


USAGE = {
    "stae": "COMMAND: there is no 'stae'; did you mean 'state'?",
    "lease tke": "ACTION: there is no 'tke'; did you mean 'take'?",
    "lease x": "ACTION: there is no 'x': show, take",
    "goto 40mm": "COMMAND: there is no 'goto'; did you mean 'move'?",
    "xyzzy": "COMMAND: there is no 'xyzzy'\n",
    "config set speed_mm_s 80": "is no setting: say speed_mm_s=NUMBER",
    "grasp --forse 10": "unrecognized arguments: --forse 10; did you mean '--force'?",
    "grasp --forse=10": "; did you mean '--force'?",
    "state --jsn": "; did you mean '--json'?",
    "state xyzzy": "unrecognized arguments: xyzzy\n",
    "disable --force": "unrecognized arguments: --force\n",
    "cancel abc": "'abc' is not a whole number of 1 or more",
    "grasp --width 48 --tolerance -1": "'-1' is not a number of 0 or more",
    "grasp --force 10kg": "'10kg' is not in N: give it in N, or as a number",
    "open --speed 25mm": "'25mm' is not in mm/s: give it in mm/s, or as a number",
    "open --speed 0mm/s": "'0' is not a number above 0: say 0.1 to 150 mm/s\n",
    "close --speed fast": "'fast' is not a number above 0: say 0.1 to 150 mm/s\n",
    "force 0": "'0' is not a number above 0: say 0.5 to 40 N\n",
    "watch --hz 0": "'0' is not a number above 0: say 0.1 to 200 Hz\n",
    "sim object 4cm": "'4cm' is not in mm: give it in mm, or as a number",
    "open 40mm": "unrecognized arguments: 40mm; to an opening or a position: litegripctl move 40mm",
    "open 40": "to an opening: litegripctl move 40mm; a speed is an option: --speed 40",
    "close -40MM": "to an opening or a position: litegripctl move -40MM",
    "close --force 5": "; to hold an object with a force: litegripctl grasp --force N",
    "move 45mm --force=5": "; to hold an object with a force: litegripctl grasp --force N",
    "grasp 10N": "unrecognized arguments: 10N; a force is an option: --force 10\n",
    "grasp -f 10": "unrecognized arguments: -f 10; did you mean '--force'?",
    "grasp -x 10": "unrecognized arguments: -x 10\n",
    "release 5mm": "; a distance is an option: --by 5\n",
    "trajectories get pick /tmp/a": "; a file is an option: -o /tmp/a\n",
    "dump /tmp/a.mcap": "; a file is an option: -o /tmp/a.mcap\n",
    "move 45,5mm": "'45,5mm' has a comma: say 45.5mm",
    "grasp --hold nan": "'nan' is not a number of 0 or more",
    "grasp --width 0 --tolerance 1": "'0' is not a number above 0, in mm\n",
    "grasp --width 20": "go together: give --tolerance 2, too, say (mm)\n",
    "grasp --tolerance 1": "go together: give --width 20, too, say (mm)\n",
    "grasp --force x": "see: litegripctl grasp --help\n",
    "grasp --width 4": "see: litegripctl grasp --help\n",
    "grasp --no-such-option": "see: litegripctl grasp --help\n",
    "grasp --frce 10": "usage: litegripctl grasp [-h]",
    "close --force 10": "usage: litegripctl close [-h]",
    "-c can0 state --nope": "usage: litegripctl state [-h]",
    "lease take mine now": "usage: litegripctl lease take [-h]",
    "teleop slave --no-such-option": "see: litegripctl teleop slave --help\n",
    "calibration load": "see: litegripctl calibration load --help\n",
    "nothing": "see: litegripctl --help\n",
}
"""Wrong command lines, and what of it is said."""


def test_what_is_allowed_is_what_the_daemon_allows() -> None:
    told = {"speed_mm_s": SPEEDS, "grasp_speed_mm_s": SPEEDS, "force_n": FORCES}
    assert told == {name: "{:g} to {:g}".format(*WIDEST[name]) for name in told}


@pytest.mark.parametrize(
    "line",
    [
        *USAGE,
        "",
        "fly",
        "open --speed 0",
        "open --speed nan",
        "open --speed fast",
        "watch --hz -1",
        "watch --count 0",
        "watch --count ²",
        "cancel x",
        "grasp --force 0",
        "grasp --hold -1",
        "grasp --tolerance 2",
        "grasp --width 48",
        "release --by -5",
        "move",
        "move 45mm --speed 5 --duration 2",
        "force",
        "zero --mount upside-down",
        "calibration forget",
        "calibration load normal --chain",
        "config set",
        "config set force_n",
        "config set force_n=strong",
        "config set force_n=nan",
        "register",
        "-c ../etc state",
        "-c can0 --socket /x state",
    ],
)
def test_wrong_usage_is_told_with_what_is_meant_and_where_the_help_is(
    litegripctl: Ctl, line: str
) -> None:
    code, out, err = litegripctl(*line.split())
    assert (code, out) == (2, "")
    assert err.startswith("usage: litegripctl")
    assert USAGE.get(line, "") in err
    assert err.splitlines()[-1].startswith("  see: litegripctl")
    assert "choose from" not in err
    code, out, err = litegripctl("--json", *line.split())
    assert (code, json.loads(out)["error"]["data"]["reason"], err) == (2, "wrong_usage", "")
