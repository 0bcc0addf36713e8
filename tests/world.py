"""The daemon without its sockets, in virtual time: controller, motor, RPC service, gripper.

A scene moves time with `run` or `run_until`; nothing in it waits. The same scene gives the same
result every time.
"""

import json
import mmap
import shutil
import tempfile
import weakref
from bisect import bisect_left
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, ClassVar, TypeVar

from litegripd.app.build import build_service
from litegripd.app.machine import Machine
from litegripd.control.snapshot import GripperState
from litegripd.handover.state import OnRestart, OnRestarted, no_restart
from litegripd.io.helper.atomic_file import FileSystem
from litegripd.io.helper.files import load_operation, templates_operation
from litegripd.model.calibration import Calibration
from litegripd.model.errors import Refusal
from litegripd.model.gripper import DM4310, Geometry, GripperId, MotorType
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import (
    UP,
    CanFrame,
    Feedback,
    MitCommand,
    MotorIdentity,
    MotorPhase,
    Ranges,
)
from litegripd.model.state import Event, HelperTask, Job, TaskResult
from litegripd.motor import codec
from litegripd.recorder.files import Recording, read
from litegripd.recorder.recorder import Dumps, Recorder, memory_bytes, tick_slots
from litegripd.rpc.reports import Hello, Info, MotionFields
from litegripd.rpc.service import RpcService
from litegripd.rpc.sessions import Peer, Role, Session
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters, limits_of_mount
from litegripd.trajectories.store import Limits, TrajectoryStore
from tests.answers import described

PERIOD_S = 0.005
CAN_ID = 0x08
FRAME_TIME_S = 130e-6
Figure = TypeVar("Figure")


class FixedFacts:
    """Facts that need no daemon."""

    def hello(self) -> Hello:
        return {
            "daemon": "litegripd",
            "version": "0",
            "protocol": 1,
            "channel": "virtual",
            "pid": 1,
            "epoch": "0",
            "simulated": True,
            "stop_socket": None,
            "remote": None,
            "motor": {"type": "DM4310", "can_id": 8, "master_id": None, "serial": None},
            "gripper": {
                "calibrated": False,
                "mount": None,
                "travel_mm": None,
                "closed_rad": None,
                "open_rad": None,
                "rad_to_mm": None,
                "nm_to_n": None,
                "stroke_mm": 85.0,
                "work_stroke_mm": None,
                "kp": 100.0,
                "kd": 2.0,
            },
            "limits": {
                "rate_hz": 200.0,
                "max_line_bytes": 16_384,
                "max_connections": 256,
                "max_connections_per_uid": 64,
            },
        }

    def health(self, now_s: float) -> dict[str, object]:
        return {"verdict": "ok", "at_s": now_s}

    def info(self) -> Info:
        return {
            **self.hello(),
            "registers": {},
            "motor_warnings": [],
            "calibration_file": None,
            "calibration": {
                "file": None,
                "nominal": False,
                "channel": None,
                "saved_s": None,
                "foreign": None,
                "work_stroke": None,
                "problem": None,
            },
            "motion": MotionFields(MotionConfig().as_fields(PERIOD_S)),
            "configuration": {
                "file": None,
                "bus": {"interface": "virtual", "channel": "virtual", "bitrate": 1_000_000},
                "control": {},
                "gripper": {"stroke_mm": 85.0, "calibration": None},
                "rpc": {"group": "litegrip"},
                "trajectories": {"most_per_user": 500, "most_mb_per_user": 500},
            },
        }


@dataclass(slots=True)
class Sent:
    """One frame that the daemon sent, and when."""

    at_s: float
    frame: CanFrame


