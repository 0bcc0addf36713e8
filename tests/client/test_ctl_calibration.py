"""The commands of litegripctl around the calibration, without the one by hand."""

import json
import subprocess
from pathlib import Path
from typing import Any

import pytest

from tests.client.ctl_terminal import Terminal
from tests.client.fake_daemon import STATE, FakeDaemon
from tests.client.helpers import Ctl

CONTENT = {"calibrated": True, "zero_position_rad": 0.114, "max_position_rad": -1.491, "own": "é"}
CALIBRATION: dict[str, Any] = {
    "calibrated": True,
    "mount": "normal",
    "closed_rad": 0.114,
    "open_rad": -1.491,
    "travel_rad": 1.605,
    "travel_mm": 120.054,
    "rad_to_mm": 74.8,
    "kp": 100.0,
    "kd": 2.0,
    "file": "/var/lib/litegripd/can0_calibration.json",
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
    "rad_to_mm": 74.2,
    "content": CONTENT,
    "path": "/var/lib/x.json",
    "message": None,
    "state": STATE,
}
TRAVEL = "closed +0.1040 rad, open -1.5130 rad, travel 1.6170 rad or 119.98 mm, mount normal\n"
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
        (MEASURED, 0, f"zero: measured\n{TRAVEL}stored in /var/lib/x.json\n"),
        ({**MEASURED, "path": None}, 0, f"zero: measured\n{TRAVEL}{IN_USE}"),
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


@pytest.mark.parametrize(("answer", "code"), [("y\n", 0), ("Yes \n", 0), ("\n", 1), ("\x04", 1)])
def test_zero_on_a_terminal_asks_before_it_moves(
    daemon: FakeDaemon, answer: str, code: int
) -> None:
    daemon.handlers["calibration.zero"] = lambda request: MEASURED
    terminal = Terminal("--socket", daemon.path, "zero")
    terminal.expect("the jaws will move to both stops; continue? [y/N] ")
    assert daemon.methods() == ["hello"]
    terminal.type(answer)
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


@pytest.mark.parametrize("arguments", [[], ["show"]])
def test_the_calibration_is_shown(daemon: FakeDaemon, ctl: Ctl, arguments: list[str]) -> None:
    daemon.handlers["calibration.get"] = lambda request: CALIBRATION
    code, out, _ = ctl("calibration", *arguments)
    assert code == 0
    assert out.splitlines() == [
        "mount   normal",
        "closed  +0.1140 rad",
        "open    -1.4910 rad",
        "travel  1.6050 rad or 120.05 mm",
        "scale   74.80 mm/rad",
        "gains   kp 100, kd 2",
        "file    /var/lib/litegripd/can0_calibration.json",
    ]
    assert json.loads(ctl("calibration", *arguments, "--json")[1]) == CALIBRATION
    daemon.handlers["calibration.get"] = lambda request: NONE
    assert ctl("calibration", *arguments) == (0, f"not calibrated; {CHOOSE}\n", "")


def test_the_templates_are_shown(daemon: FakeDaemon, ctl: Ctl) -> None:
    rows = {"templates": [{"name": "normal", "content": CONTENT}]}
    daemon.handlers["calibration.templates"] = lambda request: rows
    text = "normal   closed +0.1140 rad, open -1.4910 rad\n"
    assert ctl("calibration", "templates") == (0, text, "")
    assert json.loads(ctl("calibration", "templates", "--json")[1]) == rows


def test_loading(daemon: FakeDaemon, ctl: Ctl, tmp_path: Path) -> None:
    path = tmp_path / "normal"
    path.write_text(json.dumps(CONTENT), encoding="utf-8")
    daemon.handlers["calibration.load"] = lambda request: LOADED
    text = "loaded: mount normal, travel 1.6050 rad or 120.05 mm\n"
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
        (b"\xff{}", "can't decode"),
        (b"{", "not valid JSON"),
        (b'{"kp": NaN}', "NaN is no number"),
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
