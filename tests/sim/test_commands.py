"""The lines by which a running simulator takes faults: what each does, and what is refused."""

import os
import pty
from collections.abc import Iterator

import pytest

from litegripd.model.motor import CanFrame
from litegripd.sim import registers as reg
from litegripd.sim.console import TABLE, Console, help_text, parse
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import MotorWire
from tests.sim.driving import STATUS, decode, write


class Simulator:
    """Takes commands; time passes by `ask`."""

    def __init__(self) -> None:
        self.wire = MotorWire(SimulatedGripper(seed=None))
        self.injected: list[CanFrame] = []
        self.plugged = True
        self.now_s = 10.0

    @property
    def gripper(self) -> SimulatedGripper:
        return self.wire.gripper

    def inject(self, frame: CanFrame) -> None:
        self.injected.append(frame)

    def unplug(self) -> None:
        self.plugged = False

    def plug(self) -> None:
        if self.plugged:
            raise ValueError("the adapter is plugged in already")
        self.plugged = True

    def do(self, line: str) -> str | None:
        return parse(line)(self)

    def ask(self) -> list[tuple[float, CanFrame]]:
        """Let a second pass and ask for the status; return what has come by then, with delays."""
        self.now_s += 1.0
        answers = self.wire.carry(self.now_s, self.now_s, STATUS)
        answers += self.wire.late(self.now_s + 0.5)
        return [(round(at_s - self.now_s, 6), frame) for at_s, frame in answers]

    @property
    def status(self) -> int:
        return decode(self.ask()[0][1]).status


@pytest.fixture
def simulator() -> Simulator:
    return Simulator()


def test_each_fault_of_frames_goes_both_ways_or_one(simulator: Simulator) -> None:
    simulator.do("delay 0.1")
    assert [delay_s for delay_s, _ in simulator.ask()] == [0.2]
    simulator.do("delay 0 to")
    assert [delay_s for delay_s, _ in simulator.ask()] == [0.1]
    simulator.do("delay 0 from")
    simulator.do("double 1 to")
    assert len(simulator.ask()) == 2
    simulator.do("double 1")
    assert len(simulator.ask()) == 4
    simulator.do("double 0")
    simulator.do("corrupt 1 from")
    assert simulator.ask()[0][1].data != simulator.gripper.receive(simulator.now_s, STATUS)[0].data
    simulator.do("corrupt 0")
    simulator.do("drop 1.0 from")
    assert simulator.ask() == []
    simulator.do("drop 0")
    assert len(simulator.ask()) == 1


def test_silence_lasts_until_nothing_is_dropped(simulator: Simulator) -> None:
    simulator.do("silence")
    assert simulator.ask() == []
    simulator.do("drop 0")
    assert simulator.status == 0


def test_power_status_heat_and_supply(simulator: Simulator) -> None:
    simulator.do("power off")
    assert simulator.ask() == []
    simulator.do("power on")
    assert simulator.status == 0
    simulator.do("status 0xB")
    assert simulator.status == 0xB
    simulator.do("power off")
    simulator.do("power on")
    simulator.do("heat 105")
    assert simulator.status == 0xC
    simulator.do("power off")
    simulator.do("heat 25")
    simulator.do("supply 0")
    simulator.do("power on")
    assert simulator.status == 9


def test_a_weak_motor_makes_a_share_of_what_it_is_told(simulator: Simulator) -> None:
    simulator.do("weak 0.15")
    assert simulator.wire.gripper.made_share == 0.15
    simulator.do("weak 1")
    assert simulator.wire.gripper.made_share == 1.0


def test_turns_and_jumps_shift_the_report(simulator: Simulator) -> None:
    before_rad = decode(simulator.ask()[0][1]).position_rad
    simulator.do("turns -1")
    assert decode(simulator.ask()[0][1]).position_rad == pytest.approx(
        before_rad - 6.2832, abs=1e-3
    )
    simulator.do("jump 0.5")
    assert decode(simulator.ask()[0][1]).position_rad == pytest.approx(
        before_rad - 5.7832, abs=1e-3
    )


