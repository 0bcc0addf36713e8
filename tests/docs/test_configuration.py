"""The page on the configuration names the simulator's keys, and what the daemon makes of them."""

import inspect

from litegripd.motor.identity import LONGEST_WATCHDOG_S, WATCHDOG_S
from litegripd.sim.gripper import OPTIONS, build_gripper

NOT_OF_A_FILE = {"can_id", "master_id"}
"""`[motor]` has the ids; the simulated motor of a daemon keeps those from the factory."""


def test_the_keys_of_the_simulator_are_those_that_it_takes() -> None:
    taken = inspect.signature(build_gripper).parameters.keys()
    meanings = {option.name: option.meaning for option in OPTIONS}
    assert taken - NOT_OF_A_FILE == set(meanings)
    assert f"at most {LONGEST_WATCHDOG_S:g}:" in meanings["watchdog_s"]
    assert f"back to {WATCHDOG_S:g} when" in meanings["watchdog_s"]
