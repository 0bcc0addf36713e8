"""Does the control thread lose a tick, whatever goes on beside it?

Runs the real reactor, server, helper and pump in one process under FIFO and locked memory, and
beside it, one after the other: nothing; 32 flooding clients; a helper that parses 10-minute
trajectories; an SLCAN adapter that is stopped (SIGSTOP); a helper and a pump that are killed
again and again; and all of it at once. `machine` is the bare loop of `bench.timing.reference`, run
at the same time: what it loses, the machine loses. Run it by `python -m bench.timing.proof
[seconds]`.
"""

import json
import os
import pty
import signal
import socket
import subprocess
import sys
import tempfile
import time
import tty
from pathlib import Path

from litegripd.io.can.pumped import PumpedBus
from litegripd.io.helper.child import Child
from litegripd.io.helper.helper import Helper, HelperResult
from litegripd.io.loop import Reactor
from litegripd.io.realtime import acquire
from litegripd.io.server import Server
from litegripd.model.motor import BusSettings, CanFrame
from litegripd.rpc.jsonrpc import encode, parse, result_line
from litegripd.rpc.sessions import Peer, Session

PERIOD_S = 0.005
CLIENTS = 32
COMMAND = CanFrame(0x08, bytes.fromhex("7FFF7FF0000007FF"))
FLOOD = """
import socket, sys
sockets = []
for _ in range(int(sys.argv[2])):
    s = socket.socket(socket.AF_UNIX); s.connect(sys.argv[1]); sockets.append(s)
line = b'{"jsonrpc":"2.0","id":1,"method":"state.get"}\\n'
try:
    while True:
        for s in sockets: s.send(line)
        for s in sockets: s.recv(65536)
except OSError:
    pass
"""
ADAPTER = """
import os, sys
fd = int(sys.argv[1])
while True:
    commanded = b"t008" in os.read(fd, 4096)
    os.write(fd, b"t01881880007FF7FF1E1F\\r" if commanded else b"\\r")
"""


class StateService:
    """Answers every request with a state, as the daemon would."""

    def __init__(self) -> None:
        self.state = b"{}"

    def opened(self, peer: Peer, _now_s: float) -> Session:
        return Session(id(peer), peer)

    def handle(
        self, session: Session, line: bytes, _now_s: float, _received_s: float | None = None
    ) -> None:
        session.write(result_line(parse(line).identity, self.state))

    @property
    def pending(self) -> bool:
        return False

    def send_one(self) -> None:
        pass

    def closed(self, session: Session, now_s: float) -> None:
        pass

    def process_ended(self, session: Session, _now_s: float) -> None:
        """Nothing is anybody's here."""

    def is_idle(self, _session: Session) -> bool:
        return True


class Rig:
    """The control process: everything of the daemon that lives in real time, and no gripper."""

    def __init__(self, folder: Path, load: str) -> None:
        self.service = StateService()
        self.load = load
        self.loads = 0
        self.kills = 0
        self.ticks = 0
        self.send_failures = 0
        self.reactor = Reactor(PERIOD_S, self.tick)
        listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
        listener.bind(str(folder / "rpc.sock"))
        self.server = Server(self.reactor, listener, self.service)
        self.end_s = 0.0
        self.reactor.backlog = self.server
        self.helper = Helper(self._watch, self._unwatch, "bench.timing.proof_helper")
        self.master, slave = pty.openpty()
        tty.setraw(self.master)
        tty.setraw(slave)
        os.set_inheritable(self.master, True)
        self.adapter = subprocess.Popen(
            [sys.executable, "-c", ADAPTER, str(self.master)], pass_fds=(self.master,)
        )
        options = {"sleep_after_open": 0}
        self.bus = PumpedBus(BusSettings("slcan", os.ttyname(slave), 1_000_000, options), PERIOD_S)

    def _watch(self, child: Child) -> None:
        self.reactor.add(child.socket.fileno(), self.helper)

    def _unwatch(self, child: Child) -> None:
        self.reactor.remove(child.socket.fileno())

    def tick(self, now_s: float) -> None:
        self.ticks += 1
        if now_s >= self.end_s:
            self.reactor.stop()
        self.bus.receive(now_s)
        self.bus.send((COMMAND,), now_s)
        self.helper.poll(now_s)
        self.service.state = encode({"seq": self.ticks, "monotonic_s": now_s, "x": [1.5] * 20})
        if self.load in ("trajectory", "everything") and self.loads == 0:
            self.request_load()
        if self.load in ("kills", "everything") and self.ticks % 200 == 100:
            for pid in (self.helper.pid, self.bus.pid):
                if pid is not None:
                    os.kill(pid, signal.SIGKILL)
                    self.kills += 1
        if self.load in ("sigstop", "everything") and self.ticks == 200:
            os.kill(self.adapter.pid, signal.SIGSTOP)

    def request_load(self) -> None:
        self.loads += 1
        self.helper.request("load_trajectory", {}, self.loaded)

    def loaded(self, result: HelperResult) -> None:
        if result.error is None and sum(map(len, result.pieces)) != 600 * 200 * 40:
            raise ValueError("the trajectory is not whole")
        if self.helper.is_running:
            self.request_load()
        else:
            self.loads = 0


def control_process(load: str, seconds: float) -> None:
    """Run one case and print its figures as JSON."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        rig = Rig(folder, load)
        floods = []
        if load in ("flood", "everything"):
            for _ in range(4):
                arguments = [sys.executable, "-c", FLOOD, str(folder / "rpc.sock")]
                floods.append(subprocess.Popen([*arguments, str(CLIENTS // 4)]))
        rights = acquire(50, ())
        rig.end_s = time.monotonic() + seconds
        rig.reactor.run()
        figures: dict[str, object] = dict(rig.reactor.lateness.summary_us())
        figures |= {"lost": rig.reactor.lost_ticks, "ticks": rig.reactor.ticks}
        figures |= {"tick_errors": rig.reactor.tick_errors, "requests": rig.server.requests}
        figures |= {"loads": rig.loads, "kills": rig.kills, "refused": list(rights.refused)}
        figures |= {"bus_sent": rig.bus.counters.sent, "bus_received": rig.bus.counters.received}
        figures |= {"cpu_share": round(time.process_time() / seconds, 3)}
        print(json.dumps(figures))
        rig.server.close()
        rig.helper.close()
        rig.bus.close()
        for process in [*floods, rig.adapter]:
            process.kill()
            process.wait()


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) > 1 else 10.0
    for load in ("nothing", "flood", "trajectory", "sigstop", "kills", "everything"):
        command = [sys.executable, "-m", "bench.timing.proof", load, str(seconds)]
        machine = subprocess.Popen(
            [sys.executable, "-m", "bench.timing.reference", str(seconds)], stdout=subprocess.PIPE
        )
        done = subprocess.run(command, check=True, capture_output=True, text=True)
        print(f"{load:<11}{done.stdout}{'  machine':<11}", end="", flush=True)
        print(machine.communicate()[0].decode(), end="", flush=True)


if __name__ == "__main__":
    if len(sys.argv) > 2:
        control_process(sys.argv[1], float(sys.argv[2]))
    else:
        main()
