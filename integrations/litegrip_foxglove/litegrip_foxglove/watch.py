"""One gripper as Foxglove sees it: connected, and connected again, until it is cancelled."""

from __future__ import annotations

import asyncio
import math
import sys
import time
from collections.abc import Coroutine
from typing import Any

from foxglove import Channel, Context, StatusLevel
from foxglove.websocket import WebSocketServer

from litegrip_client import LiteGripError
from litegrip_client.aio import LiteGrip
from litegrip_client.values.foxglove import EVENT, JOINTS, TICK, Topic, log_of
from litegrip_foxglove.messages import Scale, joints_message, tick_of

MOST_AGE_S = 0.1
"""Older figures of the motor are not shown as those of now."""
RETRY_S = 1.0


class Watch:
    """A gripper's three topics."""

    def __init__(
        self, gripper: LiteGrip, hz: float, context: Context, server: WebSocketServer
    ) -> None:
        self._gripper = gripper
        self._hz = hz
        self._server = server
        self._scale: Scale | None = None
        self._shown_s = -math.inf
        self._away = ""

        def channel(topic: Topic) -> Channel:
            return Channel(topic.name(gripper.channel), schema=dict(topic.schema), context=context)

        self._ticks, self._events, self._joints = map(channel, (TICK, EVENT, JOINTS))

    async def run(self) -> None:
        """Show the gripper for as long as its daemon answers, and try again when it does not."""
        while True:
            try:
                async with self._gripper:
                    self._scale = Scale.from_info(await self._gripper.info())
                    self._say("")
                    await _until_one_ends(self._show_states(), self._show_events())
            except LiteGripError as error:
                self._say(error.message)
            await asyncio.sleep(RETRY_S)

    def _say(self, away: str) -> None:
        """Tell viewers, and who started the program, that no daemon answers, or one again."""
        name = self._gripper.channel
        if away and not self._away:
            self._server.publish_status(f"{name}: {away}", StatusLevel.Warning, name)
            sys.stderr.write(f"litegrip-foxglove: {name}: {away}; trying again\n")
        elif self._away and not away:
            self._server.remove_status([name])
            sys.stderr.write(f"litegrip-foxglove: {name}: the daemon answers again\n")
        self._away = away

    async def _show_states(self) -> None:
        """Show each new state; of the motor's figures only fresh ones, and each once."""
        async with self._gripper.latest(self._hz) as latest:
            while True:
                state = await latest.wait_newer()
                now_ns, feedback_age_s = time.time_ns(), latest.feedback_age_s
                is_fresh = (
                    not state.stale
                    and state.feedback_s is not None
                    and feedback_age_s is not None
                    and feedback_age_s <= MOST_AGE_S
                )
                if latest.age_s <= MOST_AGE_S:
                    at_ns = now_ns - round(latest.age_s * 1e9)
                    self._ticks.log(tick_of(state, self._scale, is_fresh=is_fresh), log_time=at_ns)
                if is_fresh and feedback_age_s is not None and state.feedback_s != self._shown_s:
                    self._shown_s = state.feedback_s or 0.0
                    at_ns = now_ns - round(feedback_age_s * 1e9)
                    self._joints.log(joints_message(state, self._scale, at_ns), log_time=at_ns)

    async def _show_events(self) -> None:
        async with self._gripper.events() as events:
            async for event in events:
                if event.kind == "calibration":
                    self._scale = Scale.from_info(await self._gripper.info())
                now_ns = time.time_ns()
                message = log_of(
                    now_ns,
                    number=event.seq,
                    at_s=event.monotonic_s,
                    kind=event.kind,
                    message=event.message,
                    data=event.data,
                )
                self._events.log(message, log_time=now_ns)


async def _until_one_ends(*coroutines: Coroutine[Any, Any, None]) -> None:
    """Run all until one of them ends, and cancel the others; raises what that one did."""
    tasks = [asyncio.ensure_future(one) for one in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
