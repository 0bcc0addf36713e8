"""Records a trajectory: a sample for each due time, and the grips on the way.

A capture only watches. It takes each measurement once, with the time of the measurement. If none
comes for `LONGEST_GAP_S`, or the calibration changes, the capture fails and reports it.

`GripNotes` notes where the jaws gripped: contact, force, and who commanded it. It notes only grips
that the daemon has commanded and watches. While a hand pushes slack jaws the motor applies no force
and measures none, so nothing is noted.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from litegrip_client.values.trajectory_format import MAX_SOURCE, MOST_GRIPS, SAMPLE
from litegripd.control.events import JobBook
from litegripd.control.holds import Grip, Slack
from litegripd.control.motions.base import PlainAction, Step, progress_of
from litegripd.model.gripper import Geometry
from litegripd.model.motor import Feedback, MotorPhase, MotorView
from litegripd.model.state import Job, JobKind, Progress, RecordOutcome, RecordResult
from litegripd.trajectories.values import PIECE_BYTES

_METHODS: Mapping[JobKind, str] = {
    "grasp": "motion.grasp",
    "set_force": "motion.set_force",
    "play": "trajectory.play",
}
"""The jobs that begin or change a grip: the latest of them is the source of what is held."""


@dataclass(slots=True)
class _Note:
    """A grip that is held now; its times count from the start of the recording."""

    grip: Grip
    force_n: float
    closing_s: float
    start_s: float
    end_s: float
    position_rad: float
    source: str


class GripNotes:
    """The grips of one recording; `left_out` counts those beyond the most that a file can hold.

    A change of force begins another grip where the one before ends.
    """

    def __init__(self) -> None:
        self.left_out = 0
        self._notes: list[_Note] = []
        self._held: _Note | None = None

    def see(
        self, t_s: float, began_s: float, position_rad: float, grip: Grip | None, jobs: JobBook
    ) -> None:
        """Note what the jaws hold at `t_s`, counted from `began_s`, the start of the recording."""
        before = self._held
        if before is not None:
            before.end_s = t_s
        if grip is None or not grip.is_holding or grip.force_n <= 0.0:
            self._held = None
        elif before is None or grip is not before.grip or grip.force_n != before.force_n:
            job = jobs.latest(*_METHODS)
            closing_s = t_s
            if before is None and job is not None and job.kind == "grasp":
                last_s = self._notes[-1].end_s if self._notes else 0.0
                closing_s = min(max(job.started_s - began_s, last_s), t_s)
            source = "unknown" if job is None else f"{_METHODS[job.kind]} by {job.owner.program}"
            note = _Note(grip, grip.force_n, closing_s, t_s, t_s, position_rad, _plain(source))
            self._held = note
            if len(self._notes) < MOST_GRIPS:
                self._notes.append(note)
            else:
                self.left_out += 1

    def plain(self, geometry: Geometry, duration_s: float) -> list[dict[str, float | str]]:
        """Return the grips of a recording of this length, by the names of `TaughtGrip`.

        The helper process checks them when it stores them: that takes too long for a tick.
        """
        return [
            {
                "closing_s": note.closing_s,
                "start_s": note.start_s,
                "end_s": min(note.end_s, duration_s),
                "openness": geometry.openness(note.position_rad),
                "width_mm": max(geometry.opening_mm(note.position_rad), 0.0),
                "force_n": note.force_n,
                "source": note.source,
            }
            for note in self._notes
            if note.start_s <= duration_s
        ]


def _plain(source: str) -> str:
    """Return a source in the file's form: a program may have any name."""
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in source)[:MAX_SOURCE]


LONGEST_GAP_S = 0.1
"""Single lost measurements are counted as missed; a longer gap is a failure."""

_EARLY_PERIODS = 0.5
"""A measurement this early counts for its due time: it is the nearest one. Each sample has the
time of its measurement, so this shifts nothing."""

_ROUNDING_PERIODS = 0.1
_ONLY_PERIODS = 2.5
"""How old an only sample may be: one period for the answer, one for the tick after it."""


