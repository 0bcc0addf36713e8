"""The drop-in client and whole daemons in one virtual time: what a user's script sees and does.

The client is the real one down to its socket. In place of that stands `VirtualStream`, which hands
lines to a daemon's RPC service and lets time pass while the client waits; its clock is the site's.
No sockets, and threads that take turns: the same script gives the same result every time.
"""

import json
import os
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace

import pytest

from litegrip_client import LiteGrip
from litegrip_client.core.sockets import SYSTEM_DIRECTORY
from litegrip_client.line.connection import SLICE_S, StreamEndedError
from litegripd.app.build import build_service, load_at_start
from litegripd.app.config import Config
from litegripd.app.helper_main import OPERATIONS
from litegripd.app.status import DaemonFacts
from litegripd.model.gripper import GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import BusSettings, MitCommand, MotorPhase
from litegripd.model.state import HelperTask, TaskResult
from litegripd.motor import codec
from litegripd.rpc.service import RpcService
from litegripd.rpc.sessions import Peer
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from litegripd.teleop.link import Links
from tests.turns import Turns
from tests.world import CAN_ID, PERIOD_S, Disk, World, is_command

_CLOCKED = (
    *("core.motion", "core.session", "core.trajectories", "line.connection", "line.exchange"),
    *("line.latest", "threads.blocking", "threads.sdk_gripper", "values.results"),
)
"""The client's modules that read a clock, or wait by it."""


class RealDisk(Disk):
    """Files as the daemon's helper process reads and writes them.

    `home` is that of the user whom the daemon runs as, the script's by default.
    """

    def __init__(self, home: Path | None = None) -> None:
        super().__init__()
        self._home = home

    def do(self, task: HelperTask) -> TaskResult:
        with pytest.MonkeyPatch.context() as patch:
            patch.delenv("LITEGRIP_CALIB", raising=False)  # the script's, not the daemon's
            if self._home is not None:
                patch.setenv("HOME", str(self._home))
            return self._do(task)

    def _do(self, task: HelperTask) -> TaskResult:
        try:
            parameters = json.loads(json.dumps(task.parameters))
            return TaskResult(json.loads(json.dumps(OPERATIONS[task.operation](parameters))))
        except (OSError, ValueError) as error:
            return TaskResult(error=f"{type(error).__name__}: {error}")


class Daemon(World):
    """One channel's daemon and the gripper on its bus.

    `mount` is how the gripper is built. `calibrated` gives the daemon its exact calibration;
    without, it has none, and with `boots` it takes what it finds in its files, as it does in life.
    `gripper` is one that another daemon has driven before; `home` that of the daemon's own user.
    Over `links` that two daemons share they teleoperate.
    """

    def __init__(
        self,
        channel: str = "can0",
        mount: str = "normal",
        *,
        calibrated: bool = True,
        boots: bool = False,
        config: MotionConfig | None = None,
        parameters: SimulatorParameters | None = None,
        gripper: SimulatedGripper | None = None,
        home: Path | None = None,
        links: Links | None = None,
    ) -> None:
        self.mount = mount
        self._channel, self._home, self._links = channel, home, links
        super().__init__(mount, calibrated and not boots, config, parameters)
        if gripper is not None:
            self.gripper = gripper
        if boots:
            load_at_start(self.controller, lambda: None)

    def make_service(self) -> RpcService:
        self.controller.gripper_id = GripperId(self._channel)
        settings = BusSettings("virtual", self._channel, 1_000_000)
        facts = DaemonFacts(Config(self._channel, settings), self.machine)
        return build_service(self.controller, facts, PERIOD_S, dumps=self.dumps, links=self._links)

    def make_disk(self) -> Disk:
        return RealDisk(self._home)

    @property
    def closing_torque_nm(self) -> float:
        """The torque that the motor really makes, positive when it squeezes."""
        return self.gripper.motor_torque_nm * self.gripper.parameters.close_sign

    @property
    def is_energised(self) -> bool:
        """True if the motor itself says that it is enabled."""
        return self.gripper.motor.status == 1

    def command_now(self) -> MitCommand | None:
        """Return what the motor was told in this period."""
        for sent in reversed(self.sent):
            if sent.at_s != self.now_s:
                break
            if sent.frame.can_id == CAN_ID and is_command(sent.frame):
                return codec.decode_command(sent.frame.data, self.ranges)
        return None


class VirtualStream:
    """Stands in for the client's `LineStream`, whose methods these are."""

    peer_pid = 0

    def __init__(self, site: "Site", daemon: Daemon) -> None:
        peer = Peer(os.getpid(), os.getuid(), os.getgid(), "script")
        self._site = site
        self._daemon = daemon
        self._session = daemon.service.opened(peer, site.now_s)
        self._received = b""
        self.hung_up = False

    def send(self, line: bytes, _timeout_s: float) -> None:
        if self.hung_up:
            raise BrokenPipeError("the daemon has ended the connection")
        for one in line.splitlines():
            self._daemon.service.handle(self._session, one, self._site.now_s)

    def receive(self, wait_s: float) -> tuple[list[bytes], bytes]:
        """Let time pass until there is a line."""
        self._site.turns.wait(lambda: self._take() or self.hung_up, min(wait_s, SLICE_S))
        if self.hung_up and not self._received:
            raise StreamEndedError
        *lines, rest = self._received.split(b"\n")
        return lines, rest

    @property
    def has_more(self) -> bool:
        return bool(self._session.outgoing) or self.hung_up

    def _take(self) -> bool:
        self._received += b"".join(self._session.outgoing)
        self._session.outgoing.clear()
        return bool(self._received)

    def keep(self, rest: bytes) -> None:
        self._received = rest

    def close(self, *, shared: bool = False) -> None:
        """End the connection, as the kernel does when its process is gone."""
        if not self.hung_up and not shared:
            self.hung_up = True
            self._daemon.service.closed(self._session, self._site.now_s)


