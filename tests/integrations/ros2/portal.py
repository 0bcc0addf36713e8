"""Runs a fleet before daemons of this machine, for the tests of `make ros`, whose Python has none.

python -m tests.integrations.ros2.portal FOLDER NAME...

The daemon of `lab.NAME` is at FOLDER/NAME.sock, and may come and go. Prints the XDG_RUNTIME_DIR in
which clients find these names; ends when its standard input does.
"""

import sys
from pathlib import Path

from tests.process.fleet.fleet_process import HOST, make_certificates, started


def main(place: str, *names: str) -> None:
    folder = Path(place)
    certificates = make_certificates(folder / "certificates", HOST, "user:op1", "gateway:robot1")
    with started(folder / "fleet", certificates) as lab:
        lab.start_router({"op1": "operator"}, {"robot1": names})
        lab.start_gateway({name: folder / f"{name}.sock" for name in names})
        lab.start_portal("op1", "operator", names, ttl_s=5.0)
        print(lab.runtime_directory(), flush=True)
        sys.stdin.read()


if __name__ == "__main__":
    main(*sys.argv[1:])
