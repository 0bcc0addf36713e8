"""The checks of the bus: the network interface and its controller, or another adapter's file.

Facts in, findings out; nothing is asked.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from litegrip_client.ctl.doctor.facts import SIMULATED, Device, Facts
from litegrip_client.ctl.findings import Finding, error, ok, warning
from litegrip_client.socketcan.link import BITRATE, HINDERING, Link, rate_text, switch_off
from litegrip_client.values.figures import LIST_SERIAL
from litegrip_client.values.results import USABLE_BUS

SAMPLE_POINTS = (0.7, 0.9)
"""0.75 is what Linux takes above 800 kbit/s (CiA 301), and 0.875 what many set; within these limits
an adapter's clock may be too coarse to meet them."""

LONGEST_QUEUE_S = 0.1
"""The soonest that a motor has given up by itself, 0.1 s: nothing may wait for longer."""

RATE_HZ = 200.0
"""The daemon's default, if it reports none."""

UNOPENED = ("down", "adapter_gone")
"""States of a bus whose adapter the daemon could not open, or has lost."""

_OTHER_PORT = (
    f"correct [bus] channel ({LIST_SERIAL}), or write the adapter's baud rate behind it:"
    ' channel = "/dev/ttyUSB0@1000000"'
)
_OPENING = (
    ("not supported", "python-can has no such interface: correct [bus] interface, then restart"),
    ("library not found", "install the library that the adapter's maker offers, then restart"),
    ("No module named", "install that module for the daemon's Python, then restart"),
    ("not configure port", "that is no serial adapter: correct [bus] channel, then restart"),
    ("ermission denied", "a daemon of systemd needs: litegripctl install-units --serial"),
    ("No such file", f"plug the adapter in, or correct [bus] channel: {LIST_SERIAL}"),
    ("another program", "end that program; the line serial says if one opens it at every plug"),
    ("frames waited", "give the daemon real-time rights, or this machine fewer programs"),
    ("busy", "another program has it: end that one; the daemon then opens it by itself"),
    ("1 Mbit/s", "use another adapter, or another firmware for this one"),
    ("refuses", "look at the motor's 24 V and plug; then unplug the adapter and plug it in again"),
    ("nothing has come", f"switch the motor's 24 V on; if that is no help: {_OTHER_PORT}"),
    ("SLCAN", f"{_OTHER_PORT}; then restart"),
)
"""What to do about an adapter, by a part of what its driver or the daemon says of it."""

_OPENING_ELSE = "fix what its driver says, or correct [bus] in the configuration and restart"

_NO_RESTART = (None, "gs_usb")
"""Drivers without a restart after bus-off, as those of serial lines, which sysfs does not name.
Kernels from 2025 on refuse `restart-ms` for them, after the bit rate is set; the link stays down.
"""

_IF_LOST = (
    'if it answers "No such file or directory", the adapter has lost its USB endpoints: unplug it'
    " and plug it in again"
)
_IF_REFUSED = 'if "Device doesn\'t support restart from Bus Off", leave restart-ms 100 out'

_WIRING = (
    "look at the wiring (CAN-H, CAN-L, 120 ohms at both ends), the motor's 24 V, and the bit rate"
)


def tool(facts: Facts) -> Finding | None:
    """Check that iproute2 describes the link."""
    problem = facts.system.ip_problem
    if facts.interface != "socketcan" or problem is None:
        return None
    return warning(
        f"bit rate, restart-ms and error counters are not known: {problem}",
        "sudo apt install iproute2",
    )


def link(facts: Facts) -> Finding | None:
    """Check that the network interface is there, is one for CAN, and is up."""
    if facts.interface != "socketcan":
        return None
    name, found = facts.bus_channel, facts.system.link
    if found is None:
        return _missing(facts)
    if not found.is_can:
        listed = ", ".join(facts.system.can_links) or "none"
        return error(
            f"{name} is no CAN interface",
            advice=f'name one in the configuration, [bus] channel = "..."; there are: {listed}',
        )
    former = facts.system.renamed_from
    if former is not None and found.is_up:
        taken = former in facts.system.can_links
        other = f"; what is called {former} now is another interface" if taken else ""
        return warning(
            f"{former} is called {name} now; the daemon holds it{other}",
            advice=f'at its next start the daemon looks for {former}: set [bus] channel = "{name}"'
            f" in its configuration, or give the old name back once the motor is disabled"
            f" ({facts.ctl} state)",
        )
    virtual = ", virtual: without bit rate and error counters" if _is_virtual(found) else ""
    if not found.is_up:
        if virtual:
            return error(f"{name} is down{virtual}", f"sudo ip link set {name} up")
        return _set_up(facts, f"{name} is down")
    return ok(f"{name} is up{virtual}")


