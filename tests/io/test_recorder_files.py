"""Dumps on the disk: read back by an independent reader, bounded in number, whole or not there."""

import io
import json
import os
import re
import select
import signal
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
from mcap.reader import make_reader

from litegrip_client.values.foxglove import EVENT_SCHEMA, JOINTS_SCHEMA, TICK_SCHEMA
from litegripd.io.helper import helper
from litegripd.io.helper.atomic_file import FileError
from litegripd.io.helper.child import SharedMemory, copy_of, start_here
from litegripd.recorder import files as recorder_files
from litegripd.recorder.files import dump, prune, read, to_mcap
from litegripd.recorder.recorder import memory_bytes, tick_slots
from tests.io.test_helper import DEADLINE_S, Rig
from tests.world import PERIOD_S, World

Messages = dict[str, list[tuple[int, dict[str, Any]]]]
OFFSET_NS = 1_700_000_000_000_000_000
JSON_TYPES: dict[str, tuple[type, ...]] = {
    "number": (int, float),
    "integer": (int,),
    "string": (str,),
    "boolean": (bool,),
}


def messages_of(content: bytes) -> Messages:
    """Read a file with the reader of the format's own library, which checks what it reads."""
    found: Messages = {}
    for schema, channel, message in make_reader(io.BytesIO(content), True).iter_messages():
        assert schema is not None
        assert (schema.encoding, channel.message_encoding) == ("jsonschema", "json")
        found.setdefault(channel.topic, []).append((message.log_time, json.loads(message.data)))
    return found


@pytest.fixture(scope="module")
def memory() -> bytes:
    """A minute in which a motion ran, a client was refused, and the motor faulted."""
    world = World()
    client = world.enabled()
    client.result("motion.move", opening_mm=40, speed_mm_s=100)
    client.send("no.such.method")
    client.send("motion.open")
    world.run(0.2)
    world.gripper.set_supply(40.0)
    world.run(0.5)
    return bytes(world.disk.memory)


