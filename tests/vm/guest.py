"""What the scenes in the virtual machine are made of: programs, a client, a witness, a verdict.

Daemon and simulator are the installed programs, candump is the witness of what is on the bus.
"""

import contextlib
import json
import signal
import socket
import subprocess
import threading
import time
import traceback
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

LOGS = Path("logs")
LIMIT_S = 60.0
TRIES = 8
REGISTERS, COMMANDS, FEEDBACK, MARKER = "7FF", "008", "018", "7FE"
DISABLE = "FFFFFFFFFFFFFFFD"
ENABLE = "FFFFFFFFFFFFFFFC"

pause = threading.Event()
failed: list[str] = []
stalls: list[str] = []


def check(what: str, passed: bool, detail: object = "") -> None:
    """Print PASS or FAIL with what was seen."""
    seen = f"  [{detail}]" if detail else ""
    print(f"{'PASS' if passed else 'FAIL'}  {what}{seen}", flush=True)
    if not passed:
        failed.append(what)


def play(scenes: Sequence[Callable[[], None]]) -> int:
    """Run scenes one after the other, whatever becomes of each; return 0 when all checks passed."""
    check("there is a scene to run", bool(scenes), len(scenes))
    for scene in scenes:
        print(f"----  {scene.__doc__}", flush=True)
        began_s = time.monotonic()
        try:
            scene()
        except Exception:  # noqa: BLE001 - the other scenes still have something to tell
            check(f"{scene.__name__} runs to its end", False, traceback.format_exc())
        print(f"      {time.monotonic() - began_s:.0f} s", flush=True)
    print(f"      repeated after a stall of the machine: {stalls or 'nothing'}", flush=True)
    print(f"{len(failed)} checks failed" if failed else "all checks passed", flush=True)
    return 1 if failed else 0


def reaches(is_true: Callable[[], bool], limit_s: float = LIMIT_S) -> bool:
    """Look until it is true, at most `limit_s`."""
    deadline_s = time.monotonic() + limit_s
    while not is_true():
        if time.monotonic() > deadline_s:
            return False
        pause.wait(0.05)
    return True


class Rpc:
    """A connection to a daemon's socket: one request, one answer."""

    def __init__(self, channel: str) -> None:
        self._socket = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        self._socket.settimeout(LIMIT_S)
        self._socket.connect(f"/run/litegripd/{channel}.sock")
        self._lines = self._socket.makefile("rb")
        self._next_id = 0

    def call(self, method: str, **params: object) -> dict[str, Any]:
        """Return the result; an error answer is returned as {"error": ...}."""
        self._next_id += 1
        request = {"jsonrpc": "2.0", "id": self._next_id, "method": method, "params": params}
        self._socket.sendall(json.dumps(request).encode() + b"\n")
        for line in self._lines:
            answer: dict[str, Any] = json.loads(line)
            if answer.get("id") == self._next_id:
                result: dict[str, Any] = answer.get("result", {"error": answer.get("error")})
                return result
        raise ConnectionError(f"the daemon closed the connection before it answered {method}")

    def state(self) -> dict[str, Any]:
        """Return the gripper's state."""
        return self.call("state.get")

    def motor_is(self, phase: str) -> bool:
        """True if the motor is in this phase now."""
        return bool(self.state()["motor"] == phase)

    def insist(self, method: str, **params: object) -> dict[str, Any]:
        """Call; try again when the motor is said to be silent, for the machine itself stalls."""
        answer: dict[str, Any] = {}
        for _ in range(TRIES):
            if method != "motor.enable" and not self.motor_is("enabled"):
                self.call("motor.enable")
            answer = self.call(method, **params)
            error = answer.get("error") or {}
            if error.get("data", {}).get("reason") not in ("motor_silent", "not_enabled"):
                break
            stalls.append(method)
            reaches(lambda: self.state()["motor"] in ("enabled", "disabled", "fault"))
        return answer

    def bus_is(self, state: str) -> bool:
        """True if the bus is in this state now."""
        return bool(self.call("health")["bus"]["state"] == state)

    def close(self) -> None:
        """Close the connection."""
        self._lines.close()
        self._socket.close()


