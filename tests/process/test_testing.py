"""`litegrip_client.testing`: a daemon on a simulated gripper for the tests of a user's program."""

import os
import re
import select
import shutil
import sys
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CommandError, ConnectError, LiteGrip, ParameterError
from litegrip_client.testing import SimulatedDaemon, simulated
from tests.process.daemon_process import (
    DEADLINE_S,
    configured,
    kill_and_wait,
    line_of,
    ran,
    spawn,
)
from tests.sim.simulator_process import simulator


def enabled(daemon: SimulatedDaemon) -> LiteGrip:
    gripper = daemon.gripper()
    gripper.connect()
    assert gripper.enable()
    return gripper


def test_a_program_grasps_loses_and_finds_again() -> None:
    with simulated(object_mm=40.0) as daemon:
        gripper = enabled(daemon)
        assert gripper.grasp(10.0, until="verdict")
        assert daemon.world()["object"]["width_mm"] == 40.0
        with gripper.events(("object_lost",)) as events:
            assert daemon.remove_object()["object"] is None
            assert next(events).kind == "object_lost"
        assert gripper.open()
        with pytest.raises(ParameterError, match="does not fit"):
            daemon.put_object(150.0)
        daemon.put_object(50.0, stiffness_nm_rad=100.0)
        assert gripper.grasp(10.0, until="verdict").width_mm == pytest.approx(50.0, abs=1.5)
        gripper.disconnect()


def test_mujoco_moves_the_jaws_where_it_is_named() -> None:
    with simulated(mechanics="mujoco") as daemon, daemon.gripper() as gripper:
        gripper.enable()
        grasp = gripper.grasp(10.0, until="verdict")
        assert grasp.outcome == "object_held"
        assert grasp.width_mm == pytest.approx(30.0, abs=0.5)
        assert daemon.world()["object"] is None


def test_a_daemon_shows_its_channel_and_where_it_is() -> None:
    shown = repr(SimulatedDaemon("sim1-1", "/run/x.sock"))
    assert shown == "<SimulatedDaemon sim1-1, at /run/x.sock>"


def block(language: str, part: str = "") -> str:
    """Return the only block of a language in the simulator's page that has this."""
    page = (Path(__file__).parents[2] / "docs" / "simulator.md").read_text(encoding="utf-8")
    blocks = re.findall(rf"^```{language}\n(.*?)^```$", page, re.MULTILINE | re.DOTALL)
    (found,) = (each for each in blocks if part in each)
    return str(found)


def test_the_block_of_the_page_runs() -> None:
    exec(compile(block("python", "import simulated"), "simulator.md", "exec"), {})


def test_the_members_of_the_gripper_are_found_where_the_daemon_is_taken_for_it() -> None:
    daemon: Any = SimulatedDaemon("sim1-1", "/run/x.sock")
    with pytest.raises(AttributeError) as caught:
        daemon.enable()
    assert str(caught.value) == (
        "this is the daemon, and 'enable' its gripper's; use:"
        " with simulated_gripper.gripper() as gripper:"
    )
    with pytest.raises(AttributeError, match="did you mean 'put_object'"):
        daemon.put_objekt(40.0)
    with pytest.raises(AttributeError, match="did you mean 'remove_object'"):
        daemon.remove()


def test_an_argument_that_is_not_there_is_told_with_those_that_are() -> None:
    takes = "it takes: mount, object_mm, motor_type, mechanics, within_s"
    anything: Any = simulated
    with pytest.raises(TypeError) as caught:
        anything(object=40)
    assert str(caught.value) == (
        f"simulated() has no argument 'object': did you mean 'object_mm'? {takes}"
    )
    assert caught.value.__context__ is None
    with pytest.raises(TypeError, match=rf"^simulated\(\): too many .*; {takes}$"):
        anything(40)


