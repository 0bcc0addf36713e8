"""Real-time rights of a process that has no privileges, as a unit of an ordinary user."""

import os
import subprocess
import sys

import pytest

AS_A_USER = """
import os
from litegripd.io import realtime
assert realtime.acquire(50, ()).fifo_priority == 50
os.setgroups([]); os.setgid(65534); os.setuid(65534)
assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_FIFO
realtime.give_up_priority()
assert os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER
"""


@pytest.mark.skipif(os.getuid() != 0, reason="only root may become somebody else")
def test_what_was_granted_can_be_given_up_without_privileges() -> None:
    command = [sys.executable, "-c", AS_A_USER]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "fifo_priority" in done.stderr:
        pytest.skip("this machine grants nobody a real-time priority")
    assert done.returncode == 0, done.stderr
