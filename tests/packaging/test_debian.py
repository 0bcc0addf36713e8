"""The Debian packages, as far as they can be judged without building them."""

import gzip
import os
import re
import shutil
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest
import tomli

from litegrip_client.ctl import install

SOURCES = Path(__file__).parents[2]
PACKAGING = SOURCES / "packaging/debian"
BUILD = PACKAGING / "build"
SCRIPTS = [BUILD, *sorted(PACKAGING.glob("*/p*"))]
DISTRIBUTIONS = ("litegrip-client", "litegripd", "litegrip-web", "litegrip-fleet")
UNIT = "litegripd@can0.service"
PAGE = "litegripd-web.service"
STUB = """#!/bin/sh
echo "${0##*/} $*" >>"$CALLS"
case $1 in
    list-units) echo "litegripd@can0.service loaded active running LiteGrip gripper on can0" ;;
    reload) exit $RELOADED ;;
esac
"""


def put() -> dict[str, str]:
    """Return where the package has which file of the sources."""
    found = re.findall(r'^ +put "\$1" (\S+) (\S+)$', BUILD.read_text(), re.M)
    return {where: source for source, where in found}


@pytest.mark.parametrize("script", SCRIPTS, ids=lambda path: f"{path.parent.name}/{path.name}")
def test_a_shell_can_read_the_script(script: Path) -> None:
    assert script.read_text().startswith("#!/bin/sh\n")
    assert re.search(r"^set -e", script.read_text(), re.M)
    subprocess.run(["sh", "-n", str(script)], check=True)
    assert os.access(script, os.X_OK)


def test_the_units_are_where_systemd_looks_for_those_of_packages() -> None:
    files = put()
    assert set(files) == {
        install.PACKAGED,
        "usr/lib/systemd/system/litegripd.target",
        "usr/lib/systemd/system/litegripd-web.service",
        "usr/lib/systemd/system/litegripd-fleet@.service",
        "usr/lib/sysusers.d/litegripd.conf",
        "usr/lib/sysusers.d/litegripd-fleet.conf",
        "usr/lib/tmpfiles.d/litegripd.conf",
        "etc/litegripd/litegripd.toml",
        "etc/litegripd/fleet.toml",
        "usr/share/doc/litegripd/changelog",
        "usr/share/litegrip-client/litegripctl",
    }
    for source in files.values():
        assert (SOURCES / source).is_file(), source
    installed = {
        (file.content, Path(file.path).name)
        for file in (*install.units("/opt/litegripd/bin"), *install.fleet("/opt/litegripd/bin"))
    }
    packaged = {
        ((SOURCES / source).read_text(), Path(where).name) for where, source in files.items()
    }
    assert installed <= packaged


def test_what_is_a_configuration_is_kept_by_dpkg() -> None:
    configured = {f"/{where}" for where in put() if where.startswith("etc/")}
    lists = sorted(PACKAGING.glob("*/conffiles"))
    assert {path.parent.name for path in lists} == {"litegripd", "litegrip-fleet"}
    assert {name for path in lists for name in path.read_text().split()} == configured


def test_the_link_leads_from_where_the_units_look_to_where_the_version_is() -> None:
    build = BUILD.read_text()
    link = install.PROGRAMS.removesuffix("/bin/")
    assert f'ln -s "{Path(link).name}{install.VERSIONS}/$version" "$1{link}"' in build
    assert f"prefix={link}{install.VERSIONS}/$version" in build
    assert f"ExecStart={link}/bin/litegripd %i" in (SOURCES / put()[install.PACKAGED]).read_text()


def test_the_version_is_that_of_the_sources() -> None:
    (command,) = re.findall(r"^release=\$\((.*)\)$", BUILD.read_text(), re.M)
    told = subprocess.run(
        ["sh", "-c", command],
        env={**os.environ, "sources": str(SOURCES)},
        check=True,
        capture_output=True,
        text=True,
    )
    project = tomli.loads((SOURCES / "pyproject.toml").read_text())["project"]
    assert told.stdout.strip() == project["version"]


