"""A leader in a hand and a follower with something in its jaws, and a network with a delay."""

import struct
from dataclasses import dataclass, field

from litegripd.app.build import build_service
from tests.control.teleop_scene import MM_RAD, OBJECT_MM, Pair, TeleopWorld
from tests.world import PERIOD_S, FixedFacts

FORCE = struct.Struct(">8sQ3d")


def force_frame(
    force_n: float, at_s: float, echo_s: float, sender: int = 7, magic: bytes = b"LGFORCE1"
) -> bytes:
    """Make a force frame as the page on teleoperation describes it."""
    return FORCE.pack(magic, sender, force_n, at_s, echo_s)


class Hand:
    """A spring with damping between the leader's jaws and where the hand wants them.

    With `stiffness_nm_mm` 0 it has let go.
    """

    def __init__(self, world: TeleopWorld, stiffness_nm_mm: float = 0.06) -> None:
        self.world = world
        self.wanted_mm = world.gripper.opening_mm
        self.stiffness_nm_mm = stiffness_nm_mm
        self.push_nm = 0.0
        """With what it pushes, opening positive."""

    def push(self) -> None:
        gripper = self.world.gripper
        opening = -gripper.parameters.close_sign
        speed_mm_s = opening * gripper.velocity_rad_s * MM_RAD
        self.push_nm = self.stiffness_nm_mm * (self.wanted_mm - gripper.opening_mm)
        self.push_nm -= 0.0133 * self.stiffness_nm_mm * speed_mm_s
        gripper.push(opening * self.push_nm)


@dataclass
class FeltPair(Pair):
    """A pair whose leader is in a hand."""

    hand: Hand = field(init=False)

    def tick(self) -> None:
        self.hand.push()
        super().tick()

    def move(self, duration_s: float, to_mm: float | None = None) -> list[float]:
        """Let time pass while the hand goes to `to_mm`; return the leader's torques."""
        ticks, from_mm = round(duration_s / PERIOD_S), self.hand.wanted_mm
        torques = []
        for tick in range(ticks):
            if to_mm is not None:
                self.hand.wanted_mm = from_mm + (to_mm - from_mm) * (tick + 1) / ticks
            self.tick()
            torques.append(self.commanded_nm)
        return torques

    @property
    def commanded_nm(self) -> float:
        """The torque that the leader's motor gets, opening positive."""
        return -self.leader.gripper.parameters.close_sign * self.leader.wanted.torque_nm


def pair(
    reflect_n: float = 5.0,
    *,
    delay_s: float = 0.0,
    mounts: tuple[str, str] = ("normal", "normal"),
    object_mm: float | None = OBJECT_MM,
    reflect: bool = True,
    gain: float | None = None,
    **follows: object,
) -> FeltPair:
    """Return a pair that has aligned, half open."""
    leader, follower = (TeleopWorld(mount) for mount in mounts)
    follower.service = build_service(
        follower.controller, FixedFacts(), PERIOD_S, epoch="00ff", links=follower.wires
    )
    if object_mm is not None:
        follower.gripper.put_object(width_mm=object_mm)
    leading, following = leader.enabled(), follower.enabled()
    more = {} if gain is None else {"reflect_gain": gain}
    leading.result("teleop.start", mode="master", reflect_n=reflect_n, **more)
    following.result("teleop.start", mode="slave", host="l", reflect=reflect, **follows)
    both = FeltPair(leader, follower, leading, following, delay_s=delay_s)
    both.hand = Hand(leader)
    both.run(0.5)
    assert both.follows["phase"] == "following"
    return both
