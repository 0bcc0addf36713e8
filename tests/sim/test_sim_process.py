"""The command `litegrip-sim`, as a user runs it."""

import errno
import fcntl
import os
import select
import signal
import struct
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.metadata import version
from pathlib import Path

import can
import pytest

from litegripd.app.sim_main import main
from litegripd.model.motor import CanFrame
from litegripd.sim.gripper import build_gripper
from litegripd.sim.interface import MotorWire
from litegripd.sim.server import BusServer, PtyServer
from tests.sim.driving import DISABLE, ENABLE, STATUS, Feedback, command, decode, read, write
from tests.sim.faulty import message
from tests.sim.simulator_process import DEADLINE_S, simulator


def open_slcan(path: str) -> can.BusABC:
    return can.Bus(
        interface="slcan",
        channel=path,
        bitrate=1_000_000,
        sleep_after_open=0,
        ignore_config=True,
    )


def ask(bus: can.BusABC, frame: CanFrame) -> Feedback:
    bus.send(message(frame))
    deadline_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < deadline_s:
        answer = bus.recv(1.0)
        if answer is not None:
            return decode(CanFrame(answer.arbitration_id, bytes(answer.data)))
    raise AssertionError("the motor did not answer")


def test_it_serves_a_gripper_on_a_terminal_to_an_slcan_bus() -> None:
    with simulator("--pty", "--object-mm", "55") as process:
        with open_slcan(process.first_line) as bus:
            ask(bus, write(9, 0))  # a busy machine may be slower than the motor's 100 ms
            start_rad = ask(bus, STATUS).position_rad
            ask(bus, command())
            assert ask(bus, ENABLE).status == 1
            deadline_s = time.monotonic() + DEADLINE_S
            while ask(bus, command(kd=2.0, tau=1.0)).torque_nm < 0.9:
                assert time.monotonic() < deadline_s
            assert ask(bus, command(kd=2.0, tau=1.0)).position_rad > start_rad
            assert ask(bus, DISABLE).status == 0
        assert process.end() == (0, "")


def test_it_has_the_type_of_motor_that_is_asked_for() -> None:
    with simulator("--pty", "--motor-type", "DM4340") as process:
        with open_slcan(process.first_line) as bus:
            bus.send(message(read(20)))
            answer = bus.recv(DEADLINE_S)
        assert answer is not None
        assert bytes(answer.data) == bytes((8, 0, 0x33, 20)) + struct.pack("<f", 40.0)
        assert process.end() == (0, "")


def test_clients_may_come_and_go() -> None:
    with simulator("--pty") as process:
        for _ in range(3):
            with open_slcan(process.first_line) as bus:
                assert ask(bus, STATUS).status == 0
        assert process.end(signal.SIGINT) == (0, "")


def test_a_terminal_left_and_taken_again_is_raw_and_silent() -> None:
    with simulator("--pty") as process:
        for _ in range(2):
            fd = os.open(process.first_line, os.O_RDWR | os.O_NOCTTY)
            try:
                local_flags = termios.tcgetattr(fd)[3]
                assert not local_flags & (termios.ECHO | termios.ICANON)
                os.write(fd, b"V\r")
                assert os.read(fd, 100) == b"V1013\r"
            finally:
                os.close(fd)
        assert process.end()[0] == 0


def test_a_client_that_stops_reading_cannot_hang_it() -> None:
    with simulator("--pty") as process:
        fd = os.open(process.first_line, os.O_RDWR | os.O_NOCTTY)
        try:
            os.write(fd, b"S8\rO\r")
            written = 0
            while written < 300_000:  # far more answers than a terminal holds
                written += os.write(fd, b"t7FF80800CC0000000000\r" * 50)
            unread = struct.unpack("i", fcntl.ioctl(fd, termios.FIONREAD, bytes(4)))[0]
            assert unread > 0
        finally:
            os.close(fd)
        with open_slcan(process.first_line) as bus:
            assert ask(bus, STATUS).motor_id == 8
        code, errors = process.end()
    assert code == 0
    assert "answers dropped, the client did not read them" in errors


def test_a_link_leads_to_the_terminal_and_goes_with_the_process(tmp_path: Path) -> None:
    link = tmp_path / "gripper"
    link.symlink_to("/dev/null")  # left over from a process that was killed
    with simulator("--pty", "--link", str(link)) as process:
        assert str(link.readlink()) == process.first_line
        with open_slcan(str(link)) as bus:
            assert ask(bus, STATUS).status == 0
        assert process.end() == (0, "")
    assert not link.is_symlink()


def test_another_node_sends_frames_that_the_client_sees() -> None:
    with simulator("--pty") as process:
        with open_slcan(process.first_line) as bus:
            ask(bus, write(9, 0))
            process.write("latch_fault B")
            deadline_s = time.monotonic() + DEADLINE_S
            while ask(bus, STATUS).status != 0xB:
                assert time.monotonic() < deadline_s
            process.write("inject 008 FFFFFFFFFFFFFFFB")  # a second master clears the fault
            seen = [bus.recv(DEADLINE_S), bus.recv(DEADLINE_S)]
            assert [found.arbitration_id for found in seen if found is not None] == [0x08, 0x18]
            assert ask(bus, STATUS).status == 0
        assert process.end() == (0, "")


