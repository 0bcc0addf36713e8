"""Each method of the SDK is called by position and by keyword; both send the same frames."""

import inspect
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import CalibrationData, LiteGrip, Trajectory
from tests.drop_in import Daemon, Moment, Site, a_site
from tests.geometry import MM_RAD, TRAVEL_MM, TRAVEL_RAD
from tests.sdk.readme.scenes import lead_mm, write_file
from tests.sdk.readme.trajectories import push, swing, teach


@dataclass(slots=True)
class Played:
    """One scene: a gripper at 60 mm, enabled, of which one method is called."""

    site: Site
    daemon: Daemon
    gripper: LiteGrip
    home: Path
    moments: list[Moment] = field(default_factory=list)
    result: Any = None
    took_s: float = 0.0

    @property
    def opening_mm(self) -> float:
        return self.daemon.gripper.opening_mm

    def speed_mm_s(self) -> float:
        """Return the fastest that the jaws were commanded to go."""
        commands = [m.command for m in self.moments if m.command]
        return max(abs(command.velocity_rad_s) for command in commands) * MM_RAD

    def kp(self) -> set[int]:
        """Return the stiffness of all commands on the way."""
        commands = [m.command for m in self.moments if m.command]
        return {round(c.kp_nm_rad) for c in commands if abs(c.velocity_rad_s) > 0.15}


def at_30_mm(played: Played) -> float:
    geometry = played.daemon.controller.geometry
    assert geometry is not None
    return geometry.closed_rad - geometry.close_sign * geometry.to_rad(30.0)


def nothing(_played: Played) -> None:
    """Leave the gripper as it is."""


def an_object(played: Played) -> None:
    played.daemon.gripper.put_object(width_mm=30.0)


def at_50_mm_s(played: Played) -> None:
    """Have a stream follow slowly: fast ones are softer than their `kp`."""
    played.gripper.motion_config.speed_mm_s = 50.0


def half_open(played: Played) -> None:
    assert played.gripper.goto_openness(0.5)


def a_grip(played: Played) -> None:
    an_object(played)
    assert played.gripper.grasp(10.0, until="verdict")


def a_hand(played: Played) -> None:
    push(played.site, played.daemon, (0.5, 0.4), (2.0, -0.4), (5.0, 0.0))


def a_teacher(played: Played) -> None:
    teach(played.site, played.daemon)


def a_recording(played: Played) -> None:
    played.gripper.record_start()
    played.site.run(0.5)


def a_replay(played: Played) -> None:
    played.gripper.play_start(swing(), loop=True)
    played.site.run(0.5)


def a_follower(played: Played) -> None:
    played.gripper.teleop_start("slave", fake_leader=True)
    played.site.run(0.5)


def slack_jaws(played: Played) -> None:
    assert played.gripper.enter_zero_gravity()


def a_fault(played: Played) -> None:
    played.daemon.gripper.latch_fault(0xE)
    played.site.run(0.1)


def no_power(played: Played) -> None:
    assert played.gripper.disable()


Check = Callable[[Played], object]
Arguments = tuple[Any, ...] | Callable[[Played], tuple[Any, ...]]


@dataclass(frozen=True, slots=True)
class Scene:
    """What is called, with every argument that the SDK takes by position; and what is then true."""

    arguments: Arguments
    check: Check
    before: Check = nothing
    after_s: float = 0.0


def arrives(speed_mm_s: float, kp: int, took_s: float) -> Check:
    def check(played: Played) -> None:
        assert played.result.ok
        assert played.opening_mm == pytest.approx(30.0, abs=0.6)
        assert played.speed_mm_s() == pytest.approx(speed_mm_s, rel=0.05)
        assert played.kp() == {kp}
        assert played.took_s == pytest.approx(took_s, abs=0.4)

    return check


def runs_to(opening_mm: float, speed_mm_s: float) -> Check:
    def check(played: Played) -> None:
        assert played.result.ok
        assert played.result.stalled
        assert played.opening_mm == pytest.approx(opening_mm, abs=1.0)
        assert played.speed_mm_s() == pytest.approx(speed_mm_s, rel=0.05)

    return check


def grasped(played: Played) -> None:
    assert (played.result.ok, played.result.outcome) == (True, "object_held")
    assert played.result.held_s == pytest.approx(0.7, abs=0.02)
    assert played.daemon.closing_torque_nm == pytest.approx(1.2, abs=0.1)


def squeezed(played: Played) -> None:
    assert played.took_s == pytest.approx(1.5, abs=0.05)
    assert played.daemon.closing_torque_nm == pytest.approx(0.8, abs=0.1)


