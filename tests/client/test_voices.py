"""The daemon's messages in the words of a script, of a shell, and of the wire."""

from __future__ import annotations

import inspect
import re
from collections.abc import Iterator

import pytest

import litegrip_client
from litegrip_client import LiteGrip, LiteGripError
from litegrip_client.threads.blocking import connect
from litegrip_client.values.errors import from_error_object
from litegrip_client.values.voices import ARGUMENTS, CALLS, in_python, in_shell
from litegripd.app.build import METHODS
from litegripd.control.admission import NOT_CALIBRATED, NOT_ENABLED, ZERO_MOVED, busy_with
from litegripd.control.authority import StopLatch
from litegripd.model.errors import Refusal
from litegripd.model.sentence import method_name, sentence, with_terms
from litegripd.model.state import Job, Owner
from litegripd.motor.phases import implausible_refusal
from litegripd.rpc.jsonrpc import error_object
from litegripd.rpc.method import check, methods_of
from litegripd.sim.methods import SimMethods
from tests.client.ctl_commands import every_parser
from tests.client.helpers import Ctl
from tests.client.rig import Heard, Refuse
from tests.world import World

ROWS = {method.name: method for method in (*METHODS, *methods_of(SimMethods))}
OWNER = Owner(client=3, pid=77, uid=1000, program="pick.py")


def of_wire(text: str) -> list[str]:
    """Return what of a text only the protocol knows."""
    return [name for name in ROWS if "." in name and re.search(rf"\b{re.escape(name)}\b", text)]


COMMANDS = {parser.prog: list(parser.arguments()) for parser in every_parser()}
"""The arguments of every command line without its options."""


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


def test_a_method_without_parameters_is_a_whole_command() -> None:
    assert in_shell("calibration.load", None, None) == "litegripctl calibration load --chain"
    with_template = "litegripctl calibration load normal (or reverse)"
    assert in_shell("calibration.load", "template", None) == with_template


@pytest.mark.parametrize(
    "method", ["motion.open", "motion.grasp", "motion.set_force", "teleop.start"]
)
def test_the_arguments_of_python_are_those_of_the_method(method: str) -> None:
    function = getattr(LiteGrip, CALLS[method][0].removeprefix("gripper.").removesuffix("()"))
    names = set(inspect.signature(function).parameters)
    assert {python for python, _shell in ARGUMENTS[method].values()} <= names


def test_a_time_that_goto_takes_is_not_named_as_on_the_wire() -> None:
    _, python, _ = of("motion.move", opening_mm=5, at_least_s=-1)
    assert python == "duration is -1, it must be 0 to 3600 s"


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
def test_no_remedy_is_read_twice(refusal: Refusal, heard: Heard, litegripctl: Ctl) -> None:
    heard.instead["state.get"] = Refuse(
        refusal.reason, refusal.kind.code, refusal.message, **refusal.data
    )
    shown = litegripctl("state")[2].replace("litegripctl: ", "", 1)
    for text in (str(from_error_object(error_object(refusal))), shown):
        calls = re.findall(r"gripper\.\w+\(|litegripctl [a-z-]+", text)
        assert len(calls) == len(set(calls)), text


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
    range_ = "is 900, it must be 0.1 to 150 mm/s"
    wire, python, shell = of("motion.open", speed_mm_s=900)
    assert wire == f"motion.open: speed_mm_s {range_}"
    assert (python, shell) == (f"speed_mm_s {range_}", f"--speed {range_}")
    _, python, shell = of("motion.move", opening_mm=5, duration_s=9999)
    range_ = "is 9999, it must be 0.01 to 3600 s"
    assert (python, shell) == (f"duration {range_}", f"--duration {range_}")
    _, python, shell = of("trajectory.play", name="pick", speed=9)
    assert python.startswith("speed is 9,")
    assert shell.startswith("--speed is 9,")


def test_the_configuration_of_a_motion_is_named_as_the_reader_has_it() -> None:
    world = World()
    error = world.enabled().call("motion.grasp", config={"force_n": 99})["error"]
    python = from_error_object(error, "motion.grasp", in_python).message
    assert python.startswith("motion_config: force_n is 99, it must be 0.5 to 40 N")
    assert from_error_object(error, "motion.grasp", in_shell).message.startswith("config: force_n")


