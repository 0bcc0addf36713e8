"""The commands of litegripctl that move the jaws: what they ask, what they tell."""

import json
import os
from typing import Any

import pytest

from litegrip_client.ctl.main import main
from litegrip_client.ctl.render import progress
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import MOVE, STATE, FakeDaemon, Request
from tests.client.helpers import Ctl, interrupt_main_thread
from tests.geometry import SPAN_MM

HELD_STATE = {**STATE, "opening_mm": 48.2, "is_grasped": True, "force_set_n": 20.0}
OPEN_STATE = {**STATE, "opening_mm": 0.4, "is_grasped": False, "force_set_n": None}
GRASP: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "object_held",
    "reached": False,
    "stalled": True,
    "target_rad": 0.05,
    "force_n": 20.0,
    "cycles": 0,
    "width_mm": 48.2,
    "held_s": 0.0,
    "state": HELD_STATE,
}
MOVED = {**MOVE, "outcome": "reached", "reached": True, "stalled": False}
SQUEEZING = {"job": 5, "force_n": 15.0, "state": HELD_STATE}
CALIBRATION = {"calibrated": True, "travel_mm": SPAN_MM}
LET_GO = "let go with: litegripctl release"


@pytest.mark.parametrize(
    ("arguments", "method", "params"),
    [
        (["grasp"], "motion.grasp", {"until": "verdict"}),
        (
            ["grasp", "--force", "15", "--width", "48", "--tolerance", "2.5"],
            "motion.grasp",
            {"until": "verdict", "force_n": 15.0, "width_mm": 48.0, "tolerance_mm": 2.5},
        ),
        (
            ["grasp", "--speed", "30", "--gains"],
            "motion.grasp",
            {"until": "verdict", "hold_by": "gains", "speed_mm_s": 30.0},
        ),
        (["grasp", "--hold", "5"], "motion.grasp", {"until": "held", "hold_s": 5.0}),
        (["move", "45mm"], "motion.move", {"opening_mm": 45.0}),
        (["move", "45.5 mm"], "motion.move", {"opening_mm": 45.5}),
        (["move", "0.3rad"], "motion.move", {"position_rad": 0.3}),
        (["move", "-.3rad"], "motion.move", {"position_rad": -0.3}),
        (["move", "50%"], "motion.move", {"openness": 0.5}),
        (["move", "0%", "--speed", "12"], "motion.move", {"openness": 0.0, "speed_mm_s": 12.0}),
        (
            ["move", "--duration", "2", "-1.4rad"],
            "motion.move",
            {"position_rad": -1.4, "duration_s": 2.0},
        ),
        (["release"], "motion.move", {"opening_mm": 45.25}),
        (["release", "--by", "4.5"], "motion.move", {"opening_mm": 39.75}),
        (["release", "--by", "500"], "motion.move", {"opening_mm": SPAN_MM}),
    ],
)
def test_what_is_asked(
    daemon: FakeDaemon, ctl: Ctl, arguments: list[str], method: str, params: dict[str, Any]
) -> None:
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    daemon.handlers[method] = lambda request: request.fail("busy", -32020)
    assert ctl(*arguments)[0] == 6
    asked = dict(daemon.wait_for(method)[0].params)
    assert asked.pop("stop_generation") == 3
    assert asked.pop("sent_s") > 0.0
    assert asked == {**params, "detach": True, "progress": True}


@pytest.mark.parametrize(
    ("arguments", "method", "params", "text"),
    [
        (["grasp"], "motion.grasp", {"until": "verdict"}, "grasp: job 6 started\n"),
        (["move", "9mm"], "motion.move", {"opening_mm": 9.0}, "move: job 6 started\n"),
    ],
)
def test_not_waiting(
    daemon: FakeDaemon,
    ctl: Ctl,
    arguments: list[str],
    method: str,
    params: dict[str, Any],
    text: str,
) -> None:
    daemon.handlers[method] = lambda request: {"job": 6}
    assert ctl(*arguments, "--no-wait") == (0, text, "")
    asked = {**daemon.requests[-1].params, "sent_s": 0.0}
    guards = {"sent_s": 0.0, "stop_generation": 3}
    assert asked == {**params, **guards, "detach": True, "wait": False}


