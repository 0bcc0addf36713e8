"""Following over a bad network: ours beside the way that the vendor's SDK describes, in one run.

python -m bench.teleop.network [SECONDS per network, default 12]

A leader whose jaws a simulated hand moves (45 mm to and fro, 57 mm/s at most) sends its datagrams
to two followers, each behind a proxy of its own that loses, delays and reorders them, or cuts the
cable: the daemon, at 200 Hz, and `bench.teleop.vendor`, which gets every fourth datagram, 50 Hz.
All runs in real time on this machine, and all of it shares one clock.
"""

import bisect
import contextlib
import json
import math
import os
import signal
import socket
import sys
import tempfile
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

from bench.__main__ import run_module
from bench.jaws.rig import TRAVEL_MM
from litegripd.model.calibration import NOMINAL
from tests.process.teleop_pair import LossyProxy, Samples, free_port, gripper, until

CUT_S = 11.25
"""Half a swing of the hand more than whole ones: cut while the leader is open, mended while it is
closed."""
NEAR_MM = 3.0
BACK_MM = 4.5
"""Whoever is so near to the leader for `BACK_FOR_S` follows again: three times what is usual."""
BACK_FOR_S = 0.3
AFTER_CUT_S = 5.0
SETTLE_S = 1.5
SHIFTS_S = [0.0025 * number for number in range(120)]
QUICK = {"speed_mm_s": 130}
Row = tuple[float, float, float, float]
"""Time, jaws (mm), command (mm), torque (N·m)."""


@dataclass(frozen=True, slots=True)
class Network:
    """What the proxies do."""

    name: str
    loss: float = 0.0
    jitter_s: float = 0.0


NETWORKS = (
    Network("clean"),
    Network("30 % lost", loss=0.3),
    Network("up to 100 ms late, reordered", jitter_s=0.1),
    Network("both", loss=0.3, jitter_s=0.1),
)
HEADER = (
    f"{'network':<32}{'follower':<10}{'lag ms':>8}{'rms mm':>8}{'worst mm':>10}{'step mm':>9}"
    f"{'lead mm':>9}{'peak N·m':>10}"
)
AFTER_HEADER = (
    f"{'':<42}{'drift mm':>9}{'back ms':>9}{'step mm':>9}{'lead mm':>9}{'mm/s':>11}{'peak N·m':>10}"
)


class Course:
    """Where some jaws were by time."""

    def __init__(self, points: list[tuple[float, float]]) -> None:
        self._times = [at_s for at_s, _ in points]
        self._values = [value for _, value in points]

    def at(self, at_s: float) -> float:
        index = min(max(bisect.bisect_left(self._times, at_s), 1), len(self._times) - 1)
        (a_s, b_s), (a, b) = self._times[index - 1 : index + 1], self._values[index - 1 : index + 1]
        share = min(max((at_s - a_s) / (b_s - a_s), 0.0), 1.0) if b_s > a_s else 1.0
        return a + share * (b - a)


def figures(leader: Course, rows: list[Row], from_s: float, to_s: float) -> str:
    """Judge what a follower did in a while."""
    rows = [row for row in rows if from_s <= row[0] <= to_s]

    def rms_mm(shift_s: float) -> float:
        errors = [(leader.at(at_s - shift_s) - mm) ** 2 for at_s, mm, _, _ in rows]
        return math.sqrt(sum(errors) / len(errors))

    lag_s = min(SHIFTS_S, key=rms_mm)
    worst_mm = max(abs(leader.at(at_s) - mm) for at_s, mm, _, _ in rows)
    step_mm = max(abs(b[2] - a[2]) for a, b in pairwise(rows))
    lead_mm = max(abs(wanted_mm - mm) for _, mm, wanted_mm, _ in rows)
    peak_nm = max(abs(row[3]) for row in rows)
    return (
        f"{lag_s * 1e3:>8.0f}{rms_mm(0.0):>8.2f}{worst_mm:>10.1f}{step_mm:>9.2f}"
        f"{lead_mm:>9.1f}{peak_nm:>10.2f}"
    )


