"""What a daemon stands on, as its configuration says: its socket's path, its bus, its legacy."""

from dataclasses import dataclass
from pathlib import Path

from litegripd.app.config import Config
from litegripd.io.can.bus import DIRECT_INTERFACES, FrameBus
from litegripd.io.can.pumped import PumpedBus
from litegripd.io.helper.spawner import Spawner
from litegripd.io.sockets import Places, occupy, runtime_directory


def socket_path(config: Config) -> Path:
    """Return where clients find the daemon; raises `InUseError` where no place can be used."""
    if config.rpc.socket is not None:
        return Path(config.rpc.socket)
    return runtime_directory() / f"{config.channel}.sock"


def occupy_places(config: Config) -> Places:
    """Claim the channel and listen; raises `InUseError` where another process has a place."""
    bus = config.bus
    return occupy(bus.interface, bus.channel, socket_path(config), config.rpc.group)


def make_bus(config: Config, period_s: float, spawner: Spawner) -> FrameBus:
    """Choose how the adapter is driven: in the control thread, or by a process of its own."""
    if config.bus.interface in DIRECT_INTERFACES:
        from litegripd.io.can.direct import DirectBus  # noqa: PLC0415 - imports python-can

        return DirectBus(config.bus)
    return PumpedBus(config.bus, period_s, spawner.start)


@dataclass(frozen=True, slots=True)
class Legacy:
    """What a daemon has from the one before it: its sockets, and what tells its start."""

    places: Places
    epoch: str
