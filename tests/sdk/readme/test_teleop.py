"""The SDK's description, section "Leader/follower teleoperation": two grippers, and one hand."""

import json
import struct
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import pytest

from litegrip_client import (
    BusyError,
    CommandError,
    LiteGrip,
    TeleopBusyError,
    TeleopNotReady,
)
from litegripd.model.teleop import Arrival, LinkOptions
from litegripd.teleop.link import InProcessLink, InProcessLinks
from tests.drop_in import Daemon, Site, a_site
from tests.geometry import TRAVEL_MM
from tests.sdk.readme.scenes import bench_unit, jaws_are_loose
from tests.world import PERIOD_S

KEY = "litearm/v4/gripA/gripper_teleop"


class Tapped(InProcessLinks):
    """A bus inside the process that can be cut, listened to, and spoken on by a script."""

    def __init__(self) -> None:
        super().__init__()
        self.opened: list[LinkOptions] = []
        self.heard: list[bytes] = []
        self.is_cut = False

    def open(self, options: LinkOptions) -> InProcessLink:
        self.opened.append(options)
        return super().open(options)

    def listeners(self, options: LinkOptions) -> list[InProcessLink]:
        return [] if self.is_cut else super().listeners(options)

    def say(self, payload: bytes, now_s: float) -> None:
        for listener in self.listeners(LinkOptions("master")):
            listener.deliver(Arrival(payload, now_s))


@dataclass(slots=True)
class Pair:
    """A leader on can0, a follower on can1, and a hand at the leader's jaws."""

    site: Site
    links: Tapped
    leader: Daemon
    follower: Daemon
    master: LiteGrip
    slave: LiteGrip
    hand_mm: list[float] = field(default_factory=list)

    def push(self) -> None:
        """Be a hand: a soft spring and a damper towards where it wants the leader's jaws."""
        if self.hand_mm:
            gripper, opening = self.leader.gripper, -self.leader.gripper.parameters.close_sign
            speed_mm_s = opening * gripper.velocity_rad_s * gripper.parameters.rad_to_mm
            push_nm = 0.06 * (self.hand_mm[0] - gripper.opening_mm) - 0.0012 * speed_mm_s
            gripper.push(opening * min(max(push_nm, -0.9), 0.9))

    def move(self, to_mm: float, within_s: float = 1.0) -> None:
        """Move the leader's jaws by hand, and wait."""
        from_mm = self.leader.gripper.opening_mm
        ticks = round(within_s / PERIOD_S)
        for tick in range(ticks):
            self.hand_mm[:] = [from_mm + (to_mm - from_mm) * (tick + 1) / ticks]
            self.site.tick()
        self.site.run(0.5)

    def say(self, openness: float, duration_s: float) -> None:
        """Be a leader that is a script."""
        for _ in range(round(duration_s / PERIOD_S)):
            packed = struct.pack(">dddd", openness, 0.0, 0.0, self.site.now_s)
            self.links.say(packed, self.site.now_s)
            self.site.tick()

    def start(self, **params: object) -> None:
        self.master.teleop_start("master")
        self.slave.teleop_start("slave", host="192.168.1.20", **params)  # type: ignore[arg-type]
        self.site.run_until(lambda: self.slave.teleop_status()["phase"] == "following")

    @property
    def openness(self) -> tuple[float, float]:
        """How far leader and follower really are open, by their calibrations."""
        return share_open(self.leader), share_open(self.follower)


def share_open(daemon: Daemon) -> float:
    geometry = daemon.controller.geometry
    assert geometry is not None
    return geometry.openness(daemon.gripper.position_rad)


@pytest.fixture
def pair(home: Path) -> Iterator[Pair]:
    """Return two calibrated and enabled grippers that differ in mount and travel."""
    with a_site(home) as site:
        links = Tapped()
        leader = site.add(Daemon("can0", links=links))
        unit = bench_unit("reverse")
        follower = site.add(Daemon("can1", "reverse", parameters=unit, links=links))
        with LiteGrip("can0") as master, LiteGrip("can1") as slave:
            assert master.enable()
            assert slave.enable()
            pair = Pair(site, links, leader, follower, master, slave)
            site._watchers.append(pair.push)
            yield pair


