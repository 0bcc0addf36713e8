"""The new daemon's side of a restart that holds: prepares, then takes over between two ticks.

Until it has the state, it sends nothing to the motor and serves no client. A failure before that
is reported to the predecessor, which then continues. The predecessor also continues if this
process dies.
"""

import logging
import os
import time
from collections.abc import Callable, Sequence
from typing import Any

from litegripd.app.build import Legacy, socket_path
from litegripd.app.config import Config, ConfigError, same_settings
from litegripd.app.daemon import Daemon
from litegripd.app.features import build_service
from litegripd.app.machine import Machine
from litegripd.handover import state as handover
from litegripd.handover.link import Link, Packet, read_document
from litegripd.io.can.bus import DIRECT_INTERFACES
from litegripd.io.sockets import take_over
from litegripd.model.motion_config import MotionConfig
from litegripd.model.plain import PlainError, value_of
from litegripd.model.state import Stop
from litegripd.rpc.sessions import Peer

_log = logging.getLogger(__name__)

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
        self._prepare(hello["state"])

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
        handover.adopt(self._machine, self._service, read_document(state))
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
        is_told = isinstance(error, NotTakenError | ConfigError | PlainError | OSError)
        why = str(error) if is_told else f"a defect of the successor: {error!r}"
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
