"""What all mechanics behind the motor promise: the simulator's own, and MuJoCo's.

Both have the same motor and the same figures, so the same tests hold for both.
"""

import copy
import random
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pytest

from litegripd.app.build import build_service
from litegripd.sim.drive import Drive, Mechanics
from litegripd.sim.gripper import SimulatedGripper, build_gripper, named_mechanics
from litegripd.sim.mujoco_plant import SCENE, MujocoPlant
from litegripd.sim.plant import MOUNTS, Plant, SimulatorParameters, limits_of_mount
from tests.sim.driving import DISABLE, Driver, command
from tests.world import PERIOD_S, Client, FixedFacts, World

OBJECT_MM = 30.0

Of = Callable[[SimulatorParameters], Mechanics]


@pytest.fixture(scope="module")
def empty_scene(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The shipped scene without its cube."""
    text = SCENE.read_text(encoding="utf-8")
    text, bodies = re.subn(r'<body name="cube".*?</body>', "", text, flags=re.DOTALL)
    text, keys = re.subn(r' 0\.006 0 0\.015 1 0 0 0"/>', '"/>', text)
    assert bodies == keys == 1
    path = tmp_path_factory.mktemp("scene") / "empty.xml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.fixture(params=["own", "mujoco"])
def empty(request: pytest.FixtureRequest, empty_scene: Path) -> Of:
    """Mechanics with nothing between the jaws, which are 60 mm open."""
    return Plant if request.param == "own" else lambda p: MujocoPlant(p, empty_scene)


@pytest.fixture(params=["own", "mujoco"])
def filled(request: pytest.FixtureRequest) -> Of:
    """Mechanics with an object of 30 mm between the jaws, which are 60 mm open."""

    def own(parameters: SimulatorParameters) -> Plant:
        plant = Plant(parameters)
        plant.put(build_gripper(object_mm=OBJECT_MM).gripped_object)
        return plant

    return own if request.param == "own" else MujocoPlant


def gripper_with(mechanics: Of, mount: str = "normal") -> SimulatedGripper:
    closed_rad, open_rad = limits_of_mount(mount)
    parameters = SimulatorParameters(closed_rad=closed_rad, open_rad=open_rad)
    return SimulatedGripper(parameters, mechanics=mechanics(parameters))


def armed(mechanics: Of, mount: str = "normal") -> Driver:
    driver = Driver(gripper_with(mechanics, mount))
    driver.arm()
    return driver


class OnMechanics(World):
    """A daemon on these mechanics, which knows that its gripper is simulated."""

    def __init__(self, mechanics: Of, mount: str = "normal") -> None:
        self._mechanics = mechanics
        super().__init__(mount)
        self.service = build_service(
            self.controller, FixedFacts(), PERIOD_S, simulated=lambda: self.gripper
        )

    def make_gripper(self, parameters: SimulatorParameters) -> SimulatedGripper:
        return SimulatedGripper(parameters, mechanics=self._mechanics(parameters))


def enabled(mechanics: Of, mount: str = "normal") -> tuple[OnMechanics, Client]:
    world = OnMechanics(mechanics, mount)
    return world, world.enabled()


@pytest.mark.parametrize("mount", MOUNTS)
def test_a_daemon_opens_goes_and_grasps(filled: Of, mount: str) -> None:
    world, client = enabled(filled, mount)
    assert client.result("motion.open")["ok"]
    assert client.result("motion.move", opening_mm=50.0)["ok"]
    assert world.gripper.opening_mm == pytest.approx(50.0, abs=0.5)
    grasp = client.result("motion.grasp", force_n=10.0, until="verdict")
    assert (grasp["ok"], grasp["outcome"]) == (True, "object_held")
    assert grasp["width_mm"] == pytest.approx(OBJECT_MM, abs=0.5)
    world.run(1.0)
    assert world.state.is_grasped
    assert world.gripper.opening_mm == pytest.approx(OBJECT_MM, abs=0.5)
    # Friction carries as much of the 1 N·m, in either direction.
    assert client.result("sim.get")["clamp_nm"] == pytest.approx(1.0, abs=0.22)


def test_a_daemon_finds_nothing_to_grasp(empty: Of) -> None:
    _, client = enabled(empty)
    grasp = client.result("motion.grasp", force_n=10.0, until="verdict")
    assert grasp["outcome"] == "no_object"
    assert client.result("sim.get")["object"] is None


@pytest.mark.parametrize("mount", MOUNTS)
def test_pressed_against_an_end_the_jaws_stand_at_the_calibrated_limit(
    empty: Of, mount: str
) -> None:
    driver = armed(empty, mount)
    parameters = driver.gripper.parameters
    sign = parameters.close_sign
    travel_mm = abs(parameters.open_rad - parameters.closed_rad) * parameters.rad_to_mm
    driver.stream(4.0, command(kd=1.0, tau=sign * 0.94))
    assert driver.gripper.opening_mm == pytest.approx(0.0, abs=0.3)
    driver.stream(4.0, command(kd=1.0, tau=-sign * 0.94))
    assert driver.gripper.opening_mm == pytest.approx(travel_mm, abs=0.3)
    before_mm = driver.gripper.opening_mm
    driver.stream(2.0, command(kd=1.0, tau=-sign * 2.94))  # 250 N·m/rad
    assert driver.gripper.opening_mm - before_mm == pytest.approx(2.0 / 250.0 * 52.69, abs=0.05)


def test_the_soft_closed_end_springs_back_after_a_press(empty: Of) -> None:
    driver = armed(empty)
    driver.stream(4.0, command(kd=1.0, tau=1.0))
    pressed_rad = driver.gripper.position_rad
    driver.ask(DISABLE)
    driver.wait(1.0)
    # 72 counts were measured, 0.0275 rad.
    assert pressed_rad - driver.gripper.position_rad == pytest.approx(0.0265, abs=0.003)


def test_standing_jaws_hold_against_a_push_below_the_breakaway(empty: Of) -> None:
    driver = Driver(gripper_with(empty))
    start_mm = driver.gripper.opening_mm
    driver.gripper.push(0.20)
    driver.wait(5.0)
    assert driver.gripper.opening_mm == pytest.approx(start_mm, abs=0.005)
    driver.gripper.push(0.24)
    driver.wait(1.0)
    # Moving, only 0.15 N·m of friction is left, and the shorted phases brake.
    assert driver.gripper.velocity_rad_s == pytest.approx((0.24 - 0.15) / 0.72, rel=0.03)
    driver.gripper.push(0.0)
    driver.wait(0.2)
    assert abs(driver.gripper.velocity_rad_s) < 1e-4


def test_a_hand_with_a_damping_leads_free_jaws_at_its_own_speed(empty: Of) -> None:
    driver = Driver(gripper_with(empty))
    own_nm_s_rad, friction_nm = 0.72, 0.15  # the shorted phases and the bearings; see above
    driver.gripper.push(1.0 + friction_nm, 2.0 - own_nm_s_rad)
    driver.wait(0.4)
    assert driver.gripper.velocity_rad_s == pytest.approx(1.0 / 2.0, rel=0.03)
    assert driver.gripper.hand_nm == pytest.approx(0.5 * own_nm_s_rad + friction_nm, rel=0.03)


def test_what_blocks_the_jaws_holds_them_until_it_is_taken_away(empty: Of) -> None:
    driver = armed(empty)
    start_mm = driver.gripper.opening_mm
    driver.gripper.jam()
    assert driver.gripper.is_held
    driver.stream(2.0, command(tau=-5.0))
    assert driver.gripper.opening_mm == pytest.approx(start_mm, abs=0.05)
    driver.gripper.free()
    driver.stream(0.05, command(tau=-1.0))
    assert driver.gripper.opening_mm > start_mm + 5.0


def test_both_mounts_are_mirror_images(empty: Of) -> None:
    # Zero torque has no code of its own, so the mirror needs codes that mirror exactly.
    normal, reverse = armed(empty, "normal"), armed(empty, "reverse")
    for driver, torque_nm in ((normal, 1.0), (reverse, -1.0)):
        driver.ask(DISABLE)
        driver.gripper.push(torque_nm)
        driver.wait(0.5)
    assert normal.gripper.opening_mm == pytest.approx(reverse.gripper.opening_mm, abs=1e-9)
    assert normal.gripper.velocity_rad_s == pytest.approx(-reverse.gripper.velocity_rad_s)
    assert normal.gripper.hand_nm == reverse.gripper.hand_nm == 1.0


@pytest.mark.parametrize("seed", range(3))
def test_jaws_stay_between_their_ends_whatever_is_commanded(filled: Of, seed: int) -> None:
    chance = random.Random(seed)
    driver = armed(filled)
    openings_mm = []
    for _ in range(60):
        frame = command(
            q=chance.uniform(-2.0, 0.3),
            dq=chance.choice((0.0, -20.0, 20.0)),
            kp=chance.choice((0.0, 5.0, 100.0, 500.0)),
            kd=chance.choice((0.0, 1.0, 5.0)),
            tau=chance.uniform(-10.0, 10.0),
        )
        for _ in range(chance.randint(1, 20)):
            driver.stream(PERIOD_S, frame)
            openings_mm.append(driver.gripper.opening_mm)
    # The object gives way by some millimetres under 10 N·m, the open stop as well.
    assert 22.0 < min(openings_mm) < 30.0
    assert 80.0 < max(openings_mm) < 94.0


def test_slicing_time_changes_nothing(filled: Of) -> None:
    parameters = SimulatorParameters()
    plants = filled(parameters), filled(parameters)
    at_once, sliced = (Drive(parameters, plant) for plant in plants)
    for drive in (at_once, sliced):
        drive.drive(
            position_rad=-0.5, velocity_rad_s=0.0, kp_nm_rad=50.0, kd_nm_s_rad=1.0, torque_nm=0.1
        )
    at_once.run(4000)
    for steps in (1, 2, 3, 5, 7) * 222 + (4,):
        sliced.run(steps)
    assert plants[0].angle_rad == plants[1].angle_rad
    assert at_once.measured_velocity_rad_s == sliced.measured_velocity_rad_s
    assert at_once.motor_torque_nm == sliced.motor_torque_nm


def test_a_copy_goes_its_own_way_from_the_same_state(filled: Of) -> None:
    gripper = gripper_with(filled)
    gripper.advance(0.0)
    gripper.push(1.0)
    gripper.advance(0.1)
    other = gripper.fork()
    gripper.advance(0.3)
    assert other.opening_mm > gripper.opening_mm
    other.advance(0.3)
    assert other.opening_mm == gripper.opening_mm


def test_looking_at_the_clamp_changes_nothing(filled: Of) -> None:
    looked_at, alone = armed(filled), armed(filled)
    for _ in range(100):
        for driver in (looked_at, alone):
            driver.stream(0.01, command(kd=1.0, tau=1.0))
        assert looked_at.gripper.clamp_nm >= 0.0
    assert looked_at.gripper.position_rad == alone.gripper.position_rad


def test_free_motion_is_the_same_on_both(empty_scene: Path) -> None:
    """60 mm to 20, to 80 and back, by set-points at 50 mm/s, and by torque alone at the end."""
    rad_mm = 52.69
    drivers = [armed(Plant), armed(lambda parameters: MujocoPlant(parameters, empty_scene))]
    apart_mm = []
    wanted_mm = 60.0
    for target_mm in (20.0, 80.0, 60.0):
        while wanted_mm != target_mm:
            step_mm = min(max(target_mm - wanted_mm, -0.25), 0.25)
            wanted_mm += step_mm
            speed_rad_s = -step_mm / PERIOD_S / rad_mm
            for driver in drivers:
                frame = command(q=-wanted_mm / rad_mm, dq=speed_rad_s, kp=100.0, kd=2.0)
                driver.stream(PERIOD_S, frame)
            apart_mm.append(drivers[0].gripper.opening_mm - drivers[1].gripper.opening_mm)
    for _ in range(20):
        for driver in drivers:
            driver.stream(PERIOD_S, command(tau=0.4))
        apart_mm.append(drivers[0].gripper.opening_mm - drivers[1].gripper.opening_mm)
    assert drivers[0].gripper.opening_mm < 50.0
    assert max(map(abs, apart_mm)) < 0.5


def test_another_motor_has_its_own_inertia_on_both(empty: Of) -> None:
    heavy = replace(SimulatorParameters(), rotor_inertia_kg_m2=0.02)
    gripper = SimulatedGripper(heavy, mechanics=empty(heavy))
    gripper.advance(0.0)
    gripper.power_off()  # neither driven nor braked
    gripper.push(1.15)
    gripper.advance(0.1)
    # 1 N·m is left of it; the viscous friction takes little of that yet.
    assert gripper.velocity_rad_s == pytest.approx(0.1 / heavy.inertia_kg_m2, rel=0.06)


def test_mujoco_has_no_object_but_the_bodies_of_its_scene() -> None:
    _, client = enabled(MujocoPlant)
    words = "put the object into the scene"
    client.refused("sim.object", "out_of_limits", words, width_mm=20.0)
    assert client.result("sim.object")["object"] is None
    with pytest.raises(ValueError, match="no object between the jaws"):
        gripper_with(MujocoPlant).give_way(1.0)
    with pytest.raises(ValueError, match=words):
        build_gripper(mechanics="mujoco", object_mm=20.0)


def test_a_loose_cube_is_pushed_to_the_middle_and_stays_there() -> None:
    driver = armed(MujocoPlant)

    def cube_mm() -> list[float]:
        return [1000.0 * at_m for at_m in driver.gripper.scene().qpos[3:6]]

    assert cube_mm() == pytest.approx([6.0, 0.0, 15.0], abs=0.1)
    driver.stream(1.0, command(kd=1.0, tau=1.0))
    assert cube_mm() == pytest.approx([0.0, 0.0, 15.0], abs=0.1)
    driver.stream(1.0, command(kd=1.0, tau=1.0))
    assert abs(driver.gripper.velocity_rad_s) < 1e-3
    driver.stream(0.5, command(kd=1.0, tau=-0.5))
    assert cube_mm() == pytest.approx([0.0, 0.0, 15.0], abs=0.5)


def test_a_client_is_told_where_the_bodies_are() -> None:
    world, client = enabled(MujocoPlant)
    scene = client.result("sim.scene")
    assert scene["file"] == str(SCENE)
    assert scene["qpos"][0] == pytest.approx(-world.gripper.opening_mm / 52.69, abs=1e-6)
    assert len(scene["qpos"]) == 10
    world.run(0.1)
    assert client.result("sim.scene")["time_s"] - scene["time_s"] == pytest.approx(0.11, abs=0.011)
    _, own = enabled(Plant)
    own.refused("sim.scene", "out_of_limits", "no bodies to draw; litegripd --simulate mujoco has")


def test_a_scene_is_taken_by_its_path_and_says_what_it_lacks(tmp_path: Path) -> None:
    parameters = SimulatorParameters()
    text = SCENE.read_text(encoding="utf-8")
    mine = tmp_path / "mine.xml"

    def refusal() -> str:
        with pytest.raises(ValueError, match=re.escape(str(mine))) as caught:
            named_mechanics(f"mujoco:{mine}", parameters)
        return str(caught.value)

    assert "cannot load" in refusal()
    mine.write_text(text.replace('"shaft"', '"axle"'), encoding="utf-8")
    assert "no joint 'shaft'" in refusal()
    assert "axle, cube, left, right" in refusal()
    mine.write_text(text.replace('type="hinge"', 'type="slide"'), encoding="utf-8")
    assert "no hinge" in refusal()
    mine.write_text(text.replace('name="start" qpos="-1.138736', 'name="start" qpos="-0.5'))
    assert named_mechanics(f"mujoco:{mine}", parameters).angle_rad == -0.5
    mine.write_text(text.replace('name="start"', 'name="other"'), encoding="utf-8")
    assert named_mechanics(f"mujoco:{mine}", parameters).angle_rad == 0.0
    for name in ("bullet", "mujoco:", "mujoco2"):
        with pytest.raises(ValueError, match="must be mujoco or mujoco:"):
            named_mechanics(name, parameters)


def test_a_scene_of_another_time_step_runs_alike(tmp_path: Path) -> None:
    text = SCENE.read_text(encoding="utf-8")
    mine = tmp_path / "mine.xml"
    mine.write_text(
        text.replace("<option ", '<option timestep="0.004" integrator="RK4" '), encoding="utf-8"
    )
    parameters = SimulatorParameters()
    usual, other = MujocoPlant(parameters), MujocoPlant(parameters, mine)
    for _ in range(2000):
        assert usual.step(0.6) == other.step(0.6)


def test_a_copy_of_a_plant_shares_no_state_with_it() -> None:
    plant = MujocoPlant(SimulatorParameters())
    other = copy.deepcopy(plant)
    for _ in range(400):
        other.step(0.5)
    assert other.angle_rad > plant.angle_rad == -1.138736
