"""Following a leader: how far a follower trails, and how long a measurement takes to its command.

python -m bench.teleop [SECONDS per link, default 15]

First, in virtual time, a simulated follower behind a leader whose hand moves in sines, beside the
way that the vendor's SDK describes: 50 Hz at both ends. Then, in real time, two daemons on this
machine over each link, the leader's jaws moved by a simulated hand (`bench.teleop.handheld`): from
the tick in which the leader's feedback came to the tick in which the follower's command has it.
"""

import contextlib
import json
import math
import signal
import socket
import statistics
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.__main__ import call, enable, run_module, wait_for
from bench.jaws.rig import TRAVEL_MM
from bench.teleop.follow import SETTLE_S, WAYS, Motion, follow
from litegripd.model.gripper import Geometry

SWINGS = ((4.0, 45.0), (2.0, 45.0), (1.0, 45.0))
"""Seconds and millimetres of one to and fro."""
OBJECT_MM = 35.0
HAND = ("2.5", "20", "65")
HEADER = f"{'':<24}{'lag ms':>8}{'rms mm':>8}{'worst mm':>10}{'peak N·m':>10}"
_SAME_RAD = 1e-9


def swing(period_s: float, swing_mm: float) -> Motion:
    """Return a sine around the middle of the travel that begins gently."""

    def motion(at_s: float) -> float:
        moving_s = max(at_s - SETTLE_S, 0.0)
        share = min(moving_s / period_s, 1.0)
        return 0.5 + share * swing_mm / (2.0 * TRAVEL_MM) * math.sin(
            2.0 * math.pi * moving_s / period_s
        )

    return motion


def onto_an_object(at_s: float) -> float:
    """Close at 100 mm/s to 20 mm below what is in the way, and stay."""
    closed_mm = 100.0 * max(at_s - SETTLE_S, 0.0)
    return max(0.6 * TRAVEL_MM - closed_mm, OBJECT_MM - 20.0) / TRAVEL_MM


def simulated() -> None:
    for period_s, swing_mm in SWINGS:
        fastest = math.pi * swing_mm / period_s
        print(f"\na sine of {swing_mm:g} mm in {period_s:g} s, {fastest:.0f} mm/s at most")
        print(HEADER)
        for way in WAYS:
            row = follow(way, swing(period_s, swing_mm), 3.0 * period_s)
            figures = (
                f"{row.lag_ms:>8.1f}{row.rms_mm:>8.2f}{row.worst_mm:>10.2f}{row.peak_nm:>10.2f}"
            )
            print(f"{way.name:<24}{figures}", flush=True)
    print(f"\na leader that closes at 100 mm/s onto {OBJECT_MM:g} mm of 250 N·m/rad, 20 mm too far")
    print(f"{'':<24}{'peak N·m':>10}")
    for way in WAYS:
        row = follow(way, onto_an_object, 1.5, OBJECT_MM)
        print(f"{way.name:<24}{row.peak_nm:>10.2f}", flush=True)


@dataclass(frozen=True, slots=True)
class Delays:
    """From a measurement of the leader to the follower's command, in ms."""

    from_feedback: list[float]
    from_measurement: list[float]


