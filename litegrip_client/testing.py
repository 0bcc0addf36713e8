"""A daemon on a simulated gripper, for the tests of a user's own program.

    from litegrip_client.testing import simulated

    def test_my_program_picks_it_up():
        with simulated(object_mm=40.0) as daemon, daemon.gripper() as gripper:
            gripper.enable()
            assert gripper.grasp(10.0, until="verdict")
            daemon.remove_object()
            ...

Each is a process of its own, with its own sockets and files in a temporary folder, so that tests
may run beside each other. With pytest, the fixture `simulated_gripper` is one: the gripper is
`simulated_gripper.gripper()`.
"""

from __future__ import annotations

import functools
import itertools
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, NoReturn, ParamSpec, TypeVar

from litegrip_client.line.connection import Connection
from litegrip_client.threads.gripper import LiteGrip
from litegrip_client.values.checks import number
from litegrip_client.values.errors import ConnectError
from litegrip_client.values.tracebacks import shortened
from litegrip_client.values.voices import misuse_of_function, no_attribute

_Arguments = ParamSpec("_Arguments")
_Made = TypeVar("_Made")

_CONFIG = """\
[bus]
interface = "litegrip_sim"
watchdog_s = {watchdog_s}
{more}

[gripper]
mount = "{mount}"

[motor]
type = "{motor_type}"
"""
_WATCHDOG_S = 0.4
"""The longest that the daemon allows: a busy machine may stop all processes for a while."""
_LOOK_EVERY_S = 0.02
_END_WITHIN_S = 10.0
_numbers = itertools.count(1)


@shortened
class SimulatedDaemon:
    """A running daemon, and the world around its gripper's jaws.

    What changes the world returns it as it really is (see `sim.get` in docs/protocol.md). Raises
    `ParameterError` for what cannot be, for example an object wider than the jaws are open.
    """

    def __init__(self, channel: str, socket_path: str) -> None:
        self.channel = channel
        self.socket_path = socket_path

    def __repr__(self) -> str:
        return f"<SimulatedDaemon {self.channel}, at {self.socket_path}>"

    if not TYPE_CHECKING:  # else a type checker would find every name here

        def __getattr__(self, name: str) -> NoReturn:
            """Say where the gripper is, for whose members this is easily taken."""
            if name.startswith("_") or not hasattr(LiteGrip, name):
                raise no_attribute(self, name)
            how = "with simulated_gripper.gripper() as gripper:"
            raise AttributeError(f"this is the daemon, and {name!r} its gripper's; use: {how}")

    def gripper(self, **settings: Any) -> LiteGrip:
        """Return a `LiteGrip` for this daemon; `settings` are further arguments of its."""
        return LiteGrip(self.channel, socket_path=self.socket_path, **settings)

    def world(self) -> dict[str, Any]:
        """Return the world as it really is; the state of a gripper is what its motor reports."""
        return self._call("sim.get")

    def put_object(
        self, width_mm: float, *, stiffness_nm_rad: float = 250.0, slip_mm_s: float = 0.0
    ) -> dict[str, Any]:
        """Put an object between the jaws: 1 to 5000 N·m/rad at the motor; 250 is rigid, 10 foam.

        With `slip_mm_s` it gives way at that speed while it is pressed.
        """
        return self._call(
            "sim.object",
            width_mm=width_mm,
            stiffness_nm_rad=stiffness_nm_rad,
            slip_mm_s=slip_mm_s,
        )

    def remove_object(self) -> dict[str, Any]:
        """Take away what is between the jaws."""
        return self._call("sim.object")

    def push(self, torque_nm: float) -> dict[str, Any]:
        """Push the jaws by a hand until the next push: positive closes, negative opens, 0 ends."""
        return self._call("sim.push", torque_nm=torque_nm)

    def hold(self) -> dict[str, Any]:
        """Hold the jaws fast where they are, until the next push or a reset."""
        return self._call("sim.hold")

    def fault(self, name: str) -> dict[str, Any]:
        """Let the motor report a fault: overload, coil_hot, ...; or be silent, or weak."""
        return self._call("sim.fault", name=name)

    def heat(self, coil_c: float) -> dict[str, Any]:
        """Let the motor's coil have a temperature, -50 to 300 °C; it then cools as ever."""
        return self._call("sim.heat", coil_c=coil_c)

    def reset(self) -> dict[str, Any]:
        """Take object, hand, heat and faults away."""
        return self._call("sim.reset")

    def _call(self, method: str, **params: Any) -> dict[str, Any]:
        with Connection(self.socket_path) as connection:
            return connection.call(method, params)


