"""Plays transcripts of litegripctl at the real daemon: what is typed, shown, and asked.

A scene begins with its title behind `==`, at a calibrated gripper whose motor is disabled. Then:

    $ move 45mm               is typed; below stands all of its output
    move: reached, at ~ mm    ~ stands for a number, … for anything, or alone for more lines
    {"ok": true}              an object with at least these members
    ! litegripctl: no         on standard error
    = 4                       the exit code, 0 where none stands
    > motion.move {"x": "~"}  the last request of a method, with just these parameters
    >> motion.move {...}      one that is guarded: never after a stop it did not know of
    -- motion.move            no request of that method came in this scene
    @ object 50               something happens: see `Stage`
    @ types y ⏎ 84.5 ^D ^C    these lines are typed at the next command's questions, and shown
                              behind them; push:0.6 first pushes the jaws open, -0.6 closed

What a daemon is made to say marks its names as the daemon does: "call {motor.enable} first".
"""

import json
import re
import shlex
import sys
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from litegripd.model.errors import ERRORS
from litegripd.model.sentence import sentence, with_terms
from tests.client.rig import GUARDS, SILENT, Asked, Bench, Ctl, Heard, Refuse
from tests.trajectories import lgt

Scene = tuple[str, list[str]]


def scenes_of(path: Path) -> Iterator[Scene]:
    """Return title and lines of each scene."""
    for text in path.read_text(encoding="utf-8").split("\n== ")[1:]:
        title, *lines = text.split("\n")
        yield title, [line for line in lines if line.strip()]


