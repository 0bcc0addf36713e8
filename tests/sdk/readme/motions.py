"""Everything of the client that moves the jaws, by name."""

from collections.abc import Callable

from litegrip_client import LiteGrip

MOTIONS: dict[str, Callable[[LiteGrip], object]] = {
    "open": lambda gripper: gripper.open(),
    "close": lambda gripper: gripper.close(),
    "grasp": lambda gripper: gripper.grasp(hold_s=1.0),
    "goto": lambda gripper: gripper.goto(50.0),
    "goto_rad": lambda gripper: gripper.goto_rad(-0.5),
    "goto_openness": lambda gripper: gripper.goto_openness(0.5),
    "move_at_speed": lambda gripper: gripper.move_at_speed(50.0, 20.0),
    "set_force": lambda gripper: gripper.set_force(5.0),
    "zero": lambda gripper: gripper.zero(),
}
