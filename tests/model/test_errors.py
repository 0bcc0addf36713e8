"""The error table and the small values around it."""

import pytest

from litegripd.model.errors import ERROR_TABLE, ERRORS, Refusal
from litegripd.model.motor import Status, is_fault, status_name
from litegripd.motor.phases import REMEDIES, fault_refusal


def test_reasons_and_codes_are_unique() -> None:
    assert len({kind.reason for kind in ERROR_TABLE}) == len(ERROR_TABLE) == len(ERRORS)
    assert len({kind.code for kind in ERROR_TABLE}) == len(ERROR_TABLE)
    assert all(kind.code < 0 and 1 < kind.exit_code < 128 for kind in ERROR_TABLE)


def test_a_refusal_has_a_reason_of_the_table() -> None:
    assert Refusal("busy", "somebody moves").kind is ERRORS["busy"]
    with pytest.raises(KeyError, match="no_such_reason"):
        Refusal("no_such_reason", "never")


@pytest.mark.parametrize("code", range(16))
def test_every_status_has_a_name_and_every_fault_a_remedy(code: int) -> None:
    assert is_fault(code) == (code not in (0, 1))
    if is_fault(code):
        refusal = fault_refusal(code)
        assert refusal.reason == "motor_fault"
        assert refusal.data["status"] == status_name(code)
        assert refusal.data["hint"]


def test_every_known_fault_has_a_remedy_of_its_own() -> None:
    assert set(REMEDIES) == set(Status) - {Status.DISABLED, Status.ENABLED}
    assert len(set(REMEDIES.values())) == len(REMEDIES)
    assert status_name(3) == "unknown_3"
