"""Calibrations whose scale or limits are wrong, on every path by which one arrives.

What cannot be this gripper's is refused with the figures and a remedy, and what is in use stays in
force; at the start nothing else takes its place. The scale of earlier versions is taken, and warned
of.
"""

import json
import logging
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from litegrip_client.values.errors import from_error_object
from litegrip_client.values.voices import in_shell
from litegripd.app.build import load_at_start
from litegripd.app.helper_main import OPERATIONS, _answers
from litegripd.app.main import EXIT_USAGE, main
from litegripd.app.status import log_event
from litegripd.io.helper import files
from litegripd.model.calibration import NOMINAL, SUPERSEDED
from litegripd.model.gripper import Geometry, GripperId
from litegripd.model.state import HelperTask, TaskResult
from litegripd.sim import registers as reg
from tests.app.test_facts import info, verdict
from tests.sim.driving import write
from tests.world import Client, Disk, World, enabled_world

DEGREES = 57.29578
SCALES, LIMITS = (0.5, 2.0, 10.0, 75.0), (2.0, 10.0, DEGREES)
NORMAL, OLD = NOMINAL[0], SUPERSEDED[0]


def content_of(geometry: Geometry, scale: float = 1.0, limits: float = 1.0) -> dict[str, Any]:
    """Return what a file holds, with a scale and limits that are off by these factors."""
    return {
        "zero_position_rad": limits * geometry.closed_rad,
        "max_position_rad": limits * geometry.open_rad,
        "rad_to_mm": scale * geometry.rad_to_mm,
    }


WRONG = [
    *(pytest.param(content_of(NORMAL, scale=by), id=f"scale x {by:g}") for by in SCALES),
    *(pytest.param(content_of(NORMAL, limits=by), id=f"limits x {by:g}") for by in LIMITS),
]

ONE_OF_EACH = [WRONG[1], WRONG[-1]]
"""Which others there are is tried in tests/model/test_calibration.py."""


class FileDisk(Disk):
    """A helper that tells of a file that it cannot use as the real one does."""

    def do(self, task: HelperTask) -> TaskResult:
        if task.operation == "motion.load":
            return TaskResult({"config": None, "path": ""})
        return super().do(task)


class HelperDisk(FileDisk):
    """A helper whose errors are told as its process tells them."""

    def do(self, task: HelperTask) -> TaskResult:
        if task.operation != "calibration.load":
            return super().do(task)
        [answer] = _answers(OPERATIONS, task.operation, {**task.parameters})
        told = json.loads(answer[1:])
        return TaskResult(error=told) if answer[:1] == b"e" else TaskResult(told)


@dataclass(frozen=True, slots=True)
class Way:
    """A way on which a daemon takes a file at its start: where it is, and what names it."""

    name: str
    file: Callable[[Path], Path]
    mount: Callable[[Path], str | None] = lambda _root: None
    variable: bool = False
    others: tuple[str, ...] = ()
    """Files that the search would find after this one."""

    def put(self, root: Path, content: Mapping[str, Any], patch: pytest.MonkeyPatch) -> Path:
        """Put a file there, and good ones wherever else one is looked for later."""
        for other in self.others:
            (root / other).write_text(json.dumps(content_of(NOMINAL[1])), encoding="utf-8")
        path = self.file(root)
        path.write_text(json.dumps(content), encoding="utf-8")
        if self.variable:
            patch.setenv("LITEGRIP_CALIB", str(path))
        return path


def named(root: Path) -> Path:
    return root / "mine.json"


OWN, HOME, OLD_HOME = (
    "state/can0_calibration.json",
    ".litegrip/can0_calibration.json",
    ".litegrip/litegrip_calibration.json",
)
AT_START = [
    Way("the daemon's own file", lambda root: root / OWN, others=(HOME, OLD_HOME)),
    Way("its user's file of the channel", lambda root: root / HOME, others=(OLD_HOME,)),
    Way("its user's file for all channels", lambda root: root / OLD_HOME),
    Way("the factory's file", lambda root: root / "data" / "factory.json"),
    Way("a file that mount names", named, lambda root: str(named(root)), others=(OWN, HOME)),
    Way("LITEGRIP_CALIB", named, variable=True, others=(OWN, HOME)),
    Way("a template that mount names", lambda root: root / "data" / "normal.json",
        lambda _root: "normal", others=(HOME,)),
    Way("the own file of a named mount", lambda root: root / OWN, lambda _root: "normal",
        others=(HOME,)),
]  # fmt: skip


