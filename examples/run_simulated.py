"""Start the daemon on a simulated gripper, in the foreground, after saying what to type next."""

import os
import sys
from pathlib import Path

CHANNEL = "sim0"


def main() -> None:
    """Say what to type, and become the daemon."""
    programs = Path(sys.executable).parent
    activate = programs / "activate"
    print(
        f"The daemon of a simulated gripper, channel {CHANNEL}. In another terminal:\n\n"
        f"  . {os.path.relpath(activate)}\n"
        f"  export LITEGRIP_CHANNEL={CHANNEL}\n"
        "  litegripctl state            what the gripper does now\n"
        "  litegripctl enable           energise the motor\n"
        "  litegripctl open             and: close, hold, disable\n"
        "  litegripctl grasp --force 10 there is an object of 40 mm between the jaws\n"
        "  litegripctl sim object none  take it away; also: sim push, sim fault\n"
        "  litegripctl watch            live, in a third terminal\n"
        "  litegripctl stop             anybody may; then: litegripctl clear\n"
        "  litegripctl health\n\n"
        "Ctrl-C ends the daemon and disables the motor.\n",
        flush=True,
    )
    daemon = str(programs / "litegripd")
    config = Path(__file__).with_name("simulated.toml")
    os.execv(daemon, [daemon, CHANNEL, "--config", str(config)])


if __name__ == "__main__":
    main()
