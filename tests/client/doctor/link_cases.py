"""The cases of the checks of the bus: the network interface, its controller, other adapters."""

from dataclasses import replace
from typing import Any

from litegrip_client.ctl.doctor.facts import Device, Facts
from litegrip_client.socketcan.link import HARMFUL, HINDERING
from litegrip_client.socketcan.managers import Setting
from tests.client.doctor.case import Case
from tests.client.doctor.known import daemon, facts, link, system, with_daemon

LOST = 'if it answers "No such file or directory", the adapter has lost its USB endpoints'
REFUSED = "leave restart-ms 100 out"
UP = "sudo ip link set can0 up type can bitrate 1000000"
ANEW = f"sudo ip link set can0 down && {UP}"
LASTING = "/dev/serial/by-id/usb-CANable-if00"
SERIAL = Device("/dev/ttyACM0", True, True, True, "dialout")
CLOSED = replace(SERIAL, is_accessible=False)
CYCLE = "sudo ip link set can1 down && sudo ip link set can1 up"
ONLY_FILES = replace(link("healthy"), kind=None, bitrate=None, sample_point=None, state=None)
WIRING = "wiring"
RENAMED = replace(
    system(link=replace(link("healthy"), name="gripper0")),
    renamed_from="can0",
    can_links=("gripper0",),
)


def serial(device: Device | None, **changes: object) -> Facts:
    """Return facts of a gripper on a serial-line adapter."""
    return facts(
        None,
        interface="slcan",
        bus_channel="/dev/ttyACM0",
        system=replace(system(), link=None, device=device),
        daemon=daemon(**changes),
    )


def gs_usb(link_name: str) -> Facts:
    """Return facts of an adapter whose driver has no restart after bus-off, as kernels tell it."""
    found = replace(link(link_name), restart_ms=0)
    return facts(
        system=system(link=found, driver="gs_usb", adapter="candleLight USB to CAN adapter"),
        bus_channel=found.name,
    )


def in_modes(*modes: str, **changes: Any) -> Facts:
    """Return facts of a link whose controller is in these modes."""
    return facts(system=system(link=replace(link("healthy"), modes=modes)), **changes)


NETWORK_FILE = Setting("can0", "systemd-networkd", "/etc/systemd/network/can.network", 5, 500_000)
DROP_IN = (
    "sudo mkdir -p /etc/systemd/network/can.network.d"
    " && printf '[CAN]\\nBitRate=1000000\\n' | sudo tee"
    " /etc/systemd/network/can.network.d/90-litegrip.conf && sudo networkctl reload"
)
STANZA = replace(NETWORK_FILE, manager="ifupdown", file="/etc/network/interfaces", line=7)
RIGHT = replace(STANZA, bitrate=1_000_000)

