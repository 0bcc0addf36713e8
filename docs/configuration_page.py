"""Make the page on the configuration, and the commented file of defaults, from the daemon's tables.

What a key means stands in `litegripd/app/config.py`; what a field of the motions' defaults
means stands here.
"""

import textwrap
from typing import Any

from litegripd.app.config import KEYS, SAME_TABLES, TABLES, Key, load
from litegripd.model.gripper import DM4310, MOTOR_FAMILY, MOTOR_TYPES, IncompleteType
from litegripd.model.motion_config import MotionConfig, ranges_of
from litegripd.sim.gripper import OPTIONS

KINDS = {
    str: "string",
    int: "integer",
    float: "number",
    list: "array of integers",
    tuple: "array of strings and integers",
}
MEANINGS = {
    "speed_mm_s": "Speed of `open`, `close` and `move`, mm/s.",
    "grasp_speed_mm_s": "Closing speed of a grasp, mm/s.",
    "margin": "Share of the travel that a grasp leaves before the closed stop.",
    "sample_interval": "How often a stall is looked for, s.",
    "settle_s": "How long a move holds at its end before it answers, s.",
    "reach_tol": "How close to its target counts as reached, rad.",
    "stall_cycles": "Samples in the window of the stall test.",
    "stall_ratio": "Less than this share of the expected way is a stall.",
    "stall_delta": "The least way in the window that is none, rad.",
    "max_lead_mm": "How hard the lead pushes on the way: 1.34 N·m for each mm, 2 N·m at most;"
    " `open`, `close` and `move` push at least with 2 N·m · speed / 150 mm/s.",
    "press_overshoot": "Share of the travel by which `open` and `close` aim past the stop.",
    "press_zone_mm": "From how near the stop on `stop_lead_mm` counts, mm.",
    "stop_lead_mm": "How hard the command's lead presses there: 1.34 N·m for each mm, 0.94 N·m.",
    "stop_tol": "How close to the calibrated stop counts as pressed home, rad.",
    "force_n": "Force of a grasp, N; 10 N are about 1 N·m.",
    "force_rate_n_s": "How fast a force is ramped, N/s.",
    "hold_interval": "A hold by gains: how often the position is read, s; a slice of a hold.",
    "hold_kp": "A hold by gains: stiffness, N·m/rad.",
    "hold_kd": "A hold by gains: damping, N·m·s/rad.",
    "stop_torque_nm": "Torque guard of `open` and `close` on their way: where it begins, N·m.",
    "stop_torque_cycles": "So many samples in a row with it, and slow jaws, make it let go.",
    "stop_release_s": "For how long it lets go, s.",
    "enable_retries": "Attempts to enable the motor.",
    "enable_retry_interval": "Time between them, s.",
    "calib_kp": "Stiffness of the probe of `zero`, N·m/rad.",
    "calib_kd": "Its damping, N·m·s/rad.",
    "calib_step_rad": "How far its command leads the jaws, rad.",
    "calib_tau_limit": "The probe freezes when the torque reaches this, N·m;"
    " less cannot be told from jaws that stick. A hard probe may exceed it for a moment.",
    "calib_stall_delta": "Less way than this in a sample is standing still, rad.",
    "calib_stall_cycles": "So many samples of standing still are a stop.",
    "calib_max_iter": "Samples at most on the way to one stop.",
}
HEAD = """# Configuration

<!-- Made by docs/generate.py from the daemon's tables; not to be edited. -->

`litegripd can0` reads `/etc/litegripd/can0.toml`; if there is none,
`/etc/litegripd/litegripd.toml`; if there is none either, it takes the defaults. `--config FILE`
names another file. Only one file is read. [etc/litegripd.toml](../etc/litegripd.toml) has every key
with its default, to be copied and changed; [etc/slcan.toml](../etc/slcan.toml) is one for a serial
adapter.

An unknown key, a wrong type or an impossible value is refused at the start, with exit code 2 and a
line that names the file, the key and what is allowed; `litegripd can0 --check` does only that, and
ends with 0 where all is right. Only the arguments of python-can's interfaces it cannot judge: a
wrong one shows, if at all, when the bus is opened, in the log and in what is refused. It also reads
the calibration file that `mount` or LITEGRIP_CALIB names, and judges it as the daemon will: one
that cannot be used is exit code 2, though the daemon would start with it and refuse motions.
`--socket`, `--interface` and `--simulate` of the command line win over the file.
"""
REREAD = """## What can be read again

The file is read at the start, and by `litegripctl restart --hold`, for admins, which lets the jaws
hold on. That takes over changes in {free}.

A change in {fixed} is refused, with the reason `restart_failed`,
for what is held depends on them. `systemctl restart litegripd@can0` reads everything anew, and
disables the motor. So does ending and starting a daemon by hand, and there is no other way for one
that simulates.
"""
MOTIONS = """## The motions' defaults

They are no part of the file. `litegripctl config` shows them. `litegripctl config set
speed_mm_s=25`, for admins, changes one until the daemon ends, with `--keep` for good: then the
daemon writes it to its state directory. A request may bring its own values, which count for that
request only: `MotionConfig` in Python, `config` in the [protocol](protocol.md). So they are no
caps: none can be set for force or speed, and whoever may move may ask for all that the ranges
allow. To keep a user from that, make an observer of them (`[access]`). The ranges are with
a DM4310; `litegripctl config` shows those with the configured motor.

| field | range | default | meaning |
| --- | --- | --- | --- |"""
ENVIRONMENT = """
## Where the daemon keeps its files

In `$STATE_DIRECTORY`, which systemd sets to `/var/lib/litegripd`. Without it, in
`/var/lib/litegripd` where it may write there, else in `~/.local/state/litegripd`. There are the
calibration of each channel, the motions' defaults that were kept, `trajectories/` and
`dumps/<channel>/`. `LITEGRIP_CALIB` in the daemon's environment names a calibration file that
counts before all others but `mount`.
"""


