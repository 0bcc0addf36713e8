"""One daemon with a simulated gripper and two processes: one moves the jaws, the other watches.

Ends by itself, with exit code 0 when the first opened and closed and the second saw both.
"""

import signal
import subprocess
import sys
import tempfile
import threading
from pathlib import Path
from typing import IO

CHANNEL = "demo"
CONFIG = """
[bus]
interface = "litegrip_sim"
watchdog_s = 0.4  # a busy machine may stop all processes for longer than the usual 0.1 s

[gripper]
mount = "normal"
"""
START_WITHIN_S = 15.0
HERE = Path(__file__).parent


def start(title: str, *command: str) -> subprocess.Popen[str]:
    """Start a process whose output we show."""
    print(f"$ {title}", flush=True)
    return subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, bufsize=1
    )


def show(name: str, stream: IO[str], seen: list[str]) -> threading.Thread:
    """Show what a process prints, each line with its name, as it comes."""

    def copy() -> None:
        for line in stream:
            seen.append(line)
            print(f"{name:>7} | {line.rstrip().rpartition(chr(13))[2]}", flush=True)

    thread = threading.Thread(target=copy)
    thread.start()
    return thread


def wait_for_socket(path: Path, daemon: subprocess.Popen[str], lines: list[str]) -> None:
    """Wait until the daemon says where it listens."""
    if daemon.stdout is None:
        raise RuntimeError("the daemon's output is not read")
    for line in daemon.stdout:
        lines.append(line)
        print(f"{'daemon':>7} | {line.rstrip()}", flush=True)
        if str(path) in line and "listening" in line:
            return
    raise RuntimeError(f"the daemon ended before it listened on {path}")


def main() -> int:
    """Run the demo; return the exit code."""
    programs = Path(sys.executable).parent
    logs: dict[str, list[str]] = {"daemon": [], "mover": [], "watcher": []}
    with tempfile.TemporaryDirectory(prefix="litegripd-demo-") as folder:
        path = Path(folder) / "demo.sock"
        config = Path(folder) / "demo.toml"
        config.write_text(CONFIG, encoding="utf-8")
        daemon = start(
            f"litegripd {CHANNEL} --config {config}",
            str(programs / "litegripd"), CHANNEL, "--config", str(config), "--socket", str(path),
        )  # fmt: skip
        wait_for_socket(path, daemon, logs["daemon"])
        processes, threads = {"daemon": daemon}, []
        for name, script in (("watcher", "watch_state.py"), ("mover", "open_close.py")):
            processes[name] = start(
                f"python examples/{script} --channel {CHANNEL}",
                sys.executable, str(HERE / script), "--channel", CHANNEL, "--socket", str(path),
            )  # fmt: skip
        for name, process in processes.items():
            if process.stdout is not None:
                threads.append(show(name, process.stdout, logs[name]))
        moved = processes["mover"].wait(timeout=60)
        processes["watcher"].send_signal(signal.SIGINT)
        processes["watcher"].wait(timeout=10)
        daemon.send_signal(signal.SIGTERM)
        ended = daemon.wait(timeout=10)
        for thread in threads:
            thread.join()
    watched = "".join(logs["watcher"])
    complaints = [
        complaint
        for wrong, complaint in (
            (moved != 0, f"the mover ended with {moved}"),
            (ended != 0, f"the daemon ended with {ended}"),
            ("moving    open" not in watched, "the watcher did not see the opening"),
            ("moving    close" not in watched, "the watcher did not see the closing"),
        )
        if wrong
    ]
    print("\n" + ("; ".join(complaints) or "The demo worked: one gripper, two processes."))
    return 1 if complaints else 0


if __name__ == "__main__":
    sys.exit(main())
