"""The helper process: does, one after the other, what the control thread must never wait for.

Run by the daemon as `python -m litegripd.io.helper_main`. It ends at end-of-file on its socket,
that is, with the daemon; where that has not said goodbye, the flight recorder is written before.
"""

import json
import os
import sys
from collections.abc import Callable, Iterator, Mapping

from litegripd.io.calibration_files import load_operation, templates_operation
from litegripd.io.child import MAX_PACKET_BYTES, inherited_socket
from litegripd.io.helper import GOODBYE
from litegripd.io.saved_files import load_motion, save_calibration, save_motion
from litegripd.io.trajectory_store import TrajectoryStore

Parameters = Mapping[str, object]
Operation = Callable[[Parameters], object]
"""Takes the parameters and returns what JSON can hold; an iterator of bytes is sent in pieces."""

PIECE_BYTES = 8192
_HEADER_BYTES = 4
_MAX_ANSWER_BYTES = MAX_PACKET_BYTES - _HEADER_BYTES - 1
_LONGEST_ERROR = 2000  # characters; each takes at most 12 bytes of JSON


def write_log(parameters: Parameters) -> None:
    """Write `text` to standard error, waiting as long as the reader there takes."""
    left = str(parameters["text"]).encode(errors="backslashreplace")
    while left:
        left = left[os.write(sys.stderr.fileno(), left) :]


def dump_recorder(parameters: Parameters) -> dict[str, object]:
    """Write the flight recorder, as the operation `recorder.dump`."""
    # What a dump needs takes longer to import than all the rest of the helper.
    from litegripd.io.recorder_files import dump  # noqa: PLC0415

    return dump(str(parameters["cause"]), str(parameters["note"]))


OPERATIONS: dict[str, Operation] = {
    "log": write_log,
    "calibration.load": load_operation,
    "calibration.templates": templates_operation,
    "calibration.save": save_calibration,
    "motion.load": load_motion,
    "motion.save": save_motion,
    **TrajectoryStore().operations(),
    "recorder.dump": dump_recorder,
}


def serve(operations: Mapping[str, Operation]) -> bool:
    """Answer requests until the daemon is gone; tell whether it said goodbye."""
    with inherited_socket() as peer:
        while packet := peer.recv(MAX_PACKET_BYTES):
            identity, name, parameters = json.loads(packet)
            if name == GOODBYE:
                return True
            header = identity.to_bytes(_HEADER_BYTES, "little")
            try:
                for answer in _answers(operations, name, parameters):
                    if identity:
                        peer.send(header + answer)
            except BrokenPipeError:
                return False
    return False


def _answers(
    operations: Mapping[str, Operation], name: str, parameters: Parameters
) -> Iterator[bytes]:
    try:
        result = operations[name](parameters)
        if isinstance(result, Iterator):
            for piece in result:
                yield b"p" + piece
            result = None
        packed = json.dumps(result).encode()
        if len(packed) > _MAX_ANSWER_BYTES:
            raise ValueError(f"the answer has {len(packed)} bytes, too many for one packet")
        yield b"r" + packed
    except Exception as error:  # noqa: BLE001 - the requester gets it, whatever it is
        yield b"e" + json.dumps(f"{type(error).__name__}: {error}"[:_LONGEST_ERROR]).encode()


def main() -> None:
    """Run the helper with the daemon's operations."""
    if serve(OPERATIONS):
        return
    try:
        written = dump_recorder({"cause": "crash", "note": "the control process has gone"})
        told = f"its last minute is recorded in {written['path']}"
    except (OSError, ValueError) as error:
        told = f"its last minute could not be recorded: {error}"
    write_log({"text": f"litegripd: the control process is gone; {told}\n"})


if __name__ == "__main__":
    main()