def test_two_grippers_are_linked_so_that_one_follows_the_other(pair: Pair) -> None:
    """What travels is the opening: mounts and calibrations need not be the same."""
    assert (pair.master.mount, pair.slave.mount) == ("normal", "reverse")
    pair.start()
    for to_mm in (75.0, 20.0, 45.0):
        pair.move(to_mm)
        leads, follows = pair.openness
        assert leads * TRAVEL_MM == pytest.approx(to_mm, abs=6.0)
        assert follows == pytest.approx(leads, abs=0.006)
        assert pair.slave.teleop_status()["openness"] == pytest.approx(leads, abs=0.003)


def test_the_master_goes_slack_and_publishes_at_the_loop_rate(pair: Pair) -> None:
    pair.master.teleop_start("master", require_ready=False)  # nobody follows here
    assert jaws_are_loose(pair.site, pair.leader)
    before = pair.master.teleop_status()["frames"]
    pair.site.run(1.0)
    assert pair.master.teleop_status()["frames"] - before == pytest.approx(200, abs=3)


def test_endpoints_key_and_defaults_are_the_field_stacks(pair: Pair) -> None:
    pair.start()
    leads, follows = pair.links.opened
    assert (leads.kind, leads.port, leads.topic) == ("zenoh", 17448, KEY)
    assert (follows.host, follows.port, follows.topic) == ("192.168.1.20", 17448, KEY)


def test_a_frame_is_byte_identical_to_the_litearm_stacks(pair: Pair) -> None:
    """Four big-endian float64, packed here by hand, are followed like any other leader's."""
    pair.slave.teleop_start("slave", host="192.168.1.20")
    pair.say(0.7, 1.5)
    assert pair.openness[1] == pytest.approx(0.7, abs=0.006)
    listener = pair.links.open(LinkOptions("slave"))
    pair.slave.teleop_stop()
    pair.master.teleop_start("master")
    pair.site.run(0.1)
    payload = listener.receive(0.0)[-1].payload
    openness, position_mm, force_n, _ = struct.unpack(">dddd", payload)
    assert openness == pytest.approx(pair.openness[0], abs=0.002)
    assert position_mm == pytest.approx(pair.leader.gripper.opening_mm, abs=0.2)
    assert force_n == pytest.approx(0.0, abs=0.2)


def test_link_udp_is_a_choice(pair: Pair) -> None:
    pair.slave.teleop_start("slave", link="udp")
    assert pair.links.opened[-1].kind == "udp"
    assert pair.slave.teleop_status()["link"] == "udp"


def test_an_own_transport_is_refused_with_the_reason(pair: Pair) -> None:
    with pytest.raises(CommandError, match="daemon"):
        pair.slave.teleop_start("slave", transport=object())
    assert pair.links.opened == []


def test_the_fake_leader_sweeps_and_shows_the_guard_on_a_rigid_object(pair: Pair) -> None:
    pair.follower.gripper.put_object(width_mm=50.0)
    pair.slave.teleop_start("slave", fake_leader=True, torque_limit_nm=1.0)
    pair.site.run_until(lambda: bool(pair.slave.teleop_status()["over_torque"]))
    pair.site.run_until(lambda: not pair.slave.teleop_status()["over_torque"])
    pair.site.run_until(lambda: pair.follower.gripper.opening_mm > 0.83 * TRAVEL_MM)
    pair.site.run_until(lambda: pair.slave.teleop_status()["torque_trips"] == 2)
    assert pair.links.opened == []


def test_teleoperation_is_exclusive(pair: Pair) -> None:
    pair.start()
    for forbidden in (
        pair.slave.open,
        pair.slave.hold,
        lambda: pair.slave.teleop_start("slave", host="x"),
        lambda: pair.slave.goto(30.0),
        lambda: pair.slave.record(1.0),
    ):
        with pytest.raises(TeleopBusyError) as caught:
            forbidden()
        assert isinstance(caught.value, BusyError)
    pair.slave.teleop_stop()
    assert pair.slave.goto(60.0)


