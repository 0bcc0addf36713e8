"""Notes where the jaws gripped, while a recording watches: contact, force, and who commanded it.

It claims what the daemon has commanded and judged by itself, which is a grip that is watched. While
a hand pushes slack jaws the motor applies no force, and measures none: of that nothing is noted.
"""

from collections.abc import Mapping
from dataclasses import dataclass

from litegripd.control.grip import Grip
from litegripd.control.jobs import JobBook
from litegripd.model.geometry import Geometry
from litegripd.model.grips import MAX_SOURCE, MOST_GRIPS
from litegripd.model.jobs import JobKind

_METHODS: Mapping[JobKind, str] = {
    "grasp": "motion.grasp",
    "set_force": "motion.set_force",
    "play": "trajectory.play",
}
"""What makes grips or changes them: whatever holds something comes from the latest of these."""


@dataclass(slots=True)
class _Note:
    """A grip that is being held; its times count from the begin of the recording."""

    grip: Grip
    force_n: float
    closing_s: float
    start_s: float
    end_s: float
    position_rad: float
    source: str


class GripNotes:
    """The grips of one recording; `left_out` counts those beyond `MOST_GRIPS`.

    A force that is changed makes another grip of it, which begins where the one before ends.
    """

    def __init__(self) -> None:
        self.left_out = 0
        self._notes: list[_Note] = []
        self._held: _Note | None = None

    def see(
        self, t_s: float, began_s: float, position_rad: float, grip: Grip | None, jobs: JobBook
    ) -> None:
        """Take what the jaws hold `t_s` after `began_s`, when the recording began."""
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
        """Return the grips of a recording of this length, with the names of `TaughtGrip`.

        They are judged where they are kept, by the helper process: for so many that takes too long
        for a tick.
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
    """Return a source as the file has it: a program may call itself anything."""
    return "".join(c if c.isascii() and c.isprintable() else "?" for c in source)[:MAX_SOURCE]
