"""A gripper that holds an object by force, what may happen to it, and what clients see."""

from collections.abc import Callable
from itertools import product
from typing import Any

import pytest

from bench.jaws.hand import Hand
from litegripd.sim.plant import MOUNTS
from tests.properties import NIGHTLY, chosen
from tests.world import Client, World

RATES_HZ = (100, 200, 1000)
every_mount = pytest.mark.parametrize("mount", MOUNTS)
every_setting = pytest.mark.parametrize(
    ("rate_hz", "mount"),
    list(product(RATES_HZ, MOUNTS))
    if chosen() == NIGHTLY
    else [(100, "reverse"), (200, "normal"), (200, "reverse"), (1000, "normal")],
)
"""Each rate, and at the usual one both mounts: a mount turns signs, whatever the rate. At night
each rate has both.
"""
WIDTH_MM = 50.0
BACK_SHARE = 0.8
BACK_S = 0.5

Happen = Callable[["Held"], None]


class Held(World):
    """Holds an object of `WIDTH_MM`, after the force has been ramped; a `hand` may have the jaws.

    `figures` are the simulator's that differ from its defaults.
    """

    def __init__(
        self,
        force_n: float,
        mount: str = "normal",
        rate_hz: int = 200,
        *,
        far_mm: float = 20.0,
        figures: dict[str, Any] | None = None,
        **grasp: Any,
    ) -> None:
        opening_mm = WIDTH_MM + far_mm
        super().__init__(
            mount, period_s=1.0 / rate_hz, initial_opening_mm=opening_mm, **(figures or {})
        )
        self.hand: Hand | None = None
        self._moved_until_s = self.now_s
        self.gripper.put_object(width_mm=WIDTH_MM)
        self.owner: Client = self.enabled()
        self.watcher: Client = self.client()
        self.watcher.result("events.subscribe")
        self.grasp_result = self.owner.result(
            "motion.grasp", force_n=force_n, until="verdict", **grasp
        )
        self.run(abs(force_n - 10.0) / 20.0 + 0.5)

    def advance(self) -> None:
        if self.hand is not None:
            self.hand.advance(self._moved_until_s, self.now_s)
        super().advance()
        self._moved_until_s = self.now_s

    @property
    def clamp_n(self) -> float:
        """What the object truly feels."""
        return 10.0 * self.gripper.clamp_nm

    def events(self, kind: str) -> list[dict[str, Any]]:
        """Return the events of a kind so far."""
        return self.watcher.events(kind)

    def moved_mm(self) -> list[float]:
        """Return by how much the object moved, each time that it was reported."""
        return [event["data"]["moved_mm"] for event in self.events("object_moved")]

    def least_clamp_n(self, duration_s: float) -> float:
        """Let time pass; return the least that the object felt meanwhile."""
        return min(self.clamp_n, *self.track(duration_s, lambda: self.clamp_n))


def push(torque_nm: float, lasts_s: float) -> Happen:
    """Let a hand push the jaws open for a while."""

    def happen(held: Held) -> None:
        held.gripper.push(-held.gripper.parameters.close_sign * torque_nm)
        held.run(lasts_s)
        held.gripper.push(0.0)

    return happen


def opened(open_mm: float, lasts_s: float) -> Happen:
    """Let a hand open the jaws so far for a while."""

    def happen(held: Held) -> None:
        held.hand = Hand(held.gripper, open_mm, held.now_s, lasts_s)
        held.run(lasts_s)

    return happen


def gives_way(way_mm: float) -> Happen:
    """Let the object give way at once."""
    return lambda held: held.gripper.give_way(way_mm)


def kept(held: Held, happen: Happen) -> None:
    """Let something happen; the object is held on, and soon as hard as before."""
    before_n = held.clamp_n
    happen(held)
    assert held.state.is_grasped
    held.run(BACK_S)
    assert held.least_clamp_n(0.5) > BACK_SHARE * before_n
    assert held.state.is_grasped
    assert held.events("object_lost") == []
