"""What jaws do when something between an operator and a gripper of another machine fails.

python -m bench.fleet.faults [RUNS of each fault, default 5]

Operator, router and robot are machines of their own, as network namespaces with an emulated cable
each (`tests/process/fleet/cable.py`); this needs root. The operator's program has the lease
with `on_lost` relax, `ttl_s` is 1 s, and the jaws move when the fault begins. The cable that is
bad is the operator's, in both directions. `on_lost`: from the fault's beginning until the jaws are
slack (median, worst). Over a bad network, which ends no session as such, the program is killed at
last, and that is from then on. `moved`: whether a motion began or the jaws moved, at 200 Hz, in
the 2 s after the fault's end. `asked/run/twice`: motions that were asked for before and
during the fault, those that the daemon began, and those that it began twice. A stop is sent as by
`litegripctl stop`, in runs of their own, 0.1 s after the fault's beginning: how many were in force,
and how soon; how many were reported as not confirmed, and how soon.
"""

import contextlib
import json
import os
import signal
import statistics
import subprocess
import sys
import tempfile
import threading
import time
from collections import Counter
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from litegrip_client.core.stop import FAR_STOP_WITHIN_S, stop_at
from litegrip_client.values.errors import LiteGripError
from tests.process.daemon_process import DaemonProcess
from tests.process.fleet.cable import Fault as BadCable
from tests.process.fleet.fleet_process import make_certificates
from tests.process.fleet.lab import CERTIFICATES, Lab, lab
from tests.process.fleet.machines import missing

AFTER_S = 2.0
STILL_MM = 0.2
WITHIN_S = 30.0
TICKS_S = 0.02
"""An event has the time of its tick: that may be a little before, or after, what it is due to."""

MOTIONS = 12
TRIES = 5
MOTION_KINDS = ("open", "close", "move")
HEADER = (
    "fault",
    "jaws",
    "`on_lost` in force after",
    "moved later",
    "motions asked / run / twice",
    "stop in force after",
    "reported as not confirmed after",
)


class EndedError(Exception):
    """The operator's program has ended by itself: its session was lost."""


class Operator:
    """The operator's program, as a process on his machine."""

    def __init__(self, place: Lab) -> None:
        module = ("-m", "bench.fleet.operator")
        self.process = subprocess.Popen(
            [*place.machines.on("op1"), sys.executable, *module, str(place.socket_path())],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            text=True,
        )

    def does(self, words: str) -> dict[str, Any]:
        """Let it do something, and return what it answers."""
        if self.process.stdin is None or self.process.stdout is None:
            raise RuntimeError("it has no pipes")
        self.process.stdin.write(words + "\n")
        self.process.stdin.flush()
        line = self.process.stdout.readline()
        if not line:
            raise EndedError
        answer: dict[str, Any] = json.loads(line)
        return answer

    def end(self) -> None:
        self.process.kill()
        self.process.communicate()


class Robot:
    """What the daemon says on its own machine: events, and the state at 200 Hz."""

    def __init__(self, running: DaemonProcess) -> None:
        self.client = running.connect()
        self.client.result("events.subscribe")
        self.client.result("state.subscribe", hz=200, fields=["mode", "opening_mm"])
        self.events: list[tuple[float, str, dict[str, Any]]] = []
        self.samples: list[tuple[float, str, float]] = []
        self._thread = threading.Thread(target=self._read)
        self._thread.start()

    def _read(self) -> None:
        while message := self.client.read():
            params = message.get("params", {})
            if message.get("method") == "event":
                self.events.append((params["monotonic_s"], params["kind"], params["data"]))
            elif message.get("method") == "state.sample":
                state = params["state"]
                self.samples.append((params["monotonic_s"], state["mode"], state["opening_mm"]))

    def close(self) -> None:
        """End; raises nothing, and nothing is read any more."""
        self.client.socket.shutdown(2)
        self._thread.join()
        self.client.close()

    def until(self, condition: Callable[[], object]) -> bool:
        """Wait for what is read; return False if it does not come."""
        ends_s = time.monotonic() + WITHIN_S
        while not condition():
            if time.monotonic() > ends_s:
                return False
            time.sleep(0.005)
        return True

    def first(self, mode: str, since_s: float) -> float | None:
        """Return when the jaws were first in a mode."""
        return next((at for at, found, _ in self.samples if at >= since_s and found == mode), None)

    def begun(self, from_s: float, to_s: float, kinds: Collection[str] = MOTION_KINDS) -> int:
        """Return how many motions began; to go slack, as when a lease is lost, is none."""
        return sum(
            kind == "job_started" and data["kind"] in kinds and from_s <= at_s < to_s
            for at_s, kind, data in self.events
        )

    def last_begun(self, kind: str) -> float | None:
        """Return when the last motion of a kind began."""
        return max((at for at, _, data in self.events if data.get("kind") == kind), default=None)

    def stopped(self, since_s: float) -> float | None:
        """Return when a stop came into force."""
        return next((at for at, kind, _ in self.events if kind == "stop" and at >= since_s), None)

    def modes(self, from_s: float, to_s: float) -> str:
        """Return in which modes the jaws were."""
        found: list[str] = []
        for at_s, mode, _mm in self.samples:
            if from_s <= at_s < to_s and mode not in found[-1:]:
                found.append(mode)
        return ", ".join(found)

    def moved(self, from_s: float, to_s: float) -> bool:
        """Return True if anything moved, or a motion began."""
        openings = [mm for at_s, _mode, mm in self.samples if from_s <= at_s < to_s]
        return max(openings) - min(openings) > STILL_MM or self.begun(from_s, to_s) > 0


