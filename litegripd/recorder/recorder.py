"""The flight recorder: a ring of the last ticks, and when it is dumped to the disk.

A client asks for a dump, or there is a `Cause`. This file only makes the task; the helper process
writes. There is one dump at a time, and by itself at most one in `APART_S`: the next dump shows
what happens between. A cause that comes again and again is dumped at intervals that double.
"""

import json
import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Literal, TypeAlias, get_args
from zlib import crc32

from litegripd.control.controller import Controller
from litegripd.control.holds import Slack
from litegripd.model.calibration import Dumped
from litegripd.model.errors import Refusal
from litegripd.model.gripper import Geometry
from litegripd.model.motor import CanFrame, Feedback, MitCommand, MotorPhase
from litegripd.model.state import Event, EventKind, HelperTask, JobKind, Owner, TaskResult
from litegripd.motor.motor import Motor
from litegripd.motor.phases import Phase
from litegripd.rpc.method import Answer, Call, Deferred, Method, Param

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
OF_KIND = 8
"""So many of each kind are kept besides: what flaps displaces nothing of another kind."""
_EVENT_KINDS: tuple[EventKind, ...] = get_args(EventKind)

HEADER = struct.Struct("<8sI")
MAGIC = b"LGREC\x00\x00\x02"
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
        len(_EVENT_KINDS) * OF_KIND * text_bytes,
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
        header, description, ticks, events, refusals, of_kinds = parts(memory, slots)
        self._ticks = Ring(ticks, TICK.size)
        self._events = Ring(events, TEXT_RECORD_BYTES)
        self._refusals = Ring(refusals, TEXT_RECORD_BYTES)
        share = len(of_kinds) // len(_EVENT_KINDS)
        self._of_kinds = {
            kind: Ring(of_kinds[n * share : (n + 1) * share], TEXT_RECORD_BYTES)
            for n, kind in enumerate(_EVENT_KINDS)
        }
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
        job, holder = controller.jobs.running, controller.lease.holder
        geometry, phase = controller.geometry, controller.motor.phase
        owner = _NOBODY
        if job is not None:
            owner = job.owner
        elif holder is not None:
            owner = holder.owner
        if owner is not self._owner:
            self._note_owner(now_s, owner)
        if geometry is not self._geometry:
            self._geometry, self._geometry_flag = geometry, 0
            if geometry is not None:
                self._geometry_flag = CALIBRATED
                self._closed_rad = geometry.closed_rad
                self._mm_per_rad = -geometry.close_sign * geometry.rad_to_mm
        if phase is not self._phase:
            self._phase, self._phase_number = phase, _PHASE_NUMBERS[phase]
        if inner_phase is not self._inner_phase:
            self._inner_phase, self._inner_phase_number = inner_phase, inner_phase.value

    def event(self, event: Event, now_s: float) -> None:
        """Record one event; one that is too long for its slot is cut, and marked as cut."""
        ring = self._refusals if event.kind == "refused" else self._events
        head = {"kind": event.kind, "message": event.message}
        self._of_kinds[event.kind].put(_put_text(ring, now_s, head, event.data))

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