@pytest.fixture
def shared(
    memory: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> Iterator[SharedMemory]:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    made = SharedMemory(len(memory))
    made.view[:] = memory
    yield made
    made.close()


def test_every_tick_and_event_is_in_the_file_at_its_time(memory: bytes) -> None:
    recording = read(memory)
    found = messages_of(to_mcap(recording, "demand", "a note", OFFSET_NS))
    ticks, events = found["/litegrip/virtual/tick"], found["/litegrip/virtual/event"]
    assert len(ticks) == len(recording.ticks) > 200
    assert [tick["seq"] for _at, tick in ticks] == [tick.number for tick in recording.ticks]
    for (at_ns, fields), tick in zip(ticks, recording.ticks, strict=True):
        assert at_ns == OFFSET_NS + round(tick.at_s * 1e9)
        assert fields["monotonic_s"] == tick.at_s
    assert [event["message"] for _at, event in events] == [
        event.content["message"] for event in recording.events
    ]
    kinds = {event["name"] for _at, event in events}
    assert {"motor", "job_started", "job_ended", "refused", "owner"} <= kinds
    assert ticks[-1][1]["status"] == "over_voltage"


def test_what_is_written_is_what_the_schema_says(memory: bytes) -> None:
    found = messages_of(to_mcap(read(memory), "demand", "", OFFSET_NS))
    for topic, schema in (("tick", TICK_SCHEMA), ("event", EVENT_SCHEMA)):
        properties = schema["properties"]
        seen: set[str] = set()
        for _at, fields in found[f"/litegrip/virtual/{topic}"]:
            assert fields.keys() <= properties.keys()
            seen |= fields.keys()
            for name, value in fields.items():
                kind = properties[name]["type"]
                assert isinstance(value, JSON_TYPES.get(kind, (dict,))), (name, value)
        assert seen == properties.keys()  # the scene shows every field at least once


def test_what_was_measured_is_there_as_joints_that_viewers_know(memory: bytes) -> None:
    found = messages_of(to_mcap(read(memory), "demand", "", OFFSET_NS))
    ticks, joints = found["/litegrip/virtual/tick"], found["/litegrip/virtual/joints"]
    measured = [(at_ns, tick) for at_ns, tick in ticks if "position_rad" in tick][::4]
    assert [at_ns for at_ns, _joints in joints] == [at_ns for at_ns, _tick in measured]
    known = JOINTS_SCHEMA["properties"]["joints"]["items"]["properties"].keys()
    for (at_ns, states), (_at_ns, tick) in zip(joints, measured, strict=True):
        stamp = states["timestamp"]
        assert stamp["sec"] * 1_000_000_000 + stamp["nsec"] == at_ns
        motor, left, right = states["joints"]
        assert all(joint.keys() <= known for joint in states["joints"])
        assert motor["name"] == "motor"
        assert (motor["position"], motor["velocity"]) == (
            tick["position_rad"],
            tick["velocity_rad_s"],
        )
        assert motor["effort"] == tick["torque_nm"]
        # As the vendor's URDF has them: 0 is open, 0.042726 m closed, both with the same sign.
        names = ["gripper_slide_joint_left", "gripper_slide_joint_right"]
        assert [left["name"], right["name"]] == names
        assert left["position"] == right["position"]
        assert left["position"] == pytest.approx(0.042726 - tick["opening_mm"] / 2000, abs=2e-6)
    fingers = [states["joints"][1] for _at_ns, states in joints]
    fastest = max(range(len(fingers)), key=lambda at: float(fingers[at]["velocity"]))
    (before, now, after) = fingers[fastest - 1 : fastest + 2]
    mean_m_s = (after["position"] - before["position"]) / (8 * PERIOD_S)
    assert now["velocity"] > 0.01  # it closes
    assert now["velocity"] == pytest.approx(mean_m_s, rel=0.2)


def test_joints_are_what_foxglove_publishes_as_its_schema() -> None:
    properties = JOINTS_SCHEMA["properties"]
    assert JOINTS_SCHEMA["title"] == "foxglove.JointStates"
    assert properties.keys() == {"timestamp", "joints"}
    assert properties["timestamp"]["properties"].keys() == {"sec", "nsec"}
    joint = properties["joints"]["items"]["properties"]
    assert joint.keys() <= {"name", "position", "velocity", "acceleration", "effort"}


LAYOUT = Path(__file__).parents[2] / "docs" / "foxglove-layout.json"


def panels_in(tree: Any) -> list[str]:
    """Return the panels of a layout, from its first to its last."""
    if isinstance(tree, str):
        return [tree]
    return [*panels_in(tree["first"]), *panels_in(tree["second"])]


def test_the_layout_for_viewers_shows_what_a_dump_has(memory: bytes) -> None:
    reader = make_reader(io.BytesIO(to_mcap(read(memory), "demand", "", OFFSET_NS)))
    summary = reader.get_summary()
    assert summary is not None
    schemas = {
        channel.topic.replace("/virtual/", "/can0/"): summary.schemas[channel.schema_id]
        for channel in summary.channels.values()
    }
    layout = json.loads(LAYOUT.read_text("utf-8"))
    panels = layout["configById"]
    assert sorted(panels_in(layout["layout"])) == sorted(panels)
    paths = [path["value"] for panel in panels.values() for path in panel.get("paths", [])]
    assert len(paths) == len(set(paths)) > 8
    for path in paths:
        topic, _, field = path.partition(".")
        kind = json.loads(schemas[topic].data)["properties"][field]["type"]
        assert kind in ("number", "integer", "string", "boolean")
    assert schemas[panels["RosOut!events"]["topicToRender"]].name == "foxglove.Log"


def test_the_file_says_what_it_is(memory: bytes) -> None:
    reader = make_reader(io.BytesIO(to_mcap(read(memory), "motor_fault", "why", OFFSET_NS)))
    (about,) = reader.iter_metadata()
    assert about.metadata == {"channel": "virtual", "cause": "motor_fault", "note": "why"}
    summary = reader.get_summary()
    assert summary is not None
    assert summary.chunk_indexes  # a viewer can seek in it


def test_a_dump_goes_into_the_channels_directory(shared: SharedMemory, tmp_path: Path) -> None:
    result = dump("demand", "", shared.fd)
    path = Path(str(result["path"]))
    assert path.parent == tmp_path / "dumps" / "virtual"
    assert re.fullmatch(r"000001-\d{8}T\d{6}\.\d{3}Z-demand\.mcap", path.name)
    content = path.read_bytes()
    assert result["bytes"] == len(content)
    assert result["ticks"] == len(messages_of(content)["/litegrip/virtual/tick"])
    assert result["seconds"] == pytest.approx((int(str(result["ticks"])) - 1) * PERIOD_S)
    assert [name.name for name in path.parent.iterdir()] == [path.name]


def test_a_dump_that_cannot_be_written_is_an_error_that_names_it(
    shared: SharedMemory, tmp_path: Path
) -> None:
    (tmp_path / "dumps").write_text("no directory", encoding="utf-8")
    with pytest.raises(FileError, match=r"dumps/virtual/.*-demand\.mcap: cannot be written"):
        dump("demand", "", shared.fd)


def test_what_was_never_written_to_is_no_dump(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path))
    world = World()  # its recorder is made, and no tick is done
    made = SharedMemory(len(world.disk.memory))
    made.view[:] = bytes(world.disk.memory)
    with pytest.raises(FileError, match="nothing has been recorded"):
        dump("demand", "", made.fd)
    made.close()
    assert list(tmp_path.iterdir()) == []


