"""The public names of the vendor's SDK, and the page that says which of them work here."""

import inspect
from typing import Any

import litegrip_client
from litegrip_client import (
    CalibrationData,
    GripperConfig,
    GripperState,
    LiteGrip,
    LiteGripError,
    MotionConfig,
    MoveProgress,
    Trajectory,
    UnitConversion,
)
from litegrip_client.core.actions import GripperActions
from litegrip_client.sdk.refused import Refused, RefusedFunction, RefusedModule


def _names(text: str) -> list[str]:
    return text.split()


EXPORTS = _names("""
    LiteGrip GripperActions GripperConfig CalibrationData GripperState MotionConfig
    MoveResult GraspResult EnableResult MoveProgress UnitConversion Trajectory
    TrajectorySample CALIB_TEMPLATES list_templates LiteGripError CommandError HardwareError
    TeleopNotReady TeleopBusyError TrajectoryBusyError __version__ DEFAULT_CALIB
    default_calib_path limit_target press_target GripperInfo GripperStatus GripperMode
    GripperParams ErrorCode DefaultParams describe_error DM_Motor_Type Control_Mode
    CommError CANTimeoutError NotInitializedError GripperTeleop TeleopTransport
    TeleopSubscription UdpTeleopTransport InProcTeleopTransport TeleopError
    TeleopNotActiveError check_ready clamp_to_calibrated DEFAULT_GRIP_ID DEFAULT_GRIP_PORT
    DEFAULT_DQ_MAX DEFAULT_TORQUE_LIMIT_NM FRAME_SIZE encode_frame decode_frame teleop_topic
    ZenohTeleopTransport Listener Connector LatestSlot TrajectoryRecorder TrajectoryPlayer
    trajectory_dir resolve_path DEFAULT_RATE_HZ TrajectoryError TrajectoryNotActiveError
    TrajectoryEmptyError TrajectoryRecordingError TrajectoryFormatError can MAX_FRAME_GAP_S
    TORQUE_TRIP_CYCLES TORQUE_REARM_OPENNESS
""")
"""What the SDK's packages `litegrip` and `litegrip.teleop` export."""

MEMBERS = _names("""
    connect disconnect channel can_id mst_id is_enabled session disable_on_disconnect
    actions motion_config config enable disable open close grasp goto goto_rad
    move_to move_at_speed move_at_speed_rad set_force send_mit_frame stop home poll
    get_state get_position get_position_rad get_force get_torque get_error get_temperature
    get_info is_moving is_grasped wait_for_ready enter_zero_gravity exit_zero_gravity
    clear_fault read_param set_zero zero calibrate calibrate_manual calibrate_guided
    load_calibration save_calibration load_template mount record record_start record_stop
    play play_start play_stop trajectory_status teleop_start teleop_stop teleop_status
""")
"""What the SDK's `LiteGrip` has."""

FIELDS: dict[Any, list[str]] = {
    GripperState: _names("""
    position_mm position_rad velocity_rad_s torque_nm force_n temperature_mos
    temperature_coil timestamp error_code is_enabled is_error is_moving is_grasped
    aperture_mm
"""),
    MoveProgress: _names("""
    phase i total_steps cmd_rad pos_rad torque_nm delta_rad win_delta_rad temperature_coil
"""),
    CalibrationData: _names("""
    zero_position max_position travel_range calibration_time travel_mm
"""),
    GripperConfig: _names("""
    can_channel can_id mst_id canfd_mode motor_type calibrated pos_closed_rad pos_open_rad
    rad_to_mm kp kd close_sign max_stroke_mm work_stroke_mm nm_to_n grasp_torque_threshold
    mount
"""),
    Trajectory: _names("""
    duration openness_at samples save load
"""),
    UnitConversion: _names("""
    RAD_TO_MM MM_TO_RAD NM_TO_N N_TO_NM
"""),
    MotionConfig: _names("""
    stop_speed_ratio force_ramp_n_s
"""),
    LiteGripError: _names("""
    error_code
"""),
}
"""Fields of the SDK's values."""


def export_refusal(name: str) -> str | None:
    """Return what to use instead of an export that cannot work here; None for one that works."""
    value = getattr(litegrip_client, name)
    if isinstance(value, RefusedFunction | RefusedModule):
        return value.hint
    return value.hint if inspect.isclass(value) and issubclass(value, Refused) else None


def member_refusal(name: str) -> str | None:
    """Return why a member cannot work here; None for one that works."""
    member = inspect.getattr_static(LiteGrip, name)
    function = member.fget if isinstance(member, property) else member
    if getattr(function, "__annotations__", {}).get("return") != "NoReturn":
        return None
    return (inspect.getdoc(function) or "").removeprefix("Raise `CommandError`: ").rstrip(".")


def surface_page() -> str:
    """Make the page."""
    exports = [_row(f"`{name}`", export_refusal(name)) for name in EXPORTS]
    members = [_row(f"`LiteGrip.{name}`", member_refusal(name)) for name in MEMBERS]
    fields = [
        _row(f"`{kind.__name__}.{name}`", None) for kind, names in FIELDS.items() for name in names
    ]
    return "\n".join(
        (
            "# The vendor SDK's names",
            "",
            "Made by `docs/generate.py`. `tests/sdk_surface` checks each name and what it does.",
            "[from-the-sdk.md](../from-the-sdk.md) has what means something else here.",
            "",
            "| name | here |",
            "| --- | --- |",
            *exports,
            *members,
            *fields,
            "",
            "## Names of this package alone",
            "",
            "| name | what it is |",
            "| --- | --- |",
            *_own_rows(),
            "",
        )
    )


def _own_rows() -> list[str]:
    """Return a row for each public name that the SDK does not have."""
    # Of the core first: the client for threads is made of it by the same command as this page.
    members = {
        name: inspect.getattr_static(kind, name)
        for kind in (LiteGrip, GripperActions)
        for name in dir(kind)
        if not name.startswith("_") and name not in MEMBERS
    }
    rows = [
        f"| `LiteGrip.{name}` | {_first_sentence(member)} |"
        for name, member in sorted(members.items())
    ]
    rows += [
        f"| `{name}` | {_first_sentence(getattr(litegrip_client, name))} |"
        for name in litegrip_client.__all__
        if name not in EXPORTS
    ]
    return rows


def _first_sentence(thing: object) -> str:
    """Return the first sentence of what a function, a property or a class says of itself."""
    text = " ".join((inspect.getdoc(thing) or "").split("\n\n")[0].split())
    return text.partition(". ")[0].rstrip(".").replace("|", "\\|")


def _row(name: str, refused: str | None) -> str:
    return f"| {name} | {'works' if refused is None else f'refused: {refused}'} |"
