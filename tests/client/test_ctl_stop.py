"""How litegripctl stops: by the socket for stops, else as any other request."""

import contextlib
import json
import socket
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path

import pytest

from litegrip_client import ConnectError, ProtocolError
from litegrip_client.core.sockets import stop_path
from litegrip_client.core.stop import stop_at
from tests.client.fake_daemon import STATE, FakeDaemon, Request
from tests.client.helpers import Ctl, stopped


@pytest.fixture
def stops(daemon: FakeDaemon) -> Iterator[FakeDaemon]:
    """Return what listens where stops are taken."""
    with FakeDaemon(Path(stop_path(daemon.path))) as listening:
        yield listening


def test_a_stop_goes_by_the_socket_that_is_served_first(
    daemon: FakeDaemon, stops: FakeDaemon, ctl: Ctl
) -> None:
    stops.handlers["stop"] = lambda request: {"level": request.params["level"], "generation": 4}
    text = "stopped: relax, until: litegripctl clear\n"
    assert ctl("stop", "--level", "relax", "--why", "a hand") == (0, text, "")
    assert [one.params for one in stops.requests] == [{"level": "relax", "why": "a hand"}]
    assert daemon.methods() == []  # nothing waits behind other requests


@pytest.mark.parametrize("words", [(), ("--why", "a hand")], ids=["plain", "with a reason"])
@pytest.mark.parametrize("motor", ["silent", "unknown"])
def test_a_stop_that_does_not_reach_the_motor_says_so_and_fails(
    stops: FakeDaemon, ctl: Ctl, motor: str, words: tuple[str, ...]
) -> None:
    latched = {"level": "hold", "generation": 4, "motor": motor}
    stops.handlers["stop"] = lambda _request: latched
    code, out, _ = ctl("stop", *words)
    assert code == 1
    assert out == (
        "hold is latched, until: litegripctl clear; but the motor does not answer, so nothing"
        " reaches it: to be sure, cut its power\n"
    )


@pytest.mark.parametrize(
    ("behind", "level", "wrong"),
    [
        ("now", "hold", "unrecognized arguments: now; "),
        ("anybody may; then: litegripctl clear", "hold", "unrecognized arguments: anybody may;"),
        ("--level soft", "hold", "there is no 'soft': hold, relax, disable; "),
        ("--level relx", "hold", "did you mean 'relax'?; "),
        ("--reason x --level=relax", "relax", "unrecognized arguments: --reason x"),
        ("--level", "hold", "expected one argument; "),
        ("--relax", "relax", "unrecognized arguments: --relax"),
        ("--disable now", "disable", "unrecognized arguments: --disable now"),
        ("disable", "disable", "arguments: disable; a level is an option: --level disable; "),
        ("hand inside", "hold", "arguments: hand inside; a reason is an option: --why TEXT; "),
    ],
)
def test_whatever_stands_behind_a_stop_it_stops(
    stops: FakeDaemon, ctl: Ctl, behind: str, level: str, wrong: str
) -> None:
    stops.handlers["stop"] = lambda request: {"level": request.params["level"], "generation": 4}
    code, out, err = ctl("stop", *behind.split())
    assert (code, out) == (2, stopped(level))
    assert wrong in err
    assert f"can0 was told to stop ({level}) all the same" in err
    assert [one.params for one in stops.requests] == [{"level": level}]


@pytest.mark.parametrize(
    "given",
    [
        ("--chanel", "can1", "stop"),
        ("stop", "-c"),
        ("move", "stop"),
        ("teleop", "stop", "now"),
    ],
    ids=" ".join,
)
def test_what_may_mean_another_gripper_or_no_stop_at_all_says_that_nothing_was_stopped(
    stops: FakeDaemon, ctl: Ctl, given: tuple[str, ...]
) -> None:
    code, out, err = ctl(*given)
    assert (code, out, stops.requests) == (2, "", [])
    assert "; nothing was stopped: say litegripctl stop\n" in err