def test_hands_objects_and_jams(simulator: Simulator) -> None:
    start_mm = simulator.gripper.opening_mm
    simulator.do("jam")
    simulator.do("push 1.5")
    simulator.ask()
    assert simulator.gripper.opening_mm == start_mm
    simulator.do("object 40 300")
    simulator.do("free")
    simulator.ask()
    simulator.ask()
    assert simulator.gripper.opening_mm == pytest.approx(40.0, abs=0.5)
    simulator.do("yield 2.5")
    simulator.ask()
    assert simulator.gripper.opening_mm == pytest.approx(37.5, abs=0.5)
    simulator.do("object none")
    simulator.ask()
    assert simulator.gripper.opening_mm < 36.5


def test_frames_are_injected_and_adapters_unplugged(simulator: Simulator) -> None:
    simulator.do("inject 008#FFFFFFFFFFFFFFFD")
    simulator.do("inject 7ff#0800CC")
    assert simulator.injected == [
        CanFrame(0x08, b"\xff" * 7 + b"\xfd"),
        CanFrame(0x7FF, b"\x08\x00\xcc"),
    ]
    simulator.do("unplug")
    assert not simulator.plugged
    simulator.do("  plug  ")
    assert simulator.plugged


def test_another_node_writes_registers(simulator: Simulator) -> None:
    simulator.do("register 32 100")
    simulator.do("register 0x17 54")
    simulator.do("register 9 0")
    assert simulator.injected == [write(32, 100.0), write(23, 54.0), write(9, 0)]


def test_the_motor_bears_silence_and_reports_as_it_is_told(simulator: Simulator) -> None:
    simulator.do("comm-loss 0.9")
    simulator.do("unasked 10")
    motor = simulator.gripper.motor
    assert motor.disarms_after_s == 0.9
    simulator.do("comm-loss register")
    assert motor.disarms_after_s == 0.1
    assert simulator.wire.next_s == float("inf")  # it is not enabled


def test_help_tells_of_every_command(simulator: Simulator) -> None:
    said = simulator.do("help")
    assert said is not None
    assert said.endswith(help_text())
    assert len(help_text().splitlines()) == len(TABLE)
    assert all(f"  {entry.usage} " in help_text() for entry in TABLE.values())


@pytest.mark.parametrize(
    ("line", "complaint"),
    [
        ("explode", "unknown command 'explode'; 'help' lists the commands"),
        ("DROP 1", "unknown command 'DROP'"),
        ("drop", r"0 arguments in place of 1 or 2; write: drop P \[to|from\]"),
        ("drop much", "'much' is no number; write: drop P"),
        ("drop 1 up", "'up' is no direction"),
        ("drop 1.5", "a probability must be 0 to 1"),
        ("drop nan", "a probability must be 0 to 1"),
        ("delay -1", "must be finite and not negative"),
        ("jam now", "1 arguments in place of 0; write: jam"),
        ("power maybe", "power is 'on' or 'off', not 'maybe'"),
        ("status 1", "0x8 to 0xE"),
        ("status B", "'B' is no whole number"),
        ("turns 0.5", "'0.5' is no whole number"),
        ("heat 1000", "-50 to 300"),
        ("supply -1", "not negative"),
        ("weak 1.5", "made_share must be 0 to 1"),
        ("comm-loss soon", "'soon' is no number"),
        ("comm-loss -1", "finite and not negative"),
        ("unasked 5000", "0 to 1000 Hz"),
        ("jump inf", "must be finite"),
        ("push nan", "must be finite"),
        ("object 110", "does not fit between the jaws"),
        ("object -1", "width_mm must be finite and not negative"),
        ("object none now", "'none' is no number"),
        ("yield 1", "no object between the jaws"),
        ("yield -1", "way_mm must be finite and more than 0"),
        ("inject 8", "no frame of an id to 7FF"),
        ("inject 800#00", "no frame of an id to 7FF"),
        ("inject 8#000000000000000000", "at most 8 bytes"),
        ("inject 8#0", "no frame in hexadecimal digits"),
        ("register 32", "1 arguments in place of 2; write: register N VALUE"),
        ("register 99 1", "there is no register 99"),
        ("register V_BW 1", "'V_BW' is no whole number"),
        ("register 9 0.5", "register 9 cannot hold 0.5"),
        ("register 9 -1", "register 9 cannot hold -1"),
        ("register 9 nan", "register 9 cannot hold nan"),
        ("register 32 1e300", r"register 32 cannot hold 1e\+300"),
        ("inject x#00", "no frame in hexadecimal digits"),
        ("plug", "plugged in already"),
    ],
)
def test_what_does_not_fit_is_refused_and_changes_nothing(
    simulator: Simulator, line: str, complaint: str
) -> None:
    with pytest.raises(ValueError, match=complaint):
        simulator.do(line)
    wire = simulator.wire
    assert [wire.to_motor.is_used, wire.from_motor.is_used] == [False, False]
    assert simulator.injected == []
    assert simulator.plugged
    assert (simulator.gripper.motor.status, simulator.gripper.motor.coil_c) == (0, 25.0)
    assert simulator.gripper.opening_mm == pytest.approx(60.0)
    assert simulator.gripper.motor.registers[reg.TIMEOUT] == 2000


