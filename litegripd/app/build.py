"""The parts of a daemon, built as its configuration says, and the list of its features.

A slice without its lines in `GROUPS` and `Features` does not exist for clients. `load_at_start`
reads the calibration and the kept configuration. Without either the daemon runs, and reports what
is missing.
"""

import dataclasses
import logging
import math
import os
import resource
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from pathlib import Path
from secrets import token_urlsafe

from can.interfaces import VALID_INTERFACES

from litegrip_client.socketcan.link import BITRATE, rate_text
from litegrip_client.values.repeats import RepeatsHandler
from litegrip_client.values.terms import told
from litegrip_client.values.voices import in_shell_of
from litegripd.app.config import Config, ConfigError
from litegripd.app.machine import Machine
from litegripd.control.admission import NOT_CALIBRATED
from litegripd.control.calibration import REPAIR
from litegripd.control.controller import Controller
from litegripd.control.heat import HeatGuard
from litegripd.handover.state import OnRestart, RestartMethods, no_restart
from litegripd.io.can.bus import DirectBus, FrameBus
from litegripd.io.can.pumped import PumpedBus
from litegripd.io.helper.child import SharedMemory
from litegripd.io.helper.files import load_operation
from litegripd.io.helper.helper import Helper
from litegripd.io.helper.spawner import Spawner
from litegripd.io.loop import Reactor
from litegripd.io.realtime import RealtimeRights
from litegripd.io.server import Server
from litegripd.io.sockets import Places, occupy, runtime_directory
from litegripd.model.calibration import from_plain, of_stroke
from litegripd.model.errors import Refusal
from litegripd.model.gripper import MotorType
from litegripd.model.motion_config import MotionConfig, MotionConfigError
from litegripd.model.motor import DIRECT_INTERFACES, SIMULATOR, BusCondition, BusSettings
from litegripd.model.sentence import with_terms
from litegripd.model.state import HelperTask, TaskResult
from litegripd.recorder.recorder import Dumps, Recorder, RecorderMethods, memory_bytes, tick_slots
from litegripd.rpc.jsonrpc import encode
from litegripd.rpc.method import Feature, Method, methods_of
from litegripd.rpc.methods import CORE
from litegripd.rpc.openrpc import document
from litegripd.rpc.reports import Facts, Figures, HeatFigures, MotorFigures, MotorUse, Reporter
from litegripd.rpc.service import RpcService
from litegripd.rpc.sessions import Peer, Role
from litegripd.sim.methods import GripperOf, SimMethods
from litegripd.teleop.link import InProcessLinks, Links
from litegripd.teleop.links import TeleopLinks
from litegripd.teleop.methods import TeleopMethods
from litegripd.trajectories.file_methods import TrajectoryFileMethods
from litegripd.trajectories.methods import TrajectoryMethods

GROUPS: tuple[type, ...] = (
    *CORE,
    RestartMethods,
    RecorderMethods,
    TrajectoryMethods,
    TrajectoryFileMethods,
    TeleopMethods,
)
"""In the order of their methods in documents."""

METHODS: tuple[Method, ...] = tuple(row for group in GROUPS for row in methods_of(group))

SIMULATED_METHODS = methods_of(SimMethods)
"""Those that a daemon has beside the others when its gripper is simulated."""

BY_NAME: Mapping[str, Method] = {row.name: row for row in METHODS}


@lru_cache(maxsize=8)
def encoded_document(motor_type: MotorType, *, simulated: bool) -> bytes:
    """Return the OpenRPC document as JSON; the first call takes longer than a tick."""
    rows = (*METHODS, *SIMULATED_METHODS) if simulated else METHODS
    return encode(document([row.with_motor(motor_type) for row in rows]))


