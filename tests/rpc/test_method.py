"""A method's row stands above its function, and is found there."""

from collections.abc import Mapping

import pytest

from litegripd.app.build import BY_NAME, GROUPS, METHODS
from litegripd.rpc.method import Call, Method, functions_of, methods_of
from litegripd.rpc.methods.lease import Tokens
from litegripd.rpc.service import Requests
from tests.world import World, enabled_world


class _Group:
    @property
    def broken(self) -> object:
        raise AssertionError("looking for rows reads no property")

    @Method("b.second", "", "", Mapping)
    def _second(self, _call: Call) -> bytes:
        return b"2"

    def helper(self) -> None:
        """Have no row."""

    @Method("a.first", "", "", Mapping)
    def _first(self, _call: Call) -> bytes:
        return b"1"


def test_rows_are_found_in_the_order_of_their_functions() -> None:
    assert [row.name for row in methods_of(_Group)] == ["b.second", "a.first"]


def test_functions_are_found_by_the_names_of_their_methods() -> None:
    group = _Group()
    assert functions_of(group) == {"b.second": group._second, "a.first": group._first}


def test_no_two_methods_have_one_name() -> None:
    assert len(BY_NAME) == len(METHODS) == sum(len(methods_of(group)) for group in GROUPS)


def test_methods_without_an_object_are_found_at_the_start() -> None:
    controller, tokens = World().controller, Tokens(lambda: "")
    with pytest.raises(LookupError, match=r"state\.get"):
        Requests(controller, tokens, BY_NAME, [])
    with pytest.raises(LookupError, match=r"b\.second"):
        Requests(controller, tokens, BY_NAME, [_Group()])


def test_an_array_with_something_else_in_it_is_told_what() -> None:
    _, client = enabled_world()
    told = "events.subscribe: kinds must be an array of strings only, and has 3 in it"
    client.refused("events.subscribe", "invalid_params", told, kinds=["stop", 3])


@pytest.mark.parametrize(
    ("method", "given", "told"),
    [
        ("motion.set_force", {"force_n": "x"}, "force_n is 'x', it must be a number"),
        ("motion.open", {"wait": [1]}, "wait is an array, it must be true or false"),
        ("motion.move", {"opening_mm": 9, "kp": 900}, "kp is 900, it must be 5 to 500 N·m/rad"),
        ("motion.move", {"opening_mm": 9, "kd": 9}, "kd is 9, it must be 0.1 to 5 N·m·s/rad"),
        ("trajectory.play", {"name": "a", "repeat": 0}, "repeat is 0, it must be 1 to 1000000"),
    ],
)
def test_a_value_that_cannot_be_is_told_with_its_range_and_unit(
    method: str, given: dict[str, object], told: str
) -> None:
    _, client = enabled_world()
    client.refused(method, "invalid_params", f"{method}: {told}", **given)


@pytest.mark.parametrize("if_busy", ["replace", "queue"])
def test_what_a_function_raises_is_a_refusal_whenever_its_turn_comes(if_busy: str) -> None:
    _, client = enabled_world()
    running = client.result("motion.open", wait=False)["job"]
    both = {"opening_mm": 30, "openness": 0.5}
    data = client.refused("motion.move", "invalid_params", if_busy=if_busy, **both)
    assert data["parameter"] == "opening_mm"
    assert client.result("job.wait", job=running)["state"] == "done"