class Stage:
    """A gripper's machine, on which a scene is played; its public methods are what may happen."""

    def __init__(self, site: Bench, ctl: Ctl, folder: Path, patch: pytest.MonkeyPatch) -> None:
        self._site, self._ctl, self._folder, self._patch = site, ctl, folder, patch
        self._daemon = Heard()
        site.add(self._daemon)
        self._other = self._daemon.client(pid=77, uid=1000)
        self._answers: list[str] = []

    def play(self, lines: list[str]) -> None:
        """Play a scene; fail where it is not as it stands in the transcript."""
        at = 0
        while at < len(lines):
            line = lines[at]
            at += 1
            if line.startswith("@ "):
                name, _, rest = line[2:].partition(" ")
                getattr(self, name)(rest.replace("FOLDER", str(self._folder)))
            elif line.startswith(("> ", ">> ")):
                self._check_asked(line)
            elif line.startswith("-- "):
                assert line[3:] not in self._daemon.methods(), line
            else:
                assert line.startswith("$ "), line
                expected = []
                while at < len(lines) and not lines[at].startswith(("$ ", "@ ", ">", "-- ")):
                    expected.append(lines[at])
                    at += 1
                self._type(line[2:], expected)

    def _type(self, typed: str, expected: list[str]) -> None:
        arguments = shlex.split(typed.replace("FOLDER", str(self._folder)))
        with pytest.MonkeyPatch.context() as patch:
            if self._answers:
                here = SimpleNamespace(isatty=lambda: True, readline=self._read)
                patch.setattr("sys.stdin", here)
                patch.setattr(sys.stderr, "isatty", lambda: True)
            code, shown, told = self._ctl(*arguments)
        assert all(stream.hung_up for stream in self._daemon.streams), "a connection is left open"
        assert self._answers in ([], [_NOBODY])
        self._answers = []
        lines = [*shown.splitlines(), *(f"! {line}" for line in told.splitlines())]
        got = [line.replace(str(self._folder), "FOLDER").rstrip() for line in lines]
        got = [line for line in got if line] + ([] if code == 0 else [f"= {code}"])
        text = "".join(f"{line}\n" for line in got)
        fits, rest, below = True, expected, text
        if expected and expected[0].startswith("{"):
            fits = _has(json.loads(got[0]), json.loads(expected[0]))
            rest, below = expected[1:], text.partition("\n")[2]
        fits = fits and re.fullmatch("".join(map(_pattern, rest)), below) is not None
        assert fits, "\n".join(["", f"$ {typed}", *got, "--- expected:", *expected])

    def _check_asked(self, line: str) -> None:
        mark, method, params = line.split(" ", 2)
        (*_, last) = (one for one in self._daemon.requests if one.method == method)
        pattern = re.escape(json.dumps(json.loads(params), sort_keys=True))
        asked = json.dumps(last.plain, sort_keys=True)
        assert re.fullmatch(pattern.replace('"\\~"', _NUMBER), asked), asked
        assert (set(GUARDS) <= set(last.params)) is (mark == ">>"), line

    def _read(self) -> str:
        """Return the next line that is typed, which a terminal shows; push by hand before it."""
        answer = self._answers.pop(0)
        while answer.startswith("push:"):
            opening_nm = float(answer.removeprefix("push:"))
            self._daemon.gripper.push(-opening_nm * self._daemon.gripper.parameters.close_sign)
            self._site.run(0.6)
            self._daemon.gripper.push(0.0)
            answer = self._answers.pop(0)
        assert answer != _NOBODY
        if answer == "^C":
            raise KeyboardInterrupt
        if answer == "^D":
            return ""
        line = "\n" if answer == "⏎" else f"{answer}\n"
        sys.stderr.write(line)
        return line

    # What may happen

    def types(self, answers: str) -> None:
        """Somebody sits at the terminal of the next command."""
        self._answers = answers.split()

    def enabled(self, _rest: str) -> None:
        """The motor is enabled, for longer than a program runs."""
        assert self._daemon.client().result("motor.enable", detach=True)["ok"]

    def object(self, width_mm: str) -> None:
        """Something stands between the jaws."""
        self._daemon.gripper.put_object(width_mm=float(width_mm))

    def weakened(self, _rest: str) -> None:
        """The motor makes little of its torque from now on."""
        self._daemon.gripper.weaken(0.15)

    def other(self, rest: str) -> None:
        """Another client, which stays connected, calls a method."""
        method, _, params = rest.partition(" ")
        self._other.send(method, **json.loads(params or "{}"))

    def soon(self, rest: str) -> None:
        """It does so in 0.2 s, while litegripctl waits."""
        self._site.after(0.2, partial(self.other, rest))

    def interrupt(self, _rest: str) -> None:
        """Ctrl-C is pressed in 0.2 s."""

        def interrupt() -> None:
            raise KeyboardInterrupt

        self._site.after(0.2, interrupt)

    def gone_in(self, seconds: str) -> None:
        """The daemon ends in so many seconds."""
        self._site.after(float(seconds), self._daemon.hang_up)

    def run(self, seconds: str) -> None:
        """Time passes."""
        self._site.run(float(seconds))

    def uncalibrated(self, _rest: str) -> None:
        """Another daemon, without a calibration, is there instead."""
        self._daemon = Heard(calibrated=False, home=self._folder)
        self._site.add(self._daemon)

    def says(self, rest: str) -> None:
        """The daemon answers a method otherwise: with members changed, or by something else."""
        method, _, text = rest.partition(" ")
        self._daemon.instead[method] = _marked(json.loads(text))

    def sits(self, _rest: str) -> None:
        """Somebody sits at the terminal of the next command, which asks nothing."""
        self._answers = [_NOBODY]

    def measures(self, text: str) -> None:
        """The daemon answers `zero` with these figures, but for these members."""
        result = {**MEASURED, "state": self._daemon.wire_state, **json.loads(text or "{}")}
        self._daemon.instead["calibration.zero"] = result

    def teleop(self, text: str) -> None:
        """Teleoperation has this status, and else that of one which never ran."""
        own = self._daemon.client().result("teleop.status")
        for method in ("teleop.start", "teleop.status", "teleop.stop"):
            self._daemon.instead[method] = {**own, **json.loads(text)}

    def then(self, rest: str) -> None:
        """In 0.2 s the daemon answers a method with other members."""
        method, _, text = rest.partition(" ")
        answer = {**self._daemon.instead[method], **json.loads(text)}
        self._site.after(0.2, partial(self._daemon.instead.__setitem__, method, answer))

    def finds(self, text: str) -> None:
        """The calibration by hand ends with these figures, but for these members."""
        result = {**MEASURED, "state": self._daemon.wire_state, **json.loads(text)}
        self._daemon.instead["calibration.manual"] = lambda request: (
            result if request.params["step"] == "finish" else None
        )

    def stumbles(self, rest: str) -> None:
        """The daemon refuses a step of the calibration by hand once, with a message and data."""
        step, reason, text = rest.split(" ", 2)

        def refuse(request: Asked) -> Refuse | None:
            if request.params["step"] != step:
                return None
            del self._daemon.instead["calibration.manual"]
            return _refusal(reason, text)

        self._daemon.instead["calibration.manual"] = refuse

    def state(self, text: str) -> None:
        """The state has these members, and else is the real one."""
        state = {**self._daemon.wire_state, **json.loads(text)}
        self._daemon.instead["state.get"] = state
        self._daemon.instead["state.subscribe"] = {"subscription": 5, "state": state}
        self._daemon.instead["state.unsubscribe"] = {"subscription": 5}

    def hello(self, text: str) -> None:
        """The daemon introduces itself with these members."""
        own = self._daemon.client().result("hello")
        self._daemon.instead["hello"] = {**own, **json.loads(text)}

    def refuses(self, rest: str) -> None:
        """The daemon refuses a method for a reason, with a message and data."""
        method, reason, text = rest.split(" ", 2)
        self._daemon.instead[method] = _refusal(reason, text)

    def noon(self, _rest: str) -> None:
        """The daemon's clock shows 1000 s at noon in UTC."""
        self.hello('{"monotonic_s": 1000.0}')
        self._patch.setattr("litegrip_client.ctl.render.time", lambda: 43_200.0)

    def variable(self, setting: str) -> None:
        """A variable of the environment is set: NAME=VALUE."""
        self._patch.setenv(*setting.split("=", 1))

    def lacks(self, names: str) -> None:
        """The state is an older daemon's, which does not have these members."""
        state = self._daemon.wire_state
        self._daemon.instead["state.get"] = {
            name: value for name, value in state.items() if name not in names.split()
        }

    def hangs_up(self, method: str) -> None:
        """The daemon ends as soon as it is asked this."""

        def hang_up(_request: Asked) -> None:
            self._daemon.hang_up()

        self._daemon.instead[method] = hang_up

    def deaf(self, method: str) -> None:
        """The daemon does not answer a method."""
        self._daemon.instead[method] = SILENT

    def itself(self, _rest: str) -> None:
        """The daemon answers by itself again."""
        self._daemon.instead.clear()

    def trajectory(self, name: str) -> None:
        """A trajectory of 300 samples lies where those of this side are."""
        self._mine(name, lgt(POINTS))

    def cut(self, name: str) -> None:
        """One that lacks its last byte does."""
        self._mine(name, lgt(POINTS)[:-1])

    def _mine(self, name: str, content: bytes) -> None:
        path = self._folder / "mine" / name
        path.parent.mkdir(exist_ok=True)
        path.write_bytes(content)

    def here(self, _rest: str) -> None:
        """The folder is the current one."""
        self._patch.chdir(self._folder)

    def holds(self, rest: str) -> None:
        """A file of the folder is found to have this content."""
        name, _, text = rest.partition(" ")
        assert (self._folder / name).read_text(encoding="utf-8") == text

    def file(self, rest: str) -> None:
        """A file lies in the folder."""
        name, _, text = rest.partition(" ")
        (self._folder / name).write_text(text, encoding="utf-8")


