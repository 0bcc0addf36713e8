"""Every fault in every situation: what must hold holds; docs/generated/faults.md has the rest."""

import pytest

from litegripd.rpc.method import Method
from tests.faults.fault_world import FaultWorld
from tests.faults.matrix import PAGE, page, run_row, title
from tests.faults.rows import FAULTS, Fault
from tests.faults.situations import SITUATIONS, Situation
from tests.faults.stopped import CALLED, run_stopped
from tests.world import PERIOD_S

STALE = "stale? see: python -m tests.faults.matrix"
TEXT = PAGE.read_text(encoding="utf-8")


def documented(fault: Fault, situation: Situation) -> str:
    """Return the row that the page has for a cell, or nothing."""
    section = next(
        (text for text in TEXT.split("\n### ") if text.startswith(f"{title(fault)}\n")), ""
    )
    rows = (line for line in section.splitlines() if line.startswith(f"| {situation.name} |"))
    return next(rows, "")


def documented_stopped(method: Method) -> str:
    """Return the row that the page has for a method under a stop, or nothing."""
    rows = (line for line in TEXT.splitlines() if line.startswith(f"| `{method.name}` |"))
    return next(rows, "")


@pytest.mark.parametrize("method", CALLED, ids=lambda method: method.name)
def test_nothing_that_is_called_under_a_stop_moves_the_jaws(method: Method) -> None:
    row = run_stopped(method)
    assert row.endswith("| 0.000 | 0.000 | 0.000 |")
    assert row == documented_stopped(method), STALE


@pytest.mark.parametrize("situation", SITUATIONS, ids=lambda situation: situation.name)
@pytest.mark.parametrize("fault", FAULTS, ids=lambda fault: fault.name)
def test_a_fault_ends_safely_and_as_the_page_says(fault: Fault, situation: Situation) -> None:
    assert run_row(fault, situation) == documented(fault, situation), STALE


def test_the_page_has_each_run_and_nothing_else() -> None:
    """Of these rows and no more; each is compared with a run of its own above."""
    assert page(documented, documented_stopped) == TEXT, STALE


def test_no_two_faults_have_one_name() -> None:
    assert len({fault.name for fault in FAULTS}) == len(FAULTS)


def test_an_old_command_that_reaches_an_enabled_motor_is_noticed() -> None:
    with FaultWorld(watchdog_s=0.4) as world:
        world.enabled()
        world.run(0.5)
        assert world.oldest_s < PERIOD_S
        world.faults.to_motor.delay(0.15)
        world.run(0.3)
        assert 0.13 < world.oldest_s < 0.17  # the last of four that say the same
