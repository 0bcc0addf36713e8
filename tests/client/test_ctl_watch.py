"""litegripctl watch: the live view, what takes its place, and the terminal afterwards."""

import io
import json
import signal
import sys
from collections import deque
from collections.abc import Callable
from functools import partial
from pathlib import Path

import pytest
from rich.console import Console

from litegrip_client.ctl import state_view
from litegrip_client.ctl.commands import COMMANDS
from litegrip_client.ctl.live import Interruptions, Scene, picture
from litegrip_client.ctl.parser import for_gripper
from litegrip_client.ctl.run import samples
from litegrip_client.ctl.state_view import state_line
from litegrip_client.line.connection import Connection
from litegrip_client.line.feeds import Event
from litegrip_client.values.results import STATE_FIELDS
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import HELLO, STATE, FakeDaemon, Request
from tests.client.helpers import Ctl
from tests.client.live_daemon import HEALTH, OWNER, live, streaming
from tests.client.rig import Heard

TAKEN, GIVEN_BACK = "\x1b[?1049h", "\x1b[?1049l"
LAST_LINE = "holding      35.25 mm   +0.2500 rad   +0.500 N·m   33 °C"


@pytest.fixture(autouse=True)
def _terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TERM", "xterm")
    monkeypatch.setenv("COLUMNS", "100")
    monkeypatch.setenv("LINES", "40")


def shown(scene: Scene, call: str = "litegripctl") -> str:
    console = Console(file=io.StringIO(), width=80, force_terminal=False)
    console.print(picture(scene, "can0", partial(for_gripper, call, COMMANDS)))
    assert isinstance(console.file, io.StringIO)
    return console.file.getvalue()


def whole_scene() -> Scene:
    scene = Scene()
    job = {"job": 4, "kind": "grasp", "phase": "approach", "owner": OWNER}
    stop = {"level": "hold", "by": OWNER, "why": "smoke\x1b[2J"}
    for second in range(60):
        opening = None if second < 20 else 30.0 + second / 4
        scene.take({**STATE, "opening_mm": opening, "force_n": 0.0, "monotonic_s": 41.0 + second})
    scene.state = {**STATE, "job": job, "stop": stop, "limited": ["heat"], "monotonic_s": 100.0}
    scene.others = 2
    scene.lease = {"owner": OWNER, "mine": False, "waiting": 1}
    scene.health = HEALTH
    scene.events = deque([Event(1, 88.0, "stop", "a stop\x1b[2J " + "x" * 99, {})])
    return scene


def test_what_can_be_typed_is_for_this_gripper() -> None:
    words = shown(whole_scene(), "litegripctl -c left").split()
    assert "litegripctl -c left clear" in " ".join(words)


def test_the_view_shows_all_of_it() -> None:
    text = shown(whole_scene())
    for part in (
        "can0  degraded",
        "closed ━━━━━━━━━━━━━━━━━━━━",
        "35.25 mm, 50% open",
        "+0.500 N·m, force about +5.0 N",
        "driver 31 °C, coil 33 °C",
        "holding (motor enabled, bus up)",
        "4 grasp, approach, by pick.py (pid 77)",
        "hold, by pick.py (pid 77): smoke?[2J",
        "limited      heat",
        f"opening      {' ' * 13}▁▁▂▂▂",
        "▇██  35 to 45 mm",
        f"force        {'▅' * 40}  -3 to 3 N",
        "pick.py (pid 77), uid 1000, has it for picking?[2J; 1 waiting",
        "2 besides this one",
        "- late ticks",
        "12 s ago  a stop?[2J xxx",
    ):
        assert part in text
    assert "\x1b[2J" not in text
    assert max(map(len, text.splitlines())) <= 80


def test_the_view_of_a_daemon_that_has_gone_says_so_first() -> None:
    scene = whole_scene()
    scene.trouble = "the daemon ended the connection"
    head = shown(scene).splitlines()[0]
    assert head == "can0  NO DAEMON, trying again: the daemon ended the connection"
    scene = Scene()
    assert "can0  --" in shown(scene)
    scene.trouble = "x"
    assert "NO DAEMON" in shown(scene)