@pytest.fixture
def pipe() -> Iterator[tuple[int, int]]:
    ends = os.pipe()
    yield ends
    for fd in ends:
        if fd >= 0:
            os.close(fd)


class TestConsole:
    """Lines from a file descriptor."""

    def rig(self, fd: int | None) -> tuple[Console, Simulator, list[str]]:
        simulator, said = Simulator(), list[str]()
        return Console(fd, simulator, said.append), simulator, said

    def test_lines_come_in_any_pieces(self, pipe: tuple[int, int]) -> None:
        console, simulator, said = self.rig(pipe[0])
        console.serve()
        for piece in (b"sil", b"ence\n\n \nstatus", b" 0xB\nju"):
            os.write(pipe[1], piece)
            console.serve()
        assert simulator.ask() == []
        assert simulator.gripper.motor.status == 0xB
        assert said == []

    def test_what_is_wrong_is_said_and_the_next_line_counts(self, pipe: tuple[int, int]) -> None:
        console, simulator, said = self.rig(pipe[0])
        for piece in (b"\xff\xfe\n", b"drop 1 " + b"x" * 4000, b"y" * 3000 + b"\n", b"status 8\n"):
            os.write(pipe[1], piece)
            console.serve()
        assert len(said) == 2
        assert said[0].startswith("unknown command")
        assert said[1] == "a command has at most 200 characters"
        assert not simulator.wire.to_motor.is_used
        assert simulator.gripper.motor.status == 8

    def test_the_end_of_the_input_changes_nothing(self) -> None:
        read_fd, write_fd = os.pipe()
        console, simulator, said = self.rig(read_fd)
        os.write(write_fd, b"status 8\nstatus 9")
        os.close(write_fd)
        for _ in range(5):
            console.serve()
        assert simulator.gripper.motor.status == 9
        os.close(read_fd)
        console.serve()
        assert said == []

    def test_without_an_input_none_is_missed(self) -> None:
        console, _, said = self.rig(None)
        console.serve()
        assert said == []

    def test_a_terminal_that_goes_away_ends_the_input(self) -> None:
        outer, inner = pty.openpty()
        try:
            console, simulator, said = self.rig(inner)
            os.write(outer, b"status 8\n")
            console.serve()
            assert simulator.gripper.motor.status == 8
            os.close(outer)
            for _ in range(3):
                console.serve()
            assert said == []
        finally:
            os.close(inner)
