"""True if the daemons' user can run an environment, by the modes of all that it takes.

The reader in question is who runs the tests: the way to their files is closed to everybody else.
"""

import os
import sys
from pathlib import Path

import pytest

from litegrip_client.ctl import install
from litegrip_client.ctl.install import Reader, obstacle, reader_of
from litegrip_client.values.errors import CommandError

OWNER = Reader(os.getuid(), frozenset(os.getgroups()))
FOLDERS = {"scripts": "bin", "purelib": "lib", "platlib": "lib"}


@pytest.fixture
def environment(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An environment with links to its interpreter as venv makes them."""
    made = tmp_path / "litegripd"
    for name in ("bin", "lib/litegripd", "lib/__pycache__"):
        (made / name).mkdir(parents=True)
    (tmp_path / "usr").mkdir()
    (tmp_path / "usr/python3.11").touch(0o755)
    (made / "bin/python3").symlink_to("../../usr/python3.11")
    (made / "bin/python").symlink_to("python3")
    for name in ("litegripd", "litegripctl"):
        (made / "bin" / name).write_text(f"#!{made}/bin/python -I\n")
        (made / "bin" / name).chmod(0o755)
    (made / "lib/module.py").touch(0o644)
    monkeypatch.setattr("sysconfig.get_path", lambda name: str(made / FOLDERS[name]))
    monkeypatch.setattr("importlib.util.find_spec", lambda _name: None)
    monkeypatch.setattr(sys, "prefix", str(made))
    return made


def test_an_environment_that_is_open_is_no_obstacle(environment: Path) -> None:
    (environment / "lib/__pycache__").chmod(0o000)  # Python does without it
    assert obstacle(str(environment / "bin"), OWNER) is None


@pytest.mark.parametrize(
    ("name", "mode"),
    [
        ("", 0o600),  # no way through
        ("bin/litegripd", 0o655),
        ("bin/litegripctl", 0o655),
        ("../usr", 0o600),
        ("../usr/python3.11", 0o655),
        ("lib", 0o355),
        ("lib/litegripd", 0o655),
        ("lib/module.py", 0o244),
    ],
)
def test_what_is_closed_is_named(environment: Path, name: str, mode: int) -> None:
    closed = (environment / name).resolve()
    closed.chmod(mode)
    try:
        found = obstacle(str(environment / "bin"), OWNER)
    finally:
        closed.chmod(0o755)
    assert found is not None
    assert (found.path.resolve(), f"(mode {mode:04o})" in found.why) == (closed, True)


def test_an_interpreter_that_was_taken_away_is_named(environment: Path) -> None:
    (environment.parent / "usr/python3.11").unlink()
    found = obstacle(str(environment / "bin"), OWNER)
    assert found is not None
    assert str(found) == f"{environment}/bin/python cannot be used: No such file or directory"


def test_an_access_list_is_trusted(environment: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (environment / "lib/module.py").chmod(0o044)
    monkeypatch.setattr(os, "listxattr", lambda _path: ["system.posix_acl_access"])
    assert obstacle(str(environment / "bin"), OWNER) is None


def test_user_group_and_others_each_have_their_bits(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    owner, group = file.stat().st_uid, file.stat().st_gid
    readers = (Reader(owner), Reader(-1, frozenset({group})), Reader())
    for mode, wanted in ((0o400, 0), (0o040, 1), (0o004, 2)):
        file.chmod(mode)
        able = [number for number, reader in enumerate(readers) if reader.may(file, 4)]
        assert able == [wanted]


def test_a_user_that_there_is_not_yet_is_as_all_others() -> None:
    assert reader_of("no-such-user-here") == Reader()
    assert reader_of("root").uid == 0


@pytest.mark.parametrize(
    ("name", "remedy"),
    [("lib/module.py", "chmod --recursive go+rX {prefix}"), ("../usr", "python3 -m venv /opt/")],
)
def test_the_installation_is_refused_with_the_remedy(
    environment: Path, monkeypatch: pytest.MonkeyPatch, name: str, remedy: str
) -> None:
    monkeypatch.setattr(install, "_HIDDEN", ())
    monkeypatch.setattr(install, "reader_of", lambda: OWNER)
    closed = environment / name
    closed.chmod(0o255 if closed.is_file() else 0o655)
    try:
        with pytest.raises(CommandError, match="the user litegrip cannot run") as refused:
            install.program_directory()
    finally:
        closed.chmod(0o755)
    assert remedy.format(prefix=environment) in (refused.value.hint or "")
