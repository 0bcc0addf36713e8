"""The SDK's table of `MotionConfig`: what each field does to the jaws."""

from itertools import pairwise, takewhile

import pytest

from litegrip_client import HardwareError, LiteGrip, MotionConfig
from litegripd.motor import codec
from tests.drop_in import Daemon, Moment, Site
from tests.geometry import TRAVEL_MM, TRAVEL_RAD
from tests.sdk.readme.scenes import (
    CODE_RAD,
    LEAD_MM_RAD,
    content,
    lead_mm,
    load_content,
    speed_mm_s,
    tuned,
)

LEAD_CODE_MM = CODE_RAD * LEAD_MM_RAD

UNGUARDED: dict[str, int] = {"stop_torque_cycles": 100}
"""The daemon's own torque guard would end a move before the SDK's stall test does."""


def standing_s(moments: list[Moment]) -> float:
    """Return for how long the jaws stood where they ended."""
    last_mm = moments[-1].opening_mm
    since_s = next(m.at_s for m in moments if abs(m.opening_mm - last_mm) < 0.15)
    return moments[-1].at_s - since_s


def close_recorded(site: Site, daemon: Daemon, gripper: LiteGrip, **config: float) -> list[Moment]:
    gripper.motion_config = tuned(**config)
    with site.recorded(daemon) as moments:
        gripper.close()
    return moments


@pytest.mark.parametrize("speed", [20.0, 80.0])
def test_speed_mm_s(site: Site, daemon: Daemon, gripper: LiteGrip, speed: float) -> None:
    moments = close_recorded(site, daemon, gripper, speed_mm_s=speed)
    assert speed_mm_s(moments, 55.0, 15.0) == pytest.approx(speed, rel=0.05)
    with site.recorded(daemon) as moments:
        gripper.open()
    assert speed_mm_s(moments, 15.0, 77.0) == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize("speed", [20.0, 80.0])
def test_grasp_speed_mm_s(site: Site, daemon: Daemon, gripper: LiteGrip, speed: float) -> None:
    daemon.gripper.put_object(width_mm=15.0)
    gripper.motion_config = MotionConfig(grasp_speed_mm_s=speed)
    with site.recorded(daemon) as moments:
        assert gripper.grasp(hold_s=0.5)
    assert speed_mm_s(moments, 55.0, 20.0) == pytest.approx(speed, rel=0.05)


@pytest.mark.parametrize("margin", [0.05, 0.2])
def test_margin_is_kept_from_the_stop_by_grasp_only(
    daemon: Daemon, gripper: LiteGrip, margin: float
) -> None:
    gripper.motion_config = tuned(**({} if margin == 0.05 else {"margin": margin}))
    result = gripper.grasp()
    config = gripper.config
    assert config.pos_closed_rad is not None
    assert config.close_sign is not None
    short_rad = (config.pos_closed_rad - result.target_rad) * config.close_sign
    assert short_rad == pytest.approx(margin * TRAVEL_RAD)
    assert daemon.gripper.opening_mm == pytest.approx(margin * TRAVEL_MM, abs=1.0)
    assert gripper.close()
    assert daemon.gripper.opening_mm == pytest.approx(0.0, abs=1.0)


def test_frame_interval(site: Site, daemon: Daemon, gripper: LiteGrip) -> None:
    began_s = site.now_s
    gripper.close()
    times = [at_s for at_s, _ in daemon.commands_since(began_s)]
    gaps = [later - earlier for earlier, later in pairwise(times)]
    assert len(gaps) > 300
    assert gaps == pytest.approx([0.005] * len(gaps))


@pytest.mark.parametrize(
    ("config", "longer_s"),
    [({"sample_interval": 0.1}, 0.2), ({"stall_cycles": 12}, 0.28), ({"settle_s": 1.0}, 0.7)],
)
def test_sample_interval_stall_cycles_and_settle_s_say_how_long_the_jaws_press(
    site: Site, daemon: Daemon, gripper: LiteGrip, config: dict[str, float], longer_s: float
) -> None:
    """A stall needs a whole window in which the jaws do less than a fifth of their way."""
    plain_s = standing_s(close_recorded(site, daemon, gripper))
    gripper.goto(60.0)
    changed_s = standing_s(close_recorded(site, daemon, gripper, **config))
    assert changed_s - plain_s == pytest.approx(longer_s, abs=0.1)