HURRIED = [
    "STOP",
    "Stop",
    "stop now",
    "STOP now",
    "stopp",
    "sotp",
    "stpo",
    "stop!",
    "stop,",
    "--stop",
]
HURRIED += ["-stop", "estop", "e-stop", "emergency-stop", "halt", "freeze", "ABORT", "please stop"]


@pytest.mark.parametrize("line", HURRIED)
@pytest.mark.parametrize("is_one_word", [True, False])
def test_what_somebody_types_in_a_hurry_stops(
    stops: FakeDaemon, ctl: Ctl, line: str, *, is_one_word: bool
) -> None:
    if is_one_word and line == "please stop":
        pytest.skip("it is no command of a word")
    stops.handlers["stop"] = lambda _request: {"level": "hold", "generation": 4}
    code, out, err = ctl(*([line] if is_one_word else line.split()))
    assert (code, out) == (2, stopped("hold"))
    assert "can0 was told to stop (hold) all the same" in err


@pytest.mark.parametrize("line", ["top", "setup", "step-by", "kill", "help stop"])
def test_other_words_do_not_stop(stops: FakeDaemon, ctl: Ctl, line: str) -> None:
    with contextlib.suppress(SystemExit):  # of help
        ctl(*line.split())
    assert stops.requests == []


def test_a_wrong_stop_names_the_gripper_that_it_stopped(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, litegripctl: Ctl
) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    (tmp_path / "litegripd").mkdir()
    with FakeDaemon(tmp_path / "litegripd" / "can7.stop.sock") as other:
        other.handlers["stop"] = lambda _request: {"level": "hold", "generation": 4}
        code, _, err = litegripctl("stop", "now", "-c", "can7")
        assert (code, "can7 was told to stop (hold)" in err) == (2, True)
        assert len(other.requests) == 1


def test_a_wrong_stop_that_nobody_takes_says_what_to_do_now(
    tmp_path: Path, litegripctl: Ctl
) -> None:
    code, _, err = litegripctl("--socket", str(tmp_path / "x.sock"), "stop", "now")
    assert code == 3
    assert "STOP did not reach" in err
    assert "Cut the motor's power" in err


def test_a_reason_that_would_be_cut_with_its_level_goes_the_other_way(
    daemon: FakeDaemon, stops: FakeDaemon, ctl: Ctl
) -> None:
    answer = {"level": "disable", "generation": 4, "state": STATE}
    daemon.handlers["stop"] = lambda request: answer
    assert ctl("stop", "--level", "disable", "--why", "x" * 2000)[0] == 0
    assert stops.methods() == []
    assert daemon.requests[-1].params == {"level": "disable", "why": "x" * 2000}


@pytest.mark.parametrize("error", [PermissionError(13, "Permission denied"), TimeoutError()])
def test_who_cannot_reach_that_socket_is_told_in_a_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, litegripctl: Ctl, error: OSError
) -> None:
    def refuse(*_arguments: object) -> None:
        raise error

    monkeypatch.setattr("litegrip_client.ctl.commands.state.stop_at", refuse)
    code, _, err = litegripctl("--socket", str(tmp_path / "x.sock"), "stop")
    assert (code, "no daemon can be reached" in err) == (3, True)


@pytest.mark.parametrize("answer", [b"", b"[]\n", b"{}\n"])
def test_an_answer_that_is_none_is_told(
    daemon: FakeDaemon, stops: FakeDaemon, answer: bytes
) -> None:
    def hang_up(request: Request) -> None:
        request.send_bytes(answer)
        request.hang_up()

    stops.handlers["stop"] = hang_up
    with pytest.raises(ProtocolError):
        stop_at(daemon.path, "hold", None, 5.0)


def test_an_answer_that_does_not_come_is_told(tmp_path: Path) -> None:
    told = r"its answer did not come within 0\.01 s"
    with hung(tmp_path / "x.stop.sock"), pytest.raises(ConnectError, match=told):
        stop_at(str(tmp_path / "x.sock"), "hold", None, 0.01)


