"""The OpenRPC document against the table of methods and the table of errors."""

import re
from collections.abc import Iterator
from typing import Any

from litegripd.app.build import METHODS
from litegripd.model.errors import ERROR_TABLE
from litegripd.rpc.method import Param
from litegripd.rpc.openrpc import document
from tests.world import World

JSON_TYPES = {
    "number": "number",
    "integer": "integer",
    "boolean": "boolean",
    "string": "string",
    "strings": "array",
    "object": "object",
}


def test_rpc_discover_returns_the_document() -> None:
    assert World().client().result("rpc.discover") == document(METHODS)


def test_every_method_is_described_with_all_its_parameters() -> None:
    described = {method["name"]: method for method in document(METHODS)["methods"]}
    assert list(described) == [method.name for method in METHODS]
    for method in METHODS:
        entry = described[method.name]
        assert entry["summary"] == method.summary
        assert entry["paramStructure"] == "by-name"
        params = {param["name"]: param for param in entry["params"]}
        assert params.keys() == method.declared.keys()
        assert {"sent_s", "stop_generation"} <= params.keys()
        for name, param in method.declared.items():
            assert params[name]["description"]
            assert params[name]["required"] == param.required
            assert params[name]["schema"]["type"] == JSON_TYPES[param.kind]


def test_the_schemas_tell_the_same_limits_as_the_checks() -> None:
    for method in METHODS:
        for param in method.declared.values():
            schema = param.json_schema()
            for bound in ("minimum", "maximum"):
                limit = getattr(param, bound)
                assert schema.get(bound) == limit
                if limit is not None:
                    value = int(limit) if param.kind == "integer" else limit
                    assert param.problem(value) is None
                    assert param.problem(value - 1 if bound == "minimum" else value + 1)
            items = schema.get("items", schema)
            assert isinstance(items, dict)
            assert tuple(items.get("enum", ())) == param.choices
            is_free = param.kind in ("string", "strings") and not param.choices
            assert items.get("maxLength") == (param.longest if is_free else None)
            if is_free:
                for length in (param.longest, param.longest + 1):
                    value = "a" * length if param.kind == "string" else ["a" * length]
                    assert (param.problem(value) is None) is (length == param.longest)


def test_every_reason_is_documented_once_with_its_code() -> None:
    errors = document(METHODS)["components"]["errors"]
    assert list(errors) == [kind.reason for kind in ERROR_TABLE]
    assert len({kind.reason for kind in ERROR_TABLE}) == len(ERROR_TABLE)
    for kind in ERROR_TABLE:
        assert errors[kind.reason]["code"] == kind.code
        assert errors[kind.reason]["message"] == kind.meaning
        assert errors[kind.reason]["data"] == {"reason": kind.reason, "retryable": kind.retryable}


def test_a_range_is_told_in_words() -> None:
    assert "at most 3" in (Param("x", "number", "", maximum=3).problem(4) or "")
    assert "at least 3" in (Param("x", "number", "", minimum=3).problem(2) or "")
    assert "1 to 3" in (Param("x", "integer", "", minimum=1, maximum=3).problem(4) or "")


def schemas_in(value: object) -> Iterator[dict[str, Any]]:
    """Return every schema of a document but references, from outside to inside."""
    if isinstance(value, list):
        for one in value:
            yield from schemas_in(one)
    if not isinstance(value, dict):
        return
    if "$ref" not in value and {"type", "enum", "anyOf"} & value.keys() and "code" not in value:
        yield value
    for name, inner in value.items():
        of_members = name in ("properties", "schemas") and isinstance(inner, dict)
        yield from schemas_in(list(inner.values()) if of_members else inner)


def test_programs_that_write_clients_find_a_name_of_its_own_for_each_type() -> None:
    described = list(schemas_in(dict(document(METHODS))))
    assert len(described) > 500
    by_title: dict[str, dict[str, Any]] = {}
    for schema in described:
        assert re.fullmatch(r"[A-Z][A-Za-z0-9]+", schema.get("title", "")), schema
        assert by_title.setdefault(schema["title"], schema) == schema
    assert by_title["MotionGraspParamForceN"]["type"] == "number"
    assert by_title["GripperState"]["properties"]["opening_mm"]["title"] == "GripperStateOpeningMm"