@pytest.mark.parametrize(("tolerance", "reached"), [(0.02, True), (0.002, False)])
def test_reach_tol(daemon: Daemon, gripper: LiteGrip, tolerance: float, reached: bool) -> None:
    """A hand that leans on the jaws keeps them some 0.005 rad from their target."""
    daemon.gripper.push(-0.6 * daemon.gripper.parameters.close_sign)
    gripper.motion_config = MotionConfig(reach_tol=tolerance)
    result = gripper.goto(30.0)
    assert (result.reached, result.ok) == (reached, reached)
    assert 0.002 < abs(daemon.gripper.position_rad - result.target_rad) < 0.02


@pytest.mark.parametrize(("ratio", "stalls"), [(0.2, True), (0.05, False)])
def test_stall_ratio(daemon: Daemon, gripper: LiteGrip, ratio: float, stalls: bool) -> None:
    """What yields at 8 of 50 mm/s stands still by a fifth, and moves by a twentieth."""
    daemon.gripper.put_object(width_mm=40.0, yield_mm_s=8.0)
    gripper.motion_config = tuned(stall_ratio=ratio, max_lead_mm=2.0, **UNGUARDED)
    result = gripper.close()
    assert (result.outcome == "blocked") is stalls
    assert (daemon.gripper.opening_mm > 30.0) is stalls


@pytest.mark.parametrize(("delta", "stalls"), [(0.0015, False), (0.02, True)])
def test_stall_delta(daemon: Daemon, gripper: LiteGrip, delta: float, stalls: bool) -> None:
    """What yields at 4 of 10 mm/s moves by a fifth, but by less than a floor of 0.02 rad."""
    gripper.goto(45.0)
    daemon.gripper.put_object(width_mm=40.0, yield_mm_s=4.0)
    gripper.motion_config = tuned(speed_mm_s=10.0, stall_delta=delta, max_lead_mm=2.0, **UNGUARDED)
    result = gripper.close()
    assert (result.outcome == "blocked") is stalls
    assert (daemon.gripper.opening_mm > 30.0) is stalls


@pytest.mark.parametrize("lead", [1.0, 1.4])  # from 1.5 on the daemon pushes with 2 N·m
def test_max_lead_mm(site: Site, daemon: Daemon, gripper: LiteGrip, lead: float) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    moments = close_recorded(site, daemon, gripper, max_lead_mm=lead, **UNGUARDED)
    leads = [lead_mm(moment) for moment in moments]
    assert max(leads) == pytest.approx(lead, abs=2 * LEAD_CODE_MM)
    assert moments[-5].closing_torque_nm == pytest.approx(100.0 * lead / LEAD_MM_RAD, rel=0.1)


@pytest.mark.parametrize("share", [0.03, 0.08])
def test_press_overshoot(gripper: LiteGrip, share: float) -> None:
    gripper.motion_config = MotionConfig(press_overshoot=share)
    for result in (gripper.open(), gripper.close()):
        assert result
        assert abs(result.target_rad - result.limit_rad) == pytest.approx(share * TRAVEL_RAD)


@pytest.mark.parametrize(("zone", "torque_nm"), [(2.0, 2.0), (10.0, 0.94)])
def test_press_zone_mm(
    site: Site, daemon: Daemon, gripper: LiteGrip, zone: float, torque_nm: float
) -> None:
    """On something 6 mm thick the jaws press as on the way, or as at the stop."""
    daemon.gripper.put_object(width_mm=6.0)
    moments = close_recorded(site, daemon, gripper, press_zone_mm=zone, **UNGUARDED)
    pressed = [moment.closing_torque_nm for moment in moments]
    assert sorted(pressed)[-10] == pytest.approx(torque_nm, rel=0.15)


@pytest.mark.parametrize("lead", [None, 0.5, 1.0])
def test_stop_lead_mm(site: Site, daemon: Daemon, gripper: LiteGrip, lead: float | None) -> None:
    """It is 0.7 mm by default; the SDK's was 1 mm before."""
    moments = close_recorded(site, daemon, gripper, **({"stop_lead_mm": lead} if lead else {}))
    expected = gripper.motion_config.stop_lead_mm
    assert expected == (lead or 0.7)
    torque_nm = moments[-10].closing_torque_nm
    assert torque_nm == pytest.approx(100.0 * expected / LEAD_MM_RAD, rel=0.07)
    at_stop = [lead_mm(moment) for moment in moments[-60:]]
    assert max(at_stop) == pytest.approx(expected, abs=2 * LEAD_CODE_MM)


