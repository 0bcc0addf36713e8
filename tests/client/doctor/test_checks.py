"""Each check, failing and passing: its level, what it says, and what mends it."""

import subprocess
from collections import defaultdict
from dataclasses import replace
from typing import NamedTuple

import damiao_motor
import pytest

from litegrip_client.doctor.facts import Device, Facts, Socket, User
from litegrip_client.doctor.findings import Finding
from litegrip_client.doctor.gripper_checks import (
    CAN_BR_1_MBIT_S,
    LONGEST_WATCHDOG_S,
    MODEL_RANGES,
    TIMEOUT_UNIT_S,
)
from litegrip_client.doctor.link_checks import BITRATE
from litegrip_client.doctor.table import CHECKS
from litegripd.motor import look, registers
from tests.client.doctor.known import SOCKETS, daemon, facts, link, system

UP = "sudo ip link set can0 up type can bitrate 1000000 restart-ms 100"
ANEW = f"sudo ip link set can0 down && {UP}"
JOIN = "sudo usermod --append --groups litegrip alice"
MAKE = "sudo groupadd --system litegrip"
RESTART = "sudo systemctl restart litegripd@can0"
LOGIN = "groups count from the next login on"
ZERO = "litegripctl -c can0 enable && litegripctl -c can0 zero"
CLOSED = (replace(SOCKETS[0], is_accessible=False), SOCKETS[1])
ALICE = User("alice", 1000, "litegrip")
OUTSIDE = replace(ALICE, is_member=False, has_group=False)
NO_GROUP = replace(OUTSIDE, group_exists=False)
ROOT = User("root", 0, "litegrip", is_member=False, has_group=False)
SERIAL = Device("/dev/ttyACM0", True, True, True, "dialout")
ONLY_FILES = replace(link("healthy"), kind=None, bitrate=None, sample_point=None, state=None)
WIRING = "wiring"


class Case(NamedTuple):
    """A check, the facts, and what it must find; `level` None where nothing is to be found."""

    check: str
    facts: Facts
    level: str | None
    says: str = ""
    command: str | None = None
    advises: str | None = None


def serial(device: Device | None, **changes: object) -> Facts:
    """Return facts of a gripper on a serial-line adapter."""
    return facts(
        None,
        interface="slcan",
        bus_channel="/dev/ttyACM0",
        system=replace(system(), link=None, device=device),
        daemon=daemon(**changes),
    )


def motor(**changes: object) -> Facts:
    return facts(daemon=daemon(**changes))


