"""The daemon's messages in the words of a script, of a shell, and of the wire."""

from __future__ import annotations

import inspect
import re
from argparse import Action
from collections.abc import Iterator, Mapping

import pytest

import litegrip_client
from litegrip_client import LiteGrip, LiteGripError
from litegrip_client.ctl import commands as ctl
from litegrip_client.ctl.parser import LateParser, Parser, whole_parser
from litegrip_client.values.errors import from_error_object
from litegrip_client.values.voices import ARGUMENTS, CALLS, in_python, in_shell, is_said
from litegripd.app.build import METHODS
from litegripd.control.admission import NOT_CALIBRATED, NOT_ENABLED, ZERO_MOVED, busy_with
from litegripd.control.authority import StopLatch
from litegripd.model.errors import Refusal
from litegripd.model.state import Job, Owner
from litegripd.motor.phases import implausible_refusal
from litegripd.rpc.jsonrpc import error_object
from litegripd.rpc.method import check, methods_of
from litegripd.sim.methods import SimMethods
from tests.client.fake_daemon import FakeDaemon
from tests.client.helpers import Ctl

ROWS = {method.name: method for method in (*METHODS, *methods_of(SimMethods))}
OWNER = Owner(client=3, pid=77, uid=1000, program="pick.py")


def of_wire(text: str) -> list[str]:
    """Return what of a text only the protocol knows."""
    return [name for name in ROWS if "." in name and re.search(rf"\b{re.escape(name)}\b", text)]


def commands() -> Iterator[tuple[str, list[Action]]]:
    """Give every command line without its options, and its arguments."""

    def walk(parser: Parser, name: str) -> Iterator[tuple[str, list[Action]]]:
        if isinstance(parser, LateParser):
            parser.become()
        actions = list(parser.arguments())
        yield name, actions
        for action in actions:
            if isinstance(action.choices, Mapping):
                for word, inner in action.choices.items():
                    yield from walk(inner, f"{name} {word}")

    return walk(whole_parser(ctl.COMMANDS), "litegripctl")


COMMANDS = dict(commands())


def command_of(method: str) -> str:
    """Return the command in a row's words for the shell; empty where it has none."""
    found = re.search(r"litegripctl(?: [a-z][a-z-]*)+", CALLS[method][1] or "")
    return "" if found is None else found[0]


def test_every_method_of_the_table_is_one_of_the_protocol() -> None:
    assert set(CALLS) | set(ARGUMENTS) <= set(ROWS)


@pytest.mark.parametrize("method", sorted(CALLS))
def test_every_call_and_every_command_can_be_typed(method: str) -> None:
    call = CALLS[method][0]
    if found := re.search(r"gripper\.(\w+)", call):
        assert hasattr(LiteGrip, found[1])
        assert callable(getattr(LiteGrip, found[1])) is call.endswith("()")
    elif found := re.match(r"(\w+)\(\)", call):
        assert callable(getattr(litegrip_client, found[1]))
    for words in CALLS[method]:
        for command in re.findall(r"litegripctl(?: [a-z][a-z-]*)+", words):
            assert command in COMMANDS


@pytest.mark.parametrize("method", sorted(set(ARGUMENTS) & set(CALLS)))
def test_every_argument_can_be_typed(method: str) -> None:
    declared = ROWS[method].declared
    line = command_of(method)
    options = {
        name
        for command, actions in COMMANDS.items()
        if line and command.startswith(line)
        for action in actions
        for name in (*action.option_strings, str(action.metavar or action.dest))
    }
    for parameter, (_python, shell) in ARGUMENTS[method].items():
        assert parameter in declared
        if line:
            typed = shell.partition(" ")[0]
            assert typed in options or f"{typed}|FILE" in options


@pytest.mark.parametrize(
    "method", ["motion.open", "motion.grasp", "motion.set_force", "teleop.start"]
)
def test_the_arguments_of_python_are_those_of_the_method(method: str) -> None:
    function = getattr(LiteGrip, CALLS[method][0].removeprefix("gripper.").removesuffix("()"))
    names = set(inspect.signature(function).parameters)
    assert {python for python, _shell in ARGUMENTS[method].values()} <= names


def test_a_time_that_goto_takes_is_not_named_as_on_the_wire() -> None:
    told = in_python("at_least_s is -1, it must be 0 to 3600", "motion.move", "at_least_s")
    assert told == "duration is -1, it must be 0 to 3600"


def refusals() -> Iterator[Refusal]:
    stops = StopLatch()
    stops.raise_to("hold", OWNER, "lunch", 1.0)
    stopped = stops.refusal()
    assert stopped is not None
    yield from (NOT_ENABLED, NOT_CALIBRATED, ZERO_MOVED, stopped, implausible_refusal(6.283))
    for kind in ("grasp", "teleop"):
        yield busy_with(Job(5, kind, OWNER, detached=False, started_s=1.0))


