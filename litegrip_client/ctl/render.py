"""How `litegripctl` shows results, motions on their way, and what to do about an error.

Takes the wire's objects as they are, so that an older or newer daemon is still shown. This module
must not know single commands' options.
"""

from __future__ import annotations

import re
from argparse import Namespace
from collections.abc import Callable
from time import localtime, strftime, time

from litegrip_client.core.discovery import (
    channels_with_socket,
    is_socket_given,
    running_channels,
)
from litegrip_client.core.motion import Motion
from litegrip_client.ctl.run import ENDING, INTERRUPTED, Run
from litegrip_client.line.exchange import SEE_DOCTOR
from litegrip_client.threads.blocking import BlockingWire, complete
from litegrip_client.values.errors import CancelledError, LiteGripError
from litegrip_client.values.figures import Data, Here, figure, owner, plain

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import TypeAlias

    from litegrip_client.line.connection import Connection

Clock: TypeAlias = "Callable[[object], str]"
"""Shows a time of the daemon's clock as the time of day."""


def clock_of(connection: Connection) -> Clock:
    """Return what shows the times of a daemon, which counts from its machine's start."""
    now_s = connection.call("hello").get("monotonic_s")
    asked_s = time()

    def show(at_s: object) -> str:
        if not isinstance(at_s, int | float) or not isinstance(now_s, int | float):
            return "--"
        return strftime("%H:%M:%S", localtime(asked_s + at_s - now_s))

    return show


def lease(data: Data) -> str:
    """Return who has the lease."""
    holder, waiting = data.get("owner"), data.get("waiting") or 0
    queue = f"; {waiting} waiting" if waiting else ""
    if holder is None:
        return f"free{queue}"
    what = f" for {holder['purpose']}" if holder.get("purpose") else ""
    return plain(f"{owner(holder)}, uid {holder.get('uid')}, has it{what}{queue}")


CHOOSE_MOUNT = (
    "choose a mount: litegripctl calibration load normal (or reverse), then litegripctl zero"
)
"""What to do when there is no calibration."""

_HINTS = {
    "stopped": "when it is safe again: litegripctl clear",
    "sent_before_stop": "when it is safe again: litegripctl clear, then once more",
    "not_enabled": "first: litegripctl enable",
    "busy": "see: litegripctl jobs; to end what runs: litegripctl cancel",
    "teleop_busy": "end it: litegripctl teleop stop",
    "teleop_not_ready": "see: litegripctl state; calibrate it, then: litegripctl enable",
    "lease_held": "see: litegripctl lease; in need: litegripctl lease take REASON",
    "unknown_job": "see: litegripctl jobs",
    "unknown_trajectory": "see: litegripctl trajectories",
    "trajectory_busy": "see: litegripctl jobs; to end what runs: litegripctl cancel",
}

_REMEDIES = {
    "stopped": {"stop.clear"},
    "not_enabled": {"motor.enable"},
    "busy": {"job.wait"},
    "teleop_busy": {"teleop.stop"},
    "lease_held": {"lease.acquire", "lease.take"},
    "unknown_job": {"job.list"},
    "unknown_trajectory": {"trajectory.list"},
    "trajectory_busy": {"job.wait"},
}
"""The methods whose commands a hint names: a message that names them needs no hint."""


_OTHERWISE = {
    "not_calibrated": CHOOSE_MOUNT,
    "unreachable": "see: litegripctl doctor",
    "connection_lost": SEE_DOCTOR,
    "cancelled": "what the jaws do now: litegripctl state",
    "trajectory_unreadable": "which ones can be used: litegripctl trajectories",
}
"""Used if the error has no hint of its own; only that hint can offer a template."""


_OF_CLIENT = ("no_daemon", "no_answer", "older_daemon")
"""Reasons whose hints are this side's own words."""


_NAMES_OPTION = re.compile(r"(?:^|[\s(])--[a-z]")


