import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from litegrip_client import (
    CALIB_TEMPLATES,
    CommandError,
    HardwareError,
    LiteGrip,
    MoveProgress,
    StoppedError,
)
from tests.client.fake_daemon import CALIBRATION, CONTENT, RAD_TO_MM, ZERO, FakeDaemon, Request
from tests.client.helpers import interrupt_main_thread


@pytest.fixture(autouse=True)
def _measuring(daemon: FakeDaemon) -> None:
    daemon.handlers["calibration.zero"] = lambda request: ZERO
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION


def test_zero_measures_and_saves_with_the_tunables(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    gripper.motion_config.calib_kp = 15.0
    data = gripper.zero()
    assert (data.zero_position_rad, data.max_position_rad) == (0.104334, -1.513123)
    assert (data.rad_to_mm, data.mount, data.channel) == (RAD_TO_MM, "normal", "can0")
    params = daemon.requests[-1].params
    assert (params["save"], params["config"]) == (True, {"calib_kp": 15.0})
    assert (params["stop_generation"], params["progress"], "mount" in params) == (3, True, False)
    gripper.zero(mount="reverse")
    assert daemon.requests[-1].params["mount"] == "reverse"


def test_calibrate_measures_with_its_arguments_and_does_not_save(
    daemon: FakeDaemon, gripper: LiteGrip, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: {**ZERO, "path": None}
    gripper.motion_config.calib_kp = 15.0
    gripper.calibrate(20, 2, tau_limit=1.5, stall_cycles=4, max_iter=100, stall_delta=0.002)
    params = daemon.requests[-1].params
    assert params["save"] is False
    assert params["config"] == {
        "calib_kp": 20.0,
        "calib_kd": 2.0,
        "calib_tau_limit": 1.5,
        "calib_stall_delta": 0.002,
        "calib_stall_cycles": 4,
        "calib_max_iter": 100,
    }
    assert "; not saved" in capsys.readouterr().out
    gripper.calibrate()
    assert "config" not in daemon.requests[-1].params


def probing(request: Request) -> Any:
    for step in range(12):
        request.progress(step, phase="probe_open", total_steps=200)
    request.progress(0, phase="probe_closed", total_steps=0)
    return ZERO


TAKEN = (
    "taken: the jaws open 85 mm (config.max_stroke_mm). If a caliper says otherwise:"
    " gripper.rescale_calibration(MM), then gripper.save_calibration()"
)


def test_zero_prints_how_far_it_is(
    daemon: FakeDaemon, gripper: LiteGrip, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.handlers["calibration.zero"] = probing
    gripper.zero()
    saved = "saved by the daemon to /var/lib/litegripd/can0_calibration.json"
    assert capsys.readouterr().out.splitlines() == [
        "[probe_open] 0/200 cmd=+0.1000 pos=+0.2000 tau=+0.300",
        "[probe_open] 10/200 cmd=+0.1000 pos=+0.2000 tau=+0.300",
        "[probe_closed] 0 cmd=+0.1000 pos=+0.2000 tau=+0.300",
        f"closed +0.1043 rad, open -1.5131 rad, travel 1.6175 rad, 53.17 mm/rad; {saved}",
        TAKEN,
    ]


def test_who_takes_the_progress_is_not_printed_to(
    daemon: FakeDaemon, gripper: LiteGrip, capsys: pytest.CaptureFixture[str]
) -> None:
    daemon.handlers["calibration.zero"] = probing
    seen: list[MoveProgress] = []
    gripper.zero(progress=seen.append)
    assert [one.phase for one in seen] == ["probe_open"] * 12 + ["probe_closed"]
    assert capsys.readouterr().out == ""


@pytest.mark.parametrize(
    ("outcome", "kind"), [("not_found", HardwareError), ("not_saved", CommandError)]
)
def test_a_probe_that_fails_raises_what_the_daemon_says(
    daemon: FakeDaemon, gripper: LiteGrip, outcome: str, kind: type[Exception]
) -> None:
    failed = {**ZERO, "ok": False, "outcome": outcome, "message": "no stop within 200 steps"}
    daemon.handlers["calibration.zero"] = lambda request: failed
    for measure in (gripper.zero, gripper.calibrate):
        with pytest.raises(kind, match="no stop within 200 steps"):
            measure()


def test_an_interrupt_cancels_the_probe(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    daemon.handlers["calibration.zero"] = lambda request: request.progress(job=6)
    daemon.handlers["job.cancel"] = lambda request: {"job": 6, "state": "cancelled"}

    def interrupt(progress: MoveProgress) -> None:
        interrupt_main_thread()

    with pytest.raises(KeyboardInterrupt):
        gripper.zero(progress=interrupt)
    assert daemon.requests[-1].params == {"job": 6}


def test_the_file_of_the_environment_gets_the_measurement_too(
    daemon: FakeDaemon, gripper: LiteGrip, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIP_CALIB", str(tmp_path / "pinned.json"))
    gripper.calibrate()
    assert not (tmp_path / "pinned.json").exists()
    gripper.zero()
    assert json.loads((tmp_path / "pinned.json").read_text()) == CONTENT


def test_a_template_of_the_environment_is_refused_before_anything_moves(
    daemon: FakeDaemon, gripper: LiteGrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("LITEGRIP_CALIB", CALIB_TEMPLATES["normal"])
    with pytest.raises(CommandError, match="is not to be written"):
        gripper.zero()
    assert daemon.methods() == ["hello"]


# By hand


@pytest.fixture
def steps(daemon: FakeDaemon) -> Callable[[], list[dict[str, Any]]]:
    """Have all steps answered; returns what gives those that came."""
    marks = {"closed_rad": 0.104334, "open_rad": -1.513123}
    answers = {"begin": {"job": 8}, "closed": marks, "open": marks, "finish": ZERO, "cancel": {}}
    daemon.handlers["calibration.manual"] = lambda request: answers[request.params["step"]]
    guards = ("sent_s", "stop_generation")

    def came() -> list[dict[str, Any]]:
        return [
            {name: value for name, value in request.params.items() if name not in guards}
            for request in daemon.requests
            if request.method == "calibration.manual"
        ]

    return came


def test_by_hand_to_the_end(
    daemon: FakeDaemon, gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    with gripper.manual_calibration() as manual:
        assert manual.mark_closed() == 0.104334
        assert manual.mark_open() == -1.513123
        assert manual.finish().rad_to_mm == RAD_TO_MM
    assert steps() == [
        {"step": "begin"},
        {"step": "closed"},
        {"step": "open"},
        {"step": "finish", "save": True},
    ]
    assert daemon.requests[1].params["stop_generation"] == 3


def test_by_hand_without_an_end_changes_nothing(
    gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    with gripper.manual_calibration() as manual:
        manual.mark_open()
    with pytest.raises(ZeroDivisionError), gripper.manual_calibration():
        raise ZeroDivisionError
    assert [step["step"] for step in steps()] == ["begin", "open", "cancel", "begin", "cancel"]
    with pytest.raises(CommandError, match="no calibration by hand"):
        manual.mark_closed()


def test_an_end_that_was_refused_can_be_tried_again(
    daemon: FakeDaemon, gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    answer = daemon.handlers["calibration.manual"]
    with gripper.manual_calibration() as manual:
        daemon.handlers["calibration.manual"] = lambda request: request.fail("x", -32602, "mark!")
        with pytest.raises(CommandError, match="mark!"):
            manual.finish()
        daemon.handlers["calibration.manual"] = answer
        manual.finish(save=False)
    assert [step["step"] for step in steps()] == ["begin", "finish", "finish"]
    assert steps()[-1]["save"] is False


def test_an_implausible_end_is_an_end(
    daemon: FakeDaemon, gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    answer = daemon.handlers["calibration.manual"]
    failed = {**ZERO, "ok": False, "outcome": "implausible_travel", "message": "0.1 rad"}
    with gripper.manual_calibration() as manual:
        daemon.handlers["calibration.manual"] = lambda request: failed
        with pytest.raises(HardwareError, match=r"0\.1 rad"):
            manual.finish()
        daemon.handlers["calibration.manual"] = answer
    assert "cancel" not in [step["step"] for step in steps()]


def test_a_beginning_that_was_refused_needs_no_cancelling(
    daemon: FakeDaemon, gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    daemon.handlers["calibration.manual"] = lambda request: request.fail("stopped", -32021)
    with pytest.raises(StoppedError), gripper.manual_calibration():
        pass
    assert [step["step"] for step in steps()] == ["begin"]


def test_an_interrupted_beginning_is_cancelled(
    daemon: FakeDaemon, gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    answer = daemon.handlers["calibration.manual"]

    def begin(request: Request) -> Any:
        if request.params["step"] == "begin":
            interrupt_main_thread()
            return None
        return answer(request)

    daemon.handlers["calibration.manual"] = begin
    with pytest.raises(KeyboardInterrupt), gripper.manual_calibration():
        pass
    assert [step["step"] for step in steps()] == ["begin", "cancel"]


def test_one_calibration_by_hand_begins_once(
    gripper: LiteGrip, steps: Callable[[], list[dict[str, Any]]]
) -> None:
    manual = gripper.manual_calibration()
    with manual, pytest.raises(CommandError, match="begun already"):
        manual.__enter__()
    assert [step["step"] for step in steps()] == ["begin", "cancel"]


def test_a_measurement_by_hand_is_saved_where_the_environment_says(
    gripper: LiteGrip,
    steps: Callable[[], list[dict[str, Any]]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("LITEGRIP_CALIB", str(tmp_path / "pinned.json"))
    with gripper.manual_calibration() as manual:
        manual.finish()
    assert json.loads((tmp_path / "pinned.json").read_text()) == CONTENT
    assert [step["step"] for step in steps()] == ["begin", "finish"]
