"""What runs in the background for one gripper: teleoperation, a recording, a replay.

One at a time. The daemon runs it; a transport of the program's own is carried to it by a thread.
"""

from __future__ import annotations

import logging
import math
import threading
import time
from collections import deque
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from litegrip_client.values import errors as ours
from litegrip_client.values import trajectory as our_trajectory
from litegrip_client.values.checks import number

from ._bridge import SessionBusyError, finite, gains_in_range, in_their_terms
from .exceptions import CommandError, LiteGripError
from .teleop import (
    TeleopSubscription,
    TeleopTransport,
    check_ready,
    ready_topic,
    teleop_topic,
)
from .trajectory import (
    Trajectory,
    TrajectoryEmptyError,
    TrajectoryError,
    TrajectoryNotActiveError,
    TrajectoryRecordingError,
)

if TYPE_CHECKING:
    import litegrip_client
    from litegrip_client.line.connection import Connection

    from .gripper import LiteGrip

LOG = logging.getLogger("litegrip.teleop")
TRAJECTORY_LOG = logging.getLogger("litegrip.trajectory")

_LOOK_S, _END_S = 0.02, 2.0
_OVER_TIME, _OVER_TIME_S = 1.5, 3.0
_LEAST_SHARE = 0.9
"""Single measurements may be lost on the bus."""

_IDLE_TELEOP: Mapping[str, Any] = {"active": False, "mode": None}
_IDLE_TRAJECTORY: Mapping[str, Any] = {"active": False, "kind": None}

_TELEOP_KEYS: Mapping[str, tuple[Any, int | None]] = {
    "active": (True, None),
    "mode": ("", None),
    "topic": ("", None),
    "frames": (0, None),
    "last_frame_age_ms": (None, None),
    "stale": (False, None),
    "openness": (0.0, 4),
    "position_mm": (0.0, 4),
    "force_n": (0.0, 4),
    "loop_hz": (0.0, 1),
    "dq_cmd": (0.0, 4),
    "rejected": (0, None),
    "send_failed": (0, None),
    "fault": ("", None),
    "torque_nm": (0.0, 4),
    "over_torque": (False, None),
    "torque_trips": (0, None),
    "matching": (None, None),
    "ready": (False, None),
    "ready_rx": (0, None),
    "ready_pubs": (0, None),
    "ready_timed_out": (False, None),
}
"""The SDK's keys of a status: what stands there while a figure is not known, and its digits."""

_ABOVE_0 = ("rate_hz", "watchdog_s", "align_speed_mm_s", "ready_period_s")
_AT_LEAST_0 = ("torque_limit_nm", "lead_cap_mm", "ready_timeout_s", "ready_tolerance_mm")


