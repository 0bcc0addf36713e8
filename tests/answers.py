"""What the OpenRPC document says of answers and notifications, held against real ones."""

from collections.abc import Iterator, Mapping
from copy import deepcopy
from functools import lru_cache
from typing import Any

from jsonschema import Draft202012Validator, ValidationError

from litegripd.app.build import METHODS
from litegripd.rpc.openrpc import document

GROWING = frozenset({"ErrorData"})
"""Objects that have members beyond what is declared: an error has others for each reason."""

JsonSchema = dict[str, Any]


class Described:
    """The schemas of one document.

    With `closed` no object may have a member that is not declared. A client must bear such; what
    today's daemon sends must have none.
    """

    def __init__(self, described: Mapping[str, Any], *, closed: bool) -> None:
        components = deepcopy(described["components"]["schemas"])
        for name, schema in components.items():
            if closed and name not in GROWING:
                schema["additionalProperties"] = False
        self._components = {"schemas": components}
        self.results = {
            method["name"]: self._validator(method["result"]["schema"])
            for method in described["methods"]
        }
        self.notifications = {
            kind["name"]: self._validator(kind["params"]["schema"])
            for kind in described["x-notifications"]
        }
        self._error = self._validator({"$ref": "#/components/schemas/ErrorObject"})
        self._state = self._validator({"$ref": "#/components/schemas/PartialState"})

    def _validator(self, schema: JsonSchema) -> Draft202012Validator:
        whole = {**schema, "components": self._components}
        Draft202012Validator.check_schema(whole)
        return Draft202012Validator(whole)

    def check(self, message: Mapping[str, Any], method: str | None = None) -> None:
        """Raise `jsonschema.ValidationError` for what is not as described.

        `message` is a whole line of the daemon's: a notification, or the answer of `method`.
        """
        if "method" in message:
            _validate(self.notifications[message["method"]], message["params"])
            if message["method"] == "state.batch":
                self._check_rows(message["params"])
        elif "error" in message:
            _validate(self._error, message["error"])
        elif method is not None:
            _validate(self.results[method], message["result"])

    def holds(self, message: Mapping[str, Any], method: str) -> bool:
        """True if a whole line is as described."""
        try:
            self.check(message, method)
        except ValidationError:
            return False
        return True

    def _check_rows(self, params: Mapping[str, Any]) -> None:
        for row in params["rows"]:
            _validate(self._state, dict(zip(params["fields"], row, strict=True)))


def _validate(validator: Draft202012Validator, value: Any) -> None:
    """Raise the first error; `validate` would look for the one that tells most."""
    for error in validator.iter_errors(value):
        raise error


@lru_cache(maxsize=2)
def described(*, closed: bool = True) -> Described:
    """Return what today's document says."""
    return Described(document(METHODS), closed=closed)


FREE = frozenset(
    {"content", "control", "registers", "components", "info", "methods", "x-notifications", "data"}
)
"""Members whose inside is not described, or not alike for all."""


def mutations(value: Any, path: str = "") -> Iterator[tuple[str, Any]]:
    """Yield copies of a value with one thing wrong: a member that is gone, or of another type."""
    if isinstance(value, dict):
        for name, item in value.items():
            here = f"{path}.{name}"
            yield f"{here} is gone", {key: one for key, one in value.items() if key != name}
            yield f"{here} has another type", {**value, name: _another(item)}
            if name not in FREE:
                yield from ((text, {**value, name: bad}) for text, bad in mutations(item, here))
    elif isinstance(value, list) and value:
        for text, bad in mutations(value[0], f"{path}[0]"):
            yield text, [bad, *value[1:]]


def _another(value: Any) -> Any:
    """Return what no member takes in the place of a value."""
    return 0.5 if isinstance(value, dict | list) else {"no": ["such", "thing"]}
