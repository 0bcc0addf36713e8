"""What the flight recorder costs a tick, and a dump the helper process.

python -m bench.timing.recorder [REPETITIONS, default 20]

The recorder is fed by a gripper that moves back and forth for more than a minute of simulated time,
so that the ring is full. A tick's cost is all that the recorder adds to it. Times are those of the
processor.
"""

import statistics
import sys
import time

from litegripd.model.state import Event
from litegripd.recorder.files import read, to_mcap
from tests.world import World

TICKS = 2000
EVENT = Event("job_started", "job 12: open by python (pid 1234, uid 1000)", {"job": 12})


def main() -> None:
    """Measure and print."""
    repetitions = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    world = World()
    client = world.enabled()
    ends_s = world.now_s + 65.0
    while world.now_s < ends_s:
        client.result("motion.open")
        client.result("motion.close")
    client.send("motion.open")
    world.run(0.2)
    ticks = [_tick_us(world) for _ in range(repetitions)]
    events = [_event_us(world) for _ in range(repetitions)]
    memory = bytes(world.disk.memory)
    began_s = time.thread_time()
    recording = read(memory)
    read_s = time.thread_time()
    content = to_mcap(recording, "demand", "", 0)
    wrote_s = time.thread_time()
    print(f"memory          {len(memory) / 1e6:.2f} MB, fixed")
    print(f"per tick        {statistics.median(ticks):.2f} µs (best {min(ticks):.2f})")
    print(f"per event       {statistics.median(events):.2f} µs (best {min(events):.2f})")
    print(f"dump, read      {(read_s - began_s) * 1e3:.0f} ms, {len(recording.ticks)} ticks")
    print(f"dump, as MCAP   {(wrote_s - read_s) * 1e3:.0f} ms, {len(content) / 1e6:.2f} MB")


def _tick_us(world: World) -> float:
    recorder, machine, now_s = world.recorder, world.machine, world.now_s
    controller, motor, frames = machine.controller, machine.motor, machine.take_sent()
    began_s = time.thread_time()
    for _ in range(TICKS):
        recorder.tick(
            now_s,
            controller,
            motor,
            frames,
            late_s=1e-4,
            lost_ticks=0,
            failed=False,
            bus_is_up=True,
        )
        world.dumps.step(now_s, failed=False, bus_is_up=True)
    return (time.thread_time() - began_s) / TICKS * 1e6


def _event_us(world: World) -> float:
    began_s = time.thread_time()
    for _ in range(TICKS):
        world.recorder.event(EVENT, world.now_s)
    return (time.thread_time() - began_s) / TICKS * 1e6


if __name__ == "__main__":
    main()
