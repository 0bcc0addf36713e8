"""What to do about an error, where this program knows more of it than the daemon says.

It must not know single commands' options.
"""

from __future__ import annotations

from argparse import Namespace

from litegrip_client.discovery import is_socket_given, running_channels
from litegrip_client.errors import LiteGripError

CHOOSE_MOUNT = "choose a mount: litegripctl calibration load normal|reverse, then litegripctl zero"
"""What to do when there is no calibration."""

_HINTS = {
    "stopped": "when it is safe again: litegripctl clear",
    "sent_before_stop": "when it is safe again: litegripctl clear, then once more",
    "not_enabled": "first: litegripctl enable",
    "busy": "see: litegripctl jobs",
    "teleop_busy": "end it: litegripctl teleop stop",
    "teleop_not_ready": "see: litegripctl state; calibrate it, then: litegripctl enable",
    "lease_held": "see: litegripctl lease; in need: litegripctl lease take REASON",
    "unknown_job": "see: litegripctl jobs",
    "unknown_trajectory": "see: litegripctl trajectories",
    "trajectory_busy": "see: litegripctl jobs; what only watches ends with its client: clients",
    "unknown_method": "the daemon is older than this program: see 'litegripctl info'",
}


_OTHERWISE = {"not_calibrated": CHOOSE_MOUNT}
"""Where the error has no hint of its own: only it knows whether a template would do."""


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
    own = _HINTS.get(error.reason or "") or error.hint or _OTHERWISE.get(error.reason or "")
    if own:
        return own
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
