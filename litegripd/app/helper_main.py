"""The helper process: does, one task after the other, what the control thread must not wait for.

The daemon runs it. It ends at end-of-file on its socket, that is, with the daemon. If the daemon
has sent no goodbye, the helper first writes the flight recorder.
"""

import contextlib
import json
import os
import select
import signal
import socket
import sys
from collections import deque
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import cast

from litegrip_client.socketcan.link import ask_kernel
from litegrip_client.socketcan.managers import settings_of
from litegrip_client.values.atomic_file import (
    FULL_BYTES,
    LARGEST_BYTES,
    SYSTEM_DIRECTORIES,
    shortages,
)
from litegripd.io.helper.child import (
    CHILD_FD,
    MAX_PACKET_BYTES,
    MEMORY_FD,
    inherited_socket,
    module_command,
    module_environment,
    receive_descriptors,
    spawn,
    use_all_cpus,
)
from litegripd.io.helper.files import (
    load_motion,
    load_operation,
    save_calibration,
    save_motion,
    state_directory,
    templates_operation,
)
from litegripd.io.helper.helper import GOODBYE, LOG, LOG_STATE
from litegripd.io.helper.spawner import MODULE as SPAWNER
from litegripd.io.helper.spawner import OPERATION as START_SPAWNER
from litegripd.io.log import LineWriter
from litegripd.model.calibration import Dumped
from litegripd.trajectories.store import Limits, TrajectoryStore

Parameters = Mapping[str, object]
Operation = Callable[[Parameters], object]
"""Takes the parameters and returns a value for JSON, or an iterator of bytes, sent in pieces."""

PIECE_BYTES = 8192
_HEADER_BYTES = 4
_MAX_DESCRIPTORS = 4
_MAX_ANSWER_BYTES = MAX_PACKET_BYTES - _HEADER_BYTES - 1
_LONGEST_ERROR = 2000  # characters; each takes at most 12 bytes of JSON


_LOG = LineWriter()
_LOOK_AT_LOG_EVERY_S = 0.25
_PACKETS_AT_ONCE = 256
_LOG_WITHIN_S = 0.4  # at the end; less than a daemon waits for its helper


def write_log(parameters: Parameters) -> None:
    """Write `text` to standard error, without waiting for a reader."""
    _LOG.write(str(parameters["text"]))


def dump_recorder(parameters: Parameters) -> Dumped:
    """Write the flight recorder to a file: the operation `recorder.dump`."""
    # This import takes longer than all others of the helper.
    from litegripd.recorder.files import dump  # noqa: PLC0415

    return dump(str(parameters["cause"]), str(parameters["note"]))


def look_at_link(parameters: Parameters) -> dict[str, object]:
    """Read a CAN interface's bit rate and modes, and who sets wrong ones: `link.look`.

    Raises `OSError` where the kernel does not describe it.
    """
    name = str(parameters["channel"])
    link = ask_kernel(name)
    if link is None:
        raise OSError(f"there is no network interface {name}")
    return {
        "bitrate": link.bitrate if link.kind == "can" else None,
        "ifindex": link.index,
        "modes": {mode.lower(): why for mode, why in link.bad_modes.items()},
        "set_by": [setting.text for setting in settings_of(name) if setting.is_wrong],
    }


def look_at_disks(parameters: Parameters) -> list[dict[str, object]]:
    """Return which file systems have no room for what the daemon writes: `disk.look`."""
    written = [(str(state_directory()), LARGEST_BYTES)]
    others = (str(parameters["runtime"]), *SYSTEM_DIRECTORIES)
    written += [(directory, FULL_BYTES) for directory in others]
    return [asdict(lacking) for lacking in shortages(written)]


def start_successor(parameters: Parameters) -> dict[str, int]:
    """Run a daemon that inherits the one descriptor of `descriptors`; return its pid.

    It runs the `program`, if there is one, which may be another version by now. Else it runs the
    module at the begin of the `arguments`, of this version.

    The control thread must not do this: it would wait until the new process runs its program.
    """
    (inherited,) = cast("list[int]", parameters["descriptors"])
    module, *arguments = cast("list[str]", parameters["arguments"])
    program = cast("str | None", parameters.get("program"))
    command = module_command(module, arguments) if program is None else [program, *arguments]
    pid = os.posix_spawn(
        command[0],
        command,
        module_environment(),
        file_actions=[
            (os.POSIX_SPAWN_DUP2, inherited, CHILD_FD),
            (os.POSIX_SPAWN_CLOSE, MEMORY_FD),  # it records its own ticks
        ],
        setpgroup=0,  # a group of its own: a Ctrl-C was meant for the predecessor
        setsigmask=(),
        setsigdef=(
            signal.SIGCHLD,
            signal.SIGINT,
            signal.SIGPIPE,
            signal.SIGTERM,
            signal.SIGUSR1,
        ),
    )
    return {"pid": pid}


