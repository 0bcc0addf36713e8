"""The checks of what hangs on the bus: the motor, its registers, the calibration.

Facts in, findings out; nothing is asked. All of it is known from the daemon alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from litegrip_client.ctl.doctor.facts import Daemon, Facts
from litegrip_client.ctl.findings import Finding, error, ok, warning
from litegrip_client.values.fields import SPAN_INSET_MM, STROKE_MM
from litegrip_client.values.results import USABLE_BUS
from litegrip_client.values.terms import told

MIT_MODE = 1
CAN_BR_1_MBIT_S = 4
TIMEOUT_UNIT_S = 50e-6
SEEN_S = "0.1 to 0.9 s, whatever it held"
LONGEST_WATCHDOG_S = 0.4
"""The longest that motors are known to come with; the daemon takes a longer one for off."""

MODEL_RANGES = {
    "DM4310": {"PMAX": 12.5, "VMAX": 30.0, "TMAX": 10.0},
    "DM4340": {"PMAX": 12.5, "VMAX": 10.0, "TMAX": 28.0},
}
"""rad, rad/s and N·m: what a motor of each type leaves the factory with."""

BIT_RATES = {0: "125 kbit/s", 1: "200 kbit/s", 2: "250 kbit/s", 3: "500 kbit/s", 4: "1 Mbit/s"}
"""By the code of register can_br."""

IMPLAUSIBLE_OUTSIDE_RAD = 1.0
"""Further outside the calibrated travel the daemon moves no jaws, for none can be there."""

STROKE_TOLERANCE_MM = 2.0
"""By how much calibration and configuration may differ; a template has 1 mm too much."""
SUPERSEDED_STROKE_MM = 120.0

_RESTING: Mapping[str, tuple[str, str | None]] = {
    "communication_lost": (
        "'communication lost' is normal after a second without commands, and enabling clears it",
        None,
    ),
    "under_voltage": (
        "its power stage has, or had, no supply while it is not used",
        "see that its 24 V are on before you enable it",
    ),
}
"""By the status of a disabled motor: what it means, and what to do, if anything."""
_LOOK_AT_MOUNT = "closing may have the other direction: look at its mount first"

MOST_LOAD = 0.8
"""The daemon and a motor take 5% at 200 Hz; with so much, frames wait for each other."""
FLAPS = 3
"""So often, and once an hour at least, a bus is not lost by somebody who repairs it."""
_HOUR_S, _DAY_S = 3600.0, 86_400.0
_SET = "with the maker's tool, while the daemon does not run"
_NO_ANSWER = (
    "switch its 24 V on and look at its plug; it is expected at 0x%02X, at 1 Mbit/s; if it may have"
    " another id: %s doctor --scan"
)


def bus(facts: Facts) -> Finding | None:
    """Check that the daemon can use the bus."""
    if facts.daemon is None or not (figures := facts.daemon.health.get("bus")):
        return None
    if figures.get("state") == "bus_stalled" and not _is_in_use(facts.daemon):
        return warning(
            "nobody on it acknowledges a frame, as with a motor without power; nobody uses the"
            " gripper, so nothing is lost",
            advice="to use it: switch the motor's 24 V on, and look at its plug",
        )
    if figures.get("state") not in USABLE_BUS:
        return error(
            f"the daemon cannot use it ({figures.get('state')}): {figures.get('error')}",
            advice="fix what is found above, else what this error names; the daemon then continues",
        )
    load = figures.get("load") or 0.0
    text = f"the daemon uses it, load {load:.0%}, {figures.get('send_failures')} lost frames"
    if load >= MOST_LOAD:
        return warning(
            f"{text}: somebody fills it, and commands come late",
            f"candump {facts.bus_channel}" if facts.interface == "socketcan" else None,
            "end who sends so much; a gripper needs a bus of its own",
        )
    reopened, uptime_s = figures.get("reopened") or 0, facts.daemon.health.get("uptime_s") or 0.0
    if reopened >= FLAPS and reopened * _HOUR_S >= uptime_s:
        return warning(
            f"{text}; it was lost and opened again {reopened} times in {uptime_s / _HOUR_S:.1f} h",
            "sudo dmesg | tail",
            "a loose plug, cable or hub, or a program that sets the link down: see who",
        )
    return ok(text)


def motor(facts: Facts) -> Finding | None:
    """Check that the motor answers and reports no fault; one that nobody uses may rest."""
    daemon = facts.daemon
    if daemon is None or not _bus_is_up(daemon):
        return None
    state = daemon.state
    phase, age_s = state.get("motor"), state.get("age_s")
    age = "no feedback yet" if age_s is None else f"last feedback {age_s:.3f} s ago"
    if phase == "fault":
        status = state.get("status")
        advice = "enabling clears the fault: find its cause first"
        if status == "communication_lost":
            advice += "; the line health says if the bus or the daemon itself was silent"
        is_hot = status in ("coil_hot", "driver_hot")
        if is_hot:
            advice = f"let it cool down, and look at what it holds; then: {facts.ctl} enable"
        command = None if is_hot else f"{facts.ctl} enable"
        return error(f"it reports a fault: {status}, {age}", command, advice)
    if phase in ("silent", "unknown") or state.get("stale") or age_s is None:
        can_id = daemon.hello.get("motor", {}).get("can_id", 0x08)
        advice = _NO_ANSWER % (can_id, facts.ctl)
        if _is_in_use(daemon):
            return error(f"{phase}, {age}", advice=advice)
        text = "it does not answer, which is normal while its power is off, and nobody uses it"
        return warning(f"{phase}, {age}: {text}", advice=advice)
    if phase == "disabled" and state.get("status") in _RESTING:
        meaning, remedy = _RESTING[state["status"]]
        text = f"{phase}, {age}: {meaning}"
        return ok(text) if remedy is None else warning(text, advice=remedy)
    return ok(f"{phase}, {age}")


def stop(facts: Facts) -> Finding | None:
    """Check that no stop is latched, with which motions are refused; None where that is so."""
    latched = None if facts.daemon is None else facts.daemon.state.get("stop")
    if not latched:
        return None
    why = f": {latched['why']}" if latched.get("why") else ""
    return warning(
        f"a stop of {latched.get('by')} is latched, and motions are refused{why}",
        f"{facts.ctl} clear",
        "when it is safe",
    )


def _is_in_use(daemon: Daemon) -> bool:
    """Return False if nobody misses the motor; an older daemon does not say so."""
    return bool(daemon.health.get("motor", {}).get("in_use", True))


def scan(facts: Facts) -> Finding | None:
    """Check which ids have a motor, where the ids were asked."""
    found = facts.scan
    if found is None:
        return None
    if found.problem is not None:
        command = f"{facts.ctl} disable" if facts.is_enabled else None
        return error(
            f"no id was asked: {found.problem}",
            command,
            f"then again: {facts.ctl} doctor --scan",
        )
    own = 0x08
    if facts.daemon is not None:
        own = int(facts.daemon.hello.get("motor", {}).get("can_id", own))
    listed = ", ".join(f"0x{one:02X} (answers on 0x{on:02X})" for one, on in found.found.items())
    if own in found.found:
        others = "" if len(found.found) == 1 else "; a gripper has one motor: others are not its"
        return ok(f"motors answer at: {listed}{others}")
    if found.found:
        first = next(iter(found.found))
        configured = None if facts.daemon is None else facts.daemon.info.get("configuration", {})
        file = (configured or {}).get("file") or f"/etc/litegripd/{facts.channel}.toml"
        return error(
            f"nothing answers at 0x{own:02X}, but motors do at: {listed}",
            None if facts.unit is None else f"sudo systemctl restart {facts.unit}",
            f"first set [motor] can_id = 0x{first:02X} in {file}",
        )
    span = f"0x{found.asked[0]:02X} to 0x{found.asked[-1]:02X}" if found.asked else "the ids"
    return error(
        f"no motor answers at {span}",
        advice="switch its 24 V on and look at its plug. A motor that is set to 5 Mbit/s (CAN FD)"
        " or another bit rate cannot be found over this bus at 1 Mbit/s: connect it by itself to"
        f" the maker's tool, at its serial port, and set register 35 (can_br) to {CAN_BR_1_MBIT_S},"
        " and register 8 (ESC_ID) to what [motor] can_id says",
    )


def other_master(facts: Facts) -> Finding | None:
    """Check that nobody else commands the motor."""
    counters = facts.daemon.health.get("motor") if facts.daemon is not None else None
    if not counters or "foreign_commands" not in counters:
        return None
    count = counters["foreign_commands"]
    if not count:
        return ok("nobody but the daemon commands the motor")
    text = f"another program has sent the motor {count} frames"
    watch = f"candump {facts.bus_channel}" if facts.interface == "socketcan" else None
    if counters.get("foreign_active", True):  # an older daemon does not report it
        advice = "end that program, or let it use the daemon"
        return error(f"{text}, and continues: a second master", watch, advice)
    return warning(
        f"{text} since the daemon was started; it is quiet now",
        advice="should that program come back, motions are refused: let it use the daemon",
    )


def control_mode(facts: Facts) -> Finding | None:
    """Check that the motor takes MIT commands."""
    mode = _registers(facts).get("CTRL_MODE")
    if mode is None:
        return None
    if mode == MIT_MODE:
        return ok("CTRL_MODE 1, MIT")
    text = f"CTRL_MODE is {mode}, not {MIT_MODE} (MIT): the motor cannot be enabled"
    return error(text, advice=f"set register 10 to {MIT_MODE} {_SET}")


def bit_rate_code(facts: Facts) -> Finding | None:
    """Check the bit rate that the motor will have after its next power-on."""
    code = _registers(facts).get("can_br")
    if code is None:
        return None
    text = f"can_br {code}, {BIT_RATES.get(int(code), 'unknown')}"
    if code == CAN_BR_1_MBIT_S:
        return ok(text)
    advice = f"set register 35 to {CAN_BR_1_MBIT_S} {_SET}"
    return warning(f"{text}, where 1 Mbit/s ({CAN_BR_1_MBIT_S}) is expected", advice=advice)


def ids(facts: Facts) -> Finding | None:
    """Check the ids under which the motor is commanded and answers."""
    registers, daemon = _registers(facts), facts.daemon
    master_id, own_id = registers.get("MST_ID"), registers.get("ESC_ID")
    if daemon is None or master_id is None:
        return None
    can_id = int(daemon.hello.get("motor", {}).get("can_id", 0x08))
    text = f"commanded by 0x{can_id:02X}, answers on 0x{int(master_id):02X}"
    if own_id not in (None, can_id):
        return error(
            f"{text}, but its ESC_ID is 0x{int(own_id):02X}",
            advice=f"set [motor] can_id = 0x{int(own_id):02X} and restart the daemon",
        )
    advice = f"set register 7 (MST_ID) to 0x{can_id + 0x10:02X} {_SET}"
    if master_id == can_id:
        return error(f"{text}: commands and answers cannot be told apart", advice=advice)
    if master_id == 0:
        return warning(f"{text}: MST_ID was never set, so two motors would collide", advice=advice)
    return ok(text)


def watchdog(facts: Facts) -> Finding | None:
    """Check that the motor lets go by itself when no commands come any more."""
    timeout = _registers(facts).get("TIMEOUT")
    if timeout is None:
        return None
    timeout_s = timeout * TIMEOUT_UNIT_S
    if 0.0 < timeout_s <= LONGEST_WATCHDOG_S:
        return ok(
            f"TIMEOUT {timeout:.0f}, on; by it the motor lets go {timeout_s * 1e3:.0f} ms after a"
            f" loss, but motors have taken {SEEN_S}"
        )
    text = "TIMEOUT is 0, off" if not timeout else f"TIMEOUT is {timeout_s:g} s"
    return warning(
        f"{text} after power-on; the daemon sets it to 100 ms before it enables",
        advice=f"for other programs, too: set register 9 to 2000 and save it, {_SET}",
    )


def ranges(facts: Facts) -> Finding | None:
    """Check the ranges that the motor's frames span."""
    registers = _registers(facts)
    motor = {} if facts.daemon is None else facts.daemon.hello.get("motor", {})
    model = MODEL_RANGES.get(motor.get("type", "DM4310"), {})
    read = {name: registers.get(name) for name in model}
    if not read or any(value is None for value in read.values()):
        return None
    listed = ", ".join(f"{name} {value:g}" for name, value in read.items())
    if read == model:
        return ok(f"{listed}, the model's")
    usual = ", ".join(f"{value:g}" for value in model.values())
    return warning(
        f"{listed} instead of the model's {usual}; the motor's own are used",
        advice="nothing to do with this daemon; programs that assume the model's would be wrong",
    )


