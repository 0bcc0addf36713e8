"""Exclusive control of the gripper for a while: `with gripper.lease("sorting"):`."""

from __future__ import annotations

from types import TracebackType

from litegrip_client.blocking import wait
from litegrip_client.core import lease as core


class Lease:
    """The lease of one gripper, for `with`: taken at the start, returned at the end.

    It is kept while another block, or `enable`, of the same gripper object needs it. `token` names
    it, for another connection of the same program (`lease` of the raw methods).
    """

    def __init__(self, lease: core.Lease) -> None:
        self._lease = lease

    @property
    def token(self) -> str | None:
        """The name of the lease, inside the block."""
        return self._lease.token

    def __enter__(self) -> Lease:
        wait(self._lease.__aenter__())
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        wait(self._lease.__aexit__(kind, error, trace))

    def renew(self) -> None:
        """Restart `ttl_s`, as every call does. Raises `LeaseError` when the lease is lost."""
        wait(self._lease.renew())
