"""Register frames byte for byte, and answers distinguished from feedback."""

import struct

import pytest
from hypothesis import given
from hypothesis import strategies as st

from litegripd.model.gripper import DM4310
from litegripd.model.motor import CanFrame
from litegripd.motor import codec as reg
from litegripd.motor.codec import decode_feedback
from tests.motor.helpers import answer, world_with
from tests.world import World


def test_request_frames_byte_for_byte() -> None:
    for made, expected in (
        (reg.read_request(8, reg.MASTER_ID), "0800330700000000"),
        (reg.write_request(8, reg.TIMEOUT, 2000), "08005509d0070000"),
        (reg.write_request(8, reg.PMAX, 12.5), "0800551500004841"),
        (reg.status_request(8), "0800cc0000000000"),
        (reg.read_request(0x123, reg.TMAX), "2301331700000000"),
    ):
        assert made == CanFrame(0x7FF, bytes.fromhex(expected))


MAKERS = """
0 UV_Value f, 1 KT_Value f, 2 OT_Value f, 3 OC_Value f, 4 ACC f, 5 DEC f, 6 MAX_SPD f,
7 MST_ID u, 8 ESC_ID u, 9 TIMEOUT u, 10 CTRL_MODE u, 11 Damp f, 12 Inertia f, 13 hw_ver u,
14 sw_ver u, 15 SN u, 16 NPP u, 17 Rs f, 18 Ls f, 19 Flux f, 20 Gr f, 21 PMAX f, 22 VMAX f,
23 TMAX f, 24 I_BW f, 25 KP_ASR f, 26 KI_ASR f, 27 KP_APR f, 28 KI_APR f, 29 OV_Value f,
30 GREF f, 31 Deta f, 32 V_BW f, 33 IQ_c1 f, 34 VL_c1 f, 35 can_br u, 36 sub_ver u,
50 u_off f, 51 v_off f, 52 k1 f, 53 k2 f, 54 m_off f, 55 dir f, 56 m_off_56 f, 59 Imax f,
60 VBus f, 61 Tpcb f, 62 Tmtr f, 63 Iu_off f, 64 Iv_off f, 65 Iw_off f, 80 p_m f,
81 xout f
"""
"""Number, name and kind: a float, or an unsigned integer."""


def test_the_registers_have_the_makers_numbers_and_kinds() -> None:
    rows = [row.split() for row in MAKERS.split(",")]
    assert {r.number: [r.name, r.kind] for r in reg.REGISTERS.values()} == {
        int(number): rest for number, *rest in rows
    }
    names = [register.name.lower() for register in reg.REGISTERS.values()]
    assert len(set(names)) == len(names)


@given(st.binary(max_size=10), st.integers(1, 0x7FE))
def test_only_the_shape_of_an_answer_of_this_motor_is_one(data: bytes, can_id: int) -> None:
    found = reg.parse_answer(data, can_id)
    head = can_id.to_bytes(2, "little")
    shaped = len(data) == 8 and data[:2] == head and data[2] in (0x33, 0x55, 0xAA)
    assert (found is not None) is shaped


def test_an_answer_is_taken_apart() -> None:
    assert reg.parse_answer(bytes.fromhex("0800330900000102"), 8) == reg.Answer(
        9, False, b"\x00\x00\x01\x02"
    )
    written = reg.parse_answer(bytes.fromhex("08005509d0070000"), 8)
    assert written is not None
    assert written.is_write


@pytest.mark.parametrize("opcode", [0x33, 0x55, 0xAA])
def test_a_register_answer_never_becomes_feedback(opcode: int) -> None:
    """It would decode to about -12.47 rad, out of a jaw's reach by far."""
    world = World().start()
    before = world.state.position_rad
    frame = answer(9, struct.pack("<I", 2000), opcode)
    assert decode_feedback(frame.data, DM4310.ranges, 0.0).position_rad < -12.4
    counters = world.machine.motor.counters
    counted = counters.ignored_frames + counters.foreign_commands
    for _ in range(3):
        world.inject(frame)
        world.tick()
        assert world.state.position_rad == pytest.approx(before, abs=1e-3)
    assert counters.ignored_frames + counters.foreign_commands == counted + 3


def test_a_write_answer_does_not_become_feedback_while_enabling() -> None:
    world = world_with(9, struct.pack("<I", 0)).start()
    positions = []
    client = world.client()
    number = client.send("motor.enable")
    while not client.has_answer(number):
        world.tick()
        positions.append(world.state.position_rad)
    assert client.answers[number]["result"]["ok"]
    assert min(p for p in positions if p is not None) > -2.0
