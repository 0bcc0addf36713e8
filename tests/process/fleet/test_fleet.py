"""Every client through a portal as through a daemon: real processes, real TLS, loopback."""

import contextlib
import json
import signal
import socket
import subprocess
import sys
from pathlib import Path
from typing import Any

from litegrip_client import LiteGrip
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess, ran
from tests.process.fleet.fleet_process import Fleet, fleet


def of(lab: Fleet) -> dict[str, Any]:
    return {"channel": "lab.left", "socket_path": str(lab.socket_path())}


def test_a_gripper_of_another_machine_is_used_as_one_of_this(lab: Fleet) -> None:
    with LiteGrip(**of(lab)) as gripper:
        gripper.enable()
        assert gripper.open().ok
        assert gripper.close().ok
        for sample in gripper.states(hz=50):
            assert sample.opening_mm is not None
            break


AGAIN = """
import sys
from tests.process.daemon_process import Client
with Client(sys.argv[1]) as client:
    print(client.result("motion.open", key="grip", wait=False)["job"])
"""
"""Another program, which calls its motion by the same name."""


def test_two_programs_of_one_user_may_give_their_motions_the_same_name(lab: Fleet) -> None:
    path = lab.socket_path()
    with Client(path) as client, Client(path) as again:
        client.enabled()
        first = client.result("motion.open", key="grip")["job"]
        assert again.result("motion.open", key="grip")["job"] == first
        command = [sys.executable, "-c", AGAIN, str(path)]
        root = Path(__file__).parents[3]
        done = subprocess.run(
            command, capture_output=True, text=True, timeout=DEADLINE_S, cwd=root, check=True
        )
        assert int(done.stdout) > first


def test_who_has_said_all_gets_the_answers_that_take_longer_than_a_session_lives(
    tmp_path: Path, certificates: Path, gripper: DaemonProcess
) -> None:
    """As `socat` does at the end of its input."""
    sockets = {"left": gripper.socket_path}
    with fleet(tmp_path / "short", certificates, sockets, ttl_s=2.0) as lab:
        with Client(lab.socket_path()) as client:
            client.enabled()
            client.result("motion.close")
            number = client.send("motion.open", speed_mm_s=20.0)
            client.socket.shutdown(socket.SHUT_WR)
            assert client.answer(number)["result"]["ok"]
            assert client.read() == {}
        assert "Traceback" not in lab.gateway.log


def test_what_a_frozen_daemon_does_not_read_is_bounded(lab: Fleet, gripper: DaemonProcess) -> None:
    line = json.dumps({"jsonrpc": "2.0", "method": "ping", "params": {"x": "x" * 16_000}}).encode()
    with Client(lab.socket_path()) as client:
        client.result("hello")
        gripper.process.send_signal(signal.SIGSTOP)
        try:
            with contextlib.suppress(BrokenPipeError, ConnectionResetError):
                while True:
                    client.socket.sendall(line + b"\n")
            lab.gateway.until_says("the daemon does not read what it is sent")
        finally:
            gripper.process.send_signal(signal.SIGCONT)
    with Client(lab.socket_path()) as client:
        assert client.result("state.get")["stop"] is None


def test_hello_says_through_what(lab: Fleet) -> None:
    with Client(lab.socket_path()) as client:
        hello = client.result("hello", client="probe")
    assert hello["channel"] == "lab.left"
    assert hello["role"] == "operator"
    assert hello["stop_socket"] == str(lab.socket_path().with_suffix(".stop.sock"))
    remote = hello["remote"]
    assert remote["channel"].startswith("shared-")
    assert (remote["site"], remote["gripper"]) == ("lab", "left")
    assert (remote["user"], remote["role"]) == ("op1@lab", "operator")


def test_owner_and_journal_name_the_remote_user(lab: Fleet, gripper: DaemonProcess) -> None:
    with Client(lab.socket_path()) as client, gripper.connect() as local:
        client.result("hello", client="sorter")
        client.result("lease.acquire")
        owner = local.result("lease.get")["owner"]
        assert owner["program"] == "sorter of op1@lab via gateway"
        assert owner["ttl_s"] == 5.0


def test_the_daemon_opens_no_network_for_it(lab: Fleet, gripper: DaemonProcess) -> None:
    with LiteGrip(**of(lab)) as used:
        used.enable()
        assert used.open().ok
        daemon = gripper.process.pid
        assert all(sockets_of(pid) for pid in (daemon, lab.gateway.process.pid))
        for pid in (daemon, *children_of(daemon)):
            assert other_than_unix(pid) == set()
        assert other_than_unix(lab.gateway.process.pid)  # it is the gateway that has one


def sockets_of(pid: int) -> set[str]:
    """Return the numbers of a process's sockets, as /proc has them."""
    numbers = set()
    for descriptor in Path(f"/proc/{pid}/fd").iterdir():
        with contextlib.suppress(FileNotFoundError):  # closed meanwhile
            link = str(descriptor.readlink())
            if link.startswith("socket:["):
                numbers.add(link)
    return numbers


def other_than_unix(pid: int) -> set[str]:
    """Return those of a process's sockets that are no Unix sockets, whatever else they are."""
    before = sockets_of(pid)
    table = Path(f"/proc/{pid}/net/unix").read_text().splitlines()[1:]
    unix = {f"socket:[{row.split()[6]}]" for row in table}
    return (before - unix) & sockets_of(pid)


def children_of(pid: int) -> list[int]:
    """Return the processes that a process has started."""
    lists = Path(f"/proc/{pid}/task").glob("*/children")
    return [int(number) for one in lists for number in one.read_text().split()]


def test_a_portal_names_the_socket_that_it_cannot_make(tmp_path: Path) -> None:
    config, missing = tmp_path / "fleet.toml", tmp_path / "nowhere"
    config.write_text(
        '[network]\nconnect = ["tcp/127.0.0.1:1"]\ninsecure = true\n'
        f'[portal]\nuser = "op1"\ngrippers = ["lab.left"]\ndirectory = "{missing}"\n',
        encoding="utf-8",
    )
    done = ran(sys.executable, "-m", "litegrip_fleet", "--config", str(config), "portal")
    told = f"the socket {missing}/lab.left.sock cannot be made: No such file or directory"
    assert (done.returncode, done.stderr.splitlines()[-1]) == (1, f"litegripd-fleet: {told}")


def test_a_second_portal_for_a_gripper_leaves_the_first_ones_socket(lab: Fleet) -> None:
    command = ["-m", "litegrip_fleet", "--config", str(lab.portal.config_path), "portal"]
    done = ran(sys.executable, *command)
    assert done.returncode == 1
    assert "lab.left.sock cannot be made: it belongs to another process" in done.stderr
    with Client(lab.socket_path()) as client:
        assert client.result("hello")["channel"] == "lab.left"


def test_a_program_that_hangs_loses_a_lease_with_a_time_to_live_of_its_own(
    lab: Fleet, gripper: DaemonProcess
) -> None:
    """Its portal shows that the process lives; whether it still does its work, it alone can."""
    with gripper.connect() as local, Client(lab.socket_path()) as client:
        client.result("lease.acquire")
        begun_s = local.result("state.get")["monotonic_s"]
        longer_s = begun_s + 6.0  # than the portal's
        local.until(lambda state: bool(state["monotonic_s"] > longer_s))
        assert local.result("lease.get")["owner"] is not None
        client.result("lease.acquire", ttl_s=1.0)
        local.until(lambda _state: local.result("lease.get")["owner"] is None)
        assert client.result("state.get")["bus"] == "up"  # the session has not ended by that
