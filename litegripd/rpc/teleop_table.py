"""The rows of the methods of leader/follower teleoperation."""

from litegripd.model.teleop import (
    DEFAULT_DQ_MAX_RAD_S,
    DEFAULT_GRIP_ID,
    DEFAULT_PORT,
    DEFAULT_REFLECT_GAIN,
    DEFAULT_WATCHDOG_S,
    TeleopStatus,
)
from litegripd.rpc.method import CONFIG, DETACH, Method
from litegripd.rpc.schema import Param

_WHERE = (
    Param(
        "mode",
        "string",
        "Lead (master: the jaws go slack, a hand moves them) or follow (slave).",
        required=True,
        choices=("master", "slave"),
    ),
    Param(
        "host",
        "string",
        "A slave's leader (with udp: the only one that is listened to; default: whoever sends)."
        " With udp a master needs it, too: whom it sends to, one or several (HOST or HOST:PORT,"
        " separated by commas).",
    ),
    Param(
        "port",
        "integer",
        f"Where the leader listens, with udp the follower (default {DEFAULT_PORT}).",
        minimum=1,
        maximum=65_535,
    ),
    Param("grip_id", "string", f"Both ends share it (default {DEFAULT_GRIP_ID})."),
    Param(
        "link",
        "string",
        "How frames travel: zenoh (the default), udp (a trusted network only), or none, with which"
        " a master leads nobody.",
        choices=("zenoh", "udp", "none"),
    ),
    Param(
        "fake_leader",
        "boolean",
        "A slave follows a synthetic sweep, open to closed and back, without a network.",
    ),
)
_HOW = (
    Param(
        "rate_hz",
        "number",
        "How often a master publishes (default: the control rate). A slave follows at the control"
        " rate in any case.",
        minimum=1,
        maximum=1000,
    ),
    Param(
        "watchdog_s",
        "number",
        f"So long without a frame makes a slave hold (default {DEFAULT_WATCHDOG_S:g}).",
        minimum=0.02,
        maximum=10,
    ),
    Param(
        "torque_limit_nm",
        "number",
        "A slave lets go when its torque is at or over it for 60 ms; 0, the default: never.",
        minimum=0,
        maximum=10,
    ),
    Param(
        "force_limit_n",
        "number",
        "A slave pushes by no more (default: as its gains and the lead's cap make it).",
        minimum=1,
        maximum=55,
    ),
    Param(
        "kp", "number", "A slave's stiffness, N·m/rad (default: the calibration's).", False, 1, 500
    ),
    Param(
        "kd",
        "number",
        "A slave's damping, N·m·s/rad, at least kp · 0.002 s (default: the calibration's).",
        minimum=0,
        maximum=5,
    ),
    Param(
        "dq_max",
        "number",
        "Most of the leader's velocity that is fed forward, rad/s; 0: none"
        f" (default {DEFAULT_DQ_MAX_RAD_S:g}).",
        minimum=0,
        maximum=30,
    ),
    Param(
        "reflect",
        "boolean",
        "A slave tells its leader the force that it presses with (default false).",
    ),
    Param(
        "reflect_n",
        "number",
        "A master's jaws push back with what its slaves tell, by no more than this; 0, the default:"
        " they stay slack.",
        minimum=0,
        maximum=10,
    ),
    Param(
        "reflect_gain",
        "number",
        f"Which share of it a master's hand feels (default {DEFAULT_REFLECT_GAIN:g}).",
        minimum=0.05,
        maximum=1,
    ),
)

TELEOP: tuple[Method, ...] = (
    Method(
        "teleop.start",
        "Begin to lead another gripper, or to follow one, until teleop.stop. It answers at once.",
        "The status.",
        TeleopStatus,
        (*_WHERE, *_HOW, CONFIG, DETACH),
        role="operator",
        needs_lease=True,
        stop_voids=True,
    ),
    Method(
        "teleop.stop",
        "End teleoperation, if it runs: the jaws hold where they are, except those that the torque"
        " guard has let go of: they stay free.",
        "The status, as at the end.",
        TeleopStatus,
        role="operator",
        needs_lease=True,
    ),
    Method(
        "teleop.status",
        "Tell how teleoperation goes, or how the last one went.",
        "The status.",
        TeleopStatus,
    ),
)
