"""Hostile lines by the thousand: each answered once, none a defect, and the gripper as before.

LITEGRIPD_FUZZ_LINES sets another number of lines, for a long run; LITEGRIPD_FUZZ_SEED another seed.
"""

import json
import os
import random

from bench.hostile.lines import HostileLines
from tests.world import Client, enabled_world

LINES = int(os.environ.get("LITEGRIPD_FUZZ_LINES", "12000"))
SEED = int(os.environ.get("LITEGRIPD_FUZZ_SEED", "1"))


def test_hostile_lines_are_each_answered_once_and_do_no_harm() -> None:
    chance = random.Random(SEED)
    world, good = enabled_world()
    hostile = HostileLines(chance)
    clients = [world.client() for _ in range(4)]
    for number in range(LINES):
        client = clients[number % len(clients)]
        line = hostile.line()
        waiting = client.session.unanswered
        world.service.handle(client.session, line, world.now_s)
        check_answered(client, line, client.session.unanswered - waiting)
        if number % 50 == 0:
            world.tick()
            world.sent.clear()
        if number % 500 == 0:
            index = chance.randrange(len(clients))
            clients[index].leave()
            clients[index] = world.client()
        if number % 1000 == 0:
            assert good.result("state.get")["seq"] > 0
    good.result("lease.take", why="the end")
    good.result("stop.clear")
    world.run_until(lambda: world.controller.jobs.running is None or not cancelled(good))
    good.result("calibration.load", template="normal")
    good.result("config.set", config={"settle_s": 0.1, "press_overshoot": 0.05})
    assert good.result("motor.enable")["ok"]
    assert good.result("state.get")["enabled"]


def cancelled(client: Client) -> bool:
    """Cancel whatever runs or waits; tell whether anything did."""
    open_jobs = [
        job for job in client.result("job.list")["jobs"] if job["state"] in ("running", "queued")
    ]
    for job in open_jobs:
        client.result("job.cancel", job=job["job"])
    return bool(open_jobs)


def check_answered(client: Client, line: bytes, left_waiting: int) -> None:
    """Check that a line got one answer, or waits for it, or wanted none."""
    lines = [json.loads(one) for one in client.session.outgoing]
    client.session.outgoing.clear()
    answers = [one for one in lines if "method" not in one]
    for one in answers:
        assert one.get("error", {}).get("data", {}).get("reason") != "internal_error", (line, one)
    may_notify = b"stream.set" in line or b"teleop.receive" in line
    if may_notify and not answers:
        return  # it may be sent without an id, and then has no answer
    assert len(answers) + left_waiting >= 1 or b'"id"' not in line, (line, lines)
