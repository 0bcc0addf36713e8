"""Every method while a stop is latched: called by every role, with parameters up to their ends.

Nothing that is asked, loaded, set or configured under a stop moves the jaws, whether they hold a
position, press on a stop or hold an object. `run_stopped` measures it at the gripper's own jaws.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from litegripd.app.build import METHODS
from litegripd.model.gripper import DM4310
from litegripd.model.motion_config import MotionConfig, ranges_of
from litegripd.rpc.method import Method, Param
from litegripd.rpc.sessions import ROLES, Role
from tests.trajectories import lgt, pieces
from tests.world import Client, World

Values = dict[str, Any]

RELEASING: Mapping[str, str] = {
    "motor.disable": "lets go, as it says",
    "stop with level relax or disable": "raises the stop to one that lets go",
    "lease.take with jaws relax or disable": "says that the jaws are to be let go",
    "the loss of a lease with on_lost relax or disable": "does what its holder has asked for",
}
"""What lets the jaws go by design, and so is left out."""

LOOKED_AT_S, AFTER_S = 0.05, 0.5
"""How long the jaws are looked at after each call, and once more after the last one."""
STILL_RAD, STILL_NM = 0.0005, 0.02
"""What rounds to 0.000 rad, 0.03 mm; and two steps of the motor's own torque measurement."""

LIMITS: Values = {"zero_position_rad": 0.0, "max_position_rad": -1.651026, "rad_to_mm": 52.69}
_TAUGHT = pieces(lgt([(0.0, 0.3), (0.3, 0.5), (0.6, 0.2)]))[0]


def _contents() -> Iterator[Values]:
    """Files with gains from end to end, other limits, another mount, another scale, or no use."""
    for gains in ((1.0, 0.01), (5.0, 5.0), (5.0, 2.0), (100.0, 2.0), (500.0, 1.0), (500.0, 5.0)):
        yield {**LIMITS, "kp": gains[0], "kd": gains[1]}
    yield {**LIMITS, "zero_position_rad": -0.3, "max_position_rad": -1.951026}
    yield {**LIMITS, "zero_position_rad": 0.3, "max_position_rad": -1.351026}
    yield {**LIMITS, "zero_position_rad": -5.0, "max_position_rad": -6.651026}
    yield {**LIMITS, "zero_position_rad": -1.651026, "max_position_rad": 0.0}
    yield {**LIMITS, "rad_to_mm": 46.0, "nm_to_n": 5.0}
    yield {**LIMITS, "rad_to_mm": 58.0, "nm_to_n": 30.0, "work_stroke_mm": 20.0}
    yield {**LIMITS, "calibrated": False}


def _configs() -> Iterator[Values]:
    """Each field at both of its ends, as far as it goes with the others."""
    usual = MotionConfig().as_fields(0.0)
    for name, ends in ranges_of(DM4310).items():
        for end in ends:
            value = int(end) if isinstance(usual[name], int) else end
            others = {"max_lead_mm": value} if name == "stop_lead_mm" else {}
            others |= {"stop_lead_mm": value} if name == "max_lead_mm" else {}
            yield {**others, name: value}


def _own_calibrations() -> Iterator[Values]:
    """Limits and gains that a request brings for itself: those of files, and nothing else."""
    files_alone = ("calibrated", "nm_to_n")
    for content in _contents():
        yield {name: value for name, value in content.items() if name not in files_alone}


_OBJECTS: Mapping[str, Callable[[], Iterator[Values]]] = {
    "config": _configs,
    "content": _contents,
    "calibration": _own_calibrations,
}

_TEXTS: Mapping[str, Sequence[str]] = {
    "register": ("PMAX", "15"),
    "name": ("a", "nothing of that name"),
    "lease": ("no such token",),
    "host": ("127.0.0.1",),
    "bind": ("127.0.0.1",),
}
_NUMBERS: Mapping[str, Sequence[float]] = {
    "opening_mm": (-5.0, 0.0, 40.0, 95.0),
    "position_rad": (-1.6, -0.5, 0.0),
}
"""Of parameters that have no range of their own."""

_NEEDED: Mapping[str, Values] = {
    "motion.move": {"opening_mm": 40.0},
    "stream.set": {"opening_mm": 40.0},
    "trajectory.play": {"name": "a"},
    "trajectory.get": {"name": "a"},
    "trajectory.put": _TAUGHT,
    "trajectory.control": {"action": "speed", "speed": 4.0},
    "motion.grasp": {"width_mm": 50.0, "tolerance_mm": 5.0},
    "teleop.start": {"mode": "slave", "fake_leader": True},
    "daemon.restart": {"hold_through_restart": True},
    "lease.take": {"why": "a test"},
}
"""What a call cannot do without, or what makes it more than a refusal."""
_ONE_OF = (("opening_mm", "position_rad", "openness", "push_nm"),)
_LETS_GO = (("stop", "level"), ("lease.take", "jaws"))


def calls_of(method: Method) -> Iterator[Values]:
    """Give the parameters of the calls: each parameter by itself with a usual value, and its ends.

    What lets go by design is left out, and a lease that would be lost meanwhile.
    """
    base = _NEEDED.get(method.name, {})
    for param in method.params:
        if param.required and param.name not in base:
            base = {**base, param.name: next(_values_of(param))}
    yield base
    for param in method.params:
        for value in _values_of(param):
            if (method.name, param.name) in _LETS_GO and value != "hold":
                continue
            yield {**_without_rivals(base, param.name), param.name: value}
            if param.name == "on_lost":
                break


