"""Recording, replay and teleoperation: one at a time, their statuses, links of a program's own."""

import json
from collections.abc import Iterator
from typing import Any

import pytest

import litegrip
from litegrip import LiteGrip, Trajectory, TrajectorySample
from tests.drop_in import Daemon, Site
from tests.sdk.readme.trajectories import teach

STILL = Trajectory([TrajectorySample(0.02 * n, 0.69, -1.14) for n in range(100)])

# Trajectories


def test_a_recording_has_the_samples_that_were_asked_for(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    teach(site, daemon)
    taught = gripper.record(1.0, rate_hz=50.0)
    assert len(taught) == 50
    assert taught.duration == pytest.approx(0.98)
    assert taught.mount == daemon.mount
    assert taught.pos_closed_rad == gripper.config.pos_closed_rad
    assert taught.samples[-1].openness > taught.samples[0].openness + 0.05
    assert gripper.session is None


def test_a_motion_can_be_recorded_while_others_drive(gripper: LiteGrip, site: Site) -> None:
    status = gripper.record_start(rate_hz=100.0, zero_gravity=False)
    assert (status["active"], status["kind"], status["rate_hz"]) == (True, "record", 100.0)
    assert status["zero_gravity"] is False
    gripper.goto(20.0)
    taught = gripper.record_stop()
    assert taught.samples[0].openness > taught.samples[-1].openness + 0.3
    assert taught.samples[0].t == 0.0


def test_start_and_stop_at_once_gives_a_sample(gripper: LiteGrip) -> None:
    gripper.record_start()
    assert len(gripper.record_stop()) >= 1
    with pytest.raises(litegrip.TrajectoryNotActiveError):
        gripper.record_stop()


def test_a_full_recording_ends_by_itself_and_stays_readable(gripper: LiteGrip, site: Site) -> None:
    gripper.record_start(max_samples=20)
    site.run(1.0)
    status = gripper.trajectory_status()
    assert (status["active"], status["samples"], gripper.session) == (False, 20, None)
    assert len(gripper.record_stop()) == 20
    assert gripper.trajectory_status() == {"active": False, "kind": None}


def test_after_a_recording_there_is_no_status(gripper: LiteGrip, site: Site) -> None:
    gripper.record_start()
    site.run(0.5)
    gripper.record_stop()
    assert gripper.trajectory_status() == {"active": False, "kind": None}


def test_a_replay_returns_its_final_status(gripper: LiteGrip) -> None:
    status = gripper.play(STILL)
    assert status["frames"] > 300
    assert f"{status['openness']:.3f}" == "0.690"
    assert (status["active"], status["kind"], status["completed"]) == (False, "play", True)
    assert (status["speed"], status["loop"], status["error"]) == (1.0, False, None)
    json.dumps(status, allow_nan=False)


def test_a_replay_in_the_background(gripper: LiteGrip, site: Site) -> None:
    status = gripper.play_start(STILL, loop=True, speed=2.0)
    assert (status["active"], status["loop"], gripper.session) == (True, True, "play")
    assert status["samples"] == 100
    site.run(3.0)
    assert gripper.trajectory_status()["frames"] > 100
    final = gripper.play_stop(timeout=-1)  # the SDK joins a thread with it, which takes it for 0
    assert (final["active"], final["kind"]) == (False, "play")
    assert gripper.play_stop() == {"active": False, "kind": None}


def test_a_replay_that_something_blocks_is_an_error(gripper: LiteGrip, daemon: Daemon) -> None:
    gripper.open()
    daemon.gripper.put_object(width_mm=50.0)
    path = Trajectory([TrajectorySample(0.02 * n, 1.0 - 0.01 * n, 0.0) for n in range(90)])
    with pytest.raises(litegrip.TrajectoryError):
        gripper.play(path)


@pytest.mark.parametrize(
    ("call", "kind"),
    [
        (lambda g: g.play(STILL, loop=True), ValueError),
        (lambda g: g.play(STILL, speed=0.0), ValueError),
        (lambda g: g.play_start(STILL, speed=-1.0), ValueError),
        (lambda g: g.record_start(rate_hz=0.0), ValueError),
        (lambda g: g.record(0.0), ValueError),
        (lambda g: g.play(Trajectory()), litegrip.TrajectoryEmptyError),
        (lambda g: g.play(STILL, speed="fast"), ValueError),
        (lambda g: g.play(STILL, kp="stiff"), ValueError),
        (lambda g: g.play_start(STILL, kd=float("nan")), ValueError),
        (lambda g: g.record_start(rate_hz=None), ValueError),
        (lambda g: g.record("long"), ValueError),
    ],
)
def test_what_cannot_be_recorded_or_replayed(gripper: LiteGrip, call: Any, kind: type) -> None:
    with pytest.raises(kind):
        call(gripper)
    assert gripper.session is None


def test_without_a_calibration(daemon: Daemon) -> None:
    with LiteGrip("can0") as gripper:
        gripper.enable()
        with pytest.raises(litegrip.TrajectoryError, match="not calibrated"):
            gripper.record_start()
        with pytest.raises(litegrip.TrajectoryError, match="not calibrated"):
            gripper.play(STILL)
        with pytest.raises(litegrip.TeleopNotReady, match="not calibrated"):
            gripper.teleop_start("master")


def test_the_class_of_busy_is_of_who_asks(gripper: LiteGrip) -> None:
    gripper.play_start(STILL, loop=True)
    with pytest.raises(litegrip.TeleopBusyError, match="play"):
        gripper.teleop_start("slave", link="serial")
    with pytest.raises(litegrip.TrajectoryBusyError, match="play"):
        gripper.record_start()
    with pytest.raises(litegrip.TrajectoryBusyError, match="play"):
        gripper.play_start(STILL)
    gripper.play_stop()


# Teleoperation


@pytest.mark.parametrize(
    "wrong",
    [
        {"mode": "both"},
        {"mode": "slave"},
        {"mode": "master", "link": "udp"},
        {"mode": "master", "link": "serial"},
        {"mode": "master", "rate_hz": 0.0},
        {"mode": "master", "watchdog_s": -1.0},
        {"mode": "slave", "host": "x", "align_speed_mm_s": 0.0},
        {"mode": "master", "ready_period_s": 0.0},
        {"mode": "master", "torque_limit_nm": -1.0},
        {"mode": "master", "lead_cap_mm": -1.0},
        {"mode": "master", "ready_timeout_s": float("nan")},
        {"mode": "master", "rate_hz": "fast"},
        {"mode": "master", "watchdog_s": None},
        {"mode": "master", "lead_cap_mm": "far"},
        {"mode": "master", "kp": "stiff"},
    ],
)
def test_what_teleoperation_cannot_be(gripper: LiteGrip, wrong: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=r"must|needs"):
        gripper.teleop_start(**wrong)
    assert gripper.session is None


class Pair:
    """A leader and a follower, and the bus of their program."""

    def __init__(self, site: Site, leader: LiteGrip, follower: LiteGrip) -> None:
        self.site, self.leader, self.follower = site, leader, follower
        self.bus = litegrip.InProcTeleopTransport()


@pytest.fixture
def pair(site: Site) -> Iterator[Pair]:
    made = []
    for channel, mount in (("can0", "normal"), ("can1", "reverse")):
        site.add(Daemon(channel, mount))
        one = LiteGrip(channel, mount=mount)
        one.connect()
        one.enable()
        made.append(one)
    yield Pair(site, *made)
    for one in made:
        one.disconnect()


def test_a_follower_follows_and_says_that_it_is_ready(pair: Pair, site: Site) -> None:
    first = pair.leader.teleop_start("master", transport=pair.bus)
    assert (first["active"], first["mode"], first["frames"]) == (True, "master", 0)
    assert first["topic"] == litegrip.teleop_topic()
    assert pair.leader.session == "teleop"
    site.run(0.5)
    assert pair.leader.teleop_status()["ready"] is False
    pair.follower.teleop_start("slave", transport=pair.bus)
    site.run(6.0)
    led, followed = pair.leader.teleop_status(), pair.follower.teleop_status()
    assert (led["ready"], led["ready_timed_out"], followed["ready_pubs"] > 10) == (
        True,
        False,
        True,
    )
    assert followed["frames"] > 100
    assert followed["last_frame_age_ms"] < 100.0
    for status in (led, followed):
        json.dumps(status, allow_nan=False)
        assert status["fault"] == ""
    leader, follower = pair.leader, pair.follower
    assert follower.get_position() == pytest.approx(leader.get_position(), abs=2.0)
    final = pair.follower.teleop_stop()
    assert (final["active"], final["mode"]) == (False, "slave")
    assert pair.follower.teleop_status() == {"active": False, "mode": None}
    pair.leader.teleop_stop()


def test_a_leader_without_a_follower_holds_and_then_goes_slack(pair: Pair, site: Site) -> None:
    pair.leader.teleop_start("master", transport=pair.bus, ready_timeout_s=1.0)
    site.run(2.0)
    assert pair.leader.teleop_status()["ready_timed_out"] is True


class OneWay(litegrip.TeleopTransport):
    """A link that can only send, and sometimes cannot."""

    def __init__(self) -> None:
        self.sent = 0

    def pub(self, topic: str, payload: bytes) -> None:
        self.sent += 1
        if self.sent % 3 == 0:
            raise OSError("the network is away")


def test_a_link_that_cannot_listen_opens_the_gate(pair: Pair, site: Site) -> None:
    link = OneWay()
    pair.leader.teleop_start("master", transport=link)
    site.run(1.0)
    status = pair.leader.teleop_status()
    assert link.sent > 20
    assert status["send_failed"] >= link.sent // 3 - 1
    assert pair.leader.daemon is not None
    assert pair.leader.daemon.get_state().requested_torque_nm in (0.0, None)


def test_a_follower_drops_what_is_no_frame(pair: Pair, site: Site) -> None:
    pair.follower.teleop_start("slave", transport=pair.bus)
    topic = litegrip.teleop_topic()
    for payload in (b"", bytes(31), litegrip.encode_frame(float("nan"), 0.0, 0.0, 0.0)):
        pair.bus.pub(topic, payload)
        site.run(0.1)
    status = pair.follower.teleop_status()
    assert (status["rejected"], status["frames"]) == (3, 0)


class Odd(litegrip.TeleopTransport):
    """A link of somebody's own, which says whether somebody listens and cannot receive."""

    matching: Any = True

    def pub(self, topic: str, payload: bytes) -> None:
        pass

    def sub(self, topic: str) -> litegrip.TeleopSubscription:
        return litegrip.TeleopSubscription()


def test_a_link_that_fails_to_receive_is_carried_on(pair: Pair, site: Site) -> None:
    link = Odd()
    pair.leader.teleop_start("master", transport=link, ready_timeout_s=0.5)
    site.run(1.0)
    status = pair.leader.teleop_status()
    assert status["frames"] > 20
    assert (status["matching"], status["last_frame_age_ms"]) == (True, None)
    link.matching = lambda: True
    assert pair.leader.teleop_status()["matching"] is None
    assert pair.leader.teleop_stop()["active"] is False


def test_a_link_of_ones_own_needs_no_host(pair: Pair) -> None:
    status = pair.follower.teleop_start("slave", transport=pair.bus, host="10.0.0.1", kp=1e6, kd=0)
    assert (status["active"], status["matching"]) == (True, None)


def test_a_failed_start_frees_the_link(pair: Pair) -> None:
    with pytest.raises(litegrip.CommandError, match="grip_id"):
        pair.leader.teleop_start("master", transport=pair.bus, grip_id="a b")
    assert (pair.leader.session, pair.leader._sessions._carrier) == (None, None)
    assert pair.leader.teleop_start("master", transport=pair.bus)["active"] is True


def test_a_session_that_was_stopped_leaves_no_carrier(pair: Pair) -> None:
    pair.leader.teleop_start("master", transport=pair.bus)
    first = pair.leader._sessions._carrier
    pair.leader.stop()
    assert pair.leader.session is None
    pair.leader.record_start()
    assert first is not None
    assert pair.leader._sessions._carrier is None
    pair.leader.record_stop()


@pytest.mark.parametrize(
    "begin",
    [
        lambda g: g.play_start(STILL, loop=True),
        lambda g: g.record_start(),
        lambda g: g.teleop_start("master", transport=litegrip.InProcTeleopTransport()),
    ],
)
def test_disconnecting_ends_a_session(gripper: LiteGrip, daemon: Daemon, begin: Any) -> None:
    begin(gripper)
    gripper.disconnect()
    assert (gripper.session, daemon.is_energised) == (None, False)
    assert gripper.connect()
    assert gripper.enable()
    assert gripper.goto(30.0)


def test_a_link_that_cannot_be_opened_is_the_fault(
    pair: Pair, monkeypatch: pytest.MonkeyPatch
) -> None:
    pair.leader.teleop_start("master", transport=pair.bus)
    daemon = pair.leader.daemon
    assert daemon is not None
    found = daemon.teleop_status() | {"link_error": "port 17448 is in use"}
    monkeypatch.setattr(daemon, "teleop_status", lambda: found)
    assert pair.leader.teleop_status()["fault"] == "port 17448 is in use"
