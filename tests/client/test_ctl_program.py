"""litegripctl as a program: its command line, a terminal, a pipe that closes, no daemon."""

import json
import subprocess
import time
from pathlib import Path
from typing import Any

import pytest

import litegrip_client
from litegrip_client.ctl.commands import find
from litegrip_client.ctl.main import main
from litegripd.model.errors import ERROR_TABLE
from tests.client.ctl_commands import ACTIONS
from tests.client.ctl_terminal import COMMAND, ROOT, Terminal, start
from tests.client.fake_daemon import DEADLINE_S, HELLO, MOVE, STATE, FakeDaemon, Request


def samples(daemon: FakeDaemon, count: int) -> None:
    def subscribe(request: Request) -> None:
        request.reply({"subscription": 1, "state": STATE})
        for seq in range(count):
            sample = {"subscription": 1, "seq": seq, "dropped": 0, "monotonic_s": 1.0}
            request.notify("state.sample", {**sample, "state": STATE})

    daemon.handlers["state.subscribe"] = subscribe
    daemon.handlers["state.unsubscribe"] = lambda request: {"subscription": 1}


def test_a_motion_on_a_terminal_shows_a_bar_and_then_the_result(daemon: FakeDaemon) -> None:
    def move(request: Request) -> Any:
        for step in (0, 5, 10):
            request.progress(step)
        return MOVE

    daemon.handlers["motion.open"] = move
    code, shown = Terminal("--socket", daemon.path, "open").end()
    assert code == 0
    frames = [frame.partition("\x1b[K")[0] for frame in shown.split("\r") if frame.strip()]
    assert frames[:3] == [
        f"[{'.' * 24}]  12.50 mm  +0.30 N·m  travel",
        f"[{'#' * 12}{'.' * 12}]  12.50 mm  +0.30 N·m  travel",
        f"[{'#' * 24}]  12.50 mm  +0.30 N·m  travel",
    ]
    assert shown.endswith("\r\x1b[Kopen: pressed, at 35.25 mm\n")


@pytest.mark.parametrize("line", ["state", "--json state", "watch --count 2"])
def test_a_full_disk_is_said_in_one_line(daemon: FakeDaemon, line: str) -> None:
    samples(daemon, 5)
    with Path("/dev/full").open("wb") as full:
        process = start("--socket", daemon.path, *line.split(), stdout=full, stderr=subprocess.PIPE)
        _, told = process.communicate(timeout=DEADLINE_S)
    text = "litegripctl: standard output cannot be written: No space left on device\n"
    assert (process.returncode, told.decode()) == (74, text)


@pytest.mark.parametrize(
    ("line", "closed", "code", "out", "err"),
    [
        ("state", ">&-", 0, False, ""),
        ("watch --count 2", ">&-", 0, False, ""),
        ("cancel 3", ">&-", 4, False, "litegripctl: no"),
        ("cancel 3", "2>&-", 4, False, ""),
        ("state", "2>&- <&-", 0, True, ""),
        ("fly", "2>&-", 2, False, ""),
    ],
)
def test_streams_that_are_closed_are_no_traceback(
    daemon: FakeDaemon, line: str, closed: str, code: int, out: bool, err: str
) -> None:
    samples(daemon, 5)
    daemon.handlers["job.cancel"] = lambda request: request.fail("unknown_job", -32012, "no")
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", *COMMAND, "--socket", daemon.path]
    done = subprocess.run(
        [*shell, *line.split()], cwd=ROOT, capture_output=True, timeout=DEADLINE_S, check=False
    )
    assert done.returncode == code
    assert bool(done.stdout) is out
    assert done.stderr.decode().startswith(err)
    assert b"Traceback" not in done.stdout + done.stderr


def test_a_pipe_that_closes_is_no_noise(daemon: FakeDaemon) -> None:
    samples(daemon, 100)
    process = start(
        "--socket", daemon.path, "watch", stdout=subprocess.PIPE, stderr=subprocess.PIPE
    )
    assert process.stdout is not None
    assert process.stderr is not None
    first = process.stdout.readline()
    process.stdout.close()
    deadline_s = time.monotonic() + DEADLINE_S
    request = daemon.wait_for("state.subscribe")[0]
    seq = 100
    while process.poll() is None and time.monotonic() < deadline_s:
        sample = {"subscription": 1, "seq": seq, "dropped": 0, "monotonic_s": 1.0, "state": STATE}
        try:
            request.notify("state.sample", sample)
        except OSError:
            break
        seq += 1
    code = process.wait(DEADLINE_S)
    error = process.stderr.read()
    process.stderr.close()
    assert (b"35.25 mm" in first, code, error) == (True, 141, b"")


@pytest.mark.parametrize("line", [["--version"], ["-c", "can1", "--version", "state"]])
def test_the_version_is_the_package_s_and_needs_no_daemon(
    line: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line)
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"litegripctl {litegrip_client.__version__}\n"


def test_without_a_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "litegripd@.service").touch()
    monkeypatch.setattr("litegrip_client.core.discovery.UNIT_DIRECTORIES", (str(tmp_path),))
    assert main(["-c", "nodaemon7", "state"]) == 3
    what, hint = capsys.readouterr().err.splitlines()
    assert what.startswith("litegripctl: no daemon can be reached for channel nodaemon7 (/run/")
    assert "systemctl start litegripd@nodaemon7" in hint


