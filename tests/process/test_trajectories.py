"""Trajectories through whole processes: taught by hand on a simulator, saved, loaded, replayed."""

import os
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from mcap.reader import make_reader

from litegrip_client import (
    CommandError,
    LiteGrip,
    LiteGripError,
    Trajectory,
    TrajectoryNotFoundError,
)
from litegrip_client.ctl.main import main
from tests.process.by_portal import Met
from tests.process.daemon_process import BY_GATEWAY, DEADLINE_S, SLCAN, DaemonProcess, configured
from tests.sim.simulator_process import SimulatorProcess, simulator

_BUSY = ("recording_failed", "motor_silent", "motor_fault", "not_enabled", "not_confirmed")
"""What a simulator that was kept off the processor for too long brings; one tries again then."""


@pytest.fixture(autouse=True)
def _own_directory(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LITEGRIP_TRAJ_DIR", str(tmp_path / "mine"))


def until(condition: Callable[[], bool]) -> None:
    """Look until a condition holds."""
    ends_s = time.monotonic() + DEADLINE_S
    while not condition():
        assert time.monotonic() < ends_s, "did not happen in time"


def despite_load(gripper: LiteGrip, attempt: Callable[[], None]) -> None:
    """Try until it succeeds, enabling the motor anew where that is needed."""
    ends_s = time.monotonic() + DEADLINE_S
    while (error := _error_of(gripper, attempt)) is not None:
        assert error.reason in _BUSY, error
        assert time.monotonic() < ends_s, error


def _error_of(gripper: LiteGrip, attempt: Callable[[], None]) -> LiteGripError | None:
    try:
        until(lambda: gripper.get_state().motor not in ("silent", "enabling"))
        if not gripper.get_state().enabled:
            gripper.enable()
        attempt()
    except LiteGripError as error:
        return error
    return None


@pytest.fixture
def adapter() -> Iterator[SimulatorProcess]:
    with simulator("--pty") as process:
        yield process


def test_a_hand_teaches_the_jaws_of_a_simulator_in_another_process(
    met: Met, tmp_path: Path, adapter: SimulatorProcess
) -> None:
    config = SLCAN.format(channel=adapter.first_line) + BY_GATEWAY
    with configured(tmp_path, f"traj{os.getpid()}", config) as running, met(running):
        with running.connect() as client:
            channel = client.result("hello")["channel"]
        with LiteGrip(channel, socket_path=str(running.socket_path)) as gripper:

            def openness() -> float:
                return gripper.get_state().openness or 0.0

            def teach() -> None:
                adapter.write("push 0")
                gripper.goto_openness(0.3)
                began = openness()
                gripper.record_start()
                adapter.write("push -0.3")  # opens
                until(lambda: openness() > began + 0.2 or not gripper.get_state().enabled)
                adapter.write("push 0")
                taught = gripper.record_stop()
                assert len(taught) > 2
                assert max(one.openness for one in taught.samples) > began + 0.15
                taught.save("by hand")

            def replay() -> None:
                taught = Trajectory.load("by hand")
                assert gripper.play(taught, speed=0.25)  # a starved hand is late, and then fast
                assert openness() == pytest.approx(taught.samples[-1].openness, abs=0.05)

            despite_load(gripper, teach)
            despite_load(gripper, replay)
            assert (tmp_path / "mine" / "by hand.lgt").exists()


def test_a_programmed_motion_goes_through_the_daemons_store_and_back(
    simulated: DaemonProcess, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def ctl(*arguments: str) -> str:
        assert main(["--socket", str(simulated.socket_path), *arguments]) == 0
        return capsys.readouterr().out

    with simulated.connect() as client:
        channel = client.enabled().result("hello")["channel"]
    with LiteGrip(channel, socket_path=str(simulated.socket_path)) as gripper:

        def capture() -> None:
            gripper.goto_openness(0.3, duration=0.5)
            gripper.record_start(rate_hz=200.0, zero_gravity=False)
            assert gripper.goto_openness(0.6, duration=0.7)
            captured = gripper.record_stop()
            assert captured.samples[0].openness == pytest.approx(0.3, abs=0.05)
            assert captured.samples[-1].openness == pytest.approx(0.6, abs=0.05)
            captured.save("pick")

        despite_load(gripper, capture)
        ctl("trajectories", "put", "pick", "--as", "there")
        assert "there" in ctl("trajectories")
        ctl("trajectories", "get", "there", "-o", "back")
        assert Trajectory.load("back") == Trajectory.load("pick")
        lines = ctl("trajectories", "export", "there").splitlines()
        assert len(lines) == 1 + len(Trajectory.load("pick"))
        gripper.disable()
    ctl("enable")
    assert "completed, 2 passes" in ctl("play", "there", "--repeat", "2")
    assert "completed, 1 pass" in ctl("play", "--local", "back", "--speed", "2")
    ctl("record", "more", "--seconds", "0.3")
    ctl("trajectories", "delete", "there")
    assert [line.split()[0] for line in ctl("trajectories").splitlines()] == ["NAME", "more", "of"]
    ctl("disable")


def test_what_the_daemon_keeps_is_listed_fetched_replayed_and_removed_from_python(
    simulated: DaemonProcess,
) -> None:
    with simulated.connect() as client:
        channel = client.enabled().result("hello")["channel"]
    with LiteGrip(channel, socket_path=str(simulated.socket_path)) as gripper:

        def capture() -> None:
            gripper.goto_openness(0.5, duration=0.5)
            gripper.record_start(rate_hz=100.0, zero_gravity=False)
            assert gripper.goto_openness(0.4, duration=2.0)
            kept = gripper.record_stop()
            described = gripper.keep_trajectory("swing", kept)
            assert described["samples"] == len(kept)
            assert gripper.fetch_trajectory("swing") == kept

        despite_load(gripper, capture)
        assert [row["name"] for row in gripper.kept_trajectories()] == ["swing"]

        def replay() -> None:
            gripper.play_start(gripper.fetch_trajectory("swing"), loop=True)
            assert gripper.play_speed(0.5)["speed"] == 0.5
            until(lambda: gripper.trajectory_status()["phase"] == "play")
            gripper.play_pause()
            held = gripper.trajectory_status()["openness"]
            frames = gripper.trajectory_status()["frames"]
            until(lambda: gripper.trajectory_status()["frames"] > frames)
            assert gripper.trajectory_status()["openness"] == held
            gripper.play_resume()
            until(lambda: gripper.trajectory_status()["openness"] != held)
            gripper.play_stop()

        despite_load(gripper, replay)
        with pytest.raises(CommandError):
            gripper.play_pause()
        with pytest.raises(CommandError, match="speed"):
            gripper.play_speed(9)
        gripper.delete_trajectory("swing")
        assert gripper.kept_trajectories() == []
        with pytest.raises(TrajectoryNotFoundError):
            gripper.fetch_trajectory("swing")
        with pytest.raises(TrajectoryNotFoundError):
            gripper.delete_trajectory("swing")


def test_a_dump_is_written_from_python_with_its_note(simulated: DaemonProcess) -> None:
    with simulated.connect() as client:
        channel = client.enabled().result("hello")["channel"]
    with LiteGrip(channel, socket_path=str(simulated.socket_path)) as gripper:
        path = Path(gripper.dump("it jerked"))
        with path.open("rb") as file:
            notes = {one.name: one.metadata for one in make_reader(file).iter_metadata()}
    assert notes["litegripd"]["note"] == "it jerked"