def link_case(link: str, rate_hz: int, seconds: float) -> None:
    """Let two daemons teleoperate for a while, and say how long frames took."""
    with tempfile.TemporaryDirectory() as name, contextlib.ExitStack() as stack:
        folder = Path(name)
        paths = {end: folder / f"{end}.sock" for end in ("leads", "follows")}
        for end, path in paths.items():
            program = ["bench.teleop.handheld", *HAND] if end == "leads" else ["litegripd.app.main"]
            arguments = (*program[1:], f"bench-{end}", "--simulate", "--socket", path)
            process = run_module(program[0], *arguments)
            stack.callback(process.communicate)
            stack.callback(process.send_signal, signal.SIGTERM)
            wait_for(path)
            enable(path)
        port = free_port()
        udp = link == "udp"
        leads: dict[str, Any] = {"mode": "master", "rate_hz": rate_hz, "link": link, "port": port}
        follows: dict[str, Any] = {"mode": "slave", "link": link, "port": port}
        (leads if udp else follows)["host"] = "127.0.0.1"
        for end, params in (("follows", follows), ("leads", leads)):
            answer = call(paths[end], "teleop.start", detach=True, **params)
            if not answer.get("result", {}).get("active"):
                raise RuntimeError(f"teleoperation has not begun: {answer}")
        rows = watch(paths, seconds)
        geometry = geometry_of(paths["leads"])
        health = {end: call(path, "health")["result"]["control"] for end, path in paths.items()}
        lost = ", ".join(f"{end} {figures['lost_ticks']}" for end, figures in health.items())
        delays = matched(rows, geometry)
        told = []
        for title, values in (
            ("feedback to command", delays.from_feedback),
            ("measurement to command", delays.from_measurement),
        ):
            ordered = sorted(values)
            p99 = ordered[int(0.99 * (len(ordered) - 1))]
            told.append(f"{title} median {statistics.median(ordered):.2f} ms, p99 {p99:.2f} ms")
        count = len(delays.from_feedback)
        print(f"{link:<6}{rate_hz:>4} Hz: {'; '.join(told)}; {count} frames, lost ticks {lost}")


def free_port() -> int:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return int(probe.getsockname()[1])


def geometry_of(path: Path) -> Geometry:
    values = call(path, "calibration.get")["result"]
    return Geometry(values["closed_rad"], values["open_rad"], values["rad_to_mm"])


def watch(paths: dict[str, Path], seconds: float) -> dict[str, list[list[float]]]:
    """Take every state of both ends."""
    fields = ["monotonic_s", "feedback_s", "position_rad", "requested_rad"]
    params = {"hz": 200, "fields": fields, "batch": 40}
    asked = {"jsonrpc": "2.0", "id": 1, "method": "state.subscribe", "params": params}
    rows: dict[str, list[list[float]]] = {end: [] for end in paths}
    with contextlib.ExitStack() as stack:
        files = {}
        for end, path in paths.items():
            connected = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            connected.connect(str(path))
            connected.sendall(json.dumps(asked).encode() + b"\n")
            files[end] = stack.enter_context(connected.makefile("rb"))
        while len(rows["leads"]) < 200 * seconds:
            for end, file in files.items():
                message = json.loads(file.readline())
                if message.get("method") == "state.batch":
                    rows[end] += message["params"]["rows"]
    return rows


def matched(rows: dict[str, list[list[float]]], geometry: Geometry) -> Delays:
    """Find for each measurement of the leader the first command of the follower that has it.

    Both ends have the same calibration, so that a target that the lead's cap leaves alone is the
    leader's position, within its travel and but for rounding.
    """
    delays = Delays([], [])
    commands = [(at_s, wanted) for at_s, _, _, wanted in rows["follows"] if wanted is not None]
    first = 0
    last_rad = math.nan
    for at_s, measured_s, position_rad, _ in rows["leads"]:
        if position_rad == last_rad:
            continue  # nobody could tell it from the one before
        last_rad = position_rad
        target_rad = (
            geometry.closed_rad
            - geometry.close_sign * geometry.openness(position_rad) * geometry.travel_rad
        )
        while first < len(commands) and commands[first][0] < at_s:
            first += 1
        for when_s, wanted_rad in commands[first : first + 10]:
            if abs(wanted_rad - target_rad) < _SAME_RAD:
                delays.from_feedback.append((when_s - at_s) * 1e3)
                delays.from_measurement.append((when_s - measured_s) * 1e3)
                break
    return delays


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 15.0
    simulated()
    print(f"\ntwo daemons on this machine, {seconds:g} s a link")
    for link, rate_hz in (("zenoh", 200), ("zenoh", 50), ("udp", 200)):
        link_case(link, rate_hz, seconds)


if __name__ == "__main__":
    main()
