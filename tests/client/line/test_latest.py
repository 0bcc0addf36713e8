"""The newest state over a real socket: what a signal handler and a forked child see of it."""

import os
import signal
import threading
import time

import pytest

from litegrip_client import ConnectError, LiteGrip
from tests.client.fake_daemon import DEADLINE_S, MOVE, STATE, FakeDaemon
from tests.client.helpers import sample


@pytest.fixture
def gripper(daemon: FakeDaemon) -> LiteGrip:
    daemon.handlers["state.subscribe"] = lambda _request: {"subscription": 5, "state": STATE}
    daemon.handlers["state.unsubscribe"] = lambda _request: {"subscription": 5}
    return LiteGrip(socket_path=daemon.path)


def test_a_call_and_a_signal_handler_go_on_beside_it(daemon: FakeDaemon, gripper: LiteGrip) -> None:
    seen: list[int] = []
    arrived = threading.Event()

    def on_signal(_number: int, _frame: object) -> None:
        seen.append(latest.state.seq)
        arrived.set()
        daemon.wait_for("motion.open")[0].reply(MOVE)

    before = signal.signal(signal.SIGUSR1, on_signal)
    try:
        daemon.handlers["motion.open"] = lambda _request: signal.pthread_kill(
            threading.main_thread().ident or 0, signal.SIGUSR1
        )
        with gripper, gripper.latest() as latest:
            (request,) = daemon.wait_for("state.subscribe")
            ends_s = time.monotonic() + DEADLINE_S
            sample(request, 41)
            while latest.state.seq != 41:
                assert time.monotonic() < ends_s
                os.sched_yield()
            assert gripper.open().ok
    finally:
        signal.signal(signal.SIGUSR1, before)
    assert arrived.is_set()
    assert seen == [41]


@pytest.mark.filterwarnings("ignore:This process:DeprecationWarning")
def test_a_forked_child_has_no_state_of_its_parents(gripper: LiteGrip) -> None:
    with gripper, gripper.latest() as latest:
        assert latest.state.seq == 7
        reading, writing = os.pipe()
        child = os.fork()
        if child == 0:
            said = "nothing"
            try:
                said = str(latest.state)
            except ConnectError as error:
                said = str(error.reason)
            finally:
                os.write(writing, said.encode())
                os._exit(0)
        os.close(writing)
        os.waitpid(child, 0)
        said = os.read(reading, 1000).decode()
        os.close(reading)
        assert said == "forked"
        assert latest.state.seq == 7
