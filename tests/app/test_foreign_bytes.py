"""Bytes from outside at each reader: damage is refused by its own error, or passed.

`bench.hostile.foreign_bytes` has all readers and more bytes. SLCAN lines: tests/io/test_slcan.py;
requests: tests/rpc/test_fuzz.py; trajectories: tests/model/test_trajectory.py; messages of a fleet:
tests/fleet/test_messages.py.
"""

import contextlib
import random
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bench.hostile.foreign_bytes import all_figures
from litegripd.app.config import ConfigError, load
from litegripd.io.helper import atomic_file, files
from litegripd.io.helper.atomic_file import FileError
from litegripd.io.helper.files import DATA
from litegripd.model.calibration import CalibrationError, parse_calibration
from litegripd.model.motor import CanFrame
from litegripd.model.teleop import TeleopFrame, decode_force, decode_frame, encode_frame
from tests.world import World

CALIBRATION = (DATA / "normal.json").read_bytes()
CONFIGURATION = b'[bus]\nchannel = "can0"\n[control]\nrate_hz = 200\n[gripper]\nmount = "normal"\n'
DEEP = (b"[" * 100_000, b'{"a":' * 100_000, b"a = " + b"[" * 100_000, b"9" * 100_000)


def damaged(whole: bytes) -> st.SearchStrategy[bytes]:
    """Any bytes, and a good file with some of its bytes replaced, removed or added."""

    def damage(seed: int) -> bytes:
        chance, content = random.Random(seed), bytearray(whole)
        for _ in range(chance.randint(1, 4)):
            at = chance.randrange(len(content))
            content[at : at + chance.randrange(3)] = chance.randbytes(chance.randrange(3))
        return bytes(content)

    return st.one_of(
        st.binary(max_size=200), st.integers(0, 2**32).map(damage), st.sampled_from(DEEP)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("foreign")


@given(damaged(CONFIGURATION))
def test_a_configuration_is_read_or_refused(folder: Path, content: bytes) -> None:
    path = folder / "can0.toml"
    path.write_bytes(content)
    with contextlib.suppress(ConfigError):
        load("can0", path)


@given(damaged(CALIBRATION))
def test_a_calibration_is_read_or_refused(folder: Path, content: bytes) -> None:
    path = folder / "can0.json"
    path.write_bytes(content)
    with contextlib.suppress(CalibrationError, FileError):
        parse_calibration(atomic_file.read(path, files.MAX_FILE_BYTES))


@given(damaged(encode_frame(TeleopFrame(0.5, 42.0, 1.0, 2.0))))
def test_a_teleoperation_packet_is_a_frame_or_nothing(payload: bytes) -> None:
    assert decode_frame(payload) is None or len(payload) == 32
    assert decode_force(payload) is None or len(payload) == 40


FLAT_KB = 4000.0
"""A million bytes grow the memory by less, wherever they go; what leaks grows with them."""


def test_each_reader_bears_damage_and_reads_what_comes_behind_it() -> None:
    for one in all_figures(10_000):
        assert one.bytes >= 10_000, one
        assert one.refused > 0.4 * one.damaged, one
        assert one.lost == 0, one
        assert one.good > 0, one
        assert one.closed == 0, one
        assert one.grown_kb < FLAT_KB, one


def test_a_hundred_thousand_random_frames_leave_a_hold_as_it_is() -> None:
    """From every id but that of the motor's own answers; some are a second master's commands."""
    world, chance = World(), random.Random(3)
    client = world.enabled()
    before = client.result("state.get")
    ids = [0x00, 0x01, 0x08, 0x7FF, *range(0x100, 0x110)]

    def frame() -> CanFrame:
        return CanFrame(chance.choice(ids), chance.randbytes(chance.randrange(9)))

    for _ in range(2000):
        world.machine.motor.receive(world.now_s, [frame() for _ in range(50)])
        world.tick()
    state = client.result("state.get")
    assert state["motor"] == "enabled"
    assert state["position_rad"] == pytest.approx(before["position_rad"], abs=0.001)
