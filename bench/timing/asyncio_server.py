"""The plain design, for comparison: an asyncio server thread beside a control thread.

Both share the interpreter's lock. The control thread does what ours does in a tick: the same
machine on the same simulated bus; it has the same priority and absolute deadlines. Prints its
figures as JSON at the end.
"""

import asyncio
import json
import sys
import threading
import time

from litegripd.app.machine import Machine
from litegripd.control.snapshot import snapshot
from litegripd.io.can.bus import DirectBus
from litegripd.io.loop import PeriodicTimer
from litegripd.io.meters import LatenessMeter
from litegripd.io.realtime import acquire
from litegripd.model.gripper import GripperId
from litegripd.model.motion_config import MotionConfig
from litegripd.model.motor import BusSettings
from litegripd.rpc.reports import state_view

PERIOD_S = 0.005


class ControlThread(threading.Thread):
    """The tick, in a thread of its own."""

    def __init__(self, seconds: float) -> None:
        super().__init__()
        self.seconds = seconds
        self.lateness = LatenessMeter()
        self.lost_ticks = 0
        self.machine = Machine(GripperId(), None, MotionConfig(), PERIOD_S)
        self.bus = DirectBus(BusSettings("litegrip_sim", "asyncio", 1_000_000))
        self.bus.receive(time.monotonic())
        self.now_s = 0.0

    def run(self) -> None:
        acquire(50, ())
        timer = PeriodicTimer(PERIOD_S)
        for _ in range(round(self.seconds / PERIOD_S)):
            fired = timer.wait()
            self.now_s = time.monotonic()
            self.lateness.add(self.now_s - timer.last_due_s)
            self.lost_ticks += fired - 1
            frames = self.machine.tick(self.now_s, self.bus.receive(self.now_s))
            self.bus.send(frames, self.now_s)
        timer.close()
        self.bus.close()

    def state(self) -> bytes:
        return json.dumps(
            state_view(snapshot(self.machine.controller, self.now_s, PERIOD_S))
        ).encode()


async def serve(path: str, control: ControlThread) -> int:
    requests = 0

    async def client(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        nonlocal requests
        while line := await reader.readline():
            identity = json.loads(line)["id"]
            writer.write(b'{"jsonrpc":"2.0","id":%d,"result":%b}\n' % (identity, control.state()))
            await writer.drain()
            requests += 1

    server = await asyncio.start_unix_server(client, path)
    print("listening", flush=True)
    await asyncio.get_running_loop().run_in_executor(None, control.join)
    server.close()
    return requests


def main() -> None:
    control = ControlThread(float(sys.argv[2]))
    control.start()
    requests = asyncio.run(serve(sys.argv[1], control))
    figures = {"lateness": control.lateness.summary_us(), "lost_ticks": control.lost_ticks}
    print(json.dumps({**figures, "requests": requests}))


if __name__ == "__main__":
    main()
