"""The SDK's section "Migrating from the 2.2.0 API": what it says of measuring the travel."""

from collections import Counter
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import pytest

from litegrip_client import CommandError, HardwareError, LiteGrip, MotionConfig, MoveProgress
from tests.drop_in import Daemon, Moment, Site
from tests.geometry import TRAVEL_MM, TRAVEL_RAD
from tests.sdk.readme.scenes import CODE_RAD, LEAD_MM_RAD, bench_unit, lead_mm


def probe(
    site: Site, daemon: Daemon, measure: Callable[[], object]
) -> tuple[list[Moment], set[tuple[int, float]]]:
    with site.recorded(daemon) as moments:
        measure()
    sent = Counter(
        (round(m.command.kp_nm_rad), round(m.command.kd_nm_s_rad, 1))
        for m in moments[2:-2]
        if m.command is not None
    )
    limited = 0.02 * sent.total()  # where an end throws the jaws back, the torque's ceiling acts
    return moments, {gains for gains, count in sent.items() if count > limited}


def test_zero_probes_with_the_motion_config_and_saves_but_calibrate_does_neither(
    site: Site, home: Path, mount: str
) -> None:
    saved = home / "state" / "can0_calibration.json"
    unit = bench_unit(mount)
    daemon = site.add(Daemon(mount=mount, calibrated=False, parameters=unit))
    with LiteGrip("can0", mount=mount) as gripper:
        gripper.enable()
        gripper.motion_config = MotionConfig(calib_kp=30.0, calib_kd=3.0, calib_step_rad=0.04)
        _, gains = probe(site, daemon, gripper.calibrate)
        assert gains == {(20, 2.0)}
        assert not saved.exists()
        assert gripper.config.rad_to_mm == pytest.approx(unit.rad_to_mm, rel=0.01)  # but used
        _, gains = probe(site, daemon, lambda: gripper.calibrate(kp=15.0, kd=1.0))
        assert gains == {(15, 1.0)}
        moments, gains = probe(site, daemon, gripper.zero)
        assert gains == {(30, 3.0)}
        most_mm = max(lead_mm(moment) for moment in moments[1:])
        assert most_mm == pytest.approx(0.04 * LEAD_MM_RAD, rel=0.01)
        assert saved.exists()


def test_zero_and_calibrate_probe_alike_by_default(site: Site, mount: str) -> None:
    found: list[tuple[float | None, float | None]] = []
    for _ in range(2):
        daemon = site.add(Daemon(mount=mount))
        with LiteGrip("can0") as gripper:
            gripper.enable()
            measure = gripper.calibrate if found else gripper.zero
            moments, gains = probe(site, daemon, measure)
            assert gains == {(20, 2.0)}
            assert max(lead_mm(m) for m in moments[1:]) <= (0.05 + CODE_RAD) * LEAD_MM_RAD
            found.append((gripper.config.pos_closed_rad, gripper.config.pos_open_rad))
    assert found[0] == found[1]


@pytest.mark.parametrize("method", ["zero", "calibrate"])
def test_the_probe_is_safe_at_a_hard_stop_however_long_it_pushes(
    site: Site, daemon: Daemon, gripper: LiteGrip, method: str
) -> None:
    """An accumulated target would lead further in every cycle: 5 s of it would be 5 rad."""
    gripper.motion_config = MotionConfig(calib_stall_cycles=60)
    with site.recorded(daemon) as moments:
        if method == "zero":
            gripper.zero()
        else:
            gripper.calibrate(stall_cycles=60)
    at_open = [moment for moment in moments if moment.opening_mm > TRAVEL_MM - 0.4]
    assert len(at_open) > 500
    assert max(lead_mm(moment) for moment in moments[1:]) <= (0.05 + CODE_RAD) * LEAD_MM_RAD
    assert max(abs(moment.closing_torque_nm) for moment in at_open[:500]) < 1.25
    assert max(abs(moment.closing_torque_nm) for moment in moments) < 2.0  # the strokes after it
    still = [abs(moment.closing_torque_nm) for moment in at_open[100:450]]
    assert still == pytest.approx([1.0] * len(still), abs=0.03)


@pytest.mark.parametrize("method", ["zero", "calibrate"])
def test_the_probe_freezes_the_instant_the_torque_reaches_its_limit(
    site: Site, daemon: Daemon, gripper: LiteGrip, method: str
) -> None:
    """What presses the jaws back keeps them moving, so that no stall test could fire."""
    began_s, phases = site.now_s, []
    site.after(0.3, lambda: daemon.gripper.push(2.3 * daemon.gripper.parameters.close_sign))

    def note(report: MoveProgress) -> None:
        phases.append((site.now_s - began_s, report.phase))

    measure = gripper.zero if method == "zero" else gripper.calibrate
    with site.recorded(daemon) as moments, pytest.raises(HardwareError):
        measure(progress=note)
    hit_s = next(m.at_s for m in moments if abs(m.closing_torque_nm) >= 2.02) - began_s
    ended_s = next(at_s for at_s, phase in phases if phase == "probe_closed")
    assert 0.3 < hit_s < ended_s < hit_s + 0.07  # reports come every 0.05 s
    frozen = [m for m in moments if hit_s - 0.001 < m.at_s - began_s < hit_s + 0.03]
    assert min(lead_mm(moment) for moment in frozen) < 2 * CODE_RAD * LEAD_MM_RAD
    late = [m for m in moments if m.at_s - began_s > hit_s + 0.005]  # a hand is met by damping
    assert max(abs(moment.closing_torque_nm) for moment in late) < 2.5
    assert max(abs(moment.closing_torque_nm) for moment in moments) < 3.6


def test_a_ceiling_below_the_probes_own_push_still_finds_both_stops(
    site: Site, daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.motion_config = MotionConfig(calib_kp=40.0, calib_tau_limit=1.3)
    with site.recorded(daemon) as moments:
        data = gripper.zero(progress=lambda _progress: None)
    steady = [b for a, b in pairwise(moments) if abs(b.position_rad - a.position_rad) < 2e-4]
    assert max(abs(moment.closing_torque_nm) for moment in steady) < 1.4
    assert max(abs(moment.closing_torque_nm) for moment in moments) < 1.5 * 1.3
    assert data.travel_range_rad == pytest.approx(TRAVEL_RAD, rel=0.02)


def test_a_ceiling_that_cannot_tell_a_stop_from_jaws_that_stick_is_refused(
    daemon: Daemon, gripper: LiteGrip
) -> None:
    gripper.motion_config = MotionConfig(calib_tau_limit=0.8)
    with pytest.raises(CommandError, match=r"calib_tau_limit is 0.8, it must be 1.1 to 3"):
        gripper.zero()
