"""A restart that holds, on real SocketCAN, where both daemons have a socket on the bus at once."""

import contextlib
import math
import os
import signal
from pathlib import Path
from typing import Any

from tests.vm.guest import (
    COMMANDS,
    DISABLE,
    ENABLE,
    TRIES,
    Rpc,
    check,
    daemon,
    reaches,
    simulator,
    stalls,
    witness,
)

CHANNEL = "vcan0"
OBJECT_MM, FORCE_N = 40.0, 8.0


def _holds(state: dict[str, Any]) -> bool:
    """True if the object is held by force."""
    return bool(state["enabled"] and state["is_grasped"] and state["force_set_n"] == FORCE_N)


def _grasp(rpc: Rpc) -> dict[str, Any]:
    """Let the jaws hold the object; return the state then."""
    rpc.insist("motion.grasp", force_n=FORCE_N, until="verdict")
    return rpc.state()


def _end(pid: int) -> bool:
    """End a daemon that is no child of ours; tell whether it has."""
    os.kill(pid, signal.SIGTERM)
    return reaches(lambda: not Path(f"/proc/{pid}").exists())


def restart_while_holding() -> None:
    """A successor takes over while an object is held; where it is too slow, the daemon goes on."""
    with (
        witness(CHANNEL) as bus,
        simulator(CHANNEL, "--object-mm", f"{OBJECT_MM:g}"),
        daemon(CHANNEL) as (first, rpc),
    ):
        reaches(lambda: bool(rpc.motor_is("disabled") and rpc.state()["calibrated"]))
        pid = int(rpc.call("hello")["pid"])
        before, sent, answer = {}, 0, {}
        for _ in range(TRIES):
            before, sent = _grasp(rpc), len(bus.data(COMMANDS))
            if not _holds(before):
                continue
            answer = rpc.call("daemon.restart", hold_through_restart=True)
            if "error" not in answer:
                break
            stalls.append("daemon.restart")
            check("a restart that fails leaves the old daemon", first.status is None)
        taken = answer.get("pid", pid) != pid
        check("a successor has taken over", taken, answer)
        if not taken:
            return
        gap = f"gap {1e3 * answer.get('gap_s', 0.0):.1f} ms"
        ended = reaches(lambda: first.status is not None)
        check("the old daemon has ended by itself", ended and first.status == 0, first.status)
        try:
            with contextlib.closing(Rpc(CHANNEL)) as after:
                _look(after, before)
                since = bus.data(COMMANDS)[sent:]
                quiet = ENABLE not in since and DISABLE not in since
                check("the motor was never disabled nor enabled", quiet, f"{len(since)}, {gap}")
                opened = after.insist("motion.open").get("ok") is True
                check("the new daemon moves the jaws", opened)
        finally:
            check("the new daemon ends", _end(int(answer["pid"])))
        check("the last command is disable", bus.data(COMMANDS)[-1:] == [DISABLE])


def restart_in_time() -> None:
    """The best of a few successors takes over within two periods; the machine delays the others."""
    with simulator(CHANNEL), daemon(CHANNEL) as (_, rpc):
        reaches(lambda: bool(rpc.motor_is("disabled") and rpc.state()["calibrated"]))
        period_s = 1.0 / rpc.call("hello")["limits"]["rate_hz"]
        gaps_s: list[float] = []
        successor: int | None = None
        while len(gaps_s) < TRIES and not (gaps_s and min(gaps_s) <= 2.0 * period_s):
            with contextlib.closing(Rpc(CHANNEL)) as asker:
                asker.insist("motor.enable")
                answer = asker.call("daemon.restart", hold_through_restart=True)
            successor = answer.get("pid", successor)
            gaps_s.append(answer.get("gap_s", math.inf))
        in_time = 0.0 < min(gaps_s) <= 2.0 * period_s
        told = ", ".join(f"{1e3 * gap_s:.1f} ms" for gap_s in gaps_s)
        check("a successor takes over within two periods", in_time, told)
        if successor is not None:
            check("the last of them ends", _end(successor))


def _look(rpc: Rpc, before: dict[str, Any]) -> None:
    state = rpc.state()
    check("the object is still held by force", _holds(state), state["mode"])
    moved_mm = abs(state["opening_mm"] - before["opening_mm"])
    check("the jaws have not moved", moved_mm < 1.0, f"{moved_mm:.2f} mm")