def test_there_is_a_package_for_each_distribution() -> None:
    packed = re.findall(r'^pack "\$work/[a-z]+" "?([a-z$-]+)"? ', BUILD.read_text(), re.M)
    assert set(packed) == {*DISTRIBUTIONS, "litegripd-$version"}
    controls = {path.parent.name: path.read_text() for path in PACKAGING.glob("*/control")}
    assert set(controls) == {*DISTRIBUTIONS, "version"}
    for name in ("litegrip-web", "litegrip-fleet"):
        assert "\nDepends: litegripd (= @VERSION@)" in controls[name]
    assert "\nDepends: python3 (>= 3.10)\n" in controls["litegrip-client"]


def test_every_word_of_a_template_is_filled_in() -> None:
    filled = set(re.findall(r"s\|(@[A-Z]+@)\|", BUILD.read_text()))
    used = {
        word for path in PACKAGING.glob("*/*") for word in re.findall(r"@[A-Z]+@", path.read_text())
    }
    assert used == filled


@pytest.mark.skipif(shutil.which("dpkg-deb") is None, reason="only Debian has dpkg-deb")
def test_the_packages_have_what_debian_wants_and_lintian_finds_no_error(tmp_path: Path) -> None:
    head, _, _ = BUILD.read_text().partition('mkdir -p "$sources/dist"')
    for before, after in (
        ('$(dirname "$(readlink -f "$0")")', str(PACKAGING)),
        ('"$sources/dist"', str(tmp_path)),
    ):
        assert before in head
        head = head.replace(before, after)
    tail = """
surroundings "$work/litegripd"
web "$work/web"
fleet "$work/fleet"
pack "$work/litegripd" litegripd litegripd
pack "$work/web" litegrip-web litegrip-web addition
pack "$work/fleet" litegrip-fleet litegrip-fleet addition
"""
    (tmp_path / "script").write_text(head + tail)
    maintainer = {"DEBFULLNAME": "Who Builds", "DEBEMAIL": "who@litegripd.org"}
    subprocess.run(["sh", str(tmp_path / "script")], env={**os.environ, **maintainer}, check=True)
    package = next(tmp_path.glob("litegripd_*.deb"))
    subprocess.run(["dpkg-deb", "--extract", str(package), str(tmp_path / "tree")], check=True)
    for page in ("man8/litegripd.8.gz", "man1/litegrip-sim.1.gz"):
        assert (tmp_path / "tree/usr/share/man" / page).is_file()
    documents = tmp_path / "tree/usr/share/doc/litegripd"
    assert {path.name for path in documents.iterdir()} == {
        "changelog.Debian.gz",
        "changelog.gz",
        "copyright",
    }
    assert "/usr/share/common-licenses/Apache-2.0" in (documents / "copyright").read_text()
    newest = gzip.decompress((documents / "changelog.Debian.gz").read_bytes()).decode()
    assert newest.startswith("litegripd (")
    assert " -- Who Builds <who@litegripd.org>  " in newest
    if shutil.which("lintian") is None:
        return
    packages = sorted(map(str, tmp_path.glob("*.deb")))
    assert len(packages) == 3
    told = subprocess.run(["lintian", *packages], capture_output=True, text=True, check=False)
    assert [line for line in told.stdout.splitlines() if line.startswith("E:")] == []
    assert told.returncode == 0


def test_a_revision_that_no_package_may_have_is_refused() -> None:
    told = subprocess.run([str(BUILD), "1~rc"], capture_output=True, text=True, check=False)
    assert told.returncode == 2
    assert "allowed are digits, small letters and dots" in told.stderr


