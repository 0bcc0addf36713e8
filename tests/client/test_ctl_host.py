"""litegripctl --host: commands go through ssh, which ends with them and whose errors are told."""

import json
import os
import select
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeAlias

import pytest

from litegrip_client.discovery import stop_path
from tests.client.ctl_terminal import Terminal, start
from tests.client.fake_daemon import DEADLINE_S, HELLO, STATE, FakeDaemon
from tests.client.live_daemon import live

FAKE = Path(__file__).with_name("fake_ssh.py")
STOPPED = {"level": "hold", "generation": 4, "state": STATE}

Remote: TypeAlias = Callable[..., tuple[int, str, str]]
Begun: TypeAlias = Callable[[], list[dict[str, Any]]]


@pytest.fixture
def begun(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Begun]:
    """Put a program in the place of ssh; return what tells with what it was begun."""
    programs, log = tmp_path / "bin", tmp_path / "ssh.log"
    programs.mkdir()
    program = programs / "ssh"
    program.write_text(
        f"#!{sys.executable} -IS\n{FAKE.read_text(encoding='utf-8')}", encoding="utf-8"
    )
    program.chmod(0o755)
    log.touch()
    monkeypatch.setenv("PATH", str(programs), prepend=os.pathsep)
    monkeypatch.setenv("FAKE_SSH_LOG", str(log))
    with tempfile.TemporaryDirectory() as short:  # a killed program leaves its own directory
        monkeypatch.setenv("TMPDIR", short)
        yield lambda: [json.loads(line) for line in log.read_text(encoding="utf-8").splitlines()]


