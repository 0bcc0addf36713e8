"""Runs `litegripd` as a process of its own, and speaks to it over raw sockets."""

import contextlib
import io
import json
import os
import re
import select
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any

from litegrip_client.ctl.main import main
from litegripd.io.helper.files import DATA
from litegripd.model.calibration import parse_calibration

SLCAN = """
[bus]
interface = "slcan"
channel = "{channel}"
sleep_after_open = 0
[gripper]
mount = "normal"
"""
"""The configuration of a daemon over SLCAN: `format` takes the channel, a path."""

BY_GATEWAY = f"[access]\ngateways = [{os.getuid()}]\n"
"""What lets a daemon be met through a portal, too."""

SIMULATED = f"""
[bus]
interface = "litegrip_sim"
watchdog_s = 0.4
[gripper]
mount = "normal"
{BY_GATEWAY}"""
"""The configuration of a daemon with the simulated gripper, for remote users, too.

The motor's watchdog is as slow as motors have it: a busy machine may stop the daemon for longer
than the usual 0.1 s, and the motor then faults, as it must.
"""

WORK_MM = parse_calibration((DATA / "normal.json").read_text(encoding="utf-8")).work_stroke_mm
"""Where `open` goes with the calibration of these: that of a template."""

MODULE = ("-m", "litegripd.app.main")
"""The daemon as a module of this interpreter's."""

CTL = (sys.executable, "-m", "litegrip_client.ctl.main")
"""`litegripctl`, by this interpreter."""

START_MM = 60.0
"""Where the simulated gripper's jaws are when it begins."""

DEADLINE_S = 30.0

TICK_S = 0.005
"""The daemon's period, unless its configuration has another."""


