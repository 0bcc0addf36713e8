"""Count what a reader of the code meets: files, lines, and the files that a request passes through.

python -m tests.structure [--files]

The walks are played in virtual time; a file counts once a function of it is called. With `--files`
they are listed. Lines are lines of source files, comments and empty ones too.
"""

import ast
import statistics
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from types import FrameType
from typing import Any, NamedTuple

from litegrip_client import LiteGrip
from tests.client.fake_daemon import GRASP, FakeDaemon
from tests.world import Client, World

ROOT = Path(__file__).parent.parent
PRODUCT = ("litegripd", "litegrip_client", "litegrip_fleet", "litegrip_web")
GENERATED = (
    "litegrip_client/values/error_table.py",
    "litegrip_client/values/method_table.py",
    "litegrip_client/threads/actions.py",
)


def entered(act: Callable[[], Any]) -> list[str]:
    """Return the product's files of which a function is called by this thread during `act`."""
    files: set[str] = set()

    def note(frame: FrameType, event: str, _argument: Any) -> None:
        if event == "call":
            files.add(frame.f_code.co_filename)

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        act()
    finally:
        sys.setprofile(before)
    places = (Path(name) for name in files if name.startswith(str(ROOT)))
    inside = (str(place.relative_to(ROOT)) for place in places)
    return sorted(name for name in inside if name.partition("/")[0] in PRODUCT)


def walks() -> dict[str, list[str]]:
    """Play each walk; return the files that it enters."""
    world = World()
    client = world.enabled()
    return {
        "state.get": entered(lambda: one_request(client, "state.get")),
        "a grasp request": entered(
            lambda: one_request(client, "motion.grasp", force_n=5, until="verdict")
        ),
        "a tick of a grasp": entered(world.exchange),
        "LiteGrip.grasp()": entered_by_grasp(),
    }


def one_request(client: Client, method: str, **params: Any) -> None:
    """Let the service take one request; what it answers stays unread."""
    client.send(method, **params)


def entered_by_grasp() -> list[str]:
    """Return the client's files that a grasp enters, with a daemon that only answers."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "can0.sock"
        with FakeDaemon(path) as daemon, LiteGrip(socket_path=str(path)) as gripper:
            gripper.enable()
            daemon.handlers["motion.grasp"] = lambda _request: GRASP
            return entered(lambda: gripper.grasp(force_n=5.0, until="verdict"))


def sizes(*folders: str) -> dict[str, int]:
    """Return the lines of each hand-written source file below the folders."""
    paths = (path for folder in folders for path in (ROOT / folder).rglob("*.py"))
    lines = {str(path.relative_to(ROOT)): len(path.read_bytes().splitlines()) for path in paths}
    return {name: count for name, count in lines.items() if name not in GENERATED}


def import_circle() -> list[str]:
    """Return modules of the product that import each other in a circle; empty if there is none.

    Imports inside a function, or for type checking alone, count for nothing.
    """
    paths = (path for folder in PRODUCT for path in (ROOT / folder).rglob("*.py"))
    modules = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in paths
    }
    graph = {
        name: {found for found in imported(path, modules) if found != name}
        for name, path in modules.items()
    }
    try:
        list(TopologicalSorter(graph).static_order())
    except CycleError as error:
        return list(error.args[1])
    return []


def imported(path: Path, modules: dict[str, Path]) -> Iterator[str]:
    """Give the product's modules that a file imports when it is imported."""
    return _targets(ast.parse(path.read_text(encoding="utf-8")).body, modules)


def _targets(statements: Iterable[ast.AST], modules: Mapping[str, Path]) -> Iterator[str]:
    for statement in statements:
        if isinstance(statement, ast.Import):
            yield from (alias.name for alias in statement.names if alias.name in modules)
        elif isinstance(statement, ast.ImportFrom) and statement.module:
            for alias in statement.names:
                inner = f"{statement.module}.{alias.name}"
                name = inner if inner in modules else statement.module
                if name in modules:
                    yield name


class Drawing(NamedTuple):
    """Rooms and what runs between them: `up` are the arrows that lead back to a room above."""

    floors: int
    arrows: int
    up: list[tuple[str, str]]


def drawing(package: str, *, files: bool = False) -> Drawing:
    """Draw the rooms of a package: its folders and its files beside them, or all its `files`.

    An arrow is any import between two of them, also one in a function or for types alone. A room
    is one floor above the highest that it imports; an arrow that closes a circle leads up.
    """
    folder = ROOT / package
    rooms: dict[str, set[str]] = {}
    paths = {
        ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
        for path in folder.rglob("*.py")
    }

    def room(module: str) -> str:
        return module if files or module == package else ".".join(module.split(".")[:2])

    for name, path in paths.items():
        statements = ast.walk(ast.parse(path.read_text(encoding="utf-8")))
        found = {room(other) for other in _targets(statements, paths)} - {room(name)}
        rooms.setdefault(room(name), set()).update(found)
    floors: dict[str, int] = {}
    up: list[tuple[str, str]] = []
    above: list[str] = []

    def floor(name: str) -> int:
        if name not in floors:
            above.append(name)
            lower = [other for other in sorted(rooms[name]) if other not in above]
            up.extend((name, other) for other in sorted(rooms[name]) if other in above)
            floors[name] = 1 + max((floor(other) for other in lower), default=0)
            above.pop()
        return floors[name]

    highest = max(floor(name) for name in sorted(rooms))
    return Drawing(highest, sum(map(len, rooms.values())), up)


def main() -> None:
    """Print all counts."""
    product, tests = sizes(*PRODUCT), sizes("tests")
    modules = {name: count for name, count in product.items() if not name.endswith("__init__.py")}
    lines, test_lines = sum(product.values()), sum(tests.values())
    print(f"modules beside __init__     {len(modules):6}")
    print(f"median lines of a module    {statistics.median(modules.values()):6.0f}")
    print(f"modules of at most 60 lines {sum(count <= 60 for count in modules.values()):6}")
    print(f"lines of the product        {lines:6}")
    print(f"lines of the tests          {test_lines:6}, {test_lines / lines:.2f} for each")
    for package in PRODUCT:
        floors, arrows, up = drawing(package)
        print(f"{package:16} {floors:2} floors, {arrows:3} arrows, {len(up)} of them back up")
    for name, files in walks().items():
        print(f"files entered by {name:18} {len(files):6}")
        if "--files" in sys.argv:
            print(*files, sep="\n", end="\n\n")


if __name__ == "__main__":
    main()
