"""This client at a daemon that lacks something: it says so, or does without, and never blames."""

from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from functools import cache
from itertools import islice
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import pytest

from litegrip_client import CommandError, LiteGripError, ParameterError, ProtocolError
from litegrip_client.values.results import NEWER_FIELDS
from litegrip_client.values.version import client_version
from litegrip_client.values.voices import in_python, in_shell
from litegripd.app.build import METHODS
from litegripd.rpc.method import Method
from tests.versions.other import Lack, Scene, a_scene, lacking, lacks_of
from tests.versions.steps import STEPS, ready, uncovered

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
            what = lack.method if lack.parameter is None else f"{lack.method} with {lack.parameter}"
            value = "" if lack.value is None else f", {lack.value}"
            said, stopped, _ = error.message.partition("; stopped (")
            assert said == f"{text}{voice(what, None, None)}{value}", lack
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


# What a program's calls need ----------------------------------------------------------------------


def test_there_is_a_step_for_each_call_of_the_client() -> None:
    assert uncovered() == set()


@cache
def sent_by_steps() -> dict[Lack, str]:
    """Return all that the client sends, and the first step in which it does."""
    found: dict[Lack, str] = {}
    with TemporaryDirectory() as folder, a_scene(Path(folder) / "home") as scene:
        for name, step in STEPS.items():
            ready(scene.gripper)
            scene.requests.clear()
            step(scene.gripper)
            for method, params in scene.requests:
                for lack in (Lack(method), *(Lack(method, parameter) for parameter in params)):
                    found.setdefault(lack, name)
    return found


def test_a_call_fails_by_what_it_needs_alone_and_says_that_this_is_missing(tmp_path: Path) -> None:
    sent = sent_by_steps()
    assert len(sent) > 100
    for number, (lack, name) in enumerate(sent.items()):
        with a_scene(tmp_path / str(number)) as scene:
            ready(scene.gripper)
            with lacking(scene.daemon, lack), pytest.raises(CommandError) as caught:
                STEPS[name](scene.gripper)
            assert caught.value.reason == "older_daemon", (lack, name)


# Fields -------------------------------------------------------------------------------------------


def without(name: str) -> Callable[[Any], Iterable[Any]]:
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
        for step in STEPS.values():
            ready(gripper)
            step(gripper)
        assert getattr(gripper.get_state(), name) is None
        for batch in (1, 4):
            with gripper.states(50, batch=batch) as states:
                assert [getattr(state, name) for state in islice(states, 5)] == [None] * 5
        with pytest.raises(CommandError) as caught:
            gripper.states(50, [name])
        assert caught.value.reason == "older_daemon"
        assert caught.value.message.endswith(f" lacks: gripper.states() with fields, {name}")
