"""This client at a daemon that lacks something: it says so, or does without, and never blames."""

import json
from collections.abc import Iterator, Mapping
from contextlib import ExitStack
from itertools import islice
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CommandError, LiteGripError, ParameterError, ProtocolError
from litegrip_client.values.results import NEWER_FIELDS
from litegrip_client.values.version import client_version
from litegrip_client.values.voices import in_python, in_shell
from litegripd.app.build import METHODS
from litegripd.rpc.method import Method
from tests.client.rig import Asyncio, Heard, a_bench
from tests.versions.lines import LINES, a_shell, carried_out, sent_by_lines
from tests.versions.older import (
    Change,
    Lack,
    Requests,
    Scene,
    a_scene,
    lacking,
    lacks_of,
    needed,
    sent_by_steps,
)
from tests.versions.steps import LONG, STEPS, ready, uncovered

VERSION = "0.0.9"


@pytest.fixture
def scene(tmp_path: Path) -> Iterator[Scene]:
    with a_scene(tmp_path / "home") as scene:
        scene.connection.daemon_version = VERSION
        yield scene


SAMPLES = {"number": 5.0, "integer": 1, "boolean": True, "string": "x", "object": {}, "strings": []}


def asking_for(row: Method, lack: Lack) -> dict[str, Any]:
    """Return parameters that need what a daemon lacks, and all that the method needs anyway."""
    if lack.parameter is None:
        return {}
    required = {
        name: param.choices[0] if param.choices else SAMPLES[param.kind]
        for name, param in row.declared.items()
        if param.required
    }
    kind = row.declared[lack.parameter].kind
    named = {"strings": [lack.value], "object": {lack.value: 1}}.get(kind, lack.value)
    return {**required, lack.parameter: SAMPLES[kind] if lack.value is None else named}


@pytest.mark.parametrize("row", METHODS, ids=lambda row: row.name)
def test_what_an_older_daemon_lacks_is_named_with_its_version_and_what_to_do(
    scene: Scene, row: Method
) -> None:
    for lack in lacks_of(row):
        for voice in (in_python, in_shell):
            scene.connection.voice = voice
            with lacking(scene.daemon, lack), pytest.raises(CommandError) as caught:
                scene.connection.call(lack.method, asking_for(row, lack))
            error = caught.value
            assert type(error) is CommandError, lack
            assert error.reason == error.data["reason"] == "older_daemon", lack
            own = client_version()
            text = f"the daemon, litegripd {VERSION}, is older than this client, {own}, and lacks: "
            plain = (
                lack.method if lack.parameter is None else f"{lack.method} with {lack.parameter}"
            )
            what = voice(lack.method, lack.parameter, None) or plain
            value = "" if lack.value is None else f", {lack.value}"
            said, stopped, _ = error.message.partition("; stopped (")
            assert said == f"{text}{what}{value}", lack
            assert bool(stopped) is (lack.method == "stop" and lack.parameter is not None)
            assert "litegripctl restart --hold" in (error.hint or "")


def test_a_daemon_of_the_same_version_that_was_started_from_older_sources(scene: Scene) -> None:
    scene.connection.daemon_version = client_version()
    with lacking(scene.daemon, Lack("info.get")), pytest.raises(CommandError) as caught:
        scene.gripper.info()
    said = f"the daemon, litegripd {client_version()}, is older than this client and lacks: "
    assert caught.value.message == f"{said}gripper.info()"


SLIPS: tuple[tuple[str, dict[str, Any], str, type[LiteGripError]], ...] = (
    ("motion.fly", {}, "unknown_method", ProtocolError),
    ("motion.open", {"speed": 1}, "invalid_params", ParameterError),
    ("motion.open", {"speed_mm_s": 1e9}, "invalid_params", ParameterError),
    ("motion.open", {"speed_mm_s": "fast"}, "invalid_params", ParameterError),
    ("motion.open", {"config": {"sped": 1}}, "invalid_params", ParameterError),
    ("motion.grasp", {"until": "noon"}, "invalid_params", ParameterError),
    ("state.subscribe", {"fields": ["moood"]}, "invalid_params", ParameterError),
    ("lease.take", {}, "invalid_params", ParameterError),
)


@pytest.mark.parametrize(("method", "params", "reason", "kind"), SLIPS)
def test_a_slip_of_the_caller_is_none_of_the_daemons_age(
    scene: Scene, method: str, params: dict[str, Any], reason: str, kind: type[LiteGripError]
) -> None:
    with pytest.raises(kind) as caught:
        scene.connection.call(method, params)
    assert caught.value.reason == reason
    assert "older" not in str(caught.value)