def start_spawner(parameters: Parameters) -> dict[str, int]:
    """Run a spawner that inherits the one socket of `descriptors`, to replace one that died."""
    (inherited,) = cast("list[int]", parameters["descriptors"])
    return {"pid": spawn(SPAWNER, (), inherited)}


OPERATIONS: dict[str, Operation] = {
    LOG: write_log,
    "successor.start": start_successor,
    START_SPAWNER: start_spawner,
    "link.look": look_at_link,
    "disk.look": look_at_disks,
    "calibration.load": load_operation,
    "calibration.templates": templates_operation,
    "calibration.save": save_calibration,
    "motion.load": load_motion,
    "motion.save": save_motion,
    "recorder.dump": dump_recorder,
    **TrajectoryStore().operations(),
}


def serve(operations: Mapping[str, Operation]) -> bool:
    """Answer requests until the daemon is gone; return True if it has sent a goodbye.

    A daemon that is gone reads no answer, but its goodbye may follow its last request.
    """
    with inherited_socket() as peer:
        intake = _Intake(peer)
        while True:
            request = intake.next()
            if request is None:
                return False
            if request.name == GOODBYE:
                _LOG.finish(_LOG_WITHIN_S)
                return True
            header = request.identity.to_bytes(_HEADER_BYTES, "little")
            try:
                for answer in _answers(operations, request.name, request.parameters):
                    if request.identity:
                        peer.send(header + answer)
            except ConnectionError:
                continue
            finally:
                for descriptor in request.descriptors:
                    os.close(descriptor)


@dataclass(frozen=True, slots=True)
class _Request:
    identity: int
    name: str
    parameters: Parameters
    descriptors: Sequence[int]


class _Intake:
    """The daemon's requests in their order; its log lines are written at once.

    Log lines behind a long task would fill the socket, and be lost. How many are lost, and
    whether the log is stuck, is reported to the daemon at each change.
    """

    def __init__(self, peer: socket.socket) -> None:
        self._peer = peer
        self._waiting: deque[_Request] = deque()
        self._is_over = False
        self._reported = (0, False)

    def next(self) -> _Request | None:
        """Wait for a request and return it, or None at the end."""
        while True:
            self._take()
            self._report()
            if self._waiting:
                return self._waiting.popleft()
            if self._is_over:
                return None
            # While log lines are being written, it checks them now and then.
            within_s = _LOOK_AT_LOG_EVERY_S if _LOG.is_busy or self._reported[1] else None
            select.select((self._peer,), (), (), within_s)

    def _take(self) -> None:
        """Take the packets that have come, a bounded number at a time."""
        for _ in range(_PACKETS_AT_ONCE):
            if self._is_over or not select.select((self._peer,), (), (), 0)[0]:
                return
            packet, descriptors = receive_descriptors(
                self._peer, MAX_PACKET_BYTES, _MAX_DESCRIPTORS
            )
            if not packet:
                self._is_over = True
                return
            identity, name, parameters = json.loads(packet)
            if descriptors:
                parameters["descriptors"] = descriptors
            if name == LOG and not identity:
                write_log(parameters)
            else:
                self._waiting.append(_Request(identity, name, parameters, descriptors))

    def _report(self) -> None:
        state = (_LOG.lost, _LOG.is_stuck)
        if state != self._reported:
            self._reported = state
            with contextlib.suppress(ConnectionError):  # the next packet shows the end
                self._peer.send(bytes(_HEADER_BYTES) + LOG_STATE + json.dumps(state).encode())


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
    except Exception as error:  # noqa: BLE001 - the requester gets any error
        yield b"e" + json.dumps(_said(error)[:_LONGEST_ERROR]).encode()


def _said(error: Exception) -> str:
    """Return an error as it is told: those of our own classes are sentences for users."""
    package = type(error).__module__.partition(".")[0]
    is_ours = package in ("litegripd", "litegrip_client")
    return str(error) if is_ours else f"{type(error).__name__}: {error}"


def main() -> None:
    """Run the helper with the daemon's operations; the arguments are the limits of a user."""
    signal.signal(signal.SIGCHLD, signal.SIG_IGN)  # a successor that fails is reaped at once
    use_all_cpus()
    with contextlib.suppress(OSError):  # there may be none
        os.set_inheritable(MEMORY_FD, False)
    store = TrajectoryStore(limits=Limits.of(sys.argv[1:]))
    if serve({**OPERATIONS, **store.operations()}):
        return
    try:
        written = dump_recorder({"cause": "crash", "note": "the control process has gone"})
        outcome = f"its last minute is recorded in {written['path']}"
    except (OSError, ValueError) as error:
        outcome = f"its last minute could not be recorded: {error}"
    _LOG.write(f"litegripd: the control process is gone; {outcome}\n")
    _LOG.finish(_LOG_WITHIN_S)


if __name__ == "__main__":
    main()
