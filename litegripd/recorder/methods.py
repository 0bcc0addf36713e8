"""The method that writes the flight recorder to disk, and returns the path."""

from litegripd.model.calibration import Dumped
from litegripd.model.errors import Refusal
from litegripd.model.state import TaskResult
from litegripd.recorder.causes import Dumps
from litegripd.rpc.method import Answer, Call, Deferred, Method
from litegripd.rpc.schema import Param


class RecorderMethods:
    """The recorder's methods."""

    NOT_CARRIED = ("_dumps",)

    def __init__(self, dumps: Dumps) -> None:
        self._dumps = dumps

    @Method(
        "recorder.dump",
        "Write the last minute, tick by tick, and its events to a file of the daemon's machine, in"
        " the format MCAP.",
        "path, ticks, seconds, bytes.",
        Dumped,
        (Param("note", "string", "Kept in the file: why it was asked for."),),
        role="operator",
        waits=True,
    )
    def _dump(self, call: Call) -> Answer:
        deferred = Deferred()

        def done(result: TaskResult) -> None:
            if isinstance(result.value, dict):
                deferred.resolve(result.value)
            else:
                text = f"the recorder could not be written: {result.error}"
                deferred.resolve(Refusal(result.reason or "not_saved", text))

        return self._dumps.ask("demand", call.params.get("note", ""), done) or deferred
