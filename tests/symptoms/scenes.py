"""Each row of the page's table: a symptom, how a bench comes to it, and how it is mended.

`mend` is None where the command that the doctor prints is carried out on the bench, a function
where its words are, and a text where neither can be: who has carried it out instead.
"""

import contextlib
import re
import struct
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from litegrip_client.values.atomic_file import Shortage
from litegripd.io.can.pumped import PumpedBus
from litegripd.model.errors import Refusal
from litegripd.model.motor import UP, BusCondition, BusSettings, CanFrame, Status
from litegripd.sim.plant import SimulatorParameters
from tests.io.test_slcan import GOOD, Line
from tests.symptoms.bench import Bench
from tests.world import CAN_ID, World

Act: TypeAlias = Callable[[Bench], None]

SYSTEMD = "the command alone, in the VM (`systemd`)"
ADAPTERS = "yes, in the VM (`adapters`)"
NAMES = "no: it needs two daemons of systemd"
HARDWARE = "no: it needs the hardware"
SHELL, CAUSE = "no: it opens a shell", "no: the cause is not known by this alone"
UDEV = "no: it needs udev; `tests/client/units` has the rule"

WITHIN_S = 20.0


@dataclass(frozen=True)
class Scene:
    """One row: what somebody notices, the check that finds it, and what was done."""

    symptom: str
    check: str
    act: Act
    mend: Act | str | None = None
    runs: bool = True
    """Whether the daemon does."""
    scans: bool = False
    channel: str | None = "can0"
    remains: str = field(default="ok")
    """The level of the check when it is mended."""


def link(recorded: str = "healthy", **data: Any) -> Act:
    return lambda bench: bench.link(recorded, **data)


def in_mode(mode: str) -> Act:
    return link(ctrlmode=[mode.upper()])


def at_rate(bitrate: int) -> Act:
    return link(bittiming={"bitrate": bitrate, "sample_point": "0.750"})


def without_ip(bench: Bench) -> None:
    (bench.programs / "ip").rename(bench.programs / "away")


def with_ip(bench: Bench) -> None:
    (bench.programs / "away").rename(bench.programs / "ip")


def unplugged(bench: Bench) -> None:
    (bench.folder / "link").unlink()
    bench.driver(None)
    (bench.folder / "net/can0/type").unlink()


def plugged(bench: Bench) -> None:
    bench.driver("gs_usb")
    bench.link("healthy")


def renamed(bench: Bench) -> None:
    unplugged(bench)
    bench.put("net/can1/type", "280\n")


def virtual(bench: Bench) -> None:
    bench.bus = BusSettings("socketcan", "vcan0", 1_000_000)
    bench.link("vcan_down")
    bench.put("link", (bench.folder / "link").read_text().replace('"can0"', '"vcan0"'))


def restart_set(bench: Bench) -> None:
    for words in ("down", "type can restart-ms 100", "up"):
        bench.carry_out(f"sudo ip link set can0 {words}")


def end_of_bus(bench: Bench) -> None:
    advice = bench.doctor()["bus-state"].advice or ""
    bench.carry_out(advice.rpartition(": ")[2])


def named_wrongly(bench: Bench) -> None:
    bench.link("dummy")
    bench.put("net/can0/type", "1\n")
    bench.put("net/can1/type", "280\n")


def networkd(bench: Bench) -> None:
    bench.put("run/systemd/netif/links/4")
    bench.put("etc/systemd/network/can.network", "[Match]\nName=can0\n\n[CAN]\nBitRate=500K\n")


def serial(**changes: Any) -> Act:
    """A daemon on a serial adapter, whose port is the file /dev/ttyACM0 of the bench."""

    def act(bench: Bench) -> None:
        path = bench.folder / "dev/ttyACM0"
        bench.bus = replace(BusSettings("slcan", str(path), 1_000_000), **changes)

    return act


