"""Where `litegripctl` starts: a plain stop or state at once, every other command line in full."""

import sys

from litegrip_client.ctl import quick, streams

OUTPUT_LOST = 74
"""EX_IOERR of sysexits.h: what was to be said cannot be written."""

PIPE_CLOSED = 141
"""As the shell reports a program that SIGPIPE (13) ended: 128 + 13."""

INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> int:
    """Run `litegripctl`; return its exit code."""
    streams.prepare()
    given = sys.argv[1:] if arguments is None else arguments
    try:
        code = _run(given)
        sys.stdout.flush()
    except BrokenPipeError:
        streams.abandon_output()
        return PIPE_CLOSED
    except streams.OutputLostError as lost:
        streams.abandon_output()
        print(f"litegripctl: standard output cannot be written: {lost}", file=sys.stderr)
        return OUTPUT_LOST
    except KeyboardInterrupt:
        return INTERRUPTED
    return code


def _run(given: list[str]) -> int:
    text = quick.answer(given)
    if text is not None:
        streams.write(f"{text}\n")
        return 0
    from litegrip_client.ctl import program  # noqa: PLC0415 - takes 30 ms

    return program.run(given)


if __name__ == "__main__":
    sys.exit(main())
