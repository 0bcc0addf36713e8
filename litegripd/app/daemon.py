"""The daemon: builds the objects, runs the control thread, and ends it without moving the jaws."""

import logging
import os
import signal
import time
from pathlib import Path

from litegripd.app.config import Config
from litegripd.app.facts import DaemonFacts, Parts
from litegripd.app.machine import Machine
from litegripd.app.starting import load_at_start
from litegripd.io.bus import DIRECT_INTERFACES, FrameBus
from litegripd.io.child import Child
from litegripd.io.helper import Helper
from litegripd.io.listener import ChannelClaim, listen_on_all, runtime_directory
from litegripd.io.log import JournalSink, LogHandler, goes_to_journal
from litegripd.io.pumped_bus import PumpedBus
from litegripd.io.reactor import Reactor
from litegripd.io.realtime import acquire
from litegripd.io.server import Server
from litegripd.io.signals import Signals
from litegripd.io.stop_listener import StopListener
from litegripd.io.teleop_links import TeleopLinks
from litegripd.io.urgent import Urgent
from litegripd.model.events import Event
from litegripd.model.jobs import Owner, StopLevel
from litegripd.model.motion_config import MotionConfig
from litegripd.model.unit import Unit
from litegripd.motor.look import warnings
from litegripd.rpc.service import RpcService

_log = logging.getLogger(__name__)

_WARNINGS = frozenset({"stop", "refused", "object_lost", "heat", "second_master", "implausible"})

END_WITHIN_S = 1.5
"""So long the end waits for the motor to confirm that it is disabled."""

OPEN_WITHIN_S = 0.5
"""So long the first clients wait for motor and calibration to be found; then they are told that
these are not there."""

FIND_WITHIN_S = 0.3
"""So long the end waits for a motor that does not answer: it might be found, and be enabled."""


def socket_path(config: Config) -> Path:
    """Return where clients find the daemon; raises `InUseError` where no place can be used."""
    if config.rpc.socket is not None:
        return Path(config.rpc.socket)
    return runtime_directory() / f"{config.channel}.sock"


def stop_socket_path(path: Path) -> Path:
    """Return where stops are taken: `can0.stop.sock` beside `can0.sock`."""
    return path.parent / f"{path.name.removesuffix('.sock')}.stop.sock"


def make_bus(config: Config, period_s: float) -> FrameBus:
    """Choose how the adapter is driven: in the control thread, or by a process of its own."""
    if config.bus.interface in DIRECT_INTERFACES:
        from litegripd.io.direct_bus import DirectBus  # noqa: PLC0415 - imports python-can

        return DirectBus(config.bus)
    return PumpedBus(config.bus, period_s)


