"""What was released and is of protocol 1 goes on being understood, by its daemons and its clients.

A daemon of now has all that a released one has; a client of now asks of a released one nothing by
itself that this does not know.
"""

import json
from collections.abc import Mapping

import pytest

from litegrip_client.values.results import NEWER_FIELDS, STATE_FIELDS
from litegripd.app.build import BY_NAME, encoded_document
from litegripd.model.gripper import DM4310
from tests.versions.lines import sent_by_lines
from tests.versions.older import sent_by_steps
from tests.versions.released import RELEASED, choices, document, is_later, parameters

NOW = json.loads(encoded_document(DM4310, simulated=True))

COMMON = {"sent_s", "stop_generation", "lease"}
"""Parameters that stand in no table of a document."""


def _still_read(method: str, name: str) -> Mapping[str, object]:
    """Return what a method makes of a number under a name that it has no more."""
    of_older = BY_NAME[method].of_older
    return {name: 1} if of_older is None else of_older({name: 1})


pytestmark = pytest.mark.parametrize("version", RELEASED)


def test_a_daemon_still_takes_what_a_released_client_may_ask(version: str) -> None:
    now = parameters(NOW)
    for method, before in parameters(document(version)).items():
        given = {name for name, one in before.items() if one["required"]}
        for name, parameter in before.items():
            if name not in now[method]:
                read = _still_read(method, name)
                assert name not in read, f"{method} has lost {name}"
                given |= read.keys()
                continue
            assert set(choices(parameter)) <= set(choices(now[method][name])), (method, name)
        required = {name for name, parameter in now[method].items() if parameter["required"]}
        assert required <= given, method


def test_a_daemon_still_sends_what_a_released_client_may_read(version: str) -> None:
    before, now = document(version)["components"], NOW["components"]
    for name, schema in before["schemas"].items():
        lost = schema["properties"].keys() - now["schemas"][name]["properties"].keys()
        assert not lost, f"{name} has lost {lost}"
        assert set(schema["required"]) <= set(now["schemas"][name]["required"]), name
    for reason, error in before["errors"].items():
        assert now["errors"][reason]["code"] == error["code"]
    notified = [{one["name"] for one in of["x-notifications"]} for of in (document(version), NOW)]
    assert notified[0] <= notified[1]


def test_a_field_of_the_state_that_a_released_daemon_lacks_is_none_there(version: str) -> None:
    has = document(version)["components"]["schemas"]["GripperState"]["properties"]
    assert set(STATE_FIELDS) - has.keys() <= set(NEWER_FIELDS)


def test_what_nobody_has_given_is_sent_only_where_a_released_daemon_knows_it(version: str) -> None:
    known = parameters(document(version))
    lines = {line: requests for line, (_, requests) in sent_by_lines().items()}
    for step, requests in {**sent_by_steps(), **lines}.items():
        if is_later(step, version):
            continue
        for method, given in requests:
            assert method in known, f"{step} needs {method}: say in SINCE which version brought it"
            unknown = given.keys() - known[method].keys() - COMMON
            assert not unknown, f"{step} sends {unknown} of {method}, which {version} refuses"
            for name, value in given.items():
                allowed = choices(known[method].get(name, {"schema": {}}))
                named = set(value if isinstance(value, list) else [value]) if allowed else set()
                assert named <= set(allowed), (step, method, name)
