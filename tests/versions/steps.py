"""What a program asks of a gripper, call by call; any version of the client can run it.

Each step names only what its call needs: what else is sent, the client sends by itself. A step may
be run again, and begins with an enabled, calibrated gripper whose jaws are free. So this module
imports the client alone, and nothing of the tests.

    python tests/versions/steps.py SOCKET    all that standard input names, at a real daemon
"""

from __future__ import annotations

import asyncio
import contextlib
import inspect
import io
import json
import os
import sys
import time
from collections.abc import Callable, Collection, Mapping
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import litegrip_client
from litegrip_client import (
    BusyError,
    CalibrationData,
    CancelledError,
    LiteGrip,
    LiteGripError,
    Trajectory,
    TrajectorySample,
    aio,
)
from litegrip_client.ctl import main as ctl

Step = Callable[[LiteGrip], object]

BUSY = (
    *("motor_silent", "motor_fault", "not_enabled", "not_confirmed", "bus_down"),
    *("no_answer", "set_point_expired", "recording_failed"),
)
"""What a busy machine brings about, that stops a daemon or a program for longer than they bear."""
DEADLINE_S = 60.0
PATH = Trajectory(
    [TrajectorySample(0.02 * i, 0.6 + 0.005 * i, 0.0, 0.0, 0.0) for i in range(20)],
    *(50.0, 0.0, 0.114, -1.491, 74.8),
)


def states(gripper: LiteGrip) -> None:
    with gripper.states(50) as whole:
        assert all(state.calibrated for state in islice(whole, 3))


def cancel(gripper: LiteGrip) -> None:
    """Cancel a motion from its own report, as any other place of a program may."""
    asked: list[bool] = []

    def report(_progress: object) -> None:
        if not asked:
            asked.append(gripper.cancel())

    with contextlib.suppress(CancelledError):
        gripper.open(progress=report)
        raise AssertionError("it was not cancelled")
    assert asked == [True]


def latest(gripper: LiteGrip) -> None:
    with gripper.latest(50) as newest:
        assert newest.wait_newer(DEADLINE_S).calibrated
        assert newest.age_s < DEADLINE_S


def states_in_batches(gripper: LiteGrip) -> None:
    with gripper.states(100, batch=4) as whole:
        assert all(state.calibrated for state in islice(whole, 6))


def states_of_fields(gripper: LiteGrip) -> None:
    with gripper.states(100, ["mode", "opening_mm"], batch=2) as some:
        assert [set(state) for state in islice(some, 3)] == [{"mode", "opening_mm"}] * 3


def events(gripper: LiteGrip) -> None:
    with gripper.events() as all_kinds:
        gripper.goto(40.0)
        kinds = (event.kind for event in all_kinds)
        assert next(kind for kind in kinds if kind == "job_ended")


def events_of_a_kind(gripper: LiteGrip) -> None:
    with gripper.events(["job_ended"]) as ended:
        gripper.goto(40.0)
        assert next(ended).kind == "job_ended"


def stream(gripper: LiteGrip) -> None:
    with gripper.stream() as targets:
        for opening_mm in (50.0, 49.0, 48.0):
            targets.set_target(opening_mm)


def frames(gripper: LiteGrip) -> None:
    closed_rad = gripper.config.pos_closed_rad
    open_rad = gripper.config.pos_open_rad
    assert closed_rad is not None
    assert open_rad is not None
    for _ in range(3):
        assert gripper.send_mit_frame((closed_rad + open_rad) / 2.0, 50.0, 1.0)
    gripper.hold()


def lease(gripper: LiteGrip) -> None:
    with gripper.lease() as held:
        assert held.token
        held.renew()


def take_lease(gripper: LiteGrip) -> None:
    gripper.take_lease("to see")
    gripper.disable()  # the motor was enabled under the lease before
    assert gripper.enable()


def stop(gripper: LiteGrip) -> None:
    gripper.stop()
    gripper.hold()


def software_stop(gripper: LiteGrip) -> None:
    stopped = gripper.software_stop().stop
    assert stopped is not None
    assert stopped["level"] == "hold"
    assert gripper.clear_stop().stop is None