@dataclass(slots=True)
class Capture:
    """Samples of a gripper with `geometry`, `rate_hz` per second, until `max_samples` were due.

    `basis` is the calibration in use when it began; `geometry` may be one that its client brought.
    `job` is the number of the job that makes the jaws slack, None if others drive. `client` is the
    client that began the capture; a `detached` capture outlives it. `missed` counts the samples
    that were due, but not measured in time. `error` says why it failed, or is None. Memory is
    allocated in pieces of 32 kB, and freed when it `is_taken` to the helper process.
    """

    geometry: Geometry
    rate_hz: float
    max_samples: int
    period_s: float
    client: int
    began_s: float
    detached: bool = False
    basis: Geometry | None = field(init=False)
    job: Job | None = None
    samples: int = 0
    missed: int = 0
    error: str | None = None
    is_over: bool = False
    is_taken: bool = False
    pieces: list[bytearray] = field(default_factory=list)
    notes: GripNotes = field(default_factory=GripNotes)
    _first_s: float | None = None
    _sampled_s: float = 0.0
    _measured_s: float = -math.inf

    def __post_init__(self) -> None:
        """Take it that the geometry is that of the calibration in use."""
        self.basis = self.geometry

    @property
    def duration_s(self) -> float:
        """The time between the first and the last sample."""
        return 0.0 if self._first_s is None else self._sampled_s - self._first_s

    @property
    def loop_hz(self) -> float | None:
        """The measured number of samples per second; None before the second sample."""
        return None if self.duration_s <= 0.0 else (self.samples - 1) / self.duration_s

    @property
    def would_be_lost(self) -> bool:
        """True if there is a good recording, finished or not, that is stored nowhere else."""
        return self.error is None and not self.is_taken

    def finish(self) -> None:
        """End the capture without an error."""
        self.is_over = True

    def fail(self, why: str) -> None:
        """End the capture with an error, unless it has ended already."""
        if not self.is_over:
            self.is_over, self.error = True, why

    def note_job(self) -> None:
        """Fail if the job has ended."""
        job = self.job
        if job is not None and not job.is_running:
            self.fail("it ended" if job.error is None else job.error.message)

    def let_go(self) -> None:
        """Free the samples: they are stored elsewhere now."""
        self.is_taken = True
        self.pieces.clear()

    def step(
        self,
        now_s: float,
        motor: MotorView,
        geometry: Geometry | None,
        grip: Grip | None,
        jobs: JobBook,
    ) -> None:
        """Take this tick's measurement if one is due, and note what the jaws hold."""
        self.note_job()
        if self.is_over:
            return
        if motor.phase is not MotorPhase.ENABLED:
            self.fail(f"the motor is no longer enabled ({motor.phase.value})")
        elif geometry != self.basis:
            self.fail("another calibration was taken")
        else:
            self._watch(now_s, motor.feedback, grip, jobs)

    def take_one(self, now_s: float, feedback: Feedback, grip: Grip | None, jobs: JobBook) -> None:
        """Take the newest measurement of a recording that has none yet, unless it is an old one."""
        if self.samples == 0 and now_s - feedback.at_s <= _ONLY_PERIODS * self.period_s:
            self._take(feedback, grip, jobs)

    def _watch(
        self, now_s: float, feedback: Feedback | None, grip: Grip | None, jobs: JobBook
    ) -> None:
        if feedback is not None and feedback.at_s > max(self._measured_s, self.began_s):
            self._take(feedback, grip, jobs)
        if now_s - max(self._measured_s, self.began_s) > LONGEST_GAP_S + self.period_s:
            self.fail(f"nothing was measured for more than {LONGEST_GAP_S:g} s")

    def _take(self, feedback: Feedback, grip: Grip | None, jobs: JobBook) -> None:
        if self._first_s is None:
            self._first_s = feedback.at_s
        t_s = feedback.at_s - self._first_s
        self.notes.see(t_s, self._first_s, feedback.position_rad, grip, jobs)
        due = self.samples + self.missed
        if t_s >= due / self.rate_hz - _EARLY_PERIODS * self.period_s:
            passed = math.floor(self.rate_hz * (t_s + _ROUNDING_PERIODS * self.period_s))
            self.missed += min(max(passed, due), self.max_samples) - due
            if passed < self.max_samples:
                offset = self.samples * SAMPLE.size % PIECE_BYTES
                if offset == 0:
                    self.pieces.append(bytearray(PIECE_BYTES))
                SAMPLE.pack_into(
                    self.pieces[-1],
                    offset,
                    t_s,
                    self.geometry.openness(feedback.position_rad),
                    feedback.position_rad,
                    feedback.velocity_rad_s,
                    feedback.torque_nm,
                )
                self.samples += 1
                self._sampled_s = feedback.at_s
            if self.samples + self.missed >= self.max_samples:
                self.finish()
        self._measured_s = feedback.at_s

    @property
    def size(self) -> int:
        """The number of bytes of all samples."""
        return self.samples * SAMPLE.size

    def piece(self, number: int) -> memoryview:
        """Return one piece of the samples, as far as it is filled."""
        left = self.size - number * PIECE_BYTES
        return memoryview(self.pieces[number])[:left]

    def grips(self) -> list[dict[str, float | str]]:
        """Return the grips, ready for JSON."""
        return self.notes.plain(self.geometry, self.duration_s)

    def header(self, can_id: int) -> dict[str, Any]:
        """Return the fields of the file's header that are known before the end."""
        geometry = self.geometry
        return {
            "sample_hz": self.rate_hz,
            "closed_rad": geometry.closed_rad,
            "open_rad": geometry.open_rad,
            "rad_to_mm": geometry.rad_to_mm,
            "can_id": can_id,
            "mount": geometry.mount,
        }


class Teach(PlainAction):
    """Keeps the jaws slack until the capture is over; then they hold where they are."""

    def __init__(self, capture: Capture) -> None:
        self._capture = capture
        self._feedback: Feedback | None = None

    def step(self, now_s: float, motor: MotorView) -> Step:
        """Return a slack command, or the outcome once the capture is over."""
        feedback = motor.feedback
        if self._capture.is_over:
            outcome: RecordOutcome = "full" if self._capture.error is None else "failed"
            return Step(outcome=result_of(self._capture, outcome))
        if feedback is None:
            return Step()
        self._feedback = feedback
        return Step(Slack().command(now_s, feedback))

    def progress(self) -> Progress | None:
        """Return the number of samples, and where the jaws are."""
        if self._feedback is None:
            return None
        capture, here_rad = self._capture, self._feedback.position_rad
        total = capture.max_samples
        return progress_of("record", capture.samples, total, here_rad, self._feedback)


def result_of(capture: Capture, outcome: RecordOutcome) -> RecordResult:
    """Return how a capture ended."""
    return RecordResult(
        ok=capture.error is None,
        outcome=outcome,
        samples=capture.samples,
        missed=capture.missed,
        message=capture.error,
    )
