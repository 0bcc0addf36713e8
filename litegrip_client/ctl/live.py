"""The live view of a gripper: what is known of it, kept up to date, and drawn with rich.

A daemon that goes is waited for.
"""

from __future__ import annotations

import contextlib
import os
import select
import signal
import sys
import termios
import time
import tty
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Sequence

from rich.console import Console, Group, RenderableType
from rich.live import Live
from rich.progress_bar import ProgressBar
from rich.table import Table
from rich.text import Text

from litegrip_client.ctl import render
from litegrip_client.ctl.run import SILENT_AFTER_S, samples
from litegrip_client.ctl.state_view import state_rows
from litegrip_client.line.connection import Connection
from litegrip_client.line.exchange import not_answered
from litegrip_client.line.feeds import Event, EventFeed
from litegrip_client.values.errors import ConnectError
from litegrip_client.values.figures import Here, figure, plain
from litegrip_client.values.terms import told_all
from litegrip_client.values.voices import in_shell_of

TYPE_CHECKING = False
if TYPE_CHECKING:  # see the package: importing typing is slow
    from typing import Any

_EVENTS = 8
_TRACE_COLUMNS, _COLUMN_S = 40, 1.5
_LOOK_EVERY_S = 1.0
_RECONNECT_EVERY_S = 0.5


class Scene:
    """What is known now; None for what is not. `trouble` says why no daemon answers.

    `silent_s` is for how long none has sent anything: then what is known is old.

    `trace` has the latest opening (mm) and force (N) of each column of the last minute.
    `others` is how many other clients are connected, `lease` and `health` are the daemon's answers.
    """

    def __init__(self) -> None:
        self.state: dict[str, Any] | None = None
        self.events: deque[Event] = deque(maxlen=_EVENTS)
        self.trace: dict[int, tuple[float | None, float | None]] = {}
        self.others: int | None = None
        self.lease: dict[str, Any] | None = None
        self.health: dict[str, Any] | None = None
        self.trouble: str | None = None
        self.silent_s = 0.0

    @property
    def is_old(self) -> bool:
        """True if nobody tells what is so now."""
        return self.trouble is not None or self.silent_s > 0.0

    def take(self, state: dict[str, Any]) -> None:
        """Take a new state."""
        self.state = state
        now = int(state["monotonic_s"] / _COLUMN_S)
        known = (None, None) if state["stale"] else (state["opening_mm"], state["force_n"])
        self.trace[now] = known
        began = now - _TRACE_COLUMNS
        self.trace = {at: value for at, value in self.trace.items() if began < at <= now}


def scenes(connect: Callable[[], Connection], connection: Connection, hz: float) -> Iterator[Scene]:
    """Yield the same scene again with each state and each trouble; does not end by itself.

    Begins with a `connection` and makes another one by `connect` whenever it is lost. Raises
    `LiteGripError` when a daemon is there and refuses.
    """
    scene, connected = Scene(), connection
    while True:
        try:
            yield from _connected(scene, connected, hz)
        except ConnectError as error:
            scene.trouble = error.message
        lost_s = time.monotonic() - scene.silent_s
        while scene.trouble is not None:
            scene.silent_s = time.monotonic() - lost_s
            yield scene
            time.sleep(_RECONNECT_EVERY_S)
            try:
                connected = connect()
                scene.trouble = None
            except ConnectError as error:
                scene.trouble = error.message


def _connected(scene: Scene, connection: Connection, hz: float) -> Iterator[Scene]:
    feed = EventFeed(None)
    with connection:
        connection.begin(feed)
        scene.events.clear()
        scene.events.extend(feed.recent)
        look_s = 0.0
        for state, scene.silent_s in samples(connection, hz):
            if state is not None:
                scene.take(state)
                while feed.inbox:  # filled while the samples are read
                    event = feed.take()
                    if event is not None:
                        scene.events.append(event)
                if time.monotonic() >= look_s:  # for what is not sent by itself
                    _look(scene, connection)
                    look_s = time.monotonic() + _LOOK_EVERY_S
            yield scene


def _look(scene: Scene, connection: Connection) -> None:
    """Ask who is there, and how the daemon is; one that is silent meanwhile shows by itself."""
    try:
        rows = connection.call("clients.list", timeout_s=SILENT_AFTER_S)["clients"]
        scene.others = sum(not row.get("is_me") for row in rows)
        scene.lease = connection.call("lease.get", timeout_s=SILENT_AFTER_S)
        scene.health = connection.call("health", timeout_s=SILENT_AFTER_S)
    except ConnectError as error:
        if error.reason != "no_answer":
            raise


