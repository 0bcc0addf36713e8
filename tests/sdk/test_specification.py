"""The package has what the specification lists: exports, members, defaults, signatures, bases."""

import copy
import dataclasses
import enum
import importlib
import inspect
import json
import sys
import time
from pathlib import Path
from typing import Any

import pytest

import litegrip
from tests.sdk import table

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

SPECIFIED: dict[str, Any] = tomllib.loads(
    (Path(__file__).parent / "specification.toml").read_text(encoding="utf-8")
)


def found(path: str) -> Any:
    """Return a module, or what a module has, by its whole name."""
    try:
        return importlib.import_module(path)
    except ModuleNotFoundError:
        module, _, name = path.rpartition(".")
        return getattr(importlib.import_module(module), name)


def pairs(table: str) -> list[Any]:
    """Return each row of a table of tables: its path, name and value."""
    return [
        pytest.param(path, name, value, id=f"{path}.{name}")
        for path, rows in SPECIFIED[table].items()
        for name, value in rows.items()
    ]


@pytest.mark.parametrize("module", SPECIFIED["modules"])
def test_each_name_can_be_imported_from_its_module(module: str) -> None:
    names = SPECIFIED["modules"][module].split()
    assert [name for name in names if not hasattr(found(module), name)] == []
    exec(f"from {module} import {', '.join(names)}", {})


def test_the_package_lists_its_names_in_the_order() -> None:
    lazy = {"ZenohTeleopTransport", "Listener", "Connector", "LatestSlot"}
    added = {"WriteZeroResult", "GripperGeometry"}
    names = [name for name in SPECIFIED["modules"]["litegrip"].split() if name not in lazy | added]
    assert [name for name in litegrip.__all__ if name not in added] == names
    assert lazy | set(names) | added <= set(dir(litegrip))


@pytest.mark.parametrize(("name", "base"), SPECIFIED["bases"].items())
def test_each_exception_has_its_base(name: str, base: str) -> None:
    kind = getattr(litegrip, name)
    assert kind.__bases__ == (Exception if base == "Exception" else getattr(litegrip, base),)


@pytest.mark.parametrize("path", SPECIFIED["enums"])
def test_each_enumeration_has_its_members(path: str) -> None:
    row, kind = SPECIFIED["enums"][path], found(path)
    assert issubclass(kind, getattr(enum, row["kind"]))
    assert {name: int(value) for name, value in kind.__members__.items()} == row["members"]


@pytest.mark.parametrize(("path", "name", "value"), pairs("constants"))
def test_each_constant_has_its_value(path: str, name: str, value: object) -> None:
    have = getattr(found(path), name)
    assert have == pytest.approx(value) if isinstance(value, float) else have == value
    assert isinstance(have, type(value))


@pytest.mark.parametrize("path", SPECIFIED["types"])
def test_each_value_has_its_fields_in_order(path: str) -> None:
    row, kind = SPECIFIED["types"][path], found(path)
    have = dataclasses.fields(kind)
    assert [one.name for one in have] == [name for name, _ in row["fields"]]
    for one, (name, default) in zip(have, row["fields"], strict=True):
        match default:
            case "required":
                assert one.default is one.default_factory is dataclasses.MISSING
            case "now" | "empty":
                assert one.default_factory is not dataclasses.MISSING
            case "none":
                assert one.default is None
                assert hasattr(kind, name)
            case "a clock":
                assert one.default in (time.sleep, time.monotonic)
                assert (one.repr, one.compare) == (False, False)
            case _:
                assert (
                    one.default == pytest.approx(default)
                    if isinstance(default, float)
                    else one.default == default
                )
                assert isinstance(one.default, type(default))
                assert hasattr(kind, name)  # programs look for fields on the class
    for name in row["properties"].split():
        assert isinstance(inspect.getattr_static(kind, name), property)


@pytest.mark.parametrize("path", SPECIFIED["types"])
def test_each_value_can_be_made_assigned_copied_and_compared(path: str) -> None:
    row, kind = SPECIFIED["types"][path], found(path)
    made = kind(*[1.0 for _, default in row["fields"] if default == "required"])
    again = copy.copy(made)
    assert again == made
    assert dataclasses.replace(made) == made
    assert list(dataclasses.asdict(made)) == [name for name, _ in row["fields"]]
    name = row["fields"][0][0]
    if row.get("frozen"):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(made, name, 2.0)
    else:
        setattr(again, name, 2.0)
        assert again != made


@pytest.mark.parametrize(("path", "name", "signature"), pairs("signatures"))
def test_each_method_has_its_signature(path: str, name: str, signature: str) -> None:
    assert said(getattr(found(path), name)) == signature


@pytest.mark.parametrize(("path", "signature"), SPECIFIED["functions"].items())
def test_each_function_has_its_signature(path: str, signature: str) -> None:
    assert said(found(path)) == signature


def said(function: Any) -> str:
    """Return a signature without its annotations."""
    signature = inspect.signature(function)
    bare = [
        one.replace(annotation=inspect.Parameter.empty) for one in signature.parameters.values()
    ]
    return str(signature.replace(parameters=bare, return_annotation=inspect.Signature.empty))


@pytest.mark.parametrize("path", SPECIFIED["properties"])
def test_each_attribute_is_there(path: str) -> None:
    kind = found(path)
    names = SPECIFIED["properties"][path].split()
    made = None
    if kind is litegrip.LiteGrip or kind.__name__ in ("MotorState", "LatestSlot"):
        made = kind()
    for name in names:
        assert hasattr(kind if made is None else made, name), name


def test_the_data_files_lie_beside_the_modules() -> None:
    folder = Path(litegrip.__file__).parent
    for name in ("factory_calibration", "calibration_normal", "calibration_reverse"):
        assert isinstance(json.loads((folder / f"{name}.json").read_text()), dict)
    assert (folder / "py.typed").exists()
    assert list(litegrip.CALIB_TEMPLATES) == litegrip.list_templates() == ["normal", "reverse"]
    for path in litegrip.CALIB_TEMPLATES.values():
        assert Path(path).parent == folder
    assert Path(litegrip.gripper._FACTORY_CALIB) == folder / "factory_calibration.json"


def test_the_page_has_each_name_and_what_differs() -> None:
    assert table.PAGE.read_text(encoding="utf-8") == table.page()
