"""The floor under `bench.fleet.scale`: zenoh alone, a publisher's states to a subscriber.

python -m bench.fleet.floor publish CONFIG.json GRIPPERS HZ BYTES
python -m bench.fleet.floor subscribe CONFIG.json

CONFIG.json has `connect`, `ca`, `certificate` and `key`. The publisher sends a payload for each
gripper by a key of its own, and nothing else: no daemon, no session, no client. Both say `ready`.
Each line SECONDS on standard input of the subscriber then has it count for so long, and print as
JSON what `bench.fleet.reader` prints.
"""

import json
import struct
import sys
import threading
import time
from array import array
from pathlib import Path

import zenoh

from bench.fleet.standin import name_of
from litegrip_fleet.wire.keys import PREFIX, Place
from litegrip_fleet.wire.network import Network, Tls, opened

USER, SITE, NAME = "op1", "lab", "floor"
_STAMP = struct.Struct("d")


def session_by(config: Path) -> zenoh.Session:
    """Open a session, as gateway and portal do."""
    values = json.loads(config.read_text(encoding="utf-8"))
    tls = Tls(values["ca"], values["certificate"], values["key"])
    return opened(Network(connect=values["connect"], tls=tls))


def publish(session: zenoh.Session, grippers: int, hz: float, size_bytes: int) -> None:
    """Publish until the process is ended; each gripper has its own moment in a period."""
    keys = [zenoh.KeyExpr(Place(SITE, name_of(index)).to(USER, NAME)) for index in range(grippers)]
    rest = b"x" * (size_bytes - _STAMP.size)
    print("ready", flush=True)
    begun_s, number = time.monotonic(), 0
    while True:
        due = int((time.monotonic() - begun_s) * grippers * hz)
        while number < due:
            session.put(keys[number % grippers], _STAMP.pack(time.monotonic()) + rest)
            number += 1
        time.sleep(0.001)


def subscribe(session: zenoh.Session) -> None:
    """Take all, and count when standard input asks for it."""
    ages_s = array("d")
    channel: zenoh.handlers.FifoChannel[zenoh.Sample] = zenoh.handlers.FifoChannel(1024)
    subscriber = session.declare_subscriber(f"{PREFIX}/{SITE}/*/to/{USER}/{NAME}", channel)

    def read() -> None:
        while True:
            payload = subscriber.recv().payload.to_bytes()
            ages_s.append(time.monotonic() - _STAMP.unpack_from(payload)[0])

    threading.Thread(target=read, daemon=True).start()
    print("ready", flush=True)
    for line in sys.stdin:
        begun = len(ages_s)
        time.sleep(float(line))
        counted = sorted(ages_s[begun:])
        figures: dict[str, float] = {"samples": len(counted), "missing": 0, "ended": 0}
        if counted:
            shares = {"p50": 0.5, "p99": 0.99, "worst": 1.0}
            figures |= {
                name: counted[int(share * (len(counted) - 1))] * 1e6
                for name, share in shares.items()
            }
        print(json.dumps(figures), flush=True)


def main() -> None:
    session = session_by(Path(sys.argv[2]))
    if sys.argv[1] == "publish":
        publish(session, int(sys.argv[3]), float(sys.argv[4]), int(sys.argv[5]))
    else:
        subscribe(session)


if __name__ == "__main__":
    main()
