"""Commands that power the motor and move the jaws, and those on the jobs of these.

Motions outlive this program: what was begun is carried out, and held.
"""

from __future__ import annotations

from argparse import _ActionsContainer

from litegrip_client.core.session import ACTION_TIMEOUT_S, UNDER_WAY, naming_the_danger
from litegrip_client.ctl.parser import LateParser, count, in_unit, not_negative, positive, target
from litegrip_client.ctl.render import (
    clock_of,
    finish,
    jaws_now,
    opening_of,
    start,
    verdict,
    why_not,
    words,
)
from litegrip_client.ctl.run import ENDING, Commands, Run
from litegrip_client.values.checks import given_numbers, range_of
from litegrip_client.values.errors import BusyError, CommandError, HardwareError, from_error_object
from litegrip_client.values.figures import Data, figure, owner, plain
from litegrip_client.values.printed import aligned, leaves
from litegrip_client.values.trajectory_format import MOST_FORCE_N

SPEEDS, FORCES = range_of("speed_mm_s"), range_of("force_n")


def enable_options(parser: LateParser) -> None:
    """Add the arguments of `enable`."""
    parser.add_argument("--retries", type=count, metavar="N", help="attempts at most, 1 to 20")


def enable(run: Run) -> int:
    """Enable the motor, for longer than this program runs."""
    params: dict[str, object] = {"detach": True}
    if run.options.retries is not None:
        params["retries"] = run.options.retries
    data = run.connection.command("motor.enable", params, ACTION_TIMEOUT_S)
    failure = f"NOT enabled: {data.get('message') or data.get('reason')} (tries: {data['tries']})"
    return run.done(data, "enabled" if data["ok"] else plain(failure), ok=data["ok"])


def disable(run: Run) -> int:
    """Disable the motor."""
    try:
        with naming_the_danger(run.here):
            data = run.connection.call("motor.disable", {"detach": True}, ACTION_TIMEOUT_S)
    except BusyError as error:
        error.message += run.here("; to disable it all the same: litegripctl stop --level disable")
        raise
    return run.done(
        data,
        "disabled" if data["ok"] else "NOT disabled: the motor does not confirm it",
        ok=data["ok"],
    )


def clear_fault(run: Run) -> int:
    """Clear what the motor has latched."""
    data = run.connection.call("motor.clear_fault", {"detach": True}, ACTION_TIMEOUT_S)
    cleared = data.get("cleared")
    text = "the motor had no fault" if cleared is None else f"cleared: {cleared}"
    return run.done(data, plain(f"{text}; it is disabled"))


_REGISTERS = """\
examples:
  litegripctl register PMAX VMAX TMAX
  litegripctl register 21 0x15
"""


def register_options(parser: LateParser) -> None:
    """Add the arguments of `register`."""
    parser.description, parser.epilog = "Read registers of the motor.", _REGISTERS
    parser.add_argument(
        "registers", nargs="+", metavar="NAME|NUMBER", help="PMAX, 21 or 0x15, for one"
    )


def register(run: Run) -> int:
    """Read registers, and show one in a line."""
    rows = [
        run.connection.call("motor.read_register", {"register": name})
        for name in run.options.registers
    ]
    lines = (
        f"{plain(row.get('number')):>3}  {plain(row.get('name')):<9}  {plain(row.get('value'))}"
        for row in rows
    )
    return run.done({"registers": rows}, "\n".join(lines))


_IN_THE_WAY = """\
Where something is in the way, the jaws let go of it; the command says so, and
ends with the exit code 1. To close on an object and hold it: litegripctl grasp
"""


def to_stop_options(parser: LateParser) -> None:
    """Add the arguments of `open` and `close`."""
    parser.epilog = _IN_THE_WAY
    _speed_options(parser)
    _no_wait_options(parser)


def _speed_options(parser: _ActionsContainer) -> None:
    parser.add_argument(
        "--speed",
        type=in_unit(positive, "mm/s", SPEEDS),
        metavar="MM_S",
        help=f"in mm/s, {SPEEDS} (default: the daemon's)",
    )


def _no_wait_options(parser: LateParser) -> None:
    parser.add_argument("--no-wait", action="store_true", help="do not wait for the end")