_BAR_WIDTH = 40
_STYLES = {"ok": "bold green", "degraded": "bold yellow", "down": "bold red"}
_ALARMING = {"SCALE", "stop", "age"}


def picture(scene: Scene, name: str, here: Here) -> RenderableType:
    """Show a scene of the gripper `name`."""
    verdict = str((scene.health or {}).get("verdict", "--"))
    how, style = plain(verdict), _STYLES.get(verdict, "")
    if scene.trouble is not None:
        how, style = f"NO DAEMON, trying again: {plain(scene.trouble)}", "bold red"
    elif scene.is_old:
        how, style = f"SILENT: {not_answered(scene.silent_s)}", "bold red"
    head = Text.assemble((name, "bold"), "  ", (how, style))
    parts: list[RenderableType] = [head, Text()]
    if scene.state is not None:
        if scene.is_old:
            old = f"as it was {figure(scene.silent_s, '.0f', 's')} ago:"
            parts += [Text(old, "bold red"), Text()]
        parts += [_bar(scene.state), _figures(scene.state, here, is_old=scene.is_old)]
        parts += [Text(), Text("the last minute", "cyan"), _traces(scene)]
    lease = "--" if scene.lease is None else render.lease(scene.lease)
    others = "--" if scene.others is None else f"{scene.others} besides this one"
    company = Table.grid(padding=(0, 2))
    company.add_row(Text(f"{'lease':<11}", "cyan"), Text(lease))
    company.add_row(Text("clients", "cyan"), Text(others))
    parts += [Text(), company]
    if scene.health is not None:
        voice = in_shell_of(here)
        parts += [
            Text(f"- {plain(reason)}", "yellow")
            for reason in told_all(scene.health, "reasons", voice)
        ]
        parts += [
            Text(f"note: {plain(note)}", "dim") for note in told_all(scene.health, "notes", voice)
        ]
    return Group(*parts, Text(), *_events(scene), Text(), Text("q ends it", "dim"))


def _bar(state: dict[str, Any]) -> RenderableType:
    openness = state.get("openness")
    known = openness if isinstance(openness, int | float) else 0.0
    grid = Table.grid(padding=(0, 1))
    bar = ProgressBar(
        total=1.0,
        completed=min(max(known, 0.0), 1.0),
        width=_BAR_WIDTH,
        complete_style="cyan",
        finished_style="cyan",
    )
    grid.add_row("closed", bar, "open")
    return grid


def _figures(state: dict[str, Any], here: Here, *, is_old: bool) -> RenderableType:
    grid = Table.grid(padding=(0, 2))
    is_old = is_old or bool(state.get("stale"))
    for label, text in state_rows(state, here):
        alarming = label in _ALARMING and (label != "age" or is_old)
        style = "bold red" if alarming else "dim" if is_old else ""
        grid.add_row(Text(label, "cyan"), Text(plain(text), style))
    return grid


_LEVELS = "▁▂▃▄▅▆▇█"
_LEAST_SPAN = {"mm": 10.0, "N": 6.0}


def _traces(scene: Scene) -> RenderableType:
    """Show opening and force of the last minute, the newest at the right."""
    newest = max(scene.trace, default=0)
    columns = range(newest - _TRACE_COLUMNS + 1, newest + 1)
    grid = Table.grid(padding=(0, 2))
    for index, (label, unit) in enumerate((("opening", "mm"), ("force", "N"))):
        values = [scene.trace.get(column, (None, None))[index] for column in columns]
        line, low, high = _trace(values, _LEAST_SPAN[unit])
        span = f"{low:.0f} to {high:.0f} {unit}" if line.strip() else "--"
        grid.add_row(Text(f"{label:<11}", "cyan"), Text(line), Text(span, "dim"))
    return grid


def _trace(values: Sequence[float | None], least: float) -> tuple[str, float, float]:
    """Draw values between the lowest and the highest, which are `least` apart at least."""
    known = [value for value in values if value is not None]
    low, high = min(known, default=0.0), max(known, default=0.0)
    missing = max(0.0, least - (high - low))
    low, high = low - missing / 2, high + missing / 2
    top = len(_LEVELS) - 1
    drawn = (
        " " if value is None else _LEVELS[round((value - low) / (high - low) * top)]
        for value in values
    )
    return "".join(drawn), low, high