def test_the_oldest_of_a_sort_are_removed_and_those_of_the_other_stay(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def make(number: int, cause: str, size: int = 10) -> Path:
        path = tmp_path / f"0000{number:02}-20260101T000000.000Z-{cause}.mcap"
        path.write_bytes(bytes(size))
        return path

    fault = make(0, "motor_fault")
    for number in range(1, 15):
        prune(tmp_path, keep=make(number, "demand"))
    kept = sorted(path.name[4:6] for path in tmp_path.glob("*-demand.mcap"))
    assert kept == [f"{number:02}" for number in range(5, 15)]
    assert fault.exists()
    monkeypatch.setattr(recorder_files, "KEPT_BYTES", 35)
    prune(tmp_path, keep=make(20, "crash", 15))
    assert fault.exists()
    prune(tmp_path, keep=make(21, "bus_lost", 15))
    assert sorted(path.name[4:6] for path in tmp_path.glob("*Z-[!d]*.mcap")) == ["20", "21"]
    prune(tmp_path, keep=make(22, "crash", 100))  # larger than allowed: all but itself go
    assert [path.name[4:6] for path in tmp_path.glob("*Z-[!d]*.mcap")] == ["22"]


def test_what_a_killed_helper_left_is_removed_by_the_dump_after_the_next(tmp_path: Path) -> None:
    """The next one could be written beside it, by the helper of a successor."""
    left = [
        tmp_path / f".{number:06}-20260101T000000.000Z-crash.mcap.12ab.tmp" for number in (5, 6, 7)
    ]
    for path in left:
        path.touch()
    keep = tmp_path / "000007-20260101T000000.000Z-demand.mcap"
    keep.touch()
    prune(tmp_path, keep)
    assert sorted(tmp_path.iterdir()) == sorted((*left[1:], keep))


def test_what_is_no_dump_of_the_daemon_is_left_alone(tmp_path: Path) -> None:
    other = [tmp_path / name for name in ("jerk.mcap", "2-jerk.mcap", ".jerk.mcap.1.tmp")]
    for path in other:
        path.touch()
    for number in range(1, 15):
        keep = tmp_path / f"{number:06}-20260101T000000.000Z-demand.mcap"
        keep.touch()
        prune(tmp_path, keep)
    assert sorted(tmp_path.glob("*jerk*")) == sorted(other)
    assert len(list(tmp_path.glob("0*.mcap"))) == recorder_files.KEPT_FILES


@pytest.mark.parametrize("jump_s", [-31.5e6, -3600.0, 3600.0, 31.5e6])
def test_a_clock_that_is_set_removes_no_dump_but_the_oldest(
    shared: SharedMemory, monkeypatch: pytest.MonkeyPatch, jump_s: float
) -> None:
    """Also one that was set there and back: neither the names' times nor the files' are asked."""
    clock_ns = [1_800_000_000 * 10**9]
    monkeypatch.setattr(time, "time_ns", lambda: clock_ns[0])
    made: list[Path] = []

    def fault(count: int, cause: str = "motor_fault") -> None:
        for _ in range(count):
            path = Path(str(dump(cause, "", shared.fd)["path"]))
            os.utime(path, ns=(clock_ns[0], clock_ns[0]))
            clock_ns[0] += 60 * 10**9
            made.append(path)
            assert [old for old in made if old.exists()] == made[-recorder_files.KEPT_FILES :]

    fault(recorder_files.KEPT_FILES)
    clock_ns[0] += round(jump_s * 1e9)
    fault(5)
    clock_ns[0] -= round(jump_s * 1e9)
    fault(5)
    assert [path.name[:6] for path in sorted(made)] == [f"{n:06}" for n in range(1, len(made) + 1)]


def test_shared_memory_keeps_its_size_and_its_descriptor_stays_at_home() -> None:
    made = SharedMemory(memory_bytes(tick_slots(PERIOD_S)))
    assert not os.get_inheritable(made.fd)
    made.view[:4] = b"abcd"
    assert copy_of(made.fd)[:5] == b"abcd\0"
    assert len(copy_of(made.fd)) == len(made.view)
    made.close()


def helper_with(shared: SharedMemory) -> Rig:
    return Rig("litegripd.app.helper_main", shared.fd)


def dumps_in(tmp_path: Path) -> list[Path]:
    return sorted((tmp_path / "dumps" / "virtual").glob("*.mcap"))


def test_the_helper_writes_what_is_in_the_memory_now(shared: SharedMemory, tmp_path: Path) -> None:
    rig = helper_with(shared)
    result = rig.ask("recorder.dump", cause="demand", note="")
    assert result.error is None, result
    rig.helper.close()
    assert len(dumps_in(tmp_path)) == 1  # it ended as it should: there is nothing to tell


def test_a_helper_that_is_started_again_has_the_memory_too(shared: SharedMemory) -> None:
    rig = helper_with(shared)
    assert rig.helper.pid is not None
    os.kill(rig.helper.pid, signal.SIGKILL)
    rig.until(lambda: rig.helper.deaths == 1)
    rig.until(lambda: rig.helper.is_running)
    assert rig.ask("recorder.dump", cause="demand", note="").error is None
    rig.helper.close()


def test_without_a_goodbye_the_helper_writes_what_the_daemon_did_last(
    shared: SharedMemory, tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    child = start_here("litegripd.app.helper_main", memory_fd=shared.fd)
    child.close(DEADLINE_S)
    (path,) = dumps_in(tmp_path)
    assert path.name.endswith("-crash.mcap")
    assert messages_of(path.read_bytes())["/litegrip/virtual/tick"]
    assert str(path) in capfd.readouterr().err


def test_a_daemon_that_dies_with_an_answer_unread_leaves_its_last_minute(
    shared: SharedMemory, tmp_path: Path
) -> None:
    """The helper is told of a reset before it is told of the end."""
    child = start_here("litegripd.app.helper_main", memory_fd=shared.fd)
    assert child.send(json.dumps([1, "calibration.templates", {}]).encode())
    assert select.select([child.socket], [], [], DEADLINE_S)[0]
    child.close(DEADLINE_S)
    (path,) = dumps_in(tmp_path)
    assert path.name.endswith("-crash.mcap")


def test_an_end_before_the_last_answer_is_no_crash(
    shared: SharedMemory, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(helper, "FINISH_WITHIN_S", 20.0)  # a busy machine takes its time
    rig = helper_with(shared)
    rig.helper.request("recorder.dump", {"cause": "motor_fault", "note": ""}, rig.results.append)
    rig.helper.close()
    (path,) = dumps_in(tmp_path)
    assert path.name.endswith("-motor_fault.mcap")


def test_a_group_that_is_sent_sigterm_loses_no_helper(shared: SharedMemory) -> None:
    rig = helper_with(shared)
    assert rig.helper.pid is not None
    rig.ask("motion.load", channel="virtual")
    os.kill(rig.helper.pid, signal.SIGTERM)
    assert rig.ask("recorder.dump", cause="demand", note="").error is None
    assert rig.helper.deaths == 0
    rig.helper.close()
