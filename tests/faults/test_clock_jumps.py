"""A wall clock that is set back or forward while the daemon runs: nothing is decided by it.

No row of the matrix, whose world has no wall clock that could jump: control goes by CLOCK_MONOTONIC
alone, which the first tests prove. The wall clock only labels files and frames; what it labels is
tried with a clock that jumps, here and in `tests/io/test_recorder_files.py` (which dumps are kept).
"""

import ast
import itertools
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

import litegripd
from litegripd.model.motor import MotorPhase
from tests.control.teleop_scene import following, packed
from tests.faults.fault_world import FaultWorld
from tests.process.daemon_process import DEADLINE_S, daemon

PACKAGE = Path(litegripd.__file__).parent
PURE = ("model", "motor", "control", "rpc")
LABELS = {
    "recorder/files.py": "when a dump was made, in its name and in the file",
    "io/helper/files.py": "when a calibration was saved, as its file says, too",
    "trajectories/store.py": "when a trajectory was recorded; whether its file is still the same",
    "teleop/ends.py": "none of its own: who sent a sample, which is in zenoh's time stamp",
    "io/can/bus.py": "none: takes it away from python-can",
    "sim/mujoco_plant.py": "none: the time of a scene, which begins with it",
    "sim/interface.py": "the time stamps of simulated frames",
}
"""Who reads the wall clock, or what it left in the file system, and what for."""

WALL_CLOCK = {
    "time", "time_ns", "localtime", "gmtime", "ctime", "clock_gettime", "clock_gettime_ns",
    "CLOCK_REALTIME", "datetime", "date", "now", "utcnow", "today", "getmtime", "getctime",
    "st_mtime", "st_mtime_ns", "st_ctime", "st_ctime_ns", "timestamp",
}  # fmt: skip
HOUR_S = 3600.0
JUMPY = """
import itertools, time
true_ns, hours = time.time_ns, itertools.cycle((0, 1, -1, 0, -1))
time.time_ns = lambda: true_ns() + next(hours) * 3600 * 10**9
time.time = lambda: time.time_ns() / 1e9
"""
"""For `sitecustomize`, which every Python process of the daemon runs first."""


def names_of(path: Path) -> Iterator[str]:
    """Return the modules that a file imports, and the attributes that it reads or imports."""
    for node in ast.walk(ast.parse(path.read_text("utf-8"))):
        if isinstance(node, ast.Import):
            yield from (f"import {name.name}" for name in node.names)
        elif isinstance(node, ast.ImportFrom):
            yield f"import {node.module}"
            yield from (name.name for name in node.names)
        elif isinstance(node, ast.Attribute):
            yield node.attr


def test_the_pure_rooms_have_no_clock() -> None:
    files = [path for room in PURE for path in (PACKAGE / room).rglob("*.py")]
    assert len(files) > 40
    clocks = {"import time", "import datetime"}
    assert [path for path in files if clocks & set(names_of(path))] == []


def test_outside_of_them_it_is_a_label_and_nothing_else() -> None:
    files = {path.relative_to(PACKAGE).as_posix(): path for path in PACKAGE.rglob("*.py")}
    assert {name for name, path in files.items() if WALL_CLOCK & set(names_of(path))} == set(LABELS)


def test_a_gripper_moves_fails_and_recovers_without_ever_asking_the_wall_clock(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def asked(*_arguments: object) -> None:
        raise AssertionError("the wall clock was asked")

    with FaultWorld() as world, monkeypatch.context() as patched:
        for name in ("time", "time_ns", "localtime", "gmtime", "strftime"):
            patched.setattr(time, name, asked)
        client = world.enabled()
        client.result("motion.move", opening_mm=60)
        client.send("motion.close")
        world.run(0.1)
        world.faults.link_down()
        world.run(1.0)
        world.faults.link_up()
        world.run_until(lambda: world.in_phase(MotorPhase.FAULT, MotorPhase.DISABLED), 5.0)
        client.result("motor.clear_fault")
        assert client.result("motor.enable")["ok"]
        assert client.result("motion.open")["ok"]
        assert len(world.disk.dumps) == 1


@pytest.mark.parametrize("jump_s", [-HOUR_S, HOUR_S])
def test_a_leader_whose_clock_jumps_is_followed_on_without_a_leap(jump_s: float) -> None:
    """Its frames tell its own time of day, which may be set at any time."""
    follower = following()
    world, openness, leads = follower.world, follower.world.openness, []
    for tick in range(400):
        jumped_s = jump_s if tick >= 100 else 0.0
        target = openness if tick < 100 else openness + 0.02
        follower.put(packed(target, world.now_s + jumped_s))
        world.tick()
        leads.append(follower.lead_rad)
    assert follower.status()["phase"] == "following"
    assert follower.status()["stale"] is False
    assert world.openness == pytest.approx(openness + 0.02, abs=0.005)
    assert max(leads) < 0.0334


def test_reading_a_bus_does_not_wait_for_a_clock_that_was_set_back() -> None:
    """python-can asks the time of day how long it still has to wait; set back, that is an hour."""
    program = JUMPY + (
        "from litegripd.model.motor import BusSettings\n"
        "from litegripd.io.can.bus import DirectBus\n"
        "bus = DirectBus(BusSettings('virtual', 'clock', 1_000_000, {}))\n"
        "print([bus.receive(0.005 * tick) for tick in range(10)], bus.condition.state)\n"
        "bus.close()\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        check=True,
        capture_output=True,
        text=True,
        timeout=DEADLINE_S,
    )
    assert done.stdout == f"{[[] for _ in range(10)]} up\n", done


def test_a_daemon_whose_clock_jumps_at_every_reading_moves_and_keeps_its_latest_dumps(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sitecustomize.py").write_text(JUMPY, "utf-8")
    modules = [str(tmp_path), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join(filter(None, modules)))
    config = tmp_path / "jumps.toml"
    config.write_text(
        '[bus]\ninterface = "litegrip_sim"\nwatchdog_s = 0.4\n[gripper]\nmount = "normal"\n',
        "utf-8",
    )
    arguments = (f"jumps-{os.getpid()}", "--config", str(config))
    with daemon(tmp_path, *arguments) as running, running.connect() as client:
        client.enabled()
        client.despite_silence("motion.move", opening_mm=40)
        paths = [Path(client.result("recorder.dump")["path"]) for _ in range(12)]
        client.despite_silence("motion.open")
    assert [path.exists() for path in paths] == [False] * 2 + [True] * 10
    told = [path.name.split("-")[1] for path in paths]
    assert any(later < earlier for earlier, later in itertools.pairwise(told))  # it did jump