def build_service(
    controller: Controller,
    facts: Facts,
    period_s: float,
    *,
    dumps: Dumps | None = None,
    role_of: Callable[[Peer], Role] = lambda _peer: "admin",
    is_gateway: Callable[[Peer], bool] = lambda _peer: False,
    epoch: str = "0",
    restart: OnRestart = no_restart,
    links: Links | None = None,
    new_token: Callable[[], str] = token_urlsafe,
    simulated: GripperOf | None = None,
) -> RpcService:
    """Build the service with all features.

    Teleoperation uses `links`; without them it stays inside the process. `new_token` returns a
    secret that nobody can guess; it proves that a client holds the lease. `simulated` returns the
    simulated gripper; without it, the service has no methods that change its world.
    """

    def why_down() -> Refusal | None:
        return controller.bus.refusal(controller.gripper_id.bus_channel)

    def features(reporter: Reporter) -> Sequence[Feature]:
        files = TrajectoryFileMethods(controller)
        trajectories = TrajectoryMethods(controller, files)
        teleop = TeleopMethods(controller, links or InProcessLinks(), reporter, epoch)
        return (
            Feature((RestartMethods(restart),)),
            Feature((RecorderMethods(dumps or Dumps(controller)),)),
            Feature((trajectories, files), trajectories.session_ended),
            Feature((teleop,)),
            Feature(() if simulated is None else (SimMethods(simulated, why_down),)),
        )

    return RpcService(
        controller,
        facts,
        period_s,
        features,
        document=encoded_document(
            controller.gripper_id.motor_type, simulated=simulated is not None
        ),
        role_of=role_of,
        is_gateway=is_gateway,
        new_token=new_token,
    )


_log = logging.getLogger(__name__)


def socket_path(config: Config) -> Path:
    """Return the path of the daemon's socket; raises `InUseError` if no folder can be used."""
    if config.rpc.socket is not None:
        return Path(config.rpc.socket)
    return runtime_directory() / f"{config.channel}.sock"


def occupy_places(config: Config) -> Places:
    """Claim the channel and listen; raises `InUseError` if another process has one of them."""
    bus = config.bus
    return occupy(bus.interface, bus.channel, socket_path(config), config.rpc.group)


def simulated_gripper(config: Config) -> GripperOf | None:
    """Return what finds the simulated gripper of this process; None for a daemon on a real bus."""
    if config.bus.interface != SIMULATOR:
        return None
    from litegripd.sim.interface import gripper_on  # noqa: PLC0415 - the plant takes time to import

    return lambda: gripper_on(config.bus.channel)


def check_interface(interface: str, where: str) -> None:
    """Raise `ConfigError` for an interface that python-can has not, nor a package beside it."""
    known = sorted({SIMULATOR, *VALID_INTERFACES})
    if interface in known:
        return
    from difflib import get_close_matches  # noqa: PLC0415 - seldom needed

    alike = get_close_matches(interface.lower().replace("-", "_"), known, 1)
    meant = f"did you mean {alike[0]}? " if alike else ""
    raise ConfigError(
        f"{where} is {interface!r}, which python-can does not have; {meant}it has:"
        f" {', '.join(known)}"
    )


def check_simulated(config: Config) -> None:
    """Raise `ConfigError` if the simulated gripper of `[bus]` cannot be.

    Where it can, what it needs is imported by now: that takes longer than a tick.
    """
    bus = config.bus
    if bus.interface != SIMULATOR:
        return
    from litegripd.sim.gripper import (  # noqa: PLC0415 - it takes time to import
        build_gripper,
        check_bitrate,
        options_of,
    )

    where = "command line" if config.source is None else str(config.source)
    try:
        check_bitrate(bus.bitrate)
        options = options_of(bus.options)
        mechanics = options.get("mechanics", "")
        if ":" in mechanics and not mechanics.partition(":")[2].startswith("/"):
            raise ValueError(f"mechanics is {mechanics!r}, its scene must be an absolute path")
        build_gripper(**options)
    except ValueError as error:
        raise ConfigError(f"{where}: [bus] {error}") from None


def make_bus(config: Config, period_s: float, spawner: Spawner) -> FrameBus:
    """Return the bus: an adapter is driven in the control thread, or by a process of its own."""
    if config.bus.interface in DIRECT_INTERFACES:
        return DirectBus(config.bus)
    return PumpedBus(config.bus, period_s, spawner.start, config.control.priority)


def make_recorder(config: Config, period_s: float, version: str) -> tuple[Recorder, SharedMemory]:
    """Return the flight recorder, and the memory that the helper process reads."""
    slots = tick_slots(period_s)
    memory = SharedMemory(memory_bytes(slots))
    about = {
        "channel": config.channel,
        "version": version,
        "daemon_pid": os.getpid(),
        "rate_hz": config.control.rate_hz,
        "interface": config.bus.interface,
        "can_id": config.motor.can_id,
    }
    return Recorder(memory.view, slots, about), memory


