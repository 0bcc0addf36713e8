"""Run the daemon of a simulated gripper and its page; say what to type next once both serve.

The channel is sim0, or the next name that is free where another user's daemon has it. The page has
the same address and secret each time, so that a bookmark works. With the argument `mujoco`, MuJoCo
moves the jaws.
"""

import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from litegrip_client import ConnectError, LiteGripError
from litegrip_client.threads.blocking import connect

CHANNELS = [f"sim{number}" for number in range(10)]
FIRST_PORT = 8040
ENDS_WITHIN_S = 10.0
LOOK_EVERY_S = 0.02
IN_USE = 3
"""The daemon's exit code when another one has its channel."""

PROGRAMS = Path(sys.executable).parent
CONFIGS = Path(__file__).parent

WORDS = """\

The simulated gripper is there: channel {channel}. Its page, for your browser:

  {page}

In another terminal:

  {prepare}
  litegripctl state               # what the gripper does now
  litegripctl enable              # energise the motor
  litegripctl open                # and: close, hold, disable
{world}
  litegripctl watch               # live, in a third terminal
  litegripctl stop                # anybody may; then: litegripctl clear
  litegripctl health

Ctrl-C ends both and disables the motor.
"""


WORLDS = {
    "simulated": """\
  litegripctl grasp --force 10    # there is an object of 40 mm between the jaws
  litegripctl sim object none     # take it away; also: sim push, sim fault""",
    "mujoco": """\
  litegripctl grasp --force 10    # there is a loose cube of 30 mm between the jaws
  python examples/mujoco_view.py  # look at them; needs a display
  litegripctl sim push -0.5       # a hand opens the jaws, 0 lets go; also: sim hold, sim fault""",
}
"""What is around the jaws, by the name of the configuration."""


@contextmanager
def running(*command: str, **options: Any) -> Iterator[subprocess.Popen[str]]:
    """Run a program until the end of the block; it is ended, at last killed, if it still runs."""
    # Ctrl-C is for this program, which then ends the others in order.
    with subprocess.Popen(command, text=True, start_new_session=True, **options) as process:
        try:
            yield process
        finally:
            process.terminate()
            try:
                process.wait(ENDS_WITHIN_S)
            except subprocess.TimeoutExpired:
                process.kill()


def daemon_of(channel: str) -> int | None:
    """Return the process whom a client of `channel` reaches, or None if nobody answers."""
    try:
        with connect(channel) as connection:
            return int(connection.call("hello")["pid"])
    except LiteGripError:
        return None


def serves(process: subprocess.Popen[str], channel: str) -> bool:
    """Wait until clients of `channel` reach the daemon; return False if it ends before.

    Raises `ConnectError` if they reach another one.
    """
    while process.poll() is None:
        reached = daemon_of(channel)
        if reached == process.pid:
            return True
        if reached is not None:
            raise ConnectError(f"clients of {channel} reach another daemon, pid {reached}")
        time.sleep(LOOK_EVERY_S)
    return False


def own_directory(variable: str, otherwise: Path) -> Path:
    """Return a directory of this user, from the environment or `otherwise`.

    One that is made is for this user alone. Raises `OSError` if it is another user's.
    """
    directory = Path(os.environ.get(variable) or otherwise)
    directory.mkdir(mode=0o700, parents=True, exist_ok=True)
    if directory.lstat().st_uid != os.getuid():
        raise PermissionError(f"{directory} belongs to another user: set {variable}")
    return directory


@contextmanager
def page_of(channel: str, folder: Path) -> Iterator[str]:
    """Serve the page of `channel` until the end of the block; yield its address."""
    token = folder / f"{channel}_page.token"
    command = (str(PROGRAMS / "litegripd-web"), channel, "--operate", "--token-file", str(token))
    port = FIRST_PORT + CHANNELS.index(channel)
    for chosen in (port, 0):  # 0: any that is free
        options = {"stdout": subprocess.PIPE, "stderr": None if chosen == 0 else subprocess.DEVNULL}
        with running(*command, "--port", str(chosen), **options) as web:
            said = "" if web.stdout is None else web.stdout.readline()
            if "#" not in said:
                continue  # it ended
            if chosen == 0:
                print(f"Port {port} is taken: the page has another address than usual.")
            yield said.partition("#")[0] + "#" + token.read_text("ascii").strip()
            return
    yield "it could not be started: see above"