FIELDS = {
    *("active", "mode", "topic", "frames", "last_frame_age_ms", "stale", "openness", "position_mm"),
    *("force_n", "dq_cmd", "loop_hz", "rejected", "send_failed", "fault", "torque_nm"),
    *("over_torque", "torque_trips", "ready", "ready_rx", "ready_pubs", "ready_timed_out"),
}


def test_the_status_reports_these_fields(pair: Pair) -> None:
    """From the first one on, which `teleop_start` returns; each can be written as JSON."""
    grippers = (pair.master, pair.slave)
    statuses = [gripper.teleop_status() for gripper in grippers]
    first = pair.slave.teleop_start("slave", host="192.168.1.20")
    assert (first["active"], first["mode"], first["frames"]) == (True, "slave", 0)
    pair.slave.teleop_stop()
    pair.start()
    pair.site.run(0.5)
    leads, follows = (gripper.teleop_status() for gripper in grippers)
    assert leads["matching"] is True
    assert follows["position_mm"] == pytest.approx(leads["position_mm"], abs=0.1)
    assert follows["loop_hz"] == pytest.approx(200.0, abs=1.0)
    for status in (first, leads, follows):
        assert status.keys() >= FIELDS
        assert status["fault"] == ""
    for status in (*statuses, first, leads, follows, pair.slave.teleop_stop()):
        json.dumps(status, allow_nan=False)


def test_a_fault_is_reported(pair: Pair) -> None:
    pair.start()
    pair.follower.gripper.latch_fault(0xB)
    pair.site.run(0.2)
    status = pair.slave.teleop_status()
    assert not status["active"]
    assert "driver" in status["fault"]


def test_frames_that_could_not_be_sent_are_counted(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair.master.teleop_start("master")
    monkeypatch.setattr(InProcessLink, "publish", lambda *_arguments: False)
    pair.site.run(0.5)
    assert pair.master.teleop_status()["send_failed"] > 90


def test_stopping_leaves_both_holding(pair: Pair) -> None:
    pair.start()
    pair.move(80.0)
    pair.hand_mm.clear()
    pair.leader.gripper.push(0.0)
    for gripper, daemon in ((pair.slave, pair.follower), (pair.master, pair.leader)):
        before_mm = daemon.gripper.opening_mm
        assert not gripper.teleop_stop()["active"]
        pair.site.run(0.5)
        assert daemon.is_energised
        assert daemon.gripper.opening_mm == pytest.approx(before_mm, abs=0.5)
        assert not jaws_are_loose(pair.site, daemon)


@pytest.mark.parametrize("mode", ["master", "slave"])
def test_it_refuses_to_start_on_what_is_not_ready(site: Site, mode: str) -> None:
    daemon = site.add(Daemon(calibrated=False))
    with LiteGrip("can0") as gripper:
        for enabled in (False, True):
            with pytest.raises(TeleopNotReady):
                gripper.teleop_start(mode, host="x" if mode == "slave" else None)
            assert daemon.is_energised is enabled
            gripper.enable()


def test_the_follow_gains_are_the_calibrations_unless_given(pair: Pair) -> None:
    for given, expected in (({}, (100.0, 2.0)), ({"kp": 60.0, "kd": 1.0}, (60.0, 1.0))):
        pair.slave.teleop_start("slave", host="x", **given)  # type: ignore[arg-type]
        pair.say(0.5, 0.5)
        command = pair.follower.command_now()
        assert command is not None
        assert command.kp_nm_rad == pytest.approx(expected[0], abs=0.2)
        assert command.kd_nm_s_rad == pytest.approx(expected[1], abs=0.01)
        pair.slave.teleop_stop()


def test_disconnecting_stops_it(pair: Pair) -> None:
    pair.start()
    pair.slave.disconnect()
    pair.site.run(0.1)
    assert not pair.follower.is_energised
    with LiteGrip("can1") as other:
        assert not other.teleop_status()["active"]
