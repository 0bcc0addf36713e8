"""One capture of the jaws' motion: a sample for each due time, by the times of the measurements.

It only watches. A measurement is taken once and never as if it were newer than it is; when none
comes for `LONGEST_GAP_S`, or what it is measured in changes, the capture has failed and says so.
"""

import math
from dataclasses import dataclass, field
from typing import Any

from litegripd.control.grip import Grip
from litegripd.control.grip_notes import GripNotes
from litegripd.control.jobs import JobBook
from litegripd.model.geometry import Geometry
from litegripd.model.jobs import Job
from litegripd.model.motor import Feedback, MotorPhase, MotorView
from litegripd.model.path import PIECE_BYTES
from litegripd.model.trajectory import SAMPLE

LONGEST_GAP_S = 0.1
"""Single measurements may be lost on the bus, and are counted as missed; a longer gap is a hole."""

_EARLY_PERIODS = 0.5
"""A measurement so early counts for its due time: it is the nearest one. Nothing hangs on it, for
each sample has the time at which it was measured."""

_ROUNDING_PERIODS = 0.1


@dataclass(slots=True)
class Capture:
    """Samples of a gripper with `geometry`, `rate_hz` a second, until `max_samples` were due.

    `job` is the one that makes the jaws slack meanwhile, None where others drive; `client` is whose
    capture it is, which it outlives where it is `detached`. `missed` counts the samples that were
    due, but not measured in time; `error` says why it was broken off, if so. Memory is taken by
    pieces of 32 kB, and given back when it `is_taken` to the helper process.
    """

    geometry: Geometry
    rate_hz: float
    max_samples: int
    period_s: float
    client: int
    began_s: float
    detached: bool = False
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

    @property
    def duration_s(self) -> float:
        """The time between the first and the last sample."""
        return 0.0 if self._first_s is None else self._sampled_s - self._first_s

    @property
    def loop_hz(self) -> float | None:
        """How many samples a second there have been in truth; None before the second one."""
        return None if self.duration_s <= 0.0 else (self.samples - 1) / self.duration_s

    @property
    def would_be_lost(self) -> bool:
        """Whether there is a good recording, finished or not, that is not kept anywhere else."""
        return self.error is None and not self.is_taken

    def finish(self) -> None:
        """End it as it should."""
        self.is_over = True

    def fail(self, why: str) -> None:
        """Break it off, unless it has ended already."""
        if not self.is_over:
            self.is_over, self.error = True, why

    def let_go(self) -> None:
        """Forget the samples: they are kept elsewhere now."""
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
        """Take this tick's measurement, where one is due, and note what the jaws hold."""
        if self.is_over:
            return
        job = self.job
        if job is not None and not job.is_running:
            self.fail("it ended" if job.error is None else job.error.message)
        elif motor.phase is not MotorPhase.ENABLED:
            self.fail(f"the motor is no longer enabled ({motor.phase.value})")
        elif geometry != self.geometry:
            self.fail("another calibration was taken")
        else:
            self._watch(now_s, motor.feedback, grip, jobs)

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
                self._append(t_s, feedback)
            if self.samples + self.missed >= self.max_samples:
                self.finish()
        self._measured_s = feedback.at_s

    def _append(self, t_s: float, feedback: Feedback) -> None:
        offset = self.samples * SAMPLE.size % PIECE_BYTES
        if offset == 0:
            self.pieces.append(bytearray(PIECE_BYTES))
        position_rad = feedback.position_rad
        SAMPLE.pack_into(
            self.pieces[-1],
            offset,
            t_s,
            self.geometry.openness(position_rad),
            position_rad,
            feedback.velocity_rad_s,
            feedback.torque_nm,
        )
        self.samples += 1
        self._sampled_s = feedback.at_s

    @property
    def size(self) -> int:
        """The samples' bytes."""
        return self.samples * SAMPLE.size

    def piece(self, number: int) -> memoryview:
        """Return a piece of the samples, as far as there are any."""
        left = self.size - number * PIECE_BYTES
        return memoryview(self.pieces[number])[:left]

    def grips(self) -> list[dict[str, float | str]]:
        """Return what the jaws held meanwhile, ready for JSON."""
        return self.notes.plain(self.geometry, self.duration_s)

    def header(self, can_id: int) -> dict[str, Any]:
        """Return what the file's header says, but for what only the end brings."""
        geometry = self.geometry
        return {
            "sample_hz": self.rate_hz,
            "closed_rad": geometry.closed_rad,
            "open_rad": geometry.open_rad,
            "rad_to_mm": geometry.rad_to_mm,
            "can_id": can_id,
            "mount": geometry.mount,
        }
