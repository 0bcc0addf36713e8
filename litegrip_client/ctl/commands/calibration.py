"""The calibration: measured, shown, loaded, saved, made by hand.

By hand the person moves the slack jaws; this program asks and records. The daemon ends that when
this program dies, and the calibration in use changes at the very end only.
"""

from __future__ import annotations

import contextlib
import json
import math
import re
from collections.abc import Mapping
from pathlib import Path

from litegrip_client.core.calibrations import warnings_in
from litegrip_client.core.session import ACTION_TIMEOUT_S
from litegrip_client.ctl.files import put_file, refuse_existing
from litegrip_client.ctl.parser import LateParser, in_unit, positive
from litegrip_client.ctl.render import CHOOSE_MOUNT, finish, verdict
from litegrip_client.ctl.run import (
    INTERRUPTED,
    NOT_OK,
    Command,
    Commands,
    Run,
    ask,
    confirm,
    may_ask,
    one_line,
    say,
)
from litegrip_client.values.checks import given_numbers
from litegrip_client.values.errors import CancelledError, CommandError, LiteGripError
from litegrip_client.values.fields import SPAN_INSET_MM
from litegrip_client.values.figures import Data, figure, plain
from litegrip_client.values.terms import told
from litegrip_client.values.text import json_of

_AS_BEFORE = "the calibration is as it was"
_SAVE = "use it and store it (y), use it without storing it (n), or cancel (c)?"
_WORDS = ("y", "yes", "n", "no", "c", "cancel")
_STOOD_RAD = 0.05
"""Less than a hand moves the jaws; Enter was pressed twice."""
_TEMPLATES = ("normal", "reverse")
_IN_USE = "in use until the daemon restarts"
_UNSTORED = f"{_IN_USE}; store it with: litegripctl calibration save"
_MEASURE = (
    "nominal: it was not measured on this gripper; measure and store it with:"
    " litegripctl enable && litegripctl zero"
)


class _NotWantedError(Exception):
    """The person says so, or has gone."""


def manual(run: Run) -> int:
    """Record both stops, show the travel, and have it used as the person says."""
    if not may_ask():
        return run.refuse(
            "a calibration by hand needs a terminal to ask at",
            run.here("without hands: litegripctl zero --yes"),
        )
    _step(run, "begin")
    try:
        data = _lead(run)
    except (KeyboardInterrupt, _NotWantedError) as reason:
        interrupted = isinstance(reason, KeyboardInterrupt)
        how = "interrupted" if interrupted else "cancelled"
        text, hint = f"{how}: {_AS_BEFORE}, the jaws hold", ""
        error = _cancel(run)
        if error is not None:
            text = f"{how}, but the daemon did not confirm that {_AS_BEFORE}: {error.message}"
            hint = run.here("see: litegripctl calibration")
        run.output.error(CancelledError(text, reason=how), hint)
        return INTERRUPTED if interrupted else NOT_OK
    except BaseException:
        _cancel(run)  # if that fails, too, the end of the connection does it
        raise
    return run.done(data, _measured_text(run, "manual", data), ok=data["ok"])


def _lead(run: Run) -> Data:
    """Record until what was recorded is taken."""
    say("The jaws are slack now. Ctrl-C cancels.")
    stroke_mm = run.options.stroke_mm
    is_recorded, is_measured = False, stroke_mm is not None
    while True:
        if not is_recorded:
            _record(run)
        if not is_measured:
            stroke_mm = _ask_stroke(run)
        answer = _choose(_SAVE, "y", "n", "c")
        if answer == "c":
            raise _NotWantedError
        try:
            return _step(run, "finish", save=answer == "y", **given_numbers(stroke_mm=stroke_mm))
        except CommandError as error:
            if error.reason != "out_of_limits":
                raise
            say(f"  {one_line(error.message)}")
            is_recorded = error.data.get("field") == "stroke_mm"
            is_measured = not is_recorded


