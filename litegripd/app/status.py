"""The daemon's reports about itself: in the log, and to clients."""

import grp
import logging
import math
import os
import secrets
import shlex
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import cast

from litegrip_client.values.repeats import REPEATS, RepeatsHandler
from litegrip_client.values.severity import is_warning
from litegrip_client.values.version import installed_version
from litegripd.app.build import Parts, in_shell_text
from litegripd.app.config import Config, RpcConfig
from litegripd.app.machine import Machine
from litegripd.control.admission import position_refusal
from litegripd.control.calibration import CalibrationInUse
from litegripd.control.controller import Controller
from litegripd.control.events import weak_text
from litegripd.control.heat import HeatGuard
from litegripd.io.log import FIELDS, JournalSink, goes_to_journal
from litegripd.io.server import MAX_CONNECTIONS, MAX_CONNECTIONS_PER_UID
from litegripd.model.gripper import STROKE_MM, MotorType
from litegripd.model.motor import SIMULATOR, UNANSWERED, MotorIdentity, MotorPhase
from litegripd.model.sentence import with_terms
from litegripd.model.state import Event, EventKind
from litegripd.motor.identity import STILL_READ, warnings
from litegripd.motor.phases import RESTING
from litegripd.rpc.jsonrpc import MAX_LINE_BYTES
from litegripd.rpc.openrpc import PROTOCOL_VERSION
from litegripd.rpc.reports import (
    CalibrationFacts,
    GripperFacts,
    Hello,
    Info,
    Judged,
    MotionFields,
    MotorFacts,
    Verdict,
)
from litegripd.teleop.link import TeleopAction

_log = logging.getLogger(__name__)


_FIELDS = {
    "job": "LITEGRIP_JOB",
    "client": "LITEGRIP_CLIENT",
    "pid": "LITEGRIP_CLIENT_PID",
    "reason": "LITEGRIP_REASON",
}
"""The members of an event's data by which the journal can be searched."""

_REPEATED: frozenset[EventKind] = frozenset(
    {"bus", "motor", "teleop", "recorder", "client_lost", "lease_lost"}
)
"""What a loose plug, a leader or a program that fails repeats without end, also as information."""

_ALWAYS: frozenset[EventKind] = frozenset(
    {"stop", "stop_cleared", "released_by_fault", "object_lost", "calibration"}
)
"""Somebody's act, or the loss of what was held: each is logged."""


_UNPOWERED = (
    "the motor does not answer, and nobody uses the gripper: normal while its power is off;"
    " otherwise check its 24 V supply, the CAN wiring and its id"
)


@dataclass(slots=True)
class _Complaints:
    """What makes the gripper unusable, what degrades it, and what is normal but worth a note."""

    down: list[str] = field(default_factory=list)
    degraded: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)


def make_log_handler(channel: str, post: Callable[[str], bool]) -> RepeatsHandler:
    """Return a log handler that never waits: it writes to the journal, or passes text to `post`."""
    if goes_to_journal():
        return RepeatsHandler(JournalSink(channel))
    handler = RepeatsHandler(lambda _record, text: post(text + "\n"))
    form = "%(asctime)s %(levelname)-7s %(message)s"
    handler.setFormatter(logging.Formatter(form, "%H:%M:%S"))
    return handler


def log_event(event: Event, channel: str) -> None:
    """Log one event, with the commands of `litegripctl` for what it names: a person reads it."""
    level = logging.WARNING if is_warning(event.kind, event.data) else logging.INFO
    fields = {name: event.data[key] for key, name in _FIELDS.items() if event.data.get(key)}
    extra: dict[str, object] = {FIELDS: {"LITEGRIP_EVENT": event.kind, **fields}}
    if event.kind in _REPEATED or event.kind in _ALWAYS:
        extra[REPEATS] = event.kind in _REPEATED
    _log.log(level, "%s", in_shell_text(event.message, channel), extra=extra)


def warn_of_untried(motor_type: MotorType) -> None:
    """Warn once, at the start, if the configured type of motor was never tried."""
    if motor_type.is_untried:
        _log.warning(
            "[motor] type %s has NEVER BEEN TRIED ON HARDWARE: its figures are the maker's data and"
            " estimates; keep hands and valuables away until you have tried it",
            motor_type.name,
        )