@contextmanager
def hung(path: Path, queue: int = 8) -> Iterator[socket.socket]:
    """Listen, and take nobody."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as listener:
        listener.bind(str(path))
        listener.listen(queue)
        yield listener


def wait_only(monkeypatch: pytest.MonkeyPatch, within_s: float) -> None:
    monkeypatch.setattr("litegrip_client.ctl.quick._STOP_WITHIN_S", within_s)
    for name in ("STOP_WITHIN_S", "FAR_STOP_WITHIN_S"):
        monkeypatch.setattr(f"litegrip_client.core.stop.{name}", within_s)


@pytest.fixture
def quickly(monkeypatch: pytest.MonkeyPatch) -> None:
    """Wait less for answers that do not come."""
    wait_only(monkeypatch, 0.01)


FOLLOWS = "Cut the motor's power. Why: "


@pytest.mark.usefixtures("quickly")
@pytest.mark.parametrize("line", ["-c left stop", "-c left stop --why hand"])
def test_a_stop_that_is_not_answered_says_first_to_cut_the_power(
    tmp_path: Path, litegripctl: Ctl, line: str
) -> None:
    (tmp_path / "xdg/litegripd").mkdir(parents=True)
    with hung(tmp_path / "xdg/litegripd/left.stop.sock"):
        code, out, err = litegripctl(*line.split())
    first, second = err.splitlines()
    assert (code, out) == (3, "")
    assert first.startswith(f"litegripctl: STOP not confirmed by left. {FOLLOWS}the stop was sent")
    assert second == "  see what is wrong: litegripctl -c left doctor"


@pytest.mark.usefixtures("quickly")
def test_where_too_many_stops_wait_already_it_says_so_too(tmp_path: Path, litegripctl: Ctl) -> None:
    """A full queue is refused at once at one socket, and in time at the other."""
    paths = [tmp_path / "x.stop.sock", tmp_path / "x.sock"]
    with hung(paths[0], 0), hung(paths[1], 0), ExitStack() as stack:
        for path in paths:
            waits = stack.enter_context(socket.socket(socket.AF_UNIX, socket.SOCK_STREAM))
            waits.connect(str(path))
        code, _, err = litegripctl("--socket", str(paths[1]), "stop")
    assert (code, f"STOP did not reach {paths[1]}. {FOLLOWS}" in err) == (3, True)
    assert "accepts no connection in time" in err


@pytest.mark.usefixtures("quickly")
def test_a_daemon_that_hangs_in_its_answer_to_the_other_socket_is_told_as_soon(
    tmp_path: Path, litegripctl: Ctl
) -> None:
    with hung(tmp_path / "x.sock"):
        code, _, err = litegripctl("--socket", str(tmp_path / "x.sock"), "stop", "--json")
        told = json.loads(litegripctl("--socket", str(tmp_path / "x.sock"), "stop", "--json")[1])
    assert (code, err, told["error"]["data"]["reason"]) == (3, "", "no_answer")
    assert told["error"]["message"].startswith(f"STOP not confirmed by {tmp_path}/x.sock. Cut")
    assert told["error"]["message"].endswith("did not answer within 0.01 s")


def test_a_stop_that_reaches_no_daemon_says_so_and_names_those_that_run(
    tmp_path: Path, litegripctl: Ctl, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    (tmp_path / "xdg/litegripd").mkdir(parents=True)
    folder = tmp_path / "xdg/litegripd"
    named = "there are: left, right; name one: litegripctl -c left stop"
    with FakeDaemon(folder / "left.sock"), FakeDaemon(folder / "right.sock"):
        for line, whom, hint in (
            ("stop", "can0", f"{named}, or stop all: litegripctl stop --all"),
            ("-c lef stop", "lef", f"{named}, or stop all: litegripctl stop --all"),
        ):
            code, _, err = litegripctl(*line.split())
            first, second = err.splitlines()
            assert (code, second.strip().startswith(hint)) == (3, True)
            assert first.startswith(f"litegripctl: STOP did not reach {whom}. {FOLLOWS}no daemon")


NAMES = ("left", "right")
CUT = "Cut the motor's power"
LATCHED = "stopped: {level}, until: litegripctl -c {name} clear"


@pytest.fixture
def machine(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return where the sockets of a machine of its own are."""
    monkeypatch.setattr("litegrip_client.core.sockets.SYSTEM_DIRECTORY", str(tmp_path))
    monkeypatch.setattr("litegrip_client.core.sockets.PORTAL_DIRECTORY", str(tmp_path / "far"))
    folder = tmp_path / "xdg/litegripd"
    folder.mkdir(parents=True)
    return folder


