"""What checks find by themselves: its level, what it says, and what mends it."""

import subprocess

import damiao_motor
import pytest

from litegrip_client.ctl.commands.machine import CHECKS
from litegrip_client.ctl.doctor.facts import Facts
from litegrip_client.ctl.doctor.gripper_checks import (
    CAN_BR_1_MBIT_S,
    IMPLAUSIBLE_OUTSIDE_RAD,
    LONGEST_WATCHDOG_S,
    MODEL_RANGES,
    TIMEOUT_UNIT_S,
)
from litegrip_client.ctl.findings import Finding
from litegrip_client.socketcan.link import BITRATE
from litegripd.control import admission
from litegripd.model.gripper import MOTOR_TYPES
from litegripd.motor import codec, identity
from tests.client.doctor.case import Case
from tests.client.doctor.daemon_cases import DAEMON_CASES
from tests.client.doctor.fleet_cases import FAR, FLEET_CASES
from tests.client.doctor.gripper_cases import GRIPPER_CASES
from tests.client.doctor.known import facts, with_daemon
from tests.client.doctor.link_cases import LINK_CASES

TABLES = (LINK_CASES, DAEMON_CASES, GRIPPER_CASES, FLEET_CASES)
CASES = [(check, case) for table in TABLES for check, cases in table.items() for case in cases]
BY_NAME = {check.name: check for check in CHECKS}


def found_in(check: str, case: Case) -> Finding | None:
    """Return what a check finds by itself."""
    found = BY_NAME[check].examine(case.facts)
    assert found is None or isinstance(found, Finding)
    return found


@pytest.mark.parametrize(("check", "case"), CASES)
def test_a_check(check: str, case: Case) -> None:
    found, wanted = found_in(check, case), case.found()
    if wanted is None or found is None:
        assert (found, wanted) == (None, None)
        return
    assert (found.level, found.command) == (wanted.level, wanted.command)
    assert wanted.text in found.text
    assert (found.advice is None) is (wanted.advice is None)
    assert (wanted.advice or "") in (found.advice or "")


WELL = "configuration device iproute2 network protection scan serial stop teleop"
"""Of what these check nothing is said where all is well."""

NO_DAEMON = (
    "bus calibration can-br channel control-mode health ids motor other-master position ranges"
    " real-time stroke version watchdog"
)
NO_CONTROLLER = "adapter bit-rate bus-errors bus-state modes queue restart sample-point"


@pytest.mark.parametrize(
    ("found", "less"),
    [
        (facts(), ""),
        (facts(daemon=None), NO_DAEMON),
        (facts("vcan"), NO_CONTROLLER),
        (facts("unset"), "bus-state restart sample-point"),
        (facts("down"), "bus-state restart"),
        (facts(None, interface=None, daemon=None), f"link {NO_CONTROLLER} {NO_DAEMON}"),
        (with_daemon(info_registers={}), "can-br control-mode ids ranges watchdog"),
        # What another machine has, is not looked for on this one.
        (FAR, f"link disk real-time {NO_CONTROLLER}"),
    ],
)
def test_nothing_is_said_of_what_is_not_there(found: Facts, less: str) -> None:
    silent = {check.name for check in CHECKS if check.examine(found) is None}
    assert silent == {*WELL.split(), *less.split()}


def test_every_check_is_shown_passing() -> None:
    """And failing in the scenes of `tests/symptoms`, which are not told here a second time."""
    passing = {check for check, case in CASES if (case.finds or "OK").startswith("OK")}
    assert passing | {*WELL.split()} == BY_NAME.keys()


def failing() -> list[Finding]:
    found = (found_in(check, case) for check, case in CASES)
    return [finding for finding in found if finding is not None and finding.level != "ok"]


def test_what_fails_says_what_to_do_in_single_lines() -> None:
    for finding in failing():
        assert finding.command or finding.advice
        for text in (finding.text, finding.command or "", finding.advice or ""):
            assert "\n" not in text


def test_a_shell_understands_every_command() -> None:
    commands = sorted({finding.command for finding in failing() if finding.command})
    assert len(commands) > 10
    script = "\n".join(commands)
    done = subprocess.run(["sh", "-n", "-c", script], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


def test_what_is_expected_of_the_motor_is_what_the_daemon_expects() -> None:
    ranges = {name: row.ranges for name, row in MOTOR_TYPES.items()}
    assert {
        name: {"PMAX": of.position_rad, "VMAX": of.velocity_rad_s, "TMAX": of.torque_nm}
        for name, of in ranges.items()
    } == MODEL_RANGES
    assert (TIMEOUT_UNIT_S, LONGEST_WATCHDOG_S) == (
        codec.TIMEOUT_UNIT_S,
        identity.LONGEST_WATCHDOG_S,
    )
    assert IMPLAUSIBLE_OUTSIDE_RAD == admission.IMPLAUSIBLE_OUTSIDE_RAD
    assert damiao_motor.CAN_BAUD_RATE_CODES[CAN_BR_1_MBIT_S] == BITRATE