def _record(run: Run) -> None:
    before = run.connection.call("calibration.get")
    while True:
        for step, request in (
            ("closed", "push the jaws closed, to the stop, then press Enter:"),
            ("open", "pull the jaws open, to the stop, then press Enter:"),
        ):
            _ask(request)
            marks = _step(run, step)
            say(f"  {step} at {figure(marks[f'{step}_rad'], '+.4f', 'rad')}")
        if abs(marks["closed_rad"] - marks["open_rad"]) < _STOOD_RAD:
            say("  the jaws have stood still between the two: once more")
            continue
        say(f"  {_travel_text(marks)}")
        mount = _mount(marks)
        if not before["calibrated"] or before["mount"] == mount:
            return
        say(f"  the mount was {before['mount']}: were they closed first, and then open?")
        if _choose("yes, go on (y), or record both again (n)?", "y", "n") == "y":
            return


def _ask(question: str) -> str:
    answer = ask(question)
    if answer is None:
        raise _NotWantedError
    return answer


def _choose(question: str, *letters: str) -> str:
    """Return which of these letters an answer begins with; asks until it is one of them."""
    answer = _ask(question)
    while answer not in _WORDS or answer[0] not in letters:
        one_of = f"{', '.join(letters[:-1])} or {letters[-1]}"
        answer = _ask(f"please answer {one_of}: {question}")
    return answer[0]


def _ask_stroke(run: Run) -> float | None:
    """Return how far the jaws open, as a person measured it; None for what is configured."""
    configured_mm = run.connection.call("info.get")["gripper"]["stroke_mm"]
    question = f"how far do the jaws open, by a caliper, in mm? [{configured_mm:g}]"
    again = ""
    while answer := _ask(f"{again}{question}"):
        with contextlib.suppress(ValueError):
            stroke_mm = float(answer.removesuffix("mm"))
            if 0.0 < stroke_mm < math.inf:
                return stroke_mm
        again = "please answer a number above 0, or press Enter: "
    return None


def _step(run: Run, step: str, **params: object) -> Data:
    wanted = {"step": step, **params}
    return run.connection.command("calibration.manual", wanted, ACTION_TIMEOUT_S)


def _cancel(run: Run) -> LiteGripError | None:
    """End it; gives the error of that: the end of this connection then ends it."""
    try:
        run.connection.call("calibration.manual", {"step": "cancel"})
    except LiteGripError as error:
        return error
    return None


_ZERO = """\
Measure the travel: move to both stops, gently, and use what was found.

Keep hands and objects out of the jaws. Which way the jaws close must be known
before: by the calibration in use, or by --mount. How far they open is not found
by moving: it is asked for, or given by --stroke-mm, and all millimetres follow
from it.
"""


def zero_options(parser: LateParser) -> None:
    """Add the arguments of `zero`."""
    parser.description = _ZERO
    parser.add_argument(
        "--mount",
        choices=("normal", "reverse"),
        help="which way the jaws close (default: as in the calibration in use)",
    )
    _stroke_options(parser)
    parser.add_argument(
        "--no-save", action="store_true", help="use what was found, but do not store it"
    )
    parser.add_argument("-y", "--yes", action="store_true", help="do not ask before moving")


def _stroke_options(parser: LateParser) -> None:
    parser.add_argument(
        "--stroke-mm",
        type=in_unit(positive, "mm"),
        metavar="MM",
        help="how far the jaws open, as a caliper measures it (default: as configured)",
    )


def zero(run: Run) -> int:
    """Measure the travel by moving to both stops, once that is confirmed."""
    options = run.options
    stroke_mm = options.stroke_mm
    if not options.yes:
        if not may_ask():
            return run.refuse(
                "zero moves the jaws to both stops, and there is no terminal to confirm it at",
                run.here("if that is safe: litegripctl zero --yes"),
            )
        try:
            if not confirm("the jaws will move to both stops; is nothing between them?"):
                raise _NotWantedError
            if stroke_mm is None:
                stroke_mm = _ask_stroke(run)
        except _NotWantedError:
            run.output.error(CommandError("nothing was done", reason="not_wanted"), "")
            return NOT_OK
    params: dict[str, object] = {"save": not options.no_save, **given_numbers(stroke_mm=stroke_mm)}
    if options.mount is not None:
        params["mount"] = options.mount
    while True:
        try:
            return finish(
                run, "calibration.zero", params, lambda data: _measured_text(run, "zero", data)
            )
        except CommandError as error:
            is_asked = not options.yes and options.stroke_mm is None
            if not is_asked or error.data.get("field") != "stroke_mm":
                raise
            say(f"  {one_line(error.message)}")
        params.pop("stroke_mm", None)
        params |= given_numbers(stroke_mm=_ask_stroke(run))