@dataclass(frozen=True, slots=True)
class Moment:
    """One period: what the daemon last measured and commanded, and what was true of the jaws."""

    at_s: float
    measured_rad: float
    command: MitCommand | None
    position_rad: float
    opening_mm: float
    closing_torque_nm: float


class Site:
    """A machine with a daemon per channel, whose time passes only while everybody waits."""

    def __init__(self) -> None:
        self.now_s = 1000.0
        self.turns = Turns(self.tick, lambda: self.now_s)
        self._daemons: dict[str, Daemon] = {}
        self._plans: list[tuple[Callable[[], bool], Callable[[], object]]] = []
        self._watchers: list[Callable[[], None]] = []

    def add(self, daemon: Daemon) -> Daemon:
        """Let a daemon run on its channel, in place of any other; its motor has been found."""
        daemon.now_s = self.now_s
        self._daemons[daemon.controller.gripper_id.channel] = daemon
        self.run_until(lambda: daemon.phase is MotorPhase.DISABLED, 2.0)
        return daemon

    def leave(self, channel: str) -> None:
        """Go on on another machine: there a script finds another daemon on `channel`, if any."""
        self._daemons[f"another machine's {channel}"] = self._daemons.pop(channel)

    def tick(self) -> None:
        """Let one period pass everywhere; then do what was planned for this moment."""
        self.now_s += PERIOD_S
        for daemon in self._daemons.values():
            daemon.tick()
        for watch in self._watchers:
            watch()
        due = [plan for plan in self._plans if plan[0]()]
        self._plans = [plan for plan in self._plans if plan not in due]
        for _, action in due:
            action()

    def run(self, duration_s: float) -> None:
        """Let time pass, to the nearest period."""
        self.turns.sleep(round(duration_s / PERIOD_S) * PERIOD_S)

    def run_until(self, condition: Callable[[], bool], within_s: float = 20.0) -> None:
        """Let time pass until a condition holds; fail when it does not within a while."""
        assert self.turns.wait(condition, within_s), f"did not happen within {within_s} s"

    def when(self, condition: Callable[[], bool], action: Callable[[], object]) -> None:
        """Do something once, as soon as a condition holds; it may raise, in a waiting call."""
        self._plans.append((condition, action))

    def after(self, delay_s: float, action: Callable[[], object]) -> None:
        """Do something once, after a while."""
        due_s = self.now_s + delay_s
        self.when(lambda: self.now_s >= due_s, action)

    def kill(self, gripper: LiteGrip) -> None:
        """Let the script of this object die, without any more code of its own."""
        stream = gripper._session.connection._multiplexer._stream
        assert isinstance(stream, VirtualStream)
        stream.close()

    @contextmanager
    def recorded(self, daemon: Daemon) -> Iterator[list[Moment]]:
        """Record every period until the end of the block."""
        moments: list[Moment] = []

        def note() -> None:
            feedback, gripper = daemon.controller.motor.feedback, daemon.gripper
            assert feedback is not None
            moments.append(
                Moment(
                    self.now_s,
                    feedback.position_rad,
                    daemon.command_now(),
                    gripper.position_rad,
                    gripper.opening_mm,
                    daemon.closing_torque_nm,
                )
            )

        self._watchers.append(note)
        try:
            yield moments
        finally:
            self._watchers.remove(note)

    def open_stream(self, path: str, _timeout_s: float) -> VirtualStream:
        """Connect a client to the daemon whose socket would be at `path`."""
        at = Path(path)
        daemon = self._daemons.get(at.stem) if str(at.parent) == SYSTEM_DIRECTORY else None
        if daemon is None:
            raise FileNotFoundError(2, "No such file or directory", path)
        return VirtualStream(self, daemon)


@contextmanager
def a_site(
    home: Path, environment: Mapping[str, str] | None = None, site: Site | None = None
) -> Iterator[Site]:
    """Give a machine of its own to the client: its daemons, its clock, and its user's `home`."""
    site = Site() if site is None else site
    clock = SimpleNamespace(monotonic=lambda: site.now_s, sleep=site.turns.sleep, time=time.time)
    with pytest.MonkeyPatch.context() as patch:
        for name in (
            "LITEGRIPD_SOCKET",
            "LITEGRIP_CALIB",
            "LITEGRIP_TRAJ_DIR",
            "XDG_RUNTIME_DIR",
        ):
            patch.delenv(name, raising=False)
        patch.setenv("HOME", str(home))
        patch.setenv("STATE_DIRECTORY", str(home / "state"))
        for name, value in (environment or {}).items():
            patch.setenv(name, value)
        for module in _CLOCKED:
            patch.setattr(f"litegrip_client.{module}.time", clock)
        patch.setattr("litegrip_client.line.connection.LineStream", site.open_stream)
        for module in ("connection", "latest"):
            patch.setattr(f"litegrip_client.line.{module}.threading", site.turns.threading)
        with site.turns:
            yield site