def test_a_simulator_of_its_own_moves_with_the_configuration_of_the_page(tmp_path: Path) -> None:
    link = str(tmp_path / "gripper")
    config = block("toml").replace("/tmp/gripper", link)
    assert link in config
    with (
        simulator("--pty", "--link", link, "--watchdog", "0.4"),
        configured(tmp_path, "sim1", config) as running,
        running.connect() as client,
    ):
        client.enabled()
        assert client.despite_silence("motion.open")["ok"]


def test_two_of_one_process_do_not_meet_and_nothing_is_left() -> None:
    with simulated(mount="reverse") as one, simulated() as other:
        for daemon, mount in ((one, "reverse"), (other, "normal")):
            with daemon.gripper() as gripper:
                assert gripper.mount == mount
        one.heat(60.0)
        assert (one.world()["coil_c"] > 50.0, other.world()["coil_c"] > 50.0) == (True, False)
        assert one.hold()["held"]
        assert one.push(-0.2)["push_nm"] == -0.2
        assert not one.fault("silent")["powered"]
        assert one.reset()["powered"]
        folders = [Path(each.socket_path).parent for each in (one, other)]
        assert all(folder.exists() for folder in folders)
    assert not any(folder.exists() for folder in folders)


_KILLED = """
import time
from litegrip_client.line.connection import Connection
from litegrip_client.testing import simulated

with simulated() as daemon:
    with Connection(daemon.socket_path) as connection:
        print(connection.daemon_pid, daemon.socket_path, flush=True)
    time.sleep(600)
"""


def test_a_daemon_ends_in_order_when_the_program_that_began_it_is_killed() -> None:
    with spawn(_KILLED) as program:
        pid, _, path = line_of(program).partition(" ")
        ended = os.pidfd_open(int(pid))
        kill_and_wait(program)
    assert select.select([ended], [], [], DEADLINE_S)[0]
    os.close(ended)
    assert not Path(path).exists()
    assert "ended; the motor is off" in (Path(path).parent / "log").read_text()
    shutil.rmtree(Path(path).parent)


def test_why_a_daemon_did_not_begin_is_said() -> None:
    with pytest.raises(ConnectError, match=r"its log: .*sideways"), simulated(mount="sideways"):
        pass


@pytest.mark.parametrize("object_mm", [-3.0, 90.0])
def test_an_object_that_fits_in_no_jaws_is_refused_at_the_call(object_mm: float) -> None:
    told = rf"object_mm must be 0 to less than 87 mm wide, not {object_mm:g}$"
    with pytest.raises(ConnectError, match=told), simulated(object_mm=object_mm):
        pass


def test_a_width_that_is_no_number_is_refused_as_that() -> None:
    width: Any = "40"
    with (
        pytest.raises(ParameterError, match=r"^object_mm is '40', it must be a number$"),
        simulated(object_mm=width),
    ):
        pass


def test_without_the_daemons_program_there_is_a_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("shutil.which", lambda *_arguments, **_more: None)
    with pytest.raises(ConnectError, match="no program litegripd"), simulated():
        pass


@pytest.mark.parametrize("named", ["", 'pytest_plugins = ["litegrip_client.testing"]\n'])
def test_the_fixture_is_there_for_pytest(tmp_path: Path, named: str) -> None:
    """By itself, and also where it is named as version 0.1.0 needed it."""
    (tmp_path / "conftest.py").write_text(named)
    (tmp_path / "test_mine.py").write_text(block("python", "simulated_gripper"))
    command = [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider", str(tmp_path)]
    own = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    done = ran(*command, within_s=100, env=own)
    assert "2 passed" in done.stdout, done.stdout + done.stderr


def test_a_program_that_names_another_gripper_is_refused_as_the_page_says(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    with simulated() as daemon:
        monkeypatch.setenv("LITEGRIPD_SOCKET", daemon.socket_path)
        with pytest.raises(CommandError) as caught, LiteGrip("can0"):
            pass
        assert caught.value.reason == "wrong_gripper"
        with LiteGrip(daemon.channel) as gripper:
            assert gripper.enable()