def calibration(facts: Facts) -> Finding | None:
    """Check that the travel is known, was measured on this gripper, and is right in mm."""
    daemon = facts.daemon
    if daemon is None:
        return None
    gripper, source = daemon.hello.get("gripper", {}), _calibration(daemon)
    if not gripper.get("calibrated"):
        return _uncalibrated(facts, source)
    text = f"mount {gripper.get('mount')}, travel {gripper.get('travel_mm', 0.0):.1f} mm"
    if gripper.get("work_stroke_mm") is not None:
        text += f", open goes to {gripper['work_stroke_mm']:g} mm"
    file = source.get("file")
    doubt, where = daemon.state.get("scale_doubt"), "" if file is None else f", {file}"
    if doubt == "superseded":
        return warning(
            f"{text}{where}: the scale of earlier versions, which took the travel for 120 mm; all"
            " mm are too large",
            f"{facts.ctl} calibration rescale",
            "that needs no other measurement; if a caliper says that the jaws do not open"
            f" {gripper.get('stroke_mm', STROKE_MM):g} mm, add --stroke-mm MM",
        )
    if doubt == "unusual":
        return warning(
            f"{text}{where}: {gripper.get('rad_to_mm', 0.0):.4g} mm/rad, as no gripper was seen to"
            " have",
            f"{facts.ctl} enable && {facts.ctl} zero",
            "its limits are probably wrong; if a caliper says that the jaws do not open"
            f" {gripper.get('stroke_mm', STROKE_MM):g} mm, then:"
            f" {facts.ctl} calibration rescale --stroke-mm MM",
        )
    if source.get("work_stroke"):
        return warning(
            f"{text}{where}: {source['work_stroke']}",
            advice=f"then have the file read again: {facts.ctl} calibration load --chain",
        )
    if source.get("nominal"):
        return warning(
            f"{text}, nominal: it was not measured on this gripper",
            f"{facts.ctl} enable && {facts.ctl} zero",
        )
    if file is None:
        return warning(f"{text}, in no file: lost at a restart", f"{facts.ctl} calibration save")
    named = (daemon.info.get("configuration") or {}).get("gripper", {}).get("calibration")
    if named not in (None, file):
        return warning(
            f"{text}, {file}: at its next start the daemon takes {named}, which [gripper] mount or"
            " LITEGRIP_CALIB names",
            advice=f'to keep this one, set mount = "{gripper.get("mount")}" in [gripper]: what the'
            " daemon has measured of such a mount counts then",
        )
    return ok(f"{text}, {_age(facts.now_s, source.get('saved_s'))}, {file}")


