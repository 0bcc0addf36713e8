"""The page on the configuration names the simulator's keys, and only such as a file can have."""

import inspect

from docs.configuration_page import SIMULATOR
from litegripd.motor.identity import LONGEST_WATCHDOG_S, WATCHDOG_S
from litegripd.sim.interface import SimulatedBus

NOT_OF_A_FILE = {"gripper", "monotonic_fn", "receive_own_messages", "bitrate"}


def test_the_keys_of_the_simulator_are_those_that_it_takes() -> None:
    params = inspect.signature(SimulatedBus.__init__).parameters.values()
    taken = {param.name for param in params if param.kind is param.KEYWORD_ONLY}
    assert taken - NOT_OF_A_FILE == set(SIMULATOR)
    assert f"at most {LONGEST_WATCHDOG_S:g}:" in SIMULATOR["watchdog_s"]
    assert f"back to {WATCHDOG_S:g} when" in SIMULATOR["watchdog_s"]
