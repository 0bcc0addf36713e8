"""What `make run` runs: it says what to type once that works, and for whose gripper."""

import contextlib
import os
import signal
from pathlib import Path

import pytest

from litegrip_client import ConnectError, LiteGrip
from litegrip_client.threads.blocking import connect
from tests.process.daemon_process import DEADLINE_S, daemon
from tests.process.run_simulated import Run, run

pytestmark = pytest.mark.alone


@pytest.fixture(autouse=True)
def _free() -> None:
    with contextlib.suppress(ConnectError):
        connect("sim0").close()
        pytest.skip("a daemon of sim0 runs already")


def test_it_says_what_to_type_when_clients_are_served_already(tmp_path: Path) -> None:
    with run(tmp_path) as started:
        assert "export LITEGRIP_CHANNEL=sim0" in started.said
        with LiteGrip("sim0") as gripper:
            gripper.enable()
    assert "not granted" not in started.said
    assert "the motor is off" in started.said


def test_a_daemon_that_was_killed_is_told_in_words(tmp_path: Path) -> None:
    started = Run(tmp_path)
    with connect("sim0") as connection:
        os.kill(connection.call("hello")["pid"], signal.SIGKILL)
    assert started.process.wait(DEADLINE_S) == 1
    assert started.end() == 1
    assert "The daemon was ended by SIGKILL: start it again." in started.said


def test_mujoco_has_a_loose_cube_to_grasp(tmp_path: Path) -> None:
    with run(tmp_path, "mujoco") as started:
        assert "there is a loose cube of 30 mm between the jaws" in started.said
        with LiteGrip("sim0") as gripper:
            gripper.enable()
            grasp = gripper.grasp(10.0, until="verdict")
            assert (grasp.ok, grasp.outcome) == (True, "object_held")
            assert grasp.width_mm == pytest.approx(30.0, abs=0.5)


def test_a_second_one_says_where_the_first_one_is_and_starts_nothing(tmp_path: Path) -> None:
    with run(tmp_path) as first:
        second = Run(tmp_path)
        assert second.end() == 0
        with connect("sim0") as connection:
            pid = connection.call("hello")["pid"]
        assert f"runs already: channel sim0, process {pid}." in second.said
        assert second.page == first.page


def test_a_bookmark_of_the_page_works_after_a_restart(tmp_path: Path) -> None:
    with run(tmp_path) as first:
        pass
    with run(tmp_path) as second:
        assert second.page == first.page


def test_a_name_that_another_daemon_has_is_not_used(tmp_path: Path) -> None:
    """It is one that clients of the name do not reach, as that of another user."""
    with daemon(tmp_path, "sim0", "--simulate") as other:
        other.connect().close()
        with run(tmp_path) as started:
            said = started.said
        assert "export LITEGRIP_CHANNEL=sim1" in said
        assert "sim0 is owned by the daemon with pid" in said