@dataclass(slots=True)
class Client:
    """A client of the service: sends requests, keeps what it is sent."""

    is_checked: ClassVar[bool] = False
    world: "World"
    session: Session
    last_id: int = 0
    notifications: list[dict[str, Any]] = field(default_factory=list)
    answers: dict[int, dict[str, Any]] = field(default_factory=dict)
    asked: dict[int, str] = field(default_factory=dict)

    def send(self, method: str, **params: Any) -> int:
        """Send a request; return its id."""
        self.last_id += 1
        request = {"jsonrpc": "2.0", "id": self.last_id, "method": method, "params": params}
        self.asked[self.last_id] = method
        self.world.service.handle(self.session, json.dumps(request).encode(), self.world.now_s)
        return self.last_id

    def notify(self, method: str, **params: Any) -> None:
        """Send a request that gets no answer."""
        line = {"jsonrpc": "2.0", "method": method, "params": params}
        self.world.service.handle(self.session, json.dumps(line).encode(), self.world.now_s)

    def read(self) -> None:
        """Take what has been written to this client; where that is checked, all as described."""
        for line in self.session.outgoing:
            message = json.loads(line)
            method = self.asked.get(message.get("id"))
            if self.is_checked and method != "health":  # `FixedFacts` make a figure of their own
                described().check(message, method)
            if "method" in message:
                self.notifications.append(message)
            else:
                self.answers[message["id"]] = message
        self.session.outgoing.clear()

    def has_answer(self, number: int) -> bool:
        """True if a request has been answered."""
        self.read()
        return number in self.answers

    def answered(self, number: int) -> dict[str, Any]:
        """Return the whole answer to a request that has been answered by now."""
        assert self.has_answer(number), "there is no answer yet"
        return self.answers[number]

    def told(self, method: str) -> list[dict[str, Any]]:
        """Return the parameters of this client's notifications of one kind so far."""
        self.read()
        return [told["params"] for told in self.notifications if told["method"] == method]

    def events(self, *kinds: str) -> list[dict[str, Any]]:
        """Return the events that this client was sent, of these kinds or of all."""
        return [event for event in self.told("event") if not kinds or event["kind"] in kinds]

    def wait(self, number: int, within_s: float = 20.0) -> dict[str, Any]:
        """Let time pass until a request is answered; return the whole answer."""
        self.world.run_until(lambda: self.has_answer(number), within_s)
        return self.answers[number]

    def track(self, number: int, figure: Callable[[], Figure]) -> list[Figure]:
        """Let time pass until a request is answered; return what a figure was after each tick."""
        figures = []
        while not self.has_answer(number):
            self.world.tick()
            figures.append(figure())
        return figures

    def call(self, method: str, within_s: float = 20.0, **params: Any) -> dict[str, Any]:
        """Send a request and let time pass until it is answered; return the whole answer."""
        return self.wait(self.send(method, **params), within_s)

    def result(self, method: str, **params: Any) -> dict[str, Any]:
        """Call a method that is expected to succeed; return its result."""
        answer = self.call(method, **params)
        assert "result" in answer, answer
        result: dict[str, Any] = answer["result"]
        return result

    def refusal(self, method: str, **params: Any) -> str:
        """Call a method that is expected to be refused; return the stable reason."""
        return reason_of(self.call(method, **params))

    def refused(self, method: str, reason: str, /, *words: str, **params: Any) -> dict[str, Any]:
        """Call a method that is expected to be refused, in these words; return the data of it."""
        answer = self.call(method, **params)
        assert reason_of(answer) == reason
        for text in words:
            assert text in answer["error"]["message"]
        data: dict[str, Any] = answer["error"]["data"]
        return data

    def leave(self) -> None:
        """End the connection, as a crash or a kill would."""
        self.world.service.closed(self.session, self.world.now_s)


def reason_of(answer: dict[str, Any]) -> str:
    """Return the stable reason of an answer that is expected to be a refusal."""
    assert "error" in answer, answer
    reason: str = answer["error"]["data"]["reason"]
    return reason


class Unsynced(FileSystem):
    """Files that need not outlive a power cut, and so wait for no disk."""

    def sync(self, descriptor: int) -> None:
        pass

    def sync_directory(self, directory: Path) -> None:
        pass