_RAISED = re.compile(r"\braise (\w+)")
"""A field of the configuration that a measurement failed by; the daemon names it alone."""


def _with_setting(run: Run, message: str) -> str:
    """Put behind such a field the command that sets it."""

    def named(raised: re.Match[str]) -> str:
        setting = f"{raised[1]}=..."
        return f"{raised[0]} ({run.here(f'litegripctl config set {setting}')})"

    return _RAISED.sub(named, message)


def _measured_text(run: Run, name: str, data: Data) -> str:
    """Return what was measured between the stops, and where it is stored."""
    text = f"{name}: {verdict(data)}"
    if data.get("message"):
        text += f": {_with_setting(run, plain(told(data, 'message', run.voice)))}"
    if data.get("closed_rad") is not None and data.get("open_rad") is not None:
        text += f"\n{_travel_text(data)}"
    if data.get("ok") and data.get("rad_to_mm") is not None:
        text += f"\n{_stroke_text(run, data)}"
    if data.get("path") is not None:
        return f"{text}\nstored in {plain(data['path'])}"
    return f"{text}\n{run.here(_UNSTORED)}" if data.get("ok") else text


def _stroke_text(run: Run, data: Data) -> str:
    """Return which stroke the scale was made of, and how to correct it."""
    stroke_mm = abs(data["closed_rad"] - data["open_rad"]) * data["rad_to_mm"] - SPAN_INSET_MM
    remedy = run.here("if a caliper says otherwise: litegripctl calibration rescale --stroke-mm MM")
    return f"taken: the jaws open {figure(stroke_mm, '.5g', 'mm')}; {remedy}"


def _travel_text(data: Data) -> str:
    """Return the two stops and what lies between, in one line."""
    closed_rad, open_rad = data["closed_rad"], data["open_rad"]
    travel_rad = abs(closed_rad - open_rad)
    size = figure(travel_rad, ".4f", "rad")
    if data.get("rad_to_mm") is not None:
        size += f" or {figure(travel_rad * data['rad_to_mm'], '.2f', 'mm')}"
    ends = f"closed {figure(closed_rad, '+.4f', 'rad')}, open {figure(open_rad, '+.4f', 'rad')}"
    return f"{ends}, travel {size}, mount {_mount(data)}"


def _mount(data: Data) -> str:
    """Return the mount that two stops mean."""
    return "normal" if data["closed_rad"] > data["open_rad"] else "reverse"


_CALIBRATION = """\
The calibration says where the two stops are, which way the jaws close, and how
far they move. Without an action it is shown.
"""
_MANUAL = """\
Calibrate by hand: the jaws go slack, you push them to both stops, and the
travel between is used. Nothing changes before you agree at the end.
"""


def actions_options(parser: LateParser) -> None:
    """Add the actions of `calibration`, and their arguments."""
    parser.description = _CALIBRATION
    add = parser.add_subparsers(dest="action", metavar="ACTION", parser_class=LateParser).add_parser
    add("show", help="show the calibration in use (default)")
    add("templates", help="show the nominal calibrations, one for each mount")
    add("load", help="use another calibration", fill=_load_options)
    add("save", help="store the calibration in use", fill=_save_options)
    add("manual", help="calibrate by hand", description=_MANUAL, fill=_stroke_options)
    add("rescale", help="correct its millimetres, and store it", fill=_rescale_options)


