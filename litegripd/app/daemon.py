"""The daemon: builds the objects, runs the control thread, and ends without moving the jaws.

In a restart that holds, the new daemon prepares, then takes over between two ticks. Until it has
the state, it sends nothing to the motor and serves no client. A failure before that is reported to
the predecessor, which then continues. The predecessor also continues if this process dies.
"""

import logging
import os
import signal
import time
from collections.abc import Callable, Sequence
from typing import Any

from litegrip_client.values.version import installed_version
from litegripd.app.build import (
    DiskWatch,
    Legacy,
    LinkWatch,
    Parts,
    build_service,
    load_at_start,
    make_bus,
    make_recorder,
    occupy_places,
    simulated_gripper,
    socket_path,
)
from litegripd.app.config import Config, ConfigError, same_settings
from litegripd.app.machine import Ending, Machine
from litegripd.app.status import (
    DaemonFacts,
    MotorGreeting,
    log_event,
    make_log_handler,
    warn_of_untried,
)
from litegripd.app.systemd import Supervision
from litegripd.handover import state as handover
from litegripd.handover.predecessor import Link, Packet, Retirement, Succession, read_document
from litegripd.io.helper.child import Child
from litegripd.io.helper.helper import Helper
from litegripd.io.helper.spawner import Spawner
from litegripd.io.loop import Reactor, Signals, Urgent
from litegripd.io.realtime import acquire, give_up_priority
from litegripd.io.server import MAX_CONNECTIONS, Server
from litegripd.io.sockets import take_over
from litegripd.io.stop_socket import Latched, StopListener, clients_within_limit
from litegripd.model.gripper import MOTOR_TYPES
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import DIRECT_INTERFACES
from litegripd.model.plain import PlainError, value_of
from litegripd.model.state import Owner, Stop, StopLevel
from litegripd.recorder.recorder import Dumps
from litegripd.rpc.sessions import Peer
from litegripd.teleop.links import TeleopLinks

_log = logging.getLogger(__name__)

OPEN_WITHIN_S = 0.5
"""How long the first clients wait until the motor is found; then it is reported as silent."""

READ_WITHIN_S = 5.0
"""How long they wait until the calibration is read; then it is reported as still loading."""


