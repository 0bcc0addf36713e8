"""The daemons under systemd: installed from the wheel, hardened, supervised. Run as root in the VM.

The scenes build on each other. Nothing here is about timing: the machine is emulated, and stalls.
"""

import re
import sys
from functools import partial
from pathlib import Path

from tests.vm.attended import ATTENDED, patient_motor
from tests.vm.beside import fleet_as_units, page_as_a_unit, printed_after_an_upgrade
from tests.vm.failing_units import FAILING_UNITS
from tests.vm.guest import check, play, reaches
from tests.vm.managed import MANAGED
from tests.vm.unit import (
    CONFIGURATION,
    PROGRAMS,
    SLOW,
    STATE,
    Unit,
    ctl,
    flags,
    is_set_up,
    must,
    run,
    status_of,
)

EXPOSURE_AT_MOST = 2.0
LATER_KEYS = re.compile("Unknown key .*'Restart(Steps|MaxDelaySec)'")
"""Of systemd 254; older ones say that they ignore them."""

UNIT_FILE = "/usr/local/lib/systemd/system/litegripd@.service"


def installation() -> None:
    """install-units on a bare system, and what its own hints say to do then."""
    install = (f"{PROGRAMS}/litegripctl", "install-units", "--can", "can0", "--can", "can1")
    print(must(*install), flush=True)
    again = must(*install).split("next,")[0]
    check("a second time changes nothing", set(again.split()[::2]) == {"unchanged"}, again)
    must("systemd-sysusers")
    account = must("getent", "passwd", "litegrip")
    check("there is a user litegrip", account.split(":")[5] == str(STATE), account)
    for user in ("alice", "bob"):
        must("useradd", "--create-home", user)
    must("usermod", "--append", "--groups", "litegrip", "alice")
    for channel in ("can0", "vcan0", "arm"):
        (CONFIGURATION.parent / f"{channel}.toml").write_text(SLOW)
    must("systemctl", "daemon-reload")
    must("udevadm", "control", "--reload")
    for name in ("can0", "can1"):
        trigger = ("udevadm", "trigger", "--action=add", "--subsystem-match=net")
        must(*trigger, f"--sysname-match={name}")
        check(f"udev brings {name} up", reaches(partial(is_set_up, name)), flags(name))
    status, out = run("systemd-analyze", "verify", "--man=no", UNIT_FILE)
    complaints = [line for line in out.splitlines() if not LATER_KEYS.search(line)]
    check("systemd-analyze verify accepts the unit", status == 0 and not complaints, out)


def one_daemon() -> None:
    """A daemon as a unit, and who may use it."""
    unit = Unit()
    with patient_motor("can1"):
        unit.start()
        check("the unit is active", unit.is_active(), unit.tell())
        uid = int(must("id", "-u", "litegrip"))
        owned = [status_of(pid, "Uid").split()[1] for pid in unit.processes()]
        check("all of its processes are the user's", set(owned) == {str(uid)}, owned)
        capabilities = status_of(unit.pid, "CapEff")
        check("without any capability", int(capabilities, 16) == 0, capabilities)
        out = must("systemd-analyze", "security", "--no-pager", unit.name)
        worst = [line for line in out.splitlines() if line.startswith("✗")]
        print("\n".join([*worst, out.splitlines()[-1]]), flush=True)
        exposure = float(out.rpartition("exposure level for")[2].split()[1])
        check(f"exposure at most {EXPOSURE_AT_MOST}", exposure <= EXPOSURE_AT_MOST, exposure)
        found = reaches(lambda: unit.rpc().motor_is("disabled"))
        check("the motor is found", found, unit.tell())
        told = reaches(lambda: unit.show("StatusText").startswith("disabled, "))
        check("STATUS tells the mode", told, unit.show("StatusText"))
        status, out = ctl("alice", "state")
        check("alice, of the group, sees the state", status == 0, out)
        status, out = ctl("bob", "state")
        check("bob, outside of it, is refused", status == 3 and "ermission" in out, out)
        status, out = ctl("bob", "stop")
        check("and may not stop either", status == 3, out)
        with_rights(unit)
        in_the_journal(unit)


