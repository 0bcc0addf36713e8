"""An operator's program for `bench.fleet.faults`: it moves, or works, as its standard input says.

python -m bench.fleet.operator SOCKET

`move` takes the lease, with `on_lost` relax, and begins a slow motion; `ask` sends three motions
more and waits for no answer; `work N` makes N motions, one after the other, and begins another
session when one ends. Each line is answered by one of JSON.
"""

import contextlib
import json
import sys
import time
from pathlib import Path
from typing import Any

from tests.process.daemon_process import Client

GIVES_UP_S = 60.0


class Operator:
    def __init__(self, path: Path) -> None:
        self._path = path
        self._client = Client(path)

    def move(self) -> dict[str, Any]:
        client = self._client
        client.result("lease.acquire", on_lost="relax", wait_s=10.0)
        client.despite_silence("motor.enable")
        client.despite_silence("motion.move", opening_mm=10, speed_mm_s=100)
        client.send("motion.open", speed_mm_s=10, progress=True)
        while client.read().get("method") != "job.progress":
            pass
        return {"asked": 1}

    def ask(self) -> dict[str, Any]:
        """Send motions; how many can be sent at all depends on what has gone."""
        motions: list[tuple[str, dict[str, Any]]] = [
            ("motion.close", {"if_busy": "replace"}),
            ("motion.open", {"if_busy": "replace", "wait": False}),
            ("motion.move", {"if_busy": "queue", "wait": False, "opening_mm": 40}),
        ]
        sent = 0
        with contextlib.suppress(ConnectionError):
            for sent, (method, params) in enumerate(motions, 1):  # noqa: B007
                self._client.send(method, **params)
        return {"asked": sent}

    def work(self, count: int) -> dict[str, Any]:
        """Make motions; return when each was asked for, and what came of it.

        `back_s` is how long it then took to have another session, in so far as there was time.
        """
        done, back_s, ends_s = [], [], time.monotonic() + GIVES_UP_S
        for number in range(count):
            if time.monotonic() > ends_s:
                break
            at_s = time.monotonic()
            opening_mm = 20.0 + 5.0 * (number % 2)
            word = self._outcome(
                "motion.move", opening_mm=opening_mm, speed_mm_s=100, if_busy="replace"
            )
            lost_s = time.monotonic()
            done.append((at_s, lost_s - at_s, word))
            if word not in ("ok", "too_late"):
                while word != "ok" and time.monotonic() < ends_s:
                    self._client.close()
                    self._client = Client(self._path)
                    word = self._outcome("lease.acquire", on_lost="relax", wait_s=10.0)
                back_s.append(time.monotonic() - lost_s)
        return {"done": done, "back_s": back_s}

    def _outcome(self, method: str, **params: object) -> str:
        """Call a method; return `ok`, or why not; the connection's end is one, too."""
        try:
            number = self._client.send(method, **params)
        except ConnectionError:
            return "ended"
        while message := self._client.read():
            is_last = "error" in message and message["id"] is None
            if message.get("id") != number and not is_last:
                continue
            reason: str = "ok" if "result" in message else message["error"]["data"]["reason"]
            return reason
        return "ended"


def main() -> None:
    operator = Operator(Path(sys.argv[1]))
    for line in sys.stdin:
        word, *arguments = line.split()
        print(json.dumps(getattr(operator, word)(*map(int, arguments))), flush=True)


if __name__ == "__main__":
    main()
