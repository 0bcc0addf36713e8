"""The checks that need a kernel with SocketCAN; run as root in the virtual machine.

The machine is emulated and stalls: nothing here is about timing, and every limit is generous.
"""

import sys
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

from damiao_motor import DaMiaoController

from tests.vm.failing import FAILING
from tests.vm.guest import (
    COMMANDS,
    DISABLE,
    ENABLE,
    FEEDBACK,
    LIMIT_S,
    REGISTERS,
    TRIES,
    Rpc,
    check,
    daemon,
    figures,
    ip,
    pause,
    play,
    reaches,
    reasons,
    simulator,
    stalls,
    witness,
)
from tests.vm.restarting import restart_in_time, restart_while_holding

TWO_ATTEMPTS_S = 12.0  # to open a bus: the daemon tries every 5 s at least


def check_motions(rpc: Rpc, where: str) -> None:
    """Enable, open, close, disable, each with its result."""
    enabled = rpc.insist("motor.enable")
    tries = f"tries {enabled.get('tries')}"
    check(f"{where}: enable", enabled.get("ok") is True, enabled.get("error", tries))
    for motion, opening_mm, outcome in (("open", 80.0, "reached"), ("close", 0.0, "pressed_home")):
        result = rpc.insist(f"motion.{motion}")
        ok = result.get("ok") is True and result.get("outcome") == outcome
        seen = result.get("error", result.get("outcome"))
        check(f"{where}: {motion} ends {outcome}", ok, seen)
        seen = result.get("state", {}).get("opening_mm")
        near = seen is not None and abs(seen - opening_mm) < 10.0
        check(f"{where}: {motion} arrives at about {opening_mm:g} mm", near, f"{seen} mm")
    disabled = rpc.call("motor.disable")
    ok = disabled.get("ok") is True and rpc.motor_is("disabled")
    check(f"{where}: disable is confirmed", ok, disabled.get("error", ""))


def vcan_works() -> None:
    """Daemon and simulator on vcan0, and what candump sees of it."""
    with witness("vcan0") as bus, simulator("vcan0"), daemon("vcan0") as (_, rpc):
        hello = rpc.call("hello", client="vm-test")
        known = hello.get("daemon") == "litegripd" and hello.get("channel") == "vcan0"
        check("hello", known and hello.get("simulated") is False, f"version {hello.get('version')}")
        check("the motor is found and disabled", reaches(partial(rpc.motor_is, "disabled")))
        identity = rpc.call("info.get")["motor"]
        check("its answers' id is read from MST_ID", identity["master_id"] == 0x18, identity)
        calibrated = reaches(lambda: bool(rpc.state()["calibrated"]))
        check("the calibration of mount normal is loaded", calibrated)
        health = rpc.call("health")
        up = health["verdict"] != "down" and health["bus"]["state"] == "up"
        check("health says that it works", up, f"{health['verdict']} {health['reasons']}")

        before = bus.frames()
        ids = [can_id for can_id, _ in before]
        check("the first frame asks for a register", ids[:1] == [REGISTERS], before[:1])
        check("nothing goes to the motor's own id before enable", COMMANDS not in ids, set(ids))
        check_motions(rpc, "vcan0")
        commands = bus.data(COMMANDS)
        check("one enable frame or more was sent", ENABLE in commands, commands.count(ENABLE))
        check("the last command is disable", commands[-1:] == [DISABLE], commands[-1:])
        used = {can_id for can_id, _ in bus.frames()}
        check("no other id was used", used == {REGISTERS, COMMANDS, FEEDBACK}, used)
        print("      " + figures(rpc), flush=True)


def start_opening(rpc: Rpc) -> dict[str, Any]:
    """Close, begin to open slowly, and return the state once the jaws are under way."""
    state = rpc.state()
    for _ in range(TRIES):
        rpc.insist("motion.close")
        rpc.call("motion.open", speed_mm_s=10.0, wait=False)
        while (state := rpc.state())["mode"] == "moving":
            if state["opening_mm"] > 5.0:
                return state
            pause.wait(0.05)
        stalls.append("motion.open")
    return state


