"""The OpenRPC document, made from the tables of methods, notifications and errors."""

from functools import lru_cache
from typing import Any

from litegripd.model.errors import ERROR_TABLE
from litegripd.rpc.answers import AT_ONCE, Discovered
from litegripd.rpc.forms import FORMS
from litegripd.rpc.method import WAIT, Method
from litegripd.rpc.methods import METHODS
from litegripd.rpc.notifications import NOTIFICATIONS, Notification
from litegripd.rpc.schema import Param
from litegripd.rpc.type_schema import Schema, Schemas
from litegripd.rpc.wire import encode

OPENRPC_VERSION = "1.2.6"
PROTOCOL_VERSION = 1


@lru_cache(maxsize=1)
def encoded_document() -> bytes:
    """Return the document as JSON; the first time that takes longer than a tick."""
    return encode(document())


def document() -> Discovered:
    """Describe all methods, notifications and errors.

    OpenRPC has no word for what a server sends unasked: an extension of the document does.
    """
    schemas = Schemas(FORMS)
    return {
        "openrpc": OPENRPC_VERSION,
        "info": {"title": "litegripd", "version": str(PROTOCOL_VERSION)},
        "methods": [_method(method, schemas) for method in METHODS],
        "x-notifications": [_notification(kind, schemas) for kind in NOTIFICATIONS],
        "components": {
            "schemas": schemas.definitions,
            "errors": {
                kind.reason: {
                    "code": kind.code,
                    "message": kind.meaning,
                    "data": {"reason": kind.reason, "retryable": kind.retryable},
                }
                for kind in ERROR_TABLE
            },
        },
    }


def result_schema(method: Method, schemas: Schemas) -> Schema:
    """Describe the results of a method; one that can be told not to wait has two."""
    schema = schemas.of(method.returns)
    if WAIT.name in method.declared:
        schema = {"anyOf": [schema, schemas.of(AT_ONCE)]}
    return {"type": "object", **schema}


def _method(method: Method, schemas: Schemas) -> dict[str, Any]:
    return {
        "name": method.name,
        "summary": method.summary,
        "paramStructure": "by-name",
        "params": [_param(param) for param in method.declared.values()],
        "result": {
            "name": "result",
            "description": method.result,
            "schema": result_schema(method, schemas),
        },
    }


def _notification(kind: Notification, schemas: Schemas) -> dict[str, Any]:
    return {
        "name": kind.name,
        "summary": kind.summary,
        "params": {"name": "params", "schema": schemas.of(kind.params)},
    }


def _param(param: Param) -> dict[str, Any]:
    return {
        "name": param.name,
        "description": param.description,
        "required": param.required,
        "schema": param.json_schema(),
    }
