"""litegripctl as a program: its command line, a terminal, a pipe that closes, no daemon."""

import json
import re
import socket
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, get_args

import pytest

import litegrip_client
from litegrip_client.core import discovery
from litegrip_client.ctl.commands import find
from litegrip_client.ctl.main import main
from litegrip_client.ctl.render import WHY_NOT, progress, why_not
from litegripd.model.errors import ERROR_TABLE
from litegripd.model.state import GraspOutcome, MoveOutcome, ReplayOutcome
from tests.client.ctl_commands import ACTIONS
from tests.client.ctl_terminal import COMMAND, ROOT, start
from tests.client.fake_daemon import DEADLINE_S, HELLO, STATE, FakeDaemon
from tests.client.helpers import Ctl, stopped
from tests.client.live_daemon import live
from tests.client.rig import Heard


@pytest.mark.parametrize(
    ("line", "figures", "result"),
    [
        ("open", "{mm}  ramp|{mm}  press|{mm}  settle", "open: pressed home, at {n} mm"),
        ("grasp", "{mm}  approach", "grasp: object held, {n} mm wide, .*litegripctl release"),
        ("record x --seconds 0.5", "{n} s, {n} samples", "record: 50 samples in {n} s, .* play x"),
    ],
)
def test_what_takes_a_while_shows_a_bar_on_a_terminal_and_then_the_result(
    heard: Heard, on_a_terminal: Ctl, line: str, figures: str, result: str
) -> None:
    heard.client().result("motor.enable", detach=True)
    if line == "grasp":
        heard.gripper.put_object(width_mm=50)
    code, shown, _ = on_a_terminal(*line.split())
    before, *frames, last = shown.split("\r")
    assert (code, before) == (0, "")
    parts = {"n": "[0-9.]+", "mm": r" [0-9.]+ mm  [-+][0-9.]+ N·m"}
    bars = []
    for frame in frames:
        found = re.fullmatch(rf"\[(#*\.*)\] ({figures.format(**parts)})\x1b\[K", frame)
        assert found is not None, frame
        bars.append(found[1])
    assert {len(bar) for bar in bars} == {24}
    assert bars == sorted(bars, reverse=True)  # "." comes behind "#"
    assert len(set(bars)) >= 5
    assert re.fullmatch(rf"\x1b\[K{result.format(**parts)}\n", last)


@pytest.mark.parametrize(
    ("data", "line"),
    [
        (
            {"phase": "hold", "step": 3, "total_steps": 0, "opening_mm": 48.2, "torque_nm": 2.0},
            " 48.20 mm  +2.00 N·m  hold",
        ),
        ({"phase": "probe_open\x1b"}, "-- mm  -- N·m  probe open?"),
        (
            {"phase": "play", "step": 5, "total_steps": 10, "opening_mm": 12.5, "loops": 2},
            "[############............]  12.50 mm  -- N·m  play, pass 3",
        ),
    ],
)
def test_progress_without_an_end_has_no_bar_and_a_replay_has_passes(
    data: dict[str, Any], line: str
) -> None:
    assert progress(data) == line


def test_each_outcome_that_is_not_ok_has_its_cause_and_next_step() -> None:
    ended = {one for kind in (MoveOutcome, GraspOutcome, ReplayOutcome) for one in get_args(kind)}
    assert set(WHY_NOT) == ended - {"pressed_home", "reached", "object_held", "completed"}
    assert why_not({"ok": False, "outcome": "of a newer daemon"}, str) == ""
    assert why_not({"ok": True, "outcome": "blocked"}, str) == ""


@pytest.mark.parametrize("line", ["state", "--json state", "watch --count 2"])
def test_a_full_disk_is_said_in_one_line(daemon: FakeDaemon, line: str) -> None:
    live(daemon)
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
    live(daemon)
    daemon.handlers["job.get"] = lambda request: request.fail("unknown_job", -32012, "no")
    shell = ["sh", "-c", f'exec "$@" {closed}', "sh", *COMMAND, "--socket", daemon.path]
    done = subprocess.run(
        [*shell, *line.split()], cwd=ROOT, capture_output=True, timeout=DEADLINE_S, check=False
    )
    assert done.returncode == code
    assert bool(done.stdout) is out
    assert done.stderr.decode().startswith(err)
    assert b"Traceback" not in done.stdout + done.stderr


def test_a_pipe_that_closes_is_no_noise(daemon: FakeDaemon) -> None:
    live(daemon, 100)
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


@pytest.mark.parametrize("line", [["--version"], ["version"], ["-c", "can1", "--version", "state"]])
def test_the_version_is_the_package_s_and_needs_no_daemon(
    line: list[str], capsys: pytest.CaptureFixture[str]
) -> None:
    with pytest.raises(SystemExit) as ended:
        main(line)
    assert ended.value.code == 0
    assert capsys.readouterr().out == f"litegripctl {litegrip_client.__version__}\n"


def test_without_a_daemon(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, litegripctl: Ctl
) -> None:
    (tmp_path / "litegripd@.service").touch()
    monkeypatch.setattr("litegrip_client.core.discovery.UNIT_DIRECTORIES", (str(tmp_path),))
    code, _, err = litegripctl("-c", "nodaemon7", "state")
    what, hint = err.splitlines()
    assert code == 3
    assert what.startswith("litegripctl: no daemon can be reached for channel nodaemon7 (/run/")
    assert "systemctl start litegripd@nodaemon7" in hint