class Daemon:
    """One channel's daemon; `run` returns after SIGTERM or SIGINT, SIGUSR1 stops the gripper.

    Raises `InUseError` if the channel or the socket belongs to another process. Raises
    `TooFewDescriptorsError` if it may not open enough files to hear stops in any case.
    """

    def __init__(
        self, config: Config, arguments: Sequence[str] = (), legacy: Legacy | None = None
    ) -> None:
        period_s = 1.0 / config.control.rate_hz
        room = clients_within_limit(MAX_CONNECTIONS)
        self._config = config
        self._places = occupy_places(config) if legacy is None else legacy.places
        self._machine = Machine(config.gripper_id, config.motor.master_id, MotionConfig(), period_s)
        self._machine.controller.second_master.is_tolerated = (
            config.motor.second_master == "tolerate"
        )
        epoch = None if legacy is None else legacy.epoch
        self._spawner = Spawner()
        self._links = TeleopLinks(config.teleop.zenoh_config, self._spawner.start)
        self._facts = DaemonFacts(config, self._machine, self._places.stop_path, epoch)
        self._dumps = Dumps(self._machine.controller)
        self._service = build_service(
            self._machine.controller,
            self._facts,
            period_s,
            dumps=self._dumps,
            role_of=config.access.role_of,
            is_gateway=config.access.is_gateway,
            epoch=self._facts.epoch,
            restart=lambda on_restarted: self._succession.begin(on_restarted, time.monotonic()),
            links=self._links,
            simulated=simulated_gripper(config),
        )
        self._reactor = Reactor(period_s, self._tick)
        self._urgent = Urgent(period_s)
        self._stop_listener = StopListener(
            self._urgent, self._places.stops, self._stop, config.access.is_gateway
        )
        self._server = Server(self._reactor, self._places.requests, self._service, room)
        self._server.let_in(False)
        self._machine.controller.stop_latch.on_stop = self._note_stop
        self._reactor.backlog = self._server
        self._supervision = Supervision(
            self._machine,
            self._server,
            self._facts,
            lambda: self._service.reporter.state().mode,
            follows=legacy is not None,
        )
        self._recorder, self._memory = make_recorder(
            config, period_s, installed_version("litegripd")
        )
        self._service.on_event = self._recorder.event
        self._helper = Helper(
            self._watch,
            self._unwatch,
            memory_fd=self._memory.fd,
            start=self._spawner.start,
            arguments=config.trajectories.limits.arguments(),
        )
        self._bus = make_bus(config, period_s, self._spawner)
        self._link_watch = LinkWatch(config.bus)
        self._disk_watch = DiskWatch(self._places.path.parent)
        self._log_handler = make_log_handler(
            config.channel, lambda text: self._helper.post("log", {"text": text})
        )
        self._succession = Succession(
            same_settings(config),
            arguments,
            self._facts.epoch,
            interface=config.bus.interface,
            channel=config.bus.channel,
            machine=self._machine,
            service=self._service,
            helper=self._helper,
            bus=self._bus,
            places=self._places,
        )
        self._signals = Signals(
            {
                signal.SIGTERM: self._end,
                signal.SIGINT: self._end,
                signal.SIGHUP: self._end,  # the terminal is gone
                signal.SIGUSR1: self._stop_by_signal,
            }
        )
        self._previous_handlers = logging.getLogger().handlers
        self._parts: Parts | None = None
        self._ending = Ending(self._machine)
        self._greeting = MotorGreeting(MOTOR_TYPES[config.motor.type])
        self._calibration_is_known = False
        self._began_s: float | None = None
        self._retirement: Retirement | None = None

    def run(self) -> bool:
        """Run until the end, and disable the motor; return False if it may still be energised."""
        load_at_start(self._machine.controller, self._note_calibration)
        self._begin()
        warn_of_untried(self._machine.controller.gripper_id.motor_type)
        self._began_s = time.monotonic()
        return self._loop()

    def _begin(self) -> None:
        """Get what the loop needs: processes, rights, descriptors."""
        self._urgent.add(self._signals.fileno(), self._signals)
        self._reactor.add(self._urgent.fileno(), self._urgent)
        self._reactor.add(self._places.claim.fileno(), self._places.claim)
        self._helper.poll(time.monotonic())
        self._send_tasks()
        self._open_bus()
        logging.getLogger().handlers = [self._log_handler]
        rights = acquire(self._config.control.priority, self._config.control.cpus)
        for refused in () if self._facts.simulated else rights.refused:
            _log.warning("not granted, continuing without: %s", refused)
        self._parts = Parts(
            reactor=self._reactor,
            server=self._server,
            service=self._service,
            spawner=self._spawner,
            helper=self._helper,
            links=self._links,
            bus=self._bus,
            link=self._link_watch,
            disks=self._disk_watch,
            rights=rights,
            log=self._log_handler,
            bitrate=self._config.bus.bitrate,
        )
        self._facts.attach(self._parts)

    def _open_bus(self) -> None:
        """Open the adapter; that may take many periods."""
        self._bus.receive(time.monotonic())

    def _loop(self, first_tick_s: float | None = None) -> bool:
        try:
            self._reactor.run(first_tick_s)
        finally:
            self._log_handler.close()
            self._close()
            logging.getLogger().handlers = self._previous_handlers
        if self._retirement is not None:
            _log.info("ended; the motor belongs to the successor, pid %d", self._succession.pid)
            return True
        return self._ending.report()

    def _tick(self, now_s: float) -> None:
        """Do the work of one period, stops first; whatever fails, the daemon can still be ended."""
        if self._retirement is not None:  # not even a defect in `_retire` may command again
            self._reactor.stop()
            return
        self._urgent.serve()
        failed = True
        try:
            self._work(now_s)
            failed = False
        except Exception:
            self._service.reporter.tick(now_s)  # the state must not look fresh
            raise
        finally:
            if self._ending.is_over(now_s):
                self._reactor.stop()
            self._record(now_s, failed)

    def _work(self, now_s: float) -> None:
        """Receive, step the machine, send, and then answer clients."""
        received = self._bus.receive(now_s)
        condition = self._link_watch.judged(self._bus.condition)
        frames = self._machine.tick(now_s, received, condition)
        self._bus.send(frames, now_s)
        self._service.after_tick(now_s)
        for look in (self._link_watch.step(self._bus.condition), self._disk_watch.step(now_s)):
            if look is not None:
                self._machine.controller.tasks.append(look)
        self._spawner.poll(now_s, self._helper, may_wait=not self._machine.needs_commands)
        self._helper.poll(now_s)
        self._links.poll(now_s)
        if self._parts is not None:
            self._parts.tick(now_s)
        self._greeting.note(self._machine.controller.motor.identity)
        if self._began_s is not None:
            # Clients come once motor and calibration are found, or were awaited long enough.
            waited_s = now_s - self._began_s
            is_read = self._calibration_is_known or waited_s >= READ_WITHIN_S
            if is_read and (waited_s >= OPEN_WITHIN_S or not self._machine.is_out_of_reach):
                self._began_s = None
                self._open()
                self._supervision.ready()
        successor = self._succession.step(now_s, self._reactor.next_tick_s)
        if successor is not None:
            controller = self._machine.controller
            self._retirement = Retirement(
                successor, controller, self._urgent, lambda: self._ending.has_begun
            )
            self._reactor.stop()
            self._retire(self._retirement)

    def _record(self, now_s: float, failed: bool) -> None:
        """Record the tick; pass on tasks and events even if it failed."""
        machine, bus_is_up = self._machine, self._bus.condition.is_usable
        self._recorder.tick(
            now_s,
            machine.controller,
            machine.motor,
            machine.take_sent(),
            late_s=self._reactor.late_s,
            lost_ticks=self._reactor.lost_ticks,
            failed=failed,
            bus_is_up=bus_is_up,
            send_failures=self._bus.counters.send_failures,
        )
        self._dumps.step(now_s, failed=failed, bus_is_up=bus_is_up)
        self._send_tasks()
        for event in self._service.take_events():
            log_event(event, self._config.channel)
        self._log_handler.poll()
        self._supervision.tick(now_s, failed=failed)

    def _open(self) -> None:
        self._server.let_in(True)
        channel, places = self._config.channel, self._places
        _log.info("channel %s: listening on %s and %s", channel, places.path, places.stop_path)

    def _retire(self, retirement: Retirement) -> None:
        """End after a successor has taken over the bus and all new clients."""
        give_up_priority()
        self._succession.report_outcome()
        retirement.release_clients(self._server, self._stop_listener)
        self._supervision.followed_by(self._succession.pid, retirement.is_followed)

    def _stop(self, level: StopLevel, by: Owner, why: str | None) -> Latched:
        """Stop from the next command on; return the stop in force then."""
        controller = self._machine.controller
        named = by if by.remote is not None else self._server.named(by)
        controller.stop(level, named, why, time.monotonic())
        self._service.reporter.refresh()
        latched = controller.stop_latch.latched
        return Latched(
            level if latched is None else latched.level,
            controller.stop_latch.generation,
            self._service.reporter.state().motor,
        )

    def _note_stop(self, stopped_s: float) -> None:
        """Have all stops, from wherever they come, come before what was sent, and command soon."""
        self._server.note_stop(stopped_s)
        self._reactor.hasten()

    def _stop_by_signal(self) -> None:
        self._stop("hold", Owner(0, os.getpid(), os.getuid(), "signal SIGUSR1"), None)

    def _end(self) -> None:
        self._supervision.ends()
        self._ending.begin(time.monotonic())

    def _close(self) -> None:
        self._succession.close()
        self._dumps.finish(time.monotonic())
        self._send_tasks()
        if self._retirement is None:
            self._server.flush()
            self._server.close(self._ending.parting())
            self._stop_listener.close()
            self._places.remove()
            self._bus.close()
            self._helper.close()
            self._links.close()
            self._spawner.close()
        else:
            self._bus.leave()
            self._helper.let_go()
            self._links.let_go()
            self._spawner.let_go()
            self._retirement.close()
        self._signals.close()
        self._supervision.close()
        self._places.claim.close()
        self._urgent.close()
        self._reactor.close()
        self._memory.close()

    def _send_tasks(self) -> None:
        """Send the tasks of the pure rooms to the helper process."""
        tasks = self._machine.controller.tasks
        while tasks:
            task = tasks.pop(0)
            self._helper.request(task.operation, task.parameters, task.on_result, uid=task.uid)

    def _note_calibration(self) -> None:
        self._calibration_is_known = True

    def _watch(self, child: Child) -> None:
        self._reactor.add(child.socket.fileno(), self._helper)

    def _unwatch(self, child: Child) -> None:
        self._reactor.remove(child.socket.fileno())