def bit_rate(facts: Facts) -> Finding | None:
    """Check that the bus runs at the motor's bit rate."""
    found = _controller(facts)
    if found is None:
        return _configured_bit_rate(facts)
    if found.bitrate is None:
        return _set_up(facts, "no bit rate is set")
    text = rate_text(found.bitrate)
    if found.bitrate == BITRATE:
        return ok(text)
    return _set_up(facts, f"{text}, but the motor speaks at 1 Mbit/s")


def modes(facts: Facts) -> Finding | None:
    """Check that the controller is in no mode in which a motor cannot answer."""
    found = _controller(facts)
    if found is None:
        return None
    bad = found.bad_modes
    if not bad:
        others = f", with {', '.join(found.modes).lower()}" if found.modes else ""
        return ok(f"classic CAN, sends and listens{others}")
    text = "; ".join(f"{mode.lower()} is on: {why}" for mode, why in bad.items())
    if any(mode in HINDERING for mode in bad):
        return _set_up(facts, text)
    return warning(text, _anew(facts, f"type can bitrate {BITRATE}"), _IF_LOST)


def network(facts: Facts) -> Finding | None:
    """Check that no file of this system sets the link up for something else."""
    settings = facts.system.settings
    wrong = [setting for setting in settings if setting.is_wrong]
    if not wrong:
        return ok("; ".join(setting.text for setting in settings)) if settings else None
    text = "; ".join(setting.text for setting in wrong)
    commands = [setting.command for setting in wrong if setting.command is not None]
    return warning(
        f"at every plug and boot {text}",
        " && ".join(commands) or None,
        "the motor needs 1 Mbit/s and no other mode: correct what is named; then plug the adapter"
        " in again",
    )


def sample_point(facts: Facts) -> Finding | None:
    """Check where in a bit the adapter looks."""
    found = _controller(facts)
    if found is None or found.sample_point is None:
        return None
    low, high = SAMPLE_POINTS
    text = f"at {found.sample_point:.1%} of a bit"
    if low <= found.sample_point <= high:
        return ok(text)
    settings = f"type can bitrate {found.bitrate} sample-point 0.75"
    return warning(f"{text}; {low:.0%} to {high:.0%} are usual", _anew(facts, settings))


def restart(facts: Facts) -> Finding | None:
    """Check that the controller of a link that is up restarts by itself after bus-off.

    No command: the link would have to go down, and it works.
    """
    found = _controller(facts)
    if found is None or found.restart_ms is None or not found.is_up:
        return None
    if facts.system.driver in _NO_RESTART:
        return ok(f"this driver has none: after bus-off, {_down_and_up(found)}")
    if found.restart_ms > 0:
        return ok(f"by itself, {found.restart_ms} ms after bus-off")
    return warning(
        f"restart-ms is not set: after bus-off, {_down_and_up(found)}",
        advice="it can be set only while the link is down: the next time, before it is brought up,"
        f" sudo ip link set {found.name} type can restart-ms 100; what 'litegripctl install-units"
        f" --can {found.name}' installs does so at every plug and boot, where the driver can do it",
    )


def queue(facts: Facts) -> Finding | None:
    """Check that no more commands can wait than any motor's watchdog outlasts."""
    found = _can_link(facts)
    if found is None or found.queue_frames is None or _is_virtual(found):
        return None
    rate_hz = RATE_HZ
    if facts.daemon is not None:
        rate_hz = float(facts.daemon.hello.get("limits", {}).get("rate_hz", RATE_HZ))
    held_s = found.queue_frames / rate_hz
    text = f"{found.queue_frames} frames, {held_s * 1e3:.0f} ms of commands at {rate_hz:g} Hz"
    shorten = f"sudo ip link set {found.name} txqueuelen 10"
    if found.queue_frames == 0:
        return warning(f"{text}: a command that has to wait for another frame is lost", shorten)
    if held_s <= LONGEST_QUEUE_S:
        return ok(text)
    return warning(
        f"{text}: a dead bus that comes back gets old commands",
        shorten,
    )