class Disk:
    """The helper process's files, in memory: what was saved last, by operation."""

    def __init__(self, period_s: float = PERIOD_S) -> None:
        self.saved: dict[str, Any] = {}
        self.error: str | None = None
        self.silent = False
        self.found: dict[str, Any] | None = None
        # Zeros that cost nothing until they are written: most worlds do not fill a minute.
        self.memory = mmap.mmap(-1, memory_bytes(tick_slots(period_s)))
        self.dumps: list[Recording] = []
        self._folder: Path | None = None
        self._store = TrajectoryStore(self.trajectories, Unsynced(), clock=lambda: 1e9)

    def trajectories(self) -> Path:
        """Return where trajectories are kept: they alone are real files, gone with this world."""
        if self._folder is None:
            self._folder = Path(tempfile.mkdtemp())
            weakref.finalize(self, shutil.rmtree, self._folder, ignore_errors=True)
        return self._folder / "trajectories"

    def limit(self, limits: Limits) -> None:
        """Have another helper process, whose users may have no more than this."""
        self._store = TrajectoryStore(self.trajectories, Unsynced(), lambda: 1e9, limits)

    def do(self, task: HelperTask) -> TaskResult:
        """Carry out one helper task."""
        operation, parameters = task.operation, task.parameters
        if self.error is not None:
            return TaskResult(error=self.error)
        if operation == "calibration.load":
            return TaskResult(load_operation(parameters) if self.found is None else self.found)
        if operation == "calibration.templates":
            return TaskResult(templates_operation(parameters))
        packed = json.dumps(parameters)  # as it goes to the helper
        if operation.startswith("trajectory."):
            return TaskResult(self.do_plainly(operation, **json.loads(packed)))
        if operation == "recorder.dump":
            return TaskResult(self._dump())
        self.saved[operation] = parameters
        return TaskResult({"path": f"/state/{operation}", "previous": None, "saved_s": 1.6e9})

    def _dump(self) -> dict[str, Any]:
        recording = read(bytes(self.memory))
        self.dumps.append(recording)
        path = f"/state/dumps/{len(self.dumps)}"
        return {
            "path": path,
            "ticks": len(recording.ticks),
            "seconds": recording.duration_s,
            "bytes": len(self.memory),
        }

    def do_plainly(self, operation: str, **parameters: Any) -> Any:
        """Carry out an operation on trajectories; return its answer, without the true path."""
        answer = self._store.operations()[operation](parameters)
        return json.loads(json.dumps(answer).replace(str(self.trajectories().parent), "/state"))


