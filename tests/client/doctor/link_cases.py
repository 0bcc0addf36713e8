"""The cases of the checks of the bus: the network interface, its controller, other adapters."""

from dataclasses import replace
from typing import Any

from litegrip_client.ctl.doctor.facts import Device, Facts
from litegrip_client.socketcan.managers import Setting
from tests.client.doctor.case import Case, Cases
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

LINK_CASES: Cases = {
    "link": [
        Case(facts(), "OK can0 is up"),
        Case(facts("vcan", bus_channel="vcan0"), "OK vcan0 is up, virtual: without bit rate"),
        Case(
            facts(system=RENAMED, bus_channel="gripper0"),
            "WARNING can0 is called gripper0 now; the daemon holds it"
            ' # set [bus] channel = "gripper0"',
        ),
        Case(
            facts(system=replace(RENAMED, can_links=("can0", "gripper0")), bus_channel="gripper0"),
            "WARNING the daemon holds it; what is called can0 now is another interface"
            " # at its next start the daemon looks for can0",
        ),
        Case(facts("down"), f"ERROR can0 is down $ {UP} # {LOST}"),
        Case(facts("unset"), f"ERROR can0 is down $ {UP} restart-ms 100 # {REFUSED}"),
        Case(gs_usb("down"), f"ERROR can0 is down $ {UP} # {LOST}"),
        Case(gs_usb("unset"), f"ERROR can0 is down $ {UP} # {LOST}"),
        Case(
            facts("dummy", bus_channel="can8"),
            "ERROR can8 is no CAN interface # there are: can0, can1",
        ),
        Case(
            facts(None, bus_channel="can9"),
            "ERROR there is no network interface can9; there are: can0, can1"
            " # if can0 is its adapter, under another name since a plug or a boot: set [bus]"
            ' channel = "can0" in the configuration and restart the daemon; else plug the'
            " adapter in",
        ),
        Case(
            facts(None, bus_channel="/dev/ttyACM0"),
            "ERROR there is no network interface /dev/ttyACM0"
            ' # at a serial port it needs [bus] interface = "slcan": etc/slcan.toml',
        ),
        Case(
            facts(None, bus_channel="vcan0"),
            "ERROR there is no network interface vcan0"
            " $ sudo ip link add dev vcan0 type vcan && sudo ip link set vcan0 up",
        ),
        Case(
            facts(None, bus_channel="sim0", daemon=None, failure="it does not answer", hung_pid=77),
            "WARNING there is no network interface sim0"
            " # right if its daemon simulates the gripper; else plug the adapter in",
        ),
        Case(
            facts(None, bus_channel="can9", daemon=None, failure="there is none", sockets=()),
            "ERROR there is no network interface can9 # plug the adapter in",
        ),
        Case(serial(SERIAL)),
        Case(
            facts(system=system(link=replace(link("down"), modes=("LOOPBACK",)))),
            f"ERROR can0 is down $ {UP} loopback off # {LOST}",
        ),
    ],
    "device": [
        Case(facts(interface="litegrip_sim"), "OK no adapter to check"),
        Case(serial(SERIAL), "OK /dev/ttyACM0 is there and accessible"),
        Case(serial(None), "OK channel /dev/ttyACM0: the daemon opens it by python-can"),
        *(
            Case(
                serial(device, health_bus={"state": state, "error": f"cannot be opened: {why}"}),
                f"ERROR /dev/ttyACM0: cannot be opened: {why} # {advice}",
            )
            for device, state, why, advice in (
                (None, "down", "CAN interface 'nonsense' not supported", "correct [bus] interface"),
                (None, "down", "pcanbasic library not found.", "install the library that"),
                (None, "adapter_gone", "No module named 'usb'", "for the daemon's Python"),
                (
                    SERIAL,
                    "down",
                    "Could not configure port: (25, 'Ina",
                    "no serial adapter: correct",
                ),
                (SERIAL, "down", "Device or resource busy", "another program has it"),
                (
                    SERIAL,
                    "down",
                    (
                        "frames waited up to 32 ms for the process that drives the adapter, and"
                        " were dropped: this machine is too busy"
                    ),
                    "give the daemon real-time rights, or this machine fewer programs",
                ),
                (SERIAL, "down", "it smells", "fix what its driver says"),
            )
        ),
        Case(
            serial(Device("/dev/ttyACM0", False)),
            "ERROR /dev/ttyACM0 is not there $ ls -l /dev/serial/by-id/ # plug the adapter in",
        ),
        Case(
            serial(CLOSED, health_bus__state="down"),
            "WARNING /dev/ttyACM0 is there, but not for alice"
            " $ sudo usermod --append --groups dialout alice"
            " # log in again",
        ),
        Case(serial(CLOSED), "OK is there and accessible"),
        Case(serial(CLOSED, health_bus__state="motor_silent"), "OK is there and accessible"),
        Case(serial(replace(SERIAL, lasting_path=LASTING)), "OK"),
        Case(serial(replace(SERIAL, other_ports=1)), "OK"),
        Case(
            serial(replace(SERIAL, lasting_path=LASTING, other_ports=1)),
            "WARNING /dev/ttyACM0 is there, but another adapter is, too, and such names"
            " follow the order of"
            f' # set [bus] channel = "{LASTING}" and restart the daemon',
        ),
        Case(
            serial(replace(SERIAL, lasting_path=LASTING, other_ports=2)),
            "WARNING but 2 others are, too # restart the daemon",
        ),
    ],
    "serial": [
        Case(serial(SERIAL), "OK no program of this machine"),
        Case(serial(Device("/dev/ttyACM0", True))),
        Case(
            serial(replace(SERIAL, probers=("ModemManager",), is_left_alone=True)),
            "OK a rule keeps ModemManager off /dev/ttyACM0",
        ),
        Case(
            serial(replace(SERIAL, probers=("ModemManager", "brltty"))),
            "WARNING ModemManager and brltty, installed here, may open /dev/ttyACM0"
            " $ sudo litegripctl install-units --serial && sudo udevadm control --reload &&"
            " sudo udevadm trigger --subsystem-match=tty"
            " # 91-litegrip-serial.rules says how to add it",
        ),
    ],
    "adapter": [
        Case(facts(), "OK driver peak_usb, PCAN-USB"),
        Case(gs_usb("healthy"), "OK driver gs_usb, candleLight USB to CAN adapter"),
        Case(facts(system=system(adapter=None)), "OK driver peak_usb"),
    ],
    "bit-rate": [
        Case(facts(), "OK 1 Mbit/s"),
        Case(
            facts("wrong_bitrate"),
            f"ERROR 0.5 Mbit/s, but the motor speaks at 1 Mbit/s $ {ANEW} # {LOST}",
        ),
        Case(
            facts("wrong_bitrate", daemon=daemon(state_enabled=True)),
            f"ERROR 0.5 Mbit/s $ litegripctl -c can0 disable && {ANEW} # {LOST}",
        ),
        Case(facts("unset"), f"ERROR no bit rate is set $ {UP} restart-ms 100 # {REFUSED}"),
        Case(gs_usb("unset"), f"ERROR no bit rate is set $ {UP} # {LOST}"),
        Case(gs_usb("wrong_bitrate"), f"ERROR 0.5 Mbit/s $ {ANEW} # {LOST}"),
        Case(facts(system=system(link=ONLY_FILES))),
        Case(serial(SERIAL), "OK 1 Mbit/s, by the configuration"),
        Case(
            facts(system=system(link=link("wrong_bitrate"), settings=(NETWORK_FILE,))),
            "ERROR 0.5 Mbit/s, but the motor speaks at 1 Mbit/s"
            f" $ {ANEW}"
            " # /etc/systemd/network/can.network:5 (systemd-networkd) sets 0.5 Mbit/s at"
            " every plug and boot: see the line network",
        ),
    ],
    "modes": [
        Case(facts(), "OK classic CAN, sends and listens"),
        Case(in_modes("BERR-REPORTING"), "OK and listens, with berr-reporting"),
        Case(
            in_modes("FD", "LISTEN-ONLY", "BERR-REPORTING", daemon=daemon(state_enabled=True)),
            "ERROR listen-only is on: the adapter only listens: it sends nothing and"
            " acknowledges nothing; fd is on: "
            f" $ litegripctl -c can0 disable && {ANEW} listen-only off fd off"
            f" # {LOST}",
        ),
    ],
    "network": [
        Case(facts(system=system(settings=(RIGHT,))), "OK (ifupdown) sets 1 Mbit/s"),
        Case(
            facts(system=system(settings=(NETWORK_FILE, RIGHT))),
            "WARNING at every plug and boot /etc/systemd/network/can.network:5"
            " (systemd-networkd) sets 0.5 Mbit/s"
            f" $ {DROP_IN}"
            " # the motor needs 1 Mbit/s and no other mode",
        ),
        Case(
            facts(system=system(settings=(NETWORK_FILE, STANZA))),
            "WARNING /etc/network/interfaces:7 (ifupdown) sets 0.5 Mbit/s"
            f" $ {DROP_IN} && sudo sed -i"
            " '7s/\\(\\bbitrate[[:space:]]*\\)500000\\b/\\11000000/' /etc/network/interfaces"
            " # the motor needs 1 Mbit/s and no other mode",
        ),
    ],
    "sample-point": [
        Case(facts(), "OK at 75.0% of a bit"),
        Case(facts("wrong_bitrate"), "OK at 87.5% of a bit"),
    ],
    "restart": [
        Case(facts(), "OK by itself, 100 ms after bus-off"),
        Case(
            facts("no_restart", bus_channel="can1"),
            f"WARNING restart-ms is not set: after bus-off, {CYCLE}"
            " # at every plug and boot, where the driver can do it",
        ),
        Case(gs_usb("no_restart"), f"OK this driver has none: after bus-off, {CYCLE}"),
        Case(  # a restart-ms that an older kernel has taken
            facts(system=system(driver="gs_usb")), "OK this driver has none"
        ),
    ],
    "queue": [
        Case(facts(), "OK 10 frames, 50 ms of commands at 200 Hz"),
        Case(with_daemon(hello_limits__rate_hz=100), "OK 10 frames, 100 ms of commands"),
        Case(facts(daemon=None), "OK 10 frames, 50 ms of commands at 200 Hz"),
        Case(
            facts(system=system(link=replace(link("healthy"), queue_frames=0))),
            "WARNING 0 frames, 0 ms of commands at 200 Hz: a command that has to wait for"
            " another frame is"
            " $ sudo ip link set can0 txqueuelen 10",
        ),
    ],
    "bus-state": [
        Case(facts(), "OK error-active, tx errors 0, rx errors 0"),
        Case(
            facts(
                system=system(link=replace(link("healthy"), state="ERROR-WARNING", tx_errors=None))
            ),
            f"WARNING error-warning, tx errors unknown, rx errors 0 # {WIRING}",
        ),
        Case(facts("bus_off"), f"ERROR bus-off, tx errors 248 $ {CYCLE} # {WIRING}"),
        Case(gs_usb("bus_off"), f"ERROR bus-off, tx errors 248 $ {CYCLE} # {WIRING}"),
        Case(
            facts(system=system(link=replace(link("bus_off"), restart_ms=100), driver="gs_usb")),
            f"ERROR bus-off $ {CYCLE} # {WIRING}",
        ),
        Case(
            facts(system=system(link=replace(link("bus_off"), restart_ms=100))),
            f"ERROR bus-off # {WIRING}",
        ),
        *(
            Case(
                facts(system=system(link=replace(link("healthy"), state=state))),
                f"ERROR {state.lower()}, tx errors 0, rx errors 0: the adapter takes no part in"
                " the bus"
                f" $ {CYCLE.replace('can1', 'can0')}"
                f" # {LOST}",
            )
            for state in ("STOPPED", "SLEEPING")
        ),
    ],
    "bus-errors": [
        Case(facts(), "OK none since the driver was loaded"),
    ],
}
