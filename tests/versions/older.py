"""Daemons of other versions, made of this one in virtual time: what one lacks, or has besides.

What can be missing is what the daemon's own tables have, so that a later addition is tried as well.
"""

import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import pytest

from litegrip_client import LiteGrip
from litegripd.app.build import BY_NAME
from litegripd.model import motion_config
from litegripd.model.state import HelperTask, TaskResult
from litegripd.rpc.method import CONFIG, Method, Param
from tests.drop_in import Daemon, RealDisk, Site, VirtualStream, a_site
from tests.versions.steps import STEPS, ready

Requests = list[tuple[str, Mapping[str, Any]]]
Change = Callable[[dict[str, Any]], Iterable[dict[str, Any]]]
"""Makes of a message of the daemon's those that come in its place."""


class Lack(NamedTuple):
    """A method, one of its parameters, or a value that this may have."""

    method: str
    parameter: str | None = None
    value: str | None = None

    def __str__(self) -> str:
        return " ".join(filter(None, self))


CONFIG_FIELDS = tuple(motion_config._RANGES)


def values_of(param: Param) -> tuple[str, ...]:
    """Return what a parameter may name."""
    return CONFIG_FIELDS if param.name == CONFIG.name else param.choices


def lacks_of(row: Method) -> Iterator[Lack]:
    """Give all that a daemon may lack of a method."""
    yield Lack(row.name)
    for name, param in row.declared.items():
        yield Lack(row.name, name)
        yield from (Lack(row.name, name, value) for value in values_of(param))


def needed(requests: Requests) -> Iterator[Lack]:
    """Give the methods and parameters without which a daemon refuses some of the requests."""
    for method, params in requests:
        yield Lack(method)
        yield from (Lack(method, parameter) for parameter in params)


@contextmanager
def lacking(daemon: Daemon, lack: Lack) -> Iterator[None]:
    """Let a daemon be without something."""
    with pytest.MonkeyPatch.context() as patch:
        methods, row = daemon.service._methods, BY_NAME[lack.method]
        if lack.parameter is None:
            patch.delitem(methods, row.name)
            if row.name == "state.get":  # it is answered before its name is looked up
                patch.setattr("litegripd.rpc.service.state_asked", lambda _line: None)
        elif lack.parameter == CONFIG.name and lack.value is not None:
            patch.delitem(motion_config._RANGES, lack.value)
        else:
            declared = dict(row.declared)
            param = declared.pop(lack.parameter)
            if lack.value is not None:
                others = tuple(one for one in param.choices if one != lack.value)
                declared[param.name] = replace(param, choices=others or ("none of them",))
            older = replace(row)
            object.__setattr__(older, "declared", declared)
            patch.setitem(methods, row.name, older)
        yield


class WholeDisk(RealDisk):
    """Real files, but for dumps: these read what the recorder has written."""

    def do(self, task: HelperTask) -> TaskResult:
        return TaskResult(self._dump()) if task.operation == "recorder.dump" else super().do(task)


@dataclass
class Scene:
    """A daemon of some version and the client of this one, connected and enabled."""

    site: Site
    daemon: Daemon
    gripper: LiteGrip
    requests: Requests = field(default_factory=list)

    @property
    def connection(self) -> Any:
        return self.gripper._session.connection


class OtherStream(VirtualStream):
    """Notes what the client sends, and changes what the daemon answers."""

    peer_pid = os.getpid()

    def __init__(self, site: Site, daemon: Daemon, requests: Requests, change: Change) -> None:
        super().__init__(site, daemon)
        self._requests = requests
        self._change = change

    def send(self, line: bytes, timeout_s: float) -> None:
        for one in line.splitlines():
            request = json.loads(one)
            self._requests.append((request["method"], request.get("params", {})))
        super().send(line, timeout_s)

    def _take(self) -> bool:
        outgoing = self._session.outgoing
        lines = [line for sent in outgoing for line in sent.splitlines()]
        outgoing[:] = [
            json.dumps(message).encode() + b"\n"
            for line in lines
            for message in self._change(json.loads(line))
        ]
        return super()._take()


def as_it_is(message: dict[str, Any]) -> Iterable[dict[str, Any]]:
    """Change nothing."""
    return (message,)


@contextmanager
def a_scene(home: Path, change: Change = as_it_is) -> Iterator[Scene]:
    """Give a daemon whose messages come changed, and a client that has enabled its gripper."""
    home.mkdir(exist_ok=True)
    with a_site(home, {"LITEGRIP_TRAJ_DIR": str(home / "own")}) as site:
        daemon = Daemon()
        disk = WholeDisk()
        disk.memory, daemon.disk = daemon.disk.memory, disk
        daemon.recorder = daemon.make_recorder()
        site.add(daemon)
        requests: Requests = []

        def open_stream(path: str, _timeout_s: float) -> OtherStream:
            site.open_stream(path, _timeout_s).close()  # for its error where there is none
            return OtherStream(site, daemon, requests, change)

        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("litegrip_client.line.connection.LineStream", open_stream)
            gripper = LiteGrip("can0")
            gripper.connect()
            assert gripper.enable()
            yield Scene(site, daemon, gripper, requests)
            gripper.disconnect()


@cache
def sent_by_steps() -> dict[str, Requests]:
    """Return what the client sends in each step at a daemon of its own version."""
    sent: dict[str, Requests] = {}
    with TemporaryDirectory() as folder, a_scene(Path(folder) / "home") as scene:
        for name, step in STEPS.items():
            ready(scene.gripper)
            scene.requests.clear()
            step(scene.gripper)
            sent[name] = list(scene.requests)
    return sent