@dataclass(frozen=True, slots=True)
class Legacy:
    """What a daemon inherits from its predecessor: the sockets, and the epoch of the start."""

    places: Places
    epoch: str


def page_bytes(field: int) -> int:
    """Return one field of /proc/self/statm in bytes; 1 is the resident memory."""
    with Path("/proc/self/statm").open(encoding="ascii") as statm:
        return int(statm.read().split()[field]) * resource.getpagesize()


class LinkWatch:
    """Has the interface's bit rate read at each link-up: a wrong one looks like a cable's fault.

    `bitrate` is what was read, None where nothing is known; `doubt` what is wrong with the link.
    `ifindex` is the kernel's number of the interface: it stays when the interface is renamed.
    """

    def __init__(self, bus: BusSettings) -> None:
        self.bitrate: int | None = None
        self.ifindex: int | None = None
        self.doubt: str | None = None
        self._bus = bus
        self._was_up = False

    def step(self, condition: BusCondition) -> HelperTask | None:
        """Return, once for each link-up, the task that reads it."""
        is_up = condition.state not in _NO_LINK and self._bus.interface == "socketcan"
        was_up, self._was_up = self._was_up, is_up
        if not is_up:
            self.bitrate = self.ifindex = self.doubt = None
        if not is_up or was_up:
            return None
        return HelperTask("link.look", {"channel": self._bus.channel}, self._take)

    def judged(self, condition: BusCondition) -> BusCondition:
        """Return a condition of the bus with what is wrong with its link in front."""
        if self.doubt is None or condition.state in _NO_LINK:
            return condition
        also = "" if condition.error is None else f"; {condition.error}"
        return replace(condition, error=f"{self.doubt}{also}")

    def _take(self, result: TaskResult) -> None:
        if result.error is not None or not isinstance(result.value, dict) or not self._was_up:
            return
        name, found = self._bus.channel, result.value
        self.bitrate, self.ifindex = found["bitrate"], found["ifindex"]
        wrong = []
        if self.bitrate is not None and self.bitrate != BITRATE:
            wrong.append(f"runs at {rate_text(self.bitrate)}, and the motor speaks at 1 Mbit/s")
        wrong += [f"has {mode} on ({why})" for mode, why in found["modes"].items()]
        if not wrong:
            return
        modes_off = "".join(f" {mode} off" for mode in found["modes"])
        again = (
            f", and again at every plug: {'; '.join(found['set_by'])}" if found["set_by"] else ""
        )
        self.doubt = (
            f"{name} {' and '.join(wrong)}{again}; to correct it: sudo ip link set {name} down &&"
            f" sudo ip link set {name} up type can bitrate {BITRATE}{modes_off}"
        )
        _log.warning("%s", self.doubt)


LOOK_AT_DISKS_EVERY_S = 10.0


class DiskWatch:
    """Has the helper look now and then if there is room for what the daemon writes.

    `full` says where nothing can be written, `nearly_full` where the largest file cannot.
    """

    def __init__(self, runtime: Path) -> None:
        self._runtime = runtime
        self.full: list[str] = []
        self.nearly_full: list[str] = []
        self._look_at_s = float("-inf")

    def step(self, now_s: float) -> HelperTask | None:
        """Return the task that looks, when its time has come."""
        if now_s < self._look_at_s:
            return None
        self._look_at_s = now_s + LOOK_AT_DISKS_EVERY_S
        return HelperTask("disk.look", {"runtime": str(self._runtime)}, self._take)

    def _take(self, result: TaskResult) -> None:
        """Take what was found; the change is logged, since the amount of what is free changes."""
        if result.error is not None or not isinstance(result.value, list):
            return
        was_full = bool(self.full)
        self.full = [one["text"] for one in result.value if one["is_full"]]
        self.nearly_full = [one["text"] for one in result.value if not one["is_full"]]
        if self.full and not was_full:
            _log.warning("%s", "; ".join(self.full))
        elif was_full and not self.full:
            _log.info("there is space again on what was full")


_NO_LINK = ("link_down", "adapter_gone", "down")
"""States of a bus whose interface is not up."""


