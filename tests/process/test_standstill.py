"""A daemon that the kernel keeps from running: what it says afterwards, and what others show."""

import json
import os
import select
import signal
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from litegrip_client.ctl.plot.drawing import draw, read
from tests.process.daemon_process import DEADLINE_S, Client, DaemonProcess, daemon, litegripctl

STOOD_STILL_S = 0.4


@pytest.fixture
def usual(tmp_path: Path) -> Iterator[DaemonProcess]:
    """A motor whose watchdog is the usual one of 0.1 s."""
    with daemon(tmp_path, f"still-{os.getpid()}", "--simulate") as running:
        yield running


def stand_still(running: DaemonProcess) -> None:
    """Stop the process for a while, as a suspended or overloaded machine would."""
    pidfd = os.pidfd_open(running.process.pid)
    running.process.send_signal(signal.SIGSTOP)
    try:
        os.waitid(os.P_PID, running.process.pid, os.WSTOPPED)
        assert not select.select([pidfd], [], [], STOOD_STILL_S)[0]
    finally:
        running.process.send_signal(signal.SIGCONT)
        os.close(pidfd)


def dumped(client: Client) -> Path:
    """Have the recorder dumped, after the dump that a fault makes by itself."""
    ends_s = time.monotonic() + DEADLINE_S
    while "result" not in (answer := client.call("recorder.dump")):
        assert answer["error"]["data"]["reason"] == "too_many_requests", answer
        assert time.monotonic() < ends_s, answer
        client.let_a_tick_pass()
    return Path(answer["result"]["path"])


def longest_drawn_us(dump: Path) -> float:
    """Return the latest of the ticks that the picture of a dump marks as after lost ones."""
    axes = draw(read(str(dump)), None).axes[-1]
    (marked,) = (line for line in axes.lines if line.get_label() == "ticks lost before")
    return float(np.max(np.asarray(marked.get_ydata())))


def test_a_stopped_daemon_is_not_taken_for_bad_wiring(usual: DaemonProcess) -> None:
    with usual.connect() as client:
        client.enabled()
        stand_still(usual)
        client.until(lambda state: bool(state["motor"] == "fault"))
        error = client.call("motion.open")["error"]
        assert "the daemon itself stood still for" in error["message"]
        assert "wiring" not in error["message"]
        assert error["data"]["stood_still_s"] >= STOOD_STILL_S
        health = client.result("health")
        path = dumped(client)
    assert health["control"]["lateness"]["worst_us"] >= (STOOD_STILL_S - 0.005) * 1e6
    assert any("stood still" in reason for reason in health["reasons"])
    _, found = litegripctl(usual, "doctor", "--json")
    rows = {row["check"]: row for row in json.loads(found)["findings"]}
    assert "the daemon itself stood still for" in rows["real-time"]["text"]
    assert "the daemon itself stood still for" in rows["health"]["text"]
    assert "wiring" not in json.dumps(list(rows.values()))
    assert "stood still for" in usual.log
    assert longest_drawn_us(path) >= (STOOD_STILL_S - 0.005) * 1e6