def _events(scene: Scene) -> list[RenderableType]:
    """Return the last events, the newest at the end, with their age by the state's time."""
    now_s = (scene.state or {}).get("monotonic_s")
    grid = Table.grid(padding=(0, 2))
    for event in scene.events:
        age_s = None if now_s is None else max(0.0, now_s + scene.silent_s - event.monotonic_s)
        age = Text(f"{figure(age_s, '.0f', 's')} ago", "dim", justify="right")
        grid.add_row(age, Text(plain(event.message), no_wrap=True, overflow="ellipsis"))
    return [Text("events", "cyan"), grid] if scene.events else []


_SHORTEST_S = 0.05
"""Between two pictures: nobody sees more, and a slow terminal has time for them."""

_TERMINATED = 128 + signal.SIGTERM


def show(scenes: Iterable[Scene], name: str, here: Here) -> None:
    """Show scenes of the gripper `name` until there are no more of them, or q is pressed."""
    shown_s = 0.0
    keyboard = _Keyboard()
    with (
        Live(console=Console(), screen=True, auto_refresh=False) as live,
        _giving_back(live, keyboard) as interruptions,
    ):
        for scene in scenes:
            if keyboard.is_q_pressed():
                return
            now_s = time.monotonic()
            if now_s - shown_s >= _SHORTEST_S:
                with interruptions.writing():
                    live.update(picture(scene, name, here), refresh=True)
                shown_s = now_s


class _Keyboard:
    """Reads keys as they are pressed, where a terminal is ours to read; Ctrl-C remains a signal."""

    def __init__(self) -> None:
        self._file: int | None = None
        self._before: list[Any] = []

    def start(self) -> None:
        """Begin to read single keys."""
        if sys.stdin is None or not sys.stdin.isatty():
            return
        keyboard = sys.stdin.fileno()
        with contextlib.suppress(OSError):  # it is nobody's controlling terminal
            if os.tcgetpgrp(keyboard) != os.getpgrp():
                return  # it runs in the background: the keys are somebody else's
        self._file, self._before = keyboard, termios.tcgetattr(keyboard)
        tty.setcbreak(keyboard)

    def stop(self) -> None:
        """Leave the terminal as it was."""
        if self._file is not None:
            termios.tcsetattr(self._file, termios.TCSADRAIN, self._before)
        self._file = None

    def is_q_pressed(self) -> bool:
        """Return True if q has been pressed, or nobody is there any more."""
        while self._file is not None and select.select([self._file], [], [], 0.0)[0]:
            if os.read(self._file, 1) in (b"q", b"Q", b""):
                return True
        return False


class Interruptions:
    """Handlers of signals that never run while the terminal is being written to.

    They write to it as well, and a write in a write raises.
    """

    def __init__(self) -> None:
        self._writes = False
        self._due: list[Callable[[], None]] = []

    def handler(self, act: Callable[[], None]) -> Callable[..., None]:
        """Return a handler that acts at once, or after the present `writing`."""

        def handle(*_: object) -> None:
            if self._writes:
                self._due.append(act)
            else:
                act()

        return handle

    @contextlib.contextmanager
    def writing(self) -> Iterator[None]:
        """Let what interrupts wait until the end of the block."""
        self._writes = True
        try:
            yield
        finally:
            self._writes = False
            while self._due:
                self._due.pop(0)()


@contextlib.contextmanager
def _giving_back(live: Live, keyboard: _Keyboard) -> Iterator[Interruptions]:
    """Give the terminal back on SIGTERM, and while Ctrl-Z stops this program."""
    interruptions = Interruptions()

    def pause() -> None:
        live.stop()
        keyboard.stop()
        os.kill(os.getpid(), signal.SIGSTOP)
        keyboard.start()
        live.start(refresh=True)

    acts = {signal.SIGTERM: lambda: sys.exit(_TERMINATED), signal.SIGTSTP: pause}
    before = {
        number: signal.signal(number, interruptions.handler(act)) for number, act in acts.items()
    }
    keyboard.start()
    try:
        yield interruptions
    finally:
        keyboard.stop()
        for number, handler in before.items():
            signal.signal(number, handler)
