"""The spawning process: starts the daemon's other processes, and reaps them.

Run by the daemon. It ends at end-of-file on its socket, that is, with the daemon; those that it
has started see that of their own sockets.
"""

import contextlib
import json
import os
import select
import socket

from litegripd.io.helper.child import (
    MAX_PACKET_BYTES,
    inherited_socket,
    receive_descriptors,
    spawn,
    use_all_cpus,
)


def serve(daemon: socket.socket) -> None:
    """Start the processes that the daemon requests, until the daemon is gone."""
    running: dict[int, int] = {}  # pidfds and their pids
    poll = select.poll()
    poll.register(daemon, select.POLLIN)
    while True:
        for descriptor, _mask in poll.poll():
            if descriptor in running:
                poll.unregister(descriptor)
                os.waitpid(running.pop(descriptor), 0)
                os.close(descriptor)
                continue
            packet, inherited = receive_descriptors(daemon, MAX_PACKET_BYTES, 2)
            if not packet:
                return
            started = _start(daemon, packet, inherited)
            if started is not None:
                pidfd, pid = started
                running[pidfd] = pid
                poll.register(pidfd, select.POLLIN)


def _start(daemon: socket.socket, packet: bytes, inherited: list[int]) -> tuple[int, int] | None:
    """Start one process and report it; return its pidfd and its pid."""
    number, module, arguments = json.loads(packet)
    try:
        pid = spawn(module, arguments, *inherited)
        pidfd = os.pidfd_open(pid)  # of a process that nobody else reaps
    except (OSError, ValueError) as error:  # the latter: no such argument is possible
        daemon.send(json.dumps([number, None, str(error)]).encode())
        return None
    finally:
        # After the report: when the socket of a failed start ends, its reason can be read already.
        for descriptor in inherited:
            os.close(descriptor)
    socket.send_fds(daemon, [json.dumps([number, pid, None]).encode()], [pidfd])
    return pidfd, pid


def main() -> None:
    """Run the spawner."""
    use_all_cpus()
    # Who is gone hears no report, and needs none.
    with contextlib.suppress(ConnectionError), inherited_socket() as daemon:
        serve(daemon)


if __name__ == "__main__":
    main()
