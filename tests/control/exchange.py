"""Puts a successor in the place of a world's machine, as a restart of the daemon does."""

import json
from typing import Any

from litegripd.app.build import build_service
from litegripd.app.machine import Machine
from litegripd.handover import state as handover
from litegripd.model.motion_config import MotionConfig
from tests.world import PERIOD_S, FixedFacts, World


def exported(world: World) -> dict[str, Any]:
    """Return all that is handed over, as it arrives."""
    return {
        "state": through_json(handover.export(world.machine, world.service)),
        "history": through_json(handover.export_history(world.machine, world.service)),
    }


def through_json(plain: Any) -> Any:
    return json.loads(json.dumps(plain))


def exchange(world: World, early: Any = None) -> dict[str, Any]:
    """Exchange the machine between two ticks; return what was handed over.

    `early` is a state that the successor adopts before, as it does while it prepares.
    """
    assert handover.why_not_restartable(world.machine) is None
    plain = exported(world)
    machine = Machine(world.controller.gripper_id, None, MotionConfig(), PERIOD_S)
    service = build_service(machine.controller, FixedFacts(), PERIOD_S)
    if early is not None:
        handover.adopt(machine, service, early)
    handover.adopt(machine, service, plain["state"], early)
    handover.adopt_history(machine, service, plain["history"])
    world.machine, world.controller, world.service = machine, machine.controller, service
    world.recorder = world.make_recorder()
    return plain