@dataclass(slots=True, kw_only=True, eq=False)
class Parts:
    """The running parts, and their figures."""

    reactor: Reactor
    server: Server
    service: RpcService
    spawner: Spawner
    helper: Helper
    links: TeleopLinks
    bus: FrameBus
    link: LinkWatch
    disks: DiskWatch
    rights: RealtimeRights
    log: RepeatsHandler
    bitrate: int
    cpu_share: float = 0.0
    bus_load: float = 0.0
    _window_began_s: float = field(default_factory=time.monotonic)
    _window_cpu_s: float = field(default_factory=time.thread_time)
    _window_bits: float = 0.0

    @property
    def condition(self) -> BusCondition:
        """The state of the bus, with what is wrong with its link."""
        return self.link.judged(self.bus.condition)

    def tick(self, now_s: float) -> None:
        """Once a second, note the shares of the last second."""
        elapsed_s = now_s - self._window_began_s
        if elapsed_s < 1.0:
            return
        cpu_s, bits = time.thread_time(), self.bus.counters.bits
        self.cpu_share = (cpu_s - self._window_cpu_s) / elapsed_s
        self.bus_load = (bits - self._window_bits) / elapsed_s / self.bitrate
        self._window_began_s, self._window_cpu_s, self._window_bits = now_s, cpu_s, bits

    def figures(self, uptime_s: float, machine: Machine) -> Figures:
        """Return all figures, by room."""
        reactor, counters, pump = self.reactor, self.bus.counters, self.bus.lateness
        reach = None if self.links.status is None else self.links.status.reach
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
                "state": machine.controller.bus.state,
                "error": machine.controller.bus.error,
                "bitrate": self.link.bitrate,
                "ifindex": self.link.ifindex,
                "load": round(self.bus_load, 4),
                "sent": counters.sent,
                "received": counters.received,
                "send_failures": counters.send_failures,
                "ignored": counters.ignored,
                "error_frames": counters.error_frames,
                "errors": counters.errors,
                "reopened": counters.reopened,
                "pump_late_us": None if pump is None else round(pump.worst_s() * 1e6, 1),
            },
            "motor": motor_figures(machine),
            "heat": _heat(machine.controller.output.heat),
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
                "reach": None if reach is None else reach.state,
                "unreached": None if reach is None else reach.problem(time.monotonic()),
            },
            "log": {
                "dropped": self.log.dropped + self.helper.log_lines_lost,
                "is_stuck": self.helper.log_is_stuck,
            },
        }


def motor_figures(machine: Machine) -> MotorFigures:
    """Return the motor's counters, and who uses it."""
    is_active = machine.controller.second_master.is_active
    own: MotorUse = {"foreign_active": is_active, "in_use": machine.is_missed}
    return MotorFigures({**dataclasses.asdict(machine.motor.counters), **own})


def _heat(heat: HeatGuard) -> HeatFigures:
    """Return the coil's modelled temperature, and how long the present load may last."""
    coil_c, limit_s = heat.model.coil_c, heat.model.time_to_limit_s()
    return {
        "coil_c": None if coil_c is None else round(coil_c, 1),
        "limit_c": heat.limit_c,
        "time_to_limit_s": None if limit_s is None else round(limit_s, 1),
        "allowed_nm": heat.allowance_nm if math.isfinite(heat.allowance_nm) else None,
    }


def load_at_start(controller: Controller, on_calibration: Callable[[], None]) -> None:
    """Ask the helper for calibration and configuration; `on_calibration` follows the first."""
    gripper_id = controller.gripper_id
    controller.calibrated.expect()

    def use_calibration(result: TaskResult) -> None:
        on_calibration()
        if controller.calibrated.is_coming:
            unusable = _use_calibration(controller, result)
            if unusable is not None:
                _log.error("%s", unusable.message)
                _log.error("what to do: %s", in_shell_text(REPAIR, controller.gripper_id.channel))
        else:
            _log.info(
                "a client has loaded a calibration meanwhile; the one at the start is not used"
            )

    wanted = {"channel": gripper_id.channel, "mount": gripper_id.mount, "configured": True}
    controller.tasks.append(
        HelperTask(
            "motion.load",
            {"channel": gripper_id.channel},
            lambda result: _use_config(controller, result),
        )
    )
    controller.tasks.append(HelperTask("calibration.load", wanted, use_calibration))