def _put_text(
    ring: Ring, now_s: float, head: Mapping[str, str], data: Mapping[str, object]
) -> bytes:
    """Write a text and return its record; what is too long loses data, then the message's end."""
    text = json.dumps({**head, "data": dict(data)}, default=str).encode()
    message = head.get("message", "")
    while len(text) > TEXT_BYTES:
        text = json.dumps({**head, "message": message, "is_cut": True}).encode()
        message = message[: len(message) * 3 // 4]
    record = TEXT.pack(ring.next_number, now_s, len(text)) + text.ljust(TEXT_BYTES, b"\0")
    ring.put(record)
    return record


Cause: TypeAlias = Literal[
    "demand",
    "motor_fault",
    "motor_silent",
    "motor_reset",
    "implausible",
    "second_master",
    "bus_lost",
    "tick_error",
]
"""`motor_silent`: a motor that may be energised has stopped answering, though the bus works.
`motor_reset`: an enabled motor reports that it is disabled, though the daemon did not ask for it;
its supply failed for a moment, or another program did it. `implausible`: the daemon has disabled
the motor because its position jumped.
"""

AFTER_S = 1.0
"""The dump is made this long after its cause, so that it shows the effects."""

APART_S = KEPT_S - 5.0
"""Less than the recorded time: the next dump still shows a fault right after this one."""

APART_AT_MOST_S = 3600.0
_FLAPPING: frozenset[Cause] = frozenset({"bus_lost", "motor_silent", "motor_reset"})
"""What a loose plug causes. From its third dump on, each waits twice as long as the one before, an
hour at most: one in every `APART_S` is 1570 files a day, and the ten that are kept would be of its
last ten minutes. What has stayed away for an hour is dumped at once."""

_MOST_CAUSES = 10
_POWERED = (MotorPhase.ENABLING, MotorPhase.ENABLED, MotorPhase.DISABLING)


class Dumps:
    """Asks for dumps; call `step` once per tick."""

    NOT_CARRIED = (
        "_apart_s",
        "_bus_was_up",
        "_causes",
        "_controller",
        "_due_s",
        "_dumped_s",
        "_dumps_s",
        "_has_worked",
        "_is_busy",
        "_is_powered",
        "_noted_s",
        "_phase",
        "_seen_s",
    )

    def __init__(self, controller: Controller) -> None:
        self._controller = controller
        self._is_busy = False
        self._causes: list[Cause] = []
        self._due_s = 0.0
        self._dumped_s = float("-inf")
        self._phase = MotorPhase.UNKNOWN
        self._has_worked = False
        self._is_powered = False
        self._bus_was_up = True
        self._seen_s: dict[Cause, float] = {}
        self._noted_s: dict[Cause, float] = {}  # when a cause has come last
        self._dumps_s: dict[Cause, float] = {}  # and was dumped last
        self._apart_s: dict[Cause, float] = {}  # and how long after that it may be again

    def ask(self, cause: Cause, note: str, then: Callable[[TaskResult], None]) -> Refusal | None:
        """Ask for a dump, or return a refusal; `then` gets the result."""
        if self._is_busy:
            text = "a dump of the recorder is being written already: ask again when it is done"
            return Refusal("too_many_requests", text, {"limit": 1})
        self._is_busy = True

        def done(result: TaskResult) -> None:
            self._is_busy = False
            self._controller.events.append(_dumped(cause, result))
            then(result)

        parameters = {"cause": cause, "note": note}
        self._controller.tasks.append(HelperTask("recorder.dump", parameters, done))
        return None

    def step(self, now_s: float, *, failed: bool, bus_is_up: bool) -> None:
        """Look for a cause; `failed` is True if a defect broke this tick off."""
        before, phase = self._phase, self._controller.motor.phase
        if phase is not before:
            self._phase = phase
            self._note_phase(before, phase, now_s, bus_is_up=bus_is_up)
        if bus_is_up is not self._bus_was_up:
            self._bus_was_up = bus_is_up
            if not bus_is_up and self._is_powered:
                self._note("bus_lost", now_s)
        other = self._controller.second_master
        if other.is_active and not other.is_tolerated:
            self._note_once("second_master", now_s)
        if failed:
            self._note_once("tick_error", now_s)
        if self._causes and now_s >= self._due_s and not self._is_busy:
            self._dump(now_s)

    def finish(self, now_s: float) -> None:
        """Before the daemon ends, ask for the dump that is still due."""
        if self._causes and not self._is_busy:
            self._dump(now_s)

    def _note_phase(
        self, before: MotorPhase, phase: MotorPhase, now_s: float, *, bus_is_up: bool
    ) -> None:
        """Note the cause that a change of the motor's phase shows, if any."""
        has_jumped, was_powered = self._controller.motor.has_jumped, self._is_powered
        if phase in _POWERED:
            self._is_powered = True
        elif phase in (MotorPhase.DISABLED, MotorPhase.FAULT):
            self._is_powered = False
            self._seen_s.pop("motor_silent", None)  # the next one needs a client that enables it
        if phase is MotorPhase.FAULT and self._has_worked and was_powered:
            self._has_worked = False
            self._note("motor_fault", now_s)
        elif phase in (MotorPhase.ENABLED, MotorPhase.DISABLED):
            self._has_worked = True
        elif phase is MotorPhase.SILENT and self._is_powered and bus_is_up:
            self._note_once("motor_silent", now_s)
        elif phase is MotorPhase.UNKNOWN and before is MotorPhase.ENABLED:
            self._note("motor_reset", now_s)
        elif (before, phase) == (MotorPhase.ENABLED, MotorPhase.DISABLING) and has_jumped:
            self._note("implausible", now_s)

    def _note_once(self, cause: Cause, now_s: float) -> None:
        """Note a cause that lasts, or repeats, only when it begins: one dump shows it."""
        if now_s - self._seen_s.get(cause, float("-inf")) > APART_S:
            self._note(cause, now_s)
        self._seen_s[cause] = now_s

    def _note(self, cause: Cause, now_s: float) -> None:
        if now_s - self._noted_s.get(cause, float("-inf")) > APART_AT_MOST_S:
            self._apart_s.pop(cause, None)
        self._noted_s[cause] = now_s
        if now_s - self._dumps_s.get(cause, float("-inf")) < self._apart_s.get(cause, 0.0):
            return  # a dump has shown it, and the events tell of this one
        if not self._causes:
            self._due_s = max(now_s + AFTER_S, self._dumped_s + APART_S)
        if len(self._causes) < _MOST_CAUSES:
            self._causes.append(cause)

    def _dump(self, now_s: float) -> None:
        causes, self._causes, self._dumped_s = self._causes, [], now_s
        for cause in _FLAPPING.intersection(causes):
            apart_s = self._apart_s.get(cause)
            doubled_s = 0.0 if apart_s is None else 2.0 * max(apart_s, APART_S)
            self._apart_s[cause] = min(doubled_s, APART_AT_MOST_S)
            self._dumps_s[cause] = now_s
        self.ask(causes[0], ", then ".join(causes), lambda _result: None)


def _dumped(cause: Cause, result: TaskResult) -> Event:
    """Return an event that says where the dump is, or why there is none."""
    if isinstance(result.value, dict):
        value = result.value
        text = f"the last {value['seconds']:.0f} s are recorded in {value['path']} ({cause})"
        return Event("recorder", text, {"cause": cause, "path": value["path"]})
    text = f"the last minute could NOT be recorded ({cause}): {result.error}"
    return Event("recorder", text, {"cause": cause, "error": result.error})


class RecorderMethods:
    """The recorder's methods."""

    NOT_CARRIED = ("_dumps",)

    def __init__(self, dumps: Dumps) -> None:
        self._dumps = dumps

    @Method(
        "recorder.dump",
        "Write the last minute, tick by tick, and its events to a file of the daemon's machine, in"
        " the format MCAP.",
        "path, ticks, seconds, bytes.",
        Dumped,
        (Param("note", "string", "Kept in the file: why it was asked for."),),
        role="operator",
        waits=True,
    )
    def _dump(self, call: Call) -> Answer:
        deferred = Deferred()

        def done(result: TaskResult) -> None:
            if isinstance(result.value, dict):
                deferred.resolve(result.value)
            else:
                text = f"the recorder could not be written: {result.error}"
                deferred.resolve(Refusal(result.reason or "not_saved", text))

        return self._dumps.ask("demand", call.params.get("note", ""), done) or deferred
