"""A daemon with a simulated gripper and two processes: one grasps an object, the other watches.

While the object is held, it is taken away: the grasp ends, and the process grasps again what it
finds. Ends by itself, with exit code 0 when all of that happened; nothing is left behind, however
it ends.
"""

import io
import os
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from threading import Event, Thread

CHANNEL = f"demo{os.getpid()}"  # so that two demos do not meet
HERE = Path(__file__).parent
ENDS_WITHIN_S = 10.0


@contextmanager
def running(title: str, *command: str) -> Iterator[subprocess.Popen[bytes]]:
    """Run a process until the end of the block; it is ended, at last killed, if it still runs."""
    print(f"$ {title}", flush=True)
    process = subprocess.Popen(
        command,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        start_new_session=True,  # Ctrl-C is for the demo, which then ends the others in order
    )
    try:
        yield process
    finally:
        if process.poll() is None:
            process.send_signal(signal.SIGTERM)
        try:
            process.wait(ENDS_WITHIN_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stdout is not None:
            process.stdout.close()


def lines_of(name: str, process: subprocess.Popen[bytes]) -> Iterator[str]:
    """Show what a process prints, each line with its name, and give it, too.

    On a terminal a progress bar stays one line that changes.
    """
    if process.stdout is None:
        return
    text, line = io.TextIOWrapper(process.stdout, "utf-8", newline=""), ""  # \r stays \r
    try:
        while letter := text.read(1):
            if letter not in "\r\n":
                line += letter
                continue
            if line:
                yield _shown(name, line, changes=letter == "\r")
            line = ""
    finally:
        text.detach()  # or its end would close the pipe, and the process could not write its last


def _shown(name: str, line: str, *, changes: bool) -> str:
    if changes and sys.stdout.isatty():
        print(f"\r{name:>7} | {line}", end="", flush=True)
    elif not changes:
        start = "\r" if sys.stdout.isatty() else ""
        print(f"{start}{name:>7} | {line}\n", end="", flush=True)  # whole, beside another thread
    return line


def main() -> int:
    """Run the demo; return the exit code."""
    signal.signal(signal.SIGTERM, lambda *_: sys.exit(143))
    programs = Path(sys.executable).parent
    with tempfile.TemporaryDirectory(prefix="litegripd-demo-") as folder, ExitStack() as stack:
        path = Path(folder) / "demo.sock"
        os.environ["STATE_DIRECTORY"] = folder

        def simulate(*words: str) -> bool:
            print(f"$ litegripctl sim {' '.join(words)}", flush=True)
            command = [str(programs / "litegripctl"), "--socket", str(path), "sim", *words]
            return subprocess.run(command, check=False, stdout=subprocess.DEVNULL).returncode == 0

        def begin(title: str, *command: str) -> subprocess.Popen[bytes]:
            return stack.enter_context(running(title, *command))

        daemon = begin(
            f"litegripd {CHANNEL} --config examples/simulated.toml",
            str(programs / "litegripd"), CHANNEL, "--socket", str(path),
            "--config", str(HERE / "simulated.toml"),
        )  # fmt: skip
        if not any("listening" in line for line in lines_of("daemon", daemon)):
            print("the daemon did not begin")
            return 1
        watcher = begin(
            f"python examples/watch_state.py --channel {CHANNEL}",
            sys.executable, str(HERE / "watch_state.py"), "--channel", CHANNEL,
            "--socket", str(path),
        )  # fmt: skip
        watched: list[str] = []
        begun = Event()

        def watch() -> None:
            for line in lines_of("watcher", watcher):
                watched.append(line)
                begun.set()

        # A thread, so that each line is shown when it comes.
        watching = Thread(target=watch, daemon=True)
        stack.callback(watching.join, ENDS_WITHIN_S)
        stack.callback(watcher.terminate)
        watching.start()
        begun.wait(ENDS_WITHIN_S)
        mover = begin(
            f"python examples/hold_on.py --channel {CHANNEL}",
            sys.executable, str(HERE / "hold_on.py"), "--channel", CHANNEL, "--socket", str(path),
            "--hold", "1.5",
        )  # fmt: skip
        outcomes = follow(mover, simulate)
    seen = {
        "the object was lost": "object_lost" in outcomes,
        "it was held again": outcomes[-1:] == ["object_held"],
        "the watcher saw the grasps": any("grasp" in line for line in watched),
        "the mover ended well": mover.returncode == 0,
        "the daemon ended well": daemon.returncode == 0,
    }
    for what, happened in seen.items():
        if not happened:
            print(f"NOT so: {what}")
    if all(seen.values()):
        print("\nThe demo worked: an object was grasped, lost, and grasped again.")
    return 0 if all(seen.values()) else 1


def follow(mover: subprocess.Popen[bytes], simulate: Callable[..., bool]) -> list[str]:
    """Take the object away while it is held, and give it back; return how the grasps ended.

    On a busy machine the jaws may be where it was before it is back: then once they open again.
    """
    outcomes: list[str] = []
    taken = given = False
    for line in lines_of("mover", mover):
        text = line.strip()
        if text.startswith("hold ") and not taken:
            if sys.stdout.isatty():
                print(flush=True)  # leave the line of the bar
            taken = simulate("object", "none")
        elif "mm open" in text and taken and not given:
            given = simulate("object", "40")
        if text.startswith(("object_", "no_object")):
            outcomes.append(text.partition(",")[0])
    mover.wait(ENDS_WITHIN_S)
    return outcomes


if __name__ == "__main__":
    try:
        sys.exit(main())
    except KeyboardInterrupt:
        sys.exit(130)