def calibrations(gripper: LiteGrip) -> None:
    assert gripper.load_template("normal")
    assert gripper.load_calibration()
    assert gripper.mount == "normal"
    assert gripper.use_calibration(CalibrationData())
    assert gripper.rescale_calibration().rad_to_mm > 0.0
    assert gripper.save_calibration()


def by_hand(gripper: LiteGrip) -> None:
    with gripper.manual_calibration() as manual, gripper.states(50) as looks:
        for _ in looks:
            with contextlib.suppress(BusyError):  # the jaws are not loose yet
                manual.mark_closed()
                break


def set_zero(gripper: LiteGrip) -> None:
    assert gripper.set_zero()
    assert gripper.load_template("normal")
    assert gripper.enable()
    assert gripper.zero(progress=lambda _report: None).calibrated


def record(gripper: LiteGrip) -> None:
    assert len(gripper.record(0.1)) > 0
    gripper.record_start()
    assert gripper.trajectory_status()["active"]
    assert gripper.record_stop(allow_empty=True) is not None


def play(gripper: LiteGrip) -> None:
    assert gripper.play(PATH)


def play_in_the_background(gripper: LiteGrip) -> None:
    gripper.play_start(PATH, loop=True)
    gripper.play_pause()
    gripper.play_resume()
    gripper.play_speed(0.5)
    gripper.play_stop(20.0)


def kept(gripper: LiteGrip) -> None:
    gripper.keep_trajectory("pick", PATH)
    assert "pick" in [row["name"] for row in gripper.kept_trajectories()]
    assert len(gripper.fetch_trajectory("pick")) == len(PATH)
    gripper.delete_trajectory("pick")


def follow(gripper: LiteGrip) -> None:
    assert gripper.teleop_start("slave", fake_leader=True)["active"]
    assert gripper.teleop_status()["mode"] == "slave"
    assert not gripper.teleop_stop(20.0)["active"]


def again(gripper: LiteGrip) -> None:
    assert gripper.disable()
    assert gripper.enable()


def connect(gripper: LiteGrip) -> None:
    own = LiteGrip(gripper.channel, socket_path=os.environ.get("LITEGRIPD_SOCKET"))
    own.connect()
    assert own.is_connected
    own.disconnect()


STEPS: Mapping[str, Step] = {
    "connect disconnect": connect,
    "get_state": lambda gripper: gripper.get_state(),
    "health": lambda gripper: gripper.health()["verdict"],
    "info": lambda gripper: gripper.info()["registers"],
    "jobs": lambda gripper: gripper.jobs(),
    "config": lambda gripper: gripper.config,
    "mount": lambda gripper: gripper.mount,
    "read_param": lambda gripper: gripper.read_param("PMAX"),
    "cancel": cancel,
    "latest": latest,
    "states": states,
    "states in batches": states_in_batches,
    "states of fields": states_of_fields,
    "events": events,
    "events of a kind": events_of_a_kind,
    "disable enable": again,
    "clear_fault": lambda gripper: gripper.clear_fault(),
    "open": lambda gripper: gripper.open(),
    "close": lambda gripper: gripper.close(),
    "goto": lambda gripper: gripper.goto(40.0),
    "goto_rad": lambda gripper: gripper.goto_rad(gripper.get_position_rad()),
    "move_to": lambda gripper: gripper.move_to(gripper.get_position_rad()),
    "goto_openness": lambda gripper: gripper.goto_openness(0.5),
    "move_at_speed": lambda gripper: gripper.move_at_speed(60.0),
    "grasp": lambda gripper: gripper.grasp(hold_s=0.1),
    "grasp until the verdict": lambda gripper: gripper.grasp(until="verdict"),
    "set_force": lambda gripper: gripper.set_force(3.0),
    "zero_gravity hold": lambda gripper: (gripper.zero_gravity(), gripper.hold()),
    "stream": stream,
    "send_mit_frame": frames,
    "lease": lease,
    "take_lease": take_lease,
    "stop": stop,
    "software_stop clear_stop": software_stop,
    "load_template load_calibration use_calibration rescale_calibration save_calibration": (
        calibrations
    ),
    "manual_calibration": by_hand,
    "calibrate": lambda gripper: gripper.calibrate(progress=lambda _report: None),
    "set_zero zero": set_zero,
    "record record_start record_stop trajectory_status": record,
    "play": play,
    "play_start play_pause play_resume play_speed play_stop": play_in_the_background,
    "keep_trajectory kept_trajectories fetch_trajectory delete_trajectory": kept,
    "teleop_start teleop_status teleop_stop": follow,
    "dump": lambda gripper: gripper.dump(),
}
"""By the calls that a step is about."""


