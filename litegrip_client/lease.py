"""Having the gripper to oneself for a while: `with gripper.lease("sorting"):`."""

from __future__ import annotations

from types import TracebackType

from litegrip_client.link import Link

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any


class Lease:
    """The lease of one gripper, for `with`: got at its begin, given back at its end.

    `token` names it, for another connection of the same program (`lease` of the raw methods).
    """

    def __init__(self, link: Link, wish: dict[str, Any]) -> None:
        self.token: str | None = None
        self._link = link
        self._wish = wish
        self._was_leased = False

    def __enter__(self) -> Lease:
        self._was_leased = self._link.leased
        self.token = str(self._link.acquire(**self._wish)["lease"])
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.token = None
        if not self._was_leased and self._link.is_open:
            self._link.release()

    def renew(self) -> None:
        """Let `ttl_s` begin anew, as every call does. Raises `LeaseError` when it is lost."""
        self._link.connection.call("lease.renew")