class Sessions:
    """The sessions of one gripper object."""

    def __init__(self, gripper: LiteGrip) -> None:
        self._gripper = gripper
        self._kind: str | None = None
        self._last: dict[str, Any] = {}
        self._asked: dict[str, Any] = {}
        self._carrier: Carrier | None = None

    @property
    def kind(self) -> str | None:
        """What runs: "teleop", "record", "play" or None. One that has ended by itself is over."""
        kind = self._kind
        if kind is None or not self._gripper.is_connected:
            return None
        status = self.teleop_status() if kind == "teleop" else self.trajectory_status()
        return kind if status["active"] else None

    def end(self) -> None:
        """End what runs, on the way out, and forget it."""
        try:
            kind = self.kind
            if kind == "teleop":
                self.teleop_stop()
            elif kind == "record":
                self.record_stop(allow_empty=True)
            elif kind == "play":
                self.play_stop(_END_S)
        except LiteGripError as error:
            LOG.warning("%s did not end as it should: %s", self._kind, error)
        finally:
            self._kind, self._last = None, {}
            self._end_carrier()

    def _end_carrier(self) -> None:
        carrier, self._carrier = self._carrier, None
        if carrier is not None:
            carrier.end()

    @contextmanager
    def _begun(self, kind: str, **asked: Any) -> Iterator[None]:
        """Note a session that begins; free it if that fails, or is interrupted."""
        self._kind, self._asked, self._last = kind, asked, {}
        try:
            with in_their_terms():
                yield
        except LiteGripError:
            self._kind = None
            self._end_carrier()
            raise
        except BaseException:
            self.end()
            raise

    def _gains(self, kp: float | None, kd: float | None) -> tuple[float | None, float | None]:
        """Return gains inside the daemon's ranges, none where none were given."""
        if kp is None and kd is None:
            return None, None
        config = self._gripper.config
        return gains_in_range(
            config.kp if kp is None else _figure("kp", kp),
            config.kd if kd is None else _figure("kd", kd),
        )

    def _claim(self) -> litegrip_client.LiteGrip:
        """Return the daemon's object with the program's limits; raises where a session runs."""
        gripper = self._gripper
        gripper._ready()  # noqa: SLF001 - the two are one object for users
        kind = self.kind
        if kind is not None:
            raise SessionBusyError(f"{kind} runs on {gripper.channel}: end it first")
        self._end_carrier()  # of teleoperation that has ended by itself
        return gripper._in_force()  # noqa: SLF001

    # Trajectories

    def record_start(
        self, rate_hz: float, zero_gravity: bool, max_samples: int | None
    ) -> dict[str, Any]:
        """Begin to record; return the status."""
        rate = _above_0("rate_hz", rate_hz)
        self._gripper._ready()  # noqa: SLF001
        if not self._gripper.config.calibrated:
            raise TrajectoryError("not calibrated: load_calibration(), or zero()")
        daemon = self._claim()
        with self._begun("record", rate_hz=rate, zero_gravity=bool(zero_gravity)):
            daemon.record_start(rate, bool(zero_gravity), max_samples)
        TRAJECTORY_LOG.info("recording on %s at %g Hz", self._gripper.channel, rate)
        return self.trajectory_status()

    def record_stop(self, allow_empty: bool) -> Trajectory:
        """End the recording and return it."""
        if self._kind != "record":
            raise TrajectoryNotActiveError("nothing is being recorded: record_start() first")
        daemon = self._gripper._connected()  # noqa: SLF001
        try:
            with in_their_terms():
                taken = daemon.record_stop(bool(allow_empty))
        except TrajectoryError:
            self._kind = None
            raise
        self._kind = None
        TRAJECTORY_LOG.info("recorded %d samples", len(taken))
        return Trajectory._of(taken)  # noqa: SLF001

    def record(self, duration_s: float, rate_hz: float, zero_gravity: bool) -> Trajectory:
        """Record for a while."""
        lasts_s = _above_0("duration_s", duration_s)
        wanted = max(1, round(lasts_s * _above_0("rate_hz", rate_hz)))
        self.record_start(rate_hz, zero_gravity, wanted)
        ends_s = time.monotonic() + _OVER_TIME * lasts_s + _OVER_TIME_S
        try:
            while self.trajectory_status()["active"] and time.monotonic() < ends_s:
                time.sleep(_LOOK_S)
        except BaseException:
            self.end()
            raise
        taken = self.record_stop(allow_empty=True)
        if len(taken) < _LEAST_SHARE * wanted:
            raise TrajectoryRecordingError(
                f"{len(taken)} of {wanted} samples were recorded: the recording did not fill"
            )
        return taken

    def play_start(
        self,
        trajectory: Trajectory,
        speed: float,
        kp: float | None,
        kd: float | None,
        loop: bool,
        align: bool,
    ) -> dict[str, Any]:
        """Begin to replay; return the status."""
        daemon, given, gains = self._replay(trajectory, speed, kp, kd)
        with self._begun("play", loop=bool(loop), speed=float(speed), samples=len(given)):
            daemon.play_start(given, speed, *gains, bool(loop), bool(align))
        return self.trajectory_status()

    def play(
        self,
        trajectory: Trajectory,
        speed: float,
        kp: float | None,
        kd: float | None,
        loop: bool,
        align: bool,
    ) -> dict[str, Any]:
        """Replay to the end; return the final status."""
        if loop:
            raise ValueError("play() returns at the end, which a loop does not have: play_start()")
        daemon, given, gains = self._replay(trajectory, speed, kp, kd)
        with self._begun("play", loop=False, speed=float(speed), samples=len(given)):
            try:
                result = daemon.play(given, speed, *gains, bool(align))
            except (ours.CancelledError, ours.StoppedError) as error:
                raise TrajectoryError(str(error)) from None
        status = self._last = self._trajectory_status(daemon)
        self._kind = None
        if not result:
            raise TrajectoryError(f"the replay ended before its end: {result.outcome}")
        return status

    def _replay(
        self, trajectory: Trajectory, speed: float, kp: float | None, kd: float | None
    ) -> tuple[
        litegrip_client.LiteGrip, our_trajectory.Trajectory, tuple[float | None, float | None]
    ]:
        _above_0("speed", speed)
        self._gripper._ready()  # noqa: SLF001
        if not len(trajectory):
            raise TrajectoryEmptyError("a trajectory without samples cannot be replayed")
        if not self._gripper.config.calibrated:
            raise TrajectoryError("not calibrated: load_calibration(), or zero()")
        gains = self._gains(kp, kd)
        daemon = self._claim()
        with in_their_terms():
            return daemon, _ours(trajectory, self._gripper), gains

    def play_stop(self, timeout: float) -> dict[str, Any]:
        """End the replay; return the final status."""
        if self._kind != "play":
            return dict(self._last) if self._last.get("kind") == "play" else dict(_IDLE_TRAJECTORY)
        daemon = self._gripper._connected()  # noqa: SLF001
        with in_their_terms():
            daemon.play_stop(_waited_s(timeout))
        last = self._trajectory_status(daemon)
        self._kind = None
        return last

    def trajectory_status(self) -> dict[str, Any]:
        """Return the status of the recording or replay, as it ended if it has."""
        if self._kind not in ("record", "play"):
            return dict(self._last) or dict(_IDLE_TRAJECTORY)
        return self._trajectory_status(self._gripper._connected())  # noqa: SLF001

    def _trajectory_status(self, daemon: litegrip_client.LiteGrip) -> dict[str, Any]:
        with in_their_terms():
            found = daemon.trajectory_status()
        asked = self._asked
        status: dict[str, Any] = {
            "active": bool(found.get("active")),
            "kind": found.get("kind"),
            "samples": int(found.get("samples") or asked.get("samples", 0)),
            "error": found.get("error"),
            "loop_hz": round(float(found.get("loop_hz") or 0.0), 1),
        }
        if found.get("kind") == "record":
            return status | {
                "rate_hz": round(asked.get("rate_hz", 0.0), 1),
                "zero_gravity": asked.get("zero_gravity", True),
            }
        return status | {
            "frames": int(found.get("frames") or 0),
            "speed": round(float(found.get("speed") or asked.get("speed", 1.0)), 3),
            "loop": asked.get("loop", False),
            "completed": bool(found.get("completed")),
            "openness": round(float(found.get("openness") or 0.0), 4),
        }

    # Teleoperation

    def teleop_start(
        self,
        mode: str,
        transport: TeleopTransport | None,
        *,
        link: str,
        host: str | None,
        port: int,
        grip_id: str,
        align: bool,
        gains: tuple[float | None, float | None],
        require_ready: bool,
        figures: Mapping[str, Any],
    ) -> dict[str, Any]:
        """Begin to lead or follow; return the status."""
        self._gripper._ready()  # noqa: SLF001
        if mode not in ("master", "slave"):
            raise ValueError(f"mode is {mode!r}, it must be master or slave")
        check_ready(self._gripper.config)
        daemon = self._claim()
        if transport is None:
            if link not in ("zenoh", "udp"):
                raise ValueError(f"link is {link!r}, it must be zenoh or udp")
            if not host and (mode == "slave" or link == "udp"):
                raise ValueError(f"a {mode} over {link} needs a host")
        for name in _ABOVE_0:
            _above_0(name, figures[name])
        for name in _AT_LEAST_0:
            if _figure(name, figures[name]) < 0.0:
                raise ValueError(f"{name} is {figures[name]!r}, it must not be negative")
        kp, kd = self._gains(*gains)
        with self._begun("teleop"):
            carrier = None
            if transport is not None:
                connection = daemon._session.connection  # noqa: SLF001 - no public way for bytes
                rate_hz = float(figures["rate_hz"])
                carrier = self._carrier = Carrier(connection, transport, mode, grip_id, rate_hz)
            daemon.teleop_start(
                mode,
                host if carrier is None else None,
                link="client" if carrier is not None else link,
                port=port if carrier is None else None,
                grip_id=grip_id,
                kp=kp,
                kd=kd,
                align=bool(align),
                require_ready=bool(require_ready) and (carrier is None or carrier.can_listen),
                **figures,
            )
        if carrier is not None:
            carrier.start()
        LOG.info("teleoperation of %s as %s", self._gripper.channel, mode)
        return self.teleop_status()

    def teleop_stop(self, timeout: float = 2.0) -> dict[str, Any]:
        """End teleoperation; return the final status."""
        if self._kind != "teleop":
            return dict(_IDLE_TELEOP)
        daemon = self._gripper._connected()  # noqa: SLF001
        with in_their_terms():
            found = daemon.teleop_stop(_waited_s(timeout))
        self._kind = None
        last = self._of_carrier(_teleop_status(found)) | {"active": False}
        self._end_carrier()
        LOG.info("teleoperation of %s ended", self._gripper.channel)
        return last

    def teleop_status(self) -> dict[str, Any]:
        """Return the status of this object's teleoperation."""
        if self._kind != "teleop":
            return dict(_IDLE_TELEOP)
        with in_their_terms():
            found = self._gripper._connected().teleop_status()  # noqa: SLF001
        return self._of_carrier(_teleop_status(found))

    def _of_carrier(self, status: dict[str, Any]) -> dict[str, Any]:
        """Return a status with what the carrier knows of the program's own link."""
        carrier = self._carrier
        if carrier is not None:
            status["send_failed"] += carrier.failed
            status["matching"] = carrier.matching if status["mode"] == "master" else None
        return status