LONG = ("calibrate", "set_zero zero")
"""Both stops are probed, for which a quarter of a minute goes by."""


def uncovered() -> set[str]:
    """Return the calls of this version's client that no step is about."""
    named = {word for name in STEPS for word in name.split()}
    from litegrip_client.core.gripper import Gripper  # noqa: PLC0415 - of newer clients only

    calls = inspect.getmembers(Gripper, inspect.isfunction)
    own = {name for name, _ in calls if not name.startswith("_")}
    return own - named


def ready(gripper: LiteGrip) -> None:
    """Bring the gripper to where a step begins."""
    if gripper.get_state().stop is not None:
        gripper.clear_stop()
    if not gripper.get_state().calibrated:
        gripper.load_template("normal")
    if gripper.get_state().enabled is not True:
        gripper.clear_fault()


def carried_out(step: Callable[[], Any], prepare: Callable[[], Any]) -> Any:
    """Carry out a step, again where a busy machine has let the motor go."""
    ends_s = time.monotonic() + DEADLINE_S
    while True:
        try:
            prepare()
            return step()
        except LiteGripError as error:  # noqa: PERF203 - it waits for a machine
            if error.reason not in BUSY or time.monotonic() > ends_s:
                raise


async def by_asyncio(path: str) -> None:
    """Make some calls of each kind by the client for asyncio."""
    async with aio.LiteGrip(socket_path=path) as gripper:
        if (await gripper.get_state()).enabled is not True:
            await gripper.clear_fault()
        async with gripper.states(100, batch=4) as whole:
            assert (await anext(whole)).calibrated
        async with gripper.events(["job_ended"]) as ended:
            assert await gripper.goto(40.0)
            assert (await anext(ended)).kind == "job_ended"
        async with gripper.lease(), gripper.stream() as targets:
            await targets.set_target(45.0)
            await targets.set_target(46.0)
        assert await gripper.open()
        await gripper.grasp(until="verdict")
        assert (await gripper.software_stop()).stop is not None
        assert (await gripper.clear_stop()).stop is None
        await gripper.load_template("normal")
        await gripper.teleop_status()
        await gripper.keep_trajectory("pick", PATH)
        assert await gripper.play(await gripper.fetch_trajectory("pick"))


def command(path: str, line: str) -> dict[str, Any]:
    """Carry out a command of litegripctl; return its exit code, and what it shows."""
    shown = io.StringIO()
    with contextlib.redirect_stdout(shown):
        code = ctl.main(["--socket", path, "--json", *line.split()])
    return {"line": line, "code": code, "shown": [*map(json.loads, shown.getvalue().splitlines())]}


def command_carried_out(path: str, line: str, codes: Collection[int]) -> dict[str, Any]:
    """Carry out a command that is to end with one of the codes, again on a busy machine."""
    ends_s = time.monotonic() + DEADLINE_S
    while True:
        done = command(path, line)
        if done["code"] in codes or time.monotonic() > ends_s:
            return done
        error = done["shown"][-1].get("error") or {"data": {}}
        if error["data"].get("reason") not in BUSY:
            return done
        command(path, "clear-fault")
        command(path, "enable")


def main() -> None:
    """Make all calls at the daemon of a socket, then what a list on standard input names.

    Prints what was done, as JSON, a line each.
    """
    path = sys.argv[1]
    wanted = json.load(sys.stdin)
    os.environ["LITEGRIPD_SOCKET"] = path
    print(json.dumps({"client": str(Path(litegrip_client.__file__).parent)}))
    for line, codes in wanted.get("lines", ()):
        print(json.dumps(command_carried_out(path, line, codes)))
    names = wanted.get("steps", ())
    if not names:
        return
    with LiteGrip(socket_path=path) as gripper:
        for name in names:
            carried_out(partial(STEPS[name], gripper), partial(ready, gripper))
            print(json.dumps({"step": name}))
    carried_out(lambda: asyncio.run(by_asyncio(path)), lambda: None)
    print(json.dumps({"step": "asyncio"}))


if __name__ == "__main__":
    main()