def test_the_view_of_a_daemon_that_hangs_says_how_old_all_is() -> None:
    scene = whole_scene()
    scene.silent_s = 3.2
    text = shown(scene)
    assert text.startswith("can0  SILENT: the daemon has not answered for 3 s: what the jaws do is")
    assert "as it was 3 s ago:" in text
    assert "15 s ago  a stop" in text  # 12 s before the last state


def test_a_daemon_that_hangs_is_told_each_second_until_it_goes_on(
    daemon: FakeDaemon, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("litegrip_client.ctl.run.SILENT_AFTER_S", 0.05)
    requests: list[Request] = []

    def subscribe(request: Request) -> None:
        requests.append(request)
        request.reply({"subscription": 1, "state": STATE})

    daemon.handlers["state.subscribe"] = subscribe
    connection = Connection(daemon.path)
    shown = samples(connection, 100.0)
    assert next(shown) == (STATE, 0.0)
    silent_s = [next(shown) for _ in range(3)]
    assert [state for state, _ in silent_s] == [None] * 3
    assert 0.05 < silent_s[0][1] < silent_s[1][1] < silent_s[2][1]
    sample = {"subscription": 1, "seq": 0, "dropped": 0, "monotonic_s": 1.0, "state": STATE}
    requests[0].notify("state.sample", sample)
    assert next(shown) == (STATE, 0.0)
    shown.close()
    assert connection.closed
    assert daemon.methods() == ["state.subscribe"]


def test_a_view_of_a_daemon_that_hangs_shows_it_and_ends_at_once(daemon: FakeDaemon) -> None:
    live(daemon)
    terminal = Terminal("--socket", daemon.path, "watch")
    terminal.expect("besides this one")
    terminal.expect("SILENT: the daemon has not answered for")
    terminal.expect("as it was 2 s ago:")
    terminal.type("q")
    assert terminal.end()[0] == 0
    assert "state.unsubscribe" not in daemon.methods()


def test_a_trace_forgets_what_is_older_than_a_minute() -> None:
    scene = Scene()
    for second in range(100):
        scene.take({**STATE, "opening_mm": float(second), "monotonic_s": float(second)})
    assert (min(scene.trace), max(scene.trace)) == (27, 66)
    assert "41 to 99 mm" in shown(scene)
    scene.take({**STATE, "stale": True, "monotonic_s": 5.0})  # another daemon's clock
    assert scene.trace == {3: (None, None)}


def test_what_is_normal_is_not_red() -> None:
    console = Console(file=io.StringIO(), width=80, force_terminal=True, color_system="standard")
    scene = whole_scene()
    assert scene.state is not None
    scene.state["stop"] = None
    console.print(picture(scene, "can0", str))
    assert isinstance(console.file, io.StringIO)
    assert "\x1b[1;31m" not in console.file.getvalue()


@pytest.mark.parametrize("key", ["q", "Q"])
def test_q_ends_the_view_and_other_keys_do_not(daemon: FakeDaemon, key: str) -> None:
    with streaming(daemon) as state:
        terminal = Terminal("--socket", daemon.path, "watch")
        terminal.expect("besides this one")
        terminal.type("x\n")
        state["opening_mm"] = 36.5  # keys are read before it is drawn
        terminal.expect("36.50 mm")
        terminal.type(key)
        code, out = terminal.end()
    assert code == 0
    assert out.endswith(f"{GIVEN_BACK}{LAST_LINE.replace('35.25', '36.50')}\n")


def test_on_a_terminal_it_is_a_view_and_leaves_the_last_line(daemon: FakeDaemon) -> None:
    live(daemon)
    code, out = Terminal("--socket", daemon.path, "watch", "--count", "3").end()
    assert code == 0
    before, _, after = out.partition(GIVEN_BACK)
    assert before.startswith(TAKEN)
    assert "35.25 mm, 50% open" in before
    assert "1 besides this one" in before
    assert "the job ended" in before
    assert after == f"{LAST_LINE}\n"


@pytest.mark.parametrize(("number", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)])
def test_the_terminal_is_given_back(daemon: FakeDaemon, number: int, code: int) -> None:
    terminal = Terminal("--socket", live(daemon).path, "watch")
    terminal.expect("besides this one")
    terminal.interrupt(number)
    ended, out = terminal.end()
    assert ended == code
    assert "\x1b[?25h" in out  # the cursor
    assert out.endswith(f"{GIVEN_BACK}{LAST_LINE}\n")