def _uncalibrated(facts: Facts, source: Mapping[str, Any]) -> Finding:
    if source.get("problem"):
        return error(
            f"none, and motions are refused: {source['problem']}",
            advice=f"repair that file and have it read again: {facts.ctl} calibration load --chain;"
            f" or measure again: {facts.ctl} enable"
            f" && {facts.ctl} zero --mount normal (or reverse)",
        )
    return warning(
        "none: motions are refused",
        advice=f"load the mount's template: {facts.ctl} calibration load normal (or reverse);"
        f" then measure: {facts.ctl} enable && {facts.ctl} zero",
    )


def stroke(facts: Facts) -> Finding | None:
    """Check that the configured stroke is not the placeholder of earlier versions."""
    daemon = facts.daemon
    content = facts.configuration.content if facts.configuration is not None else None
    found = content if daemon is None else daemon.info.get("configuration")
    stroke_mm = ((found or {}).get("gripper") or {}).get("stroke_mm")
    if stroke_mm is None:
        return None
    if stroke_mm != SUPERSEDED_STROKE_MM:
        gripper = {} if daemon is None else daemon.hello.get("gripper", {})
        travel_mm = gripper.get("travel_mm")
        opens_mm = stroke_mm if travel_mm is None else travel_mm - SPAN_INSET_MM
        if abs(opens_mm - stroke_mm) > STROKE_TOLERANCE_MM:
            return warning(
                f"by the configuration the jaws open {stroke_mm:g} mm, by the calibration"
                f" {opens_mm:.1f} mm",
                f"{facts.ctl} calibration rescale",
                "if a caliper agrees with the configuration; else correct stroke_mm in [gripper]",
            )
        return ok(f"the jaws open {stroke_mm:g} mm, as configured")
    file = (found or {}).get("file") or "the configuration"
    return warning(
        f"stroke_mm = {stroke_mm:g} under [gripper] in {file} is the placeholder of earlier"
        f" versions, and counts as {STROKE_MM:g} mm",
        advice=f"remove stroke_mm from {file}, or set it to what a caliper measures",
    )


