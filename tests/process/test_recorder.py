"""The flight recorder of a real daemon: dumped by `litegripctl`, drawn, and left by a crash."""

import json
import os
import select
import subprocess
import sys
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tests.process.daemon_process import DEADLINE_S, DaemonProcess, daemon, litegripctl

PNG = b"\x89PNG\r\n\x1a\n"


def ticks_in(path: Path) -> list[dict[str, object]]:
    with path.open("rb") as file:
        found = make_reader(file, True).iter_messages()
        return [json.loads(m.data) for _s, channel, m in found if channel.topic.endswith("/tick")]


def test_a_dump_is_written_copied_and_drawn(own: DaemonProcess, tmp_path: Path) -> None:
    with own.connect() as client:
        client.enabled()
        client.despite_silence("motion.move", opening_mm=40)
    copy, picture = tmp_path / "a.mcap", tmp_path / "a.png"
    code, shown = litegripctl(own, "--json", "dump", "--note", "a test", "-o", str(copy))
    assert code == 0, shown
    result = json.loads(shown)
    path = Path(result["path"])
    assert path.parent.parent == tmp_path / "dumps"
    assert copy.read_bytes() == path.read_bytes()
    ticks = ticks_in(copy)
    assert len(ticks) == result["ticks"]
    assert {"moving", "holding", "disabled"} <= {tick["mode"] for tick in ticks}
    assert all(tick["sent"] == "command" for tick in ticks if tick["mode"] == "moving")
    assert litegripctl(own, "plot", str(copy)) == (0, f"drawn in {picture}\n")
    assert picture.read_bytes().startswith(PNG)
    assert litegripctl(own, "dump", "-o", str(copy))[0] == 4  # it is there already
    assert list(path.parent.glob("*-demand.mcap")) == [path]  # a silence makes one of its own
    assert str(path) in own.log


@pytest.fixture
def config(tmp_path: Path) -> Path:
    path = tmp_path / "crash.toml"
    path.write_text('[bus]\ninterface = "litegrip_sim"\n[gripper]\nmount = "normal"\n', "utf-8")
    return path


def test_a_daemon_that_is_killed_leaves_its_last_minute(tmp_path: Path, config: Path) -> None:
    name = f"crash-{os.getpid()}"
    socket = str(tmp_path / "rpc.sock")
    running = DaemonProcess(tmp_path, name, "--config", str(config), "--socket", socket)
    try:
        with running.connect() as client:
            helper = client.result("health")["helper"]["pid"]
            last = client.until(lambda state: bool(state["seq"] > 20))
        pidfd = os.pidfd_open(helper)
        running.kill()
        assert select.select([pidfd], [], [], DEADLINE_S)[0]
        os.close(pidfd)
    finally:
        running.kill()
    (path,) = (tmp_path / "dumps" / name).iterdir()
    assert path.name.endswith("-crash.mcap")
    ticks = ticks_in(path)
    assert [tick["seq"] for tick in ticks] == list(range(1, len(ticks) + 1))
    assert len(ticks) >= last["seq"]
    assert f"its last minute is recorded in {path}" in running.log


DEFECTIVE = """
import sys
from litegripd.app.machine import Machine
from litegripd.app.main import main
from litegripd.io.server import Server

tick, ticks, let_in, is_open = Machine.tick, 0, Server.let_in, False

def defective(*arguments):
    global ticks
    ticks += 1
    if ticks > 100 and is_open:
        raise ZeroDivisionError("a defect that stays")
    return tick(*arguments)

def opened(server, is_let_in):
    global is_open
    is_open = is_let_in
    let_in(server, is_let_in)

Machine.tick, Server.let_in = defective, opened
sys.exit(main())
"""


def test_a_tick_that_fails_by_a_defect_is_recorded(tmp_path: Path, config: Path) -> None:
    name, socket = f"defect-{os.getpid()}", str(tmp_path / "rpc.sock")
    arguments = (name, "--config", str(config), "--socket", socket)
    running = DaemonProcess(tmp_path, *arguments, program=("-c", DEFECTIVE))
    try:
        with running.connect() as client:
            earlier = client.result("events.subscribe", kinds=["recorder"])["events"]
            event = earlier[0] if earlier else client.read()["params"]
        assert event["data"]["cause"] == "tick_error"
        path = Path(event["data"]["path"])
        assert path.name.endswith("-tick_error.mcap")
        ticks = ticks_in(path)
        began = [tick["failed"] for tick in ticks].index(True)
        assert began >= 100
        assert all(tick["failed"] and not tick["frames"] for tick in ticks[began:])
        after_s = float(str(ticks[-1]["monotonic_s"])) - float(str(ticks[began]["monotonic_s"]))
        assert after_s > 0.75, "what came after it, too"  # a busy machine leaves ticks out
    finally:
        running.kill()
    assert "the tick failed" in running.log
    assert f"recorded in {path} (tick_error)" in running.log


def test_a_daemon_that_ends_as_it_should_leaves_nothing(tmp_path: Path, config: Path) -> None:
    name = f"end-{os.getpid()}"
    with daemon(tmp_path, name, "--config", str(config)) as running, running.connect() as client:
        client.result("hello")
    assert not (tmp_path / "dumps").exists()


def test_the_control_process_imports_nothing_of_what_a_dump_needs() -> None:
    program = (
        "import sys, litegripd.app.daemon, litegripd.app.main\n"
        "heavy = {'mcap', 'zstandard', 'lz4', 'matplotlib', 'numpy'}\n"
        "print(sorted(heavy & {name.partition('.')[0] for name in sys.modules}))"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], check=True, capture_output=True, text=True
    )
    assert done.stdout == "[]\n", done
