"""Who sets a CAN interface up: the files are found, and what the doctor prints corrects them."""

import os
import subprocess
from pathlib import Path

import pytest

from litegrip_client.socketcan.managers import Setting, settings_of

RUNS = {
    "systemd-networkd": "run/systemd/netif/links/",
    "ifupdown": "sbin/ifup",
    "NetworkManager": "run/NetworkManager/devices/",
}
"""What shows that a manager is in use."""


def put(root: Path, path: str, content: str = "") -> Path:
    file = root / path
    if path.endswith("/"):
        file.mkdir(parents=True, exist_ok=True)
        return file
    file.parent.mkdir(parents=True, exist_ok=True)
    file.write_text(content, encoding="utf-8")
    return file


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """Return a system on which every manager is in use."""
    for path in RUNS.values():
        put(tmp_path, path)
    put(tmp_path, "etc/NetworkManager/conf.d/")
    return tmp_path


def found(root: Path, name: str = "can0", driver: str | None = None) -> list[Setting]:
    return settings_of(name, driver, root)


def mend(root: Path, setting: Setting) -> list[str]:
    """Carry out the command of a setting in a shell, without root; return what else it has run."""
    programs, log = root / "programs", root / "ran"
    put(root, "programs/sudo", '#!/bin/sh\nexec "$@"\n').chmod(0o755)
    for name in ("networkctl", "nmcli"):
        put(root, f"programs/{name}", f'#!/bin/sh\necho {name} "$@" >> {log}\n').chmod(0o755)
    assert setting.command is not None
    environment = {**os.environ, "PATH": f"{programs}:{os.environ['PATH']}"}
    subprocess.run(["sh", "-ec", setting.command], env=environment, check=True, capture_output=True)
    return log.read_text(encoding="utf-8").splitlines() if log.exists() else []


NETWORK = "[Match]\nName=can*\n\n[CAN]\n# the robot's\nBitRate=500K\nRestartSec=100ms\n"
INTERFACES = "auto lo\niface lo inet loopback\n\nauto can0\niface can0 can static\n"
WRONG = [
    pytest.param("etc/systemd/network/80-can.network", NETWORK, "systemd-networkd", 6, 500_000, (),
                 id="networkd"),
    pytest.param("usr/lib/systemd/network/80-can.network",
                 NETWORK.replace("500K", "1M\nListenOnly=yes\nFDMode=true"),
                 "systemd-networkd", 6, 1_000_000, ("FD", "LISTEN-ONLY"), id="networkd's modes"),
    pytest.param("etc/network/interfaces", f"{INTERFACES}    bitrate 250000\n", "ifupdown", 6,
                 250_000, (), id="interfaces"),
    pytest.param("etc/network/interfaces.d/can",
                 "iface can0 inet manual\n  pre-up ip link set $IFACE type can bitrate 500000\n",
                 "ifupdown", 2, 500_000, (), id="interfaces.d, by a command"),
    pytest.param("etc/udev/rules.d/99-can.rules",
                 'ACTION=="add", SUBSYSTEM=="net", KERNEL=="can*", RUN+="/sbin/ip link set %k up'
                 ' type can bitrate 500000"\n', "a rule of udev", 1, 500_000, (), id="udev"),
    pytest.param("etc/systemd/system/can0.service",
                 "[Service]\nExecStart=/sbin/ip -d link set can0 type can bitrate 125000\n",
                 "a unit of systemd", 2, 125_000, (), id="a unit"),
    pytest.param("etc/rc.local",
                 "#!/bin/sh\nip link set dev can0 up type can dbitrate 5000000 bitrate 500000\n",
                 "a script at boot", 2, 500_000, (), id="rc.local"),
]  # fmt: skip


@pytest.mark.parametrize(("path", "content", "manager", "line", "bitrate", "modes"), WRONG)
def test_what_sets_another_rate_is_found_and_its_command_corrects_it(
    root: Path, path: str, content: str, manager: str, line: int, bitrate: int, modes: tuple[str]
) -> None:
    put(root, path, content)
    (setting,) = found(root)
    assert (setting.manager, setting.file, setting.line) == (manager, str(root / path), line)
    assert (setting.bitrate, setting.modes, setting.is_wrong) == (bitrate, modes, True)
    assert f"{root / path}:{line} ({manager}) sets {bitrate / 1e6:g} Mbit/s" in setting.text
    mend(root, setting)
    (after,) = found(root)
    assert (after.is_wrong, after.bitrate, after.modes) == (False, 1_000_000, ())


def test_networkd_is_told_to_take_its_corrected_file(root: Path) -> None:
    put(root, "etc/systemd/network/80-can.network", NETWORK)
    assert mend(root, found(root)[0]) == ["networkctl reload"]


