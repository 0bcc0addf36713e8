"""The client on asyncio has the names and parameters of the one for threads."""

import inspect
from typing import Any

import pytest

import litegrip_client
from litegrip_client import aio
from litegrip_client.aio import LiteGrip
from litegrip_client.line.feeds import EventSubscription, Subscription
from litegrip_client.line.latest import Latest
from litegrip_client.threads.actions import BlockingGripper, Lease
from litegrip_client.threads.sdk_gripper import SdkGripper

METHODS_HERE = {"config", "mount"}
"""Properties of the other client that ask the daemon."""


def public(kind: type) -> set[str]:
    return {name for name in dir(kind) if not name.startswith("_")}


def parameters(function: Any) -> list[tuple[str, Any, Any, str]]:
    return [
        (one.name, one.kind, one.default, one.annotation)
        for one in inspect.signature(function).parameters.values()
    ]


def test_names_and_parameters_are_those_of_the_other_client() -> None:
    only_in_threads = public(SdkGripper) - public(BlockingGripper)
    assert public(LiteGrip) == public(litegrip_client.LiteGrip) - only_in_threads
    for name in public(LiteGrip):
        here = inspect.getattr_static(LiteGrip, name)
        there = inspect.getattr_static(litegrip_client.LiteGrip, name)
        if name in METHODS_HERE:
            assert inspect.iscoroutinefunction(here)
            assert isinstance(there, property)
        else:
            assert type(here) is type(there), name
        if inspect.isfunction(here) and inspect.isfunction(there):
            assert parameters(here) == parameters(there), name
    assert [one[:3] for one in parameters(LiteGrip.__init__)] == [
        one[:3] for one in parameters(litegrip_client.LiteGrip.__init__)
    ]


@pytest.mark.parametrize(
    ("here", "there"),
    [
        (aio.ManualCalibration, litegrip_client.ManualCalibration),
        (aio.SetpointStream, litegrip_client.SetpointStream),
        (aio.Lease, Lease),
        (aio.Subscription, Subscription),
        (aio.Latest, Latest),
        (aio.EventSubscription, EventSubscription),
    ],
)
def test_what_comes_with_a_block_has_the_same_names(here: type, there: type) -> None:
    assert public(here) == public(there)
    for one in public(here):
        if inspect.isfunction(getattr(here, one)):
            assert parameters(getattr(here, one)) == parameters(getattr(there, one))
