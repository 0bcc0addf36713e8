"""The page on the protocol names what the daemon sends, no more and no less."""

import json
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from docs.protocol_fields import JOB, MODES, PARAMS, TELEOP
from litegrip_client.values.fields import STILL_RAD_S
from litegripd.app.build import METHODS
from tests.rpc.transcripts import FOLDER, talk
from tests.world import World

ROOT = Path(__file__).parents[2]
PAGE = (ROOT / "docs/protocol.md").read_text(encoding="utf-8")


def fields_of(title: str) -> set[str]:
    section = PAGE.split(f"\n## {title}\n")[1].split("\n## ")[0]
    return set(re.findall(r"^\| `(\w+)`", section, re.MULTILINE))


def sent() -> Iterator[dict[str, Any]]:
    """Yield the notifications of all methods' transcripts, as the daemon sends them today."""
    for exchanges in talk().values():
        for exchange in exchanges:
            yield from exchange["notifications"]


def test_every_notification_that_the_daemon_sends_has_a_row() -> None:
    sources = "".join(path.read_text("utf-8") for path in (ROOT / "litegripd").rglob("*.py"))
    named = set(re.findall(r'notification_line\(\s*"([\w.]+)"', sources))
    refused = {method.refused_as for method in METHODS if method.may_notify}
    assert named | refused == set(PARAMS)
    section = PAGE.split("## Notifications\n")[1].split("\n## ")[0]
    assert all(f"| `{kind}` |" in section for kind in PARAMS)


def test_the_fields_of_jobs_progress_and_teleoperation_are_those_that_are_sent() -> None:
    today = talk()
    assert set(today["job.get"][0]["answer"]["result"]) == set(JOB) == fields_of("Jobs")
    status = today["teleop.status"][0]["answer"]["result"]
    assert set(status) == set(TELEOP) == fields_of("The status of teleoperation")
    told = [n["params"] for n in sent() if n["method"] == "job.progress"]
    assert told
    assert fields_of("Progress") in map(set, told)


def test_a_moves_result_is_told_field_by_field() -> None:
    kept = json.loads((FOLDER / "motion.open.json").read_text(encoding="utf-8"))
    result = set(kept[0]["answer"]["result"]) - {"job", "state"}
    section = PAGE.split("### `MoveResult`\n")[1].split("\n### ")[0]
    assert set(re.findall(r"^\| `(\w+)`", section, re.MULTILINE)) == result


def test_who_may_leave_out_the_id_is_said() -> None:
    assert [method.name for method in METHODS if method.may_notify] == [
        "stream.set",
        "teleop.receive",
    ]
    said = "without an `id`, a string or an integer, except `stream.set` and `teleop.receive`"
    assert said in " ".join(PAGE.split())


def test_each_mode_means_what_the_page_says() -> None:
    world = World()
    world.gripper.put_object(width_mm=40.0)
    client = world.client()

    seen: list[str] = [world.state.mode]
    world.start()
    for method, params, found in (
        ("motor.enable", {}, "holding"),
        ("motion.zero_gravity", {}, "relaxed"),
        ("motion.hold", {}, "holding"),
        ("stop", {"level": "relax"}, "relaxed"),
    ):
        seen.append(world.state.mode)
        client.send(method, **params)
        seen += world.track(1.0, lambda: world.state.mode)
        assert world.state.mode == found
    client.result("stop.clear")
    client.send("motion.grasp", force_n=10.0)
    world.run(4.0)
    assert (world.state.mode, world.state.is_grasped) == ("moving", True)
    assert abs(world.state.velocity_rad_s or 0.0) < STILL_RAD_S
    world.gripper.latch_fault(0x8)
    seen += world.track(0.2, lambda: world.state.mode)
    assert seen[-1] == "fault"
    client.result("motor.enable")
    client.send("motor.disable")
    seen += world.track(0.2, lambda: world.state.mode)
    assert seen[-1] == "disabled"
    assert set(seen) == set(MODES)
    section = PAGE.split("\n## The state\n")[1].split("\n## ")[0]
    assert all(f"| `{name}` | {meaning} |" in section for name, meaning in MODES.items())
