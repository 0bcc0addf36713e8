"""The commands of litegripctl around the calibration, without the one by hand."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from litegripd.model.sentence import sentence, with_terms
from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import STATE, FakeDaemon
from tests.client.helpers import Ctl
from tests.geometry import (
    CLOSED_RAD,
    MM_RAD,
    OLD_CLOSED_RAD,
    OLD_MM_RAD,
    OLD_OPEN_RAD,
    OPEN_RAD,
    SPAN_MM,
    TRAVEL_MM,
    TRAVEL_RAD,
    WORK_MM,
)

CONTENT = {
    "calibrated": True,
    "zero_position_rad": CLOSED_RAD,
    "max_position_rad": OPEN_RAD,
    "own": "é",
}
CALIBRATION: dict[str, Any] = {
    "calibrated": True,
    "mount": "normal",
    "closed_rad": CLOSED_RAD,
    "open_rad": OPEN_RAD,
    "travel_rad": TRAVEL_RAD,
    "travel_mm": TRAVEL_MM,
    "rad_to_mm": MM_RAD,
    "work_stroke_mm": WORK_MM,
    "kp": 100.0,
    "kd": 2.0,
    "file": "/var/lib/litegripd/can0_calibration.json",
    "scale_warning": None,
    "content": CONTENT,
}
NONE: dict[str, Any] = {**dict.fromkeys(CALIBRATION), "calibrated": False, "content": {}}
LOADED = {**CALIBRATION, "loaded": True, "skipped": []}
STORED = {"path": "/var/lib/x.json", "previous": None}
MEASURED: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "measured",
    "closed_rad": 0.104,
    "open_rad": -1.513,
    "travel_rad": 1.617,
    "rad_to_mm": SPAN_MM / 1.617,
    "content": CONTENT,
    "path": "/var/lib/x.json",
    "message": None,
    "state": STATE,
}
TRAVEL = "closed +0.1040 rad, open -1.5130 rad, travel 1.6170 rad or 86.00 mm, mount normal\n"
TAKEN = (
    "taken: the jaws open 85 mm; if a caliper says otherwise:"
    " litegripctl calibration rescale --stroke-mm MM\n"
)
IN_USE = "in use until the daemon restarts; store it with: litegripctl calibration save\n"
MEASURE = (
    "nominal: it was not measured on this gripper; measure and store it with:"
    " litegripctl enable && litegripctl zero"
)
NOMINAL = f"in use until the daemon restarts\n{MEASURE}\n"
CHOOSE = "choose a mount: litegripctl calibration load normal|reverse, then litegripctl zero"


@pytest.mark.parametrize(
    ("arguments", "params"),
    [
        ([], {"save": True}),
        (["--no-save", "--mount", "reverse"], {"save": False, "mount": "reverse"}),
        (["--stroke-mm", "84.5"], {"save": True, "stroke_mm": 84.5}),
    ],
)
def test_zero_asks_for(
    daemon: FakeDaemon, ctl: Ctl, arguments: list[str], params: dict[str, Any]
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    assert ctl("zero", "--yes", *arguments)[0] == 0
    asked = {**daemon.requests[-1].params, "sent_s": 0.0}
    guards = {"sent_s": 0.0, "stop_generation": 3}
    assert asked == {**params, **guards, "detach": True, "progress": True}


@pytest.mark.parametrize(
    ("result", "code", "text"),
    [
        (MEASURED, 0, f"zero: measured\n{TRAVEL}{TAKEN}stored in /var/lib/x.json\n"),
        ({**MEASURED, "path": None}, 0, f"zero: measured\n{TRAVEL}{TAKEN}{IN_USE}"),
        (
            {**MEASURED, "ok": False, "outcome": "not_saved", "path": None, "message": "disk full"},
            1,
            f"zero: NOT ok: not saved: disk full\n{TRAVEL}",
        ),
        (
            {
                **dict.fromkeys(MEASURED),
                "ok": False,
                "outcome": "not_found",
                "message": "no stop\x1b in 200 steps",
            },
            1,
            "zero: NOT ok: not found: no stop? in 200 steps\n",
        ),
    ],
)
def test_what_zero_tells(
    daemon: FakeDaemon, ctl: Ctl, result: dict[str, Any], code: int, text: str
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: result
    assert ctl("zero", "-y") == (code, text, "")
    shown = ctl("zero", "-y", "--json")
    assert (shown[0], json.loads(shown[1])) == (code, result)


def test_zero_without_a_direction_tells_how_to_choose_one(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.zero"] = lambda request: request.fail("not_calibrated", -32010)
    assert ctl("zero", "-y") == (4, "", f"litegripctl: no\n  {CHOOSE}\n")


def test_zero_without_a_terminal_is_refused(daemon: FakeDaemon, ctl: Ctl) -> None:
    code, out, err = ctl("zero")
    assert (code, out, daemon.methods()) == (2, "", ["hello"])
    assert err.splitlines()[0].endswith("there is no terminal to confirm it at")
    assert err.splitlines()[1] == "  if that is safe: litegripctl zero --yes"


def test_a_question_that_nobody_can_read_is_not_asked(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero", stderr=subprocess.DEVNULL)
    assert terminal.end() == (2, "")
    assert daemon.methods() == ["hello"]


MOVES = "the jaws will move to both stops; continue? [y/N] "
WIDTH = "how far do the jaws open, by a caliper, in mm? [85] "
AGAIN = f"please answer a number above 0, or press Enter: {WIDTH}"


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("Yes \n", 0), ("\n", 1), ("\x04", 1)])
def test_zero_on_a_terminal_asks_before_it_moves(
    daemon: FakeDaemon, answer: str, code: int
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    assert daemon.methods() == ["hello"]
    terminal.type(answer)
    if code == 0:
        terminal.expect(WIDTH)
        assert "calibration.zero" not in daemon.methods()
        terminal.type("\n")
    ended, shown = terminal.end()
    assert ended == code
    assert ("calibration.zero" in daemon.methods()) == (code == 0)
    assert ("litegripctl: nothing was done\n" in shown) == (code == 1)


def test_ctrl_c_at_the_question_moves_nothing(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect("[y/N] ")
    terminal.interrupt()
    assert terminal.end() == (130, "\n")
    assert daemon.methods() == ["hello"]


@pytest.mark.parametrize(
    ("answers", "stroke"),
    [
        (["\n"], {}),
        (["84.5\n"], {"stroke_mm": 84.5}),
        ([" 84 mm\n"], {"stroke_mm": 84.0}),
        (["wide\n", "-3\n", "0\n", "nan\n", "inf\n", "86\n"], {"stroke_mm": 86.0}),
    ],
)
def test_zero_on_a_terminal_asks_how_far_the_jaws_open(
    daemon: FakeDaemon, answers: list[str], stroke: dict[str, float]
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    terminal.type("y\n")
    terminal.expect(WIDTH)
    terminal.type(answers[0])
    for answer in answers[1:]:
        terminal.expect(AGAIN)
        terminal.type(answer)
    assert terminal.end()[0] == 0
    params = daemon.requests[-1].params
    assert {name: params[name] for name in ("stroke_mm",) if name in params} == stroke


def test_no_answer_to_how_far_they_open_moves_nothing(daemon: FakeDaemon) -> None:
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect(MOVES)
    terminal.type("y\n")
    terminal.expect(WIDTH)
    terminal.type("\x04")
    assert terminal.end() == (1, "\nlitegripctl: nothing was done\n")
    assert "calibration.zero" not in daemon.methods()


@pytest.mark.parametrize(
    ("arguments", "question"), [(["--stroke-mm", "84"], MOVES), (["--yes"], None)]
)
def test_who_has_said_it_is_not_asked(
    daemon: FakeDaemon, arguments: list[str], question: str | None
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero", *arguments)
    if question is not None:
        terminal.expect(question)
        terminal.type("y\n")
    code, shown = terminal.end()
    assert (code, "how far do the jaws open" in shown) == (0, False)


@pytest.mark.parametrize("text", ["0", "-85", "nan", "wide"])
def test_a_stroke_that_is_none_is_wrong_usage(daemon: FakeDaemon, ctl: Ctl, text: str) -> None:
    for command in (["zero", "--yes"], ["calibration", "rescale"], ["calibration", "manual"]):
        assert ctl(*command, "--stroke-mm", text)[0] == 2
    assert daemon.methods() == []


DOUBT = sentence("the jaws' travel is taken for 120 mm: {calibration.rescale} corrects it")
OLD: dict[str, Any] = {
    **CALIBRATION,
    "closed_rad": OLD_CLOSED_RAD,
    "open_rad": OLD_OPEN_RAD,
    "travel_rad": 1.605,
    "travel_mm": 120.05,
    "rad_to_mm": OLD_MM_RAD,
    "work_stroke_mm": None,
    "scale_warning": DOUBT,
}
WARNING = f"WARNING: {DOUBT.replace('calibration.rescale', 'litegripctl calibration rescale')}"


def test_a_doubtful_scale_is_said_loudly(daemon: FakeDaemon, ctl: Ctl, tmp_path: Path) -> None:
    path = tmp_path / "old.json"
    path.write_text(json.dumps(CONTENT), encoding="utf-8")
    daemon.handlers["calibration.get"] = lambda request: with_terms(OLD)
    loaded = with_terms({**LOADED, "scale_warning": DOUBT})
    daemon.handlers["calibration.load"] = lambda request: loaded
    shown = ctl("calibration")[1].splitlines()
    assert shown[0] == WARNING
    assert "work stroke none: open goes to the stop" in shown
    assert ctl("calibration", "load", str(path))[1].splitlines()[-1] == WARNING


def test_whatever_is_doubtful_is_said_to_who_loads_it(daemon: FakeDaemon, ctl: Ctl) -> None:
    doubts = [DOUBT, "it has can_id 0x07"]
    loaded = with_terms({**LOADED, "warnings": doubts})
    daemon.handlers["calibration.load"] = lambda request: loaded
    shown = ctl("calibration", "load", "normal")[1].splitlines()
    assert [line for line in shown if line.startswith("WARNING")] == [
        WARNING,
        "WARNING: it has can_id 0x07",
    ]
    daemon.handlers["calibration.load"] = lambda request: {**LOADED, "warnings": []}
    assert "WARNING" not in ctl("calibration", "load", "normal")[1]


def test_rescaling_corrects_and_stores_in_one_command(daemon: FakeDaemon, ctl: Ctl) -> None:
    right = {**OLD, "travel_mm": SPAN_MM, "rad_to_mm": SPAN_MM / 1.605, "scale_warning": None}
    daemon.handlers["calibration.get"] = lambda request: OLD
    daemon.handlers["calibration.rescale"] = lambda request: right
    saved = {**STORED, "path": OLD["file"]}
    daemon.handlers["calibration.save"] = lambda request: saved
    lines = [
        "scale 74.80 -> 53.58 mm/rad, travel 120.05 -> 86.00 mm",
        TAKEN.strip(),
        f"stored in {OLD['file']}",
    ]
    assert ctl("calibration", "rescale") == (0, "\n".join(lines) + "\n", "")
    calls = ["calibration.get", "calibration.rescale", "calibration.save"]
    assert daemon.methods() == ["hello", *calls]
    assert "stroke_mm" not in daemon.requests[2].params
    assert daemon.requests[2].params["stop_generation"] == 3
    out = ctl("calibration", "rescale", "--stroke-mm", "84.5", "--json")[1]
    assert json.loads(out) == {**right, "before": OLD, "saved": saved}
    assert daemon.requests[-2].params["stroke_mm"] == 84.5


def test_a_file_of_another_place_is_said_to_stay_as_it_is(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.get"] = lambda request: OLD
    daemon.handlers["calibration.rescale"] = lambda request: CALIBRATION
    daemon.handlers["calibration.save"] = lambda request: STORED
    last = ctl("calibration", "rescale")[1].splitlines()[-1]
    assert last.startswith(f"it came from {OLD['file']}, which is as it was: ")


def test_what_is_rescaled_but_not_stored_is_said(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.get"] = lambda request: OLD
    daemon.handlers["calibration.rescale"] = lambda request: CALIBRATION
    daemon.handlers["calibration.save"] = lambda request: request.fail(
        "not_saved", -32000, "the disk is full"
    )
    code, out, err = ctl("calibration", "rescale")
    assert (code, out) == (4, "")
    text = "the calibration in use is rescaled, but not stored: the disk is full"
    assert err.splitlines()[0] == f"litegripctl: {text}"


def test_a_rescaling_that_is_refused_stores_nothing(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.get"] = lambda request: NONE
    daemon.handlers["calibration.rescale"] = lambda request: request.fail("not_calibrated", -32010)
    assert ctl("calibration", "rescale")[0] == 4
    assert "calibration.save" not in daemon.methods()


@pytest.mark.parametrize("arguments", [[], ["show"]])
def test_the_calibration_is_shown(daemon: FakeDaemon, ctl: Ctl, arguments: list[str]) -> None:
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    code, out, _ = ctl("calibration", *arguments)
    assert code == 0
    assert out.splitlines() == [
        "mount       normal",
        "closed      +0.0000 rad",
        "open        -1.6510 rad",
        "travel      1.6510 rad or 86.99 mm",
        "scale       52.69 mm/rad",
        "work stroke 80.00 mm",
        "gains       kp 100, kd 2",
        "file        /var/lib/litegripd/can0_calibration.json",
    ]
    assert json.loads(ctl("calibration", *arguments, "--json")[1]) == CALIBRATION
    daemon.handlers["calibration.get"] = lambda request: NONE
    assert ctl("calibration", *arguments) == (0, f"not calibrated; {CHOOSE}\n", "")


def test_the_templates_are_shown(daemon: FakeDaemon, ctl: Ctl) -> None:
    rows = {"templates": [{"name": "normal", "content": CONTENT}]}
    daemon.handlers["calibration.templates"] = lambda request: rows
    text = "normal   closed +0.0000 rad, open -1.6510 rad\n"
    assert ctl("calibration", "templates") == (0, text, "")
    assert json.loads(ctl("calibration", "templates", "--json")[1]) == rows


def test_loading(daemon: FakeDaemon, ctl: Ctl, tmp_path: Path) -> None:
    path = tmp_path / "normal"
    path.write_text(json.dumps(CONTENT), encoding="utf-8")
    daemon.handlers["calibration.load"] = lambda request: LOADED
    text = "loaded: mount normal, travel 1.6510 rad or 86.99 mm\n"
    found = "found in /var/lib/litegripd/can0_calibration.json\n"
    for source, params, end in (
        ("normal", {"template": "normal"}, NOMINAL),
        ("reverse", {"template": "reverse"}, NOMINAL),
        (str(path), {"content": CONTENT}, IN_USE),
        ("--chain", {}, found),
    ):
        assert ctl("calibration", "load", source) == (0, text + end, "")
        assert daemon.requests[-1].params == params


def test_loading_and_storing(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.load"] = lambda request: LOADED
    daemon.handlers["calibration.save"] = lambda request: STORED
    code, out, _ = ctl("calibration", "load", "normal", "--keep")
    assert (code, out.splitlines()[1:]) == (0, ["stored in /var/lib/x.json", MEASURE])
    out = ctl("calibration", "load", "normal", "--keep", "--json")[1]
    assert json.loads(out) == {**LOADED, "saved": STORED}


def test_loading_nothing_stores_nothing(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.load"] = lambda request: {
        **NONE,
        "loaded": False,
        "skipped": ["/a.json: of can1"],
    }
    code, out, _ = ctl("calibration", "load", "--chain", "--keep")
    assert (code, daemon.methods()) == (1, ["hello", "calibration.load"])
    assert out.splitlines() == [
        "skipped: /a.json: of can1",
        "NOT loaded: no calibration was found",
        CHOOSE,
    ]


@pytest.mark.parametrize(
    ("text", "why"),
    [
        (None, "No such file or directory"),
        (b"\xff{}", "is not UTF-8"),
        (b"{", "not valid JSON"),
        (b'{"kp": NaN}', "kp is NaN, it must be a finite number"),
        (b"[" * 100_000, "not valid JSON"),
        (b"[1]", "not a JSON object"),
    ],
)
def test_a_file_that_is_no_calibration(
    daemon: FakeDaemon, ctl: Ctl, tmp_path: Path, text: bytes | None, why: str
) -> None:
    path = tmp_path / "x.json"
    if text is not None:
        path.write_bytes(text)
    code, _, err = ctl("calibration", "load", str(path))
    assert (code, daemon.methods()) == (4, ["hello"])
    assert err.startswith(f"litegripctl: cannot load {path}: ")
    assert why in err
    assert err.endswith("  give a calibration file, or a template: normal, reverse\n")


def test_storing(daemon: FakeDaemon, ctl: Ctl) -> None:
    daemon.handlers["calibration.save"] = lambda request: {**STORED, "previous": "/x.old"}
    text = "stored in /var/lib/x.json (the one before: /x.old)\n"
    assert ctl("calibration", "save") == (0, text, "")
    daemon.handlers["calibration.save"] = lambda request: request.fail("not_calibrated", -32010)
    assert ctl("calibration", "save")[0] == 4


def test_writing_a_file(daemon: FakeDaemon, ctl: Ctl, tmp_path: Path) -> None:
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    path = tmp_path / "x.json"
    assert ctl("calibration", "save", str(path)) == (0, f"written to {path}\n", "")
    assert json.loads(path.read_text(encoding="utf-8")) == CONTENT
    path.write_text("mine", encoding="utf-8")
    code, _, err = ctl("calibration", "save", str(path))
    assert (code, path.read_text(encoding="utf-8")) == (4, "mine")
    assert err.splitlines() == [
        f"litegripctl: {path} exists already",
        "  take another name, or replace it with: --overwrite",
    ]
    out = ctl("calibration", "save", str(path), "--overwrite", "--json")[1]
    assert json.loads(out) == {"path": str(path), "content": CONTENT}
    assert json.loads(path.read_text(encoding="utf-8")) == CONTENT
    assert list(tmp_path.glob("x.json*")) == [path]


def test_a_file_that_cannot_be_written(daemon: FakeDaemon, ctl: Ctl, tmp_path: Path) -> None:
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    path = tmp_path / "missing" / "x.json"
    code, _, err = ctl("calibration", "save", str(path))
    assert code == 4
    assert err.startswith(f"litegripctl: cannot write {path}: No such file or directory\n")
    assert ctl("calibration", "save", str(tmp_path), "--overwrite")[0] == 4
    assert not list(tmp_path.parent.glob(f"{tmp_path.name}.*"))


@pytest.mark.parametrize("found", [NONE, {**CALIBRATION, "calibrated": False}])
def test_no_calibration_is_not_written(
    daemon: FakeDaemon, ctl: Ctl, tmp_path: Path, found: dict[str, Any]
) -> None:
    daemon.handlers["calibration.get"] = lambda request: found
    code, _, err = ctl("calibration", "save", str(tmp_path / "x.json"))
    assert (code, list(tmp_path.glob("x.json*"))) == (4, [])
    assert CHOOSE in err