@dataclass(frozen=True, slots=True)
class Trouble:
    """A fault: how it begins, and how it ends after `lasts_s`. A bad network is worked over."""

    name: str
    begin: Callable[[Lab, Operator], object]
    end: Callable[[Lab, Operator], object]
    lasts_s: float = 3.0
    is_bad_network: bool = False


def killed(part: str) -> Trouble:
    return Trouble(
        f"{PARTS[part]} killed",
        lambda place, _operator: place.fleet.parts[part].kill(),
        lambda place, _operator: place.fleet.parts[part].restart(),
    )


def frozen(part: str) -> Trouble:
    return Trouble(
        f"{PARTS[part]} frozen",
        lambda place, _operator: place.fleet.parts[part].freeze(),
        lambda place, _operator: place.fleet.parts[part].thaw(),
    )


def bad(name: str, fault: BadCable, lasts_s: float = 0.0) -> Trouble:
    return Trouble(
        name,
        lambda place, _operator: place.machines.fault("op1", fault),
        lambda place, _operator: place.machines.fault("op1"),
        lasts_s,
        is_bad_network=not fault.cut,
    )


def nothing(_place: Lab, _operator: Operator) -> None:
    """End nothing: it has ended."""


PARTS = {"op1": "portal", "robot1": "gateway", "router": "router"}
TROUBLES = (
    *(killed(part) for part in PARTS),
    *(frozen(part) for part in PARTS),
    Trouble("program killed", lambda _place, operator: operator.process.kill(), nothing),
    Trouble(
        "program frozen",
        lambda _place, operator: operator.process.send_signal(signal.SIGSTOP),
        lambda _place, operator: operator.process.send_signal(signal.SIGCONT),
    ),
    bad("cut of 10 s", BadCable(cut=True), 10.0),
    bad("30 % loss", BadCable(loss=0.3)),
    bad("100 ms of delay", BadCable(delay_s=0.1)),
    bad("0 to 50 ms, reordered", BadCable(jitter_s=0.05)),
    bad("the last three at once", BadCable(delay_s=0.1, jitter_s=0.05, loss=0.3)),
)


@dataclass(slots=True)
class Found:
    """What was measured of a fault, in all runs."""

    jaws: set[str] = field(default_factory=set)
    lost_s: list[float] = field(default_factory=list)
    never_lost: int = 0
    moved: int = 0
    asked: int = 0
    run: int = 0
    twice: int = 0
    words: Counter[str] = field(default_factory=Counter)
    answers_s: list[float] = field(default_factory=list)
    back_s: list[float] = field(default_factory=list)
    stopped_s: list[float] = field(default_factory=list)
    unconfirmed_s: list[float] = field(default_factory=list)
    wrongly_confirmed: int = 0


@contextlib.contextmanager
def at_work(place: Lab) -> Iterator[tuple[Operator, Robot]]:
    """Let the operator's program move the jaws, and watch them."""
    robot = Robot(place.grippers["left"])
    operator = moving(place)
    try:
        yield operator, robot
    finally:
        operator.end()
        robot.close()


def moving(place: Lab) -> Operator:
    """Start the operator's program, and let it move; again where it loses its session so soon."""
    for _ in range(TRIES):
        reachable(place)
        local(place, "stop.clear")
        operator = Operator(place)
        try:
            operator.does("move")
        except EndedError:
            operator.end()
            print("(a session ended before a fault began, or a stop came late)", flush=True)
        else:
            return operator
    raise RuntimeError("no session lives long enough")


def local(place: Lab, method: str) -> dict[str, Any]:
    with place.grippers["left"].connect() as client:
        return client.result(method)


def reachable(place: Lab) -> None:
    """Wait until the operator's machine reaches the gripper."""
    ends_s = time.monotonic() + WITHIN_S
    while time.monotonic() < ends_s:
        with contextlib.suppress(OSError), place.client() as client:
            client.send("hello")
            if "result" in client.read():
                return
        time.sleep(0.05)
    raise RuntimeError("the gripper cannot be reached again")


