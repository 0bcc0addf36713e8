"""What each method does: its function, found by its name in the table."""

from collections.abc import Mapping
from typing import Any

from litegripd.control.engine import Engine
from litegripd.model.jobs import Owner
from litegripd.rpc.calls import Answer, Call, Function
from litegripd.rpc.clients import Clients
from litegripd.rpc.facts import Facts
from litegripd.rpc.methods import BY_NAME
from litegripd.rpc.moving import Moving
from litegripd.rpc.reading import Reading
from litegripd.rpc.reporter import Reporter
from litegripd.rpc.session import Session
from litegripd.rpc.settings import Settings
from litegripd.rpc.subscriptions import Subscriptions
from litegripd.rpc.watching import Watching


class Handlers:
    """The functions of all methods; table and functions differing is a defect found at start."""

    def __init__(
        self,
        engine: Engine,
        facts: Facts,
        clients: Clients,
        subscriptions: Subscriptions,
        reporter: Reporter,
    ) -> None:
        self._functions: dict[str, Function] = {
            **Reading(engine, facts, clients, reporter).functions(),
            **Watching(subscriptions, reporter).functions(),
            **Moving(engine, reporter).functions(),
            **Settings(engine).functions(),
        }
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
    ) -> Answer:
        """Carry out a request whose parameters have been checked."""
        return self._functions[method](Call(session, owner, params, now_s))
