"""The Debian packages: installed, upgraded while the jaws hold, removed, purged. Run in the VM.

The scenes build on each other. `dpkg` alone is used, for the machine has no network.
"""

import contextlib
import sys
from functools import partial
from pathlib import Path

from tests.vm.attended import at_work, hold_through
from tests.vm.beside import FLEET, FLEET_CONFIG, PARTS, WEB, WITH_GATEWAY
from tests.vm.guest import check, play, reaches
from tests.vm.unit import CONFIGURATION, SLOW, STATE, Unit, ctl, install_units, must, run

PACKAGES = Path("/mnt/host/packages")
VERSIONS = Path("/opt/litegripd-versions")
BESIDE = (WEB, *(f"litegripd-fleet@{part}.service" for part in PARTS))
UNIT_FILE = Path("/usr/lib/systemd/system/litegripd@.service")
CLIENT, DAEMON, ADDITIONS = "litegrip-client", "litegripd", ("litegrip-web", "litegrip-fleet")


def put(revision: int, *names: str) -> str:
    """Install packages of a revision, or all, in two steps as apt does; return what dpkg said."""
    names = names or (CLIENT, DAEMON, *ADDITIONS)
    first = [f"{name}-*" if name == DAEMON else name for name in names if name not in ADDITIONS]
    then = [name for name in names if name != CLIENT]
    said = []
    for step in (first, then):  # what is pre-depended on first
        files = [str(file) for name in step for file in PACKAGES.glob(f"{name}_*-{revision}_*.deb")]
        if files:
            status, out = run("dpkg", "--install", *files, limit_s=600.0)
            check(f"dpkg installs {len(files)} packages", status == 0, "" if status == 0 else out)
            said.append(out)
    return "\n".join(said)


def version(revision: int) -> str:
    """Return the name of the package with the programs of a revision."""
    (folder,) = VERSIONS.glob(f"*-{revision}")
    return f"litegripd-{folder.name}"


def is_of(pid: int, revision: int) -> bool:
    """True if a process is of a revision."""
    try:
        command = Path(f"/proc/{pid}/cmdline").read_text()
    except OSError:  # it has just ended
        return False
    return command.startswith(f"{VERSIONS}/") and f"-{revision}/bin/" in command


def is_removed(name: str) -> bool:
    """Remove a package; return True if that was possible."""
    return run("dpkg", "--remove", name)[0] == 0


def runs(unit: Unit, revision: int) -> bool:
    """True if the daemon is of a revision."""
    return is_of(unit.pid, revision)


def beside_run(revision: int) -> bool:
    """True if page and fleet run, and are of a revision."""
    pids = [must("systemctl", "show", "--property=MainPID", "--value", name) for name in BESIDE]
    return all(is_of(int(pid), revision) for pid in pids)


def client_alone() -> None:
    """The client on a bare system: for programs of the system's Python, and for a shell."""
    put(1, CLIENT)
    version_told = must("litegripctl", "--version")
    told = must("python3", "-c", "import litegrip_client as c; print('litegripctl', c.__version__)")
    check("the module is of the version", told == version_told, f"{told}, {version_told}")
    for command, said in (
        (("fleet",), "sudo apt install litegrip-fleet"),
        (("install-units",), "apt install litegripd"),
    ):
        status, out = run("litegripctl", *command)
        is_told = status != 0 and said in out and "Traceback" not in out
        check(f"{command[0]} tells what is missing", is_told, out)
    check("the manual is there", Path("/usr/share/man/man1/litegripctl.1.gz").is_file())


def package_installed() -> None:
    """The daemon beside the client, install-units as the page says, and then page and fleet."""
    put(1, DAEMON)
    for program in ("litegripd-web", "litegripd-fleet"):
        check(f"{program} is not there", not Path(f"/opt/litegripd/bin/{program}").exists())
    status, out = run("litegripctl", "fleet")
    check("what fleet needs is told", "sudo apt install litegrip-fleet" in out, out)
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
    pid = unit.pid
    put(1, *ADDITIONS)
    check("the daemon went on meanwhile", unit.pid == pid and unit.is_active(), unit.tell())
    check("no page was started", run("systemctl", "is-active", WEB)[1] == "inactive")