def sigterm_while_moving() -> None:
    """The daemon's end disables a motor that moves."""
    with witness("vcan0") as bus, simulator("vcan0"), daemon("vcan0") as (program, rpc):
        reaches(partial(rpc.motor_is, "disabled"))
        reaches(lambda: bool(rpc.state()["calibrated"]))
        state = start_opening(rpc)
        status = program.end()
        check("the jaws moved", state["mode"] == "moving", f"{state['opening_mm']} mm")
        cut_short = program.said("open failed: the daemon is about to end")
        check("and SIGTERM came while they did", cut_short)
        check("SIGTERM while moving: exit status 0", status == 0, status)
        commands = bus.data(COMMANDS)
        check("the last command is disable", commands[-1:] == [DISABLE], commands[-1:])
        others = [data for data in commands if data != DISABLE]
        first = commands.index(DISABLE) if DISABLE in commands else -1
        check("no command follows the first disable", first == len(others), len(commands) - first)
        feedback = bus.data(FEEDBACK)
        check("the motor's last answer says disabled", feedback[-1][0] == "0", feedback[-1:])
        check("the socket is gone", not Path("/run/litegripd/vcan0.sock").exists())


def other_driver() -> None:
    """A driver that others wrote works the simulator on vcan0."""
    with simulator("vcan0"):
        controller = DaMiaoController(channel="vcan0", bustype="socketcan")
        try:
            motor = controller.add_motor(motor_id=0x08, feedback_id=0x18, motor_type="4310")
            read = {number: motor.get_register(number, timeout=LIMIT_S) for number in (7, 8, 21)}
            check("damiao-motor: registers", read == {7: 0x18, 8: 0x08, 21: 12.5}, read)
            motor.set_can_timeout(20_000)  # the motor's 100 ms are too short for this machine
            motor.get_register(9, timeout=LIMIT_S)

            def status(send: Callable[[], None]) -> str:
                before = motor.state
                send()
                reaches(lambda: motor.state is not before)
                return str(motor.get_states().get("status"))

            ask = motor.request_motor_feedback
            check("damiao-motor: feedback, disabled", reaches(lambda: status(ask) == "DISABLED"))
            start_rad = motor.get_states()["pos"]
            motor.set_zero_command()
            enabled = reaches(lambda: status(motor.enable) == "ENABLED")
            check("damiao-motor: enable", enabled, motor.get_states().get("status"))
            target_rad = start_rad + 0.3

            def arrives() -> bool:
                status(
                    partial(
                        motor.send_cmd_mit,
                        target_position=target_rad,
                        stiffness=30.0,
                        damping=1.5,
                    )
                )
                return bool(abs(motor.get_states()["pos"] - target_rad) < 0.03)

            arrived = reaches(arrives)
            detail = f"{start_rad:.3f} to {motor.get_states()['pos']:.3f} rad"
            check("damiao-motor: MIT command moves the jaws", arrived, detail)
            motor.disable()
            check("damiao-motor: disable", reaches(lambda: status(ask) == "DISABLED"))
        finally:
            controller.shutdown()


def cards_work() -> None:
    """Two emulated CAN cards on one bus; one of them goes down and comes back."""
    with witness("can0") as bus, simulator("can1"), daemon("can0") as (_, rpc):
        found = reaches(partial(rpc.motor_is, "disabled"))
        check("can0: the motor on can1 is found", found, reasons(rpc))
        reaches(lambda: bool(rpc.state()["calibrated"]))
        check_motions(rpc, "can0")
        print("      " + figures(rpc), flush=True)
        sent = len(bus.data(COMMANDS))
        ip("link set can0 down")
        down = reaches(partial(rpc.bus_is, "link_down")) and reaches(
            partial(rpc.motor_is, "silent")
        )
        check("can0 down is noticed", down, reasons(rpc))
        ip("link set can0 up")
        found = reaches(partial(rpc.motor_is, "disabled")) and reaches(partial(rpc.bus_is, "up"))
        check("can0 up again: bus and motor recover", found, reasons(rpc))
        check("and nothing energised the motor", ENABLE not in bus.data(COMMANDS)[sent:])
        check_motions(rpc, "can0 again")