_HELLO_WITHIN_S = 5.0
_LOOK_EVERY_S = 0.002
_REHEARSALS = 30


class NotTakenError(RuntimeError):
    """The predecessor keeps the bus; the message says why."""


class Successor(Daemon):
    """A daemon that continues the work of its predecessor.

    Raises `NotTakenError` or `PlainError` if it cannot; then the predecessor keeps the bus.
    """

    def __init__(self, config: Config, arguments: Sequence[str], link: Link) -> None:
        packet = link.wait(_HELLO_WITHIN_S)
        if packet is None or packet.kind != "hello":
            raise NotTakenError("the predecessor has not greeted")
        *sockets, document = packet.descriptors
        hello = read_document(document)
        _check_same(config, hello)
        bus, path = config.bus, socket_path(config)
        inherited = take_over(bus.interface, bus.channel, path, sockets)
        super().__init__(config, arguments, Legacy(inherited, hello["epoch"]))
        self._link = link
        self._greeted_with = hello["state"]
        self._prepare(self._greeted_with)

    def await_state(self) -> Packet:
        """Report that this process is ready; return the packet with the state when it comes."""
        pidfd = os.pidfd_open(os.getpid())
        try:
            self._link.send("ready", (pidfd,), pid=os.getpid())
        finally:
            os.close(pidfd)
        while True:
            packet = self._link.wait(_LOOK_EVERY_S)
            if packet is not None:
                if packet.kind != "state":
                    raise NotTakenError(f"the predecessor said {packet.kind}, and no state")
                return packet
            if self._link.has_ended:
                raise NotTakenError("the predecessor has broken off, or has ended")
            self._bus.stand_by(time.monotonic())

    def take_over(self, packet: Packet) -> float:
        """Adopt the state, and send the first command when the predecessor's was due.

        Return the time at which the next one is due.
        """
        state, self._history, *adapter = packet.descriptors
        handover.adopt(self._machine, self._service, read_document(state), self._greeted_with)
        self._bus.take_over(adapter, packet.body["pump"])
        due_s = float(packet.body["due_s"])
        time.sleep(max(due_s - time.monotonic(), 0.0))
        now_s = time.monotonic()
        received = self._bus.receive(now_s)
        # Our own socket has received the predecessor's commands: no other program sent them.
        own_id = self._machine.controller.gripper_id.can_id
        received = [frame for frame in received if frame.can_id != own_id]
        frames = self._machine.tick(now_s, received, self._bus.condition)
        self._bus.send(frames, now_s)
        gap_s = time.monotonic() - float(packet.body["sent_s"])
        self._check_bus()
        _log.info("took over %.1f ms after the last command of the daemon before", gap_s * 1e3)
        try:
            self._link.send("running", gap_s=gap_s)
        except OSError as error:  # it has died since; its state is ours
            _log.warning("the predecessor is gone already: %s", error)
        return due_s + self._reactor.period_s

    def serve(self, next_tick_s: float) -> bool:
        """Run as any daemon, to the end; return False if the motor may still be energised."""
        try:
            history = read_document(self._history)
            handover.adopt_history(self._machine, self._service, history)
        except Exception as error:  # noqa: BLE001 - the jaws are held, with or without it
            _log.error("the jobs of the daemon before are not known any more: %s", error)
        self._calibration_is_known = True
        self._urgent.add(self._link.fileno(), self)
        self._places.name_owner()
        self._open()
        return self._loop(next_tick_s)

    def on_event(self, _mask: int) -> None:
        """Take what the predecessor passes on after the handover: a stop, or the end."""
        packet = self._link.receive()
        if packet is not None and packet.kind == "stop":
            stop = value_of(packet.body["stop"], Stop, "stop")
            controller = self._machine.controller
            controller.stop(stop.level, stop.by, stop.why, time.monotonic())
            # Clients know the predecessor's generation: it must not go back.
            latch = controller.stop_latch
            latch.generation = max(latch.generation, int(packet.body["generation"]))
            self._service.reporter.refresh()
        elif packet is not None and packet.kind == "end":
            self._end()
        elif self._link.has_ended:
            self._urgent.remove(self._link.fileno())
            self._link.close()

    def _open_bus(self) -> None:
        """Open an own socket on the bus if the bus allows two."""
        self._bus.stand_by(time.monotonic())

    def _prepare(self, state: Any) -> None:
        """Warm up, at ordinary priority: the adapter's pump needs the processor, too."""
        for _ in range(_REHEARSALS):
            self._rehearse(state)
        self._reactor.freeze()
        self._begin()
        handover.adopt(self._machine, self._service, state)
        if self._config.bus.interface in DIRECT_INTERFACES:
            self._check_bus()

    def _check_bus(self) -> None:
        refusal = self._bus.condition.refusal(self._config.bus.channel)
        if refusal is not None:
            raise NotTakenError(f"the successor: {refusal.message}")

    def _rehearse(self, state: Any) -> None:
        """Adopt a copy of the state on trial, so that the real first tick is fast."""
        controller, now_s = self._machine.controller, time.monotonic()
        machine = Machine(
            controller.gripper_id, self._config.motor.master_id, MotionConfig(), controller.period_s
        )
        service = build_service(machine.controller, self._facts, controller.period_s)
        handover.adopt(machine, service, state)
        peer = Peer(os.getpid(), os.getuid(), os.getgid(), "rehearsal")
        session = service.opened(peer, now_s)
        for number in range(2):  # after more unanswered requests the motor would count as lost
            machine.tick(now_s + number * controller.period_s, ())
            service.after_tick(now_s)
            service.handle(session, b'{"jsonrpc":"2.0","id":1,"method":"state.get"}', now_s)


