"""The python-can interface `litegrip_sim`: a bus with one simulated gripper on it.

Any program that opens its bus with python-can can use it:
`can.Bus(interface="litegrip_sim", channel="sim0", ignore_config=True)`. Buses of one process that
name the same channel are nodes of the same bus; it ends with the last of them.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from dataclasses import dataclass

import can

from litegripd.sim.channel import Channel, Node
from litegripd.sim.faults import BusFaults
from litegripd.sim.gripper import SimulatedGripper, build_gripper

BITRATE = 1_000_000


@dataclass(frozen=True, slots=True)
class _Options:
    """What a channel was opened with; a second bus must ask for the same or for nothing."""

    mount: str | None
    seed: int | None
    object_mm: float | None
    object_stiffness_nm_rad: float | None
    watchdog_s: float | None

    def build(self) -> SimulatedGripper:
        return build_gripper(
            mount=self.mount or "normal",
            seed=self.seed,
            object_mm=self.object_mm,
            object_stiffness_nm_rad=250.0
            if self.object_stiffness_nm_rad is None
            else self.object_stiffness_nm_rad,
            watchdog_s=0.1 if self.watchdog_s is None else self.watchdog_s,
        )


_NO_OPTIONS = _Options(None, None, None, None, None)


@dataclass(frozen=True, slots=True)
class _OpenChannel:
    channel: Channel
    options: _Options
    monotonic_fn: Callable[[], float]


_channels: dict[str, _OpenChannel] = {}
_channels_lock = threading.Lock()


class SimulatedBus(can.BusABC):
    """One node of a simulated bus.

    Options, by keyword:

    - `mount`: "normal" (closing increases radians) or "reverse"
    - `seed`: an integer gives the reports a noise of at most one code; without it they are exact
    - `object_mm`, `object_stiffness_nm_rad`: an object between the jaws
    - `watchdog_s`: time without a command after which the motor disarms, 0.1 unless given
    - `gripper`: a ready-made `SimulatedGripper` instead of the options above
    - `monotonic_fn`: the clock, `time.monotonic` unless given; seconds, never backwards
    - `receive_own_messages`: also receive what this node sends
    - `bitrate`: 1 000 000 or left out, because the motor knows no other

    Raises `ValueError` for an unknown option, for a value out of range, and when the channel is
    open already with other options; `OSError` 19 while its adapter is unplugged by `faults`.
    """

    def __init__(
        self,
        channel: object = "sim0",
        can_filters: can.typechecking.CanFilters | None = None,
        *,
        mount: str | None = None,
        seed: object = None,
        object_mm: object = None,
        object_stiffness_nm_rad: object = None,
        watchdog_s: object = None,
        gripper: SimulatedGripper | None = None,
        monotonic_fn: Callable[[], float] | None = None,
        receive_own_messages: bool = False,
        bitrate: object = None,
        **unknown: object,
    ) -> None:
        if unknown:
            raise ValueError(
                f"unknown option {', '.join(sorted(unknown))}; litegrip_sim takes mount, seed, "
                f"object_mm, object_stiffness_nm_rad, watchdog_s, gripper, monotonic_fn, "
                f"receive_own_messages and bitrate"
            )
        if not isinstance(channel, str) or not channel:
            raise ValueError(f"channel must be a name such as 'sim0', not {channel!r}")
        if bitrate is not None and _number("bitrate", bitrate) != BITRATE:
            raise ValueError(f"bitrate must be {BITRATE}, as the motor's is, not {bitrate!r}")
        options = _Options(
            mount=mount,
            seed=_integer("seed", seed),
            object_mm=_number("object_mm", object_mm),
            object_stiffness_nm_rad=_number("object_stiffness_nm_rad", object_stiffness_nm_rad),
            watchdog_s=_number("watchdog_s", watchdog_s),
        )
        self._node = Node(receive_own=bool(receive_own_messages))
        self._name = channel
        self._channel = _join(channel, self._node, options, gripper, monotonic_fn)
        self.channel_info = f"litegrip_sim: {channel}"
        super().__init__(channel, can_filters)

    @property
    def gripper(self) -> SimulatedGripper:
        """The gripper on this bus."""
        return self._channel.gripper

    @property
    def faults(self) -> BusFaults:
        """The faults that can be let happen to the whole channel."""
        return self._channel.faults

    def send(self, msg: can.Message, timeout: float | None = None) -> None:  # noqa: ARG002
        """Send one classic frame; it never waits.

        Raises `can.CanOperationError` after `shutdown`, for an FD or an error frame, and as
        `faults` has it.
        """
        if self._is_shutdown:
            raise can.CanOperationError(f"{self.channel_info} is shut down")
        if msg.is_fd or msg.is_error_frame:
            raise can.CanOperationError(f"{self.channel_info} carries classic data frames only")
        self._channel.send(self._node, msg)

    def _recv_internal(self, timeout: float | None) -> tuple[can.Message | None, bool]:
        message = self._channel.receive(self._node, timeout)
        if message is None and self._is_shutdown:
            raise can.CanOperationError(f"{self.channel_info} is shut down")
        # Error frames pass by the filters for ids: the kernel has a filter of their own for them.
        return message, message is not None and message.is_error_frame

    def shutdown(self) -> None:
        """Leave the bus. The last node that leaves ends it, and the gripper with it.

        While its adapter is unplugged, the bus outlasts its nodes.
        """
        if not self._is_shutdown:
            super().shutdown()
            _leave(self._name, self._node)


def _join(
    name: str,
    node: Node,
    options: _Options,
    gripper: SimulatedGripper | None,
    monotonic_fn: Callable[[], float] | None,
) -> Channel:
    """Attach a node to the channel of this name, which the first node creates."""
    if gripper is not None and options != _NO_OPTIONS:
        raise ValueError(
            "give either gripper or the options that build one (mount, seed, object_mm, "
            "object_stiffness_nm_rad), not both"
        )
    if options.object_stiffness_nm_rad is not None and options.object_mm is None:
        raise ValueError("object_stiffness_nm_rad needs object_mm: there is no object")
    with _channels_lock:
        opened = _channels.get(name)
        if opened is None:
            clock = monotonic_fn or time.monotonic
            built = options.build() if gripper is None else gripper
            opened = _channels[name] = _OpenChannel(Channel(built, clock), options, clock)
        elif (
            options not in (_NO_OPTIONS, opened.options)
            or gripper not in (None, opened.channel.gripper)
            or monotonic_fn not in (None, opened.monotonic_fn)
        ):
            raise ValueError(
                f"channel {name!r} is open already with other options; use the same options, "
                f"none, or another channel"
            )
        opened.channel.attach(node)
        return opened.channel


def _leave(name: str, node: Node) -> None:
    with _channels_lock:
        channel = _channels[name].channel
        if not channel.detach(node) and not channel.faults.is_unplugged:
            del _channels[name]


def _number(name: str, value: object) -> float | None:
    """Return an option as a number; configuration files and command lines give text."""
    if value is None:
        return None
    complaint = f"{name} must be a number, not {value!r}"
    if not isinstance(value, (int, float, str)) or isinstance(value, bool):
        raise ValueError(complaint)
    try:
        return float(value)
    except ValueError:
        raise ValueError(complaint) from None


def _integer(name: str, value: object) -> int | None:
    number = _number(name, value)
    if number is not None and not number.is_integer():
        raise ValueError(f"{name} must be a whole number, not {value!r}")
    return None if number is None else int(number)
