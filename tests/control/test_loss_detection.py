"""A loss is reported, or the state says beforehand that it may not be."""

from dataclasses import replace

import pytest

from litegripd.model.motor import CanFrame
from tests.control.held import Held, every_mount, every_setting

TOLD_S = 0.2
COULOMB_NM, BREAKAWAY_NM = 0.15, 0.21
VELOCITY_CODES_RAD_S = 4095 / 60.0


def rubbing(times: float) -> dict[str, float]:
    """Return the figures of jaws with so many times the friction."""
    return {"coulomb_nm": times * COULOMB_NM, "breakaway_nm": times * BREAKAWAY_NM}


def loses(held: Held) -> bool:
    """Take the object away; return whether that is reported soon."""
    began_s = held.now_s
    held.gripper.remove_object()
    held.run(1.0)
    lost = held.events("object_lost")
    assert len(lost) <= 1
    assert held.state.is_grasped is not bool(lost)
    return bool(lost) and lost[0]["monotonic_s"] <= began_s + TOLD_S


@every_mount
@pytest.mark.parametrize("rate_hz", [100, 200])
@pytest.mark.parametrize("times", [1.0, 2.0, 3.0])
@pytest.mark.parametrize("far_mm", [3.0, 20.0])
def test_a_loss_is_reported_or_said_not_to_be(
    far_mm: float, times: float, rate_hz: int, mount: str
) -> None:
    """After a short way the friction is not known, and what is said must be true all the same."""
    for force_n in (2.0, 3.0, 4.0, 5.0, 6.0, 8.0, 10.0, 12.0):
        held = Held(force_n, mount, rate_hz, far_mm=far_mm, figures=rubbing(times))
        assert held.grasp_result["outcome"] == "object_held"
        state = held.state
        assert state.loss_detection_from_n is not None
        assert state.loss_detection is (force_n >= state.loss_detection_from_n)
        if state.loss_detection:
            assert loses(held), f"{force_n} N, said: from {state.loss_detection_from_n:.1f} N"


@pytest.mark.parametrize("times", [1.0, 2.0])
def test_what_is_said_is_no_more_careful_than_it_must_be(times: float) -> None:
    from_n = Held(10.0, figures=rubbing(times)).state.loss_detection_from_n
    assert from_n is not None
    assert from_n < 10.0 * (2.3 * times * COULOMB_NM + 0.1)
    assert Held(10.0, figures=rubbing(times)).state.loss_detection


class Noisy(Held):
    """The motor reports its speed with a noise of up to `noise_rad_s`, other in each answer."""

    noise_rad_s = 0.0
    _seed = 12345

    def exchange(self) -> None:
        super().exchange()
        self._in_flight = [self._falsified(frame) for frame in self._in_flight]

    def _falsified(self, frame: CanFrame) -> CanFrame:
        if frame.can_id != self.gripper.parameters.master_id or len(frame.data) != 8:
            return frame
        if frame.data[0] >> 4 != 1:  # no feedback of an enabled motor
            return frame
        self._seed = self._seed * 1103515245 + 12345 & 0x7FFFFFFF
        share = self._seed / 0x3FFFFFFF - 1.0
        code = (frame.data[3] << 4 | frame.data[4] >> 4) + round(
            share * self.noise_rad_s * VELOCITY_CODES_RAD_S
        )
        code = min(max(code, 0), 4095)
        data = bytearray(frame.data)
        data[3], data[4] = code >> 4, (code & 0xF) << 4 | data[4] & 0xF
        return replace(frame, data=bytes(data))


@every_setting
@pytest.mark.parametrize("noise_rad_s", [0.1, 0.2, 0.3])
@pytest.mark.parametrize("speed_mm_s", [25.0, 50.0])
def test_a_noisy_speed_delays_neither_the_verdict_nor_the_report_of_a_loss(
    speed_mm_s: float, noise_rad_s: float, rate_hz: int, mount: str
) -> None:
    noisy = type("NoisyNow", (Noisy,), {"noise_rad_s": noise_rad_s})
    held: Held = noisy(10.0, mount, rate_hz, speed_mm_s=speed_mm_s)
    assert held.grasp_result["outcome"] == "object_held"
    assert held.events("object_lost") == []
    held.owner.result("motion.open")
    held.run(0.2)
    number = held.owner.send("motion.grasp", force_n=10, until="verdict", speed_mm_s=speed_mm_s)
    held.run_until(lambda: held.clamp_n > 0.0)
    held.run_until(lambda: held.owner.has_answer(number), TOLD_S)
    held.run(1.0)
    assert held.state.is_grasped
    assert held.clamp_n == pytest.approx(10.0, abs=2.0)
    assert loses(held)