def open_or_close(run: Run) -> int:
    """Move to the stop that `options.command` names."""
    return _move(run, f"motion.{run.options.command}", given_numbers(speed_mm_s=run.options.speed))


_MOVE_EXAMPLES = """\
examples:
  litegripctl move 45mm            45 mm between the jaws
  litegripctl move 50%             half open; 0% is closed
  litegripctl move -0.3rad         the position of the motor
  litegripctl move 45mm --duration 2
"""


def move_options(parser: LateParser) -> None:
    """Add the arguments of `move`."""
    parser.description = "Move to a target, then hold."
    parser.epilog = _MOVE_EXAMPLES
    parser.add_argument(
        "target",
        type=target,
        metavar="TARGET",
        help="with its unit: 45mm (opening), -0.3rad (position of the motor), 50%% (of the travel)",
    )
    pace = parser.add_mutually_exclusive_group()
    _speed_options(pace)
    pace.add_argument(
        "--duration", type=in_unit(positive, "s"), metavar="S", help="how long it takes, in s"
    )
    _no_wait_options(parser)


def move(run: Run) -> int:
    """Move to a target."""
    parameter, value = run.options.target
    paces = given_numbers(speed_mm_s=run.options.speed, duration_s=run.options.duration)
    return _move(run, "motion.move", {parameter: value, **paces})


def _move(run: Run, method: str, params: Data) -> int:
    if run.options.no_wait:
        return start(run, method, params)
    return finish(run, method, params, lambda data: _moved_text(run, data))


def _moved_text(run: Run, data: Data) -> str:
    """Return how a motion ended."""
    text = f"{run.options.command}: {verdict(data)}, at {opening_of(data)}"
    return f"{text}{why_not(data, run.here, opens=_opens(run, data))}"


def _opens(run: Run, data: Data) -> bool:
    """Return True if a motion that has not arrived was to open the jaws, as far as is known."""
    if run.options.command != "move":
        return run.options.command in ("open", "release")
    parameter, wanted = run.options.target
    reached = data.get("state", {}).get(parameter)
    return parameter != "position_rad" and reached is not None and bool(wanted > reached)


_GRASP = """\
Close until the jaws hold something, then squeeze it with a force.

Ends with the verdict: held or not. The daemon continues to hold.
The exit code is 0 only when it is. Let go again with: litegripctl release
"""
_GRASP_EXAMPLES = """\
examples:
  litegripctl grasp --force 15
  litegripctl grasp --width 48 --tolerance 2    only this object will do
  litegripctl grasp --hold 5                    is it still held after 5 s?
"""


def grasp_options(parser: LateParser) -> None:
    """Add the arguments of `grasp`."""
    parser.description, parser.epilog = _GRASP, _GRASP_EXAMPLES
    parser.add_argument(
        "--force",
        type=in_unit(positive, "N", FORCES),
        metavar="N",
        help=f"in newtons, {FORCES} (default: the daemon's)",
    )
    _speed_options(parser)
    parser.add_argument(
        "--width",
        type=in_unit(positive, "mm"),
        metavar="MM",
        help="how wide the object must be, in mm; give both",
    )
    parser.add_argument(
        "--tolerance",
        type=in_unit(not_negative, "mm"),
        metavar="MM",
        help="how far the width may be off, in mm; give both",
    )
    parser.add_argument(
        "--hold",
        type=in_unit(not_negative, "s"),
        metavar="S",
        help="hold for S seconds, and then check that it is still held",
    )
    parser.add_argument(
        "--gains", action="store_true", help="hold by position and gains, not by torque"
    )
    _no_wait_options(parser)


def grasp(run: Run) -> int:
    """Close until something is held; wait for the verdict, or through the holding."""
    options = run.options
    params = given_numbers(
        force_n=options.force,
        speed_mm_s=options.speed,
        width_mm=options.width,
        tolerance_mm=options.tolerance,
        hold_s=options.hold,
    )
    params["until"] = "verdict" if options.hold is None else "held"
    if options.gains:
        params["hold_by"] = "gains"
    _note_force(run, options.force)
    if options.no_wait:
        return start(run, "motion.grasp", params)
    return finish(run, "motion.grasp", params, lambda data: _grasp_text(run, data))


CONTINUOUS_N = 20.0
"""What the vendor recommends for continuous work."""


