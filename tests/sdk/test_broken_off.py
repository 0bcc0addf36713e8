"""What breaks off: the daemon goes away and comes back, an interrupt, another thread, a mistake."""

import math
import traceback
from types import SimpleNamespace
from typing import Any

import pytest

import litegrip
import litegrip_client
from litegrip import LiteGrip, Trajectory, TrajectorySample
from litegrip._bridge import Samples
from litegrip.protocols import LiteGripCAN
from tests.drop_in import Daemon, Site

STILL = Trajectory([TrajectorySample(0.02 * n, 0.69, -1.14) for n in range(100)])


@pytest.fixture
def mount() -> str:
    return "normal"


def go_away(site: Site, gripper: LiteGrip) -> None:
    assert gripper.daemon is not None
    site.kill(gripper.daemon)


# The daemon


def test_a_session_is_over_with_its_daemon(gripper: LiteGrip, site: Site) -> None:
    gripper.record_start(zero_gravity=False)
    go_away(site, gripper)
    assert (gripper.is_connected, gripper.is_enabled, gripper.session) == (False, False, None)
    with pytest.raises(litegrip.CommError):
        gripper.record_stop()
    gripper.disconnect()
    assert gripper.session is None
    assert gripper.trajectory_status() == {"active": False, "kind": None}


def test_it_connects_again(gripper: LiteGrip, site: Site) -> None:
    gripper.record_start(zero_gravity=False)
    old = gripper.daemon
    go_away(site, gripper)
    assert gripper.connect() is True
    assert gripper.daemon is not old
    assert gripper.is_enabled is False
    assert gripper.trajectory_status() == {"active": False, "kind": None}
    with pytest.raises(litegrip.NotInitializedError, match="enable"):
        gripper.open()
    assert gripper.enable()
    assert gripper.goto(30.0)


def test_a_carrier_ends_with_its_daemon(gripper: LiteGrip, site: Site) -> None:
    gripper.teleop_start("master", transport=litegrip.InProcTeleopTransport())
    assert gripper._sessions._carrier is not None
    go_away(site, gripper)
    gripper.connect()
    assert gripper._sessions._carrier is None


def test_a_calibration_is_not_asked_of_a_daemon_that_is_gone(gripper: LiteGrip, site: Site) -> None:
    """Else the object were connected again behind the program's back, and not enabled."""
    go_away(site, gripper)
    assert gripper.load_calibration()
    assert not gripper.is_connected


@pytest.mark.parametrize("channel", ["", "a/b", "x" * 300])
def test_what_is_no_channel(site: Site, channel: str) -> None:
    gripper = LiteGrip(channel)
    gripper.load_calibration()
    with pytest.raises(litegrip.ConnectError, match="channel"):
        gripper.connect()


# The motor


