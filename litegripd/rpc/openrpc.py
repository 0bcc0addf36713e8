"""The OpenRPC document, made from the table of methods and the table of errors."""

from functools import lru_cache
from typing import Any

from litegripd.model.errors import ERROR_TABLE
from litegripd.rpc.method import Method
from litegripd.rpc.methods import METHODS
from litegripd.rpc.schema import Param
from litegripd.rpc.wire import encode

OPENRPC_VERSION = "1.2.6"
PROTOCOL_VERSION = 1


@lru_cache(maxsize=1)
def encoded_document() -> bytes:
    """Return the document as JSON; encoding it takes longer than any other request."""
    return encode(document())


def document() -> dict[str, Any]:
    """Describe all methods and errors."""
    return {
        "openrpc": OPENRPC_VERSION,
        "info": {"title": "litegripd", "version": str(PROTOCOL_VERSION)},
        "methods": [_method(method) for method in METHODS],
        "components": {
            "errors": {
                kind.reason: {
                    "code": kind.code,
                    "message": kind.meaning,
                    "data": {"reason": kind.reason, "retryable": kind.retryable},
                }
                for kind in ERROR_TABLE
            }
        },
    }


def _method(method: Method) -> dict[str, Any]:
    return {
        "name": method.name,
        "summary": method.summary,
        "paramStructure": "by-name",
        "params": [_param(param) for param in method.declared.values()],
        "result": {"name": "result", "description": method.result, "schema": {"type": "object"}},
    }


def _param(param: Param) -> dict[str, Any]:
    return {
        "name": param.name,
        "description": param.description,
        "required": param.required,
        "schema": param.json_schema(),
    }