def test_without_a_channel_the_running_ones_are_named_and_none_is_guessed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "xdg" / "litegripd"
    own.mkdir(parents=True)
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    with FakeDaemon(own / "sim7.sock") as daemon:
        assert main(["enable"]) == 3
        assert daemon.requests == []
    hint = "there are: sim7; name one: litegripctl -c sim7 ..."
    assert capsys.readouterr().err.splitlines()[1].strip() == hint
    assert main(["-c", "can0", "enable"]) == 3
    assert "there is one for sim7: name that; or start one" in capsys.readouterr().err


def test_a_command_that_only_reads_takes_the_only_daemon_and_says_which(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "xdg" / "litegripd"
    own.mkdir(parents=True)
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    with FakeDaemon(own / "sim7.sock") as daemon:
        daemon.handlers["hello"] = lambda request: {**HELLO, "channel": "sim7"}
        assert main(["state", "--json"]) == 0
        shown = capsys.readouterr()
        assert shown.err == "sim7, the only daemon here:\n"
        assert json.loads(shown.out)["mode"]
        assert main(["-c", "can0", "state"]) == 3
        assert "there is one for sim7" in capsys.readouterr().err
        with FakeDaemon(own / "sim8.sock"):
            assert main(["state"]) == 3
    assert "there are: sim7, sim8" in capsys.readouterr().err


def test_a_closed_socket_of_the_default_channel_is_no_matter_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def refuse(path: str, timeout_s: float) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    monkeypatch.setattr("litegrip_client.threads.blocking.Connection", refuse)
    (tmp_path / "can0.sock").touch()
    assert main(["state"]) == 3
    what, hint = capsys.readouterr().err.splitlines()
    assert "permission denied: only for the group" in what
    assert hint.strip().startswith("join the group")


def test_a_channel_that_was_asked_for_must_be_the_daemons(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.path)
    assert main(["state"]) == 0
    assert main(["-c", "can1", "state"]) == 4
    assert "has channel can0, not can1" in capsys.readouterr().err
    monkeypatch.setenv("LITEGRIP_CHANNEL", "can2")
    assert main(["state"]) == 4
    assert main(["state", "-c", "can0"]) == 0


@pytest.mark.parametrize(
    "arguments",
    [
        [],
        ["fly"],
        ["open", "--speed", "0"],
        ["open", "--speed", "nan"],
        ["open", "--speed", "fast"],
        ["watch", "--hz", "-1"],
        ["watch", "--count", "0"],
        ["watch", "--count", "²"],
        ["stop", "--level", "gently"],
        ["cancel"],
        ["cancel", "x"],
        ["grasp", "--force", "0"],
        ["grasp", "--hold", "-1"],
        ["grasp", "--tolerance", "2"],
        ["grasp", "--width", "48"],
        ["release", "--by", "-5"],
        ["move"],
        ["move", "45mm", "--speed", "5", "--duration", "2"],
        ["force"],
        ["zero", "--mount", "upside-down"],
        ["calibration", "forget"],
        ["calibration", "load"],
        ["calibration", "load", "normal", "--chain"],
        ["config", "set"],
        ["config", "set", "force_n"],
        ["config", "set", "force_n=strong"],
        ["config", "set", "force_n=nan"],
        ["register"],
        ["-c", "../etc", "state"],
        ["-c", "can0", "--socket", "/x", "state"],
    ],
)
def test_wrong_usage_ends_with_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert main(arguments) == 2
    assert capsys.readouterr().err.startswith("usage: litegripctl")
    assert main(["--json", *arguments]) == 2
    out, err = capsys.readouterr()
    assert (json.loads(out)["error"]["data"]["reason"], err) == ("wrong_usage", "")


def test_the_help_lists_every_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    listed = capsys.readouterr().out.partition("exit codes:")[2].split("\n")
    codes = {int(line.split()[0]) for line in listed if line[2:3].isdigit()}
    assert codes == {0, 1, 2, 74, 130, 141} | {kind.exit_code for kind in ERROR_TABLE}


def listed(help_text: str) -> list[str]:
    """Find the names of commands, or of actions, in a help text."""
    lines = help_text.partition("positional arguments:")[2].partition("\n\n")[0].splitlines()
    return [line.split()[0] for line in lines if line[:4] == "    " and line[4:5].isalpha()]


def test_every_command_is_there_and_helps(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("COLUMNS", "80")

    def help_of(*arguments: str) -> str:
        with pytest.raises(SystemExit) as caught:
            main([*arguments, "--help"])
        assert caught.value.code == 0
        text = capsys.readouterr().out
        assert max(map(len, text.splitlines())) <= 80
        assert text.startswith(" ".join(["usage: litegripctl", *arguments, "[-h]"]))
        return text

    names = listed(help_of())
    assert len(names) == len(set(names))
    assert len(names) >= 25  # a help text that lists nothing would pass all the rest
    for name in names:
        assert callable(find(name))
        text = help_of(name)
        assert listed(text) == ACTIONS.get(name, [])
        for action in listed(text):
            help_of(name, action)