def channel_comes_later() -> None:
    """A daemon without its interface stays, says why, and works once there is one."""
    with daemon("vcan9") as (program, rpc):
        rests = reaches(lambda: rpc.call("health")["verdict"] == "degraded")
        check("vcan9 missing: health is degraded while nobody needs it", rests)
        check("and says why", "No such device" in reasons(rpc), reasons(rpc))
        answer = rpc.call("motor.enable")
        refused = (answer.get("error") or {}).get("data", {}).get("reason")
        check("enable is refused", refused is not None, answer.get("error"))
        down = reaches(lambda: rpc.call("health")["verdict"] == "down")
        check("then health is down", down)
        descriptors = Path(f"/proc/{rpc.call('hello')['pid']}/fd")
        count, began_s = len(list(descriptors.iterdir())), rpc.call("health")["uptime_s"]
        reaches(lambda: bool(rpc.call("health")["uptime_s"] >= began_s + TWO_ATTEMPTS_S))
        more = len(list(descriptors.iterdir())) - count
        check("trying again and again leaves no descriptor open", more <= 0, more)
        ip("link add dev vcan9 type vcan")
        said = reaches(lambda: "Network is down" in reasons(rpc))
        check("vcan9 added, not set up: health says so", said, reasons(rpc))
        for what in ("set up", "removed, added again"):
            if what != "set up":
                ip("link delete vcan9")
                gone = reaches(partial(rpc.bus_is, "adapter_gone"))
                check("vcan9 removed: noticed", gone, reasons(rpc))
                ip("link add dev vcan9 type vcan")
            ip("link set vcan9 up")
            with simulator("vcan9"):
                found = reaches(partial(rpc.motor_is, "disabled"))
                check(f"vcan9 {what}: the motor is found", found, reasons(rpc))
                check(f"vcan9 {what}: the bus is up", reaches(partial(rpc.bus_is, "up")))
        check("the daemon never ended", program.status is None)
        check("SIGTERM: exit status 0", program.end() == 0, program.status)


def link_down_and_up() -> None:
    """vcan0 goes down and up while the motor is disabled."""
    with daemon("vcan0") as (program, rpc):
        with simulator("vcan0"):
            check("vcan0: motor found", reaches(partial(rpc.motor_is, "disabled")))
            ip("link set vcan0 down")
            down = reaches(partial(rpc.bus_is, "link_down"))
            check("vcan0 down: noticed", down, reasons(rpc))
            silent = reaches(partial(rpc.motor_is, "silent"))
            check("vcan0 down: the motor is called silent", silent, rpc.state()["motor"])
            ip("link set vcan0 up")
        up = reaches(partial(rpc.bus_is, "motor_silent"), limit_s=10.0)
        check("vcan0 up, motor off: the motor is silent", up, reasons(rpc))
        with simulator("vcan0"):
            check("vcan0 up, motor on: found", reaches(partial(rpc.motor_is, "disabled")))
            enabled = rpc.call("motor.enable")
            check("and it can be enabled", enabled.get("ok") is True, enabled.get("error", ""))
            rpc.call("motor.disable")
        check("SIGTERM: exit status 0", program.end() == 0, program.status)


SCENES = (
    vcan_works,
    other_driver,
    cards_work,
    channel_comes_later,
    link_down_and_up,
    sigterm_while_moving,
    *FAILING,
    restart_while_holding,
    restart_in_time,
)


def main() -> int:
    """Run every scene, or those that are named; return 0 when every check passed."""
    names = sys.argv[1:]
    return play([scene for scene in SCENES if not names or scene.__name__ in names])


if __name__ == "__main__":
    sys.exit(main())