@contextlib.contextmanager
def port(bench: Bench) -> Iterator[Line]:
    """Let the port be a pseudo-terminal; nobody is at its other end yet."""
    line = Line()
    path = bench.folder / "dev/ttyACM0"
    path.parent.mkdir(exist_ok=True)
    path.symlink_to(line.device)
    serial()(bench)
    try:
        yield line
    finally:
        line.close()


def adapter(answer: bytes, *, echoes: bool = False, sends: bytes = b"") -> Act:
    """What is at the port answers so to all that is sent to it; the daemon's own pump meets it."""

    def act(bench: Bench) -> None:
        with port(bench) as line:
            line.answer, line.echoes = answer, echoes
            line.begin()
            bus = PumpedBus(replace(bench.bus, options={"sleep_after_open": 0}), 0.005)
            ends_s, seen = time.monotonic() + WITHIN_S, bus.condition
            try:
                while not has_told(seen) and not (sends and bus.counters.received):
                    assert time.monotonic() < ends_s
                    bus.receive(time.monotonic())
                    seen = bus.condition
                    if sends and seen.state == "up":
                        line.send(sends)
                    time.sleep(0.01)
            finally:
                bus.close()
            told = re.sub(r"(: \d+ lines .*)?; another program.*", "", seen.error or "")
            bench.world.condition = BusCondition(seen.state, told) if told else UP
        tty_left(bench)

    return act


def has_told(seen: BusCondition) -> bool:
    """Whether a pump has found what there is; the other program at the port is this one."""
    return not (seen.error or "not opened yet").startswith(("not opened yet", "another program"))


def tty_left(bench: Bench) -> None:
    """Leave a port behind that is there for the doctor to look at."""
    path = bench.folder / "dev/ttyACM0"
    path.unlink()
    path.symlink_to("/dev/null")


def a_port(bench: Bench) -> None:
    (bench.folder / "dev").mkdir()
    (bench.folder / "dev/ttyACM0").symlink_to("/dev/null")


def a_plain_file(bench: Bench) -> None:
    serial()(bench)
    bench.put("dev/ttyACM0")


def no_path(bench: Bench) -> None:
    bench.bus = BusSettings("slcan", "COM3", 1_000_000)
    bench.world.condition = opened(bench.bus)


def opened(settings: BusSettings) -> BusCondition:
    """Return what the daemon's own pump finds when it opens this."""
    bus, ends_s = PumpedBus(settings, 0.005), time.monotonic() + WITHIN_S
    try:
        while not has_told(bus.condition):
            assert time.monotonic() < ends_s
            bus.receive(time.monotonic())
            time.sleep(0.01)
        return bus.condition
    finally:
        bus.close()


def a_port_by_its_path(bench: Bench) -> None:
    serial()(bench)
    a_port(bench)
    well_again(bench)


def two_ports(bench: Bench) -> None:
    serial()(bench)
    names = bench.folder / "dev/serial/by-id"
    names.mkdir(parents=True)
    for name, port in (("ttyACM0", "/dev/null"), ("ttyACM1", "/dev/zero")):
        (bench.folder / "dev" / name).symlink_to(port)
        (names / f"usb-CANable-{name[-1]}-if00").symlink_to(f"../../{name}")


def named_by_its_number(bench: Bench) -> None:
    name = bench.folder / "dev/serial/by-id/usb-CANable-0-if00"
    bench.bus = BusSettings("slcan", str(name), 1_000_000)


def with_modem_manager(bench: Bench) -> None:
    serial()(bench)
    a_port(bench)
    bench.put("usr/sbin/ModemManager")


def condition(state: Any, error: str) -> Act:
    def act(bench: Bench) -> None:
        bench.world.condition = BusCondition(state, error)

    return act


def well_again(bench: Bench) -> None:
    bench.world.condition = UP