@pytest.fixture(autouse=True)
def root(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("HOME", str(tmp_path))
    monkeypatch.setenv("STATE_DIRECTORY", str(tmp_path / "state"))
    monkeypatch.delenv("LITEGRIP_CALIB", raising=False)
    for name in ("state", ".litegrip", "data"):
        (tmp_path / name).mkdir()
    for path in files.DATA.glob("*.json"):
        (tmp_path / "data" / path.name).write_bytes(path.read_bytes())
    monkeypatch.setattr(files, "DATA", tmp_path / "data")
    return tmp_path


def journalled(world: World) -> World:
    """Let a world's events go to the log, as the daemon's do."""
    world.service.on_event = lambda event, _now_s: log_event(event, "can0")
    return world


def started(mount: str | None) -> World:
    """Return a world whose daemon takes what its files have."""
    world = journalled(World(calibrated=False))
    world.disk = FileDisk()
    world.controller.gripper_id = GripperId(mount=mount)
    load_at_start(world.controller, lambda: None)
    return world.start()


def started_on(channel: str) -> World:
    """Return the same for a channel of this name, whose calibration is searched for."""
    world = World(calibrated=False)
    world.disk = FileDisk()
    world.controller.gripper_id = GripperId(channel=channel)
    load_at_start(world.controller, lambda: None)
    return world.start()


def figures(content: Mapping[str, Any]) -> list[str]:
    """Return what a refusal must say: both numbers, and what to do."""
    travel_rad = abs(content["zero_position_rad"] - content["max_position_rad"])
    if abs(content["max_position_rad"]) > 12.5:
        furthest = f"a limit is {abs(content['max_position_rad']):g} rad"
        return [furthest, "at most ±12.5 rad", "limits are radians, not degrees"]
    travel_mm = travel_rad * content["rad_to_mm"]
    return [
        f"{travel_mm:.4g} mm of travel",
        "the configured stroke is 85 mm",
        "Measure how far the jaws open",
        f"correct its rad_to_mm ({86.0 / travel_rad:.4g} for these limits)",
    ]


REPAIR = (
    "repair that file and have it read again (litegripctl -c can0 calibration load --chain), or"
    " measure again: litegripctl -c can0 enable, then litegripctl -c can0 zero --mount"
)


def test_a_file_that_cannot_be_read_is_told_with_its_remedy_and_in_words_alone(
    root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    path = root / "bad.json"
    path.write_text("{}", encoding="utf-8")
    world = journalled(World(calibrated=False))
    world.disk = HelperDisk()
    world.controller.gripper_id = GripperId(mount=str(path))
    load_at_start(world.controller, lambda: None)
    error = world.start().enabled().call("motion.open")["error"]
    assert error["message"] == f"no calibration: {path}: zero_position_rad is missing"
    told = from_error_object(error, "motion.open", in_shell)
    assert told.hint == REPAIR.replace(" -c can0", "")
    told = from_error_object(error, "motion.open")
    assert told.hint == (
        "repair that file and have it read again (gripper.load_calibration()), or measure again:"
        " gripper.enable(), then gripper.zero(mount=...)"
    )
    assert error["message"] in caplog.text
    assert REPAIR in caplog.text
    assert "CalibrationError" not in caplog.text


@pytest.mark.parametrize("way", AT_START, ids=lambda way: way.name)
@pytest.mark.parametrize("content", ONE_OF_EACH)
def test_at_the_start_a_wrong_one_leaves_the_gripper_uncalibrated_with_the_reason(
    root: Path,
    monkeypatch: pytest.MonkeyPatch,
    caplog: pytest.LogCaptureFixture,
    way: Way,
    content: dict[str, Any],
) -> None:
    path = way.put(root, content, monkeypatch)
    world = started(way.mount(root))
    client = world.enabled()
    error = client.call("motion.open")["error"]
    assert error["data"]["reason"] == "calibration_unreadable"
    for words in (str(path), *figures(content)):
        assert words in error["message"]
    assert error["message"] in [
        one.getMessage() for one in caplog.records if one.levelno == logging.ERROR
    ]
    assert REPAIR in caplog.text
    view = client.result("calibration.get")
    assert (view["calibrated"], view["mount"], view["file"]) == (False, None, None)
    assert world.state.calibrated is False
    judged, reasons = verdict(world)
    assert judged != "ok"
    assert any(figures(content)[0] in reason for reason in reasons)
    path.unlink()  # what a client then loads counts
    if way.file(root).parent.name != "data":
        assert client.result("calibration.load", template="normal")["loaded"]
        assert client.result("motion.open")["ok"]


NAMED = [way for way in AT_START if way.name in ("a file that mount names", "LITEGRIP_CALIB")]


def checked(mount: str | None, capfd: pytest.CaptureFixture[str]) -> tuple[int, Any]:
    """Return the exit code of `litegripd can0 --check`, and what it says of the file."""
    config = Path.home() / "can0.toml"
    config.write_text("" if mount is None else f'[gripper]\nmount = "{mount}"\n')
    code = main(["can0", "--config", str(config), "--check"])
    return code, json.loads(capfd.readouterr().out)["calibration"]


@pytest.mark.parametrize("way", NAMED, ids=lambda way: way.name)
@pytest.mark.parametrize("content", ONE_OF_EACH)
def test_check_reads_the_file_that_is_named_and_says_what_the_daemon_will(
    root: Path,
    monkeypatch: pytest.MonkeyPatch,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
    way: Way,
    content: dict[str, Any],
) -> None:
    path = way.put(root, content, monkeypatch)
    world = started(way.mount(root))
    refused = world.enabled().call("motion.open")["error"]["message"]
    code, judged = checked(way.mount(root), capfd)
    assert code == EXIT_USAGE
    assert judged["file"] == str(path)
    assert judged["problem"] == refused
    path.write_text('{"rad_to_mm": 1e400}')
    code, judged = checked(way.mount(root), capfd)
    assert code == EXIT_USAGE
    assert judged["problem"].endswith("rad_to_mm is 1e400, it must be 0.001 to 1000000")
    assert judged["problem"] in caplog.text


@pytest.mark.parametrize("way", NAMED, ids=lambda way: way.name)
def test_check_warns_of_what_the_daemon_will_warn_of(
    root: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str], way: Way
) -> None:
    content = {**content_of(OLD), "channel": "can7", "work_stroke_mm": 200.0}
    way.put(root, content, monkeypatch)
    code, judged = checked(way.mount(root), capfd)
    assert (code, judged["problem"]) == (0, None)
    assert judged["named_by"] == ("LITEGRIP_CALIB" if way.variable else "[gripper] mount")
    for words in (SUPERSEDED_SAYS, "channel 'can7'", "work_stroke_mm is 200, beyond"):
        assert any(words in one for one in judged["warnings"])
    way.put(root, {**content_of(NORMAL), "calibrated": False}, monkeypatch)
    code, judged = checked(way.mount(root), capfd)
    assert code == EXIT_USAGE
    assert "calibrated = false" in judged["problem"]


def test_check_judges_no_file_that_is_not_named(
    root: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    (root / HOME).write_text("{")
    assert checked(None, capfd) == (0, None)
    monkeypatch.setenv("LITEGRIP_CALIB", str(root / "none.json"))
    assert checked("normal", capfd) == (0, None)
    code, judged = checked(None, capfd)
    assert code == EXIT_USAGE
    assert judged["problem"].endswith("none.json: there is no such file")


def loads_content(_world: World, client: Client, content: dict[str, Any]) -> dict[str, Any]:
    return client.call("calibration.load", content=content)


def loads_template(_world: World, client: Client, content: dict[str, Any]) -> dict[str, Any]:
    (files.DATA / "normal.json").write_text(json.dumps(content), encoding="utf-8")
    return client.call("calibration.load", template="normal")


def loads_own_file(_world: World, client: Client, content: dict[str, Any]) -> dict[str, Any]:
    files.own_file("can0", "calibration").write_text(json.dumps(content), encoding="utf-8")
    return client.call("calibration.load")


def loads_named_file(world: World, client: Client, content: dict[str, Any]) -> dict[str, Any]:
    path = files.DATA / "named.json"
    path.write_text(json.dumps(content), encoding="utf-8")
    world.controller.gripper_id = GripperId(mount=str(path))
    return client.call("calibration.load")


BY_CLIENTS = [loads_content, loads_template, loads_own_file, loads_named_file]
by_clients = pytest.mark.parametrize("load", BY_CLIENTS, ids=lambda load: load.__name__)
Loads = Callable[[World, Client, dict[str, Any]], dict[str, Any]]


@by_clients
@pytest.mark.parametrize("content", ONE_OF_EACH)
def test_a_wrong_one_that_a_client_loads_is_refused_and_the_one_in_use_stays(
    load: Loads, content: dict[str, Any]
) -> None:
    world, client = enabled_world()
    before = client.result("calibration.get")
    error = load(world, client, content)["error"]
    assert error["data"]["reason"] == "calibration_unreadable"
    for words in figures(content):
        assert words in error["message"]
    assert client.result("calibration.get") == before
    assert client.result("motion.open")["ok"]


def test_a_client_learns_that_its_scale_is_wrong_though_none_is_in_use() -> None:
    client = World(calibrated=False).enabled()
    answer = client.call("calibration.load", content=content_of(NORMAL, scale=2.0))
    assert answer["error"]["data"]["reason"] == "calibration_unreadable"
    assert client.refusal("motion.open") == "not_calibrated"


def assert_told(world: World, caplog: pytest.LogCaptureFixture, sentence: str) -> None:
    """Check that something is warned of once in the log, and once as a reason of the verdict."""
    logged = sentence.replace("calibration.zero", "litegripctl -c can0 zero")
    told = [one for one in caplog.records if logged in one.getMessage()]
    assert [one.levelno for one in told] == [logging.WARNING]
    judged, reasons = verdict(world)
    assert judged == "degraded"
    assert sum(sentence in reason for reason in reasons) == 1


def assert_warned_of(world: World, caplog: pytest.LogCaptureFixture, sentence: str) -> None:
    """Check that a scale in use is warned of wherever somebody may look."""
    assert_told(world, caplog, sentence)
    client = world.client()
    assert sentence in client.result("calibration.get")["scale_warning"]
    assert client.result("state.get")["scale_doubt"] == world.state.scale_doubt


SUPERSEDED_SAYS = "the calibration takes the jaws' travel for 120.1 mm, as earlier versions did"


@pytest.mark.parametrize("way", AT_START, ids=lambda way: way.name)
def test_at_the_start_the_scale_of_earlier_versions_is_taken_and_warned_of(
    root: Path, monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture, way: Way
) -> None:
    caplog.set_level(logging.INFO)
    path = way.put(root, content_of(OLD), monkeypatch)
    world = started(way.mount(root))
    world.run(0.1)
    assert world.controller.calibrated.file == str(path)
    assert world.state.scale_doubt == "superseded"
    assert_warned_of(world, caplog, SUPERSEDED_SAYS)


@by_clients
def test_the_scale_of_earlier_versions_that_a_client_loads_is_taken_and_warned_of(
    load: Loads, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    world = journalled(World()).start()
    client = world.client()
    assert client.result("calibration.get")["scale_warning"] is None
    answer = load(world, client, content_of(OLD))
    assert SUPERSEDED_SAYS in answer["result"]["scale_warning"]
    world.run(0.1)
    assert world.state.scale_doubt == "superseded"
    assert_warned_of(world, caplog, SUPERSEDED_SAYS)
    client.result("calibration.rescale")
    world.tick()
    assert client.result("state.get")["scale_doubt"] is None
    assert verdict(world) == ("ok", [])
    assert client.result("calibration.get")["scale_warning"] is None


@pytest.mark.parametrize("rad_to_mm", [43.0, 82.0])
def test_an_unusual_scale_that_fits_the_stroke_is_taken_and_warned_of(
    rad_to_mm: float, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    world = journalled(World()).start()
    content = content_of(Geometry(0.0, -86.0 / rad_to_mm, rad_to_mm))
    world.client().result("calibration.load", content=content)
    world.run(0.1)
    assert world.state.scale_doubt == "unusual"
    sentence = f"the calibration has {rad_to_mm:g} mm/rad, and grippers of 45 to 80 mm/rad"
    assert_warned_of(world, caplog, sentence)


def test_limits_are_judged_by_what_the_motor_itself_reports_at_most() -> None:
    """PMAX is a register; a fresh motor has 12.5 rad."""
    world = World().start()
    content = content_of(Geometry(9.0, 9.0 - NORMAL.travel_rad, NORMAL.rad_to_mm))
    assert world.client().result("calibration.load", content=content)["loaded"]
    world.client().result("calibration.load", template="normal")
    narrow = World()
    narrow.gripper.receive(narrow.now_s, write(reg.PMAX, 8.0))
    error = narrow.start().client().call("calibration.load", content=content)["error"]
    assert "a limit is 9 rad, and the motor reports at most ±8 rad" in error["message"]


FOREIGN: list[tuple[dict[str, Any], str]] = [
    ({"can_id": 7}, "can_id 0x07, and this motor is 0x08"),
    ({"can_id": "0x07"}, "can_id 0x07, and this motor is 0x08"),
    ({"can_id": [8]}, "can_id [8], and this motor is 0x08"),
    ({"mst_id": 0x12}, "mst_id 0x12, and this motor answers on 0x18"),
    ({"mst_id": "18"}, "mst_id 0x12, and this motor answers"),
    ({"canfd_mode": True}, "canfd_mode (CAN FD), and this motor is driven by"),
    ({"canfd_mode": "true"}, "canfd_mode (CAN FD), and"),
    ({"motor_type": "DM4340"}, "'DM4340', and this motor is a DM4310"),
    ({"motor_type": 3}, "'DM4340', and this motor is a DM4310"),
    ({"channel": "can7"}, "channel 'can7', and this is can0"),
]
"""What says that a file is another gripper's, and what is said of it."""

OWN_MARKS = {"channel": "can0", "can_id": 8, "mst_id": 24, "canfd_mode": False}
TAUGHT = content_of(Geometry(0.05, -1.55, 53.75))
"""A calibration of the right size that was measured on some gripper."""


@pytest.mark.parametrize(("mark", "says"), FOREIGN, ids=str)
def test_another_grippers_is_taken_and_said_to_be_one_wherever_somebody_looks(
    mark: dict[str, Any], says: str, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    world = journalled(World()).start()
    client = world.client()
    answer = client.result("calibration.load", content={**TAUGHT, **OWN_MARKS, **mark})
    (warned,) = answer["warnings"]
    assert answer["loaded"]
    assert says in warned
    world.run(0.1)
    assert client.result("calibration.get")["warnings"] == [warned]
    assert info(world)["calibration"]["foreign"] == warned
    assert_told(world, caplog, warned)


@pytest.mark.parametrize(
    "marks",
    [
        {},
        OWN_MARKS,
        {"mst_id": 0},
        {"mst_id": None, "can_id": None},
        {"motor_type": "DM4310"},
        {"motor_type": 1, "can_id": "0x08", "mst_id": 24.0},
    ],
    ids=str,
)
def test_a_file_that_bears_no_other_mark_is_taken_without_a_word(marks: dict[str, Any]) -> None:
    world = World().start()
    assert world.client().result("calibration.load", content={**TAUGHT, **marks})["warnings"] == []
    assert verdict(world) == ("ok", [])


@pytest.mark.parametrize("way", AT_START, ids=lambda way: way.name)
def test_at_the_start_another_grippers_is_warned_of(
    root: Path, monkeypatch: pytest.MonkeyPatch, way: Way
) -> None:
    way.put(root, {**TAUGHT, "can_id": 7}, monkeypatch)
    world = started(way.mount(root))
    world.run(0.1)
    is_template = way.name == "a template that mount names"  # of which only the limits count
    judged, reasons = verdict(world)
    assert any("can_id 0x07" in reason for reason in reasons) is not is_template
    assert (judged == "degraded") is not is_template


def test_what_is_measured_here_is_this_grippers_whatever_was_loaded_before() -> None:
    world, client = enabled_world()
    foreign = {**TAUGHT, **OWN_MARKS, "can_id": 7, "mst_id": 18, "canfd_mode": True}
    assert client.result("calibration.load", content={**foreign, "motor_type": "DM4340"})[
        "warnings"
    ]
    assert client.result("calibration.zero")["ok"]
    view = client.result("calibration.get")
    assert view["warnings"] == []
    assert {name: view["content"][name] for name in OWN_MARKS} == OWN_MARKS
    assert view["content"]["motor_type"] == "DM4310"
    assert verdict(world) == ("ok", [])


def test_who_loads_one_in_which_no_jaw_can_be_where_it_is_learns_it_at_once() -> None:
    world = World().start()
    far = content_of(Geometry(9.0, 9.0 - NORMAL.travel_rad, NORMAL.rad_to_mm))
    (warned,) = world.client().result("calibration.load", content=far)["warnings"]
    assert "the motor says that it is at" in warned


@pytest.mark.parametrize("own", [True, False], ids=["its own file", "a shared one"])
def test_a_file_of_another_channel_is_a_warning_only_where_it_bears_this_ones_name(
    own: bool, root: Path, caplog: pytest.LogCaptureFixture
) -> None:
    folder = root / ".litegrip"
    name = "rup1_calibration.json" if own else "litegrip_calibration.json"
    content = json.loads((root / "data" / "normal.json").read_text(encoding="utf-8"))
    (folder / name).write_text(json.dumps({**content, "channel": "can5"}), encoding="utf-8")
    with caplog.at_level(logging.INFO):
        started_on("rup1")
    levels = {record.getMessage(): record.levelno for record in caplog.records}
    passed_over = next(text for text in levels if f"passed over: {folder / name}" in text)
    assert levels[passed_over] == (logging.WARNING if own else logging.INFO)
    (refused,) = [text for text in levels if text.startswith("no calibration for channel rup1")]
    assert refused.endswith(
        "motions are refused; choose a mount: litegripctl -c rup1 calibration load normal (or"
        " reverse), then litegripctl -c rup1 zero"
    )
