"""How well replays follow, and what the longest trajectories cost the control thread.

python -m bench.jaws.trajectories

Following is measured in simulated time, the same on every machine: the true opening against the
path, one period after each command. Ticks are those of a daemon with the simulated gripper.
"""

import os
import statistics
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from typing import Any

from bench.jaws.rig import TRAVEL_MM
from litegripd.trajectories.replay import Replay
from tests.process.daemon_process import Client, daemon
from tests.trajectories import Point, sampled, swing, uploaded
from tests.world import World

SWINGS = ((0.3, 4.0), (0.3, 2.0), (0.3, 1.5), (0.4, 1.7), (0.4, 1.5))
"""Amplitude, as a share of the travel, and period in seconds; the last is nearly as fast as any
path may be."""
TORQUES_NM = (2.0, 3.0)

LONG = 600.0
WATCHED_S = 15.0
CONFIG = '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n'


def main() -> None:
    """Measure and print."""
    following()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder)
        config = path / "bench.toml"
        config.write_text(CONFIG, encoding="utf-8")
        name = f"bench-{os.getpid()}"
        with daemon(path, name, "--config", str(config)) as running, running.connect() as client:
            _ticks(client)


def following() -> None:
    """Print how well replays follow."""
    heads = (f"with {torque_nm:g} N·m: median, worst" for torque_nm in TORQUES_NM)
    print(f"| fastest mm/s | {' | '.join(heads)} |")
    print(f"| --- |{' --- |' * len(TORQUES_NM)}")
    for size, period_s in SWINGS:
        points = sampled(swing(0.5, size, period_s), 3.0 * period_s, hz=200)
        rates = [abs(b[1] - a[1]) / (b[0] - a[0]) for a, b in pairwise(points)]
        cells = (_follow(points, torque_nm) for torque_nm in TORQUES_NM)
        print(f"| {TRAVEL_MM * max(rates):.0f} | {' | '.join(cells)} |", flush=True)


def _follow(points: list[Point], torque_nm: float) -> str:
    world = World()
    client = world.enabled()
    name = uploaded(client, points)
    number = client.send("trajectory.play", name=name, torque_nm=torque_nm)
    geometry, errors = world.controller.geometry, []
    while not client.has_answer(number):
        action = world.controller.action
        on_path = isinstance(action, Replay) and action.phase == "play"
        wanted = action.openness if isinstance(action, Replay) else None
        world.tick()
        if on_path and wanted is not None and geometry is not None:
            true_mm = geometry.opening_mm(world.gripper.position_rad)
            errors.append(abs(true_mm / geometry.travel_mm - wanted))
    return f"{100.0 * statistics.median(errors):.2f}, {100.0 * max(errors):.2f}"


def _ticks(client: Client) -> None:
    """Upload, load, replay and record for long; print the ticks after each."""
    client.enabled()
    _tell("idle", client, time.monotonic())
    began_s = time.monotonic()
    name = uploaded(client, sampled(swing(0.5, 0.1), LONG, hz=200))
    _tell("10 minutes at 200 Hz uploaded", client, began_s)
    began_s = time.monotonic()
    job = client.result("trajectory.play", name=name, wait=False)["job"]
    while client.result("trajectory.status")["phase"] == "load":
        client.result("state.get")
    _tell("loaded", client, began_s)
    _watch(client, WATCHED_S)
    _tell("replayed", client, began_s)
    client.result("job.cancel", job=job)
    client.result("trajectory.record_start", rate_hz=200)
    began_s = time.monotonic()
    _watch(client, WATCHED_S)
    _tell("recorded", client, began_s)
    answer = client.result("trajectory.record_stop", allow_partial=True)
    print(f"{answer['samples']} samples, {answer['missed']} missed")


def _watch(client: Client, duration_s: float) -> None:
    ends_s = time.monotonic() + duration_s
    while time.monotonic() < ends_s:
        client.result("state.get")
        time.sleep(0.05)


def _tell(what: str, client: Client, began_s: float) -> None:
    took_s = time.monotonic() - began_s
    control: dict[str, Any] = client.result("health")["control"]
    late, cost = control["lateness"], control["tick_cost"]
    print(
        f"{what}, {took_s:.2f} s: {control['lost_ticks']} of {control['ticks']} ticks lost so far,"
        f" late p99 {late['p99_us']:.0f} µs, cost p50 {cost['p50_us']:.0f} µs"
        f" p99 {cost['p99_us']:.0f} µs, {control['resident_mb']} MB resident"
    )


if __name__ == "__main__":
    main()