def hint_for(error: LiteGripError, options: Namespace) -> str:
    """Return what to do about an error of the command with these `options`."""
    stops = options.command == "stop"
    is_named = options.channel_chosen or options.socket is not None
    if error.reason == "no_daemon" and (stops or not is_named):
        running = running_channels()
        # Which of them is meant is not guessed: it may be the one that must not move. Where the
        # default's socket is there, it is known to be meant, and the error says what is wrong.
        if running and options.channel not in channels_with_socket():
            command = "stop" if stops else "..."
            first = f"litegripctl -c {running[0]} {command}"
            every = ", or stop all: litegripctl stop --all" if stops and len(running) > 1 else ""
            return f"there are: {', '.join(running)}; name one: {first}{every}"
        if stops:
            return ""  # how to start one is no help now
    if options.command == "clear" and error.reason == "lease_held":
        return "ask one of them to clear it"  # the message names who may
    reason, here = error.reason or "", options.here
    if error.hint and (reason not in _HINTS or error.code is None):
        return str(here(error.hint)) if reason in _OF_CLIENT else error.hint
    if own := _HINTS.get(reason) or _OTHERWISE.get(reason):
        return str(here(own))
    if error.reason == "internal_error":
        from litegrip_client.ctl.doctor.gather import is_remote_name  # noqa: PLC0415 - seldom needed

        is_remote = options.channel_chosen and is_remote_name(options.channel)
        where = " on the gripper's machine" if is_remote else ""
        # A socket that is named alone may be of any channel's daemon.
        alone = options.socket is not None or is_socket_given()
        is_any = is_remote or (alone and not options.channel_chosen)
        log_of = "-t litegripd" if is_any else f"-u litegripd@{options.channel}"
        return f"see the daemon's log{where}: journalctl {log_of}"
    if error.retryable:
        if "try again" in error.message:
            return ""
        return str(here(SEE_DOCTOR)) if reason == "motor_silent" else "try again"
    # The help says what is typed, and not what is wrong with a file, or with what the daemon has.
    is_of_line = reason == "wrong_usage" or _NAMES_OPTION.search(error.message) is not None
    return f"see: {options.help_of} --help" if is_of_line else ""


def names_remedy(error: LiteGripError) -> bool:
    """Return True if the message of an error names what its hint is about."""
    return error.names(frozenset(_REMEDIES.get(error.reason or "", error.remedy)))


def start(run: Run, method: str, params: Data) -> int:
    """Start a motion and show its job, without waiting for its end."""
    data = run.connection.command(method, {**params, "detach": True, "wait": False})
    return run.done(data, f"{run.options.command}: job {data['job']} started")


def finish(run: Run, method: str, params: Data, tell: Callable[[Data], str]) -> int:
    """Run a motion to its end and show the result as `tell` puts it.

    It outlives this program's death, but Ctrl-C cancels it. The exit code is that of the
    result's `ok`, where it has one.
    """

    def show(data: Data) -> None:
        if run.output.live:
            run.output.line(progress(data))

    motion = Motion(
        BlockingWire(run.connection), method, {**params, "detach": True}, show, warns=False
    )
    try:
        data = complete(motion.run())
    except KeyboardInterrupt:
        run.output.erase_line()
        _report_cancelled(motion, run)
        return INTERRUPTED
    run.output.erase_line()
    return run.done(data, tell(data), ok=data.get("ok", True))


def jaws(state: Data) -> str:
    """Return what the jaws do now that nothing of this program moves them."""
    mode = state.get("mode")
    if mode == "holding":
        return "the jaws hold"
    if mode == "relaxed":
        return "the jaws are slack"
    if mode == "moving":
        return "another motion runs"
    return "the motor does not answer" if mode == "offline" else "the motor is not enabled"


def jaws_now(run: Run) -> str:
    """Ask for the state, and return what the jaws do; or that this is not known."""
    try:
        return jaws(run.connection.call("state.get"))
    except LiteGripError as error:
        return f"what the jaws do is not known: {error.message}"