@contextmanager
def stoppable(folder: Path, *names: str) -> Iterator[dict[str, FakeDaemon]]:
    """Run daemons that can be stopped; yield what listens for stops."""
    with ExitStack() as stack:
        found = {}
        for name in names:
            stack.enter_context(FakeDaemon(folder / f"{name}.sock"))
            stops = stack.enter_context(FakeDaemon(folder / f"{name}.stop.sock"))
            stops.handlers["stop"] = lambda asked: {"level": asked.params["level"], "generation": 1}
            found[name] = stops
        yield found


@pytest.mark.parametrize(
    ("line", "code", "level"),
    [
        ("stop --all", 0, "hold"),
        ("-c left stop --all --level relax", 0, "relax"),
        ("stop --level disable --why hand --all", 0, "disable"),
        ("stop all", 2, "hold"),
        ("stopp all relax", 2, "relax"),
    ],
)
def test_all_grippers_of_this_machine_are_stopped(
    machine: Path, litegripctl: Ctl, line: str, code: int, level: str
) -> None:
    with stoppable(machine, *NAMES, "site.far") as stops:
        done, out, err = litegripctl(*line.split())
        why = {"why": "hand"} if "hand" in line else {}
        for name in NAMES:
            assert [one.params for one in stops[name].requests] == [{"level": level, **why}]
        assert stops["site.far"].requests == [], "that one is another machine's"
    told = [one for one in out.splitlines() if "what is squeezed" not in one]
    assert told == [f"{name}: {LATCHED.format(level=level, name=name)}" for name in NAMES]
    assert done == code
    assert (f"each gripper was told to stop ({level}) all the same" in err) == (code == 2)


def test_a_gripper_that_hangs_keeps_no_other_from_being_stopped(
    machine: Path, litegripctl: Ctl, monkeypatch: pytest.MonkeyPatch
) -> None:
    wait_only(monkeypatch, 0.5)  # the other one answers
    with stoppable(machine, "right") as stops, hung(machine / "left.stop.sock"):
        with hung(machine / "left.sock"):
            code, out, err = litegripctl("stop", "--all")
            told = json.loads(litegripctl("stop", "--all", "--json")[1])
        assert len(stops["right"].requests) == 2
    latched = f"right: {LATCHED.format(level='hold', name='right')}"
    assert (code, out.splitlines()[0], "left" in out) == (3, latched, False)
    assert err.startswith(f"litegripctl: STOP not confirmed by left. {FOLLOWS}")
    assert told["right"]["level"] == "hold"
    assert "STOP not confirmed by left" in told["left"]["error"]["message"]


def test_where_no_daemon_runs_nothing_was_stopped(machine: Path, litegripctl: Ctl) -> None:
    (machine / "left.sock").touch()
    code, out, err = litegripctl("stop", "--all")
    assert (code, out) == (3, "")
    assert err == f"litegripctl: STOP reached nothing: no daemon runs on this machine. {CUT}\n"


def test_a_socket_that_is_named_is_one_gripper(tmp_path: Path, litegripctl: Ctl) -> None:
    with stoppable(tmp_path, "x") as stops:
        code, out, err = litegripctl("--socket", str(tmp_path / "x.sock"), "stop", "--all")
        assert [one.params for one in stops["x"].requests] == [{"level": "hold"}]
    assert (code, out.startswith("stopped: hold")) == (2, True)
    assert "--all is for the grippers of this machine, and takes no --socket" in err
