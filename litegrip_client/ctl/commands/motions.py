"""The commands that move the jaws or let them be moved.

All of these outlive this program: what was begun is carried out, and held.
"""

from __future__ import annotations

from collections.abc import Mapping

from litegrip_client.ctl import render_results as render
from litegrip_client.ctl.motion import finish, start
from litegrip_client.ctl.run import OK, Command, Run
from litegrip_client.errors import CommandError, HardwareError

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: typing takes long to import
    from typing import Any


def open_or_close(run: Run) -> int:
    """Move to the stop that `options.command` names."""
    return _move(run, f"motion.{run.options.command}", _given(speed_mm_s=run.options.speed))


def move(run: Run) -> int:
    """Move to a target."""
    parameter, value = run.options.target
    paces = _given(speed_mm_s=run.options.speed, duration_s=run.options.duration)
    return _move(run, "motion.move", {parameter: value, **paces})


def _move(run: Run, method: str, params: Mapping[str, Any]) -> int:
    if run.options.no_wait:
        return start(run, method, params)
    return finish(run, method, params, lambda data: render.move(run.options.command, data))


def grasp(run: Run) -> int:
    """Close until something is held; wait for the verdict, or through the holding."""
    options = run.options
    params = _given(
        force_n=options.force,
        width_mm=options.width,
        tolerance_mm=options.tolerance,
        hold_s=options.hold,
    )
    params["until"] = "verdict" if options.hold is None else "held"
    if options.gains:
        params["hold_by"] = "gains"
    if options.speed is not None:
        params["config"] = {"grasp_speed_mm_s": options.speed}
    if options.no_wait:
        return start(run, "motion.grasp", params)
    return finish(run, "motion.grasp", params, render.grasp)


def release(run: Run) -> int:
    """Open by a distance, at most to the open end of the calibrated travel."""
    opening_mm = run.connection.call("state.get")["opening_mm"]
    calibration = run.connection.call("calibration.get")
    if not calibration["calibrated"]:
        raise CommandError("the gripper is not calibrated", reason="not_calibrated")
    if opening_mm is None:
        raise HardwareError(
            "the opening is not known: the motor has not told its position",
            reason="motor_silent",
            data={"hint": "see: litegripctl health"},
        )
    target_mm = min(opening_mm + run.options.by, calibration["travel_mm"])
    return finish(
        run, "motion.move", {"opening_mm": target_mm}, lambda data: render.move("release", data)
    )


def force(run: Run) -> int:
    """Set the squeezing force."""
    data = _settle(run, "motion.set_force", {"force_n": run.options.newtons})
    run.output.result(data, render.force(data))
    return OK


def slack(run: Run) -> int:
    """Let the jaws move freely."""
    data = _settle(run, "motion.zero_gravity", {})
    run.output.result(data, "jaws move freely; hold again with: litegripctl hold")
    return OK


def _settle(run: Run, method: str, params: Mapping[str, Any]) -> dict[str, Any]:
    """Have something in force from now on; there is no end to wait for."""
    return run.connection.run(run.connection.prepare_guarded(method, params))


def _given(**options: float | None) -> dict[str, Any]:
    return {name: value for name, value in options.items() if value is not None}


COMMANDS: Mapping[str, Command] = {
    "open": open_or_close,
    "close": open_or_close,
    "grasp": grasp,
    "release": release,
    "move": move,
    "force": force,
    "slack": slack,
}