CASES = [
    Case("iproute2", facts(), None),
    Case(
        "iproute2",
        facts(system=system(link=ONLY_FILES, ip_problem="ip (iproute2) is not installed")),
        "warning",
        "error counters are not known: ip (iproute2) is not installed",
        "sudo apt install iproute2",
    ),
    Case("link", facts(), "ok", "can0 is up"),
    Case(
        "link", facts("vcan", bus_channel="vcan0"), "ok", "vcan0 is up, virtual: without bit rate"
    ),
    Case("link", facts("down"), "error", "can0 is down", UP),
    Case("link", facts("unset"), "error", "can0 is down", UP),
    Case(
        "link",
        facts("vcan_down", bus_channel="vcan0"),
        "error",
        "vcan0 is down, virtual",
        "sudo ip link set vcan0 up",
    ),
    Case(
        "link",
        facts("dummy", bus_channel="can8"),
        "error",
        "can8 is no CAN interface",
        advises="there are: can0, can1",
    ),
    Case(
        "link",
        facts(None, bus_channel="can9"),
        "error",
        "there is no network interface can9; there are: can0, can1",
        advises="plug the adapter in",
    ),
    Case(
        "link",
        facts(system=system(link=None, can_links=())),
        "error",
        "there is no network interface can0, and no other one for CAN",
        advises="etc/slcan.toml",
    ),
    Case(
        "link",
        facts(None, bus_channel="vcan0"),
        "error",
        "there is no network interface vcan0",
        "sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up",
    ),
    Case("link", serial(SERIAL), None),
    Case("device", facts(), None),
    Case("device", facts(interface="litegrip_sim"), "ok", "no adapter to check"),
    Case("device", serial(SERIAL), "ok", "/dev/ttyACM0 is there and accessible"),
    Case("device", serial(None), "ok", "channel /dev/ttyACM0: python-can opens it"),
    Case(
        "device",
        serial(Device("/dev/ttyACM0", False)),
        "error",
        "/dev/ttyACM0 is not there",
        "ls -l /dev/serial/by-id/",
        "plug the adapter in",
    ),
    Case(
        "device",
        serial(Device("/dev/ttyACM0", True)),
        "error",
        "/dev/ttyACM0 is no device",
        "ls -l /dev/serial/by-id/",
        "[bus] channel",
    ),
    Case(
        "device",
        serial(replace(SERIAL, is_accessible=False), health_bus__state="down"),
        "warning",
        "/dev/ttyACM0 is there, but not for alice",
        "sudo usermod --append --groups dialout alice",
        "log in anew",
    ),
    Case("device", serial(replace(SERIAL, is_accessible=False)), "ok", "is there and accessible"),
    Case("adapter", facts(), "ok", "driver gs_usb, candleLight USB to CAN adapter"),
    Case("adapter", facts(system=system(adapter=None)), "ok", "driver gs_usb"),
    Case("adapter", facts("vcan"), None),
    Case(
        "adapter",
        facts(system=system(driver=None)),
        "warning",
        "no driver is known",
        advises='interface = "slcan"',
    ),
    Case("bit-rate", facts(), "ok", "1 Mbit/s"),
    Case(
        "bit-rate",
        facts("wrong_bitrate"),
        "error",
        "0.5 Mbit/s, but the motor speaks at 1 Mbit/s",
        ANEW,
    ),
    Case(
        "bit-rate",
        facts("wrong_bitrate", daemon=daemon(state_enabled=True)),
        "error",
        "0.5 Mbit/s",
        f"litegripctl -c can0 disable && {ANEW}",
    ),
    Case("bit-rate", facts("unset"), "error", "no bit rate is set", UP),
    Case("bit-rate", facts("vcan"), None),
    Case("bit-rate", facts(system=system(link=ONLY_FILES)), None),
    Case("bit-rate", serial(SERIAL), "ok", "1 Mbit/s, by the configuration"),
    Case(
        "bit-rate",
        serial(SERIAL, info_configuration__bus={"bitrate": 500_000}),
        "error",
        "0.5 Mbit/s by the configuration",
        advises="set [bus] bitrate = 1000000",
    ),
    Case("sample-point", facts(), "ok", "at 75.0% of a bit"),
    Case("sample-point", facts("wrong_bitrate"), "ok", "at 87.5% of a bit"),
    Case("sample-point", facts("unset"), None),
    Case(
        "sample-point",
        facts("sample_point"),
        "warning",
        "at 50.0% of a bit; 70% to 90% are usual",
        "sudo ip link set can0 down && sudo ip link set can0 up"
        " type can bitrate 1000000 sample-point 0.75",
    ),
    Case("restart", facts(), "ok", "by itself, 100 ms after bus-off"),
    Case(
        "restart",
        facts("no_restart"),
        "warning",
        "restart-ms is not set: after bus-off the bus stays off",
        "sudo ip link set can0 down && sudo ip link set can0 up type can restart-ms 100",
    ),
    Case("restart", facts("unset"), "warning", "restart-ms is not set", UP),
    Case("restart", facts("vcan"), None),
    Case("queue", facts(), "ok", "10 frames, 50 ms of commands at 200 Hz"),
    Case("queue", motor(hello_limits__rate_hz=100), "ok", "10 frames, 100 ms of commands"),
    Case("queue", facts(daemon=None), "ok", "10 frames, 50 ms of commands at 200 Hz"),
    Case(
        "queue",
        facts("long_queue"),
        "warning",
        "1000 frames, 5000 ms of commands at 200 Hz: a dead bus that comes back gets old commands",
        "sudo ip link set can0 txqueuelen 10",
    ),
    Case("queue", facts("vcan"), None),
    Case("bus-state", facts(), "ok", "error-active, tx errors 0, rx errors 0"),
    Case("bus-state", facts("down"), None),
    Case(
        "bus-state",
        facts("error_passive"),
        "error",
        "error-passive, tx errors 128, rx errors 0",
        advises=WIRING,
    ),
    Case(
        "bus-state",
        facts(system=system(link=replace(link("healthy"), state="ERROR-WARNING", tx_errors=None))),
        "warning",
        "error-warning, tx errors unknown, rx errors 0",
        advises=WIRING,
    ),
    Case(
        "bus-state",
        facts("bus_off"),
        "error",
        "bus-off, tx errors 248",
        "sudo ip link set can1 type can restart",
        WIRING,
    ),
    Case(
        "bus-state",
        facts(system=system(link=replace(link("bus_off"), restart_ms=100))),
        "error",
        "bus-off",
        advises=WIRING,
    ),
    Case("bus-errors", facts(), "ok", "none since the driver was loaded"),
    Case(
        "bus-errors",
        facts("bus_off"),
        "warning",
        "since the driver was loaded: 31 bus error, 1 error warning, 1 error passive, 1 bus off",
        advises=WIRING,
    ),
    Case("bus-errors", facts("vcan"), None),
    Case("daemon", facts(), "ok", "runs for 12 s, pid 77, /run/litegripd/can0.sock"),
    Case(
        "daemon",
        facts(daemon=None, failure="no daemon can be reached", sockets=()),
        "error",
        "no daemon can be reached",
        "sudo systemctl start litegripd@can0",
        "without hardware: litegripd can0 --simulate",
    ),
    Case(
        "daemon",
        facts(daemon=None, failure="no daemon can be reached", sockets=CLOSED),
        "warning",
        "not known whether it runs",
        "systemctl status litegripd@can0",
    ),
    Case(
        "daemon",
        facts(asked_channel="can1"),
        "error",
        "the daemon at /run/litegripd/can0.sock has channel can0, not can1",
        "unset LITEGRIPD_SOCKET",
    ),
    Case("version", facts(), "ok", "1.2.3, as this program"),
    Case("version", facts(daemon=None), None),
    Case(
        "version",
        motor(hello_version="1.2.2"),
        "warning",
        "the daemon is 1.2.2, this program 1.2.3",
        "sudo systemctl restart litegripd@can0",
        "install one version",
    ),
    Case("sockets", facts(sockets=()), None),
    Case(
        "sockets",
        facts(),
        "ok",
        "alice may open /run/litegripd/can0.sock and /run/litegripd/can0.stop.sock",
    ),
    Case("sockets", facts(sockets=CLOSED), "error", "alice may not open /run", RESTART, LOGIN),
    Case(
        "sockets", facts(sockets=CLOSED, user=OUTSIDE), "error", "alice may not open", JOIN, LOGIN
    ),
    Case(
        "sockets",
        facts(sockets=CLOSED, user=NO_GROUP),
        "error",
        "alice may not open",
        f"{MAKE} && {JOIN} && {RESTART}",
        LOGIN,
    ),
    Case("group", facts(), "ok", "alice is in group litegrip"),
    Case("group", facts(user=ROOT), "ok", "root needs no group litegrip"),
    Case(
        "group",
        facts(user=OUTSIDE, sockets=(Socket("/run/user/1000/x.sock", True, 1000),)),
        "ok",
        "alice needs no group",
    ),
    Case("group", facts(user=OUTSIDE), "warning", "alice is not in group", JOIN, LOGIN),
    Case(
        "group",
        facts(user=replace(ALICE, has_group=False)),
        "warning",
        "alice is in group litegrip, but not yet in this session",
        "newgrp litegrip",
        LOGIN,
    ),
    Case(
        "group",
        facts(user=NO_GROUP),
        "warning",
        "there is no group litegrip",
        f"{MAKE} && {JOIN} && {RESTART}",
        LOGIN,
    ),
    Case(
        "group",
        facts(user=replace(ROOT, group_exists=False)),
        "warning",
        "there is no group litegrip",
        f"{MAKE} && {RESTART}",
        LOGIN,
    ),
    Case("real-time", facts(), "ok", "SCHED_FIFO 50, memory locked"),
    Case("real-time", facts(daemon=None), None),
    Case(
        "real-time",
        motor(health_control__fifo_priority=0, info_configuration__control={"priority": 0}),
        "ok",
        "ordinary priority, as configured, memory locked",
    ),
    Case(
        "real-time",
        motor(health_control={"fifo_priority": 0, "memory_locked": False}),
        "warning",
        "not granted: SCHED_FIFO 50 and locked memory",
        "sudo mkdir -p /etc/systemd/system/litegripd@.service.d && printf"
        " '[Service]\\nLimitRTPRIO=99\\nLimitMEMLOCK=infinity\\n'"
        " | sudo tee /etc/systemd/system/litegripd@.service.d/realtime.conf"
        " && sudo systemctl daemon-reload && sudo systemctl restart litegripd@can0",
        "CAP_SYS_NICE",
    ),
    Case("bus", facts(), "ok", "the daemon uses it, load 12%, 0 lost frames"),
    Case("bus", facts(daemon=None), None),
    Case(
        "bus",
        motor(health_bus={"state": "down", "error": "Network is down"}),
        "error",
        "the daemon cannot use it (down): Network is down",
        advises="found above",
    ),
    Case("motor", facts(), "ok", "disabled, last feedback 0.004 s ago"),
    Case("motor", motor(health_bus__state="down"), None),
    Case(
        "motor",
        motor(state_motor="silent", state_stale=True, state_age_s=7.25),
        "error",
        "silent, last feedback 7.250 s ago",
        advises="0x08",
    ),
    Case(
        "motor",
        motor(state_motor="unknown", state_stale=True, state_age_s=None, hello_motor={"can_id": 9}),
        "error",
        "unknown, no feedback yet",
        advises="0x09",
    ),
    Case(
        "motor",
        motor(state_motor="fault", state_status="coil_hot"),
        "error",
        "it reports a fault: coil_hot, last feedback 0.004 s ago",
        "litegripctl -c can0 enable",
        "find its cause",
    ),
    Case("other-master", facts(), "ok", "nobody but the daemon"),
    Case("other-master", facts(daemon=None), None),
    Case(
        "other-master",
        motor(health_motor__foreign_commands=3),
        "error",
        "another program has sent the motor 3 frames: a second master",
        "candump can0",
        "let it use the daemon",
    ),
    Case("control-mode", facts(), "ok", "CTRL_MODE 1, MIT"),
    Case("control-mode", motor(info_registers={}), None),
    Case(
        "control-mode",
        motor(info_registers__CTRL_MODE=2),
        "error",
        "CTRL_MODE is 2, not 1 (MIT)",
        advises="set register 10 to 1",
    ),
    Case("can-br", facts(), "ok", "can_br 4, 1 Mbit/s"),
    Case("can-br", motor(info_registers__can_br=None), None),
    Case(
        "can-br",
        motor(info_registers__can_br=3),
        "warning",
        "can_br 3, 500 kbit/s, where 1 Mbit/s (4) is expected",
        advises="set register 35 to 4",
    ),
    Case("ids", facts(), "ok", "commanded by 0x08, answers on 0x18"),
    Case("ids", motor(info_registers={}), None),
    Case(
        "ids",
        motor(info_registers__ESC_ID=9),
        "error",
        "but its ESC_ID is 0x09",
        advises="set [motor] can_id = 0x09",
    ),
    Case(
        "ids",
        motor(info_registers__MST_ID=8),
        "error",
        "cannot be told apart",
        advises="set register 7 (MST_ID) to 0x18",
    ),
    Case(
        "ids",
        motor(info_registers__MST_ID=0),
        "warning",
        "MST_ID was never set",
        advises="set register 7 (MST_ID) to 0x18",
    ),
    Case("watchdog", facts(), "ok", "TIMEOUT 2000: the motor lets go 100 ms after a loss"),
    Case("watchdog", motor(info_registers__TIMEOUT=8000), "ok", "400 ms"),
    Case("watchdog", motor(info_registers={}), None),
    Case(
        "watchdog",
        motor(info_registers__TIMEOUT=0),
        "warning",
        "TIMEOUT is 0, off after power-on",
        advises="set register 9 to 2000",
    ),
    Case(
        "watchdog",
        motor(info_registers__TIMEOUT=20_000),
        "warning",
        "TIMEOUT is 1 s after power-on",
        advises="set register 9 to 2000",
    ),
    Case("ranges", facts(), "ok", "PMAX 12.5, VMAX 30, TMAX 10, the model's"),
    Case("ranges", motor(info_registers={}), None),
    Case(
        "ranges",
        motor(info_registers__PMAX=3.141593),
        "warning",
        "PMAX 3.14159, VMAX 30, TMAX 10 instead of the model's 12.5, 30, 10",
        advises="nothing to do",
    ),
    Case("calibration", facts(), "ok", "mount normal, travel 120.0 mm, 3 days old, /var/lib/lite"),
    Case("calibration", facts(daemon=None), None),
    Case(
        "calibration",
        motor(hello_gripper={"calibrated": False, "mount": None}),
        "warning",
        "none: motions are refused",
        advises=f"litegripctl -c can0 calibration load normal (or reverse); then measure: {ZERO}",
    ),
    Case(
        "calibration",
        motor(info_calibration__file=None),
        "warning",
        "in no file: lost at a restart",
        "litegripctl -c can0 calibration save",
    ),
    Case(
        "calibration", motor(info_calibration__nominal=True), "warning", "nominal: it was not", ZERO
    ),
    Case("calibration", motor(info_calibration=None), "ok", "of unknown date, /var/lib/litegripd"),
    Case("calibration", motor(info_calibration__saved_s=1.8e9), "ok", "of today"),
    Case("channel", facts(), "ok", "the calibration is for can0"),
    Case("channel", motor(info_calibration__channel=None), None),
    Case(
        "channel",
        motor(info_calibration__channel="can1"),
        "warning",
        "the calibration is for can1, this is can0",
        ZERO,
        "look at its mount",
    ),
    Case("health", facts(), "ok", "verdict on itself is ok"),
    Case("health", facts(daemon=None), None),
    Case(
        "health",
        motor(health_verdict="degraded", health_reasons=["a", "b"]),
        "warning",
        "degraded: a; b",
        "litegripctl -c can0 health",
    ),
    Case(
        "health",
        motor(health_verdict="down", health_reasons=["c"]),
        "error",
        "down: c",
        "litegripctl -c can0 health",
    ),
]
BY_NAME = {check.name: check.examine for check in CHECKS}


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.check}-{case.level}")
def test_a_check(case: Case) -> None:
    found = BY_NAME[case.check](case.facts)
    if case.level is None or found is None:
        assert (case.level, found) == (None, None)
        return
    assert (found.level, found.command) == (case.level, case.command)
    assert case.says in found.text
    assert (found.advice is None) is (case.advises is None)
    assert (case.advises or "") in (found.advice or "")


def test_every_check_is_shown_failing_and_passing() -> None:
    seen = defaultdict(set)
    for case in CASES:
        seen[case.check].add("passes" if case.level in (None, "ok") else "fails")
    assert seen.keys() == BY_NAME.keys()
    assert all(kinds == {"passes", "fails"} for kinds in seen.values())


def failing() -> list[Finding]:
    found = [BY_NAME[case.check](case.facts) for case in CASES]
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
    expected = look.MODEL_RANGES
    assert {
        "PMAX": expected.position_rad,
        "VMAX": expected.velocity_rad_s,
        "TMAX": expected.torque_nm,
    } == MODEL_RANGES
    assert (TIMEOUT_UNIT_S, LONGEST_WATCHDOG_S) == (
        registers.TIMEOUT_UNIT_S,
        look.LONGEST_WATCHDOG_S,
    )
    assert damiao_motor.CAN_BAUD_RATE_CODES[CAN_BR_1_MBIT_S] == BITRATE