def test_after_a_failure_it_is_not_enabled(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    daemon.gripper.power_off()
    site.run(1.0)
    assert not gripper.enable(1)
    assert gripper.is_enabled is False
    assert gripper.send_mit_frame(-0.5, 100.0, 2.0) is False


def test_setting_the_zero_disables(daemon: Daemon) -> None:
    motor = LiteGripCAN("can0")
    motor.connect()
    motor.register_gripper()
    assert motor.initialize() is True
    assert motor.control_mit(-1.1, 20.0, 1.0)
    assert motor.set_zero() is True
    assert motor.is_initialized is False
    assert motor.control_mit(0.0, 20.0, 1.0) is False
    motor.disconnect()


def test_a_motor_without_a_name_can_be_initialized(daemon: Daemon) -> None:
    motor = LiteGripCAN("can0")
    motor.connect()
    assert motor.initialize() is True
    motor.disconnect()


@pytest.mark.parametrize("name", ["enable", "clear_fault", "zero"])
def test_frames_end_where_the_motor_is_asked_for(gripper: LiteGrip, name: str) -> None:
    assert gripper.send_mit_frame(-1.0, 100.0, 2.0)
    assert getattr(gripper, name)()
    assert gripper._frames is None


# Interrupts


def interrupt() -> None:
    raise KeyboardInterrupt


@pytest.mark.parametrize(
    "use",
    [
        lambda g: g.open(),
        lambda g: g.grasp(10.0, 0.0),
        lambda g: g.goto(70.0, duration=3.0),
        lambda g: g.set_force(20.0, 3.0),
        lambda g: g.record(3.0),
        lambda g: g.play(STILL),
        lambda g: g.zero(),
    ],
)
def test_an_interrupt_frees_the_gripper(gripper: LiteGrip, site: Site, use: Any) -> None:
    gripper.goto(40.0)
    site.after(1.2, interrupt)
    with pytest.raises(KeyboardInterrupt):
        use(gripper)
    assert (gripper.session, gripper.is_enabled, gripper.get_error()) == (None, True, 1)
    assert gripper.send_mit_frame(-0.5, 100.0, 2.0)
    assert gripper.goto(40.0)


@pytest.mark.parametrize(
    ("call", "use"),
    [
        ("record_start", lambda g: g.record(3.0)),
        ("play_start", lambda g: g.play_start(STILL)),
        ("teleop_start", lambda g: g.teleop_start("master", link="udp", host="127.0.0.1")),
    ],
)
def test_a_session_that_is_interrupted_as_it_begins(
    gripper: LiteGrip, monkeypatch: pytest.MonkeyPatch, call: str, use: Any
) -> None:
    """It may have begun in the daemon, whose answer nobody has read."""
    daemon = gripper.daemon
    begin = getattr(daemon, call)

    def interrupted(*given: Any, **named: Any) -> None:
        begin(*given, **named)
        raise KeyboardInterrupt

    monkeypatch.setattr(daemon, call, interrupted)
    with pytest.raises(KeyboardInterrupt):
        use(gripper)
    assert gripper.session is None
    assert gripper.goto(40.0)


# Threads


def test_another_thread_may_stop_while_a_frame_is_sent(
    gripper: LiteGrip, site: Site, monkeypatch: pytest.MonkeyPatch
) -> None:
    gains = litegrip._bridge.gains_in_range

    def gains_after_a_stop(*given: Any) -> Any:
        """Let the other thread stop just before the frame is sent."""
        thread = site.turns.threading.Thread(target=gripper.stop)
        thread.start()
        thread.join()
        return gains(*given)

    monkeypatch.setattr(litegrip.gripper, "gains_in_range", gains_after_a_stop)
    assert gripper.send_mit_frame(-1.0, 100.0, 2.0)
    assert gripper.send_mit_frame(-1.0, 100.0, 2.0)


def test_a_link_may_end_its_own_teleoperation(gripper: LiteGrip, site: Site) -> None:
    """It is called in the carrier's thread, which cannot wait for itself."""
    ended: list[tuple[bool, float]] = []

    class Ending(litegrip.InProcTeleopTransport):
        def pub(self, topic: str, payload: bytes) -> None:
            began_s = site.now_s
            ended.append((gripper.teleop_stop()["active"], site.now_s - began_s))

    gripper.teleop_start("master", transport=Ending())
    site.run(1.0)
    ((active, lasted_s),) = ended
    assert not active
    assert lasted_s < 0.1
    assert gripper.session is None


def test_a_replay_is_a_session_of_the_object(
    gripper: LiteGrip, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[Any] = []
    daemon: Any = gripper.daemon
    play = daemon.play

    def watched(*given: Any) -> Any:
        """Begin as another thread would see it: in the background."""
        daemon.play_start(*given[:4], False, given[4])
        seen.append((gripper.session, gripper.trajectory_status()["kind"]))
        with pytest.raises(litegrip.TrajectoryBusyError, match="play"):
            gripper.record_start()
        seen.append(gripper.play_stop()["active"])
        return play(*given)

    monkeypatch.setattr(daemon, "play", watched)
    gripper.play(STILL)
    assert seen == [("play", "play"), False]
    assert gripper.session is None


def test_a_replay_that_is_ended_is_an_error(gripper: LiteGrip, daemon: Daemon, site: Site) -> None:
    other = LiteGrip("can0")
    other.connect()
    assert other.daemon is not None
    beside = other.daemon
    site.after(1.0, beside.software_stop)
    with pytest.raises(litegrip.TrajectoryError):
        gripper.play(STILL)
    beside.clear_stop()
    assert gripper.session is None
    other.disconnect()


@pytest.mark.parametrize(
    "use", [lambda g: g.enter_zero_gravity(30.0), lambda g: g.set_force(0.0, 30.0)]
)
def test_slack_jaws_are_not_waited_for_after_a_stop(
    gripper: LiteGrip, site: Site, use: Any
) -> None:
    began_s = site.now_s
    assert use(gripper) in {None, True}
    assert site.now_s - began_s == pytest.approx(30.0, abs=0.1)
    assert gripper.daemon is not None
    assert gripper.daemon.get_state().mode == "relaxed"

    began_s = site.now_s
    site.after(1.0, gripper.daemon.software_stop)
    with pytest.raises(litegrip.CommandError, match="stop"):
        use(gripper)
    assert site.now_s - began_s < 1.5
    gripper.daemon.clear_stop()

    began_s = site.now_s
    site.after(1.0, lambda: go_away(site, gripper))
    with pytest.raises(litegrip.CommError, match="the daemon ended the connection"):
        use(gripper)
    assert site.now_s - began_s < 1.5


@pytest.mark.parametrize(
    "begin",
    [
        lambda g: g.record_start(),
        lambda g: g.play_start(STILL, loop=True),
        lambda g: g.teleop_start("master", transport=litegrip.InProcTeleopTransport()),
    ],
)
def test_a_session_is_in_the_way_of_motions(gripper: LiteGrip, begin: Any) -> None:
    begin(gripper)
    session = gripper.session
    for use in (gripper.open, gripper.enter_zero_gravity, lambda: gripper.goto(30.0)):
        with pytest.raises(litegrip.TrajectoryBusyError):
            use()
    with pytest.raises(litegrip.TeleopBusyError):
        gripper.send_mit_frame(-0.5, 100.0, 2.0)
    assert gripper.session == session
    assert gripper.poll()
    gripper.stop()
    assert gripper.session is None
    assert gripper.open()


# Mistakes


@pytest.mark.parametrize(
    "use",
    [
        lambda g: g.goto(math.nan),
        lambda g: g.goto_rad(math.nan),
        lambda g: g.move_at_speed(math.nan),
        lambda g: g.move_at_speed_rad(-0.5, math.nan),
        lambda g: g.grasp(math.nan),
        lambda g: g.set_force(1e9),
        lambda g: g.open("fast"),
    ],
)
def test_what_is_missing_is_said_before_what_is_wrong(daemon: Daemon, use: Any) -> None:
    gripper = LiteGrip("can0", mount="normal")
    with pytest.raises(litegrip.NotInitializedError, match="connect"):
        use(gripper)
    assert gripper.send_mit_frame(math.nan, 100.0, 2.0) is False
    with gripper:
        with pytest.raises(litegrip.NotInitializedError, match="enable"):
            use(gripper)
        assert gripper.enable()
        with pytest.raises(litegrip.CommandError):
            use(gripper)
        with pytest.raises(litegrip.CommandError):
            gripper.send_mit_frame(math.nan, 100.0, 2.0)


@pytest.mark.parametrize("value", [math.nan, "fast"])
@pytest.mark.parametrize("name", ["enable", "open", "zero", "record_start"])
def test_a_tunable_that_is_no_number(gripper: LiteGrip, name: str, value: Any) -> None:
    gripper.motion_config.speed_mm_s = value
    with pytest.raises(litegrip.CommandError, match="speed_mm_s"):
        getattr(gripper, name)()
    gripper.motion_config.speed_mm_s = 50.0
    assert gripper.session is None
    assert gripper.open()


def test_slices_of_a_hold_are_the_programs_own(gripper: LiteGrip) -> None:
    tunables = gripper.motion_config
    tunables.hold_interval = math.nan
    with pytest.raises(litegrip.CommandError, match="hold_interval"):
        gripper.grasp(10.0, 1.0)
    tunables.hold_interval = 3.0
    assert gripper.grasp(10.0, 6.0).cycles == 2


def test_the_last_frame_is_one_sample() -> None:
    taken: list[litegrip.MoveProgress] = []
    samples = Samples(taken.append, litegrip.MotionConfig())
    report: Any = SimpleNamespace(
        total_steps=20, cmd_rad=0.1, pos_rad=0.1, torque_nm=0.0, temperature_coil=25.0
    )
    for _ in range(3):
        samples.take(report)
    state: Any = SimpleNamespace(position_rad=0.1, torque_nm=0.0, coil_temperature_c=25.0)
    samples.end(20, 0.1, state)
    assert [one.i for one in taken] == [10, 20]
    samples.end(23, 0.1, state)
    assert [one.i for one in taken] == [10, 20, 23]


def test_a_scale_of_0(gripper: LiteGrip) -> None:
    gripper.config.rad_to_mm = 0.0
    with pytest.raises(litegrip.CommandError, match="rad_to_mm"):
        gripper.goto(30.0)


def test_a_register_is_a_float(gripper: LiteGrip) -> None:
    value = gripper.read_param(litegrip.can.protocol.DM_REG.MST_ID)
    assert (value, type(value)) == (0x18, float)


def test_limits_count_from_the_next_frame(gripper: LiteGrip, site: Site) -> None:
    config = gripper.config

    def open_wide() -> float:
        for _ in range(200):
            assert gripper.send_mit_frame(-config.close_sign * 9.0, 100.0, 2.0)
            site.run(0.01)
        return gripper.get_position()

    wide_mm = open_wide()
    config.pos_open_rad *= 0.95
    assert open_wide() < wide_mm - 2.0


# A recording


def test_of_a_recording_that_was_broken_off_a_shell_keeps_the_part(
    gripper: LiteGrip, daemon: Daemon, site: Site
) -> None:
    """`record_stop` takes no more here than the SDK's."""
    gripper.record_start()
    site.run(0.5)
    daemon.client().result("stop")
    with pytest.raises(litegrip.TrajectoryRecordingError) as caught:
        gripper.record_stop()
    told = "; litegripctl trajectories keep --partial NAME takes what there is"
    assert told in str(caught.value)
    assert isinstance(caught.value.__context__, litegrip_client.TrajectoryRecordingError)
    kept = daemon.client().result("trajectory.record_stop", name="part", allow_partial=True)
    assert 40 < kept["samples"] < 60


def test_that_command_is_for_the_programs_gripper(site: Site) -> None:
    daemon = site.add(Daemon("left"))
    with litegrip.LiteGrip("left") as gripper:
        gripper.load_calibration()
        gripper.enable()
        gripper.record_start()
        site.run(0.5)
        daemon.client().result("stop")
        with pytest.raises(litegrip.TrajectoryRecordingError) as caught:
            gripper.record_stop()
    assert "; litegripctl -c left trajectories keep --partial NAME takes" in str(caught.value)


def test_what_the_sdk_lacks_is_named_as_a_call_of_the_daemon(gripper: LiteGrip) -> None:
    assert gripper.daemon is not None
    gripper.daemon.software_stop()
    with pytest.raises(
        litegrip.CommandError, match=r"clear it with gripper\.daemon\.clear_stop\(\) first"
    ):
        gripper.open()
    gripper.daemon.clear_stop()
    gripper.disable()
    with pytest.raises(litegrip.NotInitializedError) as caught:
        gripper.open()
    assert "daemon" not in str(caught.value)


def test_the_traceback_of_a_stopped_motion_has_one_line_of_ours(
    gripper: LiteGrip, site: Site
) -> None:
    gripper.enable()
    assert gripper.daemon is not None
    site.after(0.3, gripper.daemon.software_stop)
    with pytest.raises(litegrip.CommandError) as caught:
        gripper.goto(10.0, duration=3.0)
    frames = traceback.extract_tb(caught.value.__traceback__)
    ours = [
        one.name for one in frames if "/drop_in/" in one.filename or "contextlib" in one.filename
    ]
    assert ours == ["goto"]
    gripper.daemon.clear_stop()
