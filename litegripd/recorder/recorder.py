"""The flight recorder: a ring of the last ticks, and when it is dumped."""

import json
import struct
from collections.abc import Mapping, Sequence
from typing import get_args
from zlib import crc32

from litegripd.control.controller import Controller
from litegripd.control.holds import Slack
from litegripd.model.geometry import Geometry
from litegripd.model.motor import CanFrame, Feedback, MitCommand, MotorPhase
from litegripd.model.state import Event, JobKind, Owner
from litegripd.motor.motor import Motor
from litegripd.motor.phases import Phase

_NUMBER = struct.Struct("<Q")
_CHECKSUM = struct.Struct("<I")
OVERHEAD_BYTES = _CHECKSUM.size


class Ring:
    """Writes records of `record_bytes` into `memory`; each replaces the oldest.

    A record begins with its number, 8 bytes, little-endian: `next_number` when it is written.
    """

    def __init__(self, memory: memoryview, record_bytes: int) -> None:
        self.next_number = 1
        self._memory = memory
        self._slot_bytes = record_bytes + OVERHEAD_BYTES
        self._end = len(memory) // self._slot_bytes * self._slot_bytes
        self._offset = 0

    def put(self, record: bytes) -> None:
        """Write a record; raises `ValueError` for one of another length, before it writes."""
        begin = self._offset
        end = begin + self._slot_bytes
        self._memory[begin:end] = record + _CHECKSUM.pack(crc32(record))
        self._offset = end if end < self._end else 0
        self.next_number += 1


