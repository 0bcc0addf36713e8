"""What the daemon tells: where its calibration is from, and how it fares."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import pytest

from litegrip_client.values.terms import methods_in
from litegripd.app.build import motor_figures
from litegripd.app.config import Config
from litegripd.app.status import DaemonFacts
from litegripd.control.authority import QUIET_AFTER_S
from litegripd.io.helper.files import DATA
from litegripd.io.meters import RecentLateness
from litegripd.model.calibration import to_plain
from litegripd.model.errors import Refusal
from litegripd.model.motor import SIMULATOR, BusSettings, CanFrame
from tests.world import CAN_ID, World, enabled_world, found_world

MEASURED = {"zero_position_rad": 0.104334, "max_position_rad": -1.513123}
TOLD = {
    **dict.fromkeys(("file", "channel", "saved_s", "foreign", "work_stroke", "problem")),
    "nominal": False,
}
"""Of a calibration of which nothing else is known."""


def info(world: World) -> Any:
    return facts(world).info()


NO_DISKS = SimpleNamespace(full=[], nearly_full=[])
OWN = Config("can0", BusSettings("socketcan", "can0", 1_000_000))


def facts(world: World, config: Config = OWN) -> DaemonFacts:
    return DaemonFacts(config, world.machine)


def verdict(
    world: World, *, helper_runs: bool = True, late_s: float = 0.0
) -> tuple[str, list[str]]:
    """Return the verdict of a daemon with these parts, whose latest tick was late, and why."""
    return judged(world, helper_runs=helper_runs, late_s=late_s).verdict()


def judged(
    world: World,
    *,
    helper_runs: bool = True,
    late_s: float = 0.0,
    config: Config = OWN,
    figures: Callable[[float, Any], Mapping[str, Any]] | None = None,
    not_granted: Sequence[str] = (),
) -> DaemonFacts:
    """Return the facts of a daemon with these parts, whose latest tick was late."""
    made = facts(world, config)
    parts = parts_of(world, helper_runs=helper_runs, late_s=late_s, figures=figures)
    parts.rights.refused = not_granted
    made.attach(parts)
    return made


def parts_of(
    world: World,
    *,
    helper_runs: bool = True,
    late_s: float = 0.0,
    disks: object = NO_DISKS,
    figures: Callable[[float, Any], Mapping[str, Any]] | None = None,
) -> Any:
    """Return parts of a daemon with which all else is well."""
    lateness = RecentLateness(30.0)
    lateness.add(0.0, late_s)
    return SimpleNamespace(
        condition=world.condition,
        rights=SimpleNamespace(refused=()),
        disks=disks,
        spawner=SimpleNamespace(is_running=True),
        helper=SimpleNamespace(
            is_running=helper_runs, log_is_stuck=False, lately_refused=lambda _now_s: None
        ),
        links=SimpleNamespace(status=None),
        reactor=SimpleNamespace(
            recent_lateness=lateness, period_s=1.0, tick_errors=0, backlog_errors=0
        ),
        figures=figures,
    )


def test_whether_a_second_master_is_at_it_just_now_is_a_figure() -> None:
    world = World()
    world.enabled()
    assert motor_figures(world.machine)["foreign_active"] is False
    world.inject(CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF")))
    world.run(0.1)
    figures = motor_figures(world.machine)
    assert (figures["foreign_commands"], figures["foreign_active"]) == (1, True)
    world.run(QUIET_AFTER_S)
    figures = motor_figures(world.machine)
    assert (figures["foreign_commands"], figures["foreign_active"]) == (1, False)


@pytest.mark.parametrize("by_rad", [2.0 * math.pi, -2.0 * math.pi])
def test_a_position_far_outside_the_travel_is_told_as_it_is_refused(by_rad: float) -> None:
    world, client = enabled_world()
    assert client.result("motion.move", opening_mm=60)["ok"]
    client.result("motor.disable")
    assert verdict(world) == ("ok", [])
    world.gripper.jump(by_rad)
    world.run(0.2)
    client.result("motor.enable")
    error = client.call("motion.move", opening_mm=60)["error"]
    assert error["data"]["reason"] == "out_of_limits"
    assert verdict(world) == ("degraded", [error["message"]])
    assert error["data"]["hint"].startswith("power-cycle the motor")
    assert error["message"].endswith(error["data"]["hint"])
    assert client.result("calibration.zero", mount="normal")["ok"]
    assert verdict(world) == ("ok", [])
    assert client.result("motion.move", opening_mm=60)["ok"]


def test_a_coil_that_was_hot_is_not_called_so_for_ever() -> None:
    world, _ = enabled_world()
    heat = world.controller.output.heat
    heat.allowance_nm, heat._top_nm, heat._changed_s = 2.63, 3.0, world.controller.now_s
    heat.model.coil_c = 78.0
    limited = "holds are limited to 2.63 N·m"
    assert verdict(world) == ("degraded", [f"the coil is hot: {limited}"])
    heat.model.coil_c = 36.6
    told = f"the coil was hot, it has cooled to 37 °C: {limited} for 40 s more"
    assert verdict(world) == ("degraded", [told])


def test_a_standstill_is_named_with_how_long_it_lasted() -> None:
    world = World().start()
    assert verdict(world, late_s=0.099) == ("ok", [])
    told = ["the daemon itself stood still for 312 ms in the last minute"]
    assert verdict(world, late_s=0.312) == ("degraded", told)


def test_rights_that_a_real_motor_needs_are_no_fault_of_a_simulators_daemon() -> None:
    world, refused = World().start(), ("SCHED_FIFO 50: Operation not permitted",)
    real = judged(world, not_granted=refused)
    text = "not granted: SCHED_FIFO 50: Operation not permitted"
    assert (real.verdict(), real.notes()) == (("degraded", [text]), [])
    simulated = replace(OWN, bus=replace(OWN.bus, interface=SIMULATOR))
    facts = judged(world, config=simulated, not_granted=refused)
    assert facts.verdict() == ("ok", [])
    assert facts.notes() == [f"{text}; a simulated gripper does without"]


def test_a_template_is_nominal_and_has_no_date_and_is_so_when_it_is_saved() -> None:
    world, client = found_world()
    client.result("calibration.load", template="reverse")
    told = info(world)["calibration"]
    assert told == {**TOLD, "file": str(DATA / "reverse.json"), "nominal": True}
    client.result("calibration.save")  # it was still measured on no gripper
    told = info(world)["calibration"]
    assert (told["file"], told["nominal"]) == ("/state/calibration.save", True)


def test_why_a_file_that_is_there_is_not_used_is_a_fact_and_that_there_is_none_is_not() -> None:
    world = World(calibrated=False)
    assert info(world)["calibration"]["problem"] is None
    refusal = Refusal("calibration_unreadable", "no calibration: /c.json: Permission denied")
    world.controller.use_calibration(None, refusal)
    assert info(world)["calibration"]["problem"] == refusal.message


def test_a_content_of_a_client_is_in_no_file_until_it_is_saved() -> None:
    world, client = found_world()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content={**content, **MEASURED, "channel": "can7"})
    told = info(world)["calibration"]
    assert methods_in(told, "foreign") == {"calibration.zero"}
    foreign, _terms = told.pop("foreign"), told.pop("terms")
    assert "it has channel 'can7', and this is can0" in foreign
    assert {**told, "foreign": None} == {**TOLD, "channel": "can7"}
    client.result("calibration.save")
    file = "/state/calibration.save"
    saved = {"file": file, "channel": "can0", "saved_s": 1.6e9}
    assert info(world)["calibration"] == {**TOLD, **saved}
    assert client.result("calibration.get")["file"] == file


def test_another_calibration_than_the_saved_one_does_not_take_its_file() -> None:
    world, client = found_world()
    content = client.result("calibration.get")["content"]
    client.result("calibration.load", content=content)
    saving = client.send("calibration.save")
    client.result("calibration.load", content=content)
    assert client.wait(saving)["result"]["path"] == "/state/calibration.save"
    assert info(world)["calibration"]["file"] is None


def test_a_measured_calibration_has_the_date_of_its_file() -> None:
    world, client = enabled_world()
    assert client.result("calibration.zero")["ok"]
    told = info(world)["calibration"]
    assert (told["nominal"], told["channel"], told["saved_s"]) == (False, "can0", 1.6e9)
    assert client.result("calibration.zero", save=False)["ok"]
    told = info(world)["calibration"]
    assert (told["file"], told["saved_s"]) == (None, None)


def test_a_found_file_keeps_its_date() -> None:
    world, client = found_world()
    calibration = world.machine.controller.calibrated.calibration
    assert calibration is not None
    plain = {**to_plain(calibration), "saved_s": 1.5e9}
    found = {"path": "/x.json", "skipped": [], "factory": False, "calibration": plain}
    world.disk.found = found
    client.result("calibration.load")
    assert info(world)["calibration"]["saved_s"] == 1.5e9
    assert info(world)["configuration"]["rpc"] == {"group": "litegrip"}


@pytest.mark.parametrize("is_tolerated", [False, True])
def test_a_second_master_that_is_tolerated_only_degrades(is_tolerated: bool) -> None:
    world = World()
    world.controller.second_master.is_tolerated = is_tolerated
    client = world.enabled()
    assert verdict(world) == ("ok", [])
    world.inject(CanFrame(CAN_ID, bytes.fromhex("79DA7FF3336667FF")))
    world.tick()
    told, (reason,) = verdict(world)
    assert told == ("degraded" if is_tolerated else "down")
    assert reason.startswith("another program commands the motor (1 frames so far)")
    assert ("tolerate" in reason) is is_tolerated
    assert ("result" in client.call("motion.hold")) is is_tolerated


def test_a_motor_that_makes_less_than_is_commanded_degrades_the_gripper() -> None:
    world, client = enabled_world()
    world.gripper.put_object(width_mm=50.0)
    client.result("motion.grasp", force_n=20.0, until="verdict")
    world.run(1.0)
    assert verdict(world) == ("ok", [])
    world.gripper.weaken(0.15)
    world.run(0.5)
    level, (reason,) = verdict(world)
    assert level == "degraded"
    assert "makes 0.30 N·m of the commanded 2.0" in reason
    world.gripper.weaken(1.0)
    world.run(0.5)
    assert verdict(world) == ("ok", [])


def test_a_helper_that_is_gone_is_told_to_be_started_again() -> None:
    told, reasons = verdict(World().start(), helper_runs=False)
    assert told == "degraded"
    assert reasons == ["the helper process is not running; it is being started again"]
