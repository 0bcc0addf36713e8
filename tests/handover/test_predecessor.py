"""Who owns the bus while one daemon follows another, at every step and whoever fails."""

import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import cast

import pytest

from litegripd.app.config import OWN_MECHANICS, load, override, same_settings
from litegripd.handover.predecessor import (
    READY_WITHIN_S,
    TAKE_WITHIN_S,
    Link,
    Packet,
    Succession,
    pass_end,
    pass_stop,
    read_document,
)
from litegripd.handover.state import FORMAT
from litegripd.io.can.bus import FrameBus
from litegripd.io.helper.child import start_here
from litegripd.io.helper.helper import Helper, HelperResult
from litegripd.io.sockets import Places, occupy
from litegripd.model.errors import Refusal
from litegripd.model.motor import UP, BusCondition
from litegripd.model.plain import value_of
from litegripd.model.state import Owner, Restarted, Stop
from tests.world import PERIOD_S, World

DEADLINE_S = 20.0


class FakeHelper:
    """Keeps the successor's end of the line in place of starting a successor."""

    is_busy = False
    error: str | None = None
    is_late = False
    inherited: Link | None = None
    answer: Callable[[HelperResult], None]

    def request(
        self,
        operation: str,
        parameters: Mapping[str, object],
        on_result: Callable[[HelperResult], None],
        descriptors: Sequence[int],
    ) -> None:
        assert operation == "successor.start"
        arguments = ["litegripd.app.main", "--successor", "can7"]
        assert parameters == {"program": None, "arguments": arguments}
        if self.error is not None:
            on_result(HelperResult(error=self.error))
            return
        (descriptor,) = descriptors
        self.inherited = Link(socket.socket(fileno=os.dup(descriptor)))
        self.answer = on_result
        if not self.is_late:
            on_result(HelperResult())


class FakeBus:
    """A bus of which only is known whether it works."""

    condition = UP

    def hand_over(self) -> tuple[tuple[int, ...], int]:
        return (), 0


class Rig:
    """A succession, and a process that stands in for the successor."""

    def __init__(self, folder: Path, *, simulate: str | None = None) -> None:
        self.world = World()
        self.client = self.world.enabled()
        self.world.run(0.5)
        self.helper, self.bus = FakeHelper(), FakeBus()
        config = override(load("can7", None), socket=None, interface=None, simulate=simulate)
        self.places: Places = occupy("test", str(folder), folder / "rpc.sock", None)
        self.told: list[Restarted | Refusal] = []
        self.succession = Succession(
            same_settings(config),
            ["can7"],
            "epoch",
            interface=config.bus.interface,
            channel=config.bus.channel,
            machine=self.world.machine,
            service=self.world.service,
            helper=cast(Helper, self.helper),
            bus=cast(FrameBus, self.bus),
            places=self.places,
        )
        self.process = subprocess.Popen([sys.executable, "-c", "import signal; signal.pause()"])

    def close(self) -> None:
        self.process.kill()
        self.process.wait()
        self.succession.close()
        if self.helper.inherited is not None:
            self.helper.inherited.close()
        self.places.claim.close()
        self.places.stops.close()
        self.places.requests.close()

    def begin(self) -> Link:
        """Begin a restart; return the successor's end."""
        assert self.succession.begin(self.told.append, time.monotonic()) is None
        assert self.helper.inherited is not None
        return self.helper.inherited

    def ready(self) -> Link:
        """Begin, and say that the successor is ready."""
        link = self.begin()
        hello = link.wait(DEADLINE_S)
        assert hello is not None
        assert hello.kind == "hello"
        for descriptor in hello.descriptors:
            os.close(descriptor)
        pidfd = os.pidfd_open(self.process.pid)
        link.send("ready", (pidfd,), pid=self.process.pid)
        os.close(pidfd)
        return link

    def step(self, later_s: float = 0.0) -> Link | None:
        now_s = time.monotonic() + later_s
        return self.succession.step(now_s, now_s + PERIOD_S)

    def refusal(self) -> str:
        """Return the one thing that was told, a refusal."""
        (told,) = self.told
        assert isinstance(told, Refusal)
        assert told.reason == "restart_failed"
        return told.message


@pytest.fixture
def rig(tmp_path: Path) -> Iterator[Rig]:
    made = Rig(tmp_path)
    yield made
    made.close()


def answering(link: Link, answer: Callable[[Packet], None]) -> threading.Thread:
    """Answer the state as soon as it comes."""

    def wait() -> None:
        packet = link.wait(DEADLINE_S)
        assert packet is not None
        answer(packet)
        for descriptor in packet.descriptors:
            os.close(descriptor)

    thread = threading.Thread(target=wait)
    thread.start()
    return thread