def look_at_jaws(place: Lab, trouble: Trouble, found: Found) -> None:
    """Let a fault begin while the jaws move, and end; note what they did."""
    with at_work(place) as (operator, robot):
        robot.until(lambda: robot.last_begun("open"))
        asked, from_s = 1, robot.last_begun("open") or 0.0
        began_s = time.monotonic()
        trouble.begin(place, operator)
        if trouble.is_bad_network:
            work(operator, robot, found)
            began_s = time.monotonic()
            operator.process.kill()
            asked = 0
        elif not trouble.name.startswith("program"):
            asked += operator.does("ask")["asked"]
        was_lost_before = robot.modes(began_s - TICKS_S, began_s) == "relaxed"
        robot.until(lambda: robot.first("relaxed", began_s))
        lost_s = robot.first("relaxed", began_s)
        if lost_s is None:
            found.never_lost += 1
        elif not was_lost_before:
            found.lost_s.append(lost_s - began_s)
        time.sleep(max(0.0, began_s + trouble.lasts_s - time.monotonic()))
        ended_s = time.monotonic()
        trouble.end(place, operator)
        reachable(place)
        time.sleep(AFTER_S)
        robot.until(lambda: robot.samples[-1][0] > ended_s + AFTER_S)
        found.jaws.add(robot.modes(began_s, ended_s))
        found.moved += robot.moved(ended_s, time.monotonic())
        if asked:
            run = robot.begun(from_s, time.monotonic())
            found.asked, found.run = found.asked + asked, found.run + run
            found.twice += max(0, run - asked)


def work(operator: Operator, robot: Robot, found: Found) -> None:
    """Let the program work over a bad network; note what came of each motion."""
    answer = operator.does(f"work {MOTIONS}")
    done = answer["done"]
    found.back_s += answer["back_s"]
    ends = [at_s for at_s, *_ in done[1:]] + [time.monotonic()]
    for (at_s, after_s, word), ends_s in zip(done, ends, strict=True):
        run = robot.begun(at_s - TICKS_S, ends_s - TICKS_S, ["move"])
        found.asked, found.run, found.twice = (
            found.asked + 1,
            found.run + run,
            found.twice + (run > 1),
        )
        if word == "ok":
            found.answers_s.append(after_s)
        found.words[word] += 1


def look_at_stop(place: Lab, trouble: Trouble, found: Found) -> None:
    """Let a fault begin, and stop as `litegripctl stop` does; note what is in force, and said."""
    with at_work(place) as (operator, robot):
        trouble.begin(place, operator)
        time.sleep(0.1)
        sent_s = time.monotonic()
        try:
            stop_at(str(place.socket_path()), "hold", None, FAR_STOP_WITHIN_S)
            is_confirmed = True
        except (OSError, LiteGripError):
            is_confirmed = False
        told_s = time.monotonic()
        if is_confirmed:
            robot.until(lambda: robot.stopped(sent_s))
        stopped_s = robot.stopped(sent_s)
        if not is_confirmed:
            found.unconfirmed_s.append(told_s - sent_s)
        elif stopped_s is None or stopped_s > told_s + TICKS_S:
            found.wrongly_confirmed += 1
        if stopped_s is not None:
            found.stopped_s.append(stopped_s - sent_s)
        trouble.end(place, operator)


def seconds(values: Sequence[float], of: int) -> str:
    """Return how often, the median and the worst."""
    if not values:
        return "--"
    count = "" if len(values) == of else f"{len(values)} of {of}: "
    return f"{count}{statistics.median(values):.2f} / {max(values):.2f} s"


def row(trouble: Trouble, found: Found, runs: int) -> str:
    motions = f"{found.asked} / {found.run} / {found.twice}"
    if trouble.is_bad_network:
        motions += f"; answers: {', '.join(f'{n} {word}' for word, n in found.words.items())}"
        motions += f"; done after {seconds(found.answers_s, len(found.answers_s))}"
        motions += f"; in again after {seconds(found.back_s, len(found.back_s))}"
    lost = seconds(found.lost_s, runs) + (f", {found.never_lost} never" if found.never_lost else "")
    stop = seconds(found.stopped_s, runs)
    if found.wrongly_confirmed:
        stop += f", {found.wrongly_confirmed} CONFIRMED BEFORE"
    jaws, moved = "; ".join(sorted(found.jaws)), f"{found.moved} of {runs}"
    unconfirmed = seconds(found.unconfirmed_s, runs)
    cells = (trouble.name, jaws, lost, moved, motions, stop, unconfirmed)
    return f"| {' | '.join(cells)} |"


def main() -> None:
    runs = int(sys.argv[1]) if len(sys.argv) > 1 else 5
    wanted = sys.argv[2:]
    if (reason := missing()) is not None:
        sys.exit(f"there can be no machines here: {reason}")
    print(f"{runs} runs of each; median / worst; load {os.getloadavg()[0]:.1f}\n")
    print(f"| {' | '.join(HEADER)} |\n|{' --- |' * len(HEADER)}", flush=True)
    for trouble in TROUBLES:
        if wanted and not any(word in trouble.name for word in wanted):
            continue
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            certificates = make_certificates(folder / "tls", *CERTIFICATES)
            found = Found()
            with lab(folder, certificates, robots=["robot1"], operators=["op1"]) as place:
                for _ in range(runs):
                    look_at_jaws(place, trouble, found)
                    look_at_stop(place, trouble, found)
                reachable(place)
        print(row(trouble, found, runs), flush=True)


if __name__ == "__main__":
    main()
