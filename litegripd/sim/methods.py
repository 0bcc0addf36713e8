"""The methods by which a client changes the world of a simulated gripper: object, hand, faults.

Only a daemon that simulates its gripper has them. They act at once, beside any motion: what happens
to the jaws is the motor's and the daemon's business, as in life.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Protocol, TypedDict

from litegripd.model.errors import Refusal
from litegripd.model.motor import Status, is_fault, status_name
from litegripd.model.sentence import parameter_name, sentence
from litegripd.rpc.method import Answer, Call, Method, Param

if TYPE_CHECKING:  # the plant takes time to import, and most daemons have none
    from litegripd.sim.gripper import SimulatedGripper


class GripperOf(Protocol):
    """Finds the simulated gripper."""

    def __call__(self) -> "SimulatedGripper | None":
        """Return it; None while its bus is not open."""


FAULTS: Mapping[str, int] = {
    status.name.lower(): int(status) for status in Status if is_fault(status)
}
SILENT, WEAK, NO_FAULT = "silent", "weak", "none"
WEAK_SHARE = 0.15
RATED_SUPPLY_V = 24.0
SLIPS_FROM_NM = 0.3
"""An object that slips does so while it is pressed with more than this."""


class SimulatedObject(TypedDict):
    """What is between the jaws."""

    width_mm: float
    stiffness_nm_rad: float
    slip_mm_s: float


class SimulatedWorld(TypedDict):
    """The world of the simulated gripper, as it really is; the state is what the motor reports."""

    object: SimulatedObject | None
    opening_mm: float
    clamp_nm: float
    push_nm: float
    held: bool
    powered: bool
    fault: str | None
    made_share: float
    coil_c: float
    watchdog_s: float


class SimulatedScene(TypedDict):
    """Where the bodies of MuJoCo's scene are, to draw them."""

    file: str
    time_s: float
    qpos: list[float]