def test_the_bus_is_handed_over_once_the_successor_has_sent_its_first_command(rig: Rig) -> None:
    link = rig.ready()
    seen: list[Packet] = []

    def answer(packet: Packet) -> None:
        seen.append(packet)
        link.send("running", gap_s=0.005)

    assert rig.step() is None, "the history is made in a tick of its own"
    thread = answering(link, answer)
    line = rig.step()
    thread.join()
    assert line is not None
    assert rig.told == []
    rig.succession.report_outcome()
    assert rig.told == [Restarted(rig.process.pid, 0.005)]
    assert rig.succession.pid == rig.process.pid
    assert rig.process.poll() is None
    assert seen[0].kind == "state"
    assert len(seen[0].descriptors) == 2
    assert seen[0].body["due_s"] > seen[0].body["sent_s"]
    stop = Stop("relax", Owner(3, 4, 5, "a program"), 17.5, "a test")
    pass_stop(line, stop, 9)
    pass_end(line)
    packet = link.receive()
    assert packet is not None
    assert value_of(packet.body["stop"], Stop, "stop") == stop
    assert packet.body["generation"] == 9
    last = link.receive()
    assert last is not None
    assert last.kind == "end"
    line.close()
    pass_end(line)  # nobody is there any more: told in the log


def test_a_successor_that_does_not_command_in_time_is_ended_before_we_go_on(rig: Rig) -> None:
    link = rig.ready()
    rig.step()
    began_s = time.monotonic()
    assert rig.step() is None
    assert time.monotonic() - began_s >= TAKE_WITHIN_S
    assert rig.process.wait(DEADLINE_S) < 0, "it was killed"
    assert "did not take over within 60 ms, and was ended" in rig.refusal()
    rig.world.run(0.1)
    assert rig.world.state.enabled
    link.close()
    rig.begin()


def test_one_that_dies_or_refuses_with_the_state_in_its_hands_is_dead_before_we_go_on(
    rig: Rig,
) -> None:
    link = rig.ready()
    rig.step()
    thread = answering(link, lambda _packet: link.send("refused", why="it is not understood"))
    assert rig.step() is None
    thread.join()
    assert rig.process.wait(DEADLINE_S) < 0
    assert rig.refusal() == "the daemon continues unchanged: it is not understood"


def test_one_that_closes_the_line_with_the_state_in_its_hands_is_dead_before_we_go_on(
    rig: Rig,
) -> None:
    link = rig.ready()
    rig.step()
    thread = answering(link, lambda _packet: link.close())
    assert rig.step() is None
    thread.join()
    rig.helper.inherited = None
    assert rig.process.wait(DEADLINE_S) < 0
    assert "ended while it took over" in rig.refusal()


def test_one_that_ends_before_it_is_ready_changes_nothing(rig: Rig) -> None:
    link = rig.begin()
    assert rig.step() is None
    link.close()
    rig.helper.inherited = None
    assert rig.step() is None
    assert "ended before it was ready" in rig.refusal()
    assert rig.process.poll() is None


def test_one_that_cannot_be_started_is_reported_so_though_its_line_ends_first(rig: Rig) -> None:
    rig.helper.is_late = True
    link = rig.begin()
    link.close()
    rig.helper.inherited = None
    assert rig.step() is None
    assert rig.told == []
    rig.helper.answer(HelperResult(error="no such file"))
    assert rig.refusal().endswith("the successor cannot be started: no such file")


@pytest.mark.parametrize(
    "junk",
    [b"{}", b"7", b'["ready"]', b'["ready", 5]', b"[5, {}]", b"\xff", b"[" * 60_000, b"x" * 70_000],
    ids=lambda junk: junk[:9].decode(errors="replace"),
)
def test_junk_on_its_line_fails_no_tick(rig: Rig, junk: bytes) -> None:
    link = rig.begin()
    reader, writer = os.pipe()
    with socket.socket(fileno=os.dup(link.fileno())) as raw:
        socket.send_fds(raw, [junk], [writer])
    os.close(writer)
    assert rig.step() is None
    assert "what the successor says cannot be read" in rig.refusal()
    assert os.read(reader, 1) == b"", "the descriptor that came with it is closed"
    os.close(reader)
    assert rig.world.state.enabled


@pytest.mark.parametrize("body", [{}, {"pid": "7"}, {"pid": None}, {"pid": 7}], ids=str)
def test_one_that_says_ready_and_is_no_process_does_not_get_the_bus(
    rig: Rig, body: dict[str, object]
) -> None:
    link = rig.begin()
    with Path("/dev/null").open() as no_process:
        link.send("ready", (no_process.fileno(),), **body)
    assert rig.step() is None
    assert rig.refusal().endswith("the successor said ready")


@pytest.mark.parametrize("junk", [b"[" * 60_000, b'["running", 5]'], ids=["deep", "no body"])
def test_one_that_answers_the_state_with_junk_is_dead_before_we_go_on(
    rig: Rig, junk: bytes
) -> None:
    link = rig.ready()
    rig.step()

    def answer(_packet: Packet) -> None:
        with socket.socket(fileno=os.dup(link.fileno())) as raw:
            raw.send(junk)

    thread = answering(link, answer)
    assert rig.step() is None
    thread.join()
    assert rig.process.wait(DEADLINE_S) < 0
    assert "the daemon continues unchanged" in rig.refusal()


