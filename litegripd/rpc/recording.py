"""The method on the flight recorder: have it written to disk, and tell where it is."""

from collections.abc import Mapping

from litegripd.control.dumps import Dumps
from litegripd.model.errands import ErrandResult
from litegripd.model.errors import Refusal
from litegripd.rpc.calls import Answer, Call, Deferred, Function


class Recording:
    """Functions on the recorder."""

    def __init__(self, dumps: Dumps) -> None:
        self._dumps = dumps

    def functions(self) -> Mapping[str, Function]:
        """Return the functions by the names of their methods."""
        return {"recorder.dump": self._dump}

    def _dump(self, call: Call) -> Answer:
        deferred = Deferred()

        def done(result: ErrandResult) -> None:
            if isinstance(result.value, dict):
                deferred.resolve(result.value)
            else:
                text = f"the recorder could not be written: {result.error}"
                deferred.resolve(Refusal(result.reason or "not_saved", text))

        return self._dumps.ask("demand", call.params.get("note", ""), done) or deferred
