"""The fault matrix and its page: `python -m tests.faults.matrix` writes docs/generated/faults.md.

Every fault of `rows` in every situation of `cell`, and every method under a stop of `stopped`. The
page says what the runs have shown.
"""

from collections.abc import Callable
from itertools import groupby
from pathlib import Path

from litegripd.rpc.method import Method
from tests.faults.cell import run_cell
from tests.faults.rows import FAULTS, Fault
from tests.faults.situations import SITUATIONS, Situation
from tests.faults.stopped import CALLED, RELEASING, RESTS, run_stopped

PAGE = Path(__file__).resolve().parents[2] / "docs" / "generated" / "faults.md"
HEAD = """# Faults

<!-- Made by python -m tests.faults.matrix from runs of the daemon; not to be edited. -->

What the gripper does when something fails, found by letting it fail. Each row is a run of the whole
daemon, from the requests of a client to the frames on a simulated CAN bus and the motor's firmware
at its other end, in virtual time. `tests/faults/test_matrix.py` runs each row anew and compares it
with this page.

- **bus** and **mode** are what `state.get` tells while the fault lasts and until all has settled,
  in the order of their first appearance. A bus without anything to tell is `up`.
- **motion** is how the running motion ended: the reason of its error, or its outcome. A recording
  that is *broken off* is refused as a whole, and given as far as it goes to who asks for that.
- **next motion** is the reason with which a motion is refused at the fault's end, before it is
  taken away; `accepted` where none is.
- **jaws** is how far the jaws went at most from where they were at the fault's beginning until all
  had settled, measured at the simulated jaws, and what is left of the grip's force. A disabled
  motor brakes; an object then pushes the jaws back a little.
- **recovery** is what a client did until `motion.open` succeeded, and how long after the end of the
  fault the daemon knew again how motor and bus are. *By itself* means that the motor is as it was,
  enabled or disabled, without any request; after anything else it stays disabled until a client
  enables it.

In every row, whatever the fault: nothing arms the motor but a client's `motor.enable`; enabling
moves the jaws by less than 0.5 mm; no command that is older than the motor's watchdog, 0.1 s, comes
to an enabled motor, however long a queue was; the jaws go no further beyond a calibrated stop than
a command may lead them, 2.8 mm; jaws that nobody has asked to move stand still to 0.05 mm when
disabled and 1 mm when held, unless the row itself says that somebody else commands them or that a
measurement lies.

An interface that cannot be opened at all is `adapter_gone` or `down` until it can be.

A wall clock that is set back or forward has no row, for in virtual time there is none: the daemon
goes by CLOCK_MONOTONIC, and only labels files by the time of day. In
`tests/faults/test_clock_jumps.py` the clock of a real daemon jumps at every reading.
"""
STOPPED = """## Under a latched stop

A stop (hold) is latched while the jaws hold a position, press on the closed stop, or hold an object
by 30 N. Then an observer, an operator and an admin call the method: with each of its parameters, at
both ends of its range, in each of its choices; a configuration with each field at both of its ends;
calibrations with gains from end to end, other limits, another mount, another scale, and for no
gripper. The table has the role that a method needs, what an admin is answered, and how far the jaws
moved (rad). The motor's torque changes by less than 0.02 N·m, too.

Left out is what lets go by design:

{left_out}
"""
COLUMNS = ("situation", "bus", "mode", "motion", "next motion", "jaws", "recovery")


def run_row(fault: Fault, situation: Situation) -> str:
    """Run one cell; return its row."""
    return run_cell(fault, situation).row()


def page(
    row: Callable[[Fault, Situation], str] = run_row,
    stopped_row: Callable[[Method], str] = run_stopped,
) -> str:
    """Make the page of these rows."""
    lines = [HEAD]
    for group, faults in groupby(FAULTS, lambda fault: fault.group):
        lines.append(f"## {group}\n")
        lines += [section(fault, row) for fault in faults]
    return "\n".join([*lines, stopped_section(stopped_row)])


def stopped_section(row: Callable[[Method], str]) -> str:
    """Make the section of all methods under a stop."""
    left_out = "\n".join(f"- `{name}`: {why}" for name, why in RELEASING.items())
    names = ("method", "role", "answer", *(rest.name for rest in RESTS))
    head = f"| {' | '.join(names)} |\n|{' --- |' * len(names)}"
    rows = "\n".join(row(method) for method in CALLED)
    return f"{STOPPED.format(left_out=left_out)}\n{head}\n{rows}\n"


def section(fault: Fault, row: Callable[[Fault, Situation], str]) -> str:
    """Make the section of one fault."""
    head = f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}"
    rows = "\n".join(row(fault, situation) for situation in SITUATIONS)
    return f"### {title(fault)}\n\nIt is looked at for {fault.lasts_s:g} s.\n\n{head}\n{rows}\n"


def title(fault: Fault) -> str:
    """Return the heading of a fault's section."""
    return fault.name[0].upper() + fault.name[1:]


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8")
