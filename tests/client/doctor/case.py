"""What the cases of all checks are made of."""

from typing import NamedTuple

from litegrip_client.ctl.doctor.facts import Facts


class Case(NamedTuple):
    """A check, the facts, and what it must find; `level` None where nothing is to be found."""

    check: str
    facts: Facts
    level: str | None
    says: str = ""
    command: str | None = None
    advises: str | None = None