class System:
    """A machine of which only the service manager is asked."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._calls = folder / "calls"
        self._programs = folder / "programs"
        self._programs.mkdir()
        (folder / "booted").mkdir()
        for name in ("systemctl", "systemd-sysusers"):
            (self._programs / name).write_text(STUB)
            (self._programs / name).chmod(0o755)

    def run(
        self, script: str, *arguments: str, reloaded: int = 0
    ) -> "subprocess.CompletedProcess[str]":
        """Run a script of a maintainer's on it."""
        text = (PACKAGING / script).read_text().replace("@UNIT@", PAGE)
        for path, here in (
            ("/run/systemd/system", "booted"),
            ("@PREFIX@", "version"),
            ("/opt/litegripd", "link"),
            ("/etc/systemd", "etc"),
            ("/usr/local/lib/systemd/system", "local"),
        ):
            text = text.replace(path, str(self.folder / here))
        (self.folder / "script").write_text(text)
        environment = {
            "PATH": f"{self._programs}:{os.environ['PATH']}",
            "CALLS": str(self._calls),
            "RELOADED": str(reloaded),
        }
        command = ["sh", str(self.folder / "script"), *arguments]
        return subprocess.run(command, env=environment, capture_output=True, text=True, check=False)

    @property
    def calls(self) -> Sequence[str]:
        """What has been asked of it."""
        return self._calls.read_text().splitlines() if self._calls.exists() else []


@pytest.fixture
def system(tmp_path: Path) -> System:
    return System(tmp_path)


@pytest.mark.parametrize("reloaded", [0, 1])
def test_an_upgrade_reloads_whoever_runs_and_never_restarts(system: System, reloaded: int) -> None:
    assert system.run("litegripd/prerm", "upgrade", "0.2.0-1").returncode == 0
    assert system.run("litegripd/preinst", "upgrade", "0.1.0-1").returncode == 0
    assert system.run("litegripd/postrm", "upgrade", "0.2.0-1").returncode == 0
    assert system.calls == []
    configured = system.run("litegripd/postinst", "configure", "0.1.0-1", reloaded=reloaded)
    assert configured.returncode == 0, "an upgrade ends well even where a daemon may not follow now"
    assert system.calls == [
        "systemd-sysusers litegripd.conf",
        "systemctl daemon-reload",
        "systemctl list-units --plain --no-legend --state=active litegripd@*.service",
        f"systemctl reload {UNIT}",
    ]
    told = f"later, without letting go: systemctl reload '{UNIT}'" in configured.stderr
    assert told == bool(reloaded)


def test_a_system_that_is_not_booted_is_asked_for_users_only(system: System) -> None:
    (system.folder / "booted").rmdir()
    for script, *arguments in (
        ("litegripd/postinst", "configure", ""),
        ("litegripd/prerm", "remove"),
        ("litegripd/postrm", "remove"),
    ):
        assert system.run(script, *arguments).returncode == 0
    assert system.calls == ["systemd-sysusers litegripd.conf"]


def test_a_copy_that_shadows_the_unit_is_told(system: System) -> None:
    (system.folder / "local").mkdir()
    (system.folder / "local/litegripd@.service").touch()
    configured = system.run("litegripd/postinst", "configure", "")
    assert "to remove it: litegripctl install-units" in configured.stderr


def test_removal_stops_what_runs(system: System) -> None:
    assert system.run("litegripd/prerm", "remove").returncode == 0
    assert system.run("litegripd/postrm", "remove").returncode == 0
    stop = "systemctl stop litegripd@*.service litegripd.target"
    assert system.calls == [stop, "systemctl daemon-reload"]


