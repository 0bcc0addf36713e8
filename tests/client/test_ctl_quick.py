"""A plain stop and state without the whole program: the same is asked, done and printed."""

import itertools
import json
import re
import signal
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.core.sockets import STOP_LEVELS, stop_path
from litegrip_client.ctl import program, quick
from litegrip_client.ctl.main import main
from litegrip_client.line.exchange import PROTOCOL
from tests.client.fake_daemon import HELLO, STATE, FakeDaemon
from tests.client.helpers import stopped

OWNER = {"program": "sorter.py", "pid": 77}
STOP = {"level": "hold", "by": OWNER, "why": "a hand: litegripctl state"}
STATES = [
    STATE,
    STATE | {"stale": True, "age_s": 4.2, "motor": "silent"},
    STATE | {"feedback_s": None, "age_s": None},
    STATE | {"job": {"job": 3, "kind": "grasp", "phase": "press", "owner": OWNER}},
    STATE | {"stop": STOP, "limited": ["speed"], "requested_rad": 0.1},
    STATE | {"stop": {"level": "relax", "by": "guard\x1b\u2028\x0b"}, "mode": "Zürich °"},
    STATE | {"force_set_n": 8.0, "is_grasped": True, "clamp_n": [1.5, 9], "pressing_n": 2},
    STATE | {"scale_doubt": "superseded", "work_stroke_mm": 40.0, "calibrated": False},
]
WHERE = [[], ["-c", "can0"], ["--channel", "can0"]]
LEVELS: list[list[str]] = [[], *(["--level", level] for level in STOP_LEVELS)]
STATE_LINES = [
    line for where in WHERE for line in ([*where, "state"], ["state", *where]) if line != []
]
STOP_LINES = [
    [*before, "stop", *level, *after]
    for before, level, after in itertools.product(WHERE, LEVELS, WHERE)
    if not (before and after)
]
OTHERS = [
    "",
    "watch",
    "state state",
    "state stop",
    "state --json",
    "--json stop",
    "stop --why x",
    "stop --level",
    "stop --level limp",
    "stop --level=hold",
    "--level hold stop",
    "state --level hold",
    "state --help",
    "--version",
    "-c",
    "-c state",
    "-c can0 -c can0 state",
    "-ccan0 state",
    "--chan can0 state",
    "-c site.arm state",
    "-c a/b state",
    "-c -x state",
    "--socket /nowhere state",
    "sto",
    "state x",
    "-- state",
]


class Stops(FakeDaemon):
    """Latches whatever level it is told to."""

    def __init__(self, path: Path, **more: Any) -> None:
        super().__init__(path)
        self.handlers["stop"] = lambda asked: {**asked.params, "generation": 4, **more}


@pytest.fixture
def stops(daemon: FakeDaemon) -> Iterator[FakeDaemon]:
    with Stops(Path(stop_path(daemon.path))) as stops:
        yield stops


@pytest.fixture(autouse=True)
def _here(monkeypatch: pytest.MonkeyPatch, daemon: FakeDaemon) -> None:
    monkeypatch.setattr(
        "litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(Path(daemon.path).parent)
    )


def asked(daemon: FakeDaemon) -> list[tuple[str, Any]]:
    """Return what was asked since the last time."""
    requests, daemon.requests[:] = [(one.method, one.params) for one in daemon.requests], []
    return requests