def _note_force(run: Run, force_n: float | None) -> None:
    """Say of a large force that it is not for long; one that is refused needs no more words."""
    if force_n is not None and CONTINUOUS_N < force_n <= MOST_FORCE_N:
        run.output.note(
            f"the vendor recommends {CONTINUOUS_N:g} N for continuous work; how long the coil bears"
            f" {force_n:g} N: {run.here('litegripctl health')} (heat, time to limit)"
        )


def _grasp_text(run: Run, data: Data) -> str:
    """Return what is held, how wide it is, and how to let go of it."""
    width = data.get("width_mm")
    is_weak = data.get("outcome") == "motor_weak"  # whether anything is held is not known
    is_wide = width is not None and not is_weak
    text = f"grasp: {verdict(data)}, "
    text += f"{figure(width, '.1f', 'mm')} wide" if is_wide else f"at {opening_of(data)}"
    if data.get("held_s"):
        text += f", held for {figure(data['held_s'], '.1f', 's')}"
    if data.get("ok") or data.get("state", {}).get("force_set_n") is not None:
        held = "asked to hold" if is_weak else "holding"
        text += f", {held} {figure(data.get('force_n'), '.1f', 'N')}"
        text += run.here("; let go with: litegripctl release")
    return f"{text}{why_not(data, run.here)}"


def release_options(parser: LateParser) -> None:
    """Add the arguments of `release`."""
    parser.description = (
        "Open by a distance from where the jaws are, at most to the open end of the\n"
        "calibrated travel, then hold."
    )
    parser.add_argument(
        "--by",
        type=in_unit(positive, "mm"),
        default=10.0,
        metavar="MM",
        help="how far to open, in mm (10)",
    )


def release(run: Run) -> int:
    """Open by a distance, at most to the open end of the calibrated travel."""
    opening_mm = run.connection.call("state.get")["opening_mm"]
    calibration = run.connection.call("calibration.get")
    if not calibration["calibrated"]:
        raise CommandError("the gripper is not calibrated", reason="not_calibrated")
    if opening_mm is None:
        raise HardwareError(
            "the opening is not known: the motor has not reported its position",
            reason="motor_silent",
            data={"hint": run.here("see: litegripctl health")},
        )
    target_mm = min(opening_mm + run.options.by, calibration["travel_mm"])
    return finish(
        run, "motion.move", {"opening_mm": target_mm}, lambda data: _moved_text(run, data)
    )


def force_options(parser: LateParser) -> None:
    """Add the arguments of `force`."""
    parser.description = (
        "Squeeze with another force from now on; jaws that hold nothing close with it."
    )
    parser.add_argument(
        "newtons", type=in_unit(positive, "N", FORCES), metavar="N", help=f"in newtons, {FORCES}"
    )


def force(run: Run) -> int:
    """Set the squeezing force."""
    _note_force(run, run.options.newtons)
    data = run.connection.command("motion.set_force", {"force_n": run.options.newtons})
    text = f"force: squeezing with {figure(data.get('force_n'), '.1f', 'N')}"
    if data.get("state", {}).get("is_grasped") is False:
        text += ", no object is held"
    text += f", at {opening_of(data)}{run.here('; let go with: litegripctl release')}"
    return run.done(data, text)


def slack(run: Run) -> int:
    """Let the jaws move freely."""
    data = run.connection.command("motion.zero_gravity", {})
    return run.done(data, run.here("jaws move freely; hold again with: litegripctl hold"))


def hold(run: Run) -> int:
    """Hold the measured position."""
    data = run.connection.command("motion.hold", {})
    opening = figure(data["state"].get("opening_mm"), ".2f", "mm")
    return run.done(data, f"holding at {opening}")


def jobs(run: Run) -> int:
    """List the jobs."""
    clock = clock_of(run.connection)
    data = run.connection.call("job.list")
    table = [("JOB", "KIND", "BEGAN", "TOOK", "OUTCOME", "OWNER")]
    table += [
        (
            str(row.get("job")),
            _kind(row),
            clock(row.get("started_s")),
            _took(row),
            _outcome(row),
            plain(owner(row.get("owner") or {})),
        )
        for row in data["jobs"]
    ]
    return run.done(data, aligned(table) if data["jobs"] else "no jobs")


