"""Leader and follower: two grippers, of which one goes where the other's jaws are moved by hand.

The link between them is the daemons'; this module only asks for it.
"""

from __future__ import annotations

from litegrip_client.checks import given_numbers, integer
from litegrip_client.core.base import ActionBase
from litegrip_client.errors import CommandError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


class TeleopActions(ActionBase):
    """What begins, ends and shows teleoperation."""

    async def teleop_start(
        self,
        mode: str,
        host: str | None = None,
        *,
        port: int | None = None,
        grip_id: str | None = None,
        link: str | None = None,
        rate_hz: float | None = None,
        watchdog_s: float | None = None,
        torque_limit_nm: float | None = None,
        force_limit_n: float | None = None,
        kp: float | None = None,
        kd: float | None = None,
        dq_max: float | None = None,
        reflect: bool = False,
        reflect_n: float | None = None,
        reflect_gain: float | None = None,
        fake_leader: bool = False,
        transport: object = None,
    ) -> dict[str, Any]:
        """Lead ("master") or follow ("slave") until `teleop_stop`; return the first status."""
        if transport is not None:
            raise CommandError(
                "a transport of the caller's own cannot be used: the link is the daemon's, so that"
                " it goes on while a script is late",
                reason="unsupported",
                data={"parameter": "transport", "hint": 'leave it out, or take link="udp"'},
            )
        params: dict[str, Any] = {"mode": mode}
        texts = {"host": host, "grip_id": grip_id, "link": link}
        params |= {name: value for name, value in texts.items() if value is not None}
        if port is not None:
            params["port"] = integer("port", port)
        params |= given_numbers(
            rate_hz=rate_hz,
            watchdog_s=watchdog_s,
            torque_limit_nm=torque_limit_nm,
            force_limit_n=force_limit_n,
            kp=kp,
            kd=kd,
            dq_max=dq_max,
            reflect_n=reflect_n,
            reflect_gain=reflect_gain,
        )
        if reflect:
            params["reflect"] = True
        if fake_leader:
            params["fake_leader"] = True
        return await self._command("teleop.start", self._configured(params))

    async def teleop_stop(self) -> dict[str, Any]:
        """End it, if it runs; the jaws hold, or stay loose after a trip. Returns the status."""
        return await self._link.wire.call("teleop.stop")

    async def teleop_status(self) -> dict[str, Any]:
        """Return the status of teleoperation, or of the last one."""
        return await self._link.wire.call("teleop.status")
