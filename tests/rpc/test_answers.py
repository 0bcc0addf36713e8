"""Every answer and notification is what the OpenRPC document says, and nothing else is."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any, Literal, NewType, TypedDict

import pytest
from jsonschema import ValidationError

import litegripd
from litegripd.app.build import METHODS
from litegripd.app.config import Config
from litegripd.app.status import DaemonFacts
from litegripd.model.motor import BusSettings
from litegripd.rpc.method import Schemas, Shape
from litegripd.rpc.openrpc import NOTIFICATIONS
from tests.answers import Described, described, mutations
from tests.rpc.transcripts import talk
from tests.world import World, enabled_world, found_world

STAND_IN = {"health"}
"""Answered in a `World` by fixed facts, which have another figure than a daemon's."""

OPTIONAL = {
    "lease.lost": r"\.by is gone",
    "trajectory.delete": r"\.name is gone",
    "state.sample": r"\.state\.\w+ is gone",  # a subscription may leave fields out
    "config.get": r"\.ranges\.\w+ is gone",
    "config.set": r"\.ranges\.\w+ is gone",
    "calibration.manual": r"\.job is gone",  # what is left is the answer of another step
    "event": r"\.terms(\.message)? is gone",
}
"""What need not be there."""

Message = Mapping[str, Any]


@cache
def scenes() -> list[tuple[str, Message]]:
    """Return all that a session has been sent which uses every method, and some more."""
    told: list[tuple[str, Message]] = []
    for method, exchanges in talk().items():
        for exchange in exchanges:
            told.append((method, exchange["answer"]))
            told += [(line["method"], line) for line in exchange["notifications"]]
    return told + subscriptions() + refused_stream() + unusual()


def subscriptions() -> list[tuple[str, Message]]:
    """Return what subscriptions bring while a motion, a stop and a loss happen."""
    world = World().start()
    client, other = world.client(), world.client()
    client.result("events.subscribe", kinds=["job_started", "job_ended", "lease_lost", "stop"])
    client.result("state.subscribe", hz=50)
    client.result("state.subscribe", hz=50, fields=["opening_mm", "job", "clamp_n"], batch=3)
    client.result("state.subscribe", hz=50, fields=["stop", "mode"])
    client.result("lease.acquire")
    client.result("motor.enable")
    client.result("motion.open", speed_mm_s=100, progress=True)
    other.result("lease.take", why="a test")
    other.result("stop", why="a test")
    other.result("stop.clear")
    again = client.call("events.subscribe")
    world.run(0.2)
    client.read()
    return [("events.subscribe", again)] + [(line["method"], line) for line in client.notifications]


def refused_stream() -> list[tuple[str, Message]]:
    """Return what tells that a set-point, or a frame, without an id was refused."""
    world, client = found_world()
    for line in (
        b'{"jsonrpc":"2.0","method":"stream.set","params":{"opening_mm":30}}',
        b'{"jsonrpc":"2.0","method":"teleop.receive","params":{"topic":"a","payload":"00"}}',
    ):
        world.service.handle(client.session, line, world.now_s)
    client.read()
    return [(told["method"], told) for told in client.notifications]


def unusual() -> list[tuple[str, Message]]:
    """Return answers without a calibration, and while and after a hold by force."""
    bare = World(calibrated=False).start().client()
    told: list[tuple[str, Message]] = [
        (method, bare.call(method)) for method in ("state.get", "calibration.get", "teleop.status")
    ]
    world, client = enabled_world()
    world.gripper.put_object(width_mm=30.0)
    told.append(("motion.grasp", client.call("motion.grasp", force_n=5, until="verdict")))
    told.append(("state.get", client.call("state.get")))
    told.append(("job.list", client.call("job.list")))
    told.append(("lease.acquire", client.call("lease.acquire")))
    told.append(("lease.get", client.call("lease.get")))
    return told


NAMES = sorted(
    {"no.such.method"}
    | {method.name for method in METHODS} - STAND_IN
    | {kind.name for kind in NOTIFICATIONS}
)


def of(name: str) -> list[Message]:
    return [message for method, message in scenes() if method == name]


def form_of(value: Any) -> Any:
    """Return what a value is made of: what has the same form is mutated alike."""
    if isinstance(value, dict):
        return tuple((name, form_of(item)) for name, item in value.items())
    return tuple(map(form_of, value[:1])) if isinstance(value, list) else type(value)


def facts_of(world: World) -> DaemonFacts:
    return DaemonFacts(Config("can0", BusSettings("socketcan", "can0", 1_000_000)), world.machine)


