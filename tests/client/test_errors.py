import re
from pathlib import Path

import pytest

import litegrip_client
from litegrip_client.values.errors import (
    OWN_REASONS,
    LiteGripError,
    exit_code,
    from_error_object,
)
from litegripd.model.errors import ERROR_TABLE, ErrorKind, Refusal
from litegripd.rpc.jsonrpc import error_object


@pytest.mark.parametrize("kind", ERROR_TABLE, ids=lambda kind: kind.reason)
def test_every_row_of_the_table_becomes_its_exception_whatever_its_reason(kind: ErrorKind) -> None:
    refusal = Refusal(kind.reason, "so it is", {"limit": 3})
    error = from_error_object(error_object(refusal))
    assert type(error) is getattr(litegrip_client, kind.exception)
    assert (error.reason, error.code, error.message) == (kind.reason, kind.code, "so it is")
    assert error.retryable is kind.retryable
    assert error.data["limit"] == 3
    assert exit_code(error) == kind.exit_code
    newer = from_error_object({"code": kind.code, "message": "m", "data": {"reason": "newer"}})
    assert (type(newer), newer.reason) == (type(error), "newer")  # a known code's exception


@pytest.mark.parametrize(
    "data",
    [
        {"code": -1, "message": "m", "data": {"reason": "newer"}},
        {"code": -1, "message": "m"},
        {"code": "x", "message": "m", "data": {"reason": ["list"]}},
        {"message": "m", "data": "text"},
    ],
)
def test_what_is_not_known_at_all_is_the_base(data: dict[str, object]) -> None:
    error = from_error_object(data)
    assert type(error) is LiteGripError
    assert (error.message, exit_code(error)) == ("m", 70)
    assert (error.retryable, error.hint, error.owner) == (False, None, None)


def test_an_error_that_is_no_object_is_a_protocol_error() -> None:
    assert type(from_error_object("oops")) is litegrip_client.ProtocolError


def test_every_reason_of_the_client_is_in_one_of_the_two_tables() -> None:
    sources = Path(litegrip_client.__file__).parent.rglob("*.py")
    texts = (source.read_text(encoding="utf-8") for source in sources)
    named = r'reason="(\w+)"|_?end\(f?".*", "(\w+)"\)'  # the latter ends a connection
    used = {a or b for text in texts for a, b in re.findall(named, text)}
    assert "no_daemon" in used
    daemons = {kind.reason for kind in ERROR_TABLE}
    assert used == (used & daemons) | set(OWN_REASONS)
    assert not daemons & set(OWN_REASONS)


OF_THE_SHELL = {"wrong_usage", "not_wanted", "interrupted"}


@pytest.mark.parametrize("reason", sorted(set(OWN_REASONS) - OF_THE_SHELL))
def test_the_exit_code_of_the_clients_reasons_is_as_documented(reason: str) -> None:
    exception, code, _ = OWN_REASONS[reason]
    assert exit_code(getattr(litegrip_client, exception)("m", reason=reason)) == code


def test_the_clients_own_errors_have_the_exit_code_of_their_class() -> None:
    assert exit_code(litegrip_client.ConnectError("m", reason="no_daemon")) == 3
    assert exit_code(litegrip_client.CommandError("m")) == 4
    assert exit_code(litegrip_client.ProtocolError("m")) == 70


def test_the_classes_are_related_as_the_documents_say() -> None:
    assert issubclass(litegrip_client.ConnectError, ConnectionError)
    assert issubclass(litegrip_client.ParameterError, ValueError)
    for name in ("BusyError", "StoppedError", "CancelledError", "ParameterError"):
        assert issubclass(getattr(litegrip_client, name), litegrip_client.CommandError)
    for name in ("ProtocolError", "CommandError", "HardwareError", "ConnectError"):
        assert issubclass(getattr(litegrip_client, name), LiteGripError)
