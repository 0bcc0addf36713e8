"""Calibrations of a program: loaded, saved, measured by a probe or by hand, at the real daemon."""

import json
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import (
    CALIB_TEMPLATES,
    BusyError,
    CommandError,
    HardwareError,
    LiteGrip,
    LiteGripError,
    MoveProgress,
    ParameterError,
    StoppedError,
)
from litegripd.model.motion_config import MotionConfig
from tests.client.fake_daemon import ZERO
from tests.client.rig import SILENT, Asked, Bench, Heard, Kind, Refuse
from tests.geometry import CLOSED_RAD, MM_RAD, OPEN_RAD

GEOMETRY = {
    "calibrated": True,
    "zero_position_rad": 0.0,
    "max_position_rad": -1.64,
    "travel_range_rad": 1.64,
    "rad_to_mm": 52.5,
}


def loads(daemon: Heard) -> list[dict[str, Any]]:
    return daemon.asked("calibration.load")


def content(daemon: Heard) -> dict[str, Any]:
    """Return the calibration in use, as a file holds it."""
    view: dict[str, Any] = daemon.client().result("calibration.get")["content"]
    return view


@pytest.fixture
def pinned(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Return the one file for all channels that the environment names."""
    path = tmp_path / "pinned.json"
    monkeypatch.setenv("LITEGRIP_CALIB", str(path))
    return path


def written(path: Path, **more: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(json.dumps({**GEOMETRY, **more}))
    return path


# Loading by name


def test_a_mount_is_loaded_on_every_connecting(daemon: Heard, kind: Kind) -> None:
    gripper = kind.gripper("can0", mount="normal")
    for _ in range(2):
        with gripper:
            gripper.connect()
    assert daemon.methods() == ["hello", "calibration.load"] * 2
    assert loads(daemon) == [{"template": "normal"}] * 2


def test_a_mount_that_cannot_be_loaded_leaves_no_connection(daemon: Heard, kind: Kind) -> None:
    daemon.instead["calibration.load"] = Refuse("calibration_unreadable", -32013)
    gripper = kind.gripper(mount="normal")
    with pytest.raises(CommandError):
        gripper.connect()
    assert not gripper.is_connected


@pytest.mark.parametrize("reason", ["busy", "not_permitted"])
def test_a_watcher_connects_with_a_mount_that_it_may_not_load_yet(
    daemon: Heard, kind: Kind, caplog: pytest.LogCaptureFixture, reason: str
) -> None:
    other = daemon.client()
    other.result("lease.acquire", purpose="picking")
    if reason == "not_permitted":
        daemon.instead["calibration.load"] = Refuse(reason, -32027)
    gripper = kind.gripper(mount="normal")
    assert gripper.connect() is True
    assert "mount 'normal' is not loaded yet" in caplog.text
    if reason == "busy":
        other.leave()
        daemon.instead["calibration.load"] = Refuse(reason, -32020)
    else:
        other.leave()
    with pytest.raises(CommandError):
        gripper.enable()
    assert daemon.methods()[-1] == "calibration.load"  # nothing is enabled by another mount
    daemon.instead.clear()
    assert gripper.enable()
    assert gripper.enable()
    assert loads(daemon) == [{"template": "normal"}] * 3
    gripper.disconnect()


def test_the_four_ways_to_a_mount_are_one(daemon: Heard, gripper: LiteGrip, kind: Kind) -> None:
    assert gripper.load_template("reverse") is True
    assert gripper.load_calibration(template="reverse") is True
    assert gripper.load_calibration(CALIB_TEMPLATES["reverse"]) is True
    with kind.gripper(mount="reverse"):
        assert loads(daemon) == [{"template": "reverse"}] * 4
    assert gripper.mount == "reverse"


def test_an_unknown_template_asks_for_nothing(daemon: Heard, gripper: LiteGrip, kind: Kind) -> None:
    for load in (
        gripper.load_template,
        lambda name: gripper.load_calibration(template=name),
        lambda name: kind.gripper("can1", mount=name),
    ):
        with pytest.raises(ParameterError, match="one of: normal, reverse"):
            load("sideways")
    with pytest.raises(CommandError, match="not both"):
        gripper.load_calibration("c.json", "normal")
    assert loads(daemon) == []


# By file


def test_a_file_is_read_here_and_its_content_sent(
    daemon: Heard, gripper: LiteGrip, tmp_path: Path
) -> None:
    path = written(tmp_path / "c.json", note="left arm")
    assert gripper.load_calibration(path) is True
    assert gripper.load_calibration(str(path)) is True
    assert loads(daemon) == [{"content": {**GEOMETRY, "note": "left arm"}}] * 2
    assert gripper.config.rad_to_mm == 52.5
    assert content(daemon)["note"] == "left arm"


def test_a_file_that_cannot_be_read_raises(
    daemon: Heard, gripper: LiteGrip, tmp_path: Path
) -> None:
    with pytest.raises(CommandError, match="No such file") as caught:
        gripper.load_calibration(tmp_path / "none.json")
    assert caught.value.reason == "calibration_unreadable"
    assert loads(daemon) == []


def test_a_file_that_cannot_be_used_is_named(
    daemon: Heard, gripper: LiteGrip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "bad.json"
    path.write_text("{}", encoding="utf-8")
    told = f"{path}: the content cannot be used: zero_position_rad is missing"
    monkeypatch.setenv("LITEGRIP_CALIB", str(path))
    for given in (path, str(path), None):
        with pytest.raises(CommandError) as caught:
            gripper.load_calibration(given)
        assert caught.value.message == told


def test_the_environment_names_one_file_for_all_channels(
    daemon: Heard, gripper: LiteGrip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = written(tmp_path / "c.json", channel="can7")
    monkeypatch.setenv("LITEGRIP_CALIB", str(path))
    assert gripper.load_calibration() is True
    monkeypatch.setenv("LITEGRIP_CALIB", CALIB_TEMPLATES["reverse"])
    assert gripper.load_calibration() is True
    monkeypatch.setenv("LITEGRIP_CALIB", str(tmp_path / "none.json"))
    with pytest.raises(CommandError, match="No such file"):
        gripper.load_calibration()
    own = {"content": {**GEOMETRY, "channel": "can7"}}
    assert loads(daemon) == [own, {"template": "reverse"}]


# By nothing


def test_without_a_name_the_daemon_looks_first(
    daemon: Heard, gripper: LiteGrip, home: Path
) -> None:
    written(home / ".litegrip/can0_calibration.json", note="mine")
    assert gripper.load_calibration() is True
    assert loads(daemon) == [{}]
    assert content(daemon)["note"] == "mine"


@pytest.fixture
def elsewhere(site: Bench, tmp_path: Path) -> Heard:
    """Return a daemon that is another user's, who has no calibration that fits."""
    written(tmp_path / "daemons/.litegrip/litegrip_calibration.json", channel="can5")
    daemon = Heard(home=tmp_path / "daemons", calibrated=False)
    site.add(daemon)
    return daemon


def without_contents(found: Any, factory: bool, busy: bool, request: Asked) -> Any:
    """Find nothing, or the factory's; take what is sent, unless busy."""
    if "content" in request.params:
        return Refuse("busy", -32020) if busy else None
    return {**found, "loaded": factory, "factory": factory}


def test_what_the_daemon_does_not_find_may_be_the_users(
    elsewhere: Heard, kind: Kind, home: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with kind.gripper() as gripper:
        found = elsewhere.client().result("calibration.load")
        assert gripper.load_calibration() is found["loaded"]
        assert found["loaded"] is found["factory"]  # whose files are here or not
        assert "the daemon passed over: " in caplog.text
        assert "can5" in caplog.text
        written(home / ".litegrip/litegrip_calibration.json", note="the user's")
        assert gripper.load_calibration() is True
        assert content(elsewhere)["note"] == "the user's"
        for factory in (True, False):
            elsewhere.instead["calibration.load"] = partial(without_contents, found, factory, False)
            assert gripper.load_calibration() is True
            assert "content" in loads(elsewhere)[-1]  # which wins over the factory's
            written(home / ".litegrip/can0_calibration.json")
            elsewhere.instead["calibration.load"] = partial(without_contents, found, factory, True)
            with pytest.raises(BusyError):  # which has nothing to do with the file
                gripper.load_calibration()
        elsewhere.instead.clear()
        (home / ".litegrip/can0_calibration.json").write_text('{"note": "no geometry"}')
        with pytest.raises(CommandError, match=r"can0_calibration\.json: ") as caught:
            gripper.load_calibration()
        assert caught.value.reason == "calibration_unreadable"


def test_while_another_moves_what_is_in_use_is_enough(
    daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    other = daemon.client()
    other.result("motor.enable")
    other.send("motion.close")
    assert gripper.load_calibration() is True
    calibrated = daemon.client().result("calibration.get")
    daemon.instead["calibration.get"] = {**calibrated, "calibrated": False}
    with pytest.raises(BusyError):
        gripper.load_calibration()


# Saving


def test_without_a_path_the_daemon_saves(
    site: Bench, daemon: Heard, gripper: LiteGrip, kind: Kind
) -> None:
    saved = Path(gripper.save_calibration())
    assert json.loads(saved.read_text())["rad_to_mm"] == MM_RAD
    site.add(Heard("can1", calibrated=False))
    with kind.gripper("can1") as other:
        with pytest.raises(CommandError) as caught:
            other.save_calibration()
        assert caught.value.reason == "not_calibrated"
        with pytest.raises(CommandError, match="no calibration") as caught:
            other.save_calibration("c.json")
    assert caught.value.reason == "not_calibrated"
    assert not isinstance(caught.value, HardwareError)
    assert not Path("c.json").exists()


def test_with_a_path_this_program_saves_what_is_in_use(
    daemon: Heard, gripper: LiteGrip, pinned: Path, tmp_path: Path
) -> None:
    for path, given in ((tmp_path / "saved.json", tmp_path / "saved.json"), (pinned, None)):
        assert gripper.save_calibration(given) == str(path)
        assert json.loads(path.read_text()) == content(daemon)
    assert "calibration.save" not in daemon.methods()


# By a probe


MARKS = {"closed_rad": 0.0, "open_rad": -1.64, "travel_rad": 1.64, "rad_to_mm": 52.5}
MEASURED: dict[str, Any] = {**ZERO, **MARKS, "content": GEOMETRY, "path": None}


def test_zero_measures_saves_and_prints_how_far_it_is(
    daemon: Heard, gripper: LiteGrip, pinned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    def probe(request: Asked) -> dict[str, Any]:
        figures = {"command_rad": 0.1, "position_rad": 0.2, "torque_nm": 0.3}
        steps = [("probe_open", step, 200) for step in range(12)] + [("probe_closed", 0, 0)]
        for phase, step, total in steps:
            where = {"phase": phase, "step": step, "total_steps": total}
            named = {"job": 6, "request": request.identity, "kind": "zero"}
            daemon.streams[-1].say("job.progress", {**named, **where, **figures})
        return {**MEASURED, "path": "/var/can0.json"}

    daemon.instead["calibration.zero"] = probe
    gripper.motion_config.calib_kp = 15.0
    data = gripper.zero()
    assert (data.zero_position_rad, data.max_position_rad, data.rad_to_mm) == (0.0, -1.64, 52.5)
    asked = {"save": True, "config": {"calib_kp": 15.0}, "progress": True}
    assert daemon.asked("calibration.zero") == [asked]
    assert json.loads(pinned.read_text()) == content(daemon)
    assert capsys.readouterr().out.splitlines() == [
        "[probe_open] 0/200 cmd=+0.1000 rad pos=+0.2000 rad tau=+0.300 N·m",
        "[probe_open] 10/200 cmd=+0.1000 rad pos=+0.2000 rad tau=+0.300 N·m",
        "[probe_closed] 0 cmd=+0.1000 rad pos=+0.2000 rad tau=+0.300 N·m",
        (
            "closed +0.0000 rad, open -1.6400 rad, travel 1.6400 rad, 52.50 mm/rad;"
            " saved by the daemon to /var/can0.json"
        ),
        (
            f"taken: the jaws open {data.stroke_mm:.5g} mm (config.max_stroke_mm). If a caliper"
            " says otherwise: gripper.rescale_calibration(MM), then gripper.save_calibration()"
        ),
    ]


def test_calibrate_measures_with_its_arguments_and_does_not_save(
    daemon: Heard, gripper: LiteGrip, pinned: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.instead["calibration.zero"] = MEASURED
    gripper.motion_config.calib_kp = 15.0
    gripper.calibrate(20, 2, tau_limit=1.5, stall_cycles=4, max_iter=100, stall_delta=0.002)
    asked = daemon.asked("calibration.zero")[0]
    assert asked["save"] is False
    assert asked["config"] == {
        "calib_kp": 20.0,
        "calib_kd": 2.0,
        "calib_tau_limit": 1.5,
        "calib_stall_delta": 0.002,
        "calib_stall_cycles": 4,
        "calib_max_iter": 100,
    }
    assert set(asked["config"]) <= set(MotionConfig.__dataclass_fields__)
    assert "; not saved" in capsys.readouterr().out
    gripper.calibrate()
    assert "config" not in daemon.asked("calibration.zero")[1]
    assert not pinned.exists()
    gripper.zero(mount="reverse")
    assert daemon.asked("calibration.zero")[2]["mount"] == "reverse"


def test_who_takes_the_progress_is_not_printed_to_and_an_interrupt_cancels(
    daemon: Heard, enabled: LiteGrip, kind: Kind, capsys: pytest.CaptureFixture[str]
) -> None:
    def show(progress: MoveProgress) -> None:
        seen.append(progress.phase)
        if len(seen) == 3:
            kind.interrupt()

    seen: list[str] = []
    with pytest.raises(kind.interrupted):
        enabled.zero(progress=show)
    assert set(seen) == {"probe_open"}
    assert capsys.readouterr().out == ""
    assert daemon.methods()[-1] == "job.cancel"


def test_a_probe_that_fails_raises_what_the_daemon_says(daemon: Heard, gripper: LiteGrip) -> None:
    failed = {**MEASURED, "ok": False, "outcome": "not_found", "message": "no stop at all"}
    daemon.instead["calibration.zero"] = failed
    for measure in (gripper.zero, gripper.calibrate):
        with pytest.raises(HardwareError, match="no stop at all"):
            measure()


def test_a_template_of_the_environment_is_refused_before_anything_moves(
    daemon: Heard, gripper: LiteGrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIP_CALIB", CALIB_TEMPLATES["normal"])
    with pytest.raises(CommandError, match="is not to be written"):
        gripper.zero()
    assert daemon.methods() == ["hello"]


# By hand


def steps(daemon: Heard) -> list[str]:
    return [asked["step"] for asked in daemon.asked("calibration.manual")]


def pushed(daemon: Heard, kind: Kind, opening_nm: float) -> None:
    """Push the jaws to a stop by hand."""
    daemon.gripper.push(-opening_nm * daemon.gripper.parameters.close_sign)
    kind.pause(0.6)
    daemon.gripper.push(0.0)


def test_by_hand_to_the_end(daemon: Heard, enabled: LiteGrip, kind: Kind, pinned: Path) -> None:
    with enabled.manual_calibration() as manual:
        with pytest.raises(CommandError):
            manual.finish()  # no mark yet
        pushed(daemon, kind, -0.6)
        assert manual.mark_closed() == pytest.approx(CLOSED_RAD, abs=0.05)
        pushed(daemon, kind, 0.6)
        assert manual.mark_open() == pytest.approx(OPEN_RAD, abs=0.05)
        data = manual.finish()
    assert data.mount == "normal"
    asked = daemon.asked("calibration.manual")
    assert [one["step"] for one in asked] == ["begin", "finish", "closed", "open", "finish"]
    assert asked[-1] == {"step": "finish", "save": True}
    begin = next(one for one in daemon.requests if one.method == "calibration.manual")
    assert begin.params["stop_generation"] == daemon.state.stop_generation
    assert json.loads(pinned.read_text()) == content(daemon)


def test_by_hand_without_an_end_changes_nothing(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    before = content(daemon)
    with enabled.manual_calibration() as manual:
        kind.pause(0.1)
        manual.mark_open()
        with pytest.raises(CommandError, match="begun already"):
            manual.__enter__()
    with pytest.raises(ZeroDivisionError), enabled.manual_calibration():
        raise ZeroDivisionError
    assert steps(daemon) == ["begin", "open", "cancel", "begin", "cancel"]
    with pytest.raises(CommandError, match="no calibration by hand"):
        manual.mark_closed()
    assert content(daemon) == before


def test_an_implausible_end_is_an_end(daemon: Heard, enabled: LiteGrip) -> None:
    def finish(request: Asked) -> dict[str, Any] | None:
        return failed if request.params["step"] == "finish" else None

    failed = {**MEASURED, "ok": False, "outcome": "implausible_travel", "message": "0.1 rad"}
    daemon.instead["calibration.manual"] = finish
    with enabled.manual_calibration() as manual, pytest.raises(HardwareError, match=r"0\.1 rad"):
        manual.finish(save=False)
    assert daemon.asked("calibration.manual")[-1] == {"step": "finish", "save": False}


def test_a_beginning_that_was_refused_needs_no_cancelling(daemon: Heard, enabled: LiteGrip) -> None:
    daemon.client().result("stop")
    with pytest.raises(StoppedError), enabled.manual_calibration():
        pass
    assert steps(daemon) == ["begin"]


def test_an_interrupted_beginning_is_cancelled(
    daemon: Heard, enabled: LiteGrip, kind: Kind
) -> None:
    daemon.instead["calibration.manual"] = lambda request: (
        SILENT if request.params["step"] == "begin" else {}
    )
    kind.interrupt(0.05)
    with pytest.raises(kind.interrupted), enabled.manual_calibration():
        pass
    assert steps(daemon) == ["begin", "cancel"]


# The arguments of a probe


@pytest.mark.parametrize(
    ("given", "told"),
    [
        ({"kp": 1}, "kp is 1, it must be 2 to 100 N·m/rad"),
        ({"kd": 9}, "kd is 9, it must be 0.2 to 5 N·m·s/rad"),
        ({"step_rad": 9}, "step_rad is 9, it must be 0.005 to 0.1 rad"),
        ({"tau_limit": 100}, "tau_limit is 100, it must be 1.1 to 3 N·m"),
        ({"stall_delta": 9}, "stall_delta is 9, it must be 0.0002 to 0.02 rad"),
        ({"stall_cycles": 900}, "stall_cycles is 900, it must be 2 to 100"),
        ({"stall_cycles": 1.5}, "stall_cycles is 1.5, it must be a whole number"),
        ({"max_iter": 1}, "max_iter is 1, it must be 10 to 2000"),
        ({"kp": "soft"}, "kp is 'soft', it must be a number"),
    ],
)
def test_a_probe_is_refused_in_the_words_of_the_call(
    enabled: LiteGrip, given: dict[str, Any], told: str
) -> None:
    with pytest.raises(ParameterError) as caught:
        enabled.calibrate(**given)
    assert str(caught.value) == caught.value.args[0] == told
    assert caught.value.data["parameter"] == next(iter(given))
    assert "field" not in caught.value.data


def test_the_advice_of_a_probe_that_fails_names_the_argument_too(
    daemon: Heard, enabled: LiteGrip
) -> None:
    daemon.instead["calibration.zero"] = Refuse("not_found", -32000, "or raise calib_kp")
    with pytest.raises(LiteGripError, match=r"^or raise kp$"):
        enabled.calibrate()
    with pytest.raises(LiteGripError, match=r"^or raise gripper\.motion_config\.calib_kp$"):
        enabled.zero()  # its figures are motion_config's
