"""How soon the dead man's switch stops a gripper once nobody watches.

python -m bench.fleet.silence [ROUNDS, default 10] [SEED, default 1]

A simulated gripper, a gateway with `stop_when_silent`, a router and a portal with TLS, `ttl_s` 1 s.
A supervisor's program is connected; then it, or the portal or the router, is killed or frozen
(SIGSTOP) at a random moment of the time between two signs of life. The time is from the signal to
the daemon's own time of the stop, both by CLOCK_MONOTONIC of this machine.
"""

import contextlib
import random
import signal
import statistics
import sys
import tempfile
import time
from pathlib import Path

from tests.process.daemon_process import DEADLINE_S, SIMULATED, Client, daemon, line_of, spawn
from tests.process.fleet.fleet_process import HOST, Fleet, fleet, make_certificates
from tests.process.fleet.test_dead_man import SUPERVISOR, SWITCH, is_stopped

USER, TTL_S = "viewer", 1.0
CASES = ("program killed", "program frozen", "portal killed", "portal frozen", "router killed")


def until_reachable(lab: Fleet) -> None:
    """Wait until the gripper can be reached through the portal."""
    ends_s = time.monotonic() + DEADLINE_S
    while time.monotonic() < ends_s:
        with contextlib.suppress(OSError), Client(lab.socket_path()) as client:
            client.send("hello")
            if "result" in client.read():  # an error has no id, and ends the connection
                return
        time.sleep(0.1)
    raise TimeoutError(f"the gripper cannot be reached again: {lab.portal.log}")


def stopped_after_s(lab: Fleet, local: Client, case: str, wait_s: float) -> float:
    """Have a supervisor, take him away, and return how long it takes until the stop."""
    what, how = case.split()
    local.until(is_stopped)
    supervisor = spawn(SUPERVISOR, str(lab.socket_path()))
    try:
        if not line_of(supervisor):
            raise RuntimeError(f"the supervisor's program has ended: {lab.portal.log}")
        while is_stopped(local.result("state.get")):
            local.call("stop.clear")
            time.sleep(2 * TTL_S)  # a stop follows where he is not seen as present yet
        time.sleep(wait_s)
        number = signal.SIGKILL if how == "killed" else signal.SIGSTOP
        process = supervisor if what == "program" else lab.parts[what].process
        begun_s = time.monotonic()
        process.send_signal(number)
        stop = local.until(is_stopped)["stop"]
    finally:
        supervisor.kill()
        supervisor.communicate()
    process.send_signal(signal.SIGCONT)
    if what != "program" and how == "killed":
        lab.parts[what].restart()
    until_reachable(lab)
    return float(stop["since_s"]) - begun_s


def measured(folder: Path, rounds: int, chance: random.Random) -> dict[str, list[float]]:
    """Return the times of each case."""
    certificates = make_certificates(folder / "tls", HOST, f"user:{USER}", "gateway:robot1")
    config = folder / "simulated.toml"
    config.write_text(SIMULATED, encoding="utf-8")
    with daemon(folder / "left", "left", "--config", str(config)) as gripper:
        sockets = {"left": gripper.socket_path}
        made = fleet(
            folder / "fleet",
            certificates,
            sockets,
            user=USER,
            role="observer",
            ttl_s=TTL_S,
            options=SWITCH,
        )
        with made as lab, gripper.connect() as local:
            return {
                case: [
                    stopped_after_s(lab, local, case, chance.uniform(0.0, TTL_S / 4))
                    for _ in range(rounds)
                ]
                for case in CASES
            }


def main() -> None:
    """Print a row for each case."""
    given = list(map(int, sys.argv[1:]))
    rounds, seed = given + [10, 1][len(given) :]
    with tempfile.TemporaryDirectory(prefix="silence-") as folder:
        found = measured(Path(folder), rounds, random.Random(seed))
    print(f"ttl_s {TTL_S:g}; stopped after, in s: least, median, most of {rounds}")
    for case, times_s in found.items():
        least, most = min(times_s), max(times_s)
        print(f"{case:<16}{least:6.2f}{statistics.median(times_s):6.2f}{most:6.2f}")


if __name__ == "__main__":
    main()
