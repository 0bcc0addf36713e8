"""Chaos in its short form; LITEGRIPD_CHAOS_MINUTES sets another length of each seed's run.

The seeds run side by side, each in a process of its own. Six simulated minutes of each take about a
minute of one core in all; `make nightly` plays thirty.
"""

import os
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.faults.chaos import Chaos, DefeatError, run
from tests.faults.chaos_watch import kept_by

MINUTES = os.environ.get("LITEGRIPD_CHAOS_MINUTES", "4")
SEEDS = (1, 2, 3)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def runs() -> Iterator[list["subprocess.Popen[str]"]]:
    """Processes that are over, whatever the test comes to."""
    command = [sys.executable, "-W", "error", "-m", "tests.faults.chaos_main"]
    with ExitStack() as stack:
        processes = [
            stack.enter_context(
                subprocess.Popen(
                    [*command, "--seed", str(seed), "--minutes", MINUTES],
                    stdout=subprocess.PIPE,
                    stderr=subprocess.STDOUT,
                    text=True,
                    cwd=ROOT,
                )
            )
            for seed in SEEDS
        ]
        yield processes
        for process in processes:
            process.kill()


@pytest.mark.timeout(900)
def test_whatever_fails_and_whoever_asks_the_gripper_gets_back_to_work(
    runs: list["subprocess.Popen[str]"],
) -> None:
    told = [process.communicate()[0] for process in runs]
    assert [process.returncode for process in runs] == [0] * len(SEEDS), "\n".join(told)


def test_the_same_seed_does_the_same() -> None:
    def summary() -> tuple[object, ...]:
        chaos = run(7, 0.2)
        return chaos.world.now_s, chaos.faults, chaos.chance.random(), chaos.world.controller.ticks

    assert summary() == summary()


def test_a_run_in_which_something_does_not_hold_names_its_seed(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("litegripd.motor.procedures.Arming.has_stored_zero", False)
    with pytest.raises(DefeatError, match=r"^seed 7, after .*motor\.enable fails"):
        run(7, 1.0)


def test_memory_that_grows_is_noticed() -> None:
    chaos = Chaos(1)
    leak: list[object] = []
    chaos.world.service.leak = leak  # type: ignore[attr-defined]
    with chaos.world:
        for _ in range(6):
            chaos.kept.append(kept_by(chaos.world.machine, chaos.world.service))
            leak += [object() for _ in range(500)]
        with pytest.raises(AssertionError, match="keeps more and more"):
            chaos.check_memory()