def warn_of_missing_group(config: Config) -> None:
    """Warn once, at the start, if the group that the file names for the sockets is not there.

    Without the default group a user's own daemon is as it should be; of a system's daemon its
    sockets say so.
    """
    group = config.rpc.group
    if group == RpcConfig().group:
        return
    try:
        grp.getgrnam(group)
    except (KeyError, ValueError):  # ValueError: a NUL inside
        make = f"sudo groupadd --system {shlex.quote(group)}"
        _log.warning(
            "[rpc] group = %r in %s: there is no such group, and the sockets stay with the group"
            " that the daemon runs with; correct the name, or make the group (%s), then"
            " restart the daemon",
            group,
            config.source,
            make,
        )


def warn_of_superseded(config: Config) -> None:
    """Warn once, at the start, if the configured stroke is the default of earlier versions."""
    if config.gripper.is_superseded:
        _log.warning(
            "[gripper] stroke_mm = %g in %s is the default of earlier versions, a placeholder: the"
            " gripper that ships opens %g mm, and that counts; correct the file",
            config.gripper.stroke_mm,
            config.source,
            STROKE_MM,
        )


class MotorGreeting:
    """Logs a found motor's identity once, and each new warning about it."""

    def __init__(self, motor_type: MotorType) -> None:
        self._motor_type = motor_type
        self._was_known = False
        self._identity: MotorIdentity | None = None
        self._warnings: list[str] = []

    def note(self, identity: MotorIdentity | None) -> None:
        """Log the identity if it is new."""
        if identity is not None and not self._was_known:
            _log.info(
                "motor 0x%02X answers on 0x%02X, serial %s",
                identity.can_id,
                identity.master_id,
                identity.registers.get("SN"),
                extra={REPEATS: True},
            )
            self._warnings = []
        self._was_known = identity is not None
        if identity is None or identity is self._identity:
            return
        self._identity, before = identity, self._warnings
        self._warnings = warnings(identity, self._motor_type)
        for warning in self._warnings:
            if warning not in before:
                _log.warning("%s", warning)


_LATE_SHARE = 0.4
"""If one tick in a hundred starts later than this share of a period, health reports it."""
_STANDSTILL_S = 0.1
"""A single tick as late as this is reported, too: by then the motor may have disarmed itself."""