def with_rights(unit: Unit) -> None:
    """SCHED_FIFO and locked memory for the control process, and for it alone."""
    CONFIGURATION.write_text(SLOW.replace("priority = 0", "priority = 50"))
    unit.restart()
    policies = {pid: must("chrt", "--pid", str(pid)) for pid in unit.processes()}
    main = policies.pop(unit.pid)
    check("the control process has SCHED_FIFO 50", "SCHED_FIFO" in main and "50" in main, main)
    check("its memory is locked", int(status_of(unit.pid, "VmLck").split()[0]) > 1000)
    ordinary = all("SCHED_OTHER" in policy for policy in policies.values())
    check("its children have ordinary priority", bool(policies) and ordinary, policies)
    health = unit.rpc().call("health")
    refused = [reason for reason in health["reasons"] if "not granted" in reason]
    check("health misses no right", not refused and health["control"]["memory_locked"], refused)
    CONFIGURATION.write_text(SLOW)
    unit.restart()


def in_the_journal(unit: Unit) -> None:
    """The journal is searched by channel and job."""
    rpc = unit.rpc()
    reaches(partial(rpc.motor_is, "disabled"))
    reaches(lambda: bool(rpc.state()["calibrated"]))
    rpc.insist("motor.enable")
    number = rpc.call("motion.open", wait=False).get("job", 0)
    job = f"LITEGRIP_JOB={number}"
    reaches(lambda: all(job["state"] != "running" for job in rpc.call("job.list")["jobs"]))
    rpc.call("motor.disable")
    journal = partial(must, "journalctl", "--output=cat", "--no-pager", "-b")
    found = reaches(lambda: "open by" in journal("LITEGRIP_CHANNEL=can0", job))
    check("journalctl finds a job", found, journal(job))
    check("but not in another channel", "open by" not in journal("LITEGRIP_CHANNEL=can9", job))
    check("and all that it says", "listening on" in journal("LITEGRIP_CHANNEL=can0"))
    all_of_it = journal("--unit=litegripd@can0")
    check("and systemd's own lines", "Started" in all_of_it and "listening on" in all_of_it)


def after_reboot() -> None:
    """An enabled daemon after the machine was started anew."""
    unit = Unit()
    check("it was started at boot", reaches(unit.is_active), unit.tell())
    check("and the interface brought up", reaches(partial(is_set_up, "can0")), flags("can0"))
    with patient_motor("can1"):
        rpc = unit.rpc()
        check("it finds the motor", reaches(partial(rpc.motor_is, "disabled")), unit.tell())
        file = str(rpc.call("info.get")["calibration_file"])
        check("the kept calibration is in use", file.startswith(str(STATE)), file)
        # The simulated motor got its watchdog by a frame of its own, which is another program's.
        reaches(lambda: not rpc.call("health")["motor"]["foreign_active"])
        opened = rpc.insist("motion.open")
        check("it opens", opened.get("ok") is True, opened)
        rpc.call("motor.disable")


def removal() -> None:
    """All is removed but the configuration and what was measured."""
    uninstall = (f"{PROGRAMS}/litegripctl", "install-units", "--uninstall")
    status, out = run(*uninstall)
    check("refused while a daemon is enabled", status != 0 and "disable --now" in out, out)
    must("systemctl", "disable", "--now", "litegripd@can0", "litegripd.target")
    print(must(*uninstall), flush=True)
    must("systemctl", "daemon-reload")
    check("systemd knows no unit any more", Unit().show("LoadState") == "not-found")
    left = [CONFIGURATION, STATE / "can0_calibration.json", Path("/etc/litegripd/litegripd.toml")]
    check("configuration and calibration are there", all(path.exists() for path in left), left)
    check("and nothing of it runs", run("pgrep", "-f", "litegripd")[1] == "")


FIRST = (
    installation,
    one_daemon,
    page_as_a_unit,
    fleet_as_units,
    printed_after_an_upgrade,
    *ATTENDED,
    *MANAGED,
    *FAILING_UNITS,
)
SECOND = (after_reboot, removal)


def main() -> int:
    """Run the scenes of one boot, or those that are named; return 0 when every check passed."""
    boot, *names = sys.argv[1:]
    wanted = (*names, "installation")
    scenes = FIRST if boot == "1" else SECOND
    status = play([scene for scene in scenes if not names or scene.__name__ in wanted])
    if boot == "1":  # for the second one, whatever the scenes have left
        must("systemctl", "enable", Unit().name)
    return status


if __name__ == "__main__":
    sys.exit(main())