def bus_state(facts: Facts) -> Finding | None:
    """Check the controller's state."""
    found = _controller(facts)
    if found is None or found.state is None or not found.is_up:
        return None
    counters = f"tx errors {_count(found.tx_errors)}, rx errors {_count(found.rx_errors)}"
    text = f"{found.state.lower()}, {counters}"
    if found.state == "ERROR-ACTIVE":
        return ok(text)
    if found.state == "ERROR-WARNING":
        return warning(text, advice=_wiring(found))
    if found.state == "BUS-OFF" and (not found.restart_ms or facts.system.driver in _NO_RESTART):
        return error(text, _down_and_up(found), _wiring(found))
    if found.state in ("STOPPED", "SLEEPING"):
        return error(f"{text}: the adapter takes no part in the bus", _down_and_up(found), _IF_LOST)
    return error(text, None, _wiring(found))


def errors(facts: Facts) -> Finding | None:
    """Check what went wrong on the bus since the driver was loaded."""
    found = _controller(facts)
    if found is None or not found.history:
        return None
    seen = [
        f"{count} {name.replace('_', ' ')}"
        for name, count in found.history.items()
        if count and name not in ("restarts", "arbitration_lost")
    ]
    if not seen:
        return ok("none since the driver was loaded")
    return warning(f"since the driver was loaded: {', '.join(seen)}", advice=_wiring(found))


def adapter(facts: Facts) -> Finding | None:
    """Report the driver and the adapter."""
    found, system = _can_link(facts), facts.system
    if found is None or _is_virtual(found):
        return None
    if system.driver is None:
        return warning(
            "no driver is known: a serial-line adapter, perhaps, which may be too slow",
            advice='let the daemon open it itself: [bus] interface = "slcan", see etc/slcan.toml',
        )
    named = "" if system.adapter is None else f", {system.adapter}"
    return ok(f"driver {system.driver}{named}")


def device(facts: Facts) -> Finding | None:
    """Check the adapter that is no network interface, as far as this program can."""
    if facts.interface in (None, "socketcan"):
        return None
    if facts.interface in SIMULATED:
        return ok(f"interface {facts.interface}: SIMULATED, no jaws move; no adapter to check")
    found, bus = facts.system.device, _bus_figures(facts)
    if found is None:
        text = f"interface {facts.interface}, channel {facts.bus_channel}"
        return _unopened(facts, text) or ok(f"{text}: the daemon opens it by python-can")
    if not found.is_there:
        advice = "plug the adapter in, and name it in the configuration: [bus] channel"
        return error(f"{found.path} is not there", LIST_SERIAL, advice)
    if not found.is_character_device:
        advice = "name the adapter's device in the configuration: [bus] channel"
        return error(f"{found.path} is no device", LIST_SERIAL, advice)
    if found.is_accessible or bus.get("state") in USABLE_BUS:
        unopened = _unopened(facts, found.path)
        return unopened or _unstable(found) or ok(f"{found.path} is there and accessible")
    return warning(
        f"{found.path} is there, but not for {facts.user.name}",
        f"sudo usermod --append --groups {found.group or 'dialout'} {facts.user.name}",
        "needed if the daemon runs as this user; then log in again",
    )


def _unstable(found: Device) -> Finding | None:
    """Return that another adapter may have this name after a boot, or None."""
    if found.lasting_path is None or not found.other_ports:
        return None
    others = "another adapter is" if found.other_ports == 1 else f"{found.other_ports} others are"
    return warning(
        f"{found.path} is there, but {others}, too, and such names follow the order of plugging:"
        " after a boot it may be another gripper's",
        advice=f'set [bus] channel = "{found.lasting_path}" and restart the daemon',
    )


def serial(facts: Facts) -> Finding | None:
    """Check that nobody else opens the adapter's port, which would take bytes from the daemon."""
    found = facts.system.device
    if found is None or not found.is_character_device:
        return None
    if not found.probers:
        return ok("no program of this machine opens ports which it does not know")
    if found.is_left_alone:
        return ok(f"a rule keeps {' and '.join(found.probers)} off {found.path}")
    return warning(
        f"{' and '.join(found.probers)}, installed here, may open {found.path}: commands of others"
        " reach the adapter then, and its answers not the daemon",
        "sudo litegripctl install-units --serial && sudo udevadm control --reload"
        " && sudo udevadm trigger --subsystem-match=tty",
        "then plug the adapter in again; if this line stays, its chip is none that the rule knows:"
        " the file 91-litegrip-serial.rules says how to add it; brltty that nobody needs:"
        " sudo apt remove brltty",
    )


def _bus_figures(facts: Facts) -> Mapping[str, Any]:
    return {} if facts.daemon is None else facts.daemon.health.get("bus", {})


