"""The cases of the checks of the daemon: whether it runs, who may use it, what it was granted."""

from dataclasses import replace

from litegrip_client.ctl.doctor.facts import Configuration, Socket, User
from litegrip_client.values.atomic_file import Shortage
from tests.client.doctor.case import Case
from tests.client.doctor.known import NOW_S, SOCKETS, facts, with_daemon

JOIN = "sudo usermod --append --groups litegrip alice"
MAKE = "sudo groupadd --system litegrip"
RESTART = "sudo systemctl restart litegripd@can0"
LOGIN = "groups count from the next login on"
STARTS = "the daemon looks for its group when it starts; groups"
RELOAD = "sudo systemctl reload litegripd@can0"
BARE = facts(daemon=None, failure="nobody listens", sockets=(), is_unit_installed=False)
AGAIN = "then start the daemon again"
CLOSED = (replace(SOCKETS[0], is_accessible=False), SOCKETS[1])
ALICE = User("alice", 1000, "litegrip")
OUTSIDE = replace(ALICE, is_member=False, has_group=False)
NO_GROUP = replace(OUTSIDE, group_exists=False)
FILE = "/etc/litegripd/can0.toml"


def named(**calibration: object) -> Configuration:
    """Return a configuration that names a calibration file, of which this was said."""
    judged: dict[str, object] = {
        "file": "/m.json",
        "named_by": "[gripper] mount",
        "problem": None,
        "warnings": [],
    }
    return Configuration(FILE, content={"bus": {}, "calibration": {**judged, **calibration}})


WRONG = Configuration(FILE, error=f"{FILE}: not valid TOML: at line 3")
UNKNOWN = facts(daemon=None, failure="no daemon can be reached", sockets=(), socket="/tmp/s")
ROOT = User("root", 0, "litegrip", is_member=False, has_group=False)
GRANTED = {"fifo_priority": 50, "memory_locked": True}
LIMITS = (
    "sudo mkdir -p /etc/systemd/system/litegripd@.service.d && printf"
    " '[Service]\\nLimitRTPRIO=99\\nLimitMEMLOCK=infinity\\n'"
    " | sudo tee /etc/systemd/system/litegripd@.service.d/realtime.conf"
    " && sudo systemctl daemon-reload && sudo systemctl restart litegripd@can0"
)

FULL = Shortage("No space left on /tmp: 0 bytes free, no more files (inodes), free some", True)
LITTLE = Shortage("Little space left on /var/lib/litegripd: 900000 bytes free, free some", False)