@pytest.fixture
def sim7(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[FakeDaemon]:
    """Return the only daemon of a machine, which its user has started."""
    own = tmp_path / "xdg" / "litegripd"
    own.mkdir(parents=True)
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    with FakeDaemon(own / "sim7.sock") as daemon:
        daemon.handlers["hello"] = lambda request: {**HELLO, "channel": "sim7"}
        yield daemon


def test_without_a_channel_the_running_ones_are_named_and_none_is_guessed(
    sim7: FakeDaemon, litegripctl: Ctl
) -> None:
    code, _, err = litegripctl("enable")
    assert (code, sim7.requests) == (3, [])
    assert err.splitlines()[1].strip() == "there are: sim7; name one: litegripctl -c sim7 ..."
    for command in ("enable", "state"):
        code, _, err = litegripctl("-c", "can0", command)
        assert (code, "running: sim7; start can0's with" in err) == (3, True)


def test_a_command_that_only_reads_takes_the_only_daemon_and_says_which(
    sim7: FakeDaemon, litegripctl: Ctl
) -> None:
    code, out, err = litegripctl("state", "--json")
    assert (code, err) == (0, "sim7, the only daemon that you can reach:\n")
    assert json.loads(out)["mode"]
    with FakeDaemon(Path(sim7.path).with_name("sim8.sock")):
        code, _, err = litegripctl("state")
    assert (code, "there are: sim7, sim8" in err) == (3, True)


def test_a_stop_without_a_channel_stops_the_only_gripper_and_asks_which_of_several(
    sim7: FakeDaemon, litegripctl: Ctl
) -> None:
    sim7.handlers["stop"] = lambda _request: {"level": "hold", "generation": 4}
    code, out, err = litegripctl("stop")
    assert (code, err) == (0, "sim7, the only daemon that you can reach:\n")
    assert out == stopped("hold")
    assert "stop" in sim7.methods()
    with FakeDaemon(Path(sim7.path).with_name("sim8.sock")):
        code, _, err = litegripctl("stop")
    hint = "name one: litegripctl -c sim7 stop, or stop all: litegripctl stop --all\n"
    assert (code, hint in err) == (3, True)


def test_a_daemon_that_hangs_is_one_of_them_also_when_its_queue_is_full(
    sim7: FakeDaemon, litegripctl: Ctl
) -> None:
    with socket.socket(socket.AF_UNIX) as hung, socket.socket(socket.AF_UNIX) as waits:
        hung.bind(str(Path(sim7.path).with_name("hung.sock")))
        hung.listen(0)
        waits.connect(hung.getsockname())
        code, _, err = litegripctl("state")
        assert (code, "there are: hung, sim7; name one" in err) == (3, True)
    assert sim7.requests == []


def test_what_was_left_behind_and_what_is_closed_to_this_user_is_no_choice(
    sim7: FakeDaemon, litegripctl: Ctl, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("gone", "closed"):
        with socket.socket(socket.AF_UNIX) as dead:
            dead.bind(str(Path(sim7.path).with_name(f"{name}.sock")))
    real = discovery._how
    monkeypatch.setattr(
        discovery, "_how", lambda path: "closed" if "closed" in path else real(path)
    )
    code, _, err = litegripctl("state")
    assert (code, err) == (0, "sim7, the only daemon that you can reach:\n")
    code, _, err = litegripctl("open")
    assert (code, "there are: sim7; name one" in err) == (3, True)


def test_the_default_is_meant_where_its_socket_was_left_behind(
    sim7: FakeDaemon, litegripctl: Ctl
) -> None:
    with socket.socket(socket.AF_UNIX) as dead:
        dead.bind(str(Path(sim7.path).with_name("can0.sock")))
    code, out, err = litegripctl("state")
    assert (code, out, "refused: nobody listens" in err) == (3, "", True)


def test_a_closed_socket_of_the_default_channel_is_no_matter_of_its_name(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, litegripctl: Ctl
) -> None:
    def refuse(path: str, timeout_s: float) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    monkeypatch.setattr("litegrip_client.threads.blocking.Connection", refuse)
    (tmp_path / "can0.sock").touch()
    code, _, err = litegripctl("state")
    what, hint = err.splitlines()
    assert code == 3
    assert "permission denied: only for " in what
    assert "litegripctl doctor" in hint  # it is closed, and none is offered in its place


def test_the_help_lists_every_exit_code(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as caught:
        main(["--help"])
    assert caught.value.code == 0
    listed = capsys.readouterr().out.partition("exit codes:")[2].split("\n")
    codes = {int(line.split()[0]) for line in listed if line[2:3].isdigit()}
    assert codes == {0, 1, 2, 74, 130, 141} | {kind.exit_code for kind in ERROR_TABLE}


@pytest.mark.parametrize("words", [[], ["grasp"], ["trajectories", "get"], ["stop"]], ids=str)
def test_help_is_a_command_too(capsys: pytest.CaptureFixture[str], words: list[str]) -> None:
    shown = []
    for line in (["help", *words], [*words, "--help"]):
        with pytest.raises(SystemExit) as caught:
            main(line)
        assert caught.value.code == 0
        shown.append(capsys.readouterr().out)
    assert shown[0] == shown[1]


@pytest.mark.usefixtures("heard")
def test_of_the_events_before_the_latest_are_shown_when_asked(litegripctl: Ctl) -> None:
    litegripctl("enable")
    litegripctl("open")

    def shown(*words: str) -> list[int]:
        lines = litegripctl("events", "--json", *words)[1].splitlines()
        return [json.loads(line)["seq"] for line in lines]

    events = shown()
    assert len(events) > 3
    assert shown("-n", "2") == events[-2:]
    assert shown("--last", "999") == events


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
    assert "--fake-leader --torque-limit 1.0" in help_of("teleop")