def is_slack(played: Played) -> None:
    command = played.moments[-1].command
    assert command is not None
    assert (command.kp_nm_rad, command.kd_nm_s_rad) == (0.0, 0.0)
    assert command.torque_nm == pytest.approx(0.0, abs=0.01)


def holds(played: Played) -> None:
    assert played.gripper.get_state().mode == "holding"
    assert lead_mm(played.moments[-1]) < 0.3


def measured(kp: int | None) -> Check:
    def check(played: Played) -> None:
        data = played.result
        assert isinstance(data, CalibrationData)
        assert (data.mount, data.calibrated) == ("normal", True)
        assert data.travel_range == pytest.approx(TRAVEL_RAD, abs=0.06)
        if kp is not None:
            probing = [m.command for m in played.moments[20:200] if m.command]
            assert {round(command.kp_nm_rad) for command in probing} == {kp}

    return check


def zeroed(played: Played) -> None:
    assert played.result.ok
    assert not played.daemon.is_energised
    assert played.gripper.get_position_rad() == pytest.approx(0.0, abs=0.001)


def taught(count: int) -> Check:
    def check(played: Played) -> None:
        assert isinstance(played.result, Trajectory)
        assert (len(played.result), played.result.sample_hz) == (count, 50.0)
        holds(played)

    return check


def is_recording(played: Played) -> None:
    assert (played.result["active"], played.result["rate_hz"]) == (True, 50.0)
    assert not played.result["zero_gravity"]
    assert len(played.gripper.record_stop()) == 10


def kept(played: Played) -> None:
    assert len(played.result) == pytest.approx(50, abs=1)
    holds(played)


def replayed(played: Played) -> None:
    assert (played.result.ok, played.result.outcome) == (True, "completed")
    assert played.took_s == pytest.approx(1.05, abs=0.15)
    assert max(played.kp()) == 80


def is_replaying(played: Played) -> None:
    assert (played.result["active"], played.result["kind"]) == (True, "play")
    assert played.gripper.trajectory_status()["active"]
    assert max(played.kp()) == 80


def loaded(path: str) -> Check:
    def check(played: Played) -> None:
        assert played.result is True
        assert played.gripper.config.rad_to_mm == (53.0 if path else MM_RAD)
        assert played.gripper.mount == ("normal" if path else "reverse")

    return check


def a_file(played: Played) -> tuple[str, None]:
    return str(write_file(played.home / "mine.json", "normal", rad_to_mm=53.0)), None


def saved(played: Played) -> None:
    assert played.result == str(played.home / "mine.json")
    assert played.gripper.load_calibration(played.result) is True


def returns(value: object) -> Check:
    def check(played: Played) -> None:
        assert played.result == value

    return check


def returns_about(value: float, within: float) -> Check:
    def check(played: Played) -> None:
        assert played.result == pytest.approx(value, abs=within)

    return check


PROBE = (15.0, 1.5, 0.04, 0.002, 6, 150, 1.5)

