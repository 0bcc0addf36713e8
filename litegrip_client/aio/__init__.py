"""Drive a LiteGrip gripper through its daemon, on asyncio.

    import asyncio
    import litegrip_client.aio

    async def main():
        async with litegrip_client.aio.LiteGrip("can0") as gripper:
            await gripper.enable()
            await gripper.grasp(force_n=10, until="verdict")
            async for state in gripper.states(hz=50):
                ...

    asyncio.run(main())

`LiteGrip` offers what `litegrip_client.LiteGrip` does, by the same names, with the same arguments,
results and exceptions, which are all described there. What asks the daemon is awaited; blocks and
iterations are `async with` and `async for`; and what is a property there but asks the daemon is a
method here: `await gripper.mount()`, `await gripper.config()`.

Any number of tasks may share one object, but only of one event loop. A task that is cancelled while
it waits for a motion, also by a timeout, cancels the motion before it ends.
"""

from litegrip_client.aio.gripper import EventSubscription, Latest, LiteGrip, Subscription
from litegrip_client.core.actions import GripperActions
from litegrip_client.core.calibrations import ManualCalibration
from litegrip_client.core.motion import SetpointStream
from litegrip_client.core.session import Lease

__all__ = [
    "EventSubscription",
    "GripperActions",
    "Latest",
    "Lease",
    "LiteGrip",
    "ManualCalibration",
    "SetpointStream",
    "Subscription",
]
