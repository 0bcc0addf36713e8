"""Exclusive control of the gripper for a while: `async with gripper.lease("sorting"):`."""

from __future__ import annotations

from types import TracebackType

from litegrip_client.core.link import Link
from litegrip_client.warn import leave

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

    from litegrip_client.core.wire import Wire


class Lease:
    """The lease of one gripper: taken at the start of the block, returned at its end.

    It is kept while another block, or `enable`, of the same gripper object needs it. `token` names
    it, for another connection of the same program (`lease` of the raw methods).
    """

    def __init__(self, link: Link, wish: dict[str, Any]) -> None:
        self.token: str | None = None
        self._link = link
        self._wish = wish
        self._wire: Wire | None = None

    async def __aenter__(self) -> Lease:
        granted = await self._link.acquire(**self._wish)
        self._wire = self._link.enter_lease()
        self.token = str(granted["lease"])
        return self

    async def __aexit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.token = None
        await leave(self._leave, error)

    async def _leave(self) -> None:
        wire, self._wire = self._wire, None
        if wire is not None:
            await self._link.leave_lease(wire)

    async def renew(self) -> None:
        """Restart `ttl_s`, as every call does. Raises `LeaseError` when the lease is lost."""
        await self._link.wire.call("lease.renew")
