"""What docs/pressing.md and docs/safety.md say of forces and ways, measured at simulated jaws."""

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from litegrip_client import LiteGrip, StoppedError, Trajectory, TrajectorySample
from litegripd.model.calibration import NOMINAL
from tests.docs.test_pages import text_of
from tests.drop_in import Daemon, Moment, Site, a_site
from tests.world import World

RIGID_NM_RAD = 1500.0
OBJECT_MM = 40.0


@pytest.fixture
def site(tmp_path: Path) -> Iterator[Site]:
    with a_site(tmp_path) as site:
        yield site


def stream(gripper: LiteGrip, site: Site, **more: float) -> None:
    with gripper.stream(**more) as targets:
        for _ in range(200):
            targets.set_target(10.0)
            site.run(0.01)


def play(gripper: LiteGrip, _site: Site) -> None:
    samples = [TrajectorySample(n * 0.01, 0.5 - 0.002 * n, 0.0, 0.0, 0.0) for n in range(201)]
    geometry = NOMINAL[0]
    limits = (geometry.closed_rad, geometry.open_rad, geometry.rad_to_mm)
    assert gripper.play(Trajectory(samples, 100.0, 1.7e9, *limits)).outcome == "blocked"


def follow(gripper: LiteGrip, site: Site) -> None:
    gripper.teleop_start("slave", fake_leader=True)
    site.run(10.0)


MOTIONS: dict[str, tuple[Callable[[LiteGrip, Site], object], float, float]] = {
    "grasp": (lambda gripper, _: gripper.grasp(force_n=10, hold_s=1), 1.0, 1.1),
    "close": (lambda gripper, _: gripper.close(), 1.9, 2.6),
    "goto": (lambda gripper, _: gripper.goto(10.0, duration=None), 1.9, 2.6),
    "goto, as fast as it may": (lambda gripper, _: gripper.goto(10.0), 1.9, 2.7),
    "stream": (stream, 0.9, 1.05),
    "stream of 3 N·m": (lambda gripper, site: stream(gripper, site, torque_nm=3.0), 2.8, 3.05),
    "play": (play, 1.9, 2.05),
    "follower": (follow, 1.9, 3.0),
}


def measured(site: Site, daemon: Daemon, move: Callable[[LiteGrip], object]) -> list[Moment]:
    with LiteGrip("can0") as gripper:
        assert gripper.enable()
        with site.recorded(daemon) as moments:
            move(gripper)
    return moments


@pytest.mark.parametrize("name", MOTIONS)
def test_how_hard_something_rigid_is_pressed(site: Site, name: str) -> None:
    move, least_nm, most_nm = MOTIONS[name]
    daemon = site.add(Daemon())
    daemon.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=RIGID_NM_RAD)
    moments = measured(site, daemon, lambda gripper: move(gripper, site))
    assert least_nm < max(moment.closing_torque_nm for moment in moments) < most_nm


@pytest.mark.parametrize("name", ["close", "goto", "follower"])
def test_no_motion_presses_with_more_than_the_rating_by_itself(site: Site, name: str) -> None:
    daemon = site.add(Daemon())
    daemon.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=RIGID_NM_RAD)
    moments = measured(site, daemon, lambda gripper: MOTIONS[name][0](gripper, site))
    assert max(moment.closing_torque_nm for moment in moments) < 3.0


def test_zero_probes_with_about_1_nm_and_presses_on_each_stop_for_a_moment(site: Site) -> None:
    daemon = site.add(Daemon())
    moments = measured(site, daemon, lambda gripper: gripper.zero(progress=lambda _: None))
    torques_nm = [abs(moment.closing_torque_nm) for moment in moments]
    assert 1.8 < max(torques_nm) < 2.0
    above = [torque_nm for torque_nm in torques_nm if torque_nm > 1.1]
    assert len(above) * 0.005 < 2 * 0.6


def test_a_stop_that_holds_goes_on_gripping_and_one_that_relaxes_does_not(site: Site) -> None:
    daemon = site.add(Daemon())
    daemon.gripper.put_object(width_mm=OBJECT_MM, stiffness_nm_rad=RIGID_NM_RAD)
    with LiteGrip("can0") as gripper:
        gripper.enable()
        assert gripper.grasp(force_n=20, hold_s=1)
        gripper.software_stop()
        site.run(2.0)
        assert daemon.closing_torque_nm == pytest.approx(2.0, abs=0.1)
        gripper.software_stop("relax")
        weaker = gripper.software_stop("hold")
        assert weaker.stop is not None
        assert weaker.stop["level"] == "relax"
        site.run(0.5)
        assert daemon.closing_torque_nm == pytest.approx(0.0, abs=0.01)
        with pytest.raises(StoppedError):
            gripper.open()


@pytest.mark.parametrize("level", ["hold", "relax", "disable"])
@pytest.mark.parametrize(("begin_mm", "end_mm"), [(80.0, 5.0), (5.0, 80.0)])
@pytest.mark.parametrize("which", [0, 1])
def test_jaws_go_no_further_after_a_stop_than_is_said(
    level: str, begin_mm: float, end_mm: float, which: int
) -> None:
    """Nor is what is said much too long."""
    said = r"in the simulator (.*) mm at most from (.*) mm/s, (.*) mm from (.*) mm/s, at any level"
    found = re.search(said, " ".join(text_of("docs/safety.md").split()))
    assert found is not None
    most_mm, speed_mm_s = float(found[1 + 2 * which]), float(found[2 + 2 * which])
    world = World()
    client = world.enabled()
    gripper = world.gripper
    client.result("motion.move", opening_mm=begin_mm)
    client.send("motion.move", opening_mm=end_mm, speed_mm_s=speed_mm_s)
    world.run_until(lambda: abs(gripper.opening_mm - begin_mm) > 35.0)
    stopped_mm = gripper.opening_mm
    client.result("stop", level=level)
    further_mm = max(abs(mm - stopped_mm) for mm in world.track(1.0, lambda: gripper.opening_mm))
    assert most_mm / 5 < further_mm < most_mm
    assert gripper.velocity_rad_s == 0.0