def test_the_terminal_is_given_back_while_ctrl_z_stops_it(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", live(daemon).path, "watch")
    terminal.expect("besides this one")
    terminal.interrupt(signal.SIGTSTP)
    terminal.expect(GIVEN_BACK)
    terminal.wait_until_stopped()
    terminal.interrupt(signal.SIGCONT)
    terminal.expect(TAKEN)
    terminal.expect("besides this one")
    terminal.interrupt()
    assert terminal.end()[0] == 130


def test_a_signal_waits_until_what_is_drawn_is_written() -> None:
    """Its handler writes to the terminal, and a write in a write raises."""
    came: list[str] = []
    interruptions = Interruptions()
    handler = interruptions.handler(lambda: came.append("now"))
    with interruptions.writing():
        handler(signal.SIGTSTP, None)
        assert came == []
    assert came == ["now"]
    handler(signal.SIGTSTP, None)
    assert came == ["now", "now"]


def test_a_daemon_that_goes_is_waited_for(tmp_path: Path) -> None:
    path = tmp_path / "can0.sock"
    with FakeDaemon(path) as first:
        terminal = Terminal("--socket", live(first).path, "watch")
        terminal.expect("besides this one")
    terminal.expect("NO DAEMON, trying again")
    path.unlink()
    with FakeDaemon(path) as second:
        second.handlers["hello"] = lambda request: {**HELLO, "pid": 2}
        live(second).wait_for("health")
        terminal.expect("degraded")
        terminal.interrupt()
        assert terminal.end()[0] == 130


@pytest.mark.parametrize("plain", [True, False])
def test_without_the_view_it_is_a_line_for_each_state(
    heard: Heard, on_a_terminal: Ctl, monkeypatch: pytest.MonkeyPatch, *, plain: bool
) -> None:
    if not plain:
        monkeypatch.setenv("TERM", "dumb")
    code, out, _ = on_a_terminal("watch", "--count", "4", *(["--plain"] if plain else []))
    assert (code, out.count("\n"), out.count("\x1b")) == (0, 4, 0)
    assert heard.methods() == ["hello", "state.subscribe"]  # the connection's end ends that


@pytest.mark.usefixtures("heard")
def test_without_rich_it_says_so_once_and_shows_lines(
    on_a_terminal: Ctl, hide: Callable[[str, str], None]
) -> None:
    hide("rich", "litegrip_client.ctl.live")
    code, out, err = on_a_terminal("watch", "--count", "3")
    told = "litegripctl: lines only: the live view needs the library rich: "
    assert (code, err) == (0, f"{told}{sys.executable} -m pip install rich\n")
    assert [line.split()[0] for line in out.splitlines()] == ["disabled"] * 3
    assert TAKEN not in out


@pytest.mark.usefixtures("heard")
def test_json_on_a_terminal_is_lines(on_a_terminal: Ctl) -> None:
    code, out, _ = on_a_terminal("watch", "--count", "3", "--json")
    assert (code, [json.loads(line)["mode"] for line in out.splitlines()]) == (0, ["disabled"] * 3)


def test_a_line_tells_the_phase_of_teleoperation() -> None:
    job = {"job": 3, "kind": "teleop", "phase": "stale", "owner": OWNER}
    assert "job 3 teleop stale" in state_line({**STATE, "job": job}, str)
    assert state_line({**STATE, "job": {**job, "phase": None}}, str).endswith("job 3 teleop")


def test_only_fields_of_a_state_have_a_line_of_their_own() -> None:
    assert set(STATE_FIELDS) >= state_view._TOLD
