"""A daemon and a node for all tests, and more of both for a test that ends them.

Each test that meets a gripper runs twice: at the daemon's socket, and through a fleet's portal.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest
from processes import (
    LEFT,
    RIGHT,
    SHARED,
    Daemon,
    Gripper,
    NodeProcess,
    Place,
    Ros,
    context,
    here,
    through_a_portal,
)


@pytest.fixture(scope="session")
def ros() -> Iterator[Ros]:
    with context() as made:
        yield made


@pytest.fixture(scope="session", params=[here, through_a_portal], ids=["here", "portal"])
def place(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Place]:
    with request.param(tmp_path_factory.mktemp("place")) as made:
        yield made


@pytest.fixture(scope="session")
def shared(
    place: Place, tmp_path_factory: pytest.TempPathFactory
) -> Iterator[tuple[Daemon, NodeProcess]]:
    folder = tmp_path_factory.mktemp("shared")
    daemon = Daemon(place, folder / "daemon", SHARED)
    node = NodeProcess(folder / "node.log", daemon, "/shared")
    yield daemon, node
    code = node.end()
    daemon.end()
    assert code == 0, node.log.read_text()


@pytest.fixture
def daemon(shared: tuple[Daemon, NodeProcess]) -> Daemon:
    return shared[0]


@pytest.fixture
def gripper(shared: tuple[Daemon, NodeProcess], ros: Ros) -> Iterator[Gripper]:
    """The shared gripper: enabled, 60 mm open, nothing between the jaws."""
    daemon, node = shared
    made = ros.gripper(node)
    daemon.reset()
    made.new_state()
    assert made.call("clear").success
    assert made.call("enable").success
    status, _ = made.go(0.06)
    assert status == 4
    yield made
    made.close()


@pytest.fixture
def start(
    place: Place, tmp_path: Path, ros: Ros
) -> Iterator[Callable[..., tuple[Daemon, Gripper]]]:
    """Start a daemon and a node for this test alone; arguments are parameters of the node.

    With `is_late` the daemon has gone when the node begins.
    """
    running: list[tuple[Daemon, NodeProcess, Gripper]] = []

    def begin(
        namespace: str = "/own",
        *,
        is_calibrated: bool = True,
        is_late: bool = False,
        names: tuple[str, ...] = (),
        **parameters: Any,
    ) -> tuple[Daemon, Gripper]:
        name = (LEFT, RIGHT)[len(running)]
        daemon = Daemon(place, tmp_path / name, name, is_calibrated=is_calibrated)
        if is_late:
            daemon.kill()
        node = NodeProcess(tmp_path / f"{name}.log", daemon, namespace, **parameters)
        gripper = ros.gripper(node, names)
        running.append((daemon, node, gripper))
        return daemon, gripper

    yield begin
    for daemon, node, gripper in running:
        gripper.close()
        code = node.end()
        daemon.end()
        assert code == 0, node.log.read_text()
