"""Feeds the flight recorder: what each tick did and what happened, and when that is to be kept.

The one place that knows machine, recorder and dumps; time and the loop's figures are arguments.
"""

import os
from collections.abc import Mapping

from litegripd.app.config import Config
from litegripd.app.machine import Machine
from litegripd.app.status import daemon_version
from litegripd.io.shared_memory import SharedMemory
from litegripd.model.state import Event
from litegripd.recorder.causes import Dumps
from litegripd.recorder.recorder import Recorder, memory_bytes, tick_slots
from litegripd.rpc.service import RpcService


class Flight:
    """Records one machine into `memory`, which must have the size for its period."""

    def __init__(
        self, memory: memoryview, machine: Machine, dumps: Dumps, about: Mapping[str, object]
    ) -> None:
        self._machine = machine
        self._dumps = dumps
        self._phase = machine.motor.phase
        self._phase_number: int = self._phase.value
        self._can_id = machine.controller.gripper_id.can_id
        slots = tick_slots(machine.controller.period_s)
        self._recorder = Recorder(memory, slots, about)

    def tick(
        self,
        now_s: float,
        *,
        late_s: float,
        lost_ticks: int,
        failed: bool,
        bus_is_up: bool,
        send_failures: int = 0,
    ) -> None:
        """Record the tick that has just been done; `failed` tells that it was not, by a defect."""
        machine = self._machine
        phase = machine.motor.phase
        if phase is not self._phase:
            self._phase, self._phase_number = phase, phase.value
        sent = b""
        frames = machine.take_sent()
        for frame in frames:
            if frame.can_id == self._can_id:
                sent = frame.data
        self._recorder.tick(
            now_s,
            machine.controller,
            late_s=late_s,
            lost_ticks=lost_ticks,
            failed=failed,
            bus_is_up=bus_is_up,
            phase=self._phase_number,
            frames=len(frames),
            sent=sent,
            unanswered=machine.motor.unanswered,
            send_failures=send_failures,
        )
        self._dumps.step(now_s, failed=failed, bus_is_up=bus_is_up)

    def note_event(self, event: Event, now_s: float) -> None:
        """Record an event."""
        self._recorder.event(event, now_s)


def make_flight(
    config: Config, machine: Machine, service: RpcService, dumps: Dumps
) -> tuple[Flight, SharedMemory]:
    """Return the recorder of a daemon, and the memory that its helper process is to read."""
    memory = SharedMemory(memory_bytes(tick_slots(machine.controller.period_s)))
    about = {
        "channel": config.channel,
        "version": daemon_version(),
        "daemon_pid": os.getpid(),
        "rate_hz": config.control.rate_hz,
        "interface": config.bus.interface,
        "can_id": config.motor.can_id,
    }
    flight = Flight(memory.view, machine, dumps, about)
    service.on_event = flight.note_event
    return flight, memory
