"""install-units beside versions with a link to one of them, and beside the Debian package."""

from pathlib import Path

import pytest

from litegrip_client.ctl import install
from litegrip_client.ctl.run import installing
from litegrip_client.values.errors import CommandError
from litegrip_client.values.version import is_of_debian
from tests.client.units.system import CONFIGURATION, RULES, UNIT, System


@pytest.fixture
def versions(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A directory of two versions, this program being of the first."""
    monkeypatch.setattr(install, "_HIDDEN", ())  # the directory is one of those
    monkeypatch.setattr(install, "obstacle", lambda *_arguments: None)  # and closed to others
    folder = tmp_path / "litegripd-versions"
    for version in ("1.0", "2.0"):
        programs = folder / version / "bin"
        programs.mkdir(parents=True)
        (programs / "litegripd").touch()
    monkeypatch.setattr("sysconfig.get_path", lambda _name: str(folder / "1.0/bin"))
    return folder


def test_the_unit_has_the_path_by_the_link(versions: Path) -> None:
    link = versions.with_name("litegripd")
    link.symlink_to("litegripd-versions/1.0")
    assert install.program_directory() == f"{link}/bin"


def test_the_program_of_a_version_that_the_link_does_not_lead_to_installs_nothing(
    versions: Path,
) -> None:
    link = versions.with_name("litegripd")
    for leads_elsewhere in (False, True):
        if leads_elsewhere:
            link.symlink_to("litegripd-versions/2.0")
        with pytest.raises(
            CommandError, match=f"{link} does not lead to {versions}/1.0"
        ) as refused:
            install.program_directory()
        switch = f"ln -s litegripd-versions/1.0 {link}.new && mv -T {link}.new {link}"
        assert str(refused.value.hint).endswith(switch)


@pytest.fixture
def packaged(system: System) -> System:
    """Return a system on which the package is installed."""
    for path in (install.PACKAGED, CONFIGURATION):
        system.write(path)
    return system


def test_beside_the_package_only_the_interfaces_are_installed(packaged: System) -> None:
    told = packaged.shows("--can", "can1", "--serial")
    own = {RULES, f"{UNIT}.d/serial.conf", install.SERIAL_RULES}
    assert packaged.files() == {install.PACKAGED, CONFIGURATION, *own}
    assert "note: the units are those of the Debian package" in told


def test_copies_of_the_units_that_would_shadow_the_packages_are_removed(packaged: System) -> None:
    unit = packaged.root / install.PACKAGED
    unit.unlink()
    packaged.put("--can=can0")
    assert len(packaged.files()) == 7
    unit.touch()
    assert sorted(packaged.put().values()) == ["kept", *["removed"] * 5, "unchanged"]
    assert packaged.files() == {install.PACKAGED, CONFIGURATION, RULES}


def test_what_is_beside_the_package_is_removed_while_a_unit_is_enabled(packaged: System) -> None:
    packaged.put("--can=can0", "--serial")
    link = packaged.enable("litegripd@can0.service")
    removed = sorted(packaged.put("--uninstall").values())
    assert removed == ["kept", "removed", "removed", "removed"]
    assert packaged.files() == {install.PACKAGED, CONFIGURATION}
    assert link.is_symlink()


def test_what_a_debian_package_lacks_comes_by_apt(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("litegrip_client.ctl.run.is_of_debian", lambda: True)
    monkeypatch.setattr("sys.executable", "/x/python3")
    monkeypatch.setattr("sys.base_prefix", "/usr")
    monkeypatch.setattr("sys.prefix", "/opt/litegripd-versions/1")
    assert installing("litegrip-fleet") == "sudo apt install litegrip-fleet"
    assert installing("matplotlib", "mcap") == "/x/python3 -m pip install matplotlib mcap"
    monkeypatch.setattr("sys.prefix", "/usr")
    assert installing("rich") == "sudo apt install python3-rich"
    allowed = "--user --break-system-packages"
    assert (
        installing("matplotlib", "mcap") == f"/x/python3 -m pip install {allowed} matplotlib mcap"
    )


@pytest.mark.parametrize(("installer", "is_debian"), [("dpkg", True), ("pip", False)])
def test_who_has_installed_the_client_stands_beside_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, installer: str, is_debian: bool
) -> None:
    about = tmp_path / "litegrip_client-9.dist-info"
    about.mkdir()
    (about / "METADATA").write_text("Metadata-Version: 2.1\nName: litegrip-client\nVersion: 9\n")
    (about / "INSTALLER").write_text(f"{installer}\n")
    monkeypatch.syspath_prepend(tmp_path)
    assert is_of_debian() == is_debian


def test_units_whose_packages_are_of_debian_are_completed_by_apt(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("litegrip_client.ctl.install.is_of_debian", lambda: True)
    monkeypatch.setattr("importlib.util.find_spec", lambda _name, _package=None: None)
    remedies = {one.unit: one.remedy for one in install.lacking("/opt/litegripd/bin")}
    assert remedies == {
        "litegripd-web": "apt install litegrip-web",
        "litegripd-fleet@": "apt install litegrip-fleet",
    }
    monkeypatch.setattr("sysconfig.get_path", lambda _kind: str(tmp_path))
    with pytest.raises(CommandError) as refused:
        install.program_directory()
    assert refused.value.data["hint"] == "apt install litegripd"
