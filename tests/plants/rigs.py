"""One gripper under one daemon, the simulator or another plant: what both kinds have in common."""

from collections.abc import Callable
from typing import Any

from litegripd.sim.gripper import SimulatedGripper
from litegripd.sim.plant import SimulatorParameters
from tests.plants.parameters import MM_RAD, Item, PlantParameters
from tests.plants.world import LOOK_S, Look, PlantWorld
from tests.world import World


class Rig(World):
    """A daemon on some gripper.

    `looks` has what is true in each millisecond, `torque_nm` as the motor believes it.
    """

    looks: list[Look]
    friction_nm: float
    """What may hold standing jaws in the middle of their travel."""
    torque_factor: float
    pull_nm: Callable[[float], float] | None = None
    """With which torque something pulls the jaws together, by their opening in mm."""

    def put(self, item: Item) -> None:
        """Put an object between the jaws."""
        raise NotImplementedError

    def remove(self) -> None:
        """Take it away at once."""
        raise NotImplementedError

    def give_way(self, by_mm: float) -> None:
        """Let the object be thinner at once."""
        raise NotImplementedError

    def hand(self, closing_nm: float) -> None:
        """Let a hand close the jaws with this torque from now on."""
        raise NotImplementedError

    def hold_fast(self, duration_s: float) -> None:
        """Let something hold the jaws where they are, and let go."""
        raise NotImplementedError

    def weaken(self, made_share: float) -> None:
        """Let the motor make, and report, this share of the commanded torque."""
        raise NotImplementedError

    @property
    def true_n(self) -> float:
        """What the object feels, in the daemon's newtons."""
        raise NotImplementedError

    @property
    def speed_rad_s(self) -> float:
        """The motor's true speed, closing positive."""
        raise NotImplementedError

    def speeds_mm_s(self, since_s: float) -> list[float]:
        """Return the motor's speeds since a time, as of jaws that close."""
        return [look.rotor_mm_s for look in self.looks if look.at_s > since_s]


class SimulatedRig(Rig):
    """The simulator of this project; `figures` are those that differ from its usual ones."""

    torque_factor = 1.0

    def __init__(
        self,
        mount: str,
        rate_hz: int,
        opening_mm: float,
        *,
        is_looked_at: bool = True,
        noise_seed: int | None = None,
        **figures: Any,
    ) -> None:
        self._noise_seed = noise_seed
        self.looks = []
        self._looked_s = 1000.0 if is_looked_at else float("inf")
        super().__init__(mount, period_s=1.0 / rate_hz, initial_opening_mm=opening_mm, **figures)
        self.friction_nm = self.gripper.parameters.breakaway_nm
        self._sign = self.gripper.parameters.close_sign

    def make_gripper(self, parameters: SimulatorParameters) -> SimulatedGripper:
        return SimulatedGripper(parameters, seed=self._noise_seed)

    def put(self, item: Item) -> None:
        self.gripper.put_object(
            width_mm=item.width_mm,
            stiffness_nm_rad=item.stiffness_nm_rad,
            damping_nm_s_rad=item.damping_nm_s_rad,
            friction_nm=item.friction_nm,
            yield_mm_s=item.yield_mm_s,
            yield_torque_nm=item.yield_nm,
        )

    def remove(self) -> None:
        self.gripper.remove_object()

    def give_way(self, by_mm: float) -> None:
        self.gripper.give_way(by_mm)

    def hand(self, closing_nm: float) -> None:
        self.gripper.push(self._sign * closing_nm)

    def hold_fast(self, duration_s: float) -> None:
        self.gripper.jam()
        self.run(duration_s)
        self.gripper.free()

    def weaken(self, made_share: float) -> None:
        self.gripper.weaken(made_share)

    @property
    def true_n(self) -> float:
        return 10.0 * self.gripper.clamp_nm

    @property
    def speed_rad_s(self) -> float:
        return self._sign * self.gripper.velocity_rad_s

    def advance(self) -> None:
        gripper = self.gripper
        while self._looked_s + LOOK_S <= self.now_s + 1e-9:
            self._looked_s += LOOK_S
            if self.pull_nm is not None:
                self.hand(self.pull_nm(gripper.opening_mm))
            gripper.advance(self._looked_s)
            speed_mm_s = self.speed_rad_s * MM_RAD
            opening_mm, torque_nm = gripper.opening_mm, self._sign * gripper.motor_torque_nm
            self.looks.append(
                Look(self._looked_s, self.true_n, opening_mm, speed_mm_s, speed_mm_s, torque_nm)
            )
        super().advance()


class PlantRig(PlantWorld, Rig):
    """A gripper that is not the simulator's."""

    def __init__(
        self, parameters: PlantParameters, mount: str, rate_hz: int, opening_mm: float, **more: Any
    ) -> None:
        super().__init__(parameters, mount, rate_hz, opening_mm=opening_mm, **more)
        self.torque_factor = parameters.torque_factor
        self.friction_nm = parameters.breakaway_nm

    def put(self, item: Item) -> None:
        self.mechanics.put(item)

    def remove(self) -> None:
        self.mechanics.put(None)

    def give_way(self, by_mm: float) -> None:
        self.mechanics.give_way(by_mm)

    def hand(self, closing_nm: float) -> None:
        self.mechanics.hand_nm = closing_nm

    def hold_fast(self, duration_s: float) -> None:
        self.mechanics.hold_open(0.01, 1.0)
        self.run(duration_s)
        self.mechanics.let_go()

    def weaken(self, made_share: float) -> None:
        self.mechanics.made_share = made_share

    @property
    def true_n(self) -> float:
        return 10.0 * self.mechanics.clamp_nm

    @property
    def speed_rad_s(self) -> float:
        return self.mechanics.rotor_rad_s

    def _look_until(self, at_s: float) -> None:
        while self.pull_nm is not None and self._next_look_s <= at_s:
            self.hand(self.pull_nm(self.mechanics.opening_mm))
            super()._look_until(self._next_look_s)
        super()._look_until(at_s)