def test_a_set_point_that_gets_no_answer_tells_it_by_the_next_call(scene: Scene) -> None:
    with scene.gripper.stream(torque_nm=1.0) as targets:
        targets.set_target(50.0)
        with lacking(scene.daemon, Lack("stream.set", "torque_nm")):
            targets.set_target(49.0)
            with pytest.raises(CommandError) as caught:
                targets.set_target(48.0)
    assert caught.value.reason == "older_daemon"
    assert caught.value.message.endswith(" lacks: gripper.stream(torque_nm=...)")


def test_the_client_for_asyncio_says_the_same(tmp_path: Path) -> None:
    with a_bench(tmp_path) as site:
        daemon, tasks = site.add(Heard()), Asyncio(site)
        with (
            tasks.gripper() as gripper,
            lacking(daemon, Lack("motion.grasp", "hold_by")),
            pytest.raises(CommandError) as caught,
        ):
            gripper.grasp(hold_by="gains")
        tasks.close()
    assert caught.value.reason == "older_daemon"
    assert caught.value.message.endswith(" lacks: await gripper.grasp(hold_by=...)")


# What a program's calls need ----------------------------------------------------------------------


def test_there_is_a_step_for_each_call_of_the_client() -> None:
    assert uncovered() == set()


def first_to_need(sent: Mapping[str, Requests]) -> dict[Lack, str]:
    """Return all that the client asks for, and the first call or command that does."""
    found: dict[Lack, str] = {}
    for name, requests in sent.items():
        for lack in needed(requests):
            found.setdefault(lack, name)
    return found


@pytest.mark.parametrize("name", STEPS)
def test_a_call_fails_by_what_it_needs_alone_and_says_that_this_is_missing(
    tmp_path: Path, name: str
) -> None:
    first = first_to_need(sent_by_steps())
    assert len(first) > 100
    for number, lack in enumerate(lack for lack, step in first.items() if step == name):
        with a_scene(tmp_path / str(number)) as scene:
            ready(scene.gripper)
            with lacking(scene.daemon, lack), pytest.raises(CommandError) as caught:
                STEPS[name](scene.gripper)
            assert caught.value.reason == "older_daemon", lack


BORNE = {
    "record taught --seconds 0.2": "trajectory.get",  # a look whether the name can be
    "trajectories get taught --overwrite": "trajectory.get",  # it says that grips are left out
}
"""What a command does without, or not all of it."""


def test_a_command_fails_by_what_it_needs_alone_and_says_that_this_is_missing(
    tmp_path: Path,
) -> None:
    sent = {line: requests for line, (_, requests) in sent_by_lines().items()}
    first = first_to_need(sent)
    assert len(first) > 100
    with a_shell(tmp_path / "home") as scene:
        for line in LINES:
            for lack in (lack for lack, name in first.items() if name == line):
                if BORNE.get(line) == lack.method or line == "doctor":
                    continue
                with lacking(scene.daemon, lack):
                    code, output = carried_out(line)
                data = json.loads(output.splitlines()[-1])["error"]["data"]
                assert (code, data["reason"]) == (4, "older_daemon"), (line, lack)
            assert carried_out(line)[0] == sent_by_lines()[line][0], line


# Fields -------------------------------------------------------------------------------------------


def without(name: str) -> Change:
    """Return what drops a field from every state that is sent."""

    def drop(value: Any) -> Any:
        if isinstance(value, list):
            return [drop(item) for item in value]
        if not isinstance(value, dict):
            return value
        is_state = {"seq", "bus", "motor"} <= value.keys()
        return {key: drop(item) for key, item in value.items() if not (is_state and key == name)}

    return lambda message: (drop(message),)


@pytest.mark.parametrize("name", NEWER_FIELDS)
def test_a_field_that_an_older_daemon_lacks_is_none_in_each_state_and_harms_no_call(
    tmp_path: Path, name: str
) -> None:
    with a_scene(tmp_path / "home", without(name)) as scene, ExitStack() as lacks:
        gripper = scene.gripper
        lacks.enter_context(lacking(scene.daemon, Lack("state.subscribe", "fields", name)))
        for step in (step for name, step in STEPS.items() if name not in LONG):
            ready(gripper)
            step(gripper)
        assert getattr(gripper.get_state(), name) is None
        for batch in (1, 4):
            with gripper.states(50, batch=batch) as states:
                assert [getattr(state, name) for state in islice(states, 5)] == [None] * 5
        with pytest.raises(CommandError) as caught:
            gripper.states(50, [name])
        assert caught.value.reason == "older_daemon"
        assert caught.value.message.endswith(f" lacks: gripper.states(fields=...), {name}")