def _hinting(function: Callable[_Arguments, _Made]) -> Callable[_Arguments, _Made]:
    """Say what arguments there are where others are given."""

    @functools.wraps(function)
    def call(*arguments: _Arguments.args, **named: _Arguments.kwargs) -> _Made:
        try:
            return function(*arguments, **named)
        except TypeError as error:  # of the call itself: the block begins later
            text = misuse_of_function(function, arguments, named) or str(error)
        raise TypeError(text)

    return call


@_hinting
@contextmanager
def simulated(
    *,
    mount: str = "normal",
    object_mm: float | None = None,
    motor_type: str = "DM4310",
    mechanics: str | None = None,
    within_s: float = 20.0,
) -> Iterator[SimulatedDaemon]:
    """Run a daemon on a simulated gripper until the end of the block.

    The jaws are 60 mm open and the motor is disabled; `object_mm` is the width of what is between
    them. `mechanics` is "mujoco", or "mujoco:" and the absolute path of a scene. Raises
    `ConnectError` when the program `litegripd` is missing, or when the daemon does not serve
    clients `within_s`; its log is then in the message.
    """
    width_mm = None if object_mm is None else number("object_mm", object_mm)
    program = shutil.which("litegripd", path=str(Path(sys.executable).parent)) or shutil.which(
        "litegripd"
    )
    if program is None:
        text = "there is no program litegripd: install the package whole, not only litegrip_client"
        raise ConnectError(text, reason="no_daemon")
    with tempfile.TemporaryDirectory(prefix="litegripd-") as folder:
        channel, path = f"sim{os.getpid()}-{next(_numbers)}", Path(folder) / "rpc.sock"
        config, log = Path(folder) / "config.toml", Path(folder) / "log"
        given = {"object_mm": width_mm, "mechanics": mechanics}
        config.write_text(
            _CONFIG.format(
                watchdog_s=_WATCHDOG_S,
                more="\n".join(
                    f"{key} = {json.dumps(value)}"
                    for key, value in given.items()
                    if value is not None
                ),
                mount=mount,
                motor_type=motor_type,
            ),
            encoding="utf-8",
        )
        command = [program, channel, "--config", str(config), "--socket", str(path)]
        with log.open("wb") as output:
            process = subprocess.Popen(
                command,
                stdin=subprocess.DEVNULL,
                stdout=output,
                stderr=subprocess.STDOUT,
                env={**os.environ, "STATE_DIRECTORY": folder, "HOME": folder},
            )
        try:
            with _ending_with_us(process):
                _wait(process, path, log, time.monotonic() + within_s)
                yield SimulatedDaemon(channel, str(path))
        finally:
            _end(process)


_WATCH = """\
import signal, sys
sys.stdin.buffer.read()
try:
    signal.pidfd_send_signal(int(sys.argv[1]), signal.SIGTERM)
except ProcessLookupError:
    pass
"""
"""Waits for the end of its input, which is the starter's end, however that comes."""


@contextmanager
def _ending_with_us(process: subprocess.Popen[bytes]) -> Iterator[None]:
    """Have the daemon ended also when this process is killed, and so ends nothing itself."""
    daemon = os.pidfd_open(process.pid)
    try:
        watch = subprocess.Popen(
            [sys.executable, "-I", "-S", "-c", _WATCH, str(daemon)],
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            pass_fds=(daemon,),
            start_new_session=True,  # it outlives Ctrl-C, and what ends a whole group
        )
    finally:
        os.close(daemon)
    try:
        yield
    finally:
        watch.kill()  # `_end` ends the daemon, and waits for it
        watch.communicate()


def _wait(process: subprocess.Popen[bytes], path: Path, log: Path, ends_s: float) -> None:
    """Wait until the daemon has served a request."""
    while True:
        try:
            with Connection(str(path)) as connection:
                connection.call("hello", {"client": "simulated"})
                return
        except (ConnectError, OSError) as error:
            if process.poll() is not None or time.monotonic() > ends_s:
                said = log.read_text(encoding="utf-8", errors="replace").strip()
                text = f"the simulated daemon does not answer; its log: {said or 'empty'}"
                raise ConnectError(text, reason="no_daemon") from error
        time.sleep(_LOOK_EVERY_S)


def _end(process: subprocess.Popen[bytes]) -> None:
    process.terminate()
    try:
        process.wait(_END_WITHIN_S)
    except subprocess.TimeoutExpired:
        process.kill()
        process.wait()