def position(facts: Facts) -> Finding | None:
    """Check that the jaws can be where the motor says that they are."""
    daemon = facts.daemon
    if daemon is None or not _bus_is_up(daemon) or daemon.state.get("stale"):
        return None
    gripper, position_rad = daemon.hello.get("gripper", {}), daemon.state.get("position_rad")
    ends_rad = (gripper.get("closed_rad"), gripper.get("open_rad"))
    if position_rad is None or None in ends_rad:
        return None
    low_rad, high_rad = sorted(ends_rad)
    text = f"{position_rad:.3f} rad, calibrated travel {low_rad:.3f} to {high_rad:.3f} rad"
    if max(low_rad - position_rad, position_rad - high_rad) <= IMPLAUSIBLE_OUTSIDE_RAD:
        return ok(text)
    mount = gripper.get("mount") or "normal (or reverse)"
    return error(
        f"{text}: no jaw can be there, and motions are refused",
        advice="the motor may have lost its count of turns: power-cycle it with the jaws inside"
        f" the travel; if it is still off: {facts.ctl} enable && {facts.ctl} zero --mount {mount}",
    )


def calibration_channel(facts: Facts) -> Finding | None:
    """Check that the calibration is this gripper's and not another channel's."""
    source = {} if facts.daemon is None else _calibration(facts.daemon)
    channel, foreign = source.get("channel"), source.get("foreign")
    if foreign:
        text = told(source, "foreign", facts.voice)
        return warning(text, f"{facts.ctl} enable && {facts.ctl} zero", _LOOK_AT_MOUNT)
    if facts.daemon is None or channel is None:
        return None
    # A gripper of another machine is called otherwise there.
    own = (facts.daemon.hello.get("remote") or {}).get("channel", facts.channel)
    if channel == own:
        return ok(f"the calibration is for {channel}")
    return warning(
        f"the calibration is for {channel}, this is {own}",
        f"{facts.ctl} enable && {facts.ctl} zero",
        _LOOK_AT_MOUNT,
    )


def _bus_is_up(daemon: Daemon) -> bool:
    return daemon.health.get("bus", {}).get("state", "up") in USABLE_BUS


def _registers(facts: Facts) -> Mapping[str, Any]:
    return {} if facts.daemon is None else facts.daemon.info.get("registers", {})


def _calibration(daemon: Daemon) -> Mapping[str, Any]:
    """Return where the calibration came from; an older daemon reports only the file."""
    facts = daemon.info.get("calibration")
    return facts if isinstance(facts, Mapping) else {"file": daemon.info.get("calibration_file")}


def _age(now_s: float, saved_s: object) -> str:
    if not isinstance(saved_s, int | float):
        return "of unknown date"
    days = (now_s - saved_s) / _DAY_S
    if days < -1.0:
        return f"dated {-days:.0f} days ahead of this machine's clock"
    return "of today" if days < 1.0 else f"{days:.0f} days old"