MEASURED: dict[str, Any] = {
    "job": 4,
    "ok": True,
    "outcome": "measured",
    "closed_rad": 0.104,
    "open_rad": -1.513,
    "travel_rad": 1.617,
    "rad_to_mm": 86.0 / 1.617,
    "content": {},
    "path": "/var/lib/x.json",
    "message": None,
}
_NOBODY = "nothing is asked"
POINTS = [(number / 100, 0.6 + number / 3000) for number in range(300)]

_NUMBER = r"[-+]?[0-9.]+"


def _has(actual: Any, wished: Any) -> bool:
    """Return True if an object has at least the wished members, and so have those of a list."""
    if isinstance(wished, dict) and isinstance(actual, dict):
        return all(name in actual and _has(actual[name], one) for name, one in wished.items())
    if isinstance(wished, list) and isinstance(actual, list):
        return len(actual) == len(wished) and all(map(_has, actual, wished))
    return bool(actual == wished)


def _refusal(reason: str, text: str) -> Refuse:
    """Return a refusal with a message and, behind that, its data."""
    message, _, data = text.partition(' {"')
    more = _marked(json.loads('{"' + data)) if data else {}
    more.pop("terms", None)  # which a refusal tells of itself
    return Refuse(reason, ERRORS[reason].code, sentence(message), **more)


def _marked(value: Any) -> Any:
    """Return an answer whose texts have their terms beside them."""
    if isinstance(value, dict):
        return with_terms({name: _marked(one) for name, one in value.items()})
    if isinstance(value, list):
        return [_marked(one) for one in value]
    return sentence(value) if isinstance(value, str) else value


def _pattern(line: str) -> str:
    """Return the pattern for a line of a transcript, with its end."""
    if line in ("…", "! …"):
        return r"(?:! .*\n)*" if line[0] == "!" else r"(?:[^!=].*\n)*"
    return re.escape(line).replace("\\~", _NUMBER).replace("…", ".*") + r"\n"
