"""What the exit codes of `litegripctl` mean, for the help and the manual page."""

EXIT_CODES: tuple[tuple[int, str], ...] = (
    (0, 'ok; the verdict "ok" of health'),
    (
        1,
        (
            "the action ended, but not as it should (something blocks the jaws, or nothing is"
            ' held, say), or you said no; the verdict "degraded" of health; doctor has found an'
            " error"
        ),
    ),
    (2, 'wrong usage; the verdict "down" of health'),
    (3, "no daemon to talk to, or no longer; with --host: ssh did not get there"),
    (4, "refused: not calibrated, a value out of its range, no such job or file"),
    (5, "the motor or its bus does not work"),
    (6, "busy: another motion is running, or another client has the lease"),
    (7, "stopped: a stop is latched (see: clear)"),
    (8, "the motion was cancelled"),
    (9, "this user's role does not allow it"),
    (70, "a defect, or another version of the daemon"),
    (74, "the output cannot be written: the disk is full, say"),
    (130, "interrupted by Ctrl-C"),
    (141, "whoever read the output has gone"),
)

CLOSING = "A motion goes on when litegripctl is killed; Ctrl-C cancels it."


def epilog() -> str:
    """Return the end of the help."""
    from textwrap import fill  # noqa: PLC0415 - only the help needs it

    lines = (
        fill(text, 79, initial_indent=f"  {code:<5}", subsequent_indent=" " * 7)
        for code, text in EXIT_CODES
    )
    return "\n".join(("exit codes:", *lines, "", CLOSING, ""))