def registers(**written: int | float) -> Act:
    """Registers as the maker's tool writes them, before the daemon reads them: r10=2."""

    def act(bench: Bench) -> None:
        for name, value in written.items():
            raw = struct.pack("<f" if isinstance(value, float) else "<I", value)
            frame = CanFrame(0x7FF, struct.pack("<HBB", CAN_ID, 0x55, int(name[1:])) + raw)
            bench.world.gripper.receive(bench.world.now_s, frame)
        bench.world.client().call("motor.clear_fault")

    return act


def corrected(**written: int | float) -> Act:
    """The same, and the daemon is started again."""

    def act(bench: Bench) -> None:
        registers(**written)(bench)
        before = bench.world
        bench.world = World()
        bench.world.gripper, bench.world.now_s = before.gripper, before.now_s

    return act


def motor_at(can_id: int) -> Act:
    def act(bench: Bench) -> None:
        bench.world = World(parameters=replace(SimulatorParameters(), can_id=can_id))

    return act


def enabled(bench: Bench) -> None:
    bench.world.start().client().result("motor.enable")


def stopped(bench: Bench) -> None:
    calibrated()(bench)
    bench.world.client().result("stop", why="a hand was near")


def faulted(bench: Bench) -> None:
    enabled(bench)
    bench.world.gripper.latch_fault(Status.OVERLOAD)


def no_power(bench: Bench) -> None:
    enabled(bench)
    bench.world.gripper.power_off()


def power(bench: Bench) -> None:
    bench.world.gripper.power_on()
    bench.world.run(1.0)
    bench.world.client().result("motor.enable")


