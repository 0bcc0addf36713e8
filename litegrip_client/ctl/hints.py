"""What to do about an error, in the words of this program; the daemon's are those of the protocol.

It must not know single commands' options.
"""

from __future__ import annotations

import re
from argparse import Namespace

from litegrip_client.discovery import is_socket_given, running_channels
from litegrip_client.errors import LiteGripError

CHOOSE_MOUNT = "choose a mount: litegripctl calibration load normal|reverse, then litegripctl zero"
"""What to do when there is no calibration."""

_HINTS = {
    "stopped": "when it is safe again: litegripctl clear",
    "sent_before_stop": "when it is safe again: litegripctl clear, then once more",
    "not_enabled": "first: litegripctl enable",
    "not_calibrated": CHOOSE_MOUNT,
    "busy": "see: litegripctl jobs",
    "teleop_busy": "end it: litegripctl teleop stop",
    "teleop_not_ready": "see: litegripctl state; calibrate it, then: litegripctl enable",
    "lease_held": "see: litegripctl lease; in need: litegripctl lease take REASON",
    "unknown_job": "see: litegripctl jobs",
    "unknown_trajectory": "see: litegripctl trajectories",
    "trajectory_busy": "see: litegripctl jobs; what only watches ends with its client: clients",
    "unknown_method": "the daemon is older than this program: see 'litegripctl info'",
}

_COMMANDS = {
    "calibration.load": "litegripctl calibration load",
    "calibration.manual": "litegripctl calibration manual",
    "calibration.zero with a mount": "litegripctl zero --mount",
    "config.get": "litegripctl config",
    "daemon.restart": "litegripctl restart",
    "job.cancel": "litegripctl cancel JOB",
    "job.list": "litegripctl jobs",
    "job.wait": "see: litegripctl jobs",
    "lease.acquire with wait_s": "see: litegripctl lease",
    "lease.take": "litegripctl lease take REASON",
    "motion.grasp": "litegripctl grasp",
    "motion.move": "litegripctl move",
    "motor.clear_fault": "litegripctl clear-fault",
    "motor.disable": "litegripctl disable",
    "motor.enable": "litegripctl enable",
    "stop.clear": "litegripctl clear",
    "teleop.start": "litegripctl teleop",
    "teleop.stop": "litegripctl teleop stop",
    "trajectory.list": "litegripctl trajectories",
    "trajectory.play": "litegripctl play",
    "trajectory.record_start": "litegripctl record NAME",
    "trajectory.record_stop": "by the program that records",
}
"""What the daemon's messages name as a remedy: the command that does the same."""

_METHOD = re.compile(rf"(?<![\w.])(?:{'|'.join(map(re.escape, _COMMANDS))})(?![\w.]\w)")


def in_commands(text: str) -> str:
    """Put commands in the place of the protocol's methods, for a person at a shell."""
    return _METHOD.sub(lambda found: _COMMANDS[found[0]], text)


def hint_for(error: LiteGripError, options: Namespace) -> str:
    """Say what to do about an error of the command that `options` are of."""
    if error.reason == "no_daemon" and not options.channel_chosen and options.socket is None:
        running = running_channels()
        # Which of them is meant is not guessed: it may be the one that must not move. Where the
        # default's socket is there, it is known to be meant, and the error says what is wrong.
        if running and options.channel not in running:
            return f"there are: {', '.join(running)}; name one: litegripctl -c {running[0]} ..."
    if options.command == "clear" and error.reason == "lease_held":
        return "ask one of them to clear it"  # the message names who may
    own = _HINTS.get(error.reason or "") or error.hint
    if own:
        return in_commands(own)
    if error.reason == "internal_error":
        return f"see the daemon's log: journalctl {_log_of(options)}"
    if error.retryable:
        return "" if "try again" in error.message else "try again"
    return f"see: {options.help_of} --help"


def _log_of(options: Namespace) -> str:
    """Name the daemon's unit; a socket that is named alone may be of any channel."""
    alone = options.socket is not None or (options.ssh_host is None and is_socket_given())
    if alone and not options.channel_chosen:
        return "-t litegripd"
    return f"-u litegripd@{options.channel}"