class Client:
    """One connection; requests may be sent without reading their answers."""

    def __init__(self, path: Path) -> None:
        self.socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self.socket.settimeout(DEADLINE_S)
        try:
            self.socket.connect(str(path))
        except OSError:
            self.socket.close()
            raise
        self._file = self.socket.makefile("rb")
        self._last_id = 0
        self.answers: dict[int, dict[str, Any]] = {}

    def __enter__(self) -> "Client":
        return self

    def __exit__(self, *_exception: object) -> None:
        self.close()

    def close(self) -> None:
        self._file.close()
        self.socket.close()

    def send(self, method: str, **params: object) -> int:
        """Send a request; return its id."""
        self._last_id += 1
        request = {"jsonrpc": "2.0", "id": self._last_id, "method": method, "params": params}
        self.socket.sendall(json.dumps(request).encode() + b"\n")
        return self._last_id

    def read(self) -> dict[str, Any]:
        """Return the next message; an empty one means that the daemon has closed."""
        try:
            line = self._file.readline()
        except ConnectionResetError:
            return {}
        message: dict[str, Any] = json.loads(line) if line else {}
        return message

    def answer(self, number: int) -> dict[str, Any]:
        """Read until a request is answered."""
        while number not in self.answers:
            message = self.read()
            assert message, "the daemon has closed the connection"
            if message.get("id") is not None:
                self.answers[message["id"]] = message
        return self.answers[number]

    def call(self, method: str, **params: object) -> dict[str, Any]:
        """Send a request; return its whole answer."""
        return self.answer(self.send(method, **params))

    def result(self, method: str, **params: object) -> dict[str, Any]:
        """Call a method that is expected to succeed."""
        answer = self.call(method, **params)
        assert "result" in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def refusal(self, method: str, **params: object) -> str:
        """Call a method that is expected to be refused; return the reason."""
        answer = self.call(method, **params)
        assert "error" in answer, answer
        reason: str = answer["error"]["data"]["reason"]
        return reason

    def raw(self, line: bytes) -> dict[str, Any]:
        """Send bytes; return the next message."""
        self.socket.sendall(line)
        return self.read()

    def until(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Watch the state until a condition holds; return that state."""
        ends_s = time.monotonic() + DEADLINE_S
        while True:
            state = self.result("state.get")
            if condition(state):
                return state
            assert time.monotonic() < ends_s, f"did not happen in time: {state}"
            self.let_a_tick_pass()

    def despite_silence(self, method: str, **params: object) -> dict[str, Any]:
        """Call a method until it succeeds, enabling the motor anew where that is needed.

        A simulator in another process may be kept off the processor for longer than the daemon
        waits for answers; then a motion ends as it must, and the client asks again.
        """
        ends_s = time.monotonic() + DEADLINE_S
        while "result" not in (answer := self.call(method, **params)):
            reason = answer["error"]["data"]["reason"]
            assert reason in ("motor_silent", "motor_fault", "not_enabled", "not_confirmed"), answer
            assert time.monotonic() < ends_s, answer
            state = self.until(lambda s: bool(s["motor"] in ("disabled", "fault", "enabled")))
            if not state["enabled"]:
                self.call("motor.enable")
        result: dict[str, Any] = answer["result"]
        return result

    def until_health(self, condition: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """Watch the figures until a condition holds; return them."""
        ends_s = time.monotonic() + DEADLINE_S
        while True:
            health = self.result("health")
            if condition(health):
                return health
            assert time.monotonic() < ends_s, f"did not happen in time: {health}"
            self.let_a_tick_pass()

    def let_a_tick_pass(self) -> None:
        """Leave the processor to the daemon: it has nothing new to tell before its next tick."""
        select.select([self.socket], [], [], TICK_S)

    def enabled(self) -> "Client":
        """Wait for the motor, enable it, and return this client.

        It is enabled anew only where this busy machine has let the motor fall silent meanwhile.
        """
        self.until(lambda state: bool(state["motor"] == "disabled" and state["calibrated"]))
        while not (done := self.despite_silence("motor.enable"))["ok"]:
            assert done["state"]["motor"] in ("silent", "fault"), done
        return self


class DaemonProcess:
    """A running daemon; its errors go to a file, so that it waits for no reader, or to `log`.

    `on` is put in front of its command, and makes it run elsewhere.
    """

    remote_as: str | None = None
    """As whom the daemon knows this program, if that is by a portal."""

    def __init__(
        self,
        folder: Path,
        *arguments: str,
        log: int | None = None,
        program: tuple[str, ...] = MODULE,
        on: tuple[str, ...] = (),
    ) -> None:
        self.socket_path = folder / "rpc.sock"
        self.log_path = folder / "log.txt"
        environment = {**os.environ, "HOME": str(folder), "STATE_DIRECTORY": str(folder)}
        environment.pop("LITEGRIP_CALIB", None)
        with self.log_path.open("ab") as file:
            self.process = subprocess.Popen(
                [*on, sys.executable, *program, *arguments],
                stdin=subprocess.DEVNULL,
                stdout=file,
                stderr=file if log is None else log,
                env=environment,
            )

    @property
    def log(self) -> str:
        return self.log_path.read_text(encoding="utf-8")

    def connect(self) -> Client:
        """Connect to the daemon as soon as it listens."""
        ends_s = time.monotonic() + DEADLINE_S
        while True:
            assert self.process.poll() is None, f"the daemon has ended: {self.log}"
            assert time.monotonic() < ends_s, f"the daemon does not listen: {self.log}"
            try:
                return Client(self.socket_path)
            except (FileNotFoundError, ConnectionRefusedError):
                # Its standard error tells nothing earlier; a pidfd at least wakes at its end.
                self.wait_a_moment()

    def wait_a_moment(self) -> None:
        """Let the daemon work, but not beyond its end."""
        wait_a_moment(self.process)

    def end(self) -> None:
        """End it as an operator would; it must succeed, with the motor off or never heard of."""
        self.process.send_signal(signal.SIGTERM)
        assert self.process.wait(DEADLINE_S) == 0, self.log
        assert re.search(
            r"ended; (the motor is|it is not known whether the motor is) off", self.log
        )
        assert not self.socket_path.exists()

    def exit_code(self) -> int:
        """Wait for it to end by itself."""
        return self.process.wait(DEADLINE_S)

    def kill(self) -> None:
        """End it for certain."""
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait()


@contextlib.contextmanager
def daemon(folder: Path, *arguments: str, on: tuple[str, ...] = ()) -> Iterator[DaemonProcess]:
    """Run a daemon that must still be well at the end, and that then ends as it should."""
    folder.mkdir(exist_ok=True)
    running = DaemonProcess(folder, *arguments, "--socket", str(folder / "rpc.sock"), on=on)
    try:
        yield running
        running.end()
    finally:
        running.kill()


def written(folder: Path, config: str = SIMULATED) -> tuple[str, str]:
    """Write a configuration; return the arguments that have a daemon read it."""
    folder.mkdir(exist_ok=True)
    path = folder / "c.toml"
    path.write_text(config, encoding="utf-8")
    return "--config", str(path)


def configured(
    folder: Path, name: str, config: str = SIMULATED, on: tuple[str, ...] = ()
) -> contextlib.AbstractContextManager[DaemonProcess]:
    """Return a daemon with a configuration of this text, to be run as `daemon` does."""
    return daemon(folder, name, *written(folder, config), on=on)


@contextlib.contextmanager
def daemon_for_all(
    name: str, config: str = SIMULATED, prepare: Callable[[Path], object] = lambda _folder: None
) -> Iterator[DaemonProcess]:
    """Run a daemon to which every user of this machine may connect; root is its admin.

    `prepare` is given its folder before it starts.
    """
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        folder.chmod(0o755)
        prepare(folder)
        with configured(folder, name, config) as running:
            with running.connect() as client:
                client.until(lambda state: bool(state["motor"] == "disabled"))
                client.until(lambda state: bool(state["calibrated"]))
            for socket_path in folder.glob("*.sock"):
                socket_path.chmod(0o666)
            yield running


def begin_again(running: DaemonProcess) -> None:
    """Have a daemon be as at its beginning: no client, nothing stopped, disabled, half open.

    It has no trajectory, and a template of its mount. What it has counted and configured stays.
    """
    with running.connect() as client:
        client.until(lambda _state: not _others(client))
        client.result("stop", level="disable")
        client.result("sim.reset")
        client.result("stop.clear")
        mount = client.until(lambda state: bool(state["calibrated"]))["mount"]
        client.result("calibration.load", template=mount)
        for kept in client.result("trajectory.list")["trajectories"]:
            client.result("trajectory.delete", name=kept["name"])
        client.call("trajectory.record_stop", allow_partial=True)  # what a test has left unkept
        client.despite_silence("motion.move", opening_mm=START_MM, speed_mm_s=140)
        disable(client)


def _stays(client: Mapping[str, Any]) -> bool:
    """Return True for a gateway, and for a page's plots, whose one subscription is to states."""
    of_plots = client["program"] == "litegripd-web" and client["subscriptions"] == 1
    return bool(of_plots or client["program"] == "gateway")


def _others(client: Client) -> list[dict[str, Any]]:
    """Return the daemon's other clients, but for those that stay: a gateway, and a page's plots."""
    clients: list[dict[str, Any]] = client.result("clients.list")["clients"]
    return [one for one in clients if not one["is_me"] and not _stays(one)]


def disable(client: Client) -> None:
    """Disable the motor, also one that a busy machine has let fall silent meanwhile."""
    methods = {"enabled": "motor.disable", "fault": "motor.clear_fault"}

    def is_disabled(state: dict[str, Any]) -> bool:
        if state["motor"] in methods:
            client.call(methods[state["motor"]])
        return bool(state["motor"] == "disabled")

    client.until(is_disabled)


def litegripctl(running: DaemonProcess, *arguments: str) -> tuple[int, str]:
    """Run `litegripctl` in this process; return its exit code, and what it shows.

    It must not complain, unless what it was asked for cannot be done.
    """
    shown, complaint = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(shown), contextlib.redirect_stderr(complaint):
        code = main(["--socket", str(running.socket_path), *arguments])
    assert not complaint.getvalue() or code > 1
    return code, shown.getvalue()


def ran(
    *command: str, within_s: float = DEADLINE_S, **more: Any
) -> "subprocess.CompletedProcess[str]":
    """Run a program to its end, which comes in time; return its code, and what it wrote."""
    return subprocess.run(
        command, capture_output=True, text=True, timeout=within_s, check=False, **more
    )


def wait_a_moment(process: "subprocess.Popen[Any]") -> None:
    """Let a process work, but not beyond its end."""
    pidfd = os.pidfd_open(process.pid)
    try:
        select.select([pidfd], [], [], 0.01)
    finally:
        os.close(pidfd)


def kill_and_wait(process: "subprocess.Popen[str]") -> None:
    """Kill a process as the kernel's out-of-memory killer would."""
    process.kill()
    process.wait(DEADLINE_S)


def spawn(program: str, *arguments: str) -> "subprocess.Popen[str]":
    return subprocess.Popen(
        [sys.executable, "-c", program, *arguments],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )


@contextlib.contextmanager
def spawned(program: str, *arguments: str, says: str) -> Iterator["subprocess.Popen[str]"]:
    """Run a program until the block ends, which begins when it has said this."""
    with spawn(program, *arguments) as process:
        try:
            assert line_of(process) == says
            yield process
        finally:
            process.kill()


def line_of(process: "subprocess.Popen[str]") -> str:
    assert process.stdout is not None
    assert select.select([process.stdout], [], [], DEADLINE_S)[0]
    return process.stdout.readline().strip()
