"""Reasons of the errors that the client and `litegripctl` find out themselves, for docs/errors.md.

The daemon's own table is `litegripd.model.errors`. Nothing is decided by this one.
"""

from __future__ import annotations

from collections.abc import Mapping

OWN_REASONS: Mapping[str, tuple[str, int, str]] = {
    "no_daemon": ("ConnectError", 3, "No daemon can be reached by the sockets of the channel."),
    "no_answer": ("ConnectError", 3, "The daemon does not answer in time."),
    "connection_lost": ("ConnectError", 3, "The connection to the daemon is gone."),
    "not_connected": ("ConnectError", 3, "The object is not connected, or no longer."),
    "ssh_failed": ("ConnectError", 3, "ssh (`--host`) is missing, or did not get there."),
    "forked": ("ConnectError", 3, "The connection belongs to the process before the fork."),
    "wrong_loop": ("CommandError", 4, "The connection belongs to another event loop."),
    "reentrant": ("CommandError", 4, "The thread waits for an answer there already."),
    "wrong_protocol": ("ProtocolError", 70, "The daemon speaks another version of the protocol."),
    "missing_field": ("ProtocolError", 70, "Something is missing in what the daemon sent."),
    "wrong_gripper": ("CommandError", 4, "The daemon has another channel or motor than named."),
    "unsupported": ("CommandError", 4, "What the SDK can do, but not through a daemon."),
    "not_begun": ("CommandError", 4, "No calibration by hand is going on."),
    "file_exists": ("CommandError", 4, "There is a file or a trajectory of that name."),
    "file_not_read": ("CommandError", 4, "A file cannot be read from here."),
    "file_not_written": ("CommandError", 4, "A file cannot be written."),
    "dump_unreadable": ("CommandError", 4, "A file is no dump of the flight recorder."),
    "library_missing": ("CommandError", 4, "The command needs a library that is not installed."),
    "wrong_usage": ("CommandError", 2, "The command line of `litegripctl` is wrong."),
    "not_wanted": ("CommandError", 1, "You said no; nothing was done."),
    "interrupted": ("CancelledError", 130, "Ctrl-C ended it."),
}
"""By reason: the exception, the exit code of `litegripctl`, and what it means."""