LINK_CASES = [
    Case("iproute2", facts(), None),
    Case(
        "iproute2",
        facts(system=system(link=ONLY_FILES, ip_problem="ip (iproute2) is not installed")),
        "warning",
        "error counters are not known: ip (iproute2) is not installed",
        "sudo apt install iproute2",
    ),
    Case("link", facts(), "ok", "can0 is up"),
    Case(
        "link", facts("vcan", bus_channel="vcan0"), "ok", "vcan0 is up, virtual: without bit rate"
    ),
    Case(
        "link",
        facts(system=RENAMED, bus_channel="gripper0"),
        "warning",
        "can0 is called gripper0 now; the daemon holds it",
        advises='set [bus] channel = "gripper0"',
    ),
    Case(
        "link",
        facts(system=replace(RENAMED, can_links=("can0", "gripper0")), bus_channel="gripper0"),
        "warning",
        "the daemon holds it; what is called can0 now is another interface",
        advises="at its next start the daemon looks for can0",
    ),
    Case("link", facts("down"), "error", "can0 is down", UP, advises=LOST),
    Case("link", facts("unset"), "error", "can0 is down", f"{UP} restart-ms 100", REFUSED),
    Case("link", gs_usb("down"), "error", "can0 is down", UP, LOST),
    Case("link", gs_usb("unset"), "error", "can0 is down", UP, LOST),
    Case(
        "link",
        facts("vcan_down", bus_channel="vcan0"),
        "error",
        "vcan0 is down, virtual",
        "sudo ip link set vcan0 up",
    ),
    Case(
        "link",
        facts("dummy", bus_channel="can8"),
        "error",
        "can8 is no CAN interface",
        advises="there are: can0, can1",
    ),
    Case(
        "link",
        facts(None, bus_channel="can9"),
        "error",
        "there is no network interface can9; there are: can0, can1",
        advises="if can0 is its adapter, under another name since a plug or a boot: set [bus]"
        ' channel = "can0" in the configuration and restart the daemon; else plug the adapter in',
    ),
    Case(
        "link",
        facts(system=system(link=None, can_links=())),
        "error",
        "there is no network interface can0, and no other one for CAN",
        advises="etc/slcan.toml",
    ),
    Case(
        "link",
        facts(None, bus_channel="/dev/ttyACM0"),
        "error",
        "there is no network interface /dev/ttyACM0",
        advises='at a serial port it needs [bus] interface = "slcan": etc/slcan.toml',
    ),
    Case(
        "link",
        facts(None, bus_channel="vcan0"),
        "error",
        "there is no network interface vcan0",
        "sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up",
    ),
    Case("link", serial(SERIAL), None),
    Case("link", facts(None, interface=None, daemon=None), None),
    Case("device", facts(), None),
    Case("device", facts(None, interface=None, daemon=None), None),
    Case("device", facts(interface="litegrip_sim"), "ok", "no adapter to check"),
    Case("device", serial(SERIAL), "ok", "/dev/ttyACM0 is there and accessible"),
    Case("device", serial(None), "ok", "channel /dev/ttyACM0: the daemon opens it by python-can"),
    *(
        Case(
            "device",
            serial(device, health_bus={"state": state, "error": f"cannot be opened: {why}"}),
            "error",
            f"/dev/ttyACM0: cannot be opened: {why}",
            advises=advice,
        )
        for device, state, why, advice in (
            (None, "down", "CAN interface 'nonsense' not supported", "correct [bus] interface"),
            (None, "down", "pcanbasic library not found.", "install the library that"),
            (None, "adapter_gone", "No module named 'usb'", "for the daemon's Python"),
            (SERIAL, "down", "Could not configure port: (25, 'Inapp", "no serial adapter: correct"),
            (SERIAL, "down", "Device or resource busy", "another program has it"),
            (SERIAL, "down", "it smells", "fix what its driver says"),
        )
    ),
    Case(
        "device",
        serial(Device("/dev/ttyACM0", False)),
        "error",
        "/dev/ttyACM0 is not there",
        "ls -l /dev/serial/by-id/",
        "plug the adapter in",
    ),
    Case(
        "device",
        serial(Device("/dev/ttyACM0", True)),
        "error",
        "/dev/ttyACM0 is no device",
        "ls -l /dev/serial/by-id/",
        "[bus] channel",
    ),
    Case(
        "device",
        serial(CLOSED, health_bus__state="down"),
        "warning",
        "/dev/ttyACM0 is there, but not for alice",
        "sudo usermod --append --groups dialout alice",
        "log in again",
    ),
    Case("device", serial(CLOSED), "ok", "is there and accessible"),
    Case(
        "device", serial(CLOSED, health_bus__state="motor_silent"), "ok", "is there and accessible"
    ),
    Case("serial", facts(), None),
    Case("serial", serial(SERIAL), "ok", "no program of this machine"),
    Case("device", serial(replace(SERIAL, lasting_path=LASTING)), "ok"),
    Case("device", serial(replace(SERIAL, other_ports=1)), "ok"),
    Case(
        "device",
        serial(replace(SERIAL, lasting_path=LASTING, other_ports=1)),
        "warning",
        "/dev/ttyACM0 is there, but another adapter is, too, and such names follow the order of",
        advises=f'set [bus] channel = "{LASTING}" and restart the daemon',
    ),
    Case(
        "device",
        serial(replace(SERIAL, lasting_path=LASTING, other_ports=2)),
        "warning",
        "but 2 others are, too",
        advises="restart the daemon",
    ),
    Case("serial", serial(Device("/dev/ttyACM0", True)), None),
    Case(
        "serial",
        serial(replace(SERIAL, probers=("ModemManager",), is_left_alone=True)),
        "ok",
        "a rule keeps ModemManager off /dev/ttyACM0",
    ),
    Case(
        "serial",
        serial(replace(SERIAL, probers=("ModemManager", "brltty"))),
        "warning",
        "ModemManager and brltty, installed here, may open /dev/ttyACM0",
        "sudo litegripctl install-units --serial && sudo udevadm control --reload"
        " && sudo udevadm trigger --subsystem-match=tty",
        "91-litegrip-serial.rules says how to add it",
    ),
    Case("adapter", facts(), "ok", "driver peak_usb, PCAN-USB"),
    Case("adapter", gs_usb("healthy"), "ok", "driver gs_usb, candleLight USB to CAN adapter"),
    Case("adapter", facts(system=system(adapter=None)), "ok", "driver peak_usb"),
    Case("adapter", facts("vcan"), None),
    Case(
        "adapter",
        facts(system=system(driver=None)),
        "warning",
        "no driver is known",
        advises='interface = "slcan"',
    ),
    Case("bit-rate", facts(), "ok", "1 Mbit/s"),
    Case(
        "bit-rate",
        facts("wrong_bitrate"),
        "error",
        "0.5 Mbit/s, but the motor speaks at 1 Mbit/s",
        ANEW,
        advises=LOST,
    ),
    Case(
        "bit-rate",
        facts("wrong_bitrate", daemon=daemon(state_enabled=True)),
        "error",
        "0.5 Mbit/s",
        f"litegripctl -c can0 disable && {ANEW}",
        advises=LOST,
    ),
    Case(
        "bit-rate",
        facts("unset"),
        "error",
        "no bit rate is set",
        f"{UP} restart-ms 100",
        advises=REFUSED,
    ),
    Case("bit-rate", gs_usb("unset"), "error", "no bit rate is set", UP, LOST),
    Case("bit-rate", gs_usb("wrong_bitrate"), "error", "0.5 Mbit/s", ANEW, LOST),
    Case("bit-rate", facts("vcan"), None),
    Case("bit-rate", facts(system=system(link=ONLY_FILES)), None),
    Case("bit-rate", serial(SERIAL), "ok", "1 Mbit/s, by the configuration"),
    Case(
        "bit-rate",
        serial(SERIAL, info_configuration__bus={"bitrate": 500_000}),
        "error",
        "0.5 Mbit/s by the configuration",
        advises="set [bus] bitrate = 1000000",
    ),
    Case(
        "bit-rate",
        facts(system=system(link=link("wrong_bitrate"), settings=(NETWORK_FILE,))),
        "error",
        "0.5 Mbit/s, but the motor speaks at 1 Mbit/s",
        ANEW,
        "/etc/systemd/network/can.network:5 (systemd-networkd) sets 0.5 Mbit/s at every plug and"
        " boot: see the line network",
    ),
    Case("modes", facts(), "ok", "classic CAN, sends and listens"),
    Case("modes", in_modes("BERR-REPORTING"), "ok", "and listens, with berr-reporting"),
    Case("modes", facts("vcan"), None),
    *(
        Case(
            "modes",
            in_modes(mode),
            "error",
            f"{mode.lower()} is on: {why}",
            f"{ANEW} {mode.lower()} off",
            LOST,
        )
        for mode, why in HINDERING.items()
    ),
    *(
        Case(
            "modes",
            in_modes(mode),
            "warning",
            f"{mode.lower()} is on: {why}",
            f"{ANEW} {mode.lower()} off",
            LOST,
        )
        for mode, why in HARMFUL.items()
    ),
    Case(
        "modes",
        in_modes("FD", "LISTEN-ONLY", "BERR-REPORTING", daemon=daemon(state_enabled=True)),
        "error",
        "listen-only is on: the adapter only listens: it sends nothing and acknowledges nothing;"
        " fd is on: ",
        f"litegripctl -c can0 disable && {ANEW} listen-only off fd off",
        LOST,
    ),
    Case(
        "link",
        facts(system=system(link=replace(link("down"), modes=("LOOPBACK",)))),
        "error",
        "can0 is down",
        f"{UP} loopback off",
        LOST,
    ),
    Case("network", facts(), None),
    Case("network", facts(system=system(settings=(RIGHT,))), "ok", "(ifupdown) sets 1 Mbit/s"),
    Case(
        "network",
        facts(system=system(settings=(NETWORK_FILE, RIGHT))),
        "warning",
        "at every plug and boot /etc/systemd/network/can.network:5 (systemd-networkd) sets 0.5"
        " Mbit/s",
        DROP_IN,
        "the motor needs 1 Mbit/s and no other mode",
    ),
    Case(
        "network",
        facts(system=system(settings=(NETWORK_FILE, STANZA))),
        "warning",
        "/etc/network/interfaces:7 (ifupdown) sets 0.5 Mbit/s",
        f"{DROP_IN} && sudo sed -i '7s/\\(\\bbitrate[[:space:]]*\\)500000\\b/\\11000000/'"
        " /etc/network/interfaces",
        "the motor needs 1 Mbit/s and no other mode",
    ),
    Case("sample-point", facts(), "ok", "at 75.0% of a bit"),
    Case("sample-point", facts("wrong_bitrate"), "ok", "at 87.5% of a bit"),
    Case("sample-point", facts("unset"), None),
    Case(
        "sample-point",
        facts("sample_point"),
        "warning",
        "at 50.0% of a bit; 70% to 90% are usual",
        "sudo ip link set can0 down && sudo ip link set can0 up"
        " type can bitrate 1000000 sample-point 0.75",
    ),
    Case("restart", facts(), "ok", "by itself, 100 ms after bus-off"),
    Case(
        "restart",
        facts("no_restart", bus_channel="can1"),
        "warning",
        f"restart-ms is not set: after bus-off, {CYCLE}",
        advises="at every plug and boot, where the driver can do it",
    ),
    Case("restart", gs_usb("no_restart"), "ok", f"this driver has none: after bus-off, {CYCLE}"),
    Case(
        "restart",
        facts(system=system(driver="gs_usb")),  # a restart-ms that an older kernel has taken
        "ok",
        "this driver has none",
    ),
    Case("restart", facts("unset"), None),
    Case("restart", facts("down"), None),
    Case("restart", facts("vcan"), None),
    Case("queue", facts(), "ok", "10 frames, 50 ms of commands at 200 Hz"),
    Case("queue", with_daemon(hello_limits__rate_hz=100), "ok", "10 frames, 100 ms of commands"),
    Case("queue", facts(daemon=None), "ok", "10 frames, 50 ms of commands at 200 Hz"),
    Case(
        "queue",
        facts("long_queue"),
        "warning",
        "1000 frames, 5000 ms of commands at 200 Hz: a dead bus that comes back gets old commands",
        "sudo ip link set can0 txqueuelen 10",
    ),
    Case(
        "queue",
        facts(system=system(link=replace(link("healthy"), queue_frames=0))),
        "warning",
        "0 frames, 0 ms of commands at 200 Hz: a command that has to wait for another frame is",
        "sudo ip link set can0 txqueuelen 10",
    ),
    Case("queue", facts("vcan"), None),
    Case("bus-state", facts(), "ok", "error-active, tx errors 0, rx errors 0"),
    Case("bus-state", facts("down"), None),
    Case(
        "bus-state",
        facts("error_passive"),
        "error",
        "error-passive, tx errors 128, rx errors 0",
        advises=WIRING,
    ),
    Case(
        "bus-state",
        facts(system=system(link=replace(link("healthy"), state="ERROR-WARNING", tx_errors=None))),
        "warning",
        "error-warning, tx errors unknown, rx errors 0",
        advises=WIRING,
    ),
    Case(
        "bus-state",
        facts("bus_off"),
        "error",
        "bus-off, tx errors 248",
        CYCLE,
        WIRING,
    ),
    Case("bus-state", gs_usb("bus_off"), "error", "bus-off, tx errors 248", CYCLE, WIRING),
    Case(
        "bus-state",
        facts(system=system(link=replace(link("bus_off"), restart_ms=100), driver="gs_usb")),
        "error",
        "bus-off",
        CYCLE,
        WIRING,
    ),
    Case(
        "bus-state",
        facts(system=system(link=replace(link("bus_off"), restart_ms=100))),
        "error",
        "bus-off",
        advises=WIRING,
    ),
    *(
        Case(
            "bus-state",
            facts(system=system(link=replace(link("healthy"), state=state))),
            "error",
            f"{state.lower()}, tx errors 0, rx errors 0: the adapter takes no part in the bus",
            CYCLE.replace("can1", "can0"),
            LOST,
        )
        for state in ("STOPPED", "SLEEPING")
    ),
    Case("bus-errors", facts(), "ok", "none since the driver was loaded"),
    Case(
        "bus-errors",
        facts("bus_off"),
        "warning",
        "since the driver was loaded: 31 bus error, 1 error warning, 1 error passive, 1 bus off",
        advises=WIRING,
    ),
    Case("bus-errors", facts("vcan"), None),
]
