"""A driver that others wrote, `damiao-motor`, works the simulated motor over the terminal.

Its controller has no argument for slcan's settling time of 2 s; python-can reads such options from
the environment, so that the controller is used exactly as its users do.
"""

import json
import threading
import time
import warnings
from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import pytest
from damiao_motor import DaMiaoController, DaMiaoMotor

from tests.sim.simulator_process import DEADLINE_S, simulator


@pytest.fixture
def controller(monkeypatch: pytest.MonkeyPatch) -> Iterator[DaMiaoController]:
    options = {"sleep_after_open": 0, "bitrate": 1_000_000}
    monkeypatch.setenv("CAN_CONFIG", json.dumps(options))
    with simulator("--pty") as process:
        with warnings.catch_warnings():
            # It names the interface `bustype`, which python-can 4 deprecates.
            warnings.simplefilter("ignore", DeprecationWarning)
            made = DaMiaoController(channel=process.first_line, bustype="slcan")
        try:
            yield made
        finally:
            made.shutdown()


def wait_for(is_true: Callable[[], bool]) -> None:
    """Look until it is true, and let the driver's reading thread run in between."""
    deadline_s = time.monotonic() + DEADLINE_S
    pause = threading.Event()
    while not is_true():
        assert time.monotonic() < deadline_s
        pause.wait(0.001)


def answered(motor: DaMiaoMotor, send: Callable[[], None]) -> dict[str, Any]:
    """Send and wait for some feedback: the driver reads more slowly than it can send.

    It may be the answer to an earlier frame, for the driver enables a disabled motor by itself
    before it commands it. So states are waited for, never taken from the first answer.
    """
    before = motor.state
    send()
    wait_for(lambda: motor.state is not before)
    return dict(motor.get_states())


def test_it_reads_registers_moves_the_jaws_and_lets_go(controller: DaMiaoController) -> None:
    motor = controller.add_motor(motor_id=0x08, feedback_id=0x18, motor_type="4310")
    assert motor.get_register(8) == 0x08
    assert motor.get_register(7) == 0x18
    assert motor.get_register(21) == 12.5
    assert motor.get_register(22) == 30.0
    assert motor.get_register(23) == 10.0
    motor.ensure_control_mode("MIT")
    motor.set_can_timeout(20_000)  # a busy machine may be slower than the motor's 100 ms
    # The driver takes the answer to a write for feedback from -12.2 rad: read on past it.
    assert motor.get_register(9) == 400_000
    ask = motor.request_motor_feedback
    state = answered(motor, ask)
    assert state["status"] == "DISABLED"
    target_rad = state["pos"] + 0.3
    move = partial(motor.send_cmd_mit, target_position=target_rad, stiffness=30.0, damping=1.5)

    answered(motor, motor.set_zero_command)
    wait_for(lambda: answered(motor, motor.enable)["status"] == "ENABLED")
    for _ in range(500):
        state = answered(motor, move)
        assert state["status"] == "ENABLED"
        if abs(state["pos"] - target_rad) < 0.02 and abs(state["vel"]) < 0.05:
            break
    assert state["pos"] == pytest.approx(target_rad, abs=0.02)
    assert state["t_rotor"] == 25.0

    motor.disable()
    wait_for(lambda: answered(motor, ask)["status"] == "DISABLED")


def test_it_sees_the_watchdog_and_clears_it(controller: DaMiaoController) -> None:
    motor = controller.add_motor(motor_id=0x08, feedback_id=0x18, motor_type="4310")
    motor.set_can_timeout(20)
    assert motor.get_register(9) == 400
    answered(motor, motor.enable)
    ask = motor.request_motor_feedback
    wait_for(lambda: answered(motor, ask)["status"] == "LOST_COMM")
    motor.clear_error()
    wait_for(lambda: answered(motor, ask)["status"] == "DISABLED")
