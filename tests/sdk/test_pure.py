"""What needs no motor: targets, openness, frames; the figures are the specification's own."""

import json
import math

import pytest

import litegrip
from litegrip import can
from litegrip.actions import force_approach_terms
from litegrip.can.protocol import MOTOR_LIMITS, get_motor_limits
from litegrip.teleop import openness_to_rad, rad_to_openness, travel_mm

NORMAL = litegrip.GripperConfig(
    pos_closed_rad=0.0, pos_open_rad=-1.651026, rad_to_mm=52.69, calibrated=True
)
REVERSE = litegrip.GripperConfig(
    pos_closed_rad=-1.651026, pos_open_rad=0.0, rad_to_mm=52.69, calibrated=True
)


@pytest.mark.parametrize(
    ("config", "close_rad", "press_rad", "work_rad"),
    [
        (NORMAL, -0.0825513, -1.7335773, -1.5183147),
        (REVERSE, -1.5684747, 0.0825513, -0.1327113),
    ],
    ids=["normal", "reverse"],
)
def test_targets(
    config: litegrip.GripperConfig, close_rad: float, press_rad: float, work_rad: float
) -> None:
    margin, travel = 0.0825513, 1.651026
    assert list(litegrip.limit_target(config, "close", 0.05)) == pytest.approx(
        [close_rad, config.pos_closed_rad, margin, travel]
    )
    assert list(litegrip.press_target(config, "open", 0.05)) == pytest.approx(
        [press_rad, config.pos_open_rad, margin, travel]
    )
    assert list(litegrip.work_limit_target(config, 80.0)) == pytest.approx(
        [work_rad, config.pos_open_rad, 1.5183147]
    )
    assert litegrip.work_limit_target(config, 500.0)[0] == pytest.approx(config.pos_open_rad)


@pytest.mark.parametrize("function", [litegrip.limit_target, litegrip.press_target])
def test_there_is_no_target_without_a_calibration(function: object) -> None:
    assert callable(function)
    with pytest.raises(litegrip.CommandError, match="not calibrated"):
        function(litegrip.GripperConfig(), "close", 0.05)
    empty = litegrip.GripperConfig(calibrated=True, pos_closed_rad=1.0, pos_open_rad=1.0)
    with pytest.raises(litegrip.CommandError, match="zero travel"):
        function(empty, "close", 0.05)


def test_openness() -> None:
    assert travel_mm(NORMAL) == pytest.approx(86.9925, abs=1e-3)
    assert rad_to_openness(-0.7591573, NORMAL) == pytest.approx(0.4598094)
    assert openness_to_rad(0.25, NORMAL) == pytest.approx(-0.4127565)
    assert openness_to_rad(0.25, REVERSE) == pytest.approx(-1.2382695)
    assert rad_to_openness(9.0, NORMAL) == 0.0
    assert rad_to_openness(-9.0, NORMAL) == 1.0
    assert math.isnan(rad_to_openness(math.nan, NORMAL))
    assert rad_to_openness(0.5, litegrip.GripperConfig(pos_closed_rad=0.0)) == 0.0
    assert litegrip.clamp_to_calibrated(NORMAL, 0.3) == 0.0
    assert litegrip.clamp_to_calibrated(NORMAL, -2.0) == pytest.approx(-1.651026)


@pytest.mark.parametrize(
    ("force_n", "speed_mm_s", "kd", "lead_mm"),
    [(20.0, 50.0, 2.0, 0.358), (5.0, 50.0, 0.1789, 0.25), (1.0, 13.58, 0.0, 0.068)],
)
def test_an_approach_by_force(force_n: float, speed_mm_s: float, kd: float, lead_mm: float) -> None:
    scale = 75.4386
    terms = force_approach_terms(100.0, 2.0, 50.0 / scale, 0.005, force_n * 0.1 * 0.9, 4.0 / scale)
    speed, damping, lead = terms
    assert speed == pytest.approx(speed_mm_s / scale, rel=1e-3)
    assert damping == pytest.approx(kd, abs=1e-3)
    assert lead == pytest.approx(lead_mm / scale, rel=1e-2)
    assert force_approach_terms(100.0, 2.0, 1.0, 0.005, 0.0, 0.5) == (1.0, 2.0, 0.5)