def _report_cancelled(motion: Motion, run: Run) -> None:
    hint = ""
    if motion.cancel_error is not None:
        text = f"interrupted, but the motion could NOT be cancelled: {motion.cancel_error.message}"
        if not run.connection.is_silent:
            hint = run.here("it may continue; stop it with: litegripctl stop")
    elif motion.cancelled is None:
        text = f"interrupted: no motion was running, {jaws_now(run)}"
    elif motion.cancelled["state"] in ENDING:
        text = f"interrupted: job {motion.cancelled['job']} cancelled, {jaws_now(run)}"
    else:
        text = f"interrupted: job {motion.cancelled['job']} had ended, {motion.cancelled['state']}"
    run.output.error(CancelledError(text, reason="interrupted"), hint)


_BAR_WIDTH = 24


def progress(data: Data) -> str:
    """Return the progress of a motion in one line, with a bar if its length is known."""
    total = data.get("total_steps") or 0
    done = f"{bar(data.get('step', 0) / total)} " if total > 0 else ""
    opening = figure(data.get("opening_mm"), "6.2f", "mm")
    torque = figure(data.get("torque_nm"), "+.2f", "N·m")
    passes = f", pass {data['loops'] + 1}" if data.get("loops") else ""
    return f"{done}{opening}  {torque}  {words(data.get('phase'))}{passes}"


def bar(share: float) -> str:
    """Return a share, 0 to 1, as a bar."""
    filled = "#" * round(min(1.0, max(0.0, share)) * _BAR_WIDTH)
    return f"[{filled.ljust(_BAR_WIDTH, '.')}]"


def verdict(data: Data) -> str:
    """Return how a motion ended, and if that is how it should end."""
    return f"{'' if data.get('ok') else 'NOT ok: '}{words(data.get('outcome'))}"


WHY_NOT = {
    "blocked": (
        "something stopped the jaws on their way: take it away, or let go of what is held by"
        " litegripctl release; then once more"
    ),
    "protected": (
        "something was in the way, and the jaws let go of it: take it away, then once more;"
        " to hold it: litegripctl grasp"
    ),
    "no_stop": (
        "the jaws passed the calibrated stop and met none: measure again: litegripctl zero"
    ),
    "timed_out": (
        "the jaws neither arrived nor came to rest in time: look at what moves them, and at"
        " litegripctl health; then once more"
    ),
    "wrong_width": "something is held, but not of the width that was asked for",
    "motor_weak": (
        "the motor makes less torque than is commanded: how much less, says litegripctl health;"
        " look at its supply"
    ),
    "no_object": (
        "the jaws came to their empty end: put something between them, then litegripctl open,"
        " and once more"
    ),
    "object_lost": (
        "it slipped or gave way, and the jaws closed further: grasp it with more force (--force)"
    ),
    "not_aligned": "the jaws did not get to its start: take away what is in their way",
}
"""By outcome, of those that are not ok: the cause and the next step. What measures the travel has a
message of the daemon for that."""

_WHY_NOT_OPEN = {
    "blocked": (
        "something stopped the jaws as they opened: take away what holds them, or is in their way;"
        " then once more"
    ),
    "protected": "something was in the way as the jaws opened: take it away, then once more",
}
"""Of motions that open: nothing is let go of, or held, by another command."""


def why_not(data: Data, here: Here, *, opens: bool = False) -> str:
    """Return why a motion ended as it should not, and what to do; nothing where that is not known.

    It is a line of its own, below another one. `opens` is True if the jaws were to open.
    """
    outcomes = {**WHY_NOT, **(_WHY_NOT_OPEN if opens else {})}
    why = None if data.get("ok") else outcomes.get(str(data.get("outcome")))
    return "" if why is None else f"\n  {here(why)}"


def words(name: object) -> str:
    """Return a name of the protocol in words."""
    return plain(name).replace("_", " ")


def opening_of(data: Data) -> str:
    """Return where the jaws were at the end."""
    return figure(data.get("state", {}).get("opening_mm"), ".2f", "mm")