def test_an_addition_is_restarted_by_an_upgrade_and_stopped_by_removal(system: System) -> None:
    for script, *arguments in (
        ("addition/prerm", "upgrade", "0.2.0-1"),
        ("addition/postrm", "upgrade", "0.2.0-1"),
    ):
        assert system.run(script, *arguments).returncode == 0
    assert system.calls == []
    assert system.run("addition/postinst", "configure", "0.1.0-1").returncode == 0
    upgraded = ["systemd-sysusers", "systemctl daemon-reload", f"systemctl try-restart {PAGE}"]
    assert [*map(str.strip, system.calls)] == upgraded
    assert system.run("addition/prerm", "remove").returncode == 0
    assert system.run("addition/postrm", "remove").returncode == 0
    assert system.calls[3:] == [f"systemctl stop {PAGE}", "systemctl daemon-reload"]


def test_only_a_purge_forgets_which_units_are_enabled(system: System) -> None:
    wants = system.folder / "etc/system/litegripd.target.wants"
    wants.mkdir(parents=True)
    (wants / UNIT).symlink_to("/usr/lib/systemd/system/litegripd@.service")
    (wants / "litegripd-web.service").symlink_to("/usr/lib/systemd/system/litegripd-web.service")
    (wants / "litegripd-fleet@gateway.service").symlink_to(
        "/usr/lib/systemd/system/litegripd-fleet@.service"
    )
    system.run("litegripd/postrm", "remove")
    assert (wants / UNIT).is_symlink()
    system.run("litegripd/postrm", "purge")
    assert [path.name for path in sorted(wants.iterdir())] == [
        "litegripd-fleet@gateway.service",
        PAGE,
    ]
    system.run("addition/postrm", "remove")
    assert (wants / PAGE).is_symlink()
    system.run("addition/postrm", "purge")
    assert [path.name for path in wants.iterdir()] == ["litegripd-fleet@gateway.service"]


def test_litegripctl_is_that_of_the_daemons_environment_where_there_is_one(tmp_path: Path) -> None:
    text = (PACKAGING / "litegripctl").read_text()
    for name in ("/opt/litegripd/bin", "/usr/share/litegrip-client"):
        where = tmp_path / name.lstrip("/")
        where.mkdir(parents=True)
        (where / "litegripctl").write_text(f'#!/bin/sh\necho {name} "$1"\n')
        (where / "litegripctl").chmod(0o755)
        text = text.replace(name, str(where))
    (tmp_path / "script").write_text(text)

    def told() -> str:
        command = ["sh", str(tmp_path / "script"), "a b"]
        return subprocess.run(command, capture_output=True, text=True, check=True).stdout

    assert told() == "/opt/litegripd/bin a b\n"
    (tmp_path / "opt/litegripd/bin/litegripctl").unlink()
    assert told() == "/usr/share/litegrip-client a b\n"


def test_a_directory_in_the_place_of_the_link_is_refused(system: System) -> None:
    link = system.folder / "link"
    assert system.run("litegripd/preinst", "install").returncode == 0
    link.symlink_to(system.folder)
    assert system.run("litegripd/preinst", "upgrade").returncode == 0
    link.unlink()
    link.mkdir()
    refused = system.run("litegripd/preinst", "install")
    assert refused.returncode == 1
    assert f"first: mv {link} {link}-before" in refused.stderr


@pytest.fixture
def running(system: System) -> Iterator["subprocess.Popen[bytes]"]:
    """A process of a version's interpreter."""
    (system.folder / "version/bin").mkdir(parents=True)
    name = str(system.folder / "version/bin/python3")
    process = subprocess.Popen([name, "100"], executable="/bin/sleep")
    yield process
    process.kill()
    process.wait()


def test_a_version_that_still_runs_is_not_removed(
    system: System, running: "subprocess.Popen[bytes]"
) -> None:
    refused = system.run("version/prerm", "remove")
    assert refused.returncode == 1
    assert f": {running.pid} \n" in refused.stderr
    assert (system.folder / "version").exists()
    running.kill()
    running.wait()
    assert system.run("version/prerm", "upgrade").returncode == 0
    assert (system.folder / "version").exists()
    assert system.run("version/prerm", "remove").returncode == 0
    assert not (system.folder / "version").exists()