def _load_options(parser: LateParser) -> None:
    parser.description = "Use a template, a calibration file, or what the daemon finds itself."
    parser.usage = (
        "%(prog)s [-h] [-c CHANNEL | --socket PATH] [--json]\n"
        "       [--keep] (normal | reverse | FILE | --chain)"
    )
    source = parser.add_mutually_exclusive_group(required=True)
    source.add_argument(
        "source",
        nargs="?",
        metavar="normal|reverse|FILE",
        help="a template, or a file of this machine, ./normal for one of that name",
    )
    source.add_argument(
        "--chain", action="store_true", help="what the daemon finds, as it does at its start"
    )
    parser.add_argument(
        "--keep", action="store_true", help="have the daemon store it for its next start"
    )


def _save_options(parser: LateParser) -> None:
    parser.description = "Store the calibration in use, for the daemon's next start or in a file."
    parser.add_argument(
        "file", nargs="?", metavar="FILE", help="write it to this file instead, here"
    )
    parser.add_argument("--overwrite", action="store_true", help="replace a FILE that exists")


_RESCALE = """\
Correct the millimetres of the calibration in use, and store it: the scale
becomes that of jaws which open so far. The two stops stay as they were
measured, and nothing moves.
"""


def _rescale_options(parser: LateParser) -> None:
    parser.description = _RESCALE
    _stroke_options(parser)


def calibration(run: Run) -> int:
    """Do what `options.action` says."""
    return _ACTIONS[run.options.action or "show"](run)


def show(run: Run) -> int:
    """Show the calibration in use, in aligned lines."""
    data = run.connection.call("calibration.get")
    if not data.get("calibrated"):
        why = f": {plain(told(data, 'problem', run.voice))}\n" if data.get("problem") else "; "
        return run.done(data, f"not calibrated{why}{run.here(CHOOSE_MOUNT)}")
    work_mm = data.get("work_stroke_mm")
    work = "none: open goes to the stop" if work_mm is None else figure(work_mm, ".2f", "mm")
    rows = [
        ("mount", data.get("mount")),
        ("closed", figure(data.get("closed_rad"), "+.4f", "rad")),
        ("open", figure(data.get("open_rad"), "+.4f", "rad")),
        ("travel", _travel(data)),
        ("scale", figure(data.get("rad_to_mm"), ".2f", "mm/rad")),
        ("work stroke", work),
        ("gains", f"kp {figure(data.get('kp'), 'g', '')}, kd {figure(data.get('kd'), 'g', '')}"),
        ("file", data.get("file") or "none"),
    ]
    lines = [f"{label:<11} {plain(text)}" for label, text in rows]
    return run.done(data, "\n".join(_doubt(run, data) + lines))


def _doubt(run: Run, data: Data) -> list[str]:
    """Return a line for each reason why the calibration is probably wrong."""
    return [f"WARNING: {plain(warning)}" for warning in warnings_in(data, run.voice)]


def templates(run: Run) -> int:
    """Show which templates there are, one in a line."""
    data = run.connection.call("calibration.templates")
    lines = (
        f"{plain(row.get('name')):<8} closed "
        f"{figure(row['content'].get('zero_position_rad'), '+.4f', 'rad')}, "
        f"open {figure(row['content'].get('max_position_rad'), '+.4f', 'rad')}"
        for row in data["templates"]
    )
    return run.done(data, "\n".join(lines))


def load(run: Run) -> int:
    """Have the daemon use a template, a file of this side, or what it finds itself."""
    source = run.options.source
    params: dict[str, object] = {}
    if source in _TEMPLATES:
        params["template"] = source
    elif source is not None:
        params["content"] = _read_file(source)
    try:
        data = run.connection.call("calibration.load", params)
    except CommandError as error:
        error.message = f"{source}: {error.message}" if "content" in params else error.message
        raise
    if data["loaded"] and run.options.keep:
        data = {**data, "saved": _store(run)}
    return run.done(data, _loaded_text(run, data, source=source), ok=data["loaded"])


