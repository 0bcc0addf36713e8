"""What clients and daemon say to each other, by method, as files that later versions keep to.

    python -m tests.rpc.transcripts      write the transcripts of methods that have none yet

A transcript that is there is never written anew: it is what clients of its time expect. Evolution
is by addition, so an answer may grow but not shrink.
"""

import json
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from litegripd.app.build import METHODS
from litegripd.model.calibration import SUPERSEDED
from litegripd.model.state import Restarted
from tests.trajectories import lgt, pieces
from tests.world import Client, found_world

TAUGHT_THEN: dict[str, Any] = {
    "closed_rad": SUPERSEDED[0].closed_rad,
    "open_rad": SUPERSEDED[0].open_rad,
    "rad_to_mm": SUPERSEDED[0].rad_to_mm,
}
"""A trajectory of that time, whose gripper had other limits and another scale."""
FOLDER = Path(__file__).parent / "transcripts"

Params = dict[str, Any]


def conversation(client: Client) -> Iterator[tuple[str, Params]]:
    """Give the requests of one session that uses every method, in an order that works."""
    yield "hello", {"client": "transcript"}
    for method in ("rpc.discover", "health", "info.get", "state.get", "lease.get"):
        yield method, {}
    yield "state.subscribe", {"hz": 20, "fields": ["position_rad", "mode"]}
    yield "state.unsubscribe", {"subscription": 1}
    yield "events.subscribe", {"kinds": ["stop"]}
    yield "events.unsubscribe", {"subscription": 2}
    yield "clients.list", {}
    yield "lease.acquire", {"purpose": "a test", "ttl_s": 600, "on_lost": "hold", "wait_s": 0}
    yield "lease.renew", {}
    yield "motor.scan", {}
    yield "motor.enable", {"retries": 3}
    yield "motor.read_register", {"register": "PMAX"}
    yield "motion.open", {"speed_mm_s": 100, "progress": True, "key": "one"}
    yield "motion.close", {"speed_mm_s": 100, "config": {"settle_s": 0.1}}
    yield "motion.move", {"opening_mm": 40, "speed_mm_s": 100}
    yield "motion.move", {"openness": 0.5, "duration_s": 1.0, "wait": False}
    yield "job.wait", {"job": 5}
    yield "motion.grasp", {"force_n": 5, "hold_s": 0.2, "width_mm": 30, "tolerance_mm": 2}
    yield "motion.set_force", {"force_n": 2}
    yield "motion.hold", {}
    yield "stream.set", {"opening_mm": 30, "valid_s": 0.05, "speed_mm_s": 50, "torque_nm": 1}
    client.world.run(0.5)
    yield "motion.zero_gravity", {}
    yield "motion.open", {"wait": False, "detach": True, "if_busy": "reject"}
    yield "job.list", {}
    yield "job.cancel", {"job": 11}
    yield "job.get", {"job": 11}
    yield "calibration.templates", {}
    yield "calibration.load", {"template": "normal"}
    yield "calibration.get", {}
    yield "calibration.rescale", {"stroke_mm": 84}
    yield "calibration.rescale", {}
    yield "calibration.zero", {"save": True}
    yield "calibration.save", {}
    yield "calibration.manual", {"step": "begin"}
    client.world.run(0.1)
    for step in ("closed", "cancel"):
        yield "calibration.manual", {"step": step}
    yield "config.get", {}
    yield "config.set", {"config": {"force_n": 10}, "keep": True}
    yield "teleop.start", {"mode": "master", "link": "none", "rate_hz": 50}
    client.world.run(0.2)
    yield "teleop.status", {}
    yield "teleop.stop", {}
    yield "teleop.start", {"mode": "slave", "link": "client"}
    client.world.run(0.1)
    yield "teleop.receive", {"topic": "litearm/v4/gripA/gripper_teleop", "payload": "00"}
    yield "teleop.stop", {}
    yield "stop", {"level": "hold", "why": "a test"}
    yield "motion.open", {}
    yield "stop.clear", {}
    yield "lease.take", {"why": "a test"}
    yield "lease.release", {}
    yield "lease.resume", {"lease": "0:1"}
    yield from trajectories(client)
    yield "motor.set_zero", {}
    yield "motor.disable", {}
    yield "motor.clear_fault", {}
    yield "recorder.dump", {"note": "a test"}
    client.world.restart = lambda told: told(Restarted(4711, 0.005))
    yield "daemon.restart", {"hold_through_restart": True}
    yield "daemon.restart", {"hold_through_restart": False}
    yield "motion.open", {"speed_mm_s": "fast"}
    yield "no.such.method", {}


def trajectories(client: Client) -> Iterator[tuple[str, Params]]:
    """Record by hand and beside a motion, keep, fetch, send, play and remove."""
    yield "trajectory.status", {}
    yield "trajectory.record_start", {"rate_hz": 50, "max_samples": 500}
    client.world.run(0.1)
    yield "trajectory.status", {}
    yield "trajectory.record_stop", {"allow_empty": True, "allow_partial": True}
    yield "trajectory.record_start", {"zero_gravity": False}
    client.world.run(0.1)
    yield "trajectory.record_stop", {"name": "a test"}
    yield "trajectory.record_stop", {}
    yield "trajectory.list", {"after": "a"}
    yield "trajectory.get", {"name": "a test", "offset": 0, "length": 66, "format": "lgt"}
    yield "trajectory.get", {"recording": 1, "format": "csv"}
    for piece in pieces(lgt([(0.0, 0.2), (0.5, 0.3), (1.0, 0.2)], **TAUGHT_THEN)):
        yield "trajectory.put", piece
    yield "trajectory.play", {"name": "a test", "speed": 0.5, "align": True, "repeat": 2}
    yield "trajectory.play", {"upload": 1, "torque_nm": 1, "kp": 50, "kd": 1, "wait": False}
    client.world.run(0.1)
    yield "trajectory.play", {"recording": 1, "loop": True}
    yield "trajectory.control", {"action": "pause"}
    yield "trajectory.control", {"action": "speed", "speed": 2.0}
    yield "trajectory.control", {"action": "resume"}
    yield "trajectory.status", {}
    client.world.run(5.0)
    yield "trajectory.control", {"action": "pause"}
    yield "trajectory.delete", {"upload": 1}
    yield "trajectory.delete", {"name": "a test"}
    yield "trajectory.delete", {"name": "a test"}


@cache
def talk() -> dict[str, list[dict[str, Any]]]:
    """Hold the conversation with today's daemon; return the exchanges by method."""
    _, client = found_world()
    exchanges: dict[str, list[dict[str, Any]]] = {}
    for method, params in conversation(client):
        seen = len(client.notifications)
        answer = client.call(method, **params)
        exchange = {
            "params": params,
            "answer": {key: answer[key] for key in ("result", "error") if key in answer},
            "notifications": client.notifications[seen:][:1],
        }
        exchanges.setdefault(method, []).append(exchange)
    return exchanges


def main() -> None:
    """Write what is missing."""
    FOLDER.mkdir(exist_ok=True)
    for method, exchanges in talk().items():
        path = FOLDER / f"{method}.json"
        if not path.exists():
            path.write_text(json.dumps(exchanges, indent=1) + "\n", encoding="utf-8")
            print(f"{path.name} written")
    missing = {method.name for method in METHODS} - {path.stem for path in FOLDER.glob("*.json")}
    if missing:
        raise SystemExit(f"the conversation lacks: {', '.join(sorted(missing))}")


if __name__ == "__main__":
    main()
