"""What the daemon tells about itself: identity, configuration, and how it fares."""

import dataclasses
import math
import os
import resource
import secrets
import time
from collections.abc import Mapping
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from litegripd.app.config import Config
from litegripd.app.machine import Machine
from litegripd.control.heat import COIL_LIMIT_C, HeatGuard
from litegripd.control.in_use import CalibrationInUse
from litegripd.io.bus import FrameBus
from litegripd.io.calibration_files import is_nominal
from litegripd.io.helper import Helper
from litegripd.io.log import LogHandler
from litegripd.io.reactor import Reactor
from litegripd.io.realtime import RealtimeRights
from litegripd.io.server import MAX_CONNECTIONS, MAX_CONNECTIONS_PER_UID, Server
from litegripd.model.motor import MotorIdentity, MotorPhase
from litegripd.motor.look import warnings
from litegripd.rpc.openrpc import PROTOCOL_VERSION
from litegripd.rpc.service import RpcService
from litegripd.rpc.wire import MAX_LINE_BYTES

_LATE_SHARE = 0.4
"""When one tick in a hundred starts later than this share of a period, health says so."""


def daemon_version() -> str:
    """Return the installed version; a source tree that was never installed has none."""
    try:
        return version("litegripd")
    except PackageNotFoundError:
        return "0.0.0+source"


def page_bytes(field: int) -> int:
    """Return one field of /proc/self/statm in bytes; 1 is the resident memory."""
    with Path("/proc/self/statm").open(encoding="ascii") as statm:
        return int(statm.read().split()[field]) * resource.getpagesize()


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
        self._epoch = epoch or secrets.token_hex(8)
        self._version = daemon_version()
        self._began_s = time.monotonic()
        self._parts: Parts | None = None
        self.simulated = config.bus.interface == "litegrip_sim"

    @property
    def epoch(self) -> str:
        """Tells this start from every other; a successor has that of the first."""
        return self._epoch

    def attach(self, parts: "Parts") -> None:
        """Take the parts whose figures `health` tells."""
        self._parts = parts

    def hello(self) -> dict[str, object]:
        """Describe the daemon, the motor and the limits."""
        return {
            "daemon": "litegripd",
            "version": self._version,
            "protocol": PROTOCOL_VERSION,
            "channel": self._config.channel,
            "pid": os.getpid(),
            "epoch": self._epoch,
            "simulated": self.simulated,
            "stop_socket": self._stop_socket,
            "motor": self._motor(),
            "gripper": self._gripper(),
            "limits": {
                "rate_hz": self._config.control.rate_hz,
                "max_line_bytes": MAX_LINE_BYTES,
                "max_connections": MAX_CONNECTIONS,
                "max_connections_per_uid": MAX_CONNECTIONS_PER_UID,
            },
        }

    def info(self) -> dict[str, object]:
        """Tell what does not change."""
        config, identity = self._config, self._machine.motor.view().identity
        engine = self._machine.engine
        return {
            **self.hello(),
            "registers": {} if identity is None else dict(identity.registers),
            "motor_warnings": [] if identity is None else warnings(identity),
            "calibration_file": engine.calibrated.file,
            "calibration": _calibration(engine.calibrated),
            "motion": engine.config.as_fields(engine.period_s),
            "configuration": {
                "file": None if config.source is None else str(config.source),
                "bus": {
                    "interface": config.bus.interface,
                    "channel": config.bus.channel,
                    "bitrate": config.bus.bitrate,
                },
                "control": dataclasses.asdict(config.control),
                "rpc": {"group": config.rpc.group},
            },
        }

    def health(self, now_s: float) -> dict[str, object]:
        """Tell the verdict and the figures."""
        verdict, reasons = self.verdict()
        parts, uptime_s = self._parts, now_s - self._began_s
        figures = {} if parts is None else parts.figures(uptime_s, self._machine)
        return {"verdict": verdict, "reasons": reasons, **figures}

    def verdict(self) -> tuple[str, list[str]]:
        """Return ok, degraded or down, and why."""
        starting, parts = ["the daemon is still starting"], self._parts
        down, degraded = (starting, []) if parts is None else self._complaints(parts)
        return "down" if down else "degraded" if degraded else "ok", down + degraded

    def _complaints(self, parts: "Parts") -> tuple[list[str], list[str]]:
        """Return what keeps the gripper from being used, and what is merely not as it should."""
        view = self._machine.motor.view()
        down: list[str] = []
        refusal = parts.bus.condition.refusal()
        if refusal is not None:
            down.append(refusal.message)
        elif view.phase in (MotorPhase.SILENT, MotorPhase.FAULT) or view.problem is not None:
            problem = view.fault or view.problem
            down.append("the motor is silent" if problem is None else problem.message)
        other = self._machine.engine.second_master
        if other.is_active:
            down.append(f"another program commands the motor ({other.count} frames so far)")
        degraded = [f"not granted: {refused}" for refused in parts.rights.refused]
        if not parts.helper.is_running:
            degraded.append("the helper process is not running")
        if self._machine.engine.geometry is None:
            degraded.append("no calibration is loaded")
        late_s = parts.reactor.recent_lateness.p99_s()
        if late_s is not None and late_s > _LATE_SHARE * parts.reactor.period_s:
            degraded.append(f"ticks start late: p99 {late_s * 1e6:.0f} µs in the last minute")
        allowed_nm = self._machine.engine.output.heat.allowance_nm
        if math.isfinite(allowed_nm):
            degraded.append(f"the coil is hot: holds are limited to {allowed_nm:.2f} N·m")
        defects = parts.reactor.tick_errors + parts.reactor.backlog_errors
        if defects:
            degraded.append(f"{defects} ticks or requests failed by a defect; see the log")
        return down, degraded

    def _motor(self) -> dict[str, object]:
        identity: MotorIdentity | None = self._machine.motor.view().identity
        return {
            "type": self._config.motor.type,
            "can_id": self._config.motor.can_id,
            "master_id": None if identity is None else identity.master_id,
            "serial": None if identity is None else identity.registers.get("SN"),
        }

    def _gripper(self) -> dict[str, object]:
        engine = self._machine.engine
        geometry = engine.geometry
        return {
            "calibrated": geometry is not None,
            "mount": None if geometry is None else geometry.mount,
            "travel_mm": None if geometry is None else geometry.travel_mm,
            "closed_rad": None if geometry is None else geometry.closed_rad,
            "open_rad": None if geometry is None else geometry.open_rad,
            "rad_to_mm": None if geometry is None else geometry.rad_to_mm,
            "stroke_mm": self._config.gripper.stroke_mm,
            "kp": engine.gains.kp_nm_rad,
            "kd": engine.gains.kd_nm_s_rad,
        }