class World:
    """One daemon and one simulated gripper on a virtual bus with a virtual clock.

    `figures` are those of the simulator that differ from a gripper of this mount and motor.
    """

    def __init__(
        self,
        mount: str = "normal",
        calibrated: bool = True,
        config: MotionConfig | None = None,
        parameters: SimulatorParameters | None = None,
        master_id: int | None = None,
        period_s: float = PERIOD_S,
        motor_type: MotorType = DM4310,
        **figures: Any,
    ) -> None:
        closed_rad, open_rad = limits_of_mount(mount)
        if parameters is None:
            nominal = SimulatorParameters(closed_rad=closed_rad, open_rad=open_rad)
            parameters = replace(nominal.of_motor(motor_type), **figures)
        self.period_s = period_s
        self.now_s = 1000.0
        self.gripper = self.make_gripper(parameters)
        self.machine = Machine(
            GripperId(motor_type=motor_type), master_id, config or MotionConfig(), period_s
        )
        self.controller = self.machine.controller
        self.restart: OnRestart = no_restart
        self.dumps = Dumps(self.controller)
        self.service = self.make_service()
        self.sent: list[Sent] = []
        self.condition = UP
        self.lose_to_motor: Callable[[CanFrame], bool] = lambda _frame: False
        self.lose_from_motor: Callable[[CanFrame], bool] = lambda _frame: False
        self._in_flight: list[CanFrame] = []
        self.disk = self.make_disk()
        self.recorder = self.make_recorder()
        self._finished: list[tuple[HelperTask, TaskResult]] = []
        self._last_pid = 100
        if calibrated:
            geometry = Geometry(closed_rad, open_rad, parameters.rad_to_mm)
            self.controller.use_calibration(Calibration(geometry), None)

    def make_service(self) -> RpcService:
        """Make what answers clients."""
        return build_service(
            self.controller, FixedFacts(), self.period_s, dumps=self.dumps, restart=self._restart
        )

    def make_disk(self) -> Disk:
        """Make the files of the helper process."""
        return Disk(self.period_s)

    def _restart(self, on_restarted: OnRestarted) -> Refusal | None:
        return self.restart(on_restarted)

    def client(self, *, pid: int | None = None, uid: int = 1000, role: Role = "admin") -> Client:
        """Let a new client connect, of a process of its own where no `pid` is given."""
        self._last_pid += 1
        peer = Peer(pid or self._last_pid, uid, 1000, f"program{pid or self._last_pid}")
        client = Client(self, self.service.opened(peer, self.now_s))
        client.session.role = role
        return client

    def tick(self) -> None:
        """Let one period pass."""
        self.tick_after(self.period_s)

    def tick_after(self, after_s: float) -> None:
        """Let the part of a period pass after which a stop hastens the next tick."""
        self.now_s += after_s
        self.advance()
        self.exchange()
        self.service.after_tick(self.now_s)
        self.record()
        self._send_tasks()
        while self.service.pending:
            self.service.send_one()

    def make_recorder(self) -> Recorder:
        """Make the flight recorder of the present machine."""
        slots = tick_slots(self.period_s)
        recorder = Recorder(memoryview(self.disk.memory), slots, {"channel": "virtual"})
        self.service.on_event = recorder.event
        return recorder

    def record(self) -> None:
        """Record the present tick."""
        bus_is_up = self.controller.bus.is_usable
        self.recorder.tick(
            self.now_s,
            self.controller,
            self.machine.motor,
            self.machine.take_sent(),
            late_s=0.0,
            lost_ticks=0,
            failed=False,
            bus_is_up=bus_is_up,
        )
        self.dumps.step(self.now_s, failed=False, bus_is_up=bus_is_up)

    def make_gripper(self, parameters: SimulatorParameters) -> SimulatedGripper:
        """Make the gripper that is on the bus."""
        return SimulatedGripper(parameters)

    def advance(self) -> None:
        """Let the gripper move until now."""
        self.gripper.advance(self.now_s)

    def exchange(self) -> None:
        """Let the machine take what the bus brought, and the motor what the machine sends."""
        received, self._in_flight = self._in_flight, []
        unasked = [frame for _, frame in self.gripper.take_unasked(self.now_s)]
        received += [frame for frame in unasked if not self.lose_from_motor(frame)]
        for frame in self.machine.tick(self.now_s, received, self.condition):
            self.sent.append(Sent(self.now_s, frame))
            if not self.lose_to_motor(frame):
                answers = self.gripper.receive(self.now_s + FRAME_TIME_S, frame)
                self._in_flight += [f for f in answers if not self.lose_from_motor(f)]

    def _send_tasks(self) -> None:
        """Do the slow work as the helper process would, with the result in the next tick."""
        tasks, self.controller.tasks = self.controller.tasks, []
        finished, self._finished = self._finished, []
        for task, result in finished:
            task.on_result(result)
        if not self.disk.silent:
            self._finished = [(task, self.disk.do(task)) for task in tasks]

    def inject(self, frame: CanFrame) -> None:
        """Let a frame arrive that the motor did not send."""
        self._in_flight.append(frame)

    def falsify_position(self, by_rad: float) -> None:
        """Let the motor's answer that is under way tell of another position."""
        answer = self._in_flight[-1]
        code = int.from_bytes(answer.data[1:3], "big")
        code += round(by_rad / (2.0 * self.ranges.position_rad) * 65535)
        data = answer.data[:1] + code.to_bytes(2, "big") + answer.data[3:]
        self._in_flight[-1] = CanFrame(answer.can_id, data)

    def run(self, duration_s: float) -> None:
        """Let time pass."""
        for _ in range(round(duration_s / self.period_s)):
            self.tick()

    def run_until(self, condition: Callable[[], bool | None], within_s: float = 20.0) -> None:
        """Let time pass until a condition holds; fail when it does not within a while."""
        ends_s = self.now_s + within_s
        while not condition():
            assert self.now_s < ends_s, f"did not happen within {within_s} s"
            self.tick()

    def track(self, duration_s: float, figure: Callable[[], Figure]) -> list[Figure]:
        """Let time pass; return what a figure was after each tick."""
        figures = []
        for _ in range(round(duration_s / self.period_s)):
            self.tick()
            figures.append(figure())
        return figures

    def start(self) -> "World":
        """Let the daemon find its motor."""
        self.run_until(lambda: self.phase is MotorPhase.DISABLED, 2.0)
        return self

    def enabled(self) -> Client:
        """Let a client find the motor and enable it; return the client."""
        self.start()
        client = self.client()
        assert client.result("motor.enable")["ok"]
        return client

    @property
    def phase(self) -> MotorPhase:
        """The motor's phase as the daemon knows it."""
        return self.machine.motor.view().phase

    def in_phase(self, *phases: MotorPhase) -> bool:
        """True if the motor is in one of these phases."""
        return self.phase in phases

    @property
    def state(self) -> GripperState:
        """The state that clients see now."""
        self.service.reporter.refresh()
        return self.service.reporter.state()

    @property
    def identity(self) -> MotorIdentity:
        """What the motor has told of itself, which a scene expects to be known."""
        identity = self.machine.motor.view().identity
        assert identity is not None
        return identity

    @property
    def geometry(self) -> Geometry:
        """The geometry of the calibration in use."""
        geometry = self.controller.geometry
        assert geometry is not None
        return geometry

    @property
    def running(self) -> Job:
        """The job that runs."""
        running = self.controller.jobs.running
        assert running is not None
        return running

    @property
    def measured(self) -> Feedback:
        """What the motor reported last."""
        feedback = self.controller.motor.feedback
        assert feedback is not None
        return feedback

    @property
    def wanted(self) -> MitCommand:
        """What was wanted of the motor in this tick, before it was limited."""
        requested = self.controller.output.requested
        assert requested is not None
        return requested

    @property
    def torque_nm(self) -> float:
        """The motor's true torque, whichever way it turns."""
        return abs(self.gripper.motor_torque_nm)

    @property
    def squeeze_nm(self) -> float:
        """The motor's true torque in the closing direction."""
        return self.gripper.parameters.close_sign * self.gripper.motor_torque_nm

    @property
    def clamp_range_n(self) -> tuple[float, float]:
        """Between what the state says that the object's force lies."""
        clamp_n = self.state.clamp_n
        assert clamp_n is not None
        return clamp_n

    @property
    def ranges(self) -> Ranges:
        """The ranges that the daemon codes its frames in."""
        identity = self.machine.motor.view().identity
        return DM4310.ranges if identity is None else identity.ranges

    def take_log(self) -> list[Event]:
        """Return what the daemon has to log since the last call."""
        events: list[Event] = []
        while portion := self.service.take_events():
            events += portion
        return events

    def own_frames(self, since_s: float = 0.0) -> list[bytes]:
        """Return what was sent to the motor's own id since a time."""
        return [sent.frame.data for sent in self.sent_since(since_s) if sent.frame.can_id == CAN_ID]

    def sent_since(self, since_s: float) -> list[Sent]:
        """Return what was sent since a time; it is asked in every tick of long scenes."""
        return self.sent[bisect_left(self.sent, since_s, key=lambda sent: sent.at_s) :]

    def commands_since(self, since_s: float) -> list[tuple[float, MitCommand]]:
        """Return the MIT commands that were sent since a time, decoded, with their times."""
        ranges = self.ranges
        return [
            (sent.at_s, codec.decode_command(sent.frame.data, ranges))
            for sent in self.sent_since(since_s)
            if sent.frame.can_id == CAN_ID and is_command(sent.frame)
        ]

    def longest_gap_s(self, since_s: float) -> float:
        """Return the longest time between two frames to the motor's own id since a time."""
        times = [s.at_s for s in self.sent_since(since_s) if s.frame.can_id == CAN_ID]
        times.append(self.now_s)
        return max(later - earlier for earlier, later in pairwise(times))


def enabled_world(**options: Any) -> tuple[World, Client]:
    """Return a world, and a client that has enabled its motor."""
    world = World(**options)
    return world, world.enabled()


def found_world(**options: Any) -> tuple[World, Client]:
    """Return a world whose motor has been found, and a client."""
    world = World(**options).start()
    return world, world.client()


def is_command(frame: CanFrame) -> bool:
    """True if a frame to the motor is an MIT command and not enable, disable, clear or zero."""
    return frame.data[:7] != b"\xff" * 7


def ready(mount: str = "normal", calibrated: bool = True, **more: Any) -> tuple[World, Client]:
    """Return a world of these figures whose motor is enabled, and the client that enabled it."""
    world = World(mount, calibrated, **more)
    return world, world.enabled()
