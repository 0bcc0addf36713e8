"""Leader and follower: two grippers, of which one goes where the other's jaws are moved by hand.

The link between them is the daemons'; this module only asks for it.
"""

from __future__ import annotations

from litegrip_client.base import ActionBase
from litegrip_client.blocking import wait

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any


class TeleopActions(ActionBase):
    """What begins, ends and shows teleoperation."""

    def teleop_start(
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
        """Lead ("master") or follow ("slave") until `teleop_stop`; return the first status.

        A master's jaws go slack and are moved by hand. A slave needs the master's `host`; its jaws
        go where the master's are, as a share of its own travel: calibration and mount may differ.
        Both ends share `port` (17448) and `grip_id` ("gripA"). `link` is "zenoh" (the default)
        or "udp", which only a trusted network is for, and with which the master needs the slave's
        `host`. `rate_hz` is how often a master publishes, the control rate by default.

        After `watchdog_s` (0.2) without a frame a slave holds its last target. At or over
        `torque_limit_nm` (0: off) for 60 ms it lets go, until the master has reopened by 0.05.
        With `force_limit_n` it pushes by no more. `kp` and `kd` are the calibration's by default;
        `dq_max` (10 rad/s) bounds the velocity that is fed forward. `fake_leader` follows a
        synthetic sweep instead of a master.

        With `reflect` a slave sends its force, and a master with `reflect_n` (0, off, to 10 N)
        pushes back with the share `reflect_gain` (0.5) of it: the hand feels what is gripped. Over
        udp a master's `host` may name several slaves, separated by commas.

        `transport` is refused: the link is the daemon's, and there is no `TeleopTransport` here.

        It ends with this object's connection. Raises `TeleopNotReady` (not calibrated, not
        enabled), `TeleopBusyError` (it runs already), `TrajectoryBusyError` (a trajectory is
        recorded or replayed) and what `GripperActions` says.
        """
        return wait(
            self._core.teleop_start(
                mode,
                host,
                port=port,
                grip_id=grip_id,
                link=link,
                rate_hz=rate_hz,
                watchdog_s=watchdog_s,
                torque_limit_nm=torque_limit_nm,
                force_limit_n=force_limit_n,
                kp=kp,
                kd=kd,
                dq_max=dq_max,
                reflect=reflect,
                reflect_n=reflect_n,
                reflect_gain=reflect_gain,
                fake_leader=fake_leader,
                transport=transport,
            )
        )

    def teleop_stop(self) -> dict[str, Any]:
        """End it, if it runs: the jaws hold where they are. Returns the status at the end.

        Those that the torque guard has let go of stay loose: holding would press what it freed.
        """
        return wait(self._core.teleop_stop())

    def teleop_status(self) -> dict[str, Any]:
        """Return the status of teleoperation, or of the last one.

        A dictionary with `active`, `mode`, `topic`, `frames`, `last_frame_age_ms`, `stale`,
        `openness`, `position_mm`, `force_n`, `dq_cmd`, `loop_hz`, `rejected`, `send_failed`,
        `fault`, `torque_nm`, `over_torque`, `torque_trips`, `matching` and more: whether its limits
        make a slave press less (`force_limited`), and, of reflection, `reflected_n`, `followers`
        and `round_trip_ms`.
        """
        return wait(self._core.teleop_status())