class Parts:
    """The running parts, and their figures."""

    def __init__(
        self,
        *,
        reactor: Reactor,
        server: Server,
        service: RpcService,
        helper: Helper,
        bus: FrameBus,
        rights: RealtimeRights,
        log: LogHandler,
        bitrate: int,
    ) -> None:
        self.reactor = reactor
        self.server = server
        self.service = service
        self.helper = helper
        self.bus = bus
        self.rights = rights
        self.log = log
        self._bitrate = bitrate
        self._window_began_s = time.monotonic()
        self._window_cpu_s = time.thread_time()
        self._window_bits = 0.0
        self.cpu_share = 0.0
        self.bus_load = 0.0

    def tick(self, now_s: float) -> None:
        """Once a second, take the shares of the second that has passed."""
        elapsed_s = now_s - self._window_began_s
        if elapsed_s < 1.0:
            return
        cpu_s, bits = time.thread_time(), self.bus.counters.bits
        self.cpu_share = (cpu_s - self._window_cpu_s) / elapsed_s
        self.bus_load = (bits - self._window_bits) / elapsed_s / self._bitrate
        self._window_began_s, self._window_cpu_s, self._window_bits = now_s, cpu_s, bits

    def figures(self, uptime_s: float, machine: Machine) -> Mapping[str, object]:
        """Return all figures by their rooms."""
        reactor, counters = self.reactor, self.bus.counters
        return {
            "uptime_s": round(uptime_s, 3),
            "control": {
                "rate_hz": round(1.0 / reactor.period_s),
                "ticks": reactor.ticks,
                "lost_ticks": reactor.lost_ticks,
                "tick_errors": reactor.tick_errors,
                "lateness": reactor.lateness.summary_us(),
                "tick_cost": reactor.tick_cost.summary_us(),
                "cpu_share": round(self.cpu_share, 4),
                "fifo_priority": self.rights.fifo_priority,
                "memory_locked": self.rights.memory_locked,
                "cpus": self.rights.cpus,
                "longest_collection_us": round(reactor.longest_collection_s * 1e6, 1),
                "resident_mb": round(page_bytes(1) / 1e6, 1),
            },
            "bus": {
                "state": machine.engine.bus.state,
                "error": machine.engine.bus.error,
                "load": round(self.bus_load, 4),
                **{name: getattr(counters, name) for name in _BUS_COUNTERS},
            },
            "motor": dataclasses.asdict(machine.motor.counters),
            "heat": _heat(machine.engine.output.heat),
            "rpc": {
                "clients": self.server.clients,
                "requests": self.server.requests,
                "refused_requests": self.service.refused,
                "refused_connections": self.server.refused_connections,
                "budget_exhausted": reactor.budget_exhausted,
                "late_shares": reactor.late_shares,
            },
            "helper": {
                "pid": self.helper.pid,
                "deaths": self.helper.deaths,
                "refused": self.helper.refused,
            },
            "log": {"dropped": self.log.dropped},
        }


def _calibration(in_use: CalibrationInUse) -> Mapping[str, object]:
    """Tell where the calibration came from; `saved_s` is the file's date, in Unix time."""
    calibration, file = in_use.calibration, in_use.file
    return {
        "file": file,
        "nominal": file is not None and is_nominal(file),
        "channel": None if calibration is None else calibration.channel,
        "saved_s": None if calibration is None else calibration.saved_s,
    }


_BUS_COUNTERS = (
    "sent",
    "received",
    "send_failures",
    "ignored",
    "error_frames",
    "errors",
    "reopened",
)


def _heat(heat: HeatGuard) -> Mapping[str, object]:
    """Tell the coil's temperature as the model has it, and how long the present load may last."""
    coil_c, limit_s = heat.model.coil_c, heat.model.time_to_limit_s()
    return {
        "coil_c": None if coil_c is None else round(coil_c, 1),
        "limit_c": COIL_LIMIT_C,
        "time_to_limit_s": None if limit_s is None else round(limit_s, 1),
        "allowed_nm": heat.allowance_nm if math.isfinite(heat.allowance_nm) else None,
    }