class SimMethods:
    """The simulator's methods."""

    NOT_CARRIED = ("_gripper_of", "_why_down")

    def __init__(self, gripper_of: GripperOf, why_down: Callable[[], Refusal | None]) -> None:
        self._gripper_of = gripper_of
        self._why_down = why_down

    @Method(
        "sim.get",
        "Describe the world of the simulated gripper.",
        "The object between the jaws, or null; the true opening; the torque that the object feels;"
        " the torque of a hand, positive when it closes; whether the jaws are held; whether the"
        " motor has power, the fault that it has latched, if any, and which share of its torque it"
        " makes; its coil's temperature; after how long without a command it disarms.",
        SimulatedWorld,
    )
    def _get(self, _call: Call) -> Answer:
        return self._do(lambda _gripper: None)

    @Method(
        "sim.scene",
        "Return where the bodies of MuJoCo's scene are, to draw them.",
        "The scene's file; its time; and its qpos, the positions of all joints as MuJoCo orders"
        " them. Refused where the simulator's own mechanics are at work, which have no bodies.",
        SimulatedScene,
    )
    def _scene(self, _call: Call) -> Answer:
        return self._answer(scene_of)

    @Method(
        "sim.object",
        "Put an object between the jaws, in place of any other; without a width, take it away.",
        "The world.",
        SimulatedWorld,
        (
            Param(
                "width_mm",
                "number",
                "Its width; the jaws must be wider.",
                minimum=0.1,
                maximum=200.0,
            ),
            Param(
                "stiffness_nm_rad",
                "number",
                "Its stiffness, as torque at the motor (default: 250, which is rigid; foam: 10).",
                minimum=1.0,
                maximum=5000.0,
            ),
            Param(
                "slip_mm_s",
                "number",
                f"How fast it gives way while it is pressed with more than {SLIPS_FROM_NM} N·m"
                " (default: 0).",
                minimum=0.0,
                maximum=100.0,
            ),
        ),
        role="admin",
    )
    def _object(self, call: Call) -> Answer:
        params = dict(call.params)
        width_mm = params.get("width_mm")
        if width_mm is None:
            given = sorted({"stiffness_nm_rad", "slip_mm_s"} & params.keys())
            if given:
                text = sentence(
                    "{name} belongs to an object: give its {.width_mm}, too",
                    name=parameter_name(given[0]),
                )
                return Refusal("invalid_params", text, {"parameter": given[0]})
            return self._do(lambda gripper: gripper.remove_object())
        return self._do(
            lambda gripper: gripper.put_object(
                width_mm=width_mm,
                stiffness_nm_rad=params.get("stiffness_nm_rad", 250.0),
                yield_mm_s=params.get("slip_mm_s", 0.0),
                yield_torque_nm=SLIPS_FROM_NM,
            )
        )

    @Method(
        "sim.push",
        "Push the jaws by a hand, until the next call.",
        "The world.",
        SimulatedWorld,
        (
            Param(
                "torque_nm",
                "number",
                "Torque at the motor: positive closes, negative opens, 0 lets go.",
                required=True,
                minimum=-10.0,
                maximum=10.0,
            ),
            Param(
                "damping_nm_s_rad",
                "number",
                "The hand's own damping: the faster the jaws yield, the less it pushes. It leads"
                " free jaws at torque_nm / damping_nm_s_rad (default: 0).",
                minimum=0.0,
                maximum=10.0,
            ),
        ),
        role="admin",
    )
    def _push(self, call: Call) -> Answer:
        closing_nm = float(call.params["torque_nm"])
        damping_nm_s_rad = float(call.params.get("damping_nm_s_rad", 0.0))

        def push(gripper: "SimulatedGripper") -> None:
            gripper.free()
            gripper.push(closing_nm * gripper.parameters.close_sign, damping_nm_s_rad)

        return self._do(push)

    @Method(
        "sim.hold",
        "Hold the jaws fast where they are, whatever pushes them, until sim.push or sim.reset.",
        "The world.",
        SimulatedWorld,
        role="admin",
    )
    def _hold(self, _call: Call) -> Answer:
        return self._do(lambda gripper: gripper.jam())

    @Method(
        "sim.fault",
        "Let the motor latch a fault, which motor.clear_fault ends; or let it lose its power, or"
        " most of its torque, until none, or sim.reset.",
        "The world.",
        SimulatedWorld,
        (
            Param(
                "name",
                "string",
                f"The fault; {SILENT}: no power, so the motor answers nothing; {WEAK}: it makes"
                f" {WEAK_SHARE:.0%} of the commanded torque; {NO_FAULT}: power and torque are back,"
                " and a motor that had a fault, or no power, is switched off and on.",
                required=True,
                choices=(*FAULTS, SILENT, WEAK, NO_FAULT),
            ),
        ),
        role="admin",
    )
    def _fault(self, call: Call) -> Answer:
        name = str(call.params["name"])
        if name == SILENT:
            return self._do(lambda gripper: gripper.power_off())
        if name == WEAK:
            return self._do(lambda gripper: gripper.weaken(WEAK_SHARE))
        if name == NO_FAULT:
            return self._do(_mend)
        return self._do(lambda gripper: gripper.latch_fault(FAULTS[name]))

    @Method(
        "sim.heat",
        "Let the motor's coil have a temperature; it then cools as ever.",
        "The world.",
        SimulatedWorld,
        (
            Param(
                "coil_c",
                "number",
                "Temperature of the coil in °C.",
                required=True,
                minimum=-50.0,
                maximum=300.0,
            ),
        ),
        role="admin",
    )
    def _heat(self, call: Call) -> Answer:
        return self._do(lambda gripper: gripper.heat_coil(float(call.params["coil_c"])))

    @Method(
        "sim.reset",
        "Take the object and the hand away, cool the coil, and give power and torque; a motor with"
        " a fault, or without power, is switched off and on, so it is disabled then.",
        "The world.",
        SimulatedWorld,
        role="admin",
    )
    def _reset(self, _call: Call) -> Answer:
        return self._do(_reset)

    def _do(self, change: "Callable[[SimulatedGripper], None]") -> Answer:
        """Change the world and return it, or a refusal that says why it cannot be."""

        def changed(gripper: "SimulatedGripper") -> dict[str, Any]:
            change(gripper)
            return world_of(gripper)

        return self._answer(changed)

    def _answer(self, told: "Callable[[SimulatedGripper], dict[str, Any]]") -> Answer:
        gripper = self._gripper_of()
        if gripper is None:
            return self._why_down() or Refusal("bus_down", "the simulated bus is not open")
        try:
            return told(gripper)
        except ValueError as error:
            return Refusal("out_of_limits", str(error))


def scene_of(gripper: "SimulatedGripper") -> dict[str, Any]:
    """Return the scene around a gripper as it travels; raises `ValueError` without one."""
    found = gripper.scene()
    scene: SimulatedScene = {
        "file": str(found.file),
        "time_s": found.time_s,
        "qpos": found.qpos,
    }
    return dict(scene)


def world_of(gripper: "SimulatedGripper") -> dict[str, Any]:
    """Return the world of a gripper as it travels."""
    item, status = gripper.gripped_object, gripper.motor.status
    world: SimulatedWorld = {
        "object": None
        if item is None
        else {
            "width_mm": item.width_mm,
            "stiffness_nm_rad": item.stiffness_nm_rad,
            "slip_mm_s": item.yield_mm_s,
        },
        "opening_mm": gripper.opening_mm,
        "clamp_nm": gripper.clamp_nm,
        "push_nm": gripper.hand_nm,
        "held": gripper.is_held,
        "powered": gripper.motor.is_powered,
        "fault": status_name(status) if is_fault(status) else None,
        "made_share": gripper.made_share,
        "coil_c": gripper.motor.coil_c,
        "watchdog_s": gripper.motor.disarms_after_s,
    }
    return dict(world)


def _reset(gripper: "SimulatedGripper") -> None:
    gripper.free()
    gripper.push(0.0)
    gripper.remove_object()
    gripper.heat_coil(gripper.parameters.ambient_c)
    _mend(gripper)


def _mend(gripper: "SimulatedGripper") -> None:
    gripper.weaken(1.0)
    gripper.set_supply(RATED_SUPPLY_V)
    if not gripper.motor.is_powered or is_fault(gripper.motor.status):
        gripper.power_cycle()