def _loaded_text(run: Run, data: Data, *, source: str | None) -> str:
    """Return what was loaded, what was not and why, and where it is stored.

    Without a `source` the daemon has found it itself, and will do so again. A template is no
    measurement: what is to be done next is to measure.
    """
    lines = [f"skipped: {plain(reason)}" for reason in data.get("skipped") or ()]
    if not data.get("loaded"):
        lines += ["NOT loaded: no calibration was found", run.here(CHOOSE_MOUNT)]
    else:
        lines.append(f"loaded: mount {plain(data.get('mount'))}, travel {_travel(data)}")
        saved = data.get("saved")
        if saved is not None:
            lines.append(_stored_text(saved))
        elif source is None:
            lines.append(f"found in {plain(data.get('file'))}")
        else:
            lines.append(_IN_USE if source in _TEMPLATES else run.here(_UNSTORED))
        lines += _doubt(run, data)
        if source in _TEMPLATES:
            lines.append(run.here(_MEASURE))
    return "\n".join(lines)


def _read_file(path: str) -> Data:
    """Read a calibration file; raises `CommandError` when it is no JSON object."""
    try:
        content = json_of(Path(path).read_bytes())
        if not isinstance(content, dict):
            raise ValueError("not a JSON object")
    except (OSError, ValueError) as error:
        raise CommandError(
            f"cannot load {path}: {getattr(error, 'strerror', None) or error}",
            reason="calibration_unreadable",
            data={"hint": "give a calibration file, or a template: normal, reverse"},
        ) from error
    return content


def rescale(run: Run) -> int:
    """Have the daemon correct the millimetres of the calibration in use, and store it.

    Shows scale and travel before and after, and where that is stored.
    """
    before = run.connection.call("calibration.get")
    data = run.connection.command(
        "calibration.rescale", given_numbers(stroke_mm=run.options.stroke_mm)
    )
    try:
        saved = _store(run)
    except LiteGripError as error:
        error.message = f"the calibration in use is rescaled, but not stored: {error.message}"
        raise
    changes = (
        f"{label} {figure(before.get(name), '.2f', '')} -> {figure(data.get(name), '.2f', unit)}"
        for label, name, unit in (
            ("scale", "rad_to_mm", "mm/rad"),
            ("travel", "travel_mm", "mm"),
        )
    )
    lines = [", ".join(changes), _stroke_text(run, data), _stored_text(saved)]
    former = before.get("file")
    if former not in (None, saved.get("path")):
        lines.append(
            f"it came from {plain(former)}, which is as it was: if the configuration or"
            " LITEGRIP_CALIB names that file, correct its rad_to_mm as well"
        )
    data = {**data, "before": before, "saved": saved}
    return run.done(data, "\n".join(lines + _doubt(run, data)))


def save(run: Run) -> int:
    """Have the daemon store the calibration in use, or write it to a file of this side."""
    path = run.options.file
    if path is None:
        data = _store(run)
        return run.done(data, _stored_text(data))
    data = run.connection.call("calibration.get")
    content = data["content"]
    if not data["calibrated"] or not content:
        raise CommandError("there is no calibration to write", reason="not_calibrated")
    if not run.options.overwrite:
        refuse_existing(path, "take another name, or replace it with: --overwrite")
    put_file(path, (json.dumps(content, indent=2) + "\n").encode())
    return run.done({"path": path, "content": content}, f"written to {plain(path)}")


def _store(run: Run) -> Data:
    return run.connection.call("calibration.save", None, ACTION_TIMEOUT_S)


def _stored_text(data: Data) -> str:
    """Return where the calibration was stored."""
    previous = data.get("previous")
    before = f" (the one before: {plain(previous)})" if previous else ""
    return f"stored in {plain(data.get('path'))}{before}"


def _travel(data: Data) -> str:
    size = figure(data.get("travel_rad"), ".4f", "rad")
    return f"{size} or {figure(data.get('travel_mm'), '.2f', 'mm')}"


_ACTIONS: Mapping[str, Command] = {
    "show": show,
    "templates": templates,
    "load": load,
    "save": save,
    "manual": manual,
    "rescale": rescale,
}


COMMANDS: Commands = {
    "zero": (zero, zero_options),
    "calibration": (calibration, actions_options),
}