@pytest.mark.parametrize("refusal", list(refusals()), ids=lambda refusal: refusal.reason)
def test_no_reader_but_that_of_the_wire_reads_its_names(refusal: Refusal) -> None:
    wire = error_object(refusal)
    for voice in (in_python, in_shell):
        error = from_error_object(wire, "motion.open", voice)
        assert not of_wire(f"{error.message} {error.hint}"), str(error)
    assert from_error_object(wire).message == from_error_object(wire, None, in_python).message


@pytest.mark.parametrize("refusal", list(refusals()), ids=lambda refusal: refusal.reason)
def test_no_remedy_is_read_twice(refusal: Refusal, daemon: FakeDaemon, ctl: Ctl) -> None:
    wire = error_object(refusal)
    for text in (str(from_error_object(wire)), _shown(daemon, ctl, refusal)):
        calls = re.findall(r"gripper\.\w+\(|litegripctl [a-z-]+", text)
        assert len(calls) == len(set(calls)), text


def _shown(daemon: FakeDaemon, ctl: Ctl, refusal: Refusal) -> str:
    daemon.handlers["state.get"] = lambda request: request.fail(
        refusal.reason, refusal.kind.code, refusal.message, **refusal.data
    )
    return ctl("state")[2].replace("litegripctl: ", "", 1)


def of(method: str, **given: object) -> tuple[str, str, str]:
    """Return a refusal of parameters in the three voices."""
    refusal = check(method, ROWS[method].declared, given)
    assert refusal is not None
    wire = error_object(refusal)
    return (
        refusal.message,
        from_error_object(wire, method, in_python).message,
        from_error_object(wire, method, in_shell).message,
    )


def test_a_value_is_named_by_what_the_reader_has_typed() -> None:
    range_ = "is 900, it must be 0.1 to 150"
    wire, python, shell = of("motion.open", speed_mm_s=900)
    assert wire == f"motion.open: speed_mm_s {range_}"
    assert (python, shell) == (f"speed_mm_s {range_}", f"--speed {range_}")
    _, python, shell = of("motion.move", opening_mm=5, duration_s=9999)
    range_ = "is 9999, it must be 0.01 to 3600"
    assert (python, shell) == (f"duration {range_}", f"--duration {range_}")
    _, python, shell = of("trajectory.play", name="pick", speed=9)
    assert python.startswith("speed is 9,")
    assert shell.startswith("--speed is 9,")


def test_the_configuration_of_a_motion_is_named_as_the_reader_has_it() -> None:
    data = {"reason": "invalid_params", "parameter": "config", "field": "force_n"}
    wire = {"code": -32602, "message": "config: force_n is 99, it must be 0.5 to 30", "data": data}
    python = from_error_object(wire, "motion.open", in_python).message
    assert python == "motion_config: force_n is 99, it must be 0.5 to 30"


def test_a_word_of_the_sentence_stays_one() -> None:
    text = "teleop.start: host is missing: a slave connects to its host, with reflect_n"
    words = in_shell(text, "teleop.start", "host")
    assert words == "--host is missing: a slave connects to its host, with --reflect-force"
    assert in_shell("stop.clear with care", None) == "litegripctl clear with care"


@pytest.mark.parametrize(
    ("told", "python", "shell"),
    [
        ("calibration.zero with a mount", "gripper.zero(mount=...)", "litegripctl zero --mount"),
        (
            "trajectory.record_stop with allow_empty",
            "gripper.record_stop(allow_empty=...)",
            "by the program that records",
        ),
        (
            "trajectory.delete with its number",
            None,
            "litegripctl trajectories delete with its number",
        ),
        ("motion.movement and /a/stop.clear.json", "motion.movement and /a/stop.clear.json", None),
    ],
)
def test_a_method_with_a_parameter_is_a_call_with_an_argument(
    told: str, python: str | None, shell: str | None
) -> None:
    assert python is None or in_python(told) == python
    assert shell is None or in_shell(told) == shell


def test_a_remedy_is_said_when_its_calls_are() -> None:
    assert is_said("clear it with gripper.clear_stop() first", "gripper.clear_stop()")
    assert is_said("(litegripctl lease take REASON)", "in need: litegripctl lease take REASON")
    assert not is_said("look: litegripctl lease", "in need: litegripctl lease take REASON")
    assert not is_said("litegripctl clear-fault", "when it is safe again: litegripctl clear")
    assert not is_said("no bus", "plug it in")


def test_python_reads_python(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["motion.open"] = lambda request: request.fail(
        "stopped", -32021, "a stop is latched; clear it with stop.clear first", hint="stop.clear"
    )
    with pytest.raises(LiteGripError) as caught:
        gripper.open()
    assert str(caught.value) == "a stop is latched; clear it with gripper.clear_stop() first"
    daemon.handlers["health"] = lambda request: {
        "verdict": "down",
        "reasons": ["motor.clear_fault"],
    }
    assert gripper.health()["reasons"] == ["gripper.clear_fault()"]
