"""The Debian packages: installed, upgraded while the jaws hold, removed, purged. Run in the VM.

The scenes build on each other. `dpkg` alone is used, for the machine has no network.
"""

import contextlib
import sys
from pathlib import Path

from tests.vm.attended import at_work, hold_through
from tests.vm.guest import check, play, reaches
from tests.vm.unit import CONFIGURATION, SLOW, STATE, Unit, ctl, install_units, must, run

PACKAGES = Path("/mnt/host/packages")
VERSIONS = Path("/opt/litegripd-versions")
UNIT_FILE = Path("/usr/lib/systemd/system/litegripd@.service")


def put(revision: int) -> str:
    """Install both packages of a revision, the programs first; return what dpkg said."""
    said = []
    for name in (f"litegripd-*-{revision}_*.deb", f"litegripd_*-{revision}_*.deb"):
        (file,) = PACKAGES.glob(name)
        status, out = run("dpkg", "--install", str(file), limit_s=600.0)
        check(f"dpkg installs {file.name}", status == 0, "" if status == 0 else out)
        said.append(out)
    return "\n".join(said)


def version(revision: int) -> str:
    """Return the name of the package with the programs of a revision."""
    (folder,) = VERSIONS.glob(f"*-{revision}")
    return f"litegripd-{folder.name}"


def runs(unit: Unit, revision: int) -> bool:
    """True if the daemon is of a revision."""
    command = Path(f"/proc/{unit.pid}/cmdline").read_text()
    return command.startswith(f"{VERSIONS}/") and f"-{revision}/bin/" in command


def package_installed() -> None:
    """Both packages on a bare system, and install-units as the page says."""
    put(1)
    must("useradd", "--create-home", "alice")
    CONFIGURATION.write_text(SLOW)
    install_units("alice", "can0", "can1")
    unit = Unit()
    path = Path(unit.show("FragmentPath")).resolve()  # of Debian 12 by way of /lib
    check("the unit is the package's", path == UNIT_FILE, path)
    check("the daemon runs", unit.is_active() and runs(unit, 1), unit.tell())
    must("systemctl", "disable", "--now", "litegripd@can1")
    with at_work(unit):
        status, out = ctl("alice", "enable")
        check("alice uses it", status == 0, out)
        ctl("alice", "disable")


def package_upgraded() -> None:
    """An upgrade lets nothing go; the version before is kept while a process runs it."""
    unit = Unit()
    with at_work(unit) as rpc:
        check("the jaws hold", rpc.insist("motion.open").get("ok") is True, rpc.state()["mode"])
        before, restarts = unit.pid, unit.restarts
        status, out = run("dpkg", "--remove", version(1))
        check("what is in use is not removed", status != 0, out)
        said = put(2)
        refused = "goes on with the version before" in said
        print(
            f"      the reload of the upgrade was {'refused' if refused else 'taken'}", flush=True
        )
        if refused:  # a slow machine: the jaws are held by the version before, as the page says
            check("then the daemon before goes on", unit.pid == before and runs(unit, 1))
            held, tries = hold_through(("systemctl", "reload", unit.name))
            check("a reload later", held, f"{tries} tries")
        followed = reaches(lambda: unit.pid not in (0, before) and runs(unit, 2))
        check("the daemon is of the new version", followed, unit.tell())
        check("it was never started again", unit.restarts == restarts, unit.tell())
        with contextlib.closing(unit.rpc()) as successor:
            state = successor.state()
            check("the motor is enabled still", state["motor"] == "enabled", state["motor"])
            successor.call("motor.disable")
            reaches(lambda: successor.motor_is("disabled"))
    gone = reaches(lambda: run("dpkg", "--remove", version(1))[0] == 0)
    check("then the version before can go", gone and not list(VERSIONS.glob("*-1")))


def package_back() -> None:
    """The way back is the installation of the older packages."""
    put(1)
    unit = Unit()
    unit.restart()
    check("it is the older one again", unit.is_active() and runs(unit, 1), unit.tell())
    put(2)
    unit.restart()


def package_removed() -> None:
    """Removed, the configuration stays; purged, that has gone, and what was measured stays."""
    unit = Unit()
    must("systemctl", "enable", unit.name)
    kept = STATE / "can0_calibration.json"
    kept.write_text("{}")
    names = [version(1), version(2)]
    must("dpkg", "--remove", "litegripd")
    check("it has ended", unit.show("ActiveState") == "inactive", unit.tell())
    check("systemd knows no unit any more", unit.show("LoadState") == "not-found")
    conffile = Path("/etc/litegripd/litegripd.toml")
    check("the configuration stays", conffile.exists() and CONFIGURATION.exists())
    for name in names:
        must("dpkg", "--purge", name)
    must("dpkg", "--purge", "litegripd")
    check("purged, the configuration has gone", not conffile.exists())
    wants = list(Path("/etc/systemd/system").glob("*.wants/litegripd*"))
    check("and what was enabled", not wants, wants)
    check("no version is left", not list(VERSIONS.glob("*")))  # nor /opt, where it was empty
    check("what was measured stays", kept.exists() and CONFIGURATION.exists())
    check("and no process", run("pgrep", "-f", "bin/litegripd")[1] == "")


SCENES = (package_installed, package_upgraded, package_back, package_removed)


def main() -> int:
    """Run the scenes, or those that are named; return 0 when every check passed."""
    _boot, *names = sys.argv[1:]
    return play([scene for scene in SCENES if not names or scene.__name__ in names])


if __name__ == "__main__":
    sys.exit(main())
