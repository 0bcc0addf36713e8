"""What each method does: its function, found by its name in the table."""

from collections.abc import Mapping
from typing import Any

from litegripd.model.jobs import Owner
from litegripd.rpc.calls import Answer, Call, Function
from litegripd.rpc.methods import BY_NAME
from litegripd.rpc.sessions import Session


class Handlers:
    """The functions of all methods; table and functions differing is a defect found at start."""

    def __init__(self, *groups: Mapping[str, Function]) -> None:
        self._functions = {name: function for group in groups for name, function in group.items()}
        differing = self._functions.keys() ^ BY_NAME.keys()
        if differing:
            raise LookupError(f"methods without function, or functions without method: {differing}")

    def call(
        self,
        method: str,
        session: Session,
        owner: Owner,
        params: Mapping[str, Any],
        now_s: float,
        *,
        received_s: float,
    ) -> Answer:
        """Carry out a request whose parameters have been checked."""
        return self._functions[method](Call(session, owner, params, now_s, received_s))