def _without_rivals(base: Values, name: str) -> Values:
    rivals = [group for group in _ONE_OF if name in group]
    return {key: value for key, value in base.items() if not any(key in row for row in rivals)}


def _values_of(param: Param) -> Iterator[Any]:
    if param.kind == "boolean":
        yield from (True, False)
    elif param.kind == "object":
        yield from _OBJECTS[param.name]()
    elif param.kind == "strings":
        yield list(param.choices)
    elif param.kind == "string":
        yield from param.choices or _TEXTS.get(param.name, ("a test",))
    elif param.name in _NUMBERS:
        yield from _NUMBERS[param.name]
    else:
        low = 1.0 if param.minimum is None else param.minimum
        high = low if param.maximum is None else param.maximum
        whole = param.kind == "integer"
        yield from (int(end) if whole else end for end in (low, high))


@dataclass(frozen=True, slots=True)
class Rest:
    """What enabled jaws do when the stop comes."""

    name: str
    begin: Callable[[World, Client], None]


FORCE_N, OBJECT_MM = 30.0, 50.0
"""More than what the jaws of a gripper without a calibration may press with, 20 N."""


def _holds(world: World, client: Client) -> None:
    assert client.result("motion.move", opening_mm=40)["ok"]


def _presses(world: World, client: Client) -> None:
    assert client.result("motion.close")["outcome"] == "pressed_home"


def _grips(world: World, client: Client) -> None:
    world.gripper.put_object(width_mm=OBJECT_MM)
    grips(world, client)


def grips(world: World, client: Client) -> None:
    """Grasp what has been put between the jaws."""
    result = client.result("motion.grasp", force_n=FORCE_N, until="verdict")
    assert result["outcome"] == "object_held"
    world.run(1.5)


RESTS = (Rest("holding", _holds), Rest("pressing", _presses), Rest("gripping", _grips))


@dataclass(slots=True)
class Stopped:
    """A gripper under a latched stop, and what its jaws have done since."""

    world: World
    place: Callable[[], tuple[float, float]]
    """The true position of the jaws (rad), and the motor's true torque (N·m)."""
    moved_rad: float = 0.0
    changed_nm: float = 0.0

    def begin(self, rest: Callable[[World, Client], None]) -> None:
        """Bring the jaws to rest, and stop."""
        client = self.world.enabled()
        client.result("trajectory.put", name="a", **_TAUGHT)
        rest(self.world, client)
        self.world.run(0.3)
        client.result("stop", why="a hand")
        client.leave()
        self.world.run(0.5)

    def try_out(self, methods: Sequence[Method], roles: Sequence[Role] = ROLES) -> set[str]:
        """Let every role call methods; return what the last one is answered."""
        answers = set[str]()
        from_rad, from_nm = self.place()
        clients = [self.world.client(role=role) for role in roles]
        for method in methods:
            for client in clients:
                for params in calls_of(method):
                    number = client.send(method.name, **params)
                    self._look(LOOKED_AT_S, from_rad, from_nm)
                    if client is clients[-1] and client.has_answer(number):
                        answers.add(_worded(client.answers[number]))
                    self._stay_stopped(clients)
        self._look(AFTER_S, from_rad, from_nm)
        return answers

    def _look(self, duration_s: float, from_rad: float, from_nm: float) -> None:
        for _ in range(round(duration_s / self.world.period_s)):
            self.world.tick()
            here_rad, here_nm = self.place()
            self.moved_rad = max(self.moved_rad, abs(here_rad - from_rad))
            self.changed_nm = max(self.changed_nm, abs(here_nm - from_nm))

    def _stay_stopped(self, clients: Sequence[Client]) -> None:
        """Latch a stop that was cleared; let no lease be in the way of the next call, nor lost."""
        if self.world.controller.stop_latch.latched is None:
            clients[0].send("stop")
        for client in clients:
            client.send("lease.release")


def _worded(answer: Mapping[str, Any]) -> str:
    return f"`{answer['error']['data']['reason']}`" if "error" in answer else "accepted"


CALLED = tuple(method for method in METHODS if method.name not in RELEASING)


def stopped(rest: Rest) -> Stopped:
    """Return a simulated gripper that is at rest, under a stop."""
    world = World()
    scale = world.gripper.parameters.rad_to_mm
    under = Stopped(
        world, lambda: (world.gripper.opening_mm / scale, world.gripper.motor_torque_nm)
    )
    under.begin(rest.begin)
    return under


def run_stopped(method: Method) -> str:
    """Run the calls of a method in every situation; return its row of the page."""
    cells, answers = [], set[str]()
    for rest in RESTS:
        under = stopped(rest)
        answers |= under.try_out([method])
        assert under.changed_nm < STILL_NM, (
            f"{method.name}: {under.changed_nm:.3f} N·m while {rest}"
        )
        cells.append(f"{under.moved_rad:.3f}")
    said = ", ".join(sorted(answers)) or "later"
    return f"| `{method.name}` | {method.role} | {said} | {' | '.join(cells)} |"