_COMMANDS = {
    "set_force": "force",
    "zero_gravity": "slack",
    "calibrate_by_hand": "calibration manual",
    "clear_fault": "clear-fault",
}
"""By a job's kind: the command that begins it, where that has another name."""


def _kind(row: Data) -> str:
    """Return a job's kind as this program calls it."""
    kind = plain(row.get("kind"))
    return _COMMANDS.get(kind, kind)


def _took(row: Data) -> str:
    begun, ended = row.get("started_s"), row.get("ended_s")
    if not isinstance(begun, int | float) or not isinstance(ended, int | float):
        return figure(None, ".1f", "s")
    return figure(ended - begun, ".1f", "s")


def _outcome(row: Data) -> str:
    """Return how a job ended, or where it is."""
    error, result = row.get("error"), row.get("result") or {}
    if error:
        state, reason = plain(row.get("state")), words((error.get("data") or {}).get("reason"))
        return state if state == reason else f"{state}: {reason}"
    if "outcome" in result:
        return verdict(result)
    phase = f", {words(row['phase'])}" if row.get("phase") else ""
    return f"{'NOT ok' if result.get('ok') is False else plain(row.get('state'))}{phase}"


def job_options(parser: LateParser) -> None:
    """Add the arguments of `job`."""
    parser.add_argument("job", type=count, metavar="JOB", help="the number that 'jobs' shows")


def cancel_options(parser: LateParser) -> None:
    """Add the arguments of `cancel`."""
    parser.add_argument(
        "job",
        type=count,
        nargs="?",
        metavar="JOB",
        help="the number that 'jobs' shows (default: the one that runs)",
    )


def job(run: Run) -> int:
    """Show one job: how it ended, or where it is, and its figures."""
    clock = clock_of(run.connection)
    data = run.connection.call("job.get", {"job": run.options.job})
    rows = [
        ("job", f"{data['job']}, {_kind(data)}"),
        ("outcome", _outcome(data)),
        ("began", clock(data["started_s"])),
        ("ended", clock(data["ended_s"])),
        ("took", _took(data)),
        ("owner", plain(owner(data["owner"])) + (", detached" if data["detached"] else "")),
    ]
    if data["error"]:
        error = from_error_object(data["error"], voice=run.voice)
        rows.append(("why", plain(error.message)))
    opens = data["kind"] == "open"
    if why := why_not(data["result"] or {"ok": True}, run.here, opens=opens):
        rows.append(("why", why.strip()))
    rows += [
        (name, plain(f"{value:.4g}" if isinstance(value, float) else value))
        for name, value in leaves(data["result"] or {})
        if name.partition(".")[0] not in ("job", "state", "ok", "outcome") and value != "--"
    ]
    return run.done(data, aligned(rows))


def _running(run: Run) -> int:
    """Return the number of the job that runs; raises `CommandError` unless that is one."""
    rows = run.connection.call("job.list")["jobs"]
    running = [row["job"] for row in rows if row["state"] == "running"]
    if len(running) != 1:
        which = f"jobs {', '.join(map(str, running))} run: name one" if running else "no job runs"
        raise CommandError(which, reason="unknown_job")
    number: int = running[0]
    return number


def cancel(run: Run) -> int:
    """Cancel a job."""
    asked = {"job": run.options.job or _running(run)}
    was_over = run.connection.call("job.get", asked)["state"] not in UNDER_WAY
    data = run.connection.call("job.cancel", asked)
    done = not was_over and data["state"] in ENDING
    text = f"cancelled, {jaws_now(run)}" if done else f"had ended already: {data['state']}"
    return run.done(data, plain(f"job {data['job']} {text}"), ok=done)


COMMANDS: Commands = {
    "enable": (enable, enable_options),
    "disable": (disable, None),
    "clear-fault": (clear_fault, None),
    "register": (register, register_options),
    "open": (open_or_close, to_stop_options),
    "close": (open_or_close, to_stop_options),
    "grasp": (grasp, grasp_options),
    "release": (release, release_options),
    "move": (move, move_options),
    "force": (force, force_options),
    "slack": (slack, None),
    "hold": (hold, None),
    "jobs": (jobs, None),
    "job": (job, job_options),
    "cancel": (cancel, cancel_options),
}