def _teleop_status(found: Mapping[str, Any]) -> dict[str, Any]:
    """Return a status with the SDK's keys, each of its type: strict JSON can hold it."""
    status: dict[str, Any] = {}
    for name, (unknown, digits) in _TELEOP_KEYS.items():
        value = found.get(name)
        if value is None or (isinstance(value, float) and not math.isfinite(value)):
            value = unknown
        status[name] = round(float(value), digits) if digits is not None else value
    if status["mode"] == "master":
        status["last_frame_age_ms"] = None
    status["fault"] = str(status["fault"] or found.get("link_error") or "")
    return status


class Carrier:
    """Carries payloads between a transport of the program's own and the daemon, in a thread."""

    notification = "teleop.send"

    def __init__(
        self,
        connection: Connection,
        transport: TeleopTransport,
        mode: str,
        grip_id: str,
        rate_hz: float,
    ) -> None:
        self.transport = transport
        self.failed = 0
        self._is_deaf = False
        self.inbox: deque[Mapping[str, str]] = deque(maxlen=64)
        self._connection = connection
        self._period_s = 1.0 / rate_hz
        self._listens_to = teleop_topic(grip_id) if mode == "slave" else ready_topic(grip_id)
        self._subscription = self._subscribed()
        self._is_over = threading.Event()
        self._thread = threading.Thread(
            target=self._run, name=f"litegrip-teleop-{mode}", daemon=True
        )
        connection.listen(self.notification, self)

    def _subscribed(self) -> TeleopSubscription | None:
        try:
            return self.transport.sub(self._listens_to)
        except Exception as error:  # noqa: BLE001 - the program's own object may raise anything
            LOG.warning("the transport listens to nothing under %s: %s", self._listens_to, error)
            return None

    @property
    def can_listen(self) -> bool:
        """True if the transport can listen."""
        return self._subscription is not None

    @property
    def matching(self) -> bool | None:
        """Whether somebody listens, if the transport says so."""
        try:
            said = getattr(self.transport, "matching", None)
        except Exception:  # noqa: BLE001 - the program's own object may raise anything
            return None
        return said if isinstance(said, bool) else None

    def start(self) -> None:
        """Begin to carry."""
        self._thread.start()

    def end(self) -> None:
        """Stop carrying, when what the daemon has sent is out."""
        self._is_over.set()
        if self._thread.is_alive() and self._thread.ident != threading.get_ident():
            self._thread.join(1.0)
        self._send_out()
        self._connection.unlisten(self.notification)

    def deliver(self, message: Mapping[str, str]) -> None:
        """Take what the daemon wants to be published."""
        self.inbox.append(message)

    def step(self) -> None:
        """Carry what waits, both ways."""
        self._connection.take_refusal()  # which reads what has come
        self._send_out()
        payload = self._received()
        if payload is not None:
            params = {"topic": self._listens_to, "payload": payload.hex()}
            self._connection.notify_guarded("teleop.receive", params)

    def _received(self) -> bytes | None:
        try:
            payload = None if self._subscription is None else self._subscription.drain_latest()
            return None if payload is None else bytes(payload)
        except Exception as error:  # noqa: BLE001 - the program's own object may raise anything
            level = logging.DEBUG if self._is_deaf else logging.WARNING
            self._is_deaf = True
            LOG.log(level, "the transport did not receive: %s", error)
            return None

    def _send_out(self) -> None:
        while self.inbox:
            message = self.inbox.popleft()
            self._publish(message["topic"], bytes.fromhex(message["payload"]))

    def _publish(self, topic: str, payload: bytes) -> None:
        try:
            self.transport.pub(topic, payload)
        except Exception as error:  # noqa: BLE001 - the program's own object may raise anything
            self.failed += 1
            level = logging.WARNING if self.failed == 1 else logging.DEBUG
            LOG.log(level, "the transport did not publish: %s", error)

    def _run(self) -> None:
        try:
            while not self._is_over.wait(self._period_s):
                self.step()
        except ours.LiteGripError as error:
            LOG.warning("teleoperation's transport is not carried any more: %s", error)