def records(memory: bytes | memoryview, record_bytes: int) -> list[bytes]:
    """Return the complete records in a ring's memory, the oldest first.

    Records that are torn, or being written, and empty slots are left out.
    """
    slot_bytes = record_bytes + OVERHEAD_BYTES
    found: list[tuple[int, bytes]] = []
    for begin in range(0, len(memory) // slot_bytes * slot_bytes, slot_bytes):
        record = bytes(memory[begin : begin + record_bytes])
        (checksum,) = _CHECKSUM.unpack_from(memory, begin + record_bytes)
        if crc32(record) == checksum:
            found.append((*_NUMBER.unpack_from(record), record))
    return [record for _number, record in sorted(found)]


KEPT_S = 60.0
EVENTS = 1024
REFUSALS = 256
"""Rejected requests have a ring of their own: a flood of them must not displace other events."""

HEADER = struct.Struct("<8sI")
MAGIC = b"LGREC\x00\x00\x01"
TICK = struct.Struct("<QdfQBBBBB8s3f3B4f2d2fQQIII")
"""Number, time, lateness in µs, lost ticks, flags, two phases, frames, kind of the job, payload;
ranges, feedback, requested command, geometry; unanswered requests, lost frames, job, its owner's
pid and client.
"""

TEXT = struct.Struct("<QdH")
TEXT_BYTES = 490
TEXT_RECORD_BYTES = TEXT.size + TEXT_BYTES
PHASES: tuple[MotorPhase, ...] = tuple(MotorPhase)
KINDS: tuple[JobKind, ...] = get_args(JobKind)

BUS_UP, FAILED, HAS_FEEDBACK, HAS_REQUEST, CALIBRATED, HAS_SENT, IS_SLACK, IS_STOPPED = (
    1 << bit for bit in range(8)
)
_NO_FEEDBACK = Feedback(0, 0.0, 0.0, 0.0, 0, 0, 0.0)
_NO_COMMAND = MitCommand(0.0, 0.0, 0.0, 0.0, 0.0)
_NOBODY = Owner(0, 0, 0, "")
_PHASE_NUMBERS: Mapping[MotorPhase, int] = {phase: n for n, phase in enumerate(PHASES)}
_KIND_NUMBERS: Mapping[JobKind, int] = {kind: n for n, kind in enumerate(KINDS)}


def tick_slots(period_s: float) -> int:
    """Return how many ticks are kept at this control period."""
    return round(KEPT_S / period_s)


def memory_bytes(slots: int) -> int:
    """Return the bytes of memory for a recorder of `slots` ticks."""
    return sum(part_bytes(slots))


def part_bytes(slots: int) -> tuple[int, ...]:
    """Return the sizes of header, description, ticks, events and refusals, in this order."""
    text_bytes = TEXT_RECORD_BYTES + OVERHEAD_BYTES
    tick_bytes = TICK.size + OVERHEAD_BYTES
    return (
        HEADER.size,
        text_bytes,
        slots * tick_bytes,
        EVENTS * text_bytes,
        REFUSALS * text_bytes,
    )


def parts(memory: memoryview, slots: int) -> list[memoryview]:
    """Return the parts of a memory; raises `ValueError` if its size is wrong."""
    if len(memory) != memory_bytes(slots):
        raise ValueError(f"a recorder of {slots} ticks needs {memory_bytes(slots)} bytes")
    found, begin = [], 0
    for size in part_bytes(slots):
        found.append(memory[begin : begin + size])
        begin += size
    return found


class Recorder:
    """Writes into `memory`, of `memory_bytes(slots)` bytes; `about` describes the daemon.

    Call `tick` at the end of each tick; it takes a few microseconds.
    """

    def __init__(self, memory: memoryview, slots: int, about: Mapping[str, object]) -> None:
        header, description, ticks, events, refusals = parts(memory, slots)
        self._ticks = Ring(ticks, TICK.size)
        self._events = Ring(events, TEXT_RECORD_BYTES)
        self._refusals = Ring(refusals, TEXT_RECORD_BYTES)
        self._owner = _NOBODY
        self._named: tuple[int, str] | None = None
        self._phase = PHASES[0]
        self._phase_number = 0
        self._inner_phase = Phase.LOOKING
        self._inner_phase_number: int = Phase.LOOKING.value
        self._geometry: Geometry | None = None
        self._geometry_flag = 0
        self._closed_rad = 0.0
        self._mm_per_rad = 0.0
        _put_text(Ring(description, TEXT_RECORD_BYTES), 0.0, {}, about)
        HEADER.pack_into(header, 0, MAGIC, slots)

    def tick(
        self,
        now_s: float,
        controller: Controller,
        motor: Motor,
        frames: Sequence[CanFrame],
        *,
        late_s: float,
        lost_ticks: int,
        failed: bool,
        bus_is_up: bool,
        send_failures: int = 0,
    ) -> None:
        """Record one tick, in which `frames` were sent; `failed` if a defect broke it off.

        `send_failures` counts the frames that the bus has lost since the start.
        """
        view, gripper_id = controller.motor, controller.gripper_id
        feedback, requested = view.feedback or _NO_FEEDBACK, controller.output.requested
        identity, job = view.identity, controller.jobs.running
        ranges = gripper_id.motor_type.ranges if identity is None else identity.ranges
        self._note_changes(now_s, controller, motor.phase)
        sent = b""
        for frame in frames:
            if frame.can_id == gripper_id.can_id:
                sent = frame.data
        owner = self._owner
        flags = self._flags(controller)
        if bus_is_up:
            flags |= BUS_UP
        if failed:
            flags |= FAILED
        if sent:
            flags |= HAS_SENT
        wanted = requested or _NO_COMMAND
        self._ticks.put(
            TICK.pack(
                self._ticks.next_number,
                now_s,
                late_s * 1e6,
                lost_ticks,
                flags,
                self._phase_number,
                self._inner_phase_number,
                len(frames),
                0 if job is None else _KIND_NUMBERS[job.kind],
                sent,
                ranges.position_rad,
                ranges.velocity_rad_s,
                ranges.torque_nm,
                feedback.status,
                feedback.driver_temperature_c,
                feedback.coil_temperature_c,
                feedback.position_rad,
                feedback.velocity_rad_s,
                feedback.torque_nm,
                now_s - feedback.at_s,
                wanted.position_rad,
                wanted.torque_nm,
                self._closed_rad,
                self._mm_per_rad,
                motor.unanswered,
                send_failures,
                0 if job is None else job.number,
                owner.pid,
                owner.client,
            )
        )

    def _note_changes(self, now_s: float, controller: Controller, inner_phase: Phase) -> None:
        """Recompute what follows from owner, calibration and phases if one of them has changed."""
        job, holder, phase = (
            controller.jobs.running,
            controller.lease.holder,
            controller.motor.phase,
        )
        owner = _NOBODY
        if job is not None:
            owner = job.owner
        elif holder is not None:
            owner = holder.owner
        if owner is not self._owner:
            self._note_owner(now_s, owner)
        if controller.geometry is not self._geometry:
            self._note_geometry(controller.geometry)
        if phase is not self._phase:
            self._phase, self._phase_number = phase, _PHASE_NUMBERS[phase]
        if inner_phase is not self._inner_phase:
            self._inner_phase, self._inner_phase_number = inner_phase, inner_phase.value

    def event(self, event: Event, now_s: float) -> None:
        """Record one event; one that is too long for its slot is cut, and marked as cut."""
        ring = self._refusals if event.kind == "refused" else self._events
        head = {"kind": event.kind, "message": event.message}
        _put_text(ring, now_s, head, event.data)

    def _flags(self, controller: Controller) -> int:
        flags = self._geometry_flag
        if controller.motor.feedback is not None:
            flags |= HAS_FEEDBACK
        if controller.output.requested is not None:
            flags |= HAS_REQUEST
        if type(controller.idle) is Slack:
            flags |= IS_SLACK
        if controller.stop_latch.latched is not None:
            flags |= IS_STOPPED
        return flags

    def _note_owner(self, now_s: float, owner: Owner) -> None:
        """Record the owner's name; a tick has only its number."""
        self._owner = owner
        named = (owner.client, owner.program)
        if owner is _NOBODY or named == self._named:
            return
        self._named = named
        text = f"in the hands of {owner.program} (pid {owner.pid}, uid {owner.uid})"
        data = {"client": owner.client, "pid": owner.pid, "program": owner.program[:64]}
        _put_text(self._events, now_s, {"kind": "owner", "message": text}, data)

    def _note_geometry(self, geometry: Geometry | None) -> None:
        self._geometry, self._geometry_flag = geometry, 0
        if geometry is not None:
            self._geometry_flag = CALIBRATED
            self._closed_rad = geometry.closed_rad
            self._mm_per_rad = -geometry.close_sign * geometry.rad_to_mm


def _put_text(
    ring: Ring, now_s: float, head: Mapping[str, str], data: Mapping[str, object]
) -> None:
    """Write a text; one that is too long loses its data, then the end of its message."""
    text = json.dumps({**head, "data": dict(data)}, default=str).encode()
    message = head.get("message", "")
    while len(text) > TEXT_BYTES:
        text = json.dumps({**head, "message": message, "is_cut": True}).encode()
        message = message[: len(message) * 3 // 4]
    ring.put(TEXT.pack(ring.next_number, now_s, len(text)) + text.ljust(TEXT_BYTES, b"\0"))