@pytest.mark.parametrize(
    "gap_s", ["soon", None, True, float("nan"), float("inf"), 10**400], ids=str
)
def test_a_gap_that_is_no_time_is_none(rig: Rig, gap_s: object) -> None:
    """It commands the motor already: nothing that it says takes that back."""
    link = rig.ready()
    rig.step()
    thread = answering(link, lambda _packet: link.send("running", gap_s=gap_s))
    line = rig.step()
    thread.join()
    assert line is not None
    rig.succession.report_outcome()
    (told,) = rig.told
    assert isinstance(told, Restarted)
    assert told.gap_s == 0.0
    line.close()


def test_its_own_words_are_passed_on(rig: Rig) -> None:
    rig.begin().send("refused", why="[control] rate is unknown")
    assert rig.step() is None
    assert rig.refusal().endswith("[control] rate is unknown")


def test_a_motion_that_begins_meanwhile_is_waited_for(rig: Rig) -> None:
    link = rig.ready()
    rig.client.send("motion.move", opening_mm=58, speed_mm_s=100)
    for _ in range(5):
        assert rig.step() is None
        rig.world.tick()
    rig.world.run_until(lambda: rig.world.controller.jobs.running is None)
    rig.step()
    thread = answering(link, lambda _packet: link.send("running", gap_s=0.005))
    line = rig.step()
    thread.join()
    assert line is not None
    rig.succession.report_outcome()
    line.close()


def test_what_is_about_to_be_saved_is_waited_for(rig: Rig) -> None:
    rig.ready()
    assert rig.step() is None
    rig.client.send("config.set", config={"speed_mm_s": 33.0}, keep=True)
    assert [task.operation for task in rig.world.controller.tasks] == ["motion.save"]
    assert rig.step() is None, "its result would be lost"
    assert rig.told == []
    rig.world.run(0.1)
    assert not rig.world.controller.tasks
    assert rig.client.has_answer(rig.client.last_id)


def test_waiting_has_an_end(rig: Rig) -> None:
    link = rig.ready()
    rig.client.send("motion.move", opening_mm=20, speed_mm_s=1)
    assert rig.step() is None
    assert rig.step(READY_WITHIN_S) is None
    assert "is running" in rig.refusal()
    assert link.wait(DEADLINE_S) is None
    assert link.has_ended


def test_a_helper_that_cannot_start_it_is_told(rig: Rig) -> None:
    rig.helper.error = "no memory"
    assert rig.succession.begin(rig.told.append, time.monotonic()) is None
    assert "cannot be started: no memory" in rig.refusal()
    assert rig.step() is None


def test_what_forbids_a_restart_is_told_at_once(rig: Rig) -> None:
    rig.bus.condition = BusCondition("adapter_gone", "the cable is off")
    down = rig.succession.begin(rig.told.append, 0.0)
    assert down is not None
    assert down.reason == "bus_down"
    rig.bus.condition = UP
    rig.client.send("motion.open", speed_mm_s=20)
    moving = rig.succession.begin(rig.told.append, 0.0)
    assert moving is not None
    assert moving.reason == "busy"
    rig.client.send("stop")
    rig.world.tick()
    rig.begin()
    second = rig.succession.begin(rig.told.append, 0.0)
    assert second is not None
    assert "under way" in second.message
    assert rig.told == []


def test_a_gripper_that_lives_in_this_process_is_not_handed_over(tmp_path: Path) -> None:
    rig = Rig(tmp_path, simulate=OWN_MECHANICS)
    refusal = rig.succession.begin(rig.told.append, 0.0)
    rig.close()
    assert refusal is not None
    assert refusal.reason == "restart_failed"
    assert refusal.data["hint"] == "end the daemon and start it again"


def test_a_daemon_that_ends_lets_its_successor_go(rig: Rig) -> None:
    link = rig.ready()
    rig.succession.close()
    assert link.wait(DEADLINE_S) is None
    assert link.has_ended
    assert "about to end" in rig.refusal()


def test_the_state_fits_what_the_successor_prepares_with(rig: Rig) -> None:
    packet = rig.begin().wait(DEADLINE_S)
    assert packet is not None
    *sockets, document = packet.descriptors
    assert len(sockets) == len(rig.places.descriptors)
    for descriptor in sockets:
        os.close(descriptor)
    hello = read_document(document)
    assert hello["epoch"] == "epoch"
    assert hello["path"] == str(rig.places.path)
    assert hello["settings"].keys() == {"bus", "motor", "gripper", "rpc"}
    assert hello["state"]["format"] == FORMAT


def test_a_successor_without_predecessor_or_with_a_dead_one_ends() -> None:
    command = [sys.executable, "-m", "litegripd.app.main", "can7", "--successor"]
    alone = subprocess.run(command, capture_output=True, text=True, check=False, timeout=60)
    assert alone.returncode == 4
    assert "no predecessor" in alone.stderr
    child = start_here("litegripd.app.main", ("can7", "--successor"))
    child.socket.close()
    assert child.pid is not None
    assert child.pidfd is not None
    _, status = os.waitpid(child.pid, 0)
    os.close(child.pidfd)
    assert os.waitstatus_to_exitcode(status) == 4