def both(
    line: list[str], daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> tuple[str, list[tuple[str, Any]]]:
    """Run a line in both ways, which must do the same; return what was printed and asked."""
    assert program.run(line) == 0
    whole = capsys.readouterr(), asked(daemon)
    text = quick.answer(line)
    assert (f"{text}\n", "") == (whole[0].out, whole[0].err)
    assert asked(daemon) == whole[1]
    assert main(line) == 0
    assert capsys.readouterr() == whole[0]
    asked(daemon)
    return whole[0].out, whole[1]


@pytest.mark.parametrize("line", STOP_LINES, ids=" ".join)
def test_a_plain_stop_is_the_same_in_both_ways(
    stops: FakeDaemon, capsys: pytest.CaptureFixture[str], line: list[str]
) -> None:
    shown, requests = both(line, stops, capsys)
    level = line[line.index("--level") + 1] if "--level" in line else "hold"
    assert requests == [("stop", {"level": level})]
    call = "litegripctl -c can0" if "can0" in line else "litegripctl"
    assert shown == stopped(level, call)


def test_a_stronger_stop_from_before_is_told_in_both_ways(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str]
) -> None:
    with Stops(Path(stop_path(daemon.path)), level="disable") as stops:
        assert "stopped: disable, " in both(["stop"], stops, capsys)[0]


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("line", STATE_LINES, ids=" ".join)
def test_a_plain_state_is_the_same_in_both_ways(
    daemon: FakeDaemon, capsys: pytest.CaptureFixture[str], line: list[str], state: Any
) -> None:
    daemon.handlers["state.get"] = lambda _: state
    asked(daemon)
    requests = both(line, daemon, capsys)[1]
    assert requests == [("hello", {"client": "litegripctl"}), ("state.get", {})]


@pytest.mark.parametrize("variable", ["LITEGRIP_CHANNEL", "LITEGRIPD_SOCKET"])
def test_the_environment_says_where_in_both_ways(
    daemon: FakeDaemon,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    variable: str,
) -> None:
    path = Path(daemon.path).with_name("can1.sock")
    monkeypatch.setenv(variable, "can1" if variable == "LITEGRIP_CHANNEL" else str(path))
    with FakeDaemon(path) as other, Stops(Path(stop_path(str(path)))) as stops:
        other.handlers["hello"] = lambda _: HELLO | {"channel": "can1"}
        both(["state"], other, capsys)
        both(["stop"], stops, capsys)
    assert daemon.methods() == []


