"""The daemon's running parts, and the figures that `health` tells of them."""

import dataclasses
import math
import resource
import time
from pathlib import Path

from litegripd.app.machine import Machine
from litegripd.control.heat import HeatGuard
from litegripd.io.can.bus import FrameBus
from litegripd.io.helper.helper import Helper
from litegripd.io.helper.spawner import Spawner
from litegripd.io.log import LogHandler
from litegripd.io.loop import Reactor
from litegripd.io.realtime import RealtimeRights
from litegripd.io.server import Server
from litegripd.rpc.facts import Figures, ForeignActive, HeatFigures, MotorFigures
from litegripd.rpc.service import RpcService
from litegripd.teleop.links import TeleopLinks


def page_bytes(field: int) -> int:
    """Return one field of /proc/self/statm in bytes; 1 is the resident memory."""
    with Path("/proc/self/statm").open(encoding="ascii") as statm:
        return int(statm.read().split()[field]) * resource.getpagesize()


class Parts:
    """The running parts, and their figures."""

    def __init__(
        self,
        *,
        reactor: Reactor,
        server: Server,
        service: RpcService,
        spawner: Spawner,
        helper: Helper,
        links: TeleopLinks,
        bus: FrameBus,
        rights: RealtimeRights,
        log: LogHandler,
        bitrate: int,
    ) -> None:
        self.reactor = reactor
        self.server = server
        self.service = service
        self.spawner = spawner
        self.helper = helper
        self.links = links
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

    def figures(self, uptime_s: float, machine: Machine) -> Figures:
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
                "sent": counters.sent,
                "received": counters.received,
                "send_failures": counters.send_failures,
                "ignored": counters.ignored,
                "error_frames": counters.error_frames,
                "errors": counters.errors,
                "reopened": counters.reopened,
            },
            "motor": motor_figures(machine),
            "heat": _heat(machine.engine.output.heat),
            "rpc": {
                "clients": self.server.clients,
                "requests": self.server.requests,
                "refused_requests": self.service.refused,
                "refused_connections": self.server.refused_connections,
                "budget_exhausted": reactor.budget_exhausted,
                "late_shares": reactor.late_shares,
            },
            "spawner": {
                "pid": self.spawner.pid,
                "is_running": self.spawner.is_running,
                "deaths": self.spawner.deaths,
            },
            "helper": {
                "pid": self.helper.pid,
                "deaths": self.helper.deaths,
                "refused": self.helper.refused,
                "waiting": self.helper.waiting,
            },
            "teleop": {
                "pid": self.links.pid,
                "is_running": self.links.pid is not None,
                "deaths": self.links.deaths,
                "link": None if self.links.status is None else self.links.status.state,
                "open_to_network": self.links.is_open_to_network,
            },
            "log": {
                "dropped": self.log.dropped + self.helper.log_lines_lost,
                "is_stuck": self.helper.log_is_stuck,
            },
        }


def motor_figures(machine: Machine) -> MotorFigures:
    """Tell the motor's counters, and whether somebody else commands it just now."""
    is_active = machine.engine.second_master.is_active
    own: ForeignActive = {"foreign_active": is_active}
    return MotorFigures({**dataclasses.asdict(machine.motor.counters), **own})


def _heat(heat: HeatGuard) -> HeatFigures:
    """Tell the coil's temperature as the model has it, and how long the present load may last."""
    coil_c, limit_s = heat.model.coil_c, heat.model.time_to_limit_s()
    return {
        "coil_c": None if coil_c is None else round(coil_c, 1),
        "limit_c": heat.limit_c,
        "time_to_limit_s": None if limit_s is None else round(limit_s, 1),
        "allowed_nm": heat.allowance_nm if math.isfinite(heat.allowance_nm) else None,
    }