MOTOR_TYPES_HEAD = """\
What follows from the type of the motor; the ranges are those from the factory, the motor's own are
used. More than the most force and speed is refused; the speed is the motor's, and 150 mm/s at most.

| type | gear | ranges | for long | peak, 0.5 s | most force | most speed |
| --- | ---: | --- | ---: | ---: | ---: | ---: |"""


INCOMPLETE_HEAD = """\
The family has more types. Of these figures are missing, so the daemon cannot drive them: it refuses
them, here and in a calibration file.

| type | known | missing |
| --- | --- | --- |"""


def configuration_page() -> str:
    """Make the page."""
    sections = [f"## [{table}]\n\n{about}\n\n{_table(table)}\n" for table, about in TABLES.items()]
    rows = (f"| `{row.name}` | {KINDS[row.kind]} | {row.meaning} |" for row in OPTIONS)
    head = (
        'With `interface = "litegrip_sim"` it takes these, too, and no others:\n\n'
        "| key | type | meaning |\n| --- | --- | --- |"
    )
    sections[0] += "\n".join(["", head, *rows, ""])
    sections[list(TABLES).index("motor")] += _motor_types()
    fixed = _listed([f"`[{table}]`" for table in SAME_TABLES])
    free = _listed([f"`[{table}]`" for table in TABLES if table not in SAME_TABLES])
    motions = [
        f"| `{name}` | {low:g} to {high:g} | {getattr(MotionConfig(), name):g} | {MEANINGS[name]} |"
        for name, (low, high) in ranges_of(DM4310).items()
    ]
    parts = [HEAD, *sections, REREAD.format(free=free, fixed=fixed), MOTIONS]
    return "\n".join([*parts, *motions, ENVIRONMENT])


def default_file() -> str:
    """Make the commented file of defaults."""
    lines = [
        "# Configuration of litegripd; made by docs/generate.py.",
        "# A channel's own file, /etc/litegripd/<channel>.toml, is read if it exists, else",
        "# /etc/litegripd/litegripd.toml, else the defaults, which are the values shown here.",
        "# What is commented out shows an example. An unknown key, a wrong type or an impossible",
        "# value is refused at the start.",
    ]
    for table, about in TABLES.items():
        lines += ["", *_comment(about), f"[{table}]"]
        for key in (key for key in KEYS if key.table == table):
            mark = "" if has_default(key) else "# "
            lines += [*_comment(sentence(key)), f"{mark}{key.name} = {key.shown}"]
    return "\n".join([*lines, ""])


def _motor_types() -> str:
    """Make the table of the types of motor."""
    rows = [
        f"| `{row.name}`{', **never tried**' if row.is_untried else ''} | {row.gear_ratio:g}"
        f" | ±{row.ranges.position_rad:g} rad, ±{row.ranges.velocity_rad_s:g} rad/s,"
        f" ±{row.ranges.torque_nm:g} N·m | {row.rated_nm:g} N·m | {row.peak_nm:g} N·m"
        f" | {row.most_force_n:g} N | {row.fastest_rad_s:g} rad/s |"
        for row in MOTOR_TYPES.values()
    ]
    incomplete = [row for row in MOTOR_FAMILY.values() if isinstance(row, IncompleteType)]
    missing = [
        f"| {', '.join(f'`{row.name}`' for row in incomplete if row.missing == lacks)}"
        f" | {', '.join(knows) or 'nothing'} | {', '.join(lacks)} |"
        for knows, lacks in dict.fromkeys((row.known, row.missing) for row in incomplete)
    ]
    return "\n".join(["", MOTOR_TYPES_HEAD, *rows, "", INCOMPLETE_HEAD, *missing, ""])


def _table(table: str) -> str:
    rows = [
        f"| `{key.name}` | {KINDS[key.kind]} | {_allowed(key)} "
        f"| {f'`{key.shown}`' if has_default(key) else ''} | {_escaped(key.meaning)} |"
        for key in KEYS
        if key.table == table
    ]
    head = ["| key | type | allowed | default | meaning |", "| --- | --- | --- | --- | --- |"]
    return "\n".join([*head, *rows])


def has_default(key: Key) -> bool:
    """Whether leaving the key out means a value that could be written."""
    return (key.table, key.name) != ("bus", "channel") and _default(key) not in (None, ())


def _default(key: Key) -> Any:
    return getattr(getattr(load("can0", None), key.table), key.name, None)


def _allowed(key: Key) -> str:
    if key.choices:
        return ", ".join(f'"{choice}"' for choice in key.choices)
    if key.kind in (int, float):
        return f"{_number(key, key.low)} to {_number(key, key.high)}"
    return ""


def _number(key: Key, value: float) -> str:
    is_id = key.shown.startswith("0x")
    return f"0x{int(value):02X}" if is_id else f"{value:.0f}"


def sentence(key: Key) -> str:
    """Return what a key means, and what it may be."""
    allowed = _allowed(key)
    return f"{key.meaning} Allowed: {allowed}." if allowed else key.meaning


def _comment(text: str) -> list[str]:
    wrapped = textwrap.wrap(text, 97, break_long_words=False, break_on_hyphens=False)
    return [f"# {line}" for line in wrapped]


def _escaped(text: str) -> str:
    """Escape what would be a tag to a reader of Markdown."""
    return text.replace("<", "&lt;").replace("|", "\\|")


def _listed(names: list[str]) -> str:
    return f"{', '.join(names[:-1])} and {names[-1]}"