class Program:
    """A program in the background, with a log file; ended by SIGTERM."""

    _count = 0

    def __init__(self, *command: str) -> None:
        Program._count += 1
        self.log = LOGS / f"{Program._count:02}-{command[0]}.log"
        with self.log.open("wb") as log:
            self._process = subprocess.Popen(command, stdout=log, stderr=subprocess.STDOUT)

    def said(self, text: str) -> bool:
        """True if the program has printed this."""
        return text in self.log.read_text()

    def end(self) -> int:
        """Send SIGTERM; return the exit status."""
        self._process.send_signal(signal.SIGTERM)
        return self._process.wait(LIMIT_S)

    @property
    def status(self) -> int | None:
        """The exit status, None while it runs."""
        return self._process.poll()


@contextlib.contextmanager
def running(*command: str) -> Iterator[Program]:
    """Run a program; end it if it has not ended by itself."""
    program = Program(*command)
    try:
        yield program
    finally:
        if program.status is None:
            program.end()


@contextlib.contextmanager
def simulator(channel: str, *options: str) -> Iterator[Program]:
    """Run a simulated motor on `channel`."""
    command = ("litegrip-sim", "--interface", "socketcan", "--channel", channel, *options)
    with running(*command) as program:
        if not reaches(lambda: program.said("serving on") or program.status is not None):
            raise TimeoutError("litegrip-sim does not serve")
        yield program


@contextlib.contextmanager
def daemon(channel: str) -> Iterator[tuple[Program, Rpc]]:
    """Run a daemon on `channel`, with a client of it."""
    with running("litegripd", channel) as program:
        if not reaches(lambda: program.said("listening on") or program.status is not None):
            raise TimeoutError("litegripd does not listen")
        with contextlib.closing(Rpc(channel)) as rpc:
            yield program, rpc


class Witness:
    """candump on one interface: (id, data) of every frame in the order of the bus."""

    def __init__(self, program: Program) -> None:
        self._log = program.log

    def frames(self) -> list[tuple[str, str]]:
        """Return what was on the bus so far; what candump itself has to say is left out."""
        lines = self._log.read_text().splitlines(keepends=True)
        whole = [line for line in lines if line.startswith("(") and line.endswith("\n")]
        frames = [line.split()[2].partition("#") for line in whole]
        return [(can_id, data) for can_id, _, data in frames if can_id != MARKER]

    def data(self, can_id: str) -> list[str]:
        """Return the data of the frames on one id."""
        return [data for its_id, data in self.frames() if its_id == can_id]


@contextlib.contextmanager
def witness(channel: str) -> Iterator[Witness]:
    """Record what is on `channel`."""
    with running("candump", "-L", channel) as program:

        def is_recording() -> bool:
            subprocess.run(["cansend", channel, f"{MARKER}#"], check=True)
            return program.said(f"{MARKER}#")

        if not reaches(is_recording):
            raise TimeoutError("candump does not record")
        yield Witness(program)


def ip(arguments: str) -> None:
    """Run `ip`."""
    subprocess.run(["ip", *arguments.split()], check=True)


def reasons(rpc: Rpc) -> str:
    """Say what health complains of, but for the machine's slowness."""
    told = rpc.call("health")["reasons"]
    return "; ".join(reason for reason in told if "start late" not in reason)


def figures(rpc: Rpc) -> str:
    """Say how the control thread fared in this slow machine."""
    health = rpc.call("health")
    control, motor = health["control"], health["motor"]
    return (
        f"{control['rate_hz']} Hz, {control['ticks']} ticks, {control['lost_ticks']} lost,"
        f" p99.9 late {control['lateness']['p99_9_us']} µs,"
        f" median tick {control['tick_cost']['p50_us']} µs; {motor}"
    )