DAEMON_CASES = [
    Case("daemon", facts(), "ok", "runs for 12 s, pid 77, /run/litegripd/can0.sock"),
    Case(
        "daemon",
        facts(daemon=None, failure="no daemon can be reached", sockets=()),
        "error",
        "no daemon can be reached",
        "sudo systemctl start litegripd@can0",
        "without hardware: litegripd can0 --simulate",
    ),
    Case(
        "daemon",
        facts(daemon=None, failure="nobody listens", sockets=(), is_unit_enabled=True),
        "error",
        "nobody listens",
        "sudo systemctl start litegripd@can0",
        "it was stopped or has failed: systemctl status litegripd@can0 says which",
    ),
    Case(
        "daemon",
        facts(daemon=None, failure="no daemon can be reached", sockets=CLOSED),
        "warning",
        "not known if it runs",
        "systemctl status litegripd@can0",
    ),
    Case(
        "daemon",
        facts(asked_channel="can1"),
        "error",
        "the daemon at /run/litegripd/can0.sock has channel can0, not can1",
        "unset LITEGRIPD_SOCKET",
    ),
    Case(
        "daemon",
        facts(daemon=None, failure="no daemon can be reached", sockets=(), configuration=WRONG),
        "error",
        "no daemon can be reached",
        "sudo systemctl start litegripd@can0",
        "not before the configuration is corrected",
    ),
    Case(
        "daemon",
        facts(daemon=None, failure="the daemon did not answer hello within 5 s", hung_pid=77),
        "error",
        "pid 77 listens, but the daemon did not answer hello within 5 s",
        "sudo systemctl restart litegripd@can0",
        "look first: systemctl status litegripd@can0; without systemd: end it",
    ),
    Case(
        "daemon",
        replace(UNKNOWN, hung_pid=0),
        "error",
        "a process listens, but no daemon can be reached",
        advises="without systemd: end it",
    ),
    Case(
        "daemon",
        UNKNOWN,
        "error",
        "no daemon can be reached",
        advises="litegripd CHANNEL --socket /tmp/s",
    ),
    Case(
        "daemon",
        replace(UNKNOWN, sockets=CLOSED),
        "warning",
        "is closed to this",
        advises="ask who",
    ),
    Case(
        "daemon",
        BARE,
        "error",
        "nobody listens",
        "litegripd can0",
        "as root: litegripctl install-units --can can0, which",
    ),
    Case(
        "daemon",
        replace(BARE, interface="slcan", bus_channel="/dev/ttyACM0", configuration=None),
        "error",
        "nobody listens",
        "litegripd can0",
        "litegripctl install-units, which",
    ),
    Case(
        "daemon",
        replace(BARE, configuration=WRONG),
        "error",
        "nobody listens",
        "litegripd can0",
        "not before the configuration is corrected; that is in the foreground",
    ),
    Case(
        "daemon",
        replace(BARE, hung_pid=77),
        "error",
        "pid 77 listens",
        advises="without systemd: end it",
    ),
    Case("group", replace(BARE, user=NO_GROUP), "warning", "no group", f"{MAKE} && {JOIN}", STARTS),
    Case(
        "real-time",
        replace(
            with_daemon(health_control={"fifo_priority": 0, "memory_locked": False}),
            is_unit_installed=False,
        ),
        "warning",
        "not granted: SCHED_FIFO 50 and locked memory",
        advises="start it where 'ulimit -r' is 50 or more",
    ),
    Case("configuration", facts(), None),
    Case("configuration", facts(edited=(FILE, NOW_S - 20.0)), None),
    Case("configuration", facts(daemon=None, edited=(FILE, NOW_S)), None),
    Case(
        "configuration",
        facts(edited=(FILE, NOW_S - 5.0)),
        "warning",
        f"{FILE} was written after the daemon was started, which continues with the one before",
        "litegripctl -c can0 restart --hold",
        "where that is refused, since other tables have changed: sudo systemctl restart",
    ),
    Case(
        "configuration",
        facts(misnamed="/etc/litegripd/can0.toml.txt"),
        "warning",
        f"/etc/litegripd/can0.toml.txt is no file that a daemon reads, which would be {FILE}",
        f"sudo mv /etc/litegripd/can0.toml.txt {FILE}",
        "then restart the daemon",
    ),
    Case(
        "configuration",
        facts(daemon=None, configuration=Configuration(FILE, content={"bus": {}})),
        "ok",
        f"{FILE}: interface socketcan, channel can0",
    ),
    Case(
        "configuration",
        facts(daemon=None, configuration=named(problem="no calibration: /m.json: kp is 1e400")),
        "error",
        f"{FILE}: no calibration: /m.json: kp is 1e400 ([gripper] mount names it)",
        advises="a daemon starts with it, and refuses motions: correct it, and check it again:"
        " litegripd can0 --check",
    ),
    Case(
        "configuration",
        facts(daemon=None, configuration=named(warnings=["it is another gripper's", "too long"])),
        "warning",
        "/m.json, which [gripper] mount names: it is another gripper's; too long",
        advises="correct it, and check it again: litegripd can0 --check",
    ),
    Case("configuration", facts(daemon=None, configuration=named()), "ok"),
    Case(
        "configuration",
        facts(daemon=None, configuration=WRONG, interface=None),
        "error",
        f"{FILE}: not valid TOML",
        advises="check it again: litegripd can0 --check",
    ),
    Case(
        "configuration",
        facts(
            daemon=None,
            configuration=Configuration(FILE, unchecked="it is closed"),
            interface=None,
        ),
        "warning",
        f"{FILE} was not checked, nor the bus that it names: it is closed",
        advises="litegripd can0 --check",
    ),
    Case(
        "configuration",
        facts(daemon=None, configuration=Configuration(FILE, unchecked="it takes long")),
        "warning",
        f"{FILE} was not checked, which may name another bus than can0: it takes long",
        advises="litegripd can0 --check",
    ),
    Case(
        "configuration",
        facts(daemon=None, configuration=replace(WRONG, as_user="litegrip"), interface=None),
        "error",
        f"{FILE}: not valid TOML",
        advises="check it again: sudo -u litegrip litegripd can0 --check",
    ),
    Case("version", facts(), "ok", "1.2.3, as this program"),
    Case("version", facts(daemon=None), None),
    Case(
        "version",
        with_daemon(hello_version="1.2.2"),
        "warning",
        "the daemon is 1.2.2, this program 1.2.3",
        RELOAD,
        "install one version",
    ),
    Case(
        "version",
        replace(with_daemon(hello_version="1.2.2"), is_unit_installed=False),
        "warning",
        "the daemon is 1.2.2",
        "litegripctl -c can0 restart --hold",
        "the jaws hold meanwhile what they hold",
    ),
    Case(
        "version",
        replace(with_daemon(hello_version="1.2.2"), interface="litegrip_sim"),
        "warning",
        "the daemon is 1.2.2",
        advises="end it, and start it again",
    ),
    Case("sockets", facts(sockets=()), None),
    Case(
        "sockets",
        facts(),
        "ok",
        "alice may open /run/litegripd/can0.sock and /run/litegripd/can0.stop.sock",
    ),
    Case("sockets", facts(sockets=CLOSED), "error", "alice may not open /run", RESTART, LOGIN),
    Case("sockets", replace(UNKNOWN, sockets=CLOSED), "error", "may not open", advises=LOGIN),
    Case(
        "sockets", facts(sockets=CLOSED, user=OUTSIDE), "error", "alice may not open", JOIN, LOGIN
    ),
    Case(
        "sockets",
        facts(sockets=CLOSED, user=NO_GROUP),
        "error",
        "alice may not open",
        f"{MAKE} && {JOIN}",
        AGAIN,
    ),
    Case("group", facts(), "ok", "alice is in group litegrip"),
    Case("group", facts(user=ROOT), "ok", "root needs no group litegrip"),
    Case(
        "group",
        facts(user=OUTSIDE, sockets=(Socket("/run/user/1000/x.sock", True, 1000),)),
        "ok",
        "alice needs no group",
    ),
    Case("group", facts(user=OUTSIDE), "warning", "alice is not in group", JOIN, LOGIN),
    Case(
        "group",
        facts(user=replace(ALICE, has_group=False)),
        "warning",
        "alice is in group litegrip, but not yet in this session",
        "newgrp litegrip",
        LOGIN,
    ),
    Case(
        "group",
        facts(user=NO_GROUP),
        "warning",
        "there is no group litegrip",
        f"{MAKE} && {JOIN}",
        AGAIN,
    ),
    Case(
        "group",
        facts(user=replace(ROOT, group_exists=False)),
        "warning",
        "there is no group litegrip",
        MAKE,
        AGAIN,
    ),
    Case("real-time", facts(), "ok", "SCHED_FIFO 50, memory locked"),
    Case("real-time", facts(daemon=None), None),
    Case(
        "real-time",
        with_daemon(health_control__fifo_priority=0, info_configuration__control={"priority": 0}),
        "ok",
        "ordinary priority, as configured, memory locked",
    ),
    Case(
        "real-time",
        with_daemon(health_control={"fifo_priority": 0, "memory_locked": False}),
        "warning",
        "not granted: SCHED_FIFO 50 and locked memory",
        LIMITS,
        "CAP_SYS_NICE",
    ),
    Case(
        "real-time",
        with_daemon(health_control={**GRANTED, "lateness": {"worst_us": 99_999.0}}),
        "ok",
        "SCHED_FIFO 50, memory locked",
    ),
    Case(
        "real-time",
        with_daemon(
            health_control={**GRANTED, "lateness": {"worst_us": 312_345.6}, "lost_ticks": 61}
        ),
        "warning",
        "the daemon itself stood still for 312 ms at worst since it was started, 61 ticks lost",
        "litegripctl -c can0 health",
        "cpus in [control]",
    ),
    Case(
        "real-time",
        with_daemon(
            health_control={"fifo_priority": 0, "memory_locked": False}, info_simulated=True
        ),
        "ok",
        "ordinary priority, which is enough for a simulated gripper",
    ),
    Case(
        "real-time",
        with_daemon(
            health_control={**GRANTED, "fifo_priority": 0, "lateness": {"worst_us": 312_345.6}}
        ),
        "warning",
        "not granted: SCHED_FIFO 50; the daemon itself stood still for 312 ms",
        LIMITS,
        "CAP_SYS_NICE",
    ),
    Case(
        "daemon",
        facts(daemon=None, failure="no daemon", others=("left", "right")),
        "error",
        "no channel was named, and can0 is none of this machine; there are: left, right",
        "litegripctl -c left doctor",
        "export LITEGRIP_CHANNEL=left",
    ),
    Case("teleop", facts(), None),
    Case("teleop", facts(daemon=None), None),
    *(
        Case("teleop", with_daemon(health_teleop={"reach": reach, "unreached": None}), "ok", "is")
        for reach in ("connected", "frames")
    ),
    Case(
        "teleop",
        with_daemon(health_teleop={"reach": "sending", "unreached": None}),
        "ok",
        "no follower refuses them",
    ),
    Case(
        "teleop",
        with_daemon(health_teleop={"reach": "sending", "unreached": "b:1 refuses (for 9 s)"}),
        "error",
        "b:1 refuses (for 9 s)",
        "litegripctl -c can0 teleop status",
        "the follower is to be started",
    ),
    Case(
        "teleop",
        with_daemon(health_teleop={"reach": "bound", "unreached": "no frame comes (for 9 s)"}),
        "error",
        "bound: no frame comes (for 9 s)",
        "litegripctl -c can0 teleop status",
        "need the same port",
    ),
    Case(
        "teleop",
        with_daemon(
            health_teleop={
                "reach": "connecting",
                "unreached": "b:1 has refused the connection (for 9 s)",
            }
        ),
        "error",
        "connecting: b:1 has refused the connection (for 9 s)",
        "litegripctl -c can0 teleop status",
        "need the same port",
    ),
    Case("health", facts(), "ok", "verdict on itself is ok"),
    Case("health", facts(daemon=None), None),
    Case(
        "health",
        with_daemon(health_verdict="degraded", health_reasons=["a", "b"]),
        "warning",
        "degraded: a; b",
        "litegripctl -c can0 health",
    ),
    Case(
        "health",
        with_daemon(health_verdict="down", health_reasons=["c"]),
        "error",
        "down: c",
        "litegripctl -c can0 health",
    ),
    Case("disk", facts(), "ok", "there is room for calibrations"),
    Case("disk", facts(is_remote=True, disks=(FULL,)), None),
    Case(
        "disk",
        facts(disks=(FULL, LITTLE)),
        "error",
        "No space left on /tmp: 0 bytes free, no more files (inodes), free some; Little space left",
        "df -h /var/lib/litegripd /run /tmp /var/log",
        "nothing can be kept meanwhile, and no daemon can be started while /tmp is full",
    ),
    Case(
        "disk",
        facts(disks=(LITTLE,)),
        "warning",
        "Little space left on /var/lib/litegripd: 900000 bytes free, free some",
        "sudo du -xh --max-depth=2 /var | sort -h | tail",
        "what is largest",
    ),
    Case(
        "disk",
        facts(disks=(Shortage("/var/lib/litegripd can only be read", False, is_read_only=True),)),
        "warning",
        "/var/lib/litegripd can only be read",
        "sudo dmesg | tail",
        "an error of the disk makes it so",
    ),
]