@pytest.mark.parametrize(
    ("figures", "frame"),
    [
        ((-0.6, 0.0, 100.0, 2.0, 0.0), "79 da 7f f3 33 66 67 ff"),
        ((0.0, 0.0, 0.0, 0.0, 0.0), "7f ff 7f f0 00 00 07 ff"),
        ((0.0, 0.0, 0.0, 0.0, 2.0), "7f ff 7f f0 00 00 09 99"),
    ],
)
def test_command_frames(figures: tuple[float, ...], frame: str) -> None:
    assert can.pack_mit_frame(*figures).hex(" ") == frame


def test_reports_of_the_motor() -> None:
    report = can.unpack_status_frame(bytes.fromhex("1879DA7FF7FF2328"))
    assert (report.err, report.can_id, report.t_mos, report.t_coil) == (1, 8, 35, 40)
    assert [report.q, report.dq, report.tau] == pytest.approx(
        [-0.600252, -0.007326, -0.002442], abs=1e-6
    )
    with pytest.raises(ValueError, match="7 bytes"):
        can.unpack_status_frame(bytes(7))


def test_other_frames() -> None:
    assert can.pack_command_frame(0xFC).hex() == "ff" * 7 + "fc"
    assert can.pack_refresh_frame(0x108).hex() == "0801cc00"
    assert can.pack_read_param_frame(8, 21).hex() == "0800331500000000"
    assert can.pack_write_param_frame(8, 9, 8000).hex() == "08005509401f0000"
    assert can.pack_write_param_frame(8, 21, 12.5).hex() == "0800551500004841"
    assert can.pack_save_param_frame(8).hex() == "0800aa0100000000"
    answer = can.unpack_param_response(bytes.fromhex("0800331500004841"))
    assert answer is not None
    assert (answer.can_id, answer.opcode, answer.rid, answer.value) == (8, 0x33, 21, 12.5)
    whole = can.unpack_param_response(bytes.fromhex("08003309401f0000"))
    assert whole is not None
    assert whole.value == 8000.0
    assert isinstance(whole.value, float)
    assert can.unpack_param_response(bytes(7)) is None
    assert can.unpack_param_response(bytes(8)) is None


def test_figures_in_a_frame_are_truncated_and_never_not_finite() -> None:
    assert can.float_to_uint(99.0, -1.0, 1.0, 12) == 4095
    assert can.uint_to_float(0, -1.0, 1.0, 12) == -1.0
    with pytest.raises(ValueError, match="finite"):
        can.float_to_uint(math.nan, -1.0, 1.0, 12)
    assert get_motor_limits(can.MotorType.DM6248P) is MOTOR_LIMITS[6]
    assert get_motor_limits(99) is MOTOR_LIMITS[1]


def test_frames_of_teleoperation() -> None:
    frame = litegrip.encode_frame(0.25, 21.5, -3.5, 1234.5)
    assert frame.hex(" ", 8) == (
        "3fd0000000000000 4035800000000000 c00c000000000000 40934a0000000000"
    )
    assert litegrip.decode_frame(frame) == (0.25, 21.5, -3.5, 1234.5)
    assert [litegrip.encode_ready_frame(ready) for ready in (True, False)] == [b"\1", b"\0"]
    assert litegrip.decode_ready_frame(b"\xff")
    for decode, wrong in ((litegrip.decode_frame, bytes(31)), (litegrip.decode_ready_frame, b"")):
        with pytest.raises(ValueError, match="bytes are no"):
            decode(wrong)
    assert litegrip.teleop_topic() == "litearm/v4/gripA/gripper_teleop"
    assert litegrip.ready_topic("left") == "litearm/v4/left/gripper_ready"


def test_errors_say_their_code() -> None:
    plain, coded = litegrip.CommandError("no"), litegrip.HardwareError("x", 9)
    assert (str(plain), plain.message, plain.error_code, plain.args) == ("no", "no", None, ("no",))
    assert (str(coded), coded.args) == ("x [0x0009]", ("x",))
    assert "0x3" in litegrip.describe_error(3)
    assert all(
        litegrip.describe_error(code) == text
        for code, text in litegrip.constants.ERROR_DESCRIPTIONS.items()
    )


