"""A program in the place of ssh: it forwards Unix sockets on this machine, or fails as ssh does.

The name of the host says how it fails. Its arguments and its process go to the file $FAKE_SSH_LOG.
"""

import json
import os
import socket
import subprocess
import sys
import threading
from itertools import pairwise
from pathlib import Path

SAYS = {
    "nowhere": "ssh: Could not resolve hostname nowhere: Name or service not known",
    "stranger": "bob@stranger: Permission denied (publickey,password).",
    "impostor": "Host key verification failed.",
    "offline": "ssh: connect to host offline port 22: Connection timed out",
}
FORBIDDEN = "channel 2: open failed: administratively prohibited: open failed"
NOBODY = "channel 2: open failed: connect failed: open failed"
FAILED = 255


def main(arguments: list[str]) -> int:
    log(arguments)
    host, *command = arguments[arguments.index("--") + 1 :]
    if host in SAYS:
        say(SAYS[host])
        return FAILED
    if "-N" not in arguments:
        return subprocess.run(["sh", "-c", *command], check=False).returncode
    forwarded = [after for word, after in pairwise(arguments) if word == "-L"]
    listeners = [listen(pair, forbidden=host == "strict") for pair in forwarded]
    for listener in listeners:
        listener.join()
    return 0


def log(arguments: list[str]) -> None:
    with Path(os.environ["FAKE_SSH_LOG"]).open("a", encoding="utf-8") as file:
        file.write(json.dumps({"pid": os.getpid(), "arguments": arguments}) + "\n")


def listen(pair: str, *, forbidden: bool) -> threading.Thread:
    here, there = pair.split(":")
    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    listener.bind(here)
    listener.listen()

    def accept() -> None:
        while True:
            near, _ = listener.accept()
            far = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                if forbidden:
                    raise PermissionError
                far.connect(there)
            except OSError:
                say(FORBIDDEN if forbidden else NOBODY)
                near.close()
                continue
            for one, other in ((near, far), (far, near)):
                threading.Thread(target=copy, args=(one, other), daemon=True).start()

    thread = threading.Thread(target=accept, daemon=True)
    thread.start()
    return thread


def copy(one: socket.socket, other: socket.socket) -> None:
    try:
        while data := one.recv(65536):
            other.sendall(data)
        other.shutdown(socket.SHUT_WR)
    except OSError:
        other.close()  # the other side was first


def say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
