"""One client of the crowd: does at random what clients do, until it is killed.

python -m bench.crowd.client SOCKET SEED

It ends by itself only when it meets what no client should: a refusal that its requests cannot have
earned, or an answer that does not come.
"""

import random
import sys
import time
from collections.abc import Callable
from typing import Any

from litegrip_client.line.connection import Connection
from litegrip_client.values.errors import ConnectError, LiteGripError

EXPECTED = frozenset(
    {
        *("busy", "too_many_requests", "lease_held", "lease_lost", "cancelled", "replaced"),
        *("stopped", "sent_before_stop", "not_enabled", "client_lost"),
        *("motor_fault", "motor_silent", "not_confirmed"),  # a machine that stalls has these
        *("backlog_full", "connection_lost"),  # it was stopped for long and did not read
    }
)
"""Why a request of the crowd may be refused, or a motion of it end, without a defect."""

ANSWER_WITHIN_S = 60.0  # longer than anything waits: for the lease, in the queue, while stopped
MEAN_PAUSE_S = 0.15
LOOKS = ("state.get", "job.list", "clients.list", "health", "lease.get")


class Member:
    """A client that connects, acts for a while, and leaves, again and again."""

    def __init__(self, path: str, seed: int) -> None:
        self._path = path
        self._random = random.Random(seed)
        acts: dict[Callable[[Connection], None], int] = {
            self._move: 30,
            self._work_under_a_lease: 20,
            self._look: 20,
            self._enable: 8,
            self._change_the_hold: 8,
            self._watch: 3,
            self._disable: 2,
            self._stop: 1,
        }
        self._acts, self._weights = list(acts), list(acts.values())

    def live(self) -> None:
        """Visit the daemon again and again."""
        while True:
            try:
                self._visit()
            except ConnectError as error:
                if error.reason not in EXPECTED:
                    raise
            except BlockingIOError:  # too many connect at this moment
                pass
            self._pause()

    def _visit(self) -> None:
        with Connection(self._path, ANSWER_WITHIN_S) as connection:
            connection.greet("crowd")
            for _ in range(self._random.randint(1, 8)):
                self._random.choices(self._acts, self._weights)[0](connection)
                self._pause()

    def _pause(self) -> None:
        time.sleep(self._random.expovariate(1.0 / MEAN_PAUSE_S))

    def _ask(self, connection: Connection, method: str, **params: Any) -> str | None:
        """Make a request; return the reason of a refusal that may be."""
        try:
            connection.run(connection.prepare_guarded(method, params))
        except LiteGripError as error:
            if error.reason not in EXPECTED or isinstance(error, ConnectError):
                raise
            return error.reason
        return None

    def _look(self, connection: Connection) -> None:
        connection.call(self._random.choice(LOOKS))

    def _move(self, connection: Connection) -> None:
        """Ask for a short motion, in one of many ways, and mend what it is refused for."""
        method, params = self._motion()
        params["if_busy"] = self._random.choice(("reject", "queue", "queue", "replace"))
        how = self._random.random()
        if how < 0.15:
            params["detach"] = True
        elif how < 0.25:
            params["wait"] = False
        elif how < 0.5:
            params["progress"] = True
        reason = self._ask(connection, method, **params)
        if reason in ("not_enabled", "motor_fault"):
            self._enable(connection)
        elif reason == "stopped" and self._random.random() < 0.3:
            self._ask(connection, "stop.clear")

    def _motion(self) -> tuple[str, dict[str, Any]]:
        draw = self._random.uniform
        kind = self._random.choice(("open", "close", "move", "move", "grasp"))
        params = {"speed_mm_s": draw(60.0, 130.0)}
        if kind == "move":
            params["openness"] = draw(0.1, 0.9)
        elif kind == "grasp":
            params |= {"force_n": draw(1.0, 10.0), "hold_s": draw(0.05, 0.3)}
        return f"motion.{kind}", params

    def _work_under_a_lease(self, connection: Connection) -> None:
        """Move a few times under the lease; now and then forget to give it back."""
        wish: dict[str, Any] = {
            "wait_s": self._random.uniform(0.0, 5.0),
            "on_lost": self._random.choice(("hold", "relax", "disable")),
        }
        if self._random.random() < 0.3:
            wish["ttl_s"] = self._random.uniform(0.3, 2.0)
        if self._ask(connection, "lease.acquire", **wish) is not None:
            return
        for _ in range(self._random.randint(1, 4)):
            self._move(connection)
            self._pause()
        if self._random.random() < 0.7:
            self._ask(connection, "lease.release")

    def _enable(self, connection: Connection) -> None:
        self._ask(connection, "motor.enable", detach=self._random.random() < 0.3)

    def _change_the_hold(self, connection: Connection) -> None:
        if self._random.random() < 0.4:
            force_n = self._random.uniform(1.0, 10.0)
            self._ask(connection, "motion.set_force", force_n=force_n)
        else:
            self._ask(connection, self._random.choice(("motion.hold", "motion.zero_gravity")))

    def _watch(self, connection: Connection) -> None:
        """Read a few states; the subscription goes on, and is read only by the way."""
        states = connection.subscribe_state(self._random.choice((5.0, 50.0, 200.0)))
        connection.subscribe_events()
        for _ in range(self._random.randint(1, 10)):
            next(states)

    def _disable(self, connection: Connection) -> None:
        self._ask(connection, "motor.disable")

    def _stop(self, connection: Connection) -> None:
        level = self._random.choice(("hold", "relax", "disable"))
        self._ask(connection, "stop", level=level, why="at random")
        self._pause()
        self._ask(connection, "stop.clear")


if __name__ == "__main__":
    Member(sys.argv[1], int(sys.argv[2])).live()