class Daemon:
    """One channel's daemon; `run` returns after SIGTERM or SIGINT, SIGUSR1 stops the gripper.

    Raises `InUseError` when the channel or the socket belongs to another process.
    """

    def __init__(self, config: Config) -> None:
        period_s = 1.0 / config.control.rate_hz
        self._config = config
        self._claim = ChannelClaim(config.bus.interface, config.bus.channel)
        self._path = socket_path(config)
        self._stop_path = stop_socket_path(self._path)
        # In this order, so that whoever has reached the one can stop by the other.
        stops, listener = listen_on_all((self._stop_path, self._path), config.rpc.group)
        unit = Unit(
            config.channel, config.motor.can_id, config.gripper.stroke_mm, config.gripper.mount
        )
        self._machine = Machine(unit, config.motor.master_id, MotionConfig(), period_s)
        self._machine.engine.second_master.is_tolerated = config.motor.second_master == "tolerate"
        self._links = TeleopLinks(config.teleop.zenoh_config)
        self._facts = DaemonFacts(config, self._machine, self._stop_path)
        self._service = RpcService(
            self._machine.engine,
            self._facts,
            period_s,
            role_of=config.access.role_of,
            epoch=self._facts.epoch,
            links=self._links,
        )
        self._reactor = Reactor(period_s, self._tick)
        self._urgent = Urgent(period_s)
        self._stop_listener = StopListener(self._urgent, stops, self._stop)
        self._server = Server(self._reactor, listener, self._service)
        self._server.let_in(False)
        self._reactor.backlog = self._server
        self._helper = Helper(self._watch, self._unwatch)
        self._bus = make_bus(config, period_s)
        self._log_handler = self._make_log_handler()
        self._signals = Signals(
            {
                signal.SIGTERM: self._end,
                signal.SIGINT: self._end,
                signal.SIGUSR1: self._stop_by_signal,
            }
        )
        self._parts: Parts | None = None
        self._ending_since_s: float | None = None
        self._motor_was_known = False
        self._calibration_is_known = False
        self._opens_at_s: float | None = None

    def run(self) -> bool:
        """Run until told to end, and disable the motor; tell whether it is known to be off."""
        self._urgent.add(self._signals.fileno(), self._signals)
        self._reactor.add(self._urgent.fileno(), self._urgent)
        self._reactor.add(self._claim.fileno(), self._claim)
        self._helper.poll(time.monotonic())
        load_at_start(self._machine.engine, self._note_calibration)
        self._run_errands()
        self._bus.receive(time.monotonic())  # opens the adapter, which may take many periods
        root = logging.getLogger()
        previous, root.handlers = root.handlers, [self._log_handler]
        rights = acquire(self._config.control.priority, self._config.control.cpus)
        for refused in rights.refused:
            _log.warning("not granted, going on without: %s", refused)
        self._parts = Parts(
            reactor=self._reactor,
            server=self._server,
            service=self._service,
            helper=self._helper,
            bus=self._bus,
            rights=rights,
            log=self._log_handler,
            bitrate=self._config.bus.bitrate,
        )
        self._facts.attach(self._parts)
        self._opens_at_s = time.monotonic() + OPEN_WITHIN_S
        try:
            self._reactor.run()
        finally:
            self._close()
            root.handlers = previous
        is_off = not self._machine.may_be_energised
        phase = self._machine.motor.view().phase.value
        if is_off:
            _log.info("ended; the motor is off (%s)", phase)
        else:
            _log.error("ended; the motor did not confirm that it is off (%s): cut its power", phase)
        return is_off

    def _tick(self, now_s: float) -> None:
        """Do one period's work, stops first; whatever fails in it, the end stays possible."""
        self._urgent.serve()
        try:
            self._work(now_s)
        except Exception:
            self._service.reporter.tick(now_s)  # the state must not look fresh
            raise
        finally:
            if self._is_over(now_s):
                self._reactor.stop()

    def _work(self, now_s: float) -> None:
        """Bus in, machine, bus out, and then what clients are owed."""
        received = self._bus.receive(now_s)
        frames = self._machine.tick(now_s, received, self._bus.condition)
        self._bus.send(frames, now_s)
        self._service.after_tick(now_s)
        self._helper.poll(now_s)
        self._links.poll(now_s)
        self._run_errands()
        if self._parts is not None:
            self._parts.tick(now_s)
        for event in self._service.take_events():
            _log_event(event)
        self._greet_motor()
        if self._opens_at_s is not None:
            self._open_when_ready(now_s, self._opens_at_s)

    def _open_when_ready(self, now_s: float, latest_s: float) -> None:
        """Let clients in once motor and calibration are found, or have not been for a while."""
        if now_s >= latest_s or (self._calibration_is_known and not self._machine.is_out_of_reach):
            self._opens_at_s = None
            self._server.let_in(True)
            channel = self._config.channel
            _log.info("channel %s: listening on %s and %s", channel, self._path, self._stop_path)

    def _stop(self, level: StopLevel, by: Owner, why: str | None) -> tuple[StopLevel, int]:
        """Stop, in force with the next command; return the level that is latched, and the count."""
        engine = self._machine.engine
        engine.stop(level, by, why, time.monotonic())
        self._service.reporter.refresh()
        latched = engine.stop_latch.latched
        return level if latched is None else latched.level, engine.stop_latch.generation

    def _stop_by_signal(self) -> None:
        self._stop("hold", Owner(0, os.getpid(), os.getuid(), "signal SIGUSR1"), None)

    def _end(self) -> None:
        """Begin the end: the motor is disabled in the next tick."""
        if self._ending_since_s is None:
            _log.info("ending: the motor is being disabled")
            self._ending_since_s = time.monotonic()
            self._machine.engine.shut_down()

    def _is_over(self, now_s: float) -> bool:
        """Whether the end has begun and nothing is to be waited for any more."""
        if self._ending_since_s is None:
            return False
        waited_s = now_s - self._ending_since_s
        if self._machine.is_out_of_reach and waited_s >= FIND_WITHIN_S:
            return True
        return self._machine.is_disabled or waited_s >= END_WITHIN_S

    def _close(self) -> None:
        self._server.flush()
        self._server.close()
        self._stop_listener.close()
        for path in (self._path, self._stop_path):
            path.unlink(missing_ok=True)
        self._helper.close()
        self._links.close()
        self._bus.close()
        self._signals.close()
        self._claim.close()
        self._urgent.close()
        self._reactor.close()

    def _greet_motor(self) -> None:
        """Say once what the motor told about itself."""
        identity = self._machine.motor.view().identity
        known = identity is not None
        if identity is not None and not self._motor_was_known:
            serial = identity.registers.get("SN")
            _log.info(
                "motor 0x%02X answers on 0x%02X, serial %s",
                identity.can_id,
                identity.master_id,
                serial,
            )
            for warning in warnings(identity):
                _log.warning("%s", warning)
        self._motor_was_known = known

    def _run_errands(self) -> None:
        """Hand the slow work that the pure rooms want done to the helper process."""
        errands = self._machine.engine.errands
        while errands:
            errand = errands.pop(0)
            self._helper.request(errand.operation, errand.parameters, errand.on_result)

    def _note_calibration(self) -> None:
        self._calibration_is_known = True

    def _watch(self, child: Child) -> None:
        self._reactor.add(child.socket.fileno(), self._helper)

    def _unwatch(self, child: Child) -> None:
        self._reactor.remove(child.socket.fileno())

    def _make_log_handler(self) -> LogHandler:
        if goes_to_journal():
            return LogHandler(JournalSink(self._config.channel))
        handler = LogHandler(lambda _record, text: self._helper.post("log", {"text": text + "\n"}))
        form = "%(asctime)s %(levelname)-7s %(message)s"
        handler.setFormatter(logging.Formatter(form, "%H:%M:%S"))
        return handler


def _log_event(event: Event) -> None:
    is_warning = event.kind in _WARNINGS or event.data.get("warning")
    level = logging.WARNING if is_warning else logging.INFO
    _log.log(level, "%s", event.message)