def after_cut(leader: Course, rows: list[Row], cut_s: float, mended_s: float) -> str:
    """Tell how jaws stood while the cable was cut, and how they came back."""
    held = [mm for at_s, mm, _, _ in rows if cut_s + 0.5 <= at_s <= mended_s]
    later = [row for row in rows if mended_s - 0.1 <= row[0] <= mended_s + AFTER_CUT_S]
    back_s = next(
        (
            at_s - mended_s
            for at_s, *_ in later
            if at_s >= mended_s
            and all(
                abs(leader.at(t_s) - mm) < BACK_MM
                for t_s, mm, _, _ in later
                if at_s <= t_s <= at_s + BACK_FOR_S
            )
        ),
        math.nan,
    )
    step_mm = max(abs(b[2] - a[2]) for a, b in pairwise(later))
    lead_mm = max(abs(wanted_mm - mm) for _, mm, wanted_mm, _ in later)
    fastest = max(abs(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(later) if b[0] > a[0])
    peak_nm = max(abs(row[3]) for row in later)
    return (
        f"{max(held) - min(held):>9.2f}{back_s * 1e3:>9.0f}{step_mm:>9.2f}{lead_mm:>9.1f}"
        f"{fastest:>11.0f}{peak_nm:>10.2f}"
    )


def daemons_rows(samples: Samples) -> list[Row]:
    geometry = NOMINAL[0]
    return [
        (row[4], row[3] * geometry.travel_mm, geometry.opening_mm(row[2]), row[5])
        for row in samples.rows
        if row[2] is not None
    ]


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 12.0
    ports = [free_port(socket.SOCK_DGRAM) for _ in range(2)]
    windows: list[tuple[float, float]] = []
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        vendor = run_module("bench.teleop.vendor", ports[1], folder / "vendor.json")
        stack.callback(vendor.wait)
        stack.callback(vendor.send_signal, signal.SIGTERM)
        following = stack.enter_context(gripper(folder / "f", f"net-f-{os.getpid()}"))
        leading = stack.enter_context(gripper(folder / "l", f"net-l-{os.getpid()}", by_hand=True))
        proxies = [
            stack.enter_context(LossyProxy(port, 0.0, 0.0, 7, every))
            for port, every in zip(ports, (1, 4), strict=True)
        ]
        follower, leader = (stack.enter_context(one.connect()) for one in (following, leading))
        follower.enabled().result(
            "teleop.start", mode="slave", link="udp", port=ports[0], config=QUICK
        )
        hosts = ",".join(f"127.0.0.1:{proxy.port}" for proxy in proxies)
        leader.enabled().result("teleop.start", mode="master", link="udp", host=hosts)
        until(follower, lambda status: bool(status["phase"] == "following"))
        samples = [stack.enter_context(Samples(one)) for one in (leading, following)]
        time.sleep(2.0)
        for network in NETWORKS:
            for proxy in proxies:
                proxy.loss, proxy.jitter_s = network.loss, network.jitter_s
            time.sleep(SETTLE_S)
            began_s = time.monotonic()
            time.sleep(seconds)
            windows.append((began_s, time.monotonic()))
        for proxy in proxies:
            proxy.loss = proxy.jitter_s = 0.0
        time.sleep(SETTLE_S)
        open_mm = max(row[3] for row in samples[0].rows) * TRAVEL_MM - NEAR_MM
        while leader.result("state.get")["opening_mm"] < open_mm:
            time.sleep(0.005)
        cut_s = time.monotonic()
        for proxy in proxies:
            proxy.is_cut = True
        time.sleep(CUT_S)
        for proxy in proxies:
            proxy.is_cut = False
        mended_s = time.monotonic()
        time.sleep(AFTER_CUT_S + 1.0)
        lost = [one.result("health")["control"]["lost_ticks"] for one in (leader, follower)]
        vendor.send_signal(signal.SIGTERM)
        vendor.wait()
        vendors_rows = [tuple(row) for row in json.loads((folder / "vendor.json").read_text())]
    course = Course([(row[4], row[3] * TRAVEL_MM) for row in samples[0].rows])
    ways = (("daemon", daemons_rows(samples[1])), ("SDK's way", vendors_rows))
    print(HEADER)
    for network, (from_s, to_s) in zip(NETWORKS, windows, strict=True):
        for way, rows in ways:
            print(f"{network.name:<32}{way:<10}{figures(course, rows, from_s, to_s)}", flush=True)
    print(f"\na cable cut for {CUT_S:g} s, and the 5 s after that")
    print(AFTER_HEADER)
    for way, rows in ways:
        print(f"{'':<32}{way:<10}{after_cut(course, rows, cut_s, mended_s)}", flush=True)
    print(f"lost ticks: leader {lost[0]}, follower {lost[1]}")


if __name__ == "__main__":
    main()