def test_the_scenes_have_every_method_and_notification() -> None:
    answered = {name for name, message in scenes() if "result" in message}
    sent = {message["method"] for _name, message in scenes() if "method" in message}
    refused = {"lease.resume"}  # in the conversation; it answers as lease.acquire does
    assert answered | refused >= {method.name for method in METHODS}
    assert sent == {kind.name for kind in NOTIFICATIONS}


def test_every_notification_that_is_sent_is_described() -> None:
    folder = Path(litegripd.__file__).parent
    sources = "".join(path.read_text() for path in folder.rglob("*.py"))
    sent = set(re.findall(r'notification_line\(\s*"([\w.]+)"', sources))
    sent |= {method.refused_as for method in METHODS if method.may_notify}
    assert sent == {kind.name for kind in NOTIFICATIONS}


@pytest.mark.parametrize("closed", [False, True])
@pytest.mark.parametrize("name", NAMES)
def test_what_is_sent_is_as_described(name: str, closed: bool) -> None:
    for message in of(name):
        described(closed=closed).check(message, name)


@pytest.mark.parametrize("name", NAMES)
def test_what_is_mutated_is_not_as_described(name: str) -> None:
    for message in {form_of(message): message for message in of(name)}.values():
        part = "result" if "result" in message else "params"
        for text, bad in mutations(message.get(part, {})):
            if name in OPTIONAL and re.fullmatch(OPTIONAL[name], text):
                continue
            assert not described().holds({**message, part: bad}, name), text


def test_more_members_than_declared_are_found() -> None:
    (state, *_) = of("state.get")
    more = {**state, "result": {**state["result"], "new": 1}}
    with pytest.raises(ValidationError):
        described(closed=True).check(more, "state.get")
    described(closed=False).check(more, "state.get")  # a client has to bear them


def test_an_error_without_its_reason_is_not_as_described() -> None:
    error = {"code": -32602, "message": "", "data": {"reason": "x", "retryable": False, "by": 1}}
    described().check({"error": error})
    with pytest.raises(ValidationError):
        described().check({"error": {**error, "data": {"retryable": False}}})


def test_a_row_of_a_batch_that_has_another_type_is_found() -> None:
    (batch, *_) = of("state.batch")
    rows = [[{"no": "number"}, *row[1:]] for row in batch["params"]["rows"]]
    with pytest.raises(ValidationError):
        described().check({**batch, "params": {**batch["params"], "rows": rows}})


def test_the_daemons_own_facts_are_as_described() -> None:
    for world in (World().start(), World(calibrated=False)):
        facts = facts_of(world)
        own = {"client": 1, "role": "admin", "monotonic_s": 1.0, "stop_generation": 0}
        hello: dict[str, Any] = {**facts.hello(), **own}
        for method, result in (
            ("hello", hello),
            ("info.get", dict(facts.info())),
            ("health", dict(facts.health(world.now_s))),
        ):
            described().check({"result": result}, method)
        with pytest.raises(ValidationError):
            described().check({"result": {**hello, "motor": None}}, "hello")


class _Inner(TypedDict):
    a: int


class _Optional(_Inner, total=False):
    b: str | None


@dataclass(frozen=True)
class _Own:
    row: tuple[float, float]
    inner: _Optional
    choice: Literal["x", "y"]


_Other = NewType("_Other", dict[str, Any])


def test_schemas_are_made_from_types() -> None:
    schemas = Schemas({_Other: Shape("Both", (_Inner, _Own), closed=True)})
    assert schemas.of(dict[str, list[_Other]]) == {
        "type": "object",
        "additionalProperties": {
            "type": "array",
            "items": {"$ref": "#/components/schemas/Both"},
        },
    }
    both = schemas.definitions["Both"]
    assert both["required"] == ["a", "row", "inner", "choice"]
    assert both["additionalProperties"] is False
    assert both["properties"]["choice"] == {"enum": ["x", "y"]}
    assert both["properties"]["row"]["minItems"] == 2
    assert schemas.definitions["_Optional"]["required"] == ["a"]


@pytest.mark.parametrize("kind", [bytes, set[int], tuple[int, str], dict[int, int]])
def test_a_type_without_a_form_is_refused(kind: Any) -> None:
    with pytest.raises(TypeError, match="form"):
        Schemas({}).of(kind)


def test_two_types_of_one_name_are_refused() -> None:
    schemas = Schemas({})
    schemas.of(Shape("Same", (_Inner,)))
    with pytest.raises(TypeError, match="Same"):
        schemas.of(Shape("Same", (_Own,)))


def test_a_document_can_be_read_by_who_has_only_its_json() -> None:
    sent = World().client().result("rpc.discover")
    told = Described(sent, closed=True)
    for message in of("state.get"):
        told.check(message, "state.get")
