"""The row of the method on the flight recorder."""

from litegripd.model.calibration import Dumped
from litegripd.rpc.method import Method
from litegripd.rpc.schema import Param

RECORDING: tuple[Method, ...] = (
    Method(
        "recorder.dump",
        "Write the last minute, tick by tick, and its events to a file of the daemon's machine, in"
        " the format MCAP.",
        "path, ticks, seconds, bytes.",
        Dumped,
        (Param("note", "string", "Kept in the file: why it was asked for."),),
        role="operator",
        waits=True,
    ),
)