def named_calibration(config: Config) -> Mapping[str, object] | None:
    """Read and judge, as a daemon does at its start, the file that is named for it.

    `problem` is why it would have no calibration, None if it would. None in all where no file is
    named: what is searched for then depends on whose daemon it is.
    """
    gripper_id, file = config.gripper_id, config.gripper.named_file
    if file is None:
        return None
    controller = Controller(MotionConfig(), 1.0 / config.control.rate_hz, gripper_id)
    try:
        wanted = {"channel": config.channel, "mount": gripper_id.mount, "configured": True}
        result = TaskResult(load_operation(wanted))
    except (ValueError, OSError, RuntimeError) as error:
        result = TaskResult(error=str(error))
    unusable = _use_calibration(controller, result)
    if unusable is not None:
        _log.error("%s", unusable.message)
    in_use = controller.calibrated
    problem = None if in_use.geometry is not None else in_use.problem.message
    if problem is not None and in_use.calibration is not None:
        problem = f"{file} says that it is none, with calibrated = false: {problem}"
        _log.error("%s", problem)
    doubts = in_use.doubts(gripper_id, None) + in_use.work_stroke_doubts()
    for doubt in doubts:
        _log.warning("the calibration %s: %s", file, doubt)
    return {
        "file": file,
        "named_by": "[gripper] mount" if gripper_id.mount else "LITEGRIP_CALIB",
        "problem": problem,
        "warnings": doubts,
    }


def in_shell_text(text: object, channel: str) -> str:
    """Return a sentence with the commands of `litegripctl` for what it names: a person reads it."""
    voice = in_shell_of(lambda name: name.replace("litegripctl", f"litegripctl -c {channel}"))
    return told(with_terms({"message": text}), "message", voice)


def _use_calibration(controller: Controller, result: TaskResult) -> Refusal | None:
    """Use what was found, if anything; return why a file that was found cannot be used, or None."""
    if result.error is not None or not isinstance(result.value, dict):
        text = f"no calibration: {result.error}"
        refusal = Refusal("calibration_unreadable", text, {"hint": REPAIR})
        controller.use_calibration(None, refusal)
        return refusal
    channel = controller.gripper_id.channel
    for skipped in result.value["skipped"]:
        # A file that bears this channel's name should be for it; others need not be.
        is_own = f"{channel}_calibration.json: " in skipped
        _log.log(
            logging.WARNING if is_own else logging.INFO, "calibration passed over: %s", skipped
        )
    found = result.value["calibration"]
    if found is None:
        what_to_do = in_shell_text(NOT_CALIBRATED.data["hint"], channel)
        text = "no calibration for channel %s: motions are refused; %s"
        _log.warning(text, channel, what_to_do)
        controller.use_calibration(None)
        return None
    calibration = of_stroke(from_plain(found), controller.gripper_id.stroke_mm)
    path = result.value["path"]
    unfitting = controller.calibrated.why_unfitting(
        calibration, path, controller.gripper_id, controller.motor.identity
    )
    if unfitting is not None:
        controller.use_calibration(None, unfitting)
        return unfitting
    controller.use_calibration(calibration, file=path)
    return None


def _use_config(controller: Controller, result: TaskResult) -> None:
    if result.error is not None or not isinstance(result.value, dict):
        _log.error("the kept motion configuration is not used: %s", result.error)
        return
    kept = result.value["config"]
    if kept is None:
        return
    path = result.value["path"]
    config = _usable(controller, kept, path)
    if config is not None:
        controller.config, controller.config_is_kept = config, True
        _log.info("motion configuration: %s", path)


def _usable(controller: Controller, kept: Mapping[str, object], path: str) -> MotionConfig | None:
    """Return the configuration with what was kept, but for fields that may not be so any more."""
    before, period_s = controller.config, controller.period_s
    fields, rest = before.as_fields(period_s), dict(kept)
    for _ in range(len(fields)):
        found = _changed(before, rest, period_s, controller.gripper_id.motor_type)
        if isinstance(found, MotionConfig):
            return found
        refused = [name for name in rest if name[:40] == found.field]
        for name in refused:
            counts = f"; {fields[name]:g} counts" if name in fields else ""
            _log.error("in the kept motion configuration %s, %s%s", path, found, counts)
            del rest[name]
        if not refused:
            break
    _log.error("the kept motion configuration %s is not used: %s", path, found)
    return None


def _changed(
    config: MotionConfig, values: Mapping[str, object], period_s: float, motor_type: MotorType
) -> MotionConfig | MotionConfigError:
    try:
        return config.changed(values, period_s, motor_type)
    except MotionConfigError as error:
        return error