def test_the_socket_for_stops_takes_a_stop_alone(
    daemon: FakeDaemon,
    stops: FakeDaemon,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LITEGRIPD_SOCKET", str(stops.path))
    assert quick.answer(["state"]) is None
    assert main(["state"]) != 0
    assert "is for stops alone" in capsys.readouterr().err
    assert stops.methods() == []
    both(["stop"], stops, capsys)
    assert daemon.methods() == []


@pytest.mark.parametrize("line", OTHERS)
def test_every_other_spelling_is_left_to_the_whole_program(
    daemon: FakeDaemon, stops: FakeDaemon, line: str
) -> None:
    assert quick.answer(line.split(" ") if line else []) is None
    assert daemon.methods() == stops.methods() == []


def test_nothing_that_listens_is_left_to_the_whole_program(daemon: FakeDaemon) -> None:
    assert quick.answer(["-c", "can1", "state"]) is None
    assert quick.answer(["stop"]) is None  # there is no socket for stops
    assert daemon.methods() == []


@pytest.mark.parametrize(
    "hello", [HELLO | {"protocol": 2}, HELLO | {"channel": "can1"}, {"channel": "can0"}]
)
def test_another_daemon_is_left_to_the_whole_program(daemon: FakeDaemon, hello: Any) -> None:
    daemon.handlers["hello"] = lambda _: hello
    assert quick.answer(["-c", "can0", "state"]) is None


@pytest.mark.parametrize("command", ["state", "stop"])
def test_a_refusal_is_told_by_the_whole_program(
    daemon: FakeDaemon,
    stops: FakeDaemon,
    capsys: pytest.CaptureFixture[str],
    command: str,
) -> None:
    for one, method in ((daemon, "state.get"), (stops, "stop")):
        one.handlers[method] = lambda asked: asked.fail("not_permitted", -32019, "only others may")
    assert quick.answer([command]) is None
    assert main([command]) == 9
    assert "only others may" in capsys.readouterr().err


ANSWERS = [
    b"",
    b"\n",
    b"{}\n",
    b"[]\n",
    b"no json\n",
    b"\xff\n",
    b"[" * 20_000 + b"\n",
    b'{"jsonrpc":"2.0","id":2,"result":{"level":"hold"}}\n',
    b'{"jsonrpc":"2.0","id":1,"result":{"level":"limp"}}\n',
    b'{"jsonrpc":"2.0","id":1,"result":[]}\n',
    b'{"jsonrpc":"2.0","id":1,"result":{"level":"hold"}} x\n',
    b'{"jsonrpc":"2.0","id":1,"result":{"level":"hold"}}',
    b"x" * 200_000 + b"\n",
]


@pytest.mark.parametrize("answer", ANSWERS, ids=range(len(ANSWERS)))
def test_an_answer_that_is_none_is_left_to_the_whole_program(
    daemon: FakeDaemon, stops: FakeDaemon, answer: bytes
) -> None:
    def hang_up(asked: Any) -> None:
        asked.send_bytes(answer)
        asked.hang_up()

    stops.handlers["stop"] = daemon.handlers["hello"] = hang_up
    assert quick.answer(["stop"]) is None
    assert quick.answer(["state"]) is None


def test_a_daemon_that_does_not_answer_is_not_waited_for_long(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(quick, "_STOP_WITHIN_S", 0.05)
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(stop_path(daemon.path))
        listener.listen()
        assert quick.answer(["stop"]) is None


@pytest.mark.parametrize(
    "text", ['{"a": [1, 2.5e3, -0.0, true, null, "\\u00e9\\n\\ud83d\\ude00"]}', "{}", '{"": {}}']
)
def test_json_is_read_as_by_its_module(text: str) -> None:
    line = f'{{"id":1,"result":{text if text.startswith("{") else "{}"}}}'
    assert quick._result(line, 1) == json.loads(text)


def test_the_protocol_is_that_of_the_client() -> None:
    assert quick.PROTOCOL == PROTOCOL


LOADED = {"litegrip_client", "ctl", "ctl.main", "ctl.quick", "ctl.streams", "values.figures"}
LOADED |= {"ctl.state_view", "core", "core.sockets", "values"}
SYSTEM = {"__future__", "_json", "_socket", "importlib", "warnings", "importlib._bootstrap"}
SYSTEM |= {"importlib._bootstrap_external", "_warnings", "encodings.ascii"}


@pytest.mark.parametrize("command", ["stop", "state"])
def test_what_a_plain_one_imports_is_next_to_nothing(
    daemon: FakeDaemon, stops: FakeDaemon, command: str
) -> None:
    """What a start takes is what it imports: see `python -m bench.timing.startup`."""
    code = (
        "import site, sys; before = set(sys.modules); from litegrip_client.ctl.main import main\n"
        f"code = main([{command!r}])\n"
        "print(code, *sorted(set(sys.modules) - before), file=sys.stderr)"
    )
    environment = {
        "LITEGRIPD_SOCKET": daemon.path,
        "PYTHONPATH": re.sub("/tests/.*", "", __file__),
    }
    done = subprocess.run(
        [sys.executable, "-S", "-c", code],
        env=environment,
        capture_output=True,
        text=True,
        check=True,
    )
    status, *names = done.stderr.split()
    own = {name.removeprefix("litegrip_client.") for name in names if "litegrip" in name}
    assert (status, own) == ("0", LOADED)
    assert {name for name in names if "litegrip" not in name} <= SYSTEM


def test_the_installed_program_is_it() -> None:
    root = re.sub("/tests/.*", "", __file__)
    project = Path(root, "pyproject.toml").read_text()
    assert '"litegrip_client/ctl/litegripctl"' in project
    done = subprocess.run(
        [sys.executable, f"{root}/litegrip_client/ctl/litegripctl", "--version"],
        env={"PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=True,
    )
    assert (done.stdout.split()[0], done.stderr) == ("litegripctl", "")


def test_an_interrupt_while_it_is_imported_ends_it_at_once(tmp_path: Path) -> None:
    package = tmp_path / "litegrip_client/ctl"
    package.mkdir(parents=True)
    interrupts = "import os, signal\nos.kill(os.getpid(), signal.SIGINT)\nprint('goes on')\n"
    (package / "main.py").write_text(f"{interrupts}def main(): return 0\n")
    root = re.sub("/tests/.*", "", __file__)
    done = subprocess.run(
        [sys.executable, f"{root}/litegrip_client/ctl/litegripctl", "open"],
        env={"PYTHONPATH": str(tmp_path)},
        capture_output=True,
        check=False,
    )
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGINT, b"", b"")