@pytest.mark.parametrize(("tolerance", "pressed"), [(0.02, False), (0.06, True)])
def test_stop_tol(site: Site, mount: str, tolerance: float, pressed: bool) -> None:
    """A calibration whose stop lies 0.04 rad behind the real one."""
    site.add(Daemon(mount=mount, calibrated=False))
    with LiteGrip("can0") as gripper:
        wide = content(mount)
        sign = 1 if mount == "normal" else -1
        wide["zero_position_rad"] += 0.04 * sign
        load_content(gripper, wide)
        gripper.enable()
        gripper.motion_config = MotionConfig(stop_tol=tolerance)
        assert gripper.close().ok is pressed


@pytest.mark.parametrize("force", [None, 8.0])
def test_force_n(daemon: Daemon, gripper: LiteGrip, force: float | None) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    if force is not None:
        gripper.motion_config = MotionConfig(force_n=force)
    result = gripper.grasp(hold_s=2.0)
    assert result.force_n == (20.0 if force is None else force)
    assert daemon.closing_torque_nm == pytest.approx(result.force_n / 10.0, abs=0.1)


@pytest.mark.parametrize(("interval", "cycles"), [(None, 7), (0.1, 15), (1.0, 1)])
def test_hold_interval(
    daemon: Daemon, gripper: LiteGrip, interval: float | None, cycles: int
) -> None:
    daemon.gripper.put_object(width_mm=30.0)
    if interval is not None:
        gripper.motion_config = MotionConfig(hold_interval=interval)
    assert gripper.grasp(hold_s=1.5).cycles == cycles


def test_hold_kp_and_hold_kd(site: Site, daemon: Daemon, gripper: LiteGrip) -> None:
    """Where the daemon differs: only when asked for by `hold_by="gains"`."""
    daemon.gripper.put_object(width_mm=30.0)
    expected = {None: (150.0, 2.0), (90.0, 1.0): (90.0, 1.0)}
    for gains, (kp, kd) in expected.items():
        if gains is not None:
            gripper.motion_config = MotionConfig(hold_kp=gains[0], hold_kd=gains[1])
        gripper.grasp(hold_s=0.5, hold_by="gains")
        command = daemon.commands_since(site.now_s)[-1][1]
        assert command.kp_nm_rad == pytest.approx(kp, abs=0.1)
        assert command.kd_nm_s_rad == pytest.approx(kd, abs=0.01)
    gripper.grasp(hold_s=0.5)
    assert daemon.commands_since(site.now_s)[-1][1].kp_nm_rad == 0.0


def test_enable_retries_and_enable_retry_interval(site: Site, daemon: Daemon) -> None:
    daemon.lose_to_motor = lambda frame: frame.data == codec.ENABLE
    with LiteGrip("can0") as gripper:
        for retries, interval in ((3, 0.2), (5, 0.1)):
            began_s = site.now_s
            assert gripper.enable().tries == retries
            sent = [s.at_s for s in daemon.sent if s.frame.data == codec.ENABLE]
            times = [at_s for at_s in sent if at_s > began_s]
            assert len(times) == retries
            gaps = [later - earlier for earlier, later in pairwise(times)]
            assert gaps == pytest.approx([interval] * len(gaps), abs=0.006)
            gripper.motion_config = MotionConfig(enable_retries=5, enable_retry_interval=0.1)


@pytest.mark.parametrize(("delta", "measured"), [(0.0015, True), (0.01, False)])
def test_calib_stall_delta(daemon: Daemon, gripper: LiteGrip, delta: float, measured: bool) -> None:
    """What gives way at 0.007 rad a sample is a stop by one measure and not by another."""
    daemon.gripper.put_object(width_mm=50.0, yield_mm_s=10.0)
    gripper.motion_config = MotionConfig(calib_stall_delta=delta)
    if measured:
        gripper.zero()
        return
    with pytest.raises(HardwareError):
        gripper.zero()


@pytest.mark.parametrize("cycles", [5, 15])
def test_calib_stall_cycles(site: Site, daemon: Daemon, gripper: LiteGrip, cycles: int) -> None:
    gripper.motion_config = MotionConfig(calib_stall_cycles=cycles)
    with site.recorded(daemon) as moments:
        gripper.zero()
    arrived = next(i for i, moment in enumerate(moments) if moment.opening_mm > 86.7)
    at_open = list(takewhile(lambda moment: moment.opening_mm > 86.7, moments[arrived:]))
    assert len(at_open) * 0.005 == pytest.approx(cycles * 0.05, abs=0.12)


def test_calib_max_iter(daemon: Daemon, gripper: LiteGrip) -> None:
    gripper.motion_config = MotionConfig(calib_max_iter=10)
    with pytest.raises(HardwareError) as caught:
        gripper.zero()
    assert caught.value.reason == "not_found"
    assert daemon.gripper.opening_mm < 80.0