def package_upgraded() -> None:
    """An upgrade lets nothing go; the version before is kept while a process runs it."""
    unit = Unit()
    FLEET.write_text(FLEET_CONFIG)
    CONFIGURATION.write_text(WITH_GATEWAY)
    unit.restart()
    must("systemctl", "start", *BESIDE)
    with at_work(unit) as rpc:
        check("page and fleet run", reaches(partial(beside_run, 1)))
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
        check("page and fleet are of the new version", reaches(partial(beside_run, 2)))
        check("it was never started again", unit.restarts == restarts, unit.tell())
        with contextlib.closing(unit.rpc()) as successor:
            state = successor.state()
            check("the motor is enabled still", state["motor"] == "enabled", state["motor"])
            successor.call("motor.disable")
            reaches(lambda: successor.motor_is("disabled"))
    gone = reaches(partial(is_removed, version(1)))
    check("then the version before can go", gone and not list(VERSIONS.glob("*-1")))


def package_back() -> None:
    """The way back is the installation of the older packages; both ways without the power."""
    unit = Unit()
    state = reaches(lambda: unit.rpc().state()["motor"] in ("silent", "unknown"))
    check("the motor does not answer", state, unit.tell())
    for revision in (1, 2):
        put(revision)
        followed = reaches(partial(runs, unit, revision)) and unit.is_active()
        check(f"without power: the daemon is of revision {revision}", followed, unit.tell())
        check(f"and page and fleet are of {revision}", reaches(partial(beside_run, revision)))
        gone = reaches(partial(is_removed, version(3 - revision)))
        check("the other one can go", gone)


def package_removed() -> None:
    """Removed, the configuration stays; purged, that has gone, and what was measured stays."""
    unit = Unit()
    must("systemctl", "enable", unit.name)
    kept = STATE / "can0_calibration.json"
    kept.write_text("{}")
    names = [version(2)]
    must("systemctl", "enable", WEB)
    status, out = run("dpkg", "--remove", DAEMON)
    check("not while page and fleet are there", status != 0 and unit.is_active(), out)
    must("dpkg", "--remove", *ADDITIONS)
    ended = [run("systemctl", "is-active", name)[1] == "inactive" for name in BESIDE]
    check("page and fleet have ended, the daemon has not", all(ended) and unit.is_active())
    must("dpkg", "--remove", DAEMON)
    check("it has ended", unit.show("ActiveState") == "inactive", unit.tell())
    check("systemd knows no unit any more", unit.show("LoadState") == "not-found")
    conffile = Path("/etc/litegripd/litegripd.toml")
    check("the configuration stays", all(map(Path.exists, (conffile, FLEET, CONFIGURATION))))
    status, out = run("litegripctl", "--version")
    check("litegripctl is the client's own again", status == 0, out)
    for name in names:
        must("dpkg", "--purge", name)
    must("dpkg", "--purge", DAEMON, CLIENT, *ADDITIONS)
    check("purged, the configuration has gone", not conffile.exists() and not FLEET.exists())
    module = Path("/usr/lib/python3/dist-packages/litegrip_client")
    check("and the client", not module.exists() and not Path("/usr/bin/litegripctl").exists())
    wants = list(Path("/etc/systemd/system").glob("*.wants/litegripd*"))
    check("and what was enabled", not wants, wants)
    check("no version is left", not list(VERSIONS.glob("*")))  # nor /opt, where it was empty
    check("what was measured stays", kept.exists() and CONFIGURATION.exists())
    check("and no process", run("pgrep", "-f", "bin/litegripd")[1] == "")


SCENES = (client_alone, package_installed, package_upgraded, package_back, package_removed)


def main() -> int:
    """Run the scenes, or those that are named; return 0 when every check passed."""
    _boot, *names = sys.argv[1:]
    return play([scene for scene in SCENES if not names or scene.__name__ in names])


if __name__ == "__main__":
    sys.exit(main())