@pytest.fixture
def remote(daemon: FakeDaemon, begun: Begun) -> Remote:
    def run(*arguments: str, host: str = "bob@robot", socket: str = daemon.path) -> tuple[Any, ...]:
        command = ["--host", host, "--socket", socket, *arguments]
        with start(*command, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
            out, err = process.communicate(timeout=DEADLINE_S)
        return process.returncode, out.decode(), err.decode()

    return run


def has_ended(pid: int) -> bool:
    """Wait for the end of a process that may be another's child."""
    try:
        watched = os.pidfd_open(pid)
    except ProcessLookupError:
        return True
    try:
        return bool(select.select([watched], [], [], DEADLINE_S)[0])
    finally:
        os.close(watched)


def test_a_command_goes_through_ssh_which_ends_with_it(
    daemon: FakeDaemon, remote: Remote, begun: Begun
) -> None:
    code, out, err = remote("state")
    assert (code, err) == (0, "")
    assert "opening      35.25 mm" in out
    assert daemon.methods() == ["hello", "state.get"]
    (ssh,) = begun()
    assert ssh["arguments"][-2:] == ["--", "bob@robot"]
    forwarded = [pair.split(":") for pair in ssh["arguments"] if pair.endswith(".sock")]
    assert [there for _, there in forwarded] == [stop_path(daemon.path), daemon.path]
    assert forwarded[0][0] == stop_path(forwarded[1][0])
    assert has_ended(ssh["pid"])
    assert not Path(forwarded[0][0]).parent.exists()


def test_without_a_path_it_is_the_systems_socket_there(remote: Remote, begun: Begun) -> None:
    with start(
        "--host", "nowhere", "-c", "can3", "state", stdout=subprocess.PIPE, stderr=subprocess.PIPE
    ) as process:
        process.communicate(timeout=DEADLINE_S)
    assert begun()[0]["arguments"][-3].endswith(":/run/litegripd/can3.sock")


def test_a_long_path_of_temporary_files_is_no_obstacle(
    remote: Remote, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    long = tmp_path / ("x" * 100)
    long.mkdir()
    monkeypatch.setenv("TMPDIR", str(long))
    assert remote("state")[0] == 0


@pytest.mark.parametrize(
    ("host", "message", "hint"),
    [
        ("nowhere", "ssh does not know the machine nowhere", "~/.ssh/config"),
        ("stranger", "stranger does not let this user in", "ssh-copy-id stranger"),
        ("impostor", "ssh does not trust impostor", "ssh impostor"),
        ("offline", "ssh to offline failed: ssh: connect to host offline port 22", "ssh offline"),
        ("strict", "the ssh server of strict does not forward", "AllowStreamLocalForwarding yes"),
    ],
)
def test_what_ssh_cannot_do_is_told(remote: Remote, host: str, message: str, hint: str) -> None:
    code, out, err = remote("state", host=host)
    assert (code, out) == (3, "")
    what, then = err.splitlines()
    assert what.startswith(f"litegripctl: {message}")
    assert hint in then
    code, out, err = remote("state", "--json", host=host)
    assert (code, err) == (3, "")
    assert json.loads(out)["error"]["data"]["reason"] == "ssh_failed"


def test_a_socket_that_nobody_serves_there_is_told(remote: Remote, tmp_path: Path) -> None:
    missing = str(tmp_path / "missing.sock")
    for command in (["state"], ["stop"], ["dump", "-o", str(tmp_path / "x.mcap")]):
        code, _, err = remote(*command, socket=missing)
        assert code == 3
        text = f"ssh reaches bob@robot, but no daemon can be reached at {missing} there"
        assert text in err.splitlines()[0]


def test_without_ssh_it_says_what_to_install(
    remote: Remote, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setenv("PATH", str(tmp_path))
    code, _, err = remote("state")
    assert (code, err.splitlines()[1]) == (3, "  sudo apt install openssh-client")


def test_a_stop_goes_by_the_socket_for_stops(daemon: FakeDaemon, remote: Remote) -> None:
    with FakeDaemon(Path(stop_path(daemon.path))) as stops:
        stops.handlers["stop"] = lambda request: STOPPED
        clear = f"litegripctl --host bob@robot --socket {daemon.path} clear"
        assert remote("stop") == (0, f"stopped: hold, until: {clear}\n", "")
        assert stops.methods() == ["stop"]
    assert "stop" not in daemon.methods()


def test_a_daemon_that_does_not_listen_there_is_stopped_all_the_same(
    daemon: FakeDaemon, remote: Remote
) -> None:
    daemon.handlers["stop"] = lambda request: STOPPED
    assert remote("stop")[0] == 0
    assert daemon.methods() == ["hello", "stop"]


def test_ctrl_c_cancels_the_motion_through_ssh(daemon: FakeDaemon, begun: Begun) -> None:
    job = {"job": 6, "state": "running", "owner": {"client": 3, "pid": 1}}  # the pid is sshd's
    daemon.handlers["hello"] = lambda request: {**HELLO, "client": 3}
    daemon.handlers["motion.open"] = lambda request: None
    daemon.handlers["job.list"] = lambda request: {"jobs": [job]}
    daemon.handlers["job.cancel"] = lambda request: {"job": 6, "state": "cancelled"}
    with start(
        "--host",
        "robot",
        "--socket",
        daemon.path,
        "open",
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        start_new_session=True,
    ) as process:
        daemon.wait_for("motion.open")
        os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to ssh, too
        _, err = process.communicate(timeout=DEADLINE_S)
    assert (process.returncode, daemon.methods()[-1]) == (130, "job.cancel")
    assert err.decode() == "litegripctl: interrupted: job 6 cancelled, the jaws hold\n"
    assert has_ended(begun()[0]["pid"])


def test_ssh_does_not_outlive_a_killed_program(daemon: FakeDaemon, begun: Begun) -> None:
    with start("--host", "robot", "--socket", daemon.path, "open") as process:
        daemon.wait_for("motion.open")
        process.kill()
    assert has_ended(begun()[0]["pid"])


def test_a_dump_is_fetched(
    daemon: FakeDaemon, remote: Remote, begun: Begun, tmp_path: Path
) -> None:
    there, here = tmp_path / "it's there.mcap", tmp_path / "here.mcap"
    there.write_bytes(b"\x89content")
    answer = {"path": str(there), "ticks": 12000, "seconds": 59.995, "bytes": 756906}
    daemon.handlers["recorder.dump"] = lambda request: answer
    assert remote("dump", "-o", str(here))[0] == 0
    assert here.read_bytes() == b"\x89content"
    there.unlink()
    code, _, err = remote("dump", "-o", str(tmp_path / "again.mcap"))
    assert code == 4
    assert f"the dump is {there} on the daemon's machine" in err
    assert "No such file" in err
    assert all(has_ended(one["pid"]) for one in begun())


def test_the_doctor_is_sent_there(remote: Remote, begun: Begun) -> None:
    code, _, err = remote("doctor")
    assert (code, err.splitlines()[1]) == (2, "  run it there: ssh bob@robot litegripctl doctor")
    assert begun() == []


def test_the_host_of_a_leader_is_not_that_of_the_daemon(
    daemon: FakeDaemon, remote: Remote, begun: Begun
) -> None:
    status = {"active": True, "mode": "slave", "link_state": "open"}
    daemon.handlers["teleop.start"] = lambda _request: status
    assert remote("teleop", "slave", "--host", "10.0.0.2", "--detach")[0] == 0
    assert daemon.requests[-1].params["host"] == "10.0.0.2"
    assert begun()[0]["arguments"][-1] == "bob@robot"


def test_the_live_view_begins_ssh_anew_without_asking_for_a_password(
    daemon: FakeDaemon, begun: Begun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("TERM", "xterm")
    terminal = Terminal("--host", "robot", "--socket", live(daemon).path, "watch")
    terminal.expect("besides this one")
    os.kill(begun()[0]["pid"], signal.SIGKILL)
    terminal.expect("can0 of robot")
    terminal.expect("NO DAEMON")
    daemon.wait_for("health", 2)
    terminal.expect("degraded")
    terminal.interrupt()
    assert terminal.end()[0] == 130
    first, second = begun()
    assert "BatchMode=yes" in set(second["arguments"]) - set(first["arguments"])
    assert has_ended(second["pid"])
