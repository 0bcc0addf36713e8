"""Run the daemon of a simulated gripper and its page, after saying what to type next."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

CHANNEL = "sim0"
ENDS_WITHIN_S = 10.0

WORDS = """\
The daemon of a simulated gripper, channel {channel}. Its page, for your browser:

  {page}

In another terminal:

  . {activate}
  export LITEGRIP_CHANNEL={channel}
  litegripctl state            what the gripper does now
  litegripctl enable           energise the motor
  litegripctl open             and: close, hold, disable
  litegripctl grasp --force 10 there is an object of 40 mm between the jaws
  litegripctl sim object none  take it away; also: sim push, sim fault
  litegripctl watch            live, in a third terminal
  litegripctl stop             anybody may; then: litegripctl clear
  litegripctl health

Ctrl-C ends both and disables the motor.
"""


@contextmanager
def running(*command: str) -> Iterator[subprocess.Popen[str]]:
    """Run a program until the end of the block; it is ended, at last killed, if it still runs."""
    # Ctrl-C is for this program, which then ends the others in order.
    shown = subprocess.PIPE if "litegripd-web" in command[0] else None
    with subprocess.Popen(command, stdout=shown, text=True, start_new_session=True) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()


def main() -> int:
    """Run both until a signal comes, or until the daemon ends; return the daemon's exit code."""
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(0))
    programs = Path(sys.executable).parent
    config = Path(__file__).with_name("simulated.toml")
    with running(str(programs / "litegripd-web"), CHANNEL, "--operate", "--port", "0") as web:
        page = "" if web.stdout is None else web.stdout.readline().strip()
        activate = os.path.relpath(programs / "activate")
        print(WORDS.format(channel=CHANNEL, page=page, activate=activate), flush=True)
        with running(str(programs / "litegripd"), CHANNEL, "--config", str(config)) as daemon:
            return daemon.wait()


if __name__ == "__main__":
    sys.exit(main())