@pytest.mark.parametrize("path", list(RUNS.values()))
def test_the_files_of_a_manager_that_is_not_in_use_set_nothing(root: Path, path: str) -> None:
    put(root, "etc/systemd/network/80-can.network", NETWORK)
    put(root, "etc/network/interfaces", f"{INTERFACES}    bitrate 250000\n")
    put(root, "etc/NetworkManager/system-connections/can.nmconnection", PROFILE)
    assert len(found(root)) == 3
    one = root / path
    one.rmdir() if one.is_dir() else one.unlink()
    assert len(found(root)) == 2


PROFILE = "[connection]\nid=bus\ntype=generic\ninterface-name=can0\n"


def test_a_profile_of_network_manager_takes_the_link_until_it_is_left_alone(root: Path) -> None:
    file = put(root, "etc/NetworkManager/system-connections/can.nmconnection", PROFILE)
    (setting,) = found(root)
    assert setting.text == (
        f"{file} (NetworkManager) takes it: by this profile, which has no bit rate, it is set up"
        " and down"
    )
    assert mend(root, setting) == ["nmcli general reload"]
    assert found(root) == []


def test_profiles_of_others_and_those_that_do_not_connect_are_none(root: Path) -> None:
    folder = "etc/NetworkManager/system-connections"
    put(root, f"{folder}/a.nmconnection", PROFILE.replace("can0", "can1"))
    put(root, f"{folder}/b.nmconnection", f"{PROFILE}autoconnect=false\n")
    assert found(root) == []
    assert len(found(root, "can1")) == 1


def test_a_file_of_networkd_that_keeps_the_link_down_is_corrected(root: Path) -> None:
    content = "[Match]\nType=can\n[Link]\nActivationPolicy=always-down\n"
    put(root, "etc/systemd/network/can.network", content)
    (setting,) = found(root)
    assert setting.text.endswith("(systemd-networkd) keeps it down")
    mend(root, setting)
    assert [one.is_wrong for one in found(root)] == [False]


@pytest.mark.parametrize(
    "match",
    [
        "Name=can1",
        "Name=!can0 eth*",
        "Type=ether",
        "MACAddress=00:11:22:33:44:55",
        "Driver=mcp251x",
    ],
)
def test_a_file_for_other_interfaces_does_not_count(root: Path, match: str) -> None:
    put(root, "etc/systemd/network/80-can.network", NETWORK.replace("Name=can*", match))
    assert found(root, driver="gs_usb") == []


def test_the_first_file_that_matches_counts_and_one_in_etc_hides_its_namesake(root: Path) -> None:
    put(root, "usr/lib/systemd/network/50-can.network", NETWORK)
    put(root, "usr/lib/systemd/network/60-can.network", NETWORK.replace("500K", "250K"))
    assert [one.bitrate for one in found(root)] == [500_000]
    put(root, "etc/systemd/network/50-can.network", NETWORK.replace("500K", "800K"))
    assert [one.bitrate for one in found(root)] == [800_000]
    (root / "etc/systemd/network/50-can.network").write_text("", encoding="utf-8")  # masked
    assert [one.bitrate for one in found(root)] == [250_000]
    put(root, "run/systemd/network/50-can.network.d/x.conf", "[Link]\nUnmanaged=yes\n")
    put(root, "etc/systemd/network/60-can.network.d/x.conf", "[Link]\nUnmanaged=yes\n")
    assert found(root) == []


def test_the_rule_of_install_units_and_comments_are_not_wrong(root: Path) -> None:
    rule = Path(__file__).parents[3] / "systemd/85-litegrip.rules"
    put(root, "usr/local/lib/udev/rules.d/85-litegrip.rules", rule.read_text(encoding="utf-8"))
    put(root, "etc/rc.local", "# ip link set can0 up type can bitrate 500000\n")
    assert [one.is_wrong for one in found(root)] == [False]


def test_a_closed_file_a_directory_and_what_is_no_text_are_passed_over(root: Path) -> None:
    put(root, "etc/rc.local/")
    put(root, "etc/udev/rules.d/x.rules").write_bytes(bytes(range(256)) * 10)
    put(root, "etc/systemd/network/a.network").write_bytes(b"[Match]\nName=\xff\xfe\n[CAN]\n=\n")
    (root / "etc/systemd/network/b.network").symlink_to("/nowhere")
    assert found(root) == []


def test_each_interface_has_its_own(root: Path) -> None:
    lines = [f"ip link set can{n} up type can bitrate {n + 1}00000" for n in range(3)]
    put(root, "etc/rc.local", "\n".join(lines))
    assert [one.bitrate for n in range(3) for one in found(root, f"can{n}")] == [
        100_000,
        200_000,
        300_000,
    ]


def test_two_commands_in_one_line_are_told_apart(root: Path) -> None:
    put(root, "etc/rc.local", "ip link set can1 down; ip link set can0 up type can bitrate 500000 "
        "listen-only on && ip link set can1 up type can bitrate 250000\n")  # fmt: skip
    (setting,) = found(root)
    assert (setting.bitrate, setting.modes) == (500_000, ("LISTEN-ONLY",))