def _figure(name: str, value: Any) -> float:
    """Return a figure; raises `ValueError` unless it is a finite number."""
    try:
        return finite(name, value)
    except CommandError as error:
        raise ValueError(str(error)) from None


def _waited_s(timeout: float) -> float:
    """Return how long to wait: the SDK joins its thread, for which less than 0 is 0."""
    return max(number("timeout", timeout), 0.0)


def _above_0(name: str, value: Any) -> float:
    """Return a figure; raises `ValueError` unless it is above 0."""
    figure = _figure(name, value)
    if figure <= 0.0:
        raise ValueError(f"{name} is {value!r}, it must be above 0")
    return figure


def _ours(given: Trajectory, gripper: LiteGrip) -> our_trajectory.Trajectory:
    """Return what the daemon takes; one without a geometry gets the gripper's."""
    rows = [
        our_trajectory.TrajectorySample(
            row.t, row.openness, row.position_rad, row.velocity_rad_s, row.torque_nm
        )
        for row in given.samples
    ]
    whole = given.rad_to_mm > 0.0 and given.pos_closed_rad != given.pos_open_rad
    of: Any = given if whole else gripper.config
    mount = given.mount if given.mount in ("normal", "reverse") else None
    return our_trajectory.Trajectory(
        rows,
        sample_hz=given.sample_hz,
        created=given.created,
        pos_closed_rad=of.pos_closed_rad,
        pos_open_rad=of.pos_open_rad,
        rad_to_mm=of.rad_to_mm,
        can_id=given.can_id,
        mount=mount,  # type: ignore[arg-type]
    )
