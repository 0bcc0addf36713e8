"""Parameters of methods: their types and ranges, checked and described from one definition."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Literal, TypeAlias

from litegripd.model.errors import Refusal

Kind: TypeAlias = Literal["number", "integer", "boolean", "string", "strings", "object"]

_MAX_TEXT = 256
_MAX_INTEGER = 2**53  # beyond it most JSON readers lose digits
_JSON_TYPES: dict[Kind, str] = {"strings": "array"}
_NAMED: dict[Kind, str] = {
    "number": "a number",
    "integer": "an integer",
    "boolean": "true or false",
    "string": "a string",
    "strings": "an array of strings only",
    "object": "an object",
}


@dataclass(frozen=True, slots=True)
class Param:
    """One parameter of a method; `minimum` and `maximum` are included in the range.

    A text has at most `longest` characters.
    """

    name: str
    kind: Kind
    description: str
    required: bool = False
    minimum: float | None = None
    maximum: float | None = None
    choices: tuple[str, ...] = ()
    longest: int = _MAX_TEXT

    def problem(self, value: object) -> str | None:
        """Say what is wrong with `value` and what is allowed, if anything is wrong."""
        if not self._has_type(value):
            return f"must be {_NAMED[self.kind]}, not {_shown(value)}"
        if isinstance(value, int | float) and not isinstance(value, bool):
            return self._problem_of_number(value)
        texts = value if isinstance(value, list) else [value] if isinstance(value, str) else []
        return next(filter(None, map(self._problem_of_text, texts)), None)

    def _problem_of_number(self, value: float) -> str | None:
        if isinstance(value, int) and abs(value) > _MAX_INTEGER:
            return f"is {_shown(value)}, it must lie within ±2^53"
        if not math.isfinite(value):
            return f"must be a finite number, not {value}"
        low, high = self.minimum, self.maximum
        if (low is not None and value < low) or (high is not None and value > high):
            return f"is {_shown(value)}, it must be {self._range()}"
        return None

    def _problem_of_text(self, text: str) -> str | None:
        if self.choices and text not in self.choices:
            return f"is {_shown(text)}, it must be one of: {', '.join(self.choices)}"
        if len(text) > self.longest:
            return f"is longer than {self.longest} characters"
        if not text.isprintable():
            return f"is {_shown(text)}, it must be printable: it is shown in one line of the log"
        return None

    def json_schema(self) -> dict[str, object]:
        """Describe the values by JSON Schema."""
        schema: dict[str, object] = {"type": _JSON_TYPES.get(self.kind, self.kind)}
        if self.kind == "strings":
            schema["items"] = {"type": "string", **self._text_limits()}
        elif self.kind == "string":
            schema |= self._text_limits()
        if self.minimum is not None:
            schema["minimum"] = self.minimum
        if self.maximum is not None:
            schema["maximum"] = self.maximum
        return schema

    def _text_limits(self) -> dict[str, object]:
        """Describe which texts are taken; JSON Schema counts characters, too."""
        return {"enum": list(self.choices)} if self.choices else {"maxLength": self.longest}

    def _has_type(self, value: object) -> bool:
        if self.kind == "boolean":
            return isinstance(value, bool)
        if self.kind == "string":
            return isinstance(value, str)
        if self.kind == "object":
            return isinstance(value, dict)
        if self.kind == "strings":
            return isinstance(value, list) and all(isinstance(item, str) for item in value)
        if isinstance(value, bool):
            return False
        return isinstance(value, int if self.kind == "integer" else int | float)

    def _range(self) -> str:
        if self.minimum is None:
            return f"at most {self.maximum:g}"
        if self.maximum is None:
            return f"at least {self.minimum:g}"
        return f"{self.minimum:g} to {self.maximum:g}"


def check(method: str, declared: Mapping[str, Param], given: Mapping[str, Any]) -> Refusal | None:
    """Say why parameters are refused: unknown, missing, of the wrong type or out of range."""
    for name, value in given.items():
        param = declared.get(name)
        if param is None:
            allowed = ", ".join(declared) or "none"
            text = f"{method} has no parameter {_shown(name)}; it has: {allowed}"
            return Refusal("invalid_params", text, {"parameter": name[:64]})
        problem = param.problem(value)
        if problem is not None:
            text = f"{method}: {name} {problem}"
            return Refusal("invalid_params", text, {"parameter": name})
    for param in declared.values():
        if param.required and param.name not in given:
            text = f"{method} needs the parameter {param.name}: {param.description}"
            return Refusal("invalid_params", text, {"parameter": param.name})
    return None


def _shown(value: object) -> str:
    if isinstance(value, list | dict):
        return "an array" if isinstance(value, list) else "an object"
    text = repr(value)
    return text if len(text) <= 60 else text[:57] + "..."