SCENES: dict[str, Scene] = {
    "connect": Scene((), returns(True)),
    "disconnect": Scene((), lambda p: not p.daemon.is_energised),
    "enable": Scene((4,), lambda p: p.result.tries == 1 and p.daemon.is_energised, no_power),
    "disable": Scene((), lambda p: p.result is True and not p.daemon.is_energised),
    "open": Scene((40.0,), runs_to(TRAVEL_MM, 40.0)),
    "close": Scene((40.0,), runs_to(0.0, 40.0)),
    "grasp": Scene((12.0, 0.7), grasped, an_object),
    "goto": Scene((30.0, 150.0, 2.0, 1.0), arrives(30.0, 100, 1.0)),
    "goto_rad": Scene(lambda p: (at_30_mm(p), 150.0, 2.0, 0.0, 0.0, 1.0), arrives(30.0, 100, 1.0)),
    "move_to": Scene(lambda p: (at_30_mm(p), 150.0, 2.0, 0.0, 1.0), arrives(30.0, 100, 1.0)),
    "move_at_speed": Scene((30.0, 20.0, 150.0, 2.0), arrives(20.0, 100, 1.5)),
    "move_at_speed_rad": Scene(
        lambda p: (at_30_mm(p), 20.0 / MM_RAD, 150.0, 2.0), arrives(20.0, 100, 1.5)
    ),
    "set_force": Scene((8.0, 1.5), squeezed, lambda p: p.daemon.gripper.put_object(width_mm=58.0)),
    "send_mit_frame": Scene(
        lambda p: (at_30_mm(p), 40.0, 1.0, 0.0, 0.0),
        lambda p: p.result is True and p.kp() == {40} and p.opening_mm < 55.0,
        at_50_mm_s,
        after_s=0.15,
    ),
    "stop": Scene((), is_slack, a_grip, 0.1),
    "poll": Scene((0.5,), returns(True)),
    "get_state": Scene((True,), lambda p: abs(p.result.position_mm - p.opening_mm) < 0.2),
    "get_position": Scene((), returns_about(60.0, 0.2)),
    "get_position_rad": Scene((), lambda p: p.result - p.daemon.gripper.position_rad < 0.002),
    "get_force": Scene((), returns_about(10.0, 2.0), a_grip),
    "get_torque": Scene((), returns_about(1.0, 0.2), a_grip),
    "get_error": Scene((), returns(0xE), a_fault),
    "get_temperature": Scene((), lambda p: p.result == (25.0, 25.0)),
    "is_moving": Scene((), returns(False)),
    "is_grasped": Scene((), returns(True), a_grip),
    "wait_for_ready": Scene((1.0,), returns(True)),
    "enter_zero_gravity": Scene((0.5,), lambda p: abs(p.took_s - 0.5) < 0.05),
    "exit_zero_gravity": Scene((), holds, slack_jaws, 0.3),
    "clear_fault": Scene((), lambda p: p.result and p.daemon.is_energised, a_fault),
    "read_param": Scene(("PMAX",), returns(12.5)),
    "set_zero": Scene((), zeroed),
    "zero": Scene((), measured(None)),
    "calibrate": Scene(PROBE, measured(15)),
    "calibrate_guided": Scene(PROBE, measured(15)),
    "calibrate_manual": Scene((6.0, 0.5, 0.02), measured(None), a_hand),
    "load_calibration": Scene(a_file, loaded("mine"), no_power),
    "save_calibration": Scene(lambda p: (str(p.home / "mine.json"),), saved, no_power),
    "load_template": Scene(("reverse",), loaded(""), no_power),
    "record": Scene((1.0, 50.0, True), taught(50), a_teacher),
    "record_start": Scene((50.0, False, 10), is_recording, after_s=0.5),
    "record_stop": Scene((True,), kept, a_recording),
    "play": Scene((swing(), 2.0, 80.0, 1.5, True), replayed, half_open),
    "play_start": Scene((swing(), 2.0, 80.0, 1.5, True, True), is_replaying, after_s=3.0),
    "play_stop": Scene((1.0,), holds, a_replay, 0.3),
    "trajectory_status": Scene((), lambda p: p.result["kind"] == "play", a_replay),
    "teleop_start": Scene(
        ("slave", "192.168.1.20"), lambda p: p.result["mode"] == "slave" and p.result["active"]
    ),
    "teleop_stop": Scene((1.0,), holds, a_follower, 0.3),
    "teleop_status": Scene(
        (), lambda p: p.result["active"] and p.result["frames"] > 50, a_follower
    ),
}

POSITIONAL = (inspect.Parameter.POSITIONAL_ONLY, inspect.Parameter.POSITIONAL_OR_KEYWORD)


def by_position(method: str) -> list[str]:
    parameters = inspect.signature(getattr(LiteGrip, method)).parameters.values()
    return [one.name for one in parameters if one.kind in POSITIONAL][1:]


def play(home: Path, method: str, *, keywords: bool) -> Played:
    scene = SCENES[method]
    with a_site(home) as site:
        daemon = site.add(Daemon())
        gripper = LiteGrip("can0")
        gripper.connect()
        assert gripper.enable()
        played = Played(site, daemon, gripper, home)
        scene.before(played)
        given = scene.arguments if isinstance(scene.arguments, tuple) else scene.arguments(played)
        names = by_position(method)
        assert len(given) == len(names)
        call, began_s = getattr(gripper, method), site.now_s
        named = dict(zip(names, given, strict=True))
        with site.recorded(daemon) as played.moments:
            played.result = call(**named) if keywords else call(*given)
            played.took_s = site.now_s - began_s
            site.run(scene.after_s)
        assert scene.check(played) is not False
        if gripper.is_connected:
            gripper.disconnect()
    return played


def frames(moments: Sequence[Moment]) -> list[object]:
    return [moment.command for moment in moments]


@pytest.mark.parametrize("method", SCENES)
def test_a_method_does_what_it_says_by_position_and_by_keyword(tmp_path: Path, method: str) -> None:
    played = []
    for number, keywords in enumerate((False, True)):
        home = tmp_path / str(number)
        home.mkdir()
        played.append(play(home, method, keywords=keywords))
    first, second = played
    assert frames(first.moments) == frames(second.moments)
    assert first.took_s == second.took_s
