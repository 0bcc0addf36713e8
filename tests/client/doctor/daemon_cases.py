"""The cases of the checks of the daemon: whether it runs, who may use it, what it was granted."""

from dataclasses import replace

from litegrip_client.ctl.doctor.facts import Configuration, Socket, User
from litegrip_client.values.atomic_file import Shortage
from tests.client.doctor.case import Case, Cases
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
BEHIND_BOB = (Socket("/tmp/bob/x.sock", False, -1, ("/tmp/bob", "bob", None)),)
OF_BOB = (Socket("/tmp/x.sock", False, 1001, ("/tmp/x.sock", "bob", None)),)
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

DAEMON_CASES: Cases = {
    "daemon": [
        Case(facts(), "OK runs for 12 s, pid 77, /run/litegripd/can0.sock"),
        Case(
            facts(daemon=None, failure="no daemon can be reached", sockets=()),
            "ERROR no daemon can be reached"
            " $ sudo systemctl start litegripd@can0"
            " # without hardware: litegripd can0 --simulate",
        ),
        Case(
            facts(daemon=None, failure="nobody listens", sockets=(), is_unit_enabled=True),
            "ERROR nobody listens"
            " $ sudo systemctl start litegripd@can0"
            " # it was stopped or has failed: systemctl status litegripd@can0 says which",
        ),
        Case(
            facts(daemon=None, failure="no daemon can be reached", sockets=CLOSED),
            "WARNING not known if it runs $ systemctl status litegripd@can0",
        ),
        Case(
            facts(asked_channel="can1"),
            "ERROR the daemon at /run/litegripd/can0.sock has channel can0, not can1"
            " $ unset LITEGRIPD_SOCKET",
        ),
        Case(
            facts(daemon=None, failure="no daemon can be reached", sockets=(), configuration=WRONG),
            "ERROR no daemon can be reached"
            " $ sudo systemctl start litegripd@can0"
            " # not before the configuration is corrected",
        ),
        Case(
            facts(daemon=None, failure="the daemon did not answer within 5 s", hung_pid=77),
            "ERROR pid 77 listens, but the daemon did not answer within 5 s"
            " $ sudo systemctl restart litegripd@can0"
            " # look first: systemctl status litegripd@can0; without systemd: end it",
        ),
        Case(
            replace(UNKNOWN, hung_pid=0),
            "ERROR a process listens, but no daemon can be reached # without systemd: end it",
        ),
        Case(UNKNOWN, "ERROR no daemon can be reached # litegripd CHANNEL --socket /tmp/s"),
        Case(replace(UNKNOWN, sockets=CLOSED), "WARNING is closed to this # ask who"),
        Case(
            BARE,
            "ERROR nobody listens"
            " $ litegripd can0"
            " # as root: litegripctl install-units --can can0, which",
        ),
        Case(
            replace(BARE, interface="slcan", bus_channel="/dev/ttyACM0", configuration=None),
            "ERROR nobody listens $ litegripd can0 # litegripctl install-units, which",
        ),
        Case(
            replace(BARE, configuration=WRONG),
            "ERROR nobody listens"
            " $ litegripd can0"
            " # not before the configuration is corrected; that is in the foreground",
        ),
        Case(replace(BARE, hung_pid=77), "ERROR pid 77 listens # without systemd: end it"),
        Case(
            facts(daemon=None, failure="no daemon", others=("left", "right")),
            "ERROR no channel was named, and can0 is none of this machine; there are: left, right"
            " $ litegripctl -c left doctor"
            " # export LITEGRIP_CHANNEL=left",
        ),
    ],
    "group": [
        Case(replace(BARE, user=NO_GROUP), f"WARNING no group $ {MAKE} && {JOIN} # {STARTS}"),
        Case(facts(), "OK alice is in group litegrip"),
        Case(facts(user=ROOT), "OK root needs no group litegrip"),
        Case(
            facts(user=OUTSIDE, sockets=(Socket("/run/user/1000/x.sock", True, 1000),)),
            "OK alice needs no group",
        ),
        Case(
            facts(
                user=NO_GROUP,
                sockets=(Socket("/run/user/1000/x.sock", True, 1000),),
                interface="litegrip_sim",
            ),
            "OK alice needs no group for a simulated gripper of their own",
        ),
        Case(
            facts(
                user=NO_GROUP,
                sockets=(Socket("/run/user/1000/x.sock", True, 1000),),
            ),
            f"WARNING there is no group litegrip $ {MAKE} && {JOIN} # {AGAIN}",
        ),
        Case(facts(user=OUTSIDE, sockets=BEHIND_BOB)),
        Case(facts(user=OUTSIDE), f"WARNING alice is not in group $ {JOIN} # {LOGIN}"),
        Case(
            facts(user=replace(ALICE, has_group=False)),
            "WARNING alice is in group litegrip, but not yet in this session"
            " $ newgrp litegrip"
            f" # {LOGIN}",
        ),
        Case(
            facts(user=NO_GROUP),
            f"WARNING there is no group litegrip $ {MAKE} && {JOIN} # {AGAIN}",
        ),
        Case(
            facts(user=replace(ROOT, group_exists=False)),
            f"WARNING there is no group litegrip $ {MAKE} # {AGAIN}",
        ),
    ],
    "real-time": [
        Case(
            replace(
                with_daemon(health_control={"fifo_priority": 0, "memory_locked": False}),
                is_unit_installed=False,
            ),
            "WARNING not granted: SCHED_FIFO 50 and locked memory"
            " # start it where 'ulimit -r' is 50 or more",
        ),
        Case(facts(), "OK SCHED_FIFO 50, memory locked"),
        Case(
            with_daemon(
                health_control__fifo_priority=0, info_configuration__control={"priority": 0}
            ),
            "OK ordinary priority, as configured, memory locked",
        ),
        Case(
            with_daemon(health_control={"fifo_priority": 0, "memory_locked": False}),
            f"WARNING not granted: SCHED_FIFO 50 and locked memory $ {LIMITS} # CAP_SYS_NICE",
        ),
        Case(
            with_daemon(
                health_control={"fifo_priority": 0, "memory_locked": False}, info_simulated=True
            ),
            "OK ordinary priority, which is enough for a simulated gripper",
        ),
        Case(
            with_daemon(health_control={**GRANTED, "lateness": {"worst_us": 99_999.0}}),
            "OK SCHED_FIFO 50, memory locked",
        ),
        Case(
            with_daemon(
                health_control={**GRANTED, "lateness": {"worst_us": 312345.6}, "lost_ticks": 61}
            ),
            "WARNING the daemon itself stood still for 312 ms at worst since it was started,"
            " 61 ticks lost"
            " $ litegripctl -c can0 health"
            " # cpus in [control]",
        ),
        Case(
            with_daemon(
                health_control={**GRANTED, "fifo_priority": 0, "lateness": {"worst_us": 312345.6}}
            ),
            "WARNING not granted: SCHED_FIFO 50; the daemon itself stood still for 312 ms"
            f" $ {LIMITS}"
            " # CAP_SYS_NICE",
        ),
    ],
    "configuration": [
        Case(facts(edited=(FILE, NOW_S - 20.0))),
        Case(facts(daemon=None, edited=(FILE, NOW_S))),
        Case(
            facts(edited=(FILE, NOW_S - 5.0)),
            f"WARNING {FILE} was written after the daemon was started, which continues with"
            " the one before"
            " $ litegripctl -c can0 restart --hold"
            " # where that is refused, since other tables have changed: sudo systemctl restart",
        ),
        Case(
            replace(facts(edited=(FILE, NOW_S - 5.0)), interface="litegrip_sim"),
            f"WARNING {FILE} was written after the daemon was started, which continues with"
            " the one before"
            " # to use it: sudo systemctl restart",
        ),
        Case(
            facts(misnamed="/etc/litegripd/can0.toml.txt"),
            "WARNING /etc/litegripd/can0.toml.txt is no file that a daemon reads, which would"
            f" be {FILE}"
            f" $ sudo mv /etc/litegripd/can0.toml.txt {FILE}"
            " # then restart the daemon",
        ),
        Case(
            facts(daemon=None, configuration=Configuration(FILE, content={"bus": {}})),
            f"OK {FILE}: interface socketcan, channel can0",
        ),
        Case(
            facts(daemon=None, configuration=named(problem="no calibration: /m.json: kp is 1e400")),
            f"ERROR {FILE}: no calibration: /m.json: kp is 1e400 ([gripper] mount names it)"
            " # a daemon starts with it, and refuses motions: correct it, and check it again:"
            " litegripd can0 --check",
        ),
        Case(
            facts(
                daemon=None, configuration=named(warnings=["it is another gripper's", "too long"])
            ),
            "WARNING /m.json, which [gripper] mount names: it is another gripper's; too long"
            " # correct it, and check it again: litegripd can0 --check",
        ),
        Case(facts(daemon=None, configuration=named()), "OK"),
        Case(
            facts(daemon=None, configuration=WRONG, interface=None),
            f"ERROR {FILE}: not valid TOML # check it again: litegripd can0 --check",
        ),
        Case(
            facts(
                daemon=None,
                configuration=Configuration(FILE, unchecked="it is closed"),
                interface=None,
            ),
            f"WARNING {FILE} was not checked, nor the bus that it names: it is closed"
            " # litegripd can0 --check",
        ),
        Case(
            facts(daemon=None, configuration=Configuration(FILE, unchecked="it takes long")),
            f"WARNING {FILE} was not checked, which may name another bus than can0: it takes long"
            " # litegripd can0 --check",
        ),
        Case(
            facts(daemon=None, configuration=replace(WRONG, as_user="litegrip"), interface=None),
            f"ERROR {FILE}: not valid TOML"
            " # check it again: sudo -u litegrip litegripd can0 --check",
        ),
    ],
    "version": [
        Case(facts(), "OK 1.2.3, as this program"),
        Case(
            with_daemon(hello_version="1.2.2"),
            f"WARNING the daemon is 1.2.2, this program 1.2.3 $ {RELOAD} # install one version",
        ),
        Case(
            replace(with_daemon(hello_version="1.2.2"), is_unit_installed=False),
            "WARNING the daemon is 1.2.2"
            " $ litegripctl -c can0 restart --hold"
            " # the jaws hold meanwhile what they hold",
        ),
        Case(
            replace(with_daemon(hello_version="1.2.2"), interface="litegrip_sim"),
            "WARNING the daemon is 1.2.2 # end it, and start it again",
        ),
    ],
    "sockets": [
        Case(
            facts(daemon=None, user=OUTSIDE, sockets=BEHIND_BOB),
            "ERROR alice may not open /tmp/bob/x.sock: /tmp/bob is only for bob"
            " # ask bob for a socket in a directory that you may enter",
        ),
        Case(
            facts(daemon=None, user=OUTSIDE, sockets=OF_BOB),
            "ERROR alice may not open /tmp/x.sock: it is only for bob"
            " # ask bob, whose configuration opens it to others by [rpc] group",
        ),
        Case(facts(sockets=())),
        Case(
            facts(),
            "OK alice may open /run/litegripd/can0.sock and /run/litegripd/can0.stop.sock",
        ),
        Case(facts(sockets=CLOSED), f"ERROR alice may not open /run $ {RESTART} # {LOGIN}"),
        Case(replace(UNKNOWN, sockets=CLOSED), f"ERROR may not open # {LOGIN}"),
        Case(facts(sockets=CLOSED, user=OUTSIDE), f"ERROR alice may not open $ {JOIN} # {LOGIN}"),
        Case(
            facts(sockets=CLOSED, user=NO_GROUP),
            f"ERROR alice may not open $ {MAKE} && {JOIN} # {AGAIN}",
        ),
    ],
    "teleop": [
        *(
            Case(with_daemon(health_teleop={"reach": reach, "unreached": None}), "OK is")
            for reach in ("connected", "frames")
        ),
        Case(
            with_daemon(health_teleop={"reach": "sending", "unreached": None}),
            "OK no follower refuses them",
        ),
        Case(
            with_daemon(health_teleop={"reach": "sending", "unreached": "b:1 refuses (for 9 s)"}),
            "ERROR b:1 refuses (for 9 s)"
            " $ litegripctl -c can0 teleop status"
            " # the follower is to be started",
        ),
        Case(
            with_daemon(health_teleop={"reach": "bound", "unreached": "no frame comes (for 9 s)"}),
            "ERROR bound: no frame comes (for 9 s)"
            " $ litegripctl -c can0 teleop status"
            " # need the same port",
        ),
        Case(
            with_daemon(
                health_teleop={
                    "reach": "connecting",
                    "unreached": "b:1 has refused the connection (for 9 s)",
                }
            ),
            "ERROR connecting: b:1 has refused the connection (for 9 s)"
            " $ litegripctl -c can0 teleop status"
            " # need the same port",
        ),
    ],
    "health": [
        Case(facts(), "OK verdict on itself is ok"),
        Case(
            with_daemon(health_verdict="degraded", health_reasons=["a", "b"]),
            "WARNING degraded: a; b $ litegripctl -c can0 health",
        ),
        Case(
            with_daemon(health_verdict="down", health_reasons=["c"]),
            "ERROR down: c $ litegripctl -c can0 health",
        ),
    ],
    "disk": [
        Case(facts(), "OK there is room for calibrations"),
        Case(facts(is_remote=True, disks=(FULL,))),
        Case(
            facts(disks=(FULL, LITTLE)),
            "ERROR No space left on /tmp: 0 bytes free, no more files (inodes), free some;"
            " Little space left"
            " $ df -h /var/lib/litegripd /run /tmp /var/log"
            " # nothing can be kept meanwhile, and no daemon can be started while /tmp is full",
        ),
        Case(
            facts(disks=(LITTLE,)),
            "WARNING Little space left on /var/lib/litegripd: 900000 bytes free, free some"
            " $ sudo du -xh --max-depth=2 /var | sort -h | tail"
            " # what is largest",
        ),
        Case(
            facts(
                disks=(Shortage("/var/lib/litegripd can only be read", False, is_read_only=True),)
            ),
            "WARNING /var/lib/litegripd can only be read"
            " $ sudo dmesg | tail"
            " # an error of the disk makes it so",
        ),
    ],
}
