"""All methods, group by group: what they take and do. Checks and documents follow them.

A further method is a further function with its row above it; a further group is a class, named here
and made by the service.
"""

from collections.abc import Mapping

from litegripd.handover.methods import RestartMethods
from litegripd.recorder.methods import RecorderMethods
from litegripd.rpc.method import Method, methods_of
from litegripd.rpc.methods.lease import LeaseMethods
from litegripd.rpc.methods.motion import MotionMethods
from litegripd.rpc.methods.reading import ReadingMethods
from litegripd.rpc.methods.settings import SettingsMethods
from litegripd.teleop.methods import TeleopMethods
from litegripd.trajectories.file_methods import TrajectoryFileMethods
from litegripd.trajectories.methods import TrajectoryMethods

GROUPS: tuple[type, ...] = (
    ReadingMethods,
    LeaseMethods,
    MotionMethods,
    SettingsMethods,
    RestartMethods,
    RecorderMethods,
    TrajectoryMethods,
    TrajectoryFileMethods,
    TeleopMethods,
)
"""In the order in which documents list their methods."""

METHODS: tuple[Method, ...] = tuple(row for group in GROUPS for row in methods_of(group))

BY_NAME: Mapping[str, Method] = {row.name: row for row in METHODS}
