"""Values on their way to a successor process: the same when they arrive, or refused."""

import json
import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Any, Literal

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry
from litegripd.model.plain import (
    Carried,
    PlainError,
    memory,
    plain_of,
    restore,
    undeclared,
    value_of,
)


class Colour(Enum):
    RED = 1
    BLUE = 2


@dataclass(frozen=True, slots=True)
class Square:
    side: float
    colour: Colour = Colour.RED


@dataclass(frozen=True, slots=True)
class Circle:
    radius: int
    tags: tuple[str, ...] = ()
    inner: Square | None = None
    word: Literal["a", "b"] = "a"


SQUARES = st.builds(Square, st.floats(allow_nan=False), st.sampled_from(Colour))
SHAPES = SQUARES | st.builds(
    Circle,
    st.integers(),
    st.lists(st.text()).map(tuple),
    st.none() | SQUARES,
    st.sampled_from(["a", "b"]),
)


@given(SHAPES)
def test_what_arrives_is_what_was_sent(shape: Any) -> None:
    plain = json.loads(json.dumps(plain_of(shape)))
    assert value_of(plain, Square | Circle, "shape") == shape


@pytest.mark.parametrize(
    ("value", "kind"),
    [
        ({"a": 1.5, "b": None}, Mapping[str, float | int | None]),
        ({1: (1, 2)}, Mapping[int, tuple[int, int]]),
        (math.inf, float),
        (True, bool),
        ((1.0, 2.0, 3.0), tuple[float, float, float]),
        ({"any": ["thing", {"x": None}]}, object),
        (Geometry(0.1, -1.5, 74.8), Geometry | None),
    ],
)
def test_values_of_many_kinds(value: Any, kind: Any) -> None:
    assert value_of(json.loads(json.dumps(plain_of(value))), kind, "it") == value


@pytest.mark.parametrize(
    ("plain", "kind"),
    [
        ("1", int),
        (1.5, int),
        (True, int),
        (True, float),
        (None, float),
        (1, str),
        ("GREEN", Colour),
        (1, Colour),
        ("c", Literal["a", "b"]),
        ([], Literal["a", "b"]),
        ([1, 2], tuple[int, int, int]),
        ({}, tuple[int, ...]),
        ([], Mapping[str, int]),
        ({"x": 1}, Mapping[int, int]),
        ({"x": "1"}, Mapping[str, int]),
        ({"is": "Square", "side": 1.0}, Square),
        ({"is": "Square", "side": 1.0, "colour": "RED", "more": 1}, Square),
        ({"is": "Circle", "side": 1.0, "colour": "RED"}, Square),
        ({"is": ["Square"]}, Square | Circle),
        ({"side": 1.0, "colour": "RED"}, Square),
        ([], Square | None),
        ({"is": "Geometry", "closed_rad": 1.0, "open_rad": 1.0, "rad_to_mm": 7.0}, Geometry),
        ({"is": "Refusal", "reason": "no such", "message": "", "data": {}}, Refusal),
    ],
)
def test_what_is_not_as_declared_is_refused(plain: Any, kind: Any) -> None:
    with pytest.raises(PlainError):
        value_of(plain, kind, "it")


def test_an_error_says_where() -> None:
    plain = plain_of(Circle(1, inner=Square(2.0)))
    plain["inner"]["side"] = "wide"
    with pytest.raises(PlainError, match=r"shape.inner"):
        value_of(plain, Circle, "shape")


def test_what_cannot_be_sent_is_told() -> None:
    with pytest.raises(PlainError, match="set"):
        plain_of({1, 2})
    with pytest.raises(TypeError):
        value_of({}, set[int], "it")


class Inner:
    count: Carried[int] = 0


class Outer:
    inner: Carried[Inner]
    recent: Carried[deque[float]]
    shape: Carried[Square | None] = None
    NOT_CARRIED = ("passing",)

    def __init__(self) -> None:
        self.inner = Inner()
        self.recent = deque(maxlen=2)
        self.passing = "left"


def test_objects_are_filled_and_keep_their_bounds() -> None:
    source, target = Outer(), Outer()
    source.inner.count, source.passing, source.shape = 3, "changed", Square(2.0)
    source.recent.extend((1.0, 2.0, 3.0))
    inner = target.inner
    restore(target, json.loads(json.dumps(memory(source))))
    assert target.inner is inner
    assert (inner.count, target.passing, target.shape) == (3, "left", Square(2.0))
    assert target.recent == deque((2.0, 3.0))
    assert target.recent.maxlen == 2


def test_an_attribute_that_its_class_does_not_declare_is_a_defect() -> None:
    source = Outer()
    vars(source)["more"] = 1
    with pytest.raises(PlainError, match="more"):
        memory(source)
    assert undeclared(source) == {"more"}
    with pytest.raises(PlainError):
        restore(Outer(), {"is": "Outer"})


def test_an_attribute_that_is_declared_twice_or_not_there_is_a_defect() -> None:
    class Wrong:
        count: Carried[int] = 0
        recent: Carried[deque[float]]
        NOT_CARRIED = ("count", "gone")

    assert undeclared(Wrong()) == {"count", "recent", "gone"}