class DaemonFacts:
    """Implements `Facts` from the daemon's parts."""

    def __init__(
        self,
        config: Config,
        machine: Machine,
        stop_socket: Path | None = None,
        epoch: str | None = None,
    ) -> None:
        self._config = config
        self._stop_socket = None if stop_socket is None else str(stop_socket.absolute())
        self._machine = machine
        self.epoch = epoch or secrets.token_hex(8)
        """A name that no other start has; a successor keeps that of its predecessor."""
        self._version = installed_version("litegripd")
        self._began_s = time.monotonic()
        self._parts: Parts | None = None
        self.simulated = config.bus.interface == SIMULATOR

    def attach(self, parts: Parts) -> None:
        """Take the parts whose figures `health` reports."""
        self._parts = parts

    def hello(self) -> Hello:
        """Describe the daemon, the motor and the limits."""
        return {
            "daemon": "litegripd",
            "version": self._version,
            "protocol": PROTOCOL_VERSION,
            "channel": self._config.channel,
            "pid": os.getpid(),
            "epoch": self.epoch,
            "simulated": self.simulated,
            "stop_socket": self._stop_socket,
            "remote": None,
            "motor": self._motor(),
            "gripper": self._gripper(),
            "limits": {
                "rate_hz": self._config.control.rate_hz,
                "max_line_bytes": MAX_LINE_BYTES,
                "max_connections": MAX_CONNECTIONS,
                "max_connections_per_uid": MAX_CONNECTIONS_PER_UID,
            },
        }

    def info(self) -> Info:
        """Return the facts that do not change."""
        config, identity = self._config, self._machine.motor.view().identity
        controller = self._machine.controller
        return {
            **self.hello(),
            "registers": {} if identity is None else dict(identity.registers),
            "motor_warnings": []
            if identity is None
            else warnings(identity, controller.gripper_id.motor_type),
            "calibration_file": controller.calibrated.file,
            "calibration": _calibration(controller),
            "motion": MotionFields(controller.config.as_fields(controller.period_s)),
            "configuration": config.as_info(),
        }

    def health(self, now_s: float) -> Mapping[str, object]:
        """Return the verdict and the figures."""
        verdict, reasons, notes = self._judge()
        parts, uptime_s = self._parts, now_s - self._began_s
        judged: Judged = {"verdict": verdict, "reasons": reasons, "notes": notes, "remote": None}
        return judged if parts is None else {**judged, **parts.figures(uptime_s, self._machine)}

    def verdict(self) -> tuple[Verdict, list[str]]:
        """Return ok, degraded or down, and the reasons."""
        return self._judge()[:2]

    def notes(self) -> list[str]:
        """Return what is worth a note though it is normal."""
        return self._judge()[2]

    def _judge(self) -> tuple[Verdict, list[str], list[str]]:
        """Return the verdict, its reasons, and what is worth a note though it is normal."""
        parts = self._parts
        if parts is None:
            return "down", ["the daemon is still starting"], []
        found = self._motor_complaints(parts)
        other = self._machine.controller.second_master
        if other.is_active and not other.is_tolerated:
            found.down.append(f"another program commands the motor ({other.count} frames so far)")
        is_usable = not found.down and self._machine.motor.view().feedback is not None
        found.degraded += self._gripper_complaints(is_usable=is_usable)
        doubt = parts.condition.error
        if parts.condition.is_usable and doubt is not None:  # the nearer suspect
            (found.down or found.degraded).insert(0, f"the bus: {doubt}")
        found.degraded += self._teleop_complaints(parts) + _process_complaints(parts)
        rights = [f"not granted: {refused}" for refused in parts.rights.refused]
        if self.simulated:
            found.notes += [f"{text}; a simulated gripper does without" for text in rights]
        else:
            found.degraded += rights
        found.notes += parts.disks.nearly_full
        verdict: Verdict = "down" if found.down else "degraded" if found.degraded else "ok"
        return verdict, found.down + found.degraded, found.notes

    def _motor_complaints(self, parts: Parts) -> "_Complaints":
        """Return what keeps the motor from being used: an alarm only if somebody misses it."""
        view, controller = self._machine.motor.view(), self._machine.controller
        found, condition, is_missed = _Complaints(), parts.condition, self._machine.is_missed
        refusal = condition.refusal(self._config.bus.channel)
        if refusal is not None:
            if condition.state in UNANSWERED and not is_missed:
                found.notes.append(_UNPOWERED)
            elif is_missed:
                found.down.append(refusal.message)
            else:
                found.degraded.append(refusal.message)
        elif view.fault is not None:
            found.down.append(view.fault.message)
        elif view.phase is MotorPhase.SILENT and not is_missed:
            found.notes += [] if condition.error else [_UNPOWERED]  # else the adapter is at fault
        elif view.problem is STILL_READ and not is_missed:
            found.notes.append("the motor has been found, and its registers are being read")
        elif view.problem is not None:
            found.down.append(view.problem.message)
        elif view.latched is not None and controller.missed is not None:
            found.down.append(controller.missed.message)
        elif view.latched is not None:
            found.notes.append(RESTING[view.latched])
        return found

    def _gripper_complaints(self, *, is_usable: bool) -> list[str]:
        """Return what degrades a gripper that can be used, or could be."""
        controller = self._machine.controller
        found, other, geometry = [], controller.second_master, controller.geometry
        if other.is_active and other.is_tolerated:
            found.append(
                f"another program commands the motor ({other.count} frames so far),"
                ' which second_master = "tolerate" lets it do'
            )
        if geometry is None:
            found.append(_why_uncalibrated(controller.calibrated))
        elif is_usable:
            misplaced = position_refusal(self._machine.motor.view(), geometry)
            found += [] if misplaced is None else [misplaced.message]
        found += controller.calibrated.doubts(controller.gripper_id, controller.motor.identity)
        if controller.output.made.is_weak:
            found.append(weak_text(controller.output.made))
        if (warm := _limited_by_heat(controller.output.heat, controller.now_s)) is not None:
            found.append(warm)
        share = controller.swing.share
        if share < 1.0:
            found.append(
                f"the jaws swung in a hold: until the motor is enabled again, holds and followers"
                f" have {share:.0%} of their stiffness and damping"
            )
        return found

    def _teleop_complaints(self, parts: Parts) -> list[str]:
        """Return what degrades the link between leader and follower."""
        found: list[str] = []
        link, action = parts.links.status, self._machine.controller.action
        if link is not None and link.state == "failed":
            found.append(f"the teleoperation link has failed: {link.error}")
        if isinstance(action, TeleopAction) and (complaint := action.complaint()) is not None:
            found.append(complaint)
        return found

    def _motor(self) -> MotorFacts:
        identity: MotorIdentity | None = self._machine.motor.view().identity
        return {
            "type": self._config.motor.type,
            "can_id": self._config.motor.can_id,
            "master_id": None if identity is None else identity.master_id,
            "serial": None if identity is None else identity.registers.get("SN"),
        }

    def _gripper(self) -> GripperFacts:
        controller = self._machine.controller
        geometry = controller.geometry
        return {
            "calibrated": geometry is not None,
            "mount": None if geometry is None else geometry.mount,
            "travel_mm": None if geometry is None else geometry.travel_mm,
            "closed_rad": None if geometry is None else geometry.closed_rad,
            "open_rad": None if geometry is None else geometry.open_rad,
            "rad_to_mm": None if geometry is None else geometry.rad_to_mm,
            "nm_to_n": None if geometry is None else geometry.nm_to_n,
            "stroke_mm": controller.gripper_id.stroke_mm,
            "work_stroke_mm": controller.calibrated.work_opening_mm,
            "kp": controller.gains.kp_nm_rad,
            "kd": controller.gains.kd_nm_s_rad,
        }


