"""Following over a bad network in virtual time: ours beside the way of the vendor's SDK.

python -m bench.teleop.lossy

The same leader (a hand that swings by 45 mm in 2.5 s, 57 mm/s at most), the same losses and delays
for both, drawn by a seed; the figures are the same on every machine. `bench.teleop.network` does
the like with processes, sockets and real time.
"""

import heapq
import math
import random
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

from bench.jaws.rig import PERIOD_S, TRAVEL_MM, Rig
from bench.teleop.__main__ import swing
from bench.teleop.follow import (
    ON_ITS_WAY_S,
    SETTLE_S,
    WAYS,
    Motion,
    ScriptedLeader,
    Way,
    action_of,
    judge,
)
from litegripd.model.teleop import Arrival, TeleopFrame, encode_frame

SWING = swing(2.5, 45.0)
RUN_S = 30.0
BACK_MM = 4.5
JITTER_S = 0.1
CUT_S = (10.625, 21.875)
"""Half a swing more than whole ones, from one end of it to the other: 45 mm to make up for."""


@dataclass(frozen=True, slots=True)
class Network:
    """What happens to frames; `cut_s` from when to when none comes, in seconds of the run."""

    name: str
    loss: float = 0.0
    jitter_s: float = 0.0
    cut_s: tuple[float, float] = (math.inf, math.inf)


NETWORKS = (
    Network("clean"),
    Network("30 % lost", loss=0.3),
    Network("up to 100 ms late, reordered", jitter_s=JITTER_S),
    Network("both", loss=0.3, jitter_s=JITTER_S),
)
TITLES = ("lag ms", "rms mm", "worst mm", "step mm", "lead mm", "peak N·m")
AFTER_TITLES = ("drift mm", "back ms", "step mm", "lead mm", "fastest mm/s", "peak N·m")


class LossyLeader(ScriptedLeader):
    """A scripted leader behind a bad network."""

    def __init__(self, motion: Motion, began_s: float, every_s: float, network: Network) -> None:
        super().__init__(motion, began_s, every_s)
        self._network = network
        self._random = random.Random(7)
        self._waiting: list[tuple[float, int, bytes]] = []

    def receive(self, now_s: float) -> Sequence[Arrival]:
        """Return what has come by now, in the order of its coming."""
        network = self._network
        while (left_s := self._began_s + self._sent * self._every_s) <= now_s:
            self._sent += 1
            is_lost, late = self._random.random() < network.loss, self._random.random()
            run_s = left_s - self._began_s - SETTLE_S
            if is_lost or network.cut_s[0] <= run_s < network.cut_s[1]:
                continue
            measured_s = left_s - PERIOD_S
            openness = self._motion(measured_s - self._began_s)
            frame = encode_frame(TeleopFrame(openness, 0.0, 0.0, measured_s))
            due_s = left_s + ON_ITS_WAY_S + late * network.jitter_s
            heapq.heappush(self._waiting, (due_s, self._sent, frame))
        arrived = []
        while self._waiting and self._waiting[0][0] <= now_s:
            due_s, _, frame = heapq.heappop(self._waiting)
            arrived.append(Arrival(frame, due_s))
        return arrived


@dataclass(frozen=True, slots=True)
class Moment:
    """One tick: seconds of the run, jaws and command (mm), the motor's largest torque in it."""

    at_s: float
    jaws_mm: float
    wanted_mm: float
    torque_nm: float


def follow(way: Way, network: Network, duration_s: float) -> list[Moment]:
    """Follow in virtual time; the first swing is not looked at."""
    rig = Rig("normal", SWING(0.0) * TRAVEL_MM)
    rig.looks = 4
    rig.run(0.5)
    began_s = rig.now_s + 1.0
    link = LossyLeader(SWING, began_s, way.leader_every_s, network)
    rig.begin(action_of(way, rig.geometry, link))
    rig.run(began_s + SETTLE_S - rig.now_s)
    moments = []
    for _ in range(round(duration_s / PERIOD_S)):
        rig.peak_nm = 0.0
        rig.tick()
        wanted = rig.controller.output.requested
        if wanted is not None:
            at_s, wanted_mm = rig.now_s - began_s, rig.geometry.opening_mm(wanted.position_rad)
            moments.append(Moment(at_s, rig.gripper.opening_mm, wanted_mm, rig.peak_nm))
    return moments


def worst(moments: Sequence[Moment]) -> tuple[str, str]:
    step_mm = max(abs(b.wanted_mm - a.wanted_mm) for a, b in pairwise(moments))
    lead_mm = max(abs(moment.wanted_mm - moment.jaws_mm) for moment in moments)
    return f"{step_mm:.2f}", f"{lead_mm:.2f}"


def tracking(way: Way, network: Network, travel_mm: float) -> str:
    """Return a row of the first table: how closely the jaws follow over a bad network."""
    moments = [m for m in follow(way, network, RUN_S) if m.at_s > SETTLE_S + 3.0]
    row = judge(SWING, travel_mm, [(m.at_s, m.jaws_mm) for m in moments], 0.0)
    peak_nm = max(moment.torque_nm for moment in moments)
    figures = (f"{row.lag_ms:.1f}", f"{row.rms_mm:.2f}", f"{row.worst_mm:.2f}")
    return line(network.name, way.name, *figures, *worst(moments), f"{peak_nm:.2f}")


def after_cut(way: Way, travel_mm: float) -> str:
    """Return a row of the second: how the jaws stood while the cable was cut, and came back."""
    network = Network("", cut_s=CUT_S)
    moments = follow(way, network, CUT_S[1] + 5.0)
    cut_s, mended_s = (SETTLE_S + at_s for at_s in CUT_S)
    held = [m.jaws_mm for m in moments if cut_s + 0.5 <= m.at_s < mended_s]
    later = [m for m in moments if m.at_s >= mended_s]
    far = [m.at_s for m in later if abs(SWING(m.at_s) * travel_mm - m.jaws_mm) >= BACK_MM]
    back_s = (far[-1] if far else mended_s) - mended_s
    fastest = max(abs(b.jaws_mm - a.jaws_mm) / PERIOD_S for a, b in pairwise(later))
    peak_nm = max(moment.torque_nm for moment in later)
    drift_mm = max(held) - min(held)
    figures = (f"{drift_mm:.2f}", f"{back_s * 1e3:.0f}", *worst(later), f"{fastest:.0f}")
    return line(way.name, *figures, f"{peak_nm:.2f}")


def line(*cells: str) -> str:
    """Return a row of a table, as docs/generated/teleoperation-figures.md has it."""
    return f"| {' | '.join(cells)} |"


def main() -> None:
    travel_mm = Rig("normal", 60.0).geometry.travel_mm
    ways = [way for way in WAYS if way.dq_max_rad_s > 0.0]
    print(line("network", "follower", *TITLES))
    print(line(*["---"] * 8))
    for network in NETWORKS:
        for way in ways:
            print(tracking(way, network, travel_mm), flush=True)
    print(f"\na cable cut for {CUT_S[1] - CUT_S[0]:g} s, and the 5 s after that\n")
    print(line("follower", *AFTER_TITLES))
    print(line(*["---"] * 7))
    for way in ways:
        print(after_cut(way, travel_mm), flush=True)


if __name__ == "__main__":
    main()