def second_master(bench: Bench) -> None:
    bench.world.start().inject(CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF")))
    bench.world.run(0.1)
    bench.tell()
    busy = bench.world.tick

    def tick() -> None:
        if round(bench.world.now_s * 200) % 100 == 0:
            bench.world.inject(CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF")))
        busy()

    bench.world.tick = tick  # type: ignore[method-assign]


def it_ends(bench: Bench) -> None:
    del bench.world.tick
    bench.world.run(3.0)


def calibrated(**content: Any) -> Act:
    """Another calibration than the bench's own measurement."""

    def act(bench: Bench) -> None:
        client = bench.world.start().client()
        own = {"zero_position_rad": 0.05, "max_position_rad": -1.55, "rad_to_mm": 53.75}
        assert client.result("calibration.load", content={**own, **content})["loaded"]

    return act


def uncalibrated(bench: Bench) -> None:
    bench.world = World(calibrated=False)


def load_template_and_measure(bench: Bench) -> None:
    for words in ("calibration load normal", "enable", "zero"):
        bench.carry_out(f"litegripctl -c can0 {words}")


def unreadable(bench: Bench) -> None:
    text = "no calibration: /var/lib/litegripd/can0_calibration.json: Permission denied"
    uncalibrated(bench)
    bench.world.controller.use_calibration(None, Refusal("calibration_unreadable", text))


def measured_beside_a_named_file(bench: Bench) -> None:
    calibrated()(bench)
    controller = bench.world.controller
    own = "/var/lib/litegripd/can0_calibration.json"
    controller.use_calibration(controller.calibrated.calibration, file=own)
    bench.mount = "/home/alice/mine.json"


def no_file_named(bench: Bench) -> None:
    bench.mount = "normal"


def set_zero(bench: Bench) -> None:
    calibrated()(bench)
    bench.world.gripper.jump(6.28)
    bench.world.run(0.2)


def turned_back(bench: Bench) -> None:
    bench.world.gripper.jump(-6.28)
    bench.world.run(0.2)


def other_stroke(bench: Bench) -> None:
    calibrated()(bench)
    bench.stroke_mm = 95.0
    controller = bench.world.controller
    controller.gripper_id = replace(controller.gripper_id, stroke_mm=95.0)


def told(**facts: Any) -> Act:
    return lambda bench: bench.tell(**facts)


def user(**changes: Any) -> Act:
    def act(bench: Bench) -> None:
        bench.user = replace(bench.user, **changes)

    return act


def wrong_file(bench: Bench) -> None:
    bench.put("etc/litegripd/can0.toml", "[buss]\n")


def wrong_mount(bench: Bench) -> None:
    file = bench.put("mine.json", '{"zero_position_rad": 0, "max_position_rad": -90}')
    bench.put("etc/litegripd/can0.toml", f'[gripper]\nmount = "{file}"\n')


def edited(bench: Bench) -> None:
    bench.put("etc/litegripd/can0.toml", "[control]\nrate_hz = 400\n")
    bench.tell(health_uptime_s=3600.0)


def misnamed(bench: Bench) -> None:
    bench.put("etc/litegripd/can0.toml.txt", "[control]\nrate_hz = 400\n")


def stood_still(bench: Bench) -> None:
    bench.control |= {"lateness": {"worst_us": 312_000}, "lost_ticks": 62}


def no_rights(bench: Bench) -> None:
    bench.control |= {"fifo_priority": 0, "memory_locked": False}


def granted(bench: Bench) -> None:
    """Carry the command out below the root of the bench, where no systemd reads its file."""
    command = bench.doctor()["real-time"].command or ""
    bench.carry_out(command.replace("/etc/systemd", f"{bench.folder}/etc/systemd"))
    written = bench.folder / "etc/systemd/system/litegripd@.service.d/realtime.conf"
    assert written.read_text() == "[Service]\nLimitRTPRIO=99\nLimitMEMLOCK=infinity\n"
    bench.control |= {"fifo_priority": 50, "memory_locked": True}


def disk(word: str, free_bytes: int, where: str) -> Act:
    text = f"{word} space left on {where}: {free_bytes} bytes free, free some"
    return lambda bench: bench.disks.append(Shortage(text, is_full=word == "No"))


def read_only(bench: Bench) -> None:
    text = "/var/lib/litegripd can only be read: nothing can be kept there"
    bench.disks.append(Shortage(text, is_full=False, is_read_only=True))


def disk_freed(bench: Bench) -> None:
    bench.disks.clear()


def nothing(_bench: Bench) -> None:
    pass


def a_file_in_its_place(bench: Bench) -> None:
    bench.put("run/litegripd/can0.sock", "mine")


def closed(bench: Bench) -> None:
    bench.is_closed = True


def with_names(bench: Bench) -> None:
    unplugged(bench)
    for name in ("left", "right"):
        bench.put(f"enabled/litegripd@{name}.service")


BUS = {"state": "up", "error": None, "load": 0.05, "send_failures": 0, "reopened": 0}

SCENES = [
    Scene("no bit rate, no error counters in the doctor's lines", "iproute2", without_ip, with_ip,
          remains="none"),
    Scene("nothing works after a boot or a plug", "link", link("down")),
    Scene("the same, with an adapter that was never set up", "link", link("unset")),
    Scene("the same, and `ip link` does not list it", "link", unplugged, plugged),
    Scene("the same, since the adapter is at another hub, or after a boot", "link", renamed,
          plugged),
    Scene("`can0` is there, and python-can refuses it", "link", named_wrongly, plugged),
    Scene("a simulated bus is down", "link", virtual),
    Scene("the motor is silent, the adapter's lamp flashes errors", "bit-rate", at_rate(500_000)),
    Scene("`RTNETLINK answers: Invalid argument` at `ip link set can0 up`", "bit-rate",
          link("unset")),
    Scene("a serial adapter opens, the motor is silent", "bit-rate", serial(bitrate=500_000),
          serial()),
    Scene("`candump` shows frames of others, the motor is silent", "modes", in_mode("listen-only")),
    Scene("every frame comes back, the motor is silent", "modes", in_mode("loopback")),
    Scene("the bus works for others, nothing of ours leaves", "modes", in_mode("restricted")),
    Scene("the bus fails as soon as the vendor's SDK, or another program, is started", "modes",
          in_mode("fd")),
    Scene("the same, with CAN FD of before its standard", "modes", in_mode("fd-non-iso")),
    Scene("the same, with CAN XL", "modes", in_mode("xl")),
    Scene("single commands are lost, more of them on a busy bus", "modes", in_mode("one-shot")),
    Scene("errors count up at 1 Mbit/s", "modes", in_mode("triple-sampling")),
    Scene("frames are sent without an error though the cable is out", "modes",
          in_mode("presume-ack")),
    Scene("the right rate is set by hand, and wrong again after the next plug", "network",
          networkd),
    Scene("errors count up, with the right bit rate", "sample-point", link("sample_point")),
    Scene("after a short circuit the bus stays dead", "restart", link("no_restart"),
          restart_set),
    Scene("old commands arrive when a dead bus comes back", "queue", link("long_queue")),
    Scene("nobody acknowledges: plug, wires, or 24 V", "bus-state", link("error_passive"),
          link("healthy")),
    Scene("the same, with an adapter that has a resistor of its own", "bus-state",
          link("error_passive", termination=0, termination_const=[0, 120]), end_of_bus),
    Scene("the adapter has left the bus", "bus-state", link("bus_off", restart_ms=0)),
    Scene("the link is up, and nothing is sent", "bus-state", link(state="STOPPED")),
    Scene("faults now and then", "bus-errors", link("bus_off"), link("healthy")),
    Scene("`slcand` made the interface; commands come late", "adapter",
          lambda bench: bench.driver(None), adapter(b"V1013\r" + GOOD, sends=GOOD),
          remains="none"),
    Scene("the serial adapter is not found", "device", serial(), a_port),
    Scene("another gripper moves after a boot or a plug", "device", two_ports,
          named_by_its_number),
    Scene("the serial adapter is not found, by a name of another system", "device", no_path,
          a_port_by_its_path),
    Scene("its file is no device", "device", a_plain_file, tty_left),
    Scene("a console or a modem is at the port, or its plug loops back", "device",
          adapter(b"", echoes=True), well_again),
    Scene("another device is at the port: a modem, a printer, another baud rate", "device",
          adapter(b"\r\nERROR\r\n" * 30), well_again),
    Scene("the adapter's lamp is on, and nothing comes from it", "device", adapter(b""),
          well_again),
    Scene("the adapter does not know 1 Mbit/s", "device", adapter(b"\r\a\r\r\aV1013\r"),
          well_again),
    Scene("the adapter does not open the bus", "device", adapter(b"\r\r\r\a\aV1013\r"),
          well_again),
    Scene("a serial adapter loses lines after its plug, or its port vanishes", "serial",
          with_modem_manager, UDEV),
    Scene("`litegripctl` finds no daemon", "daemon", nothing, ADAPTERS, runs=False),
    Scene("the same, on a robot whose channels have names", "daemon", with_names, NAMES,
          runs=False, channel=None),
    Scene("the same, where a file lies in place of its socket", "daemon", a_file_in_its_place,
          lambda bench: (bench.folder / "run/litegripd/can0.sock").unlink(), runs=False),
    Scene("a daemon that was edited does not start", "configuration", wrong_file,
          lambda bench: (bench.folder / "etc/litegripd/can0.toml").unlink(), runs=False,
          remains="none"),
    Scene("a daemon that was edited starts, and refuses motions", "configuration", wrong_mount,
          lambda bench: (bench.folder / "etc/litegripd/can0.toml").unlink(), runs=False,
          remains="none"),
    Scene("what was written into the configuration has no effect", "configuration", edited,
          told(health_uptime_s=-1.0), remains="none"),
    Scene("the same, with a file that was made on another system", "configuration", misnamed,
          lambda bench: (bench.folder / "etc/litegripd/can0.toml.txt").unlink(), remains="none"),
    Scene("a new version is installed, the old one answers", "version", told(hello_version="1.2.2"),
          SYSTEMD),
    Scene("`permission denied`, for everybody", "sockets", closed, SYSTEMD),
    Scene("`permission denied`, after joining the group", "group", user(has_group=False), SHELL),
    Scene("`permission denied`, before", "group", user(has_group=False, is_member=False), SYSTEMD),
    Scene("ticks are late", "real-time", no_rights, granted),
    Scene("ticks were late once, or the motor faulted with `communication_lost`", "real-time",
          stood_still, CAUSE),
    Scene("nothing is kept any more, or a daemon does not start (226)", "disk",
          disk("No", 0, "/tmp"), disk_freed),
    Scene("the same, soon", "disk", disk("Little", 900_000, "/var/lib/litegripd"), disk_freed),
    Scene("the same, with an error of the disk before, or an image that can only be read", "disk",
          read_only, disk_freed),
    Scene("the bus is lost while the daemon runs", "bus", condition("down", "Network is down"),
          well_again),
    Scene("the gripper is gone for a moment, again and again", "bus",
          told(health_bus=BUS | {"reopened": 500}, health_uptime_s=86_400.0),
          told(health_bus=BUS)),
    Scene("commands come late, and other devices are on the bus", "bus",
          told(health_bus=BUS | {"load": 0.97}), told(health_bus=BUS)),
    Scene("the motor does not answer", "motor", no_power, power),
    Scene("the motor has faulted", "motor", faulted),
    Scene("motions are refused, and all else is well", "stop", stopped, remains="none"),
    Scene("the daemon is not content", "health", faulted, lambda bench:
          bench.carry_out("litegripctl enable")),
    Scene("the motor does not answer, and its 24 V are on: it has another id", "scan", motor_at(9),
          motor_at(8), scans=True),
    Scene("the same, and no id answers: it may have another bit rate", "scan",
          lambda bench: bench.world.gripper.power_off(), HARDWARE, scans=True),
    Scene("`doctor --scan` while the motor is enabled", "scan", enabled, scans=True),
    Scene("the jaws do what nobody here wanted", "other-master", second_master, it_ends,
          remains="warning"),
    Scene("`enable` is refused", "control-mode", registers(r10=2), corrected(r10=1)),
    Scene("the motor is silent after its next power-on", "can-br", registers(r35=3),
          corrected(r35=4)),
    Scene("commands and answers collide", "ids", registers(r7=0), corrected(r7=0x18)),
    Scene("jaws keep their last torque when a program dies", "watchdog", registers(r9=0),
          corrected(r9=2000)),
    Scene("torques are wrong in another program", "ranges", registers(r23=12.0),
          corrected(r23=10.0)),
    Scene("motions are refused", "calibration", uncalibrated, load_template_and_measure,
          remains="ok"),
    Scene("the same, though a calibration file is there", "calibration", unreadable, calibrated(),
          remains="warning"),
    Scene("an old calibration is back after each restart", "calibration",
          measured_beside_a_named_file, no_file_named),
    Scene("all millimetres are too large", "calibration", calibrated(rad_to_mm=75.0)),
    Scene("`open` goes to the stop though the calibration has a work stroke", "calibration",
          calibrated(work_stroke_mm=95.0), calibrated(), remains="warning"),
    Scene("millimetres do not agree with a caliper", "stroke", other_stroke),
    Scene("motions are refused after a power cycle", "position", set_zero, turned_back),
    Scene("the jaws stop short of the stops, or close the wrong way, after a file was loaded",
          "channel", calibrated(channel="can3")),
    Scene("a follower stays at `waiting`", "teleop",
          told(health_teleop={"reach": "connecting", "unreached":
          "10.0.0.2:17448 has refused the connection: nobody listens at that port (for 9 s)"}),
          told(health_teleop={"reach": "frames"})),
    Scene("a gripper of another machine is not reached", "protection",
          told(health_remote={"certificate_expires_s": 1.0}),
          told(health_remote={"certificate_expires_s": 9e9})),
]  # fmt: skip
"""The order of the page."""
