"""The keys of the configuration: what each may be, and what it means.

This is the one definition. `config.py` checks by it; docs/generate.py makes docs/configuration.md
and the commented etc/litegripd.toml of it. A key that is not here is unknown.
"""

import math
from dataclasses import dataclass

from litegripd.model.motor_types import DM4310, MOTOR_TYPES
from litegripd.rpc.sessions import ROLES

MAX_STANDARD_ID = 0x7FE  # 0x7FF carries register traffic
MAX_CPUS = 1024


@dataclass(frozen=True, slots=True)
class Key:
    """One key of one table.

    `kind` is the type that TOML must give; `list` means CPUs, `tuple` users. `shown` is the default
    as one writes it, or, where leaving the key out means something that no value does, an example.
    """

    table: str
    name: str
    kind: type
    shown: str
    meaning: str
    low: float = -math.inf
    high: float = math.inf
    choices: tuple[str, ...] = ()


TABLES = {
    "bus": "The CAN bus, handed to python-can. Further keys are arguments of the interface, for"
    " example tty_baudrate of slcan.",
    "motor": "The motor on the bus.",
    "gripper": "What the motor moves.",
    "control": "The control thread.",
    "rpc": "The socket for clients. A second one beside it, can0.stop.sock for can0.sock, takes"
    " stops and nothing else.",
    "access": "Who may do what. Whoever may connect may read and stop; these lists say who may do"
    " more. Where several entries fit, the highest role counts. Root and the daemon's own user are"
    " admins in any case.",
    "trajectories": "The named trajectories that the daemon keeps. A limit refuses what would go"
    " beyond it, and removes nothing. What is there from before the daemon noted who had saved it"
    " counts for nobody, until it is replaced.",
    "teleop": "Teleoperation.",
}
"""The tables, in the order in which they are shown, and what each is about."""

KEYS = (
    Key(
        "bus",
        "interface",
        str,
        '"socketcan"',
        'The interface of python-can: "socketcan", "slcan", "gs_usb", ..., or "litegrip_sim", a'
        " simulated gripper.",
    ),
    Key(
        "bus",
        "channel",
        str,
        '"can0"',
        "The interface's channel, for slcan the path of a device. Left out: the daemon's channel.",
    ),
    Key(
        "bus",
        "bitrate",
        int,
        "1000000",
        "Bit/s. For socketcan the system sets it: ip link set can0 type can bitrate 1000000.",
        10_000,
        1_000_000,
    ),
    Key(
        "motor",
        "type",
        str,
        f'"{DM4310.name}"',
        "The type of motor; one of another type is not enabled. Never tried on hardware:"
        f" {', '.join(row.name for row in MOTOR_TYPES.values() if row.is_untried)}.",
        choices=tuple(MOTOR_TYPES),
    ),
    Key(
        "motor",
        "can_id",
        int,
        "0x08",
        "The id that the motor is commanded by (its register ESC_ID).",
        0x01,
        MAX_STANDARD_ID,
    ),
    Key(
        "motor",
        "master_id",
        int,
        "0x18",
        "The id that it answers with (its register MST_ID). Left out: found by itself.",
        0x00,
        MAX_STANDARD_ID,
    ),
    Key(
        "motor",
        "second_master",
        str,
        '"refuse"',
        "When another program commands the motor on the same bus: refuse motions, or only tell of"
        " it.",
        choices=("refuse", "tolerate"),
    ),
    Key(
        "gripper",
        "mount",
        str,
        '"normal"',
        '"normal" or "reverse" declares which way closing runs: what the daemon has measured of'
        " such a mount counts, else its nominal template. Or the absolute path of a calibration"
        " file. Left out: the first that fits of the daemon's own file for this channel,"
        " ~/.litegrip/<channel>_calibration.json, ~/.litegrip/litegrip_calibration.json (of the"
        " daemon's user) and, for can0, the factory's.",
    ),
    Key(
        "gripper",
        "stroke_mm",
        float,
        "120.0",
        "How far the jaws go from stop to stop; a measured travel counts as so many millimetres.",
        1.0,
        1000.0,
    ),
    Key("control", "rate_hz", int, "200", "Ticks a second.", 100, 1000),
    Key(
        "control",
        "priority",
        int,
        "50",
        "Real-time priority (SCHED_FIFO) of the control thread; 0: an ordinary thread, as without"
        " the right to more.",
        0,
        99,
    ),
    Key(
        "control",
        "cpus",
        list,
        "[1]",
        "The CPUs that it may run on. Left out: all.",
    ),
    Key(
        "rpc",
        "socket",
        str,
        '"/run/litegripd/can0.sock"',
        "The absolute path where clients connect. Left out: /run/litegripd/<channel>.sock, or"
        " $XDG_RUNTIME_DIR/litegripd/<channel>.sock for a user who may not write there.",
    ),
    Key("rpc", "group", str, '"litegrip"', "The group whose members may connect."),
    Key(
        "access",
        "default",
        str,
        '"operator"',
        "The role of whoever is in no list: observer (read and stop), operator (also move) or admin"
        " (also take the lease from others and change the daemon's defaults).",
        choices=ROLES,
    ),
    Key(
        "access",
        "admins",
        tuple,
        '["alice", "@lab", 1000]',
        'Users, groups (with an "@") and uids that are admins. Left out: none.',
    ),
    Key("access", "operators", tuple, "[]", "The same for operators."),
    Key("access", "observers", tuple, "[]", "The same for observers."),
    Key(
        "trajectories",
        "most_per_user",
        int,
        "500",
        "How many a user (uid) may have, root and the daemon's own user included.",
        1,
        100_000,
    ),
    Key(
        "trajectories",
        "most_mb_per_user",
        int,
        "500",
        "How many megabytes (10^6 bytes) a user's may have together, with their grips. The longest"
        " recording has 14.4.",
        1,
        1_000_000,
    ),
    Key(
        "teleop",
        "zenoh_config",
        str,
        '"/etc/litegripd/zenoh-tls.json5"',
        "The absolute path of a configuration file of zenoh's own, for TLS and access lists;"
        " etc/zenoh-tls.json5 is one. Left out: the link is open to whoever reaches its port.",
    ),
)
