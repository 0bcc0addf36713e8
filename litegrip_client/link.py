"""The connection of one `LiteGrip` object: which daemon, who enabled, and what its end does.

This module must not know motions.
"""

from __future__ import annotations

import contextlib
import sys

from litegrip_client.connection import Connection
from litegrip_client.discovery import check_channel, connect
from litegrip_client.errors import (
    CommandError,
    ConnectError,
    HardwareError,
    LeaseError,
    ProtocolError,
)

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any

ACTION_TIMEOUT_S = 30.0
"""For enabling and disabling: retries and register reads included, the daemon is done by then."""


class Link:
    """A daemon, by channel, and the connection to it while there is one.

    `enabled_here` is true from this link's enabling on until its disabling; only then does its
    end do anything to the motor. `leased` tells that it has the lease, as far as it knows.
    """

    def __init__(
        self,
        channel: str,
        can_id: int | None,
        socket_path: str | None,
        *,
        disable_on_disconnect: bool,
    ) -> None:
        self.channel = check_channel(channel)
        self.can_id = can_id
        self.socket_path = socket_path
        self.disable_on_disconnect = disable_on_disconnect
        self.enabled_here = False
        self.leased = False
        self._connection: Connection | None = None

    @property
    def is_open(self) -> bool:
        """Whether calls can be made."""
        return self._connection is not None and not self._connection.closed

    @property
    def connection(self) -> Connection:
        """The connection; raises `ConnectError` when there is none."""
        if self._connection is None:
            raise ConnectError(
                f"not connected to the daemon of channel {self.channel}",
                reason="not_connected",
                data={"hint": "call connect() first, or use 'with LiteGrip(...) as gripper:'"},
            )
        return self._connection

    def open(self) -> None:
        """Connect, unless that is done.

        Raises `ConnectError`, and `CommandError` when the daemon there drives something else.
        """
        if self.is_open:
            return
        import litegrip_client.results  # noqa: F401, PLC0415 - so that no call must load it

        if self._connection is not None:
            self._connection.close()
        self.enabled_here = self.leased = False
        connection = connect(self.channel, self.socket_path)
        try:
            self._check(connection.greet(_program()), connection.path)
        except BaseException:
            connection.close()
            raise
        self._connection = connection

    def _check(self, hello: dict[str, Any], path: str) -> None:
        try:
            channel, can_id = hello["channel"], hello["motor"]["can_id"]
        except (KeyError, TypeError) as error:
            raise ProtocolError(f"what answers at {path} is no litegripd: {hello!r:.80}") from error
        if channel != self.channel:
            raise _different("channel", self.channel, channel, path)
        if self.can_id is not None and can_id != self.can_id:
            raise _different("can_id", f"{self.can_id:#04x}", f"{can_id:#04x}", path)

    def close(self) -> None:
        """End the connection, after having seen to the motor if this link enabled it.

        That is: disable it, or, without `disable_on_disconnect`, make sure that the daemon goes
        on holding. Raises the error of that; the connection is closed all the same. In a forked
        child only the child's copy is closed.
        """
        connection, self._connection = self._connection, None
        if connection is None:
            return
        enabled_here, self.enabled_here = self.enabled_here, False
        leased, self.leased = self.leased, False
        try:
            if enabled_here and connection.is_own and self.disable_on_disconnect:
                self._disable(connection)
            if leased and connection.is_own:
                _release(connection)
        finally:
            connection.close()

    def acquire(
        self,
        purpose: str | None = None,
        ttl_s: float | None = None,
        wait_s: float = 0.0,
        on_lost: str = "hold",
    ) -> dict[str, Any]:
        """Get the lease, or change what is wished of it; the purpose is the program by default."""
        params: dict[str, Any] = {"purpose": purpose or _program(), "on_lost": on_lost}
        if ttl_s is not None:
            params["ttl_s"] = ttl_s
        if wait_s:
            params["wait_s"] = wait_s
        result = self.connection.call("lease.acquire", params, wait_s + ACTION_TIMEOUT_S)
        self.leased = True
        return result

    def take(self, why: str) -> None:
        """Take the lease from whoever has it."""
        self.connection.call("lease.take", {"why": why, "purpose": _program()})
        self.leased = True

    def release(self) -> None:
        """Give the lease back; the jaws stay as they are."""
        self.leased = False
        _release(self.connection)

    @staticmethod
    def _disable(connection: Connection) -> None:
        try:
            done = connection.call("motor.disable", None, ACTION_TIMEOUT_S).get("ok")
        except LeaseError:
            return  # taken over: the motor is another's to disable
        if not done:
            raise HardwareError(
                "the motor did not confirm that it is disabled",
                reason="not_confirmed",
                data={"retryable": True},
            )


def _release(connection: Connection) -> None:
    """Give the lease back, unless it is lost already."""
    with contextlib.suppress(LeaseError):
        connection.call("lease.release")


def _program() -> str:
    name = sys.argv[0].rpartition("/")[2][:64] if sys.argv else ""
    return name if name and not name.startswith("-") else "python"  # of python -c, for one


def _different(what: str, wanted: str, found: str, path: str) -> CommandError:
    return CommandError(
        f"the daemon at {path} has {what} {found}, not {wanted}",
        reason="wrong_gripper",
        data={"hint": f"ask for {what} {found}, or for the socket of the other daemon"},
    )
