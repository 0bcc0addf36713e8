"""What completes a command line: commands, options, choices, and what the daemon knows."""

import socket
from pathlib import Path

import pytest

from litegrip_client.ctl.completion import complete
from litegrip_client.ctl.completion.scripts import SCRIPTS
from litegrip_client.ctl.completion.words import _SOURCES, FILES
from litegrip_client.ctl.main import main
from litegrip_client.trajectory_files import write
from tests.client.ctl_commands import ACTIONS, every_parser
from tests.client.fake_daemon import FakeDaemon
from tests.trajectories import lgt


def words(*line: str) -> list[str]:
    return [row.partition("\t")[0] for row in complete(line)[1:]]


def takes_files(*line: str) -> bool:
    return complete(line)[0] == "files"


@pytest.mark.parametrize(
    ("line", "found"),
    [
        (["tele"], ["teleop"]),
        (["-c", "can0", "cl"], ["clear-fault", "close", "clear", "clients"]),
        (["--json", "calibration", "s"], ["show", "save"]),
        (["teleop", "slave", "--link", ""], ["zenoh", "udp"]),
        (["stop", "--level=r"], ["--level=relax"]),
        (["stop", "--level", "relax", "--w"], ["--why"]),
        (["stop", "--level=relax", "--le"], []),
        (["open", "--speed"], ["--speed"]),
        (["open", "--speed", ""], []),
        (["grasp", "--no-such", "--forc"], ["--force"]),
        (["fly", ""], []),
        (["calibration", "load", "n"], ["normal"]),
        (["calibration", "load", "--", "--"], []),
        (["config", "get", "force_"], ["force_n", "force_rate_n_s"]),
        (["config", "set", "force_n=1", "force_n"], ["force_n="]),
        (["completion", ""], ["bash", "zsh", "fish"]),
        (["restart", "--hold", "--js"], ["--json"]),
    ],
)
def test_what_the_parsers_know(line: list[str], found: list[str]) -> None:
    assert words(*line) == found


def test_all_commands_and_actions_are_offered() -> None:
    assert len(words("")) > 35
    for command, actions in ACTIONS.items():
        assert words(command, "") == actions


def test_where_paths_may_stand_the_shell_is_told() -> None:
    for line in (
        ["calibration", "load", ""],
        ["calibration", "save", ""],
        ["dump", "-o", ""],
        ["plot", ""],
        ["--socket", ""],
        ["trajectories", "put", ""],
    ):
        assert takes_files(*line)
    for line in (["grasp", ""], ["-c", ""], ["record", ""], ["calibration", ""]):
        assert not takes_files(*line)


def test_every_source_of_words_is_one_and_belongs_to_an_argument() -> None:
    used = set()
    for parser in every_parser():
        names = {action.dest for action in parser.arguments()}
        for name, sources in parser.words.items():
            assert name in names
            used |= set(sources.split())
    assert used == {*_SOURCES, FILES}


def test_channels_are_the_sockets_that_there_are(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr("litegrip_client.discovery.SYSTEM_DIRECTORY", str(tmp_path / "none"))
    assert words("-c", "") == []
    (tmp_path / "litegripd").mkdir()
    for name in ("can1.sock", "can1.stop.sock", "sim0.sock", "lock"):
        with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
            listener.bind(str(tmp_path / "litegripd" / name))
    assert words("-c", "") == ["can1", "sim0"]
    assert words("state", "--channel=s") == ["--channel=sim0"]


def test_the_daemon_knows_its_trajectories_and_jobs(daemon: FakeDaemon) -> None:
    kept = [{"name": name, "samples": 15} for name in ("pick", "place")]
    running = [{"job": 3, "kind": "open", "state": "done"}, {"job": 4, "state": "running"}]
    daemon.handlers["trajectory.list"] = lambda request: {"trajectories": kept, "more": False}
    daemon.handlers["job.list"] = lambda request: {"jobs": running}
    at = ("--socket", daemon.path)
    for command in (["play"], ["plot"], ["trajectories", "get"], ["trajectories", "delete"]):
        assert words(*at, *command, "pi") == ["pick"]
    assert words(*at, "record", "") == []
    assert words(*at, "cancel", "") == ["4"]
    assert complete([*at, "play", "pi"])[1] == "pick\t15 samples"


def test_a_daemon_that_is_not_there_or_refuses_completes_nothing(
    daemon: FakeDaemon, tmp_path: Path
) -> None:
    daemon.handlers["trajectory.list"] = lambda request: request.fail("not_permitted", -32028)
    assert words("--socket", daemon.path, "play", "") == []
    assert words("--socket", str(tmp_path / "none"), "play", "") == []
    asked = len(daemon.requests)
    assert words("--socket", daemon.path, "--host", "robot", "play", "") == []
    assert len(daemon.requests) == asked


def test_this_users_trajectories_complete_what_is_sent(tmp_path: Path, home: Path) -> None:
    write("mine", lgt([(0.0, 0.2), (1.0, 0.3)]))
    assert words("trajectories", "put", "m") == ["mine"]


@pytest.mark.parametrize("shell", SCRIPTS)
def test_the_scripts_are_printed(shell: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["completion", shell]) == 0
    assert capsys.readouterr().out == SCRIPTS[shell]


def test_the_program_answers_the_scripts(capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["__complete", "stop", "--level", "re"]) == 0
    assert capsys.readouterr().out == "-\nrelax\t\n"
    assert main(["__complete"]) == 0
    assert capsys.readouterr().out.startswith("-\nstate\tshow the state once\n")


def test_a_name_that_is_no_line_is_left_out() -> None:
    for name in ("pick", "pi\nck", "pi\tck"):
        write(name, lgt([(0.0, 0.5)]))
    assert words("trajectories", "put", "pi") == ["pick"]