def _why_uncalibrated(calibrated: CalibrationInUse) -> str:
    if calibrated.is_coming:
        return "the calibration is still being read"
    is_refused = calibrated.problem.reason == "calibration_unreadable"
    return calibrated.problem.message if is_refused else "no calibration is loaded"


def _limited_by_heat(heat: HeatGuard, now_s: float) -> str | None:
    """Return how far the coil's heat limits holds, and for how long yet if that is known."""
    if math.isinf(heat.allowance_nm):
        return None
    limited = f"holds are limited to {heat.allowance_nm:.2f} N·m"
    coil_c, lasts_s = heat.model.coil_c, heat.lasts_s(now_s)
    if coil_c is None or lasts_s is None:
        return f"the coil is hot: {limited}"
    tens_s = max(10, 10 * math.ceil(lasts_s / 10))
    return f"the coil was hot, it has cooled to {coil_c:.0f} °C: {limited} for {tens_s} s more"


def _process_complaints(parts: Parts) -> list[str]:
    """Return what degrades the daemon's own processes and ticks."""
    found = list(parts.disks.full)
    if not parts.helper.is_running:
        found.append("the helper process is not running; it is being started again")
    if (uid := parts.helper.lately_refused(time.monotonic())) is not None:
        found.append(f"the helper process has too much to do: requests of uid {uid} were refused")
    if parts.helper.log_is_stuck:
        found.append("nobody reads standard error: log lines wait, and more of them are lost")
    if not parts.spawner.is_running:
        found.append("the process that starts the others is gone: none can be started")
    late_s = parts.reactor.recent_lateness.p99_s()
    if late_s is not None and late_s > _LATE_SHARE * parts.reactor.period_s:
        found.append(f"ticks start late: p99 {late_s * 1e6:.0f} µs in the last minute")
    worst_s = parts.reactor.recent_lateness.worst_s()
    if worst_s >= _STANDSTILL_S:
        found.append(f"the daemon itself stood still for {worst_s * 1e3:.0f} ms in the last minute")
    defects = parts.reactor.tick_errors + parts.reactor.backlog_errors
    if defects:
        found.append(f"{defects} ticks or requests failed by a defect; see the log")
    return found


def _calibration(controller: Controller) -> CalibrationFacts:
    """Return the origin of the calibration; `saved_s` is the file's date, in Unix time."""
    in_use = controller.calibrated
    calibration, problem = in_use.calibration, in_use.problem
    facts: CalibrationFacts = {
        "file": in_use.file,
        "nominal": calibration is not None and calibration.nominal,
        "channel": None if calibration is None else calibration.channel,
        "saved_s": None if calibration is None else calibration.saved_s,
        "foreign": in_use.foreign_doubt(controller.gripper_id, controller.motor.identity),
        "work_stroke": next(iter(in_use.work_stroke_doubts()), None),
        "problem": problem.message if problem.reason == "calibration_unreadable" else None,
    }
    return cast("CalibrationFacts", with_terms(facts))