def test_an_unplugged_terminal_comes_back_under_the_same_link(tmp_path: Path) -> None:
    link = tmp_path / "gripper"
    with simulator("--pty", "--link", str(link)) as process:
        fd = os.open(link, os.O_RDWR | os.O_NOCTTY)
        try:
            process.write("latch_fault A", "unplug")
            hang_up = select.poll()
            hang_up.register(fd, 0)
            assert hang_up.poll(DEADLINE_S * 1000) == [(fd, select.POLLERR | select.POLLHUP)]
            assert not link.is_symlink()
        finally:
            os.close(fd)
        process.write("plug")
        assert process.read_line() == str(link.readlink())
        with open_slcan(str(link)) as bus:
            assert ask(bus, STATUS).status == 0xA
        assert process.end() == (0, "")
    assert not link.is_symlink()


def test_an_adapter_is_plugged_in_once_and_unplugged_once() -> None:
    server = PtyServer(MotorWire(build_gripper()))
    with pytest.raises(ValueError, match="plugged in already"):
        server.plug()
    server.unplug()
    with pytest.raises(ValueError, match="unplugged already"):
        server.unplug()
    server.close()


def test_it_ends_cleanly_while_unplugged(tmp_path: Path) -> None:
    with simulator("--pty", "--link", str(tmp_path / "gripper")) as process:
        process.write("unplug", "plug", "unplug", "plug", "unplug")
        assert process.read_line().startswith("/dev/")
        assert process.read_line().startswith("/dev/")
        assert process.end() == (0, "")


@contextmanager
def served(wire: MotorWire) -> Iterator[can.BusABC]:
    """Serve a motor on a bus of python-can; give another node's end of it."""
    with (
        can.Bus(interface="virtual", channel="served", ignore_config=True) as motor_side,
        can.Bus(interface="virtual", channel="served", ignore_config=True) as bus,
    ):
        stopped = threading.Event()
        server = BusServer(wire, motor_side)
        thread = threading.Thread(target=server.run, args=(stopped.is_set,))
        thread.start()
        try:
            yield bus
        finally:
            stopped.set()
            thread.join(DEADLINE_S)
        assert not thread.is_alive()


def test_faults_reach_a_bus_of_python_can() -> None:
    wire = MotorWire(build_gripper())
    wire.to_motor.delay(0.05)
    wire.from_motor.delay(0.05)
    with served(wire) as bus:
        sent_s = time.monotonic()
        assert ask(bus, STATUS).status == 0
        assert time.monotonic() - sent_s >= 0.1


def test_it_serves_on_a_bus_of_python_can() -> None:
    with served(MotorWire(build_gripper())) as bus:
        bus.send(can.Message(arbitration_id=0x08, is_extended_id=True, data=ENABLE.data))
        bus.send(can.Message(arbitration_id=0x08, is_extended_id=False, is_remote_frame=True))
        assert ask(bus, STATUS).status == 0
        ask(bus, command())
        assert ask(bus, ENABLE).status == 1


def test_the_process_on_a_bus_of_python_can_ends_cleanly() -> None:
    with simulator("--interface", "virtual", "--channel", "x") as process:
        assert process.first_line == "serving on virtual x"
        assert process.end() == (0, "")


@pytest.mark.parametrize(
    ("arguments", "error"),
    [
        (["--pty", "--object-mm", "500"], "less than 87 mm wide"),
        (["--pty", "--motor-type", "DM4340", "--can-id", "0"], "can_id must be 1 to 0x7FE"),
        (["--pty", "--motor-type", "DM1"], "it must be DM4310 or DM4340"),
        (["--pty", "--motor-type", "DM8009"], "missing: ranges of position"),
        (["--pty", "--comm-loss", "-1"], "comm_loss_s must not be negative"),
        (["--pty", "--unasked-hz", "1e6"], "unasked_hz must be at most 1000"),
        (["--pty", "--can-id", "0x7FF"], "can_id must be 1 to 0x7FE"),
        (["--pty", "--channel", "can0"], "belong to --interface"),
        (["--interface", "virtual"], "needs --channel"),
        (["--interface", "virtual", "--channel", "x", "--link", "y"], "belongs to --pty"),
        (["--pty", "--link", "/dev/null"], "no symbolic link"),
    ],
)
def test_bad_usage_is_explained_with_exit_code_2(
    arguments: list[str], error: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(arguments) == 2
    assert error in capsys.readouterr().err


@pytest.mark.parametrize(
    "arguments",
    [[], ["--pty", "--interface", "virtual"], ["--mount", "up"], ["--pty", "--watchdog", "x"]],
)
def test_the_parser_refuses_with_exit_code_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


@pytest.mark.parametrize("interface", ["socketcan", "no_such_interface"])
def test_a_bus_that_cannot_be_opened_gives_exit_code_1(
    interface: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["--interface", interface, "--channel", "nosuchcan0"]) == 1
    assert "the bus cannot be used" in capsys.readouterr().err


def test_a_kernel_without_can_is_called_that(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(**_: object) -> None:
        raise OSError(errno.EAFNOSUPPORT, "Address family not supported by protocol")

    monkeypatch.setattr(can, "Bus", fail)
    assert main(["--interface", "socketcan", "--channel", "can0"]) == 1
    said = capsys.readouterr().err
    assert "this system has no CAN sockets: load them by 'sudo modprobe can_raw'" in said
    assert "[Errno 97]" in said


def test_the_version_is_the_package_s() -> None:
    found = subprocess.run(
        [sys.executable, "-m", "litegripd.app.sim_main", "--version"],
        capture_output=True,
        check=True,
        timeout=DEADLINE_S,
    )
    assert found.stdout.decode() == f"litegrip-sim {version('litegripd')}\n"