def _unopened(facts: Facts, text: str) -> Finding | None:
    """Return what the daemon finds wrong with an adapter that looks right from here, or None."""
    figures = _bus_figures(facts)
    why = str(figures.get("error"))
    advice = next((advice for part, advice in _OPENING if part in why), _OPENING_ELSE)
    if figures.get("state") in USABLE_BUS and figures.get("error") is not None:
        return warning(f"{text}: {why}", advice=advice)
    if figures.get("state") not in UNOPENED:
        return None
    return error(f"{text}: {why}", advice=advice)


def _missing(facts: Facts) -> Finding:
    name, others = facts.bus_channel, facts.system.can_links
    listed = f"; there are: {', '.join(others)}" if others else ", and no other one for CAN"
    text = f"there is no network interface {name}{listed}"
    if name.startswith("vcan"):
        return error(text, f"sudo ip link add dev {name} type vcan && sudo ip link set {name} up")
    if name.startswith("/"):
        return error(
            text, advice='at a serial port it needs [bus] interface = "slcan": etc/slcan.toml'
        )
    plug = "plug the adapter in and load its driver (sudo modprobe gs_usb, say)"
    if facts.daemon is None and facts.sockets and facts.configuration is None:
        return warning(text, advice=f"right if its daemon simulates the gripper; else {plug}")
    if others:
        return error(
            text,
            advice=f"if {others[0]} is its adapter, under another name since a plug or a boot: set"
            f' [bus] channel = "{others[0]}" in the configuration and restart the daemon; else'
            f" {plug}",
        )
    return error(
        text,
        advice=f"{plug}; one on a serial line is named in the configuration, see etc/slcan.toml",
    )


def _configured_bit_rate(facts: Facts) -> Finding | None:
    """Check the daemon's configuration, where it and not the system sets the bit rate."""
    is_the_systems = facts.interface in ("socketcan", *SIMULATED)
    if facts.daemon is None or facts.is_remote or is_the_systems:
        return None
    bitrate = facts.daemon.info.get("configuration", {}).get("bus", {}).get("bitrate")
    if bitrate is None:
        return None
    if bitrate == BITRATE:
        return ok("1 Mbit/s, by the configuration")
    return error(
        f"{rate_text(bitrate)} by the configuration, but the motor speaks at 1 Mbit/s",
        advice=f"set [bus] bitrate = {BITRATE} and restart the daemon",
    )


def _can_link(facts: Facts) -> Link | None:
    found = facts.system.link
    return found if facts.interface == "socketcan" and found is not None and found.is_can else None


def _controller(facts: Facts) -> Link | None:
    """Return the link if it has a controller that iproute2 describes."""
    found = _can_link(facts)
    return found if found is not None and found.kind == "can" else None


def _is_virtual(found: Link) -> bool:
    return found.kind in ("vcan", "vxcan") or (
        found.kind is None and found.name.startswith(("vcan", "vxcan"))
    )


def _set_up(facts: Facts, text: str) -> Finding:
    """Find a link that is not as it should be, and give the command that sets it up.

    A `restart-ms` that was ever set stays as it was. So do modes, unless they are switched off.
    """
    found, settings = facts.system.link, f"type can bitrate {BITRATE}"
    is_unset = found is not None and found.restart_ms == 0
    again = "".join(
        f"; {setting.text} at every plug and boot: see the line network"
        for setting in facts.system.settings
        if setting.is_wrong
    )
    if not is_unset or facts.system.driver in _NO_RESTART:
        return error(text, _anew(facts, settings), f"{_IF_LOST}{again}")
    advice = f"{_IF_LOST}; {_IF_REFUSED}{again}"
    return error(text, _anew(facts, f"{settings} restart-ms 100"), advice)


def _wiring(found: Link) -> str:
    """Return where to look when frames are damaged."""
    if found.termination_ohm != 0:
        return _WIRING
    switch_on = f"sudo ip link set {found.name} type can termination 120"
    own = "this adapter's own 120 ohms are off; where it is an end of the bus"
    return f"{_WIRING}; {own}: {switch_on}"


def _down_and_up(found: Link) -> str:
    """Return what ends a bus-off with every driver."""
    return f"sudo ip link set {found.name} down && sudo ip link set {found.name} up"


def _anew(facts: Facts, settings: str) -> str:
    """Return the command that sets a link up again; an enabled motor does not survive it."""
    name, found = facts.bus_channel, facts.system.link
    commands = [f"{facts.ctl} disable"] if facts.is_enabled else []
    if found is not None and found.is_up:
        commands.append(f"sudo ip link set {name} down")
    off = "" if found is None else switch_off(found)
    return " && ".join([*commands, f"sudo ip link set {name} up {settings}{off}"])


def _count(counter: int | None) -> str:
    return "unknown" if counter is None else str(counter)
