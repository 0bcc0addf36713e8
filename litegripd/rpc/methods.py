"""The table of methods: names, parameters and what they do. Answers, checks and docs follow it."""

from collections.abc import Mapping

from litegripd.rpc.lease_table import LEASE_METHODS
from litegripd.rpc.method import Method
from litegripd.rpc.moving_table import MOVING
from litegripd.rpc.reading_table import READING
from litegripd.rpc.recording_table import RECORDING
from litegripd.rpc.settings_table import SETTINGS
from litegripd.rpc.teleop_table import TELEOP
from litegripd.rpc.trajectory_table import TRAJECTORIES

METHODS: tuple[Method, ...] = (
    READING + LEASE_METHODS + MOVING + SETTINGS + RECORDING + TRAJECTORIES + TELEOP
)

BY_NAME: Mapping[str, Method] = {method.name: method for method in METHODS}