def prepare(channel: str, more: str) -> str:
    """Return what to type first in another terminal."""
    activate = os.path.relpath(PROGRAMS / "activate")
    lines = (f". {activate}", f"export LITEGRIP_CHANNEL={channel}", more)
    return "\n  ".join(filter(None, lines))


def already_runs(channel: str, pid: int, note: Path, more: str) -> None:
    """Say what this user's daemon of `channel` is, and where its page is."""
    page = note.read_text("utf-8") if note.exists() else ""
    print(f"Your simulated gripper runs already: channel {channel}, process {pid}.")
    print(
        f"Its page, for your browser:\n\n  {page}\n" if page else "It was started without a page."
    )
    print(f"In another terminal:\n\n  {prepare(channel, more)}\n  litegripctl state")


def ended(code: int) -> int:
    """Return the exit code for a daemon that ended with `code`; say of a signal which it was."""
    if code >= 0:
        return code
    print(f"The daemon was ended by {signal.Signals(-code).name}: start it again.", file=sys.stderr)
    return 1


def main() -> int:
    """Run both until a signal comes, or until the daemon ends; return the daemon's exit code."""
    world = sys.argv[1] if len(sys.argv) > 1 else "simulated"
    if world in ("-h", "--help"):
        print(f"usage: run_simulated.py [{'|'.join(WORLDS)}]\n\n{__doc__}")
        return 0
    if world not in WORLDS:
        sys.exit(f"run_simulated: {world!r} is none of {', '.join(WORLDS)}")
    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        signal.signal(number, lambda *_: sys.exit(0))
    os.environ.pop("LITEGRIPD_SOCKET", None)  # it would be the one socket of all channels
    more = ""
    if os.getuid() != 0 and not Path(f"/run/user/{os.getuid()}").exists():
        # Without a login session, as in a container, there is no place for a user's sockets.
        place = own_directory("XDG_RUNTIME_DIR", Path(tempfile.gettempdir(), f"run-{os.getuid()}"))
        os.environ["XDG_RUNTIME_DIR"] = str(place)
        more = f"export XDG_RUNTIME_DIR={place}"
    state = Path(os.environ.get("XDG_STATE_HOME") or Path.home() / ".local" / "state")
    folder = own_directory("STATE_DIRECTORY", state / "litegripd")
    for channel in CHANNELS:
        note = folder / f"{channel}_page.address"
        if (pid := daemon_of(channel)) is not None:
            if Path(f"/proc/{pid}").stat().st_uid == os.getuid():
                already_runs(channel, pid, note, more)
                return 0
            print(f"Channel {channel} is another user's: its daemon is process {pid}.")
            continue
        command = (str(PROGRAMS / "litegripd"), channel, "--config", str(CONFIGS / f"{world}.toml"))
        with running(*command) as daemon:
            if not serves(daemon, channel):
                if daemon.returncode == IN_USE:
                    print(f"The next name after {channel} is tried.", flush=True)
                    continue
                return daemon.returncode
            with page_of(channel, folder) as page:
                note.touch(0o600)
                note.write_text(page, "utf-8")
                try:
                    words = {"channel": channel, "page": page, "prepare": prepare(channel, more)}
                    print(WORDS.format(world=WORLDS[world], **words), flush=True)
                    return ended(daemon.wait())
                finally:
                    note.unlink()
    print(f"The channels {CHANNELS[0]} to {CHANNELS[-1]} are all in use.", file=sys.stderr)
    return IN_USE


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (OSError, LiteGripError) as error:
        sys.exit(f"run_simulated: {error}")