@pytest.mark.parametrize(
    ("arguments", "method", "result", "code", "text"),
    [
        (
            ["grasp"],
            "motion.grasp",
            GRASP,
            0,
            f"grasp: object held, 48.2 mm wide, holding 20.0 N; {LET_GO}\n",
        ),
        (
            ["grasp", "--hold", "5"],
            "motion.grasp",
            {**GRASP, "held_s": 5.0, "cycles": 25},
            0,
            f"grasp: object held, 48.2 mm wide, held for 5.0 s, holding 20.0 N; {LET_GO}\n",
        ),
        (
            ["grasp"],
            "motion.grasp",
            {**GRASP, "ok": False, "outcome": "no_object", "width_mm": None, "state": OPEN_STATE},
            1,
            "grasp: NOT ok: no object, at 0.40 mm\n",
        ),
        (
            ["grasp", "--width", "30", "--tolerance", "1"],
            "motion.grasp",
            {**GRASP, "ok": False, "outcome": "wrong_width"},
            1,
            f"grasp: NOT ok: wrong width, 48.2 mm wide, holding 20.0 N; {LET_GO}\n",
        ),
        (
            ["grasp", "--hold", "5"],
            "motion.grasp",
            {**GRASP, "ok": False, "outcome": "object_lost", "held_s": 1.25, "state": OPEN_STATE},
            1,
            "grasp: NOT ok: object lost, 48.2 mm wide, held for 1.2 s\n",
        ),
        (["move", "45mm"], "motion.move", MOVED, 0, "move: reached, at 35.25 mm\n"),
        (
            ["move", "45mm"],
            "motion.move",
            {**MOVED, "ok": False, "outcome": "timed_out"},
            1,
            "move: NOT ok: timed out, at 35.25 mm\n",
        ),
        (["release"], "motion.move", MOVED, 0, "release: reached, at 35.25 mm\n"),
        (
            ["release"],
            "motion.move",
            {**MOVED, "ok": False, "outcome": "blocked"},
            1,
            "release: NOT ok: blocked, at 35.25 mm\n",
        ),
        (
            ["force", "15"],
            "motion.set_force",
            SQUEEZING,
            0,
            f"force: squeezing with 15.0 N, at 48.20 mm; {LET_GO}\n",
        ),
        (
            ["slack"],
            "motion.zero_gravity",
            {"job": 5, "state": STATE},
            0,
            "jaws move freely; hold again with: litegripctl hold\n",
        ),
    ],
)
def test_what_is_told(
    daemon: FakeDaemon,
    ctl: Ctl,
    arguments: list[str],
    method: str,
    result: dict[str, Any],
    code: int,
    text: str,
) -> None:
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    daemon.handlers[method] = lambda request: result
    assert ctl(*arguments) == (code, text, "")
    shown = ctl(*arguments, "--json")
    assert (shown[0], json.loads(shown[1]), shown[2]) == (code, result, "")


@pytest.mark.parametrize(
    ("arguments", "method", "params"),
    [
        (["force", "15"], "motion.set_force", {"force_n": 15.0}),
        (["slack"], "motion.zero_gravity", {}),
    ],
)
def test_what_is_in_force_at_once_takes_nothing_about_waiting(
    daemon: FakeDaemon, ctl: Ctl, arguments: list[str], method: str, params: dict[str, Any]
) -> None:
    daemon.handlers[method] = lambda request: SQUEEZING
    assert ctl(*arguments)[0] == 0
    asked = {**daemon.wait_for(method)[0].params, "sent_s": 0.0}
    assert asked == {**params, "sent_s": 0.0, "stop_generation": 3}


@pytest.mark.parametrize("text", ["45", "45cm", "mm", "45 %%", "nanmm", "1e2mm", "-0.3", "", "½mm"])
def test_a_target_needs_a_number_and_its_unit(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["move", text]) == 2
    error = capsys.readouterr().err
    assert f"{text!r} is no target: say 45mm (opening), -0.3rad" in error
    assert "50% (of the travel" in error


@pytest.mark.parametrize("text", ["-1%", "100.5%", "150%"])
def test_a_share_of_the_travel_is_refused_in_the_unit_that_was_typed(
    text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["move", text]) == 2
    assert f"{text!r} is outside of the travel: say 0% to 100%" in capsys.readouterr().err


def test_release_needs_a_calibration(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["state.get"] = lambda request: {**STATE, "opening_mm": None}
    daemon.handlers["calibration.get"] = lambda request: {"calibrated": False, "travel_mm": None}
    code, out, err = ctl("release")
    assert (code, out) == (4, "")
    assert err.splitlines() == [
        "litegripctl: the gripper is not calibrated",
        "  choose a mount: litegripctl calibration load normal|reverse, then litegripctl zero",
    ]


def test_release_needs_to_know_where_the_jaws_are(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["state.get"] = lambda request: {**STATE, "opening_mm": None}
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    code, _, err = ctl("release")
    assert (code, "the opening is not known" in err) == (5, True)
    assert "motion.move" not in daemon.methods()


@pytest.mark.parametrize("arguments", [["grasp", "--hold", "5"], ["move", "9mm"], ["release"]])
def test_ctrl_c_cancels(daemon: FakeDaemon, ctl: Ctl, arguments: list[str]) -> None:
    job = {"job": 6, "state": "running", "owner": {"pid": os.getpid()}}
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    for method in ("motion.grasp", "motion.move"):
        daemon.handlers[method] = lambda request: interrupt_main_thread()
    daemon.handlers["job.list"] = lambda request: {"jobs": [job]}
    daemon.handlers["job.cancel"] = lambda request: {**job, "state": "cancelled"}
    text = "litegripctl: interrupted: job 6 cancelled, the jaws hold\n"
    assert ctl(*arguments) == (130, "", text)


def test_progress_without_an_end_has_no_bar() -> None:
    data = {"phase": "hold", "step": 3, "total_steps": 0, "opening_mm": 48.2, "torque_nm": 2.0}
    assert progress(data) == " 48.20 mm  +2.00 N·m  hold"
    assert progress({"phase": "probe_open\x1b"}) == "-- mm  -- N·m  probe open?"


def test_a_grasp_on_a_terminal_shows_how_far_it_is(daemon: FakeDaemon) -> None:
    def grasp(request: Request) -> Any:
        request.progress(5)
        return GRASP

    daemon.handlers["motion.grasp"] = grasp
    terminal = Terminal("--socket", daemon.path, "grasp")
    terminal.expect(f"\r[{'#' * 12}{'.' * 12}]  12.50 mm  +0.30 N·m  travel\x1b[K")
    code, shown = terminal.end()
    let_go = f"let go with: litegripctl --socket {daemon.path} release"
    text = f"grasp: object held, 48.2 mm wide, holding 20.0 N; {let_go}\n"
    assert (code, shown) == (0, f"\r\x1b[K{text}")