def succeed(load: Callable[[], Config], arguments: Sequence[str]) -> bool | None:
    """Take over from the daemon that has started this process, and run to the end.

    Return False if the motor may still be energised, None if it did not take over.
    """
    try:
        link = Link.inherited()
    except OSError:
        _log.error("no predecessor: this option is for the daemon's own use")
        return None
    try:
        successor = Successor(load(), arguments, link)
        next_tick_s = successor.take_over(successor.await_state())
    except Exception as error:  # noqa: BLE001 - the predecessor gets any error
        is_expected = isinstance(error, NotTakenError | ConfigError | PlainError | OSError)
        why = str(error) if is_expected else f"a defect of the successor: {error!r}"
        _log.error("no restart: %s", why)
        _report(link, why)
        return None
    return successor.serve(next_tick_s)


def _check_same(config: Config, hello: Any) -> None:
    """Reject a configuration that does not fit the hold."""
    before, now = hello["settings"], same_settings(config)
    differing = [f"[{table}]" for table, values in now.items() if values != before.get(table)]
    if differing:
        raise NotTakenError(
            f"{config.source or 'the configuration'} has another {' and '.join(differing)} than"
            " the running daemon: that needs a restart without the hold"
        )
    if str(socket_path(config)) != hello["path"]:
        raise NotTakenError(f"the socket would be {socket_path(config)}, not {hello['path']}")


def _report(link: Link, why: str) -> None:
    try:
        link.send("refused", why=why)
    except OSError as error:
        _log.debug("the predecessor does not listen any more: %s", error)