def told(template: str, method: str | None = None, **values: object) -> tuple[str, str]:
    """Return a sentence in Python's and the shell's voice."""
    wire = error_object(Refusal("busy", sentence(template, **values)))
    made = (from_error_object(wire, method, voice).message for voice in (in_python, in_shell))
    python, shell = made
    return python, shell


@pytest.mark.parametrize(
    ("template", "python", "shell"),
    [
        ("{calibration.zero with a mount}", "gripper.zero(mount=...)", "litegripctl zero --mount"),
        (
            "{trajectory.record_stop with allow_empty}",
            "gripper.record_stop(allow_empty=True)",
            "by the program that records",
        ),
        (
            "{trajectory.delete} with its number",
            "gripper.delete_trajectory() with its number",
            "litegripctl trajectories delete with its number",
        ),
        (
            "{teleop.start}: {.host} is missing: a slave connects to its host, with {.reflect_n}",
            "host is missing: a slave connects to its host, with reflect_n",
            "--host is missing: a slave connects to its host, with --reflect-force",
        ),
        ("motion.move and /a/stop.clear: force_n",) * 3,
    ],
)
def test_only_what_is_marked_is_named_in_another_voice(
    template: str, python: str, shell: str
) -> None:
    assert told(template, "teleop.start") == (python, shell)


@pytest.mark.parametrize(
    "terms",
    [
        "stop.clear",
        {"message": 3},
        {"message": [3]},
        {"message": [{"start": 0, "end": 10}]},
        {"message": [{"start": 5, "end": 90, "method": "stop.clear", "parameter": None}]},
        {"message": [{"start": -3, "end": 4, "method": "stop.clear", "parameter": None}]},
        {"message": [{"start": "a", "end": 4, "method": "stop.clear", "parameter": None}]},
        {"message": [{"start": 0, "end": 4, "method": ["stop.clear"], "parameter": None}]},
    ],
)
def test_a_message_whose_terms_cannot_be_stays_as_it_came(terms: object) -> None:
    wire = {"code": -1, "message": "stop.clear", "data": {"reason": "busy", "terms": terms}}
    assert from_error_object(wire).message == "stop.clear"


def test_another_language_can_be_given_to_a_connection(heard: Heard) -> None:
    text = sentence("the motor is not enabled: enable it first ({motor.enable})")
    hint = method_name("motor.enable")
    heard.instead["motion.open"] = Refuse("not_enabled", -32030, text, hint=hint)
    with connect("can0") as connection:
        connection.voice = lambda method, *_: f"the service {method}"
        with pytest.raises(LiteGripError, match="not enabled") as caught:
            connection.call("motion.open")
    assert caught.value.message.endswith("enable it first (the service motor.enable)")
    assert caught.value.hint == "the service motor.enable"
    assert "terms" not in caught.value.data


def test_a_remedy_is_said_when_its_calls_are() -> None:
    def shown(message: str, hint: str) -> str:
        refusal = Refusal("bus_down", sentence(message), {"hint": sentence(hint)})
        return str(from_error_object(error_object(refusal)))

    assert shown("no: first {motor.enable}", "call {motor.enable}") == "no: first gripper.enable()"
    text = shown("no: first {motor.enable}", "{motor.enable}, then {calibration.zero}")
    assert text.endswith("\ngripper.enable(), then gripper.zero()")
    assert shown("no: plug it in", "plug it in") == "no: plug it in"
    assert shown("no bus", "plug it in") == "no bus\nplug it in"
    assert shown("motor.enable", "{motor.enable}") == "motor.enable\nnext: gripper.enable()"


def test_python_reads_python(heard: Heard) -> None:
    reasons = [method_name("motor.clear_fault"), "motor.clear_fault"]
    heard.instead["health"] = with_terms({"verdict": "down", "reasons": reasons})
    heard.client().result("stop")
    with LiteGrip("can0") as gripper:
        with pytest.raises(LiteGripError, match=r"; clear it with gripper\.clear_stop\(\) first$"):
            gripper.open()
        assert gripper.health()["reasons"] == ["gripper.clear_fault()", "motor.clear_fault"]


def test_an_argument_that_may_be_a_word_too_has_one_name_in_the_shell() -> None:
    assert told("{.width_mm} is 300, it must be 0.1 to 200 mm", "sim.object") == (
        "width_mm is 300, it must be 0.1 to 200 mm",
        "WIDTH is 300, it must be 0.1 to 200 mm",
    )