def test_states() -> None:
    state = litegrip.GripperState()
    assert (state.has_data, state.is_stale, state.is_enabled, state.is_error) == (
        False,
        True,
        False,
        False,
    )
    state = litegrip.GripperState(error_code=13, velocity_rad_s=-0.02, data_age_s=0.1)
    assert (state.is_error, state.is_moving, state.is_stale) == (True, True, False)
    assert litegrip.GripperState(position_mm=40.0).aperture_mm == 40.0
    config = litegrip.GripperConfig()
    assert (config.close_sign, config.mount) == (1.0, None)
    assert (NORMAL.mount, REVERSE.mount) == ("normal", "reverse")


def test_a_trajectory_is_a_file(tmp_path: object) -> None:
    rows = [litegrip.TrajectorySample(0.1 * n, 0.1 * n, -0.2) for n in range(5)]
    one = litegrip.Trajectory(rows, 50.0, 12.0, 8, 0.0, -1.5, 50.0, "normal")
    path = one.save(f"{tmp_path}/pick.lgt")
    assert litegrip.Trajectory.load(path) == one
    assert [len(one), one.duration] == pytest.approx([5, 0.4])
    assert one.openness_at(0.25) == pytest.approx(0.25)
    assert [one.openness_at(-1.0), one.openness_at(9.0)] == pytest.approx([0.0, 0.4])
    with pytest.raises(litegrip.TrajectoryEmptyError):
        litegrip.Trajectory().openness_at(0.0)
    assert len(litegrip.Trajectory().to_bytes()) == 66  # it is written, only not read
    with pytest.raises(litegrip.TrajectoryFormatError):
        litegrip.Trajectory.from_bytes(litegrip.Trajectory().to_bytes())
    with pytest.raises(litegrip.TrajectoryError):
        litegrip.Trajectory(mount="upside down").to_bytes()
    with pytest.raises(FileNotFoundError) as missing:
        litegrip.Trajectory.load(f"{tmp_path}/none.lgt")
    assert missing.value.filename == f"{tmp_path}/none.lgt"


def test_names_of_files(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", "/tmp/taught")
    assert litegrip.trajectory_dir() == "/tmp/taught"
    assert litegrip.resolve_path("pick") == "/tmp/taught/pick.lgt"
    assert litegrip.resolve_path("pick.lgt") == "/tmp/taught/pick.lgt"
    assert litegrip.resolve_path("./pick") == "./pick"
    monkeypatch.setenv("LITEGRIP_CALIB", "/tmp/one.json")
    assert litegrip.default_calib_path("can1") == "/tmp/one.json"
    monkeypatch.delenv("LITEGRIP_CALIB")
    assert litegrip.default_calib_path("can1").endswith("/.litegrip/can1_calibration.json")


def test_a_link_inside_the_process() -> None:
    bus = litegrip.InProcTeleopTransport(fifo_depth=2)
    one, other = bus.sub("t"), bus.sub("t")
    for payload in (b"a", b"b", b"c"):
        bus.pub("t", payload)
    bus.pub("another", b"x")
    assert [one.try_recv(), one.try_recv(), one.try_recv()] == [b"b", b"c", None]
    assert other.drain_latest() == b"c"


def test_a_link_over_udp() -> None:
    with pytest.raises(ValueError, match="needs"):
        litegrip.UdpTeleopTransport()
    ends = litegrip.UdpTeleopTransport(bind_addr="127.0.0.1:0")
    port = ends._socket.getsockname()[1]
    sends = litegrip.UdpTeleopTransport(("127.0.0.1", port))
    came = ends.sub("whatever")
    sends.pub("t", b"payload")
    assert came.try_recv() == b"payload"
    assert came.try_recv() is None
    with pytest.raises(litegrip.TeleopError):
        sends.sub("t")
    with pytest.raises(OSError, match="in use"):
        litegrip.UdpTeleopTransport(bind_addr=("127.0.0.1", port))
    sends.close()
    ends.close()
    assert came.try_recv() is None


def test_the_bus_is_refused_with_the_way() -> None:
    with pytest.raises(litegrip.CommandError, match=r"LiteGrip\(channel\)\.connect"):
        can.CanTransport("can0").open()
    controller = can.MotorController(can.CanTransport("can0"))
    with pytest.raises(litegrip.CommandError, match="send_mit_frame"):
        controller.control_mit(None, 1, 2, 3)


def test_constants_can_be_printed_as_json() -> None:
    assert json.dumps({"mode": can.protocol.ControlMode.VEL_MODE}) == '{"mode": 512}'
