"""A `World` whose frames pass through the real `DirectBus` and a simulated CAN bus.

What goes wrong with the link therefore reaches the machine as it does in the daemon: raised by
python-can, handled in `litegripd.io`. The bus runs on the world's own clock, so nothing waits.
"""

from itertools import count
from types import TracebackType
from typing import Any

from litegripd.io.can.bus import DirectBus
from litegripd.model.motor import BusSettings, CanFrame
from litegripd.motor import codec
from litegripd.sim.faults import BusFaults
from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.interface import SimulatedBus
from litegripd.sim.plant import SimulatorParameters
from tests.world import CAN_ID, Sent, World, is_command

_numbers = count()


class RecordingGripper(SimulatedGripper):
    """Keeps what has come to its motor, and when."""

    def __init__(self, parameters: SimulatorParameters) -> None:
        super().__init__(parameters)
        self.received: list[Sent] = []

    def receive(self, now_s: float, frame: CanFrame) -> list[CanFrame]:
        self.received.append(Sent(now_s, frame))
        return super().receive(now_s, frame)


class BusWorld(World):
    """One daemon, its `DirectBus` and a simulated gripper; `faults` breaks the link.

    Use it in a `with` statement, which closes the bus. `sent` is what the daemon gave its bus,
    `at_motor` what came to the motor. `lose_to_motor` and `lose_from_motor` do nothing here.
    """

    def __init__(self, mount: str = "normal", **options: Any) -> None:
        super().__init__(mount, **options)
        gripper = {"gripper": self.gripper, "monotonic_fn": self._clock}
        channel = f"bus world {next(_numbers)}"
        self.bus = DirectBus(BusSettings("litegrip_sim", channel, 1_000_000, gripper))
        # Another node, so that the bus is there before the daemon opens it and after it is lost.
        self._keeper = SimulatedBus(channel, gripper=self.gripper, monotonic_fn=self._clock)

    def __enter__(self) -> "BusWorld":
        return self

    def __exit__(
        self,
        _kind: type[BaseException] | None,
        _error: BaseException | None,
        _traceback: TracebackType | None,
    ) -> None:
        self.faults.replug()
        self.bus.close()
        self._keeper.shutdown()

    @property
    def faults(self) -> BusFaults:
        """What can go wrong with the link."""
        return self._keeper.faults

    @property
    def at_motor(self) -> list[Sent]:
        """The frames that have come to the motor, in their order."""
        assert isinstance(self.gripper, RecordingGripper)
        return self.gripper.received

    def commands_at_motor(self, since_s: float) -> list[float]:
        """Return when MIT commands have come to the motor since a time."""
        return [
            sent.at_s
            for sent in self.at_motor
            if sent.at_s >= since_s and sent.frame.can_id == CAN_ID and is_command(sent.frame)
        ]

    def enables_at_motor(self, since_s: float) -> list[float]:
        """Return when enable frames have come to the motor since a time."""
        return [
            sent.at_s
            for sent in self.at_motor
            if sent.at_s >= since_s and sent.frame == CanFrame(CAN_ID, codec.ENABLE)
        ]

    def make_gripper(self, parameters: SimulatorParameters) -> SimulatedGripper:
        return RecordingGripper(parameters)

    def exchange(self) -> None:
        received = self.bus.receive(self.now_s)
        frames = self.machine.tick(self.now_s, received, self.bus.condition)
        self.sent += [Sent(self.now_s, frame) for frame in frames]
        self.bus.send(frames, self.now_s)

    def inject(self, frame: CanFrame) -> None:
        """Let another node on the bus send a frame."""
        self.faults.inject(frame)

    def _clock(self) -> float:
        return self.now_s
